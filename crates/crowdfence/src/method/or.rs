//! Baseline `or`: a voxel once called crowd by any view stays crowd.

use super::{Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::Result;
use crate::opinion_pool::require_b_threshold;
use crate::sealed::{Reader, Writer};

/// Method `or`, the paper's baseline: crowd is what any view ever called so.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Or {
    b_threshold: f64,
}

impl FusionMethod for Or {
    /// Whether any view ever called it crowd.
    type Belief = bool;
    const NO_BELIEF: bool = false;
    /// Nothing fades.
    type Fading = ();
    const NAME: &'static str = "or";
    const ORDER: InstantOrder = InstantOrder::Any;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, _since: Elapsed) {}

    fn update(&self, before: Option<(bool, ())>, looks: &[(VoxelLook, ())]) -> bool {
        let crowd_before = before.is_some_and(|(crowd, _)| crowd);
        crowd_before || looks.iter().any(|(look, ())| look.mean > self.b_threshold)
    }

    fn probability(&self, crowd: bool, _fading: ()) -> f64 {
        f64::from(u8::from(crowd))
    }

    fn unseen_probability(&self) -> f64 {
        0.0
    }

    fn default_threshold(&self) -> f64 {
        0.5
    }

    fn stays_below(&self, _probability: f64) -> bool {
        true
    }

    fn b_threshold(&self) -> f64 {
        self.b_threshold
    }

    fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        vec![("b_threshold", Parameter::Number(self.b_threshold))]
    }
}

impl Or {
    /// A view calls a voxel crowd when m > `b_threshold`, in [0, 1).
    pub fn new(b_threshold: f64) -> Result<Or> {
        require_b_threshold(b_threshold)?;
        Ok(Or { b_threshold })
    }
}

/// f64 b_threshold, in version 1 after a u64 fleet size that nothing depended on. A belief is a u8, 0 or 1, in
/// version 1 an f64, 0 or 1.
impl Stored for Or {
    fn write(&self, payload: &mut Writer) {
        payload.f64(self.b_threshold);
    }

    fn read(reader: &mut Reader<'_>, version: u32) -> Result<Or> {
        if version == 1 {
            reader.u64()?;
        }
        Or::new(reader.f64()?)
    }

    fn write_belief(crowd: bool, payload: &mut Writer) {
        payload.u8(u8::from(crowd));
    }

    fn read_beliefs(reader: &mut Reader<'_>, version: u32, count: usize) -> Result<Vec<bool>> {
        let codes: Vec<f64> = match version {
            1 => reader.numbers(count, f64::from_le_bytes)?,
            _ => reader.take(count)?.iter().copied().map(f64::from).collect(),
        };
        let crowd = |&code: &f64| match code {
            0.0 => Ok(false),
            1.0 => Ok(true),
            _ => Err(reader.damaged("a belief that is neither 0 nor 1")),
        };
        codes.iter().map(crowd).collect()
    }
}
