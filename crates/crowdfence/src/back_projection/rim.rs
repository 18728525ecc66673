//! The rim of the map: ground beside a column in which there is nothing, at a hole or at the map's edge.
//!
//! The open side of such ground hides what lies behind it, but what a picture shows there stands beside the map, nobody
//! knows how low. Crowd there counts for the rim, which is the nearest that the map knows. Emptiness there does not:
//! people on a quay were thinned out by the water before it, of which the map knows nothing.

use glam::{DVec2, DVec3};

use super::Vantage;
use crate::terrain::{Plane, Surface};

/// Sum of heatmap values and number of the pixels of a voxel.
pub(super) type Pixels = (f64, u32);

/// Mean value of a voxel of the rim. `own` are the pixels of its top and of sides that are not open, `beside` those of
/// open sides; where it has none of its own, `at_middle` is the value over the middle of its top.
pub(super) fn mean_at_rim(own: Pixels, beside: Pixels, at_middle: Option<f64>) -> f64 {
    let mean = |(sum, count): Pixels| sum / f64::from(count);
    let of_all = mean((own.0 + beside.0, own.1 + beside.1));
    let of_own = if own.1 > 0 { Some(mean(own)) } else { at_middle };
    of_own.map_or(of_all, |of_own| of_own.max(of_all))
}

/// The uppermost voxel of ground beside a column in which there is nothing.
pub(super) struct Rim {
    /// Corner of lowest coordinates of its column, relative to where rays start.
    low: DVec2,
    /// Height of its top over the middle of the column, relative to that too, and its slope.
    top: f64,
    slope: DVec2,
    /// For x and y: whether the side towards lower coordinates is open, and the one towards higher.
    is_open: [[bool; 2]; 2],
}

impl Rim {
    /// None for all other voxels. The voxels as cubes have no rim: there, the sides are those of the paper.
    pub fn of(vantage: &Vantage, id: u32) -> Option<Rim> {
        let terrain = vantage.terrain;
        let index @ [i, j, k] = terrain.index(id);
        let plane = terrain.top_plane(id, index).filter(|_| vantage.surface == Surface::Planes)?;
        let is_nothing = |i: i32, j: i32| terrain.column(i, j).next().is_none();
        let is_open = [
            [is_nothing(i.wrapping_sub(1), j), is_nothing(i.wrapping_add(1), j)],
            [is_nothing(i, j.wrapping_sub(1)), is_nothing(i, j.wrapping_add(1))],
        ];
        if is_open == [[false; 2]; 2] {
            return None;
        }
        let heights: Vec<i32> =
            terrain.column(i, j).map(|(k, _)| k).take_while(|&height| height <= k).collect();
        let is_ground = heights.windows(2).all(|pair| pair[0] + 1 == pair[1]);
        is_ground.then(|| Rim::new(vantage, id, plane, is_open))
    }

    fn new(vantage: &Vantage, id: u32, plane: Plane, is_open: [[bool; 2]; 2]) -> Rim {
        let center = (vantage.terrain.center(id) - vantage.origin) / vantage.terrain.voxel_size_m();
        let low = center.truncate() - 0.5;
        Rim { low, top: center.z - 0.5 + plane.height(), slope: plane.slope().into(), is_open }
    }

    /// Whether a ray that first meets this voxel meets an open side of it.
    pub fn is_met_beside(&self, direction: DVec3) -> bool {
        let distances: [f64; 2] = std::array::from_fn(|axis| {
            let is_from_high = direction[axis] < 0.0;
            let distance = (self.low[axis] + f64::from(u8::from(is_from_high))) / direction[axis];
            if distance.is_finite() { distance } else { f64::NEG_INFINITY }
        });
        let axis = usize::from(distances[1] > distances[0]);
        let distance = distances[axis];
        let at = direction * distance;
        let over = at.z - self.top - self.slope.dot(at.truncate() - self.low - 0.5);
        distance > 0.0 && over <= 0.0 && self.is_open[axis][usize::from(direction[axis] < 0.0)]
    }
}
