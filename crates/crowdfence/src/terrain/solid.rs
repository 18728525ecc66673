//! What lies above one column of the grid: solids, one above the other, with air between.

use super::Plane;
use super::tree::Layer;

/// What of the terrain a ray can meet.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Surface {
    /// Where the map says that the surface lies: the top of a solid is a [`Plane`].
    #[default]
    Planes,
    /// The occupied voxels as cubes: what the paper casts rays against, and up to a voxel too high.
    Voxels,
}

impl Surface {
    /// As in configurations and reports: `planes` or `voxels`.
    pub fn name(self) -> &'static str {
        match self {
            Surface::Planes => "planes",
            Surface::Voxels => "voxels",
        }
    }
}

/// A run of voxels of one column without a gap. Heights are tree coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Solid {
    /// Of the lowest and the uppermost voxel.
    pub lowest: u32,
    pub uppermost: u32,
    /// Its top, above the floor of its uppermost voxel.
    pub plane: Plane,
    /// Where it ends below.
    pub bottom: f64,
}

impl Solid {
    /// How far the lowest solid of a column reaches below its voxels. The voxels of a wall end just above the
    /// neighbour's surface at its centre; at its edge, that may be two voxels lower.
    pub const SKIRT: f64 = 2.0;
    /// How far a solid may reach below its voxels and above them.
    pub const SINK: u32 = Plane::DROP;
    pub const RISE: u32 = Plane::RISE;

    /// The solids of a column, from the lowest upwards, each with its layers.
    pub fn of_column<'l>(
        column: &'l [Layer],
        planes: &'l [Plane],
        surface: Surface,
    ) -> impl Iterator<Item = (Solid, &'l [Layer])> {
        let mut is_lowest = true;
        column.chunk_by(|a, b| a.low + 1 == b.low).map(move |run| {
            let uppermost = run[run.len() - 1];
            let solid = match surface {
                Surface::Planes => {
                    let plane = planes[uppermost.voxel_id() as usize];
                    Solid::under_plane(run[0].low, uppermost.low, plane, is_lowest)
                }
                Surface::Voxels => Solid::of_cubes(run[0].low, uppermost.low),
            };
            is_lowest = false;
            (solid, run)
        })
    }

    pub fn under_plane(lowest: u32, uppermost: u32, plane: Plane, is_lowest: bool) -> Solid {
        let floor = f64::from(lowest) - if is_lowest { Solid::SKIRT } else { 0.0 };
        let bottom = floor.min(f64::from(uppermost) + plane.lowest_corner());
        Solid { lowest, uppermost, plane, bottom }
    }

    pub fn of_cubes(lowest: u32, uppermost: u32) -> Solid {
        Solid { lowest, uppermost, plane: Plane::CEILING, bottom: f64::from(lowest) }
    }

    /// Height of the top over the centre of the column.
    pub fn top(&self) -> f64 {
        f64::from(self.uppermost) + self.plane.height()
    }

    /// From where upwards the solid is its uppermost voxel: all of its top, and what is left of the voxel's cube.
    /// Below that a hit is one of the wall.
    pub fn shoulder(&self) -> f64 {
        f64::from(self.uppermost) + self.plane.lowest_corner().min(0.0)
    }

    /// z of the voxel that a hit at a height counts for. A hit of a top that lies on the floor of its voxel may be a
    /// rounding lower, and is none of the wall.
    pub fn voxel_at(&self, height: f64) -> u32 {
        const ROUNDING: f64 = 1e-6;
        if height >= self.shoulder() - ROUNDING || self.lowest == self.uppermost {
            return self.uppermost;
        }
        (height.max(f64::from(self.lowest)) as u32).min(self.uppermost - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hit_counts_for_the_top_or_for_the_wall_at_its_height() {
        let wall = Solid::under_plane(10, 20, Plane::new(0.25, [1.0, 0.0]), true);
        assert_eq!((wall.bottom, wall.top(), wall.shoulder()), (8.0, 20.25, 19.75));
        let counted = [20.7, 19.75, 19.7, 19.0, 15.5, 10.0, 8.1].map(|height| wall.voxel_at(height));
        assert_eq!(counted, [20, 20, 19, 19, 15, 10, 10]);
        let single = Solid::under_plane(3, 3, Plane::new(0.5, [0.0, 0.0]), false);
        assert_eq!((single.bottom, single.voxel_at(3.4), single.voxel_at(3.0)), (3.0, 3, 3));
    }

    #[test]
    fn a_bottom_lies_under_the_whole_top() {
        let steep = Solid::under_plane(5, 5, Plane::new(0.0, [1.5, 1.5]), false);
        assert_eq!(steep.bottom, 3.5);
        let cubes = Solid::of_cubes(4, 6);
        assert_eq!((cubes.bottom, cubes.top(), cubes.shoulder()), (4.0, 7.0, 6.0));
    }
}
