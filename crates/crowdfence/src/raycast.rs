//! Ray -> where it first meets the terrain: its surface ([`solids`]), or its voxels as cubes ([`cubes`]).
//!
//! Both are exact up to the rounding of float64, and the reference for faster ways. A ray that starts inside meets
//! the terrain at distance 0, one that starts outside the map is followed from where it enters, and one that starts
//! further than 2^40 voxels from the map hits nothing: float64 could not follow it.

mod cubes;
mod solids;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result, require};
use crate::terrain::{Surface, Terrain};

/// Where a ray first meets the terrain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The voxel that is met.
    pub voxel_id: u32,
    /// From the ray's origin.
    pub distance_m: f64,
}

/// Voxels from the map along one axis.
const FARTHEST_ORIGIN: f64 = (1u64 << 40) as f64;

impl Terrain {
    /// Where the terrain is first met from `origin` (world metres) along `direction` (any length but 0), at no
    /// more than `max_range_m`. A ray that is not one, see [`Terrain::raycast_many`], meets nothing.
    pub fn raycast(
        &self,
        surface: Surface,
        origin: DVec3,
        direction: DVec3,
        max_range_m: f64,
    ) -> Option<Hit> {
        let (origin, direction) = (self.tree_from_world(origin), unit(direction));
        let is_ray = !origin.is_nan() && direction.is_finite();
        if !is_ray || origin.abs().max_element() > FARTHEST_ORIGIN {
            return None;
        }
        let range = max_range_m / self.voxel_size_m();
        let first_hit = match surface {
            Surface::Planes => solids::first_hit(self, surface, origin, direction, range),
            Surface::Voxels => cubes::first_hit(self, origin, direction, range),
        };
        first_hit.map(|(voxel_id, distance)| Hit { voxel_id, distance_m: distance * self.voxel_size_m() })
    }

    /// Many rays in parallel. Refused with its number is one that does not start or lead to somewhere: what is not
    /// finite, a direction of length 0.
    pub fn raycast_many(
        &self,
        surface: Surface,
        origins: &[DVec3],
        directions: &[DVec3],
        max_range_m: f64,
    ) -> Result<Vec<Option<Hit>>> {
        require(max_range_m >= 0.0, "max_range_m", max_range_m, ">= 0")?;
        if directions.len() != origins.len() {
            return Err(Error::Length {
                name: "directions",
                actual: directions.len(),
                expected: origins.len(),
            });
        }
        (0..origins.len())
            .into_par_iter()
            .map(|ray| {
                check_ray(ray, origins[ray], directions[ray])?;
                Ok(self.raycast(surface, origins[ray], directions[ray], max_range_m))
            })
            .collect()
    }
}

/// Says why a ray cannot be cast.
fn check_ray(index: usize, origin: DVec3, direction: DVec3) -> Result<()> {
    let what = if !origin.is_finite() {
        "origin is not finite"
    } else if !direction.is_finite() {
        "direction is not finite"
    } else if !unit(direction).is_finite() {
        "direction has no length"
    } else {
        return Ok(());
    };
    Err(Error::Ray { index, what })
}

/// Direction of length 1; not finite when the length is 0. Its square may overflow, so the largest component
/// is taken out first.
fn unit(direction: DVec3) -> DVec3 {
    (direction / direction.abs().max_element()).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_that_cannot_be_cast_are_named() {
        let error = check_ray(7, DVec3::ZERO, DVec3::ZERO).unwrap_err();
        assert_eq!(error.to_string(), "ray 7: direction has no length");
    }

    #[test]
    fn what_leads_nowhere_meets_nothing() {
        let terrain = Terrain::from_indices(&[[0; 3], [3, 0, 0]], 1.0, DVec3::ZERO).unwrap();
        let above = DVec3::new(0.5, 0.5, 9.0);
        for surface in [Surface::Planes, Surface::Voxels] {
            let meets = |origin, direction| terrain.raycast(surface, origin, direction, 100.0).is_some();
            assert!(meets(above, DVec3::NEG_Z));
            for direction in [
                DVec3::ZERO,
                DVec3::new(f64::NAN, 0.0, -1.0),
                DVec3::new(0.0, f64::NEG_INFINITY, -1.0),
                DVec3::new(0.0, 0.0, f64::NEG_INFINITY),
            ] {
                assert!(!meets(above, direction), "{surface:?} {direction}");
            }
            assert!(!meets(DVec3::new(f64::NAN, 0.5, 9.0), DVec3::NEG_Z));
        }
    }
}
