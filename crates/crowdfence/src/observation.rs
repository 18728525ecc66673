//! What one view says about the terrain. Checked when it is made and read-only from then on, so that whoever gets
//! one, from a projection, from Python or from another machine, can rely on it.

mod bytes;
mod crowd_mass;

use crate::error::{Error, Result, require};
use crate::stamp::check_stamp;
use crate::terrain::TerrainKey;

pub use crowd_mass::CrowdMass;

/// Back-projected view of one drone.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    terrain: TerrainKey,
    drone: String,
    stamp_ns: i64,
    seen: SeenVoxels,
    occluded_ids: Vec<u32>,
    crowd_mass: CrowdMass,
    focal_px: f32,
}

/// The voxels that a view sees: parallel columns, sorted by id.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SeenVoxels {
    /// Voxels of the terrain, increasing.
    pub ids: Vec<u32>,
    /// m_i: mean heatmap value over the pixels whose ray first hits the voxel, in [0, 1].
    pub mean: Vec<f64>,
    /// Those pixels; 0 for a voxel that is in view but between the pixel centres.
    pub pixel_count: Vec<u32>,
    /// From the camera to what it sees there, at the height of the target: over the middle of the voxel's top, or of
    /// a voxel in a wall over its centre.
    pub range_m: Vec<f32>,
    /// Of the same line, below the horizon: 90 is straight down, negative is upwards.
    pub tilt_deg: Vec<f32>,
}

impl Observation {
    /// `occluded_ids`: voxels in the image and in range that something hides, sorted; none of them is seen.
    pub fn new(
        terrain: TerrainKey,
        drone: impl Into<String>,
        stamp_ns: i64,
        seen: SeenVoxels,
        occluded_ids: Vec<u32>,
        crowd_mass: CrowdMass,
    ) -> Result<Observation> {
        let drone = drone.into();
        if drone.is_empty() {
            return Err(Error::UnnamedDrone);
        }
        check_stamp(stamp_ns)?;
        seen.check_lengths()?;
        check_ids("voxel_ids", &seen.ids, terrain)?;
        check_ids("occluded_ids", &occluded_ids, terrain)?;
        if let Some(id) = first_in_both(&seen.ids, &occluded_ids) {
            return Err(Error::SeenAndOccluded { id });
        }
        seen.check_values()?;
        crowd_mass.check()?;
        Ok(Observation { terrain, drone, stamp_ns, seen, occluded_ids, crowd_mass, focal_px: 0.0 })
    }

    /// The same from a camera of this focal length, pixels: a voxel at range r is seen with r / focal metres per
    /// pixel. 0 = nobody said.
    pub fn with_focal_px(self, focal_px: f32) -> Result<Observation> {
        let ok = focal_px.is_finite() && focal_px >= 0.0;
        require(ok, "focal_px", f64::from(focal_px), "finite and >= 0")?;
        Ok(Observation { focal_px, ..self })
    }

    /// Focal length of the camera, pixels; 0 = nobody said.
    pub fn focal_px(&self) -> f32 {
        self.focal_px
    }

    /// Whose voxels the ids are.
    pub fn terrain(&self) -> TerrainKey {
        self.terrain
    }

    /// Name of the drone.
    pub fn drone(&self) -> &str {
        &self.drone
    }

    /// When the picture was taken.
    pub fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// The voxels that it sees.
    pub fn seen(&self) -> &SeenVoxels {
        &self.seen
    }

    /// [`SeenVoxels::ids`].
    pub fn voxel_ids(&self) -> &[u32] {
        &self.seen.ids
    }

    /// [`SeenVoxels::mean`].
    pub fn mean(&self) -> &[f64] {
        &self.seen.mean
    }

    /// [`SeenVoxels::pixel_count`].
    pub fn pixel_count(&self) -> &[u32] {
        &self.seen.pixel_count
    }

    /// [`SeenVoxels::range_m`].
    pub fn range_m(&self) -> &[f32] {
        &self.seen.range_m
    }

    /// [`SeenVoxels::tilt_deg`].
    pub fn tilt_deg(&self) -> &[f32] {
        &self.seen.tilt_deg
    }

    /// Voxels in the image and in range that something hides, sorted.
    pub fn occluded_ids(&self) -> &[u32] {
        &self.occluded_ids
    }

    /// Where the crowd in the picture went.
    pub fn crowd_mass(&self) -> CrowdMass {
        self.crowd_mass
    }
}

impl SeenVoxels {
    /// None yet, with room for so many.
    pub(crate) fn with_capacity(count: usize) -> SeenVoxels {
        SeenVoxels {
            ids: Vec::with_capacity(count),
            mean: Vec::with_capacity(count),
            pixel_count: Vec::with_capacity(count),
            range_m: Vec::with_capacity(count),
            tilt_deg: Vec::with_capacity(count),
        }
    }

    fn check_lengths(&self) -> Result<()> {
        let expected = self.ids.len();
        for (name, actual) in [
            ("mean", self.mean.len()),
            ("pixel_count", self.pixel_count.len()),
            ("range_m", self.range_m.len()),
            ("tilt_deg", self.tilt_deg.len()),
        ] {
            if actual != expected {
                return Err(Error::Length { name, actual, expected });
            }
        }
        Ok(())
    }

    fn check_values(&self) -> Result<()> {
        for at in 0..self.ids.len() {
            let (mean, range_m, tilt_deg) =
                (self.mean[at], f64::from(self.range_m[at]), f64::from(self.tilt_deg[at]));
            require((0.0..=1.0).contains(&mean), "mean", mean, "inside [0, 1]")?;
            require(range_m.is_finite() && range_m >= 0.0, "range_m", range_m, "finite and >= 0")?;
            require((-90.0..=90.0).contains(&tilt_deg), "tilt_deg", tilt_deg, "inside [-90, 90]")?;
        }
        Ok(())
    }
}

/// Of two sorted lists.
fn first_in_both(ids: &[u32], others: &[u32]) -> Option<u32> {
    let mut others = others.iter();
    let mut other = others.next()?;
    for id in ids {
        while other < id {
            other = others.next()?;
        }
        if other == id {
            return Some(*id);
        }
    }
    None
}

/// Sorted, unique, and of this terrain.
fn check_ids(name: &'static str, ids: &[u32], terrain: TerrainKey) -> Result<()> {
    if let Some(at) = ids.windows(2).position(|pair| pair[0] >= pair[1]) {
        return Err(Error::IdsNotSorted { name, at: at + 1, id: ids[at + 1], before: ids[at] });
    }
    ids.last().map_or(Ok(()), |&last| terrain.check_id(i64::from(last)).map(drop))
}

#[cfg(test)]
mod tests;
