//! A method beside what it believes about every voxel that was seen.

use super::pages::Pages;
use crate::method::{Evidence, FusionMethod, LinearPool, LogOdds, LogPool, Method, MovingAverage, Or, Paper};

#[derive(Debug, Clone)]
pub(super) enum Beliefs {
    Evidence(BeliefsOf<Evidence>),
    Paper(BeliefsOf<Paper>),
    Or(BeliefsOf<Or>),
    LinearPool(BeliefsOf<LinearPool>),
    LogPool(BeliefsOf<LogPool>),
    LogOdds(BeliefsOf<LogOdds>),
    MovingAverage(BeliefsOf<MovingAverage>),
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
            Method::LinearPool(pool) => Beliefs::LinearPool(BeliefsOf::new(pool, voxel_count)),
            Method::LogPool(pool) => Beliefs::LogPool(BeliefsOf::new(pool, voxel_count)),
            Method::LogOdds(odds) => Beliefs::LogOdds(BeliefsOf::new(odds, voxel_count)),
            Method::MovingAverage(average) => Beliefs::MovingAverage(BeliefsOf::new(average, voxel_count)),
        }
    }

    pub fn method(&self) -> Method {
        match self {
            Beliefs::Evidence(beliefs) => Method::Evidence(beliefs.method.clone()),
            Beliefs::Paper(beliefs) => Method::Paper(beliefs.method),
            Beliefs::Or(beliefs) => Method::Or(beliefs.method),
            Beliefs::LinearPool(beliefs) => Method::LinearPool(beliefs.method),
            Beliefs::LogPool(beliefs) => Method::LogPool(beliefs.method.clone()),
            Beliefs::LogOdds(beliefs) => Method::LogOdds(beliefs.method),
            Beliefs::MovingAverage(beliefs) => Method::MovingAverage(beliefs.method.clone()),
        }
    }
}
