//! A method beside what it believes about every voxel that was seen.

use super::pages::Pages;
use crate::method::{Evidence, FusionMethod, Method, Or, Paper};

#[derive(Debug, Clone)]
pub(super) enum Beliefs {
    Evidence(BeliefsOf<Evidence>),
    Paper(BeliefsOf<Paper>),
    Or(BeliefsOf<Or>),
}

#[derive(Debug, Clone)]
pub(super) struct BeliefsOf<M: FusionMethod> {
    pub method: M,
    pub pages: Pages<M::Belief>,
}

impl<M: FusionMethod> BeliefsOf<M> {
    pub fn new(method: M, voxel_count: usize) -> BeliefsOf<M> {
        BeliefsOf { method, pages: Pages::new(voxel_count, M::NO_BELIEF) }
    }
}

impl Beliefs {
    pub fn new(method: Method, voxel_count: usize) -> Beliefs {
        match method {
            Method::Evidence(evidence) => Beliefs::Evidence(BeliefsOf::new(evidence, voxel_count)),
            Method::Paper(paper) => Beliefs::Paper(BeliefsOf::new(paper, voxel_count)),
            Method::Or(or) => Beliefs::Or(BeliefsOf::new(or, voxel_count)),
        }
    }

    pub fn method(&self) -> Method {
        match self {
            Beliefs::Evidence(beliefs) => Method::Evidence(beliefs.method.clone()),
            Beliefs::Paper(beliefs) => Method::Paper(beliefs.method),
            Beliefs::Or(beliefs) => Method::Or(beliefs.method),
        }
    }
}
