//! Nearly level ground in bare voxels is a stair of wide terraces: over a few columns it tells no slope. Between the edge
//! at which a terrace is stepped on and the edge at which it steps up, the surface climbs from the floor of its voxels to
//! their ceiling, in proportion to the way from either. Ground that knows one of the two alone, as a hilltop, a pit or a
//! plain with a kerb, keeps the guess with the smallest worst error, which is that of `estimate`.

use rayon::prelude::*;

use super::plane::Plane;
use super::surroundings::{self, Surroundings};
use super::tree::Block;
use super::{Index, Terrain};

/// Rise over a column, along either axis, up to which ground counts as nearly level, also across the edge of a terrace,
/// and up to which ground beside it has a say in how it is smoothed.
const LEVEL: f64 = 0.36;
const STEEPEST_BESIDE: f64 = 0.8;
/// Columns from edge to edge below which `estimate` does better.
const NARROWEST: f32 = 5.0;
/// Columns to the furthest edge that counts.
const REACH: f32 = 32.0;
/// Steps in which ways are found; a step goes two columns.
const STEPS: usize = 16;
/// Rounds in which the ways along x and y become heights without corners.
const ROUNDS: usize = 4;

/// A top that is nearly level, or beside such.
struct Top {
    id: u32,
    is_fixed: bool,
    /// West, east, south and north: which top of the other colour, or [`NOTHING`], and by how many voxels its floor is
    /// higher.
    beside: [u32; 4],
    floors: [i8; 4],
}

const NOTHING: u32 = u32::MAX;

/// Tops that take turns, as the fields of a chess board: those beside one are of the other colour.
struct Colour {
    tops: Vec<Top>,
    /// Way to where the terrace is stepped on and to where it steps up, in columns.
    ways: Vec<[f32; 2]>,
    /// Above the floors of their voxels.
    heights: Vec<f32>,
}

/// Replaces the planes of nearly level tops that lie between two edges.
pub(super) fn ramp(terrain: &Terrain, planes: &mut [Plane]) {
    let [mut white, mut black] = nearly_level(terrain, planes);
    for _ in 0..STEPS {
        white.find_ways(&black.ways);
        black.find_ways(&white.ways);
    }
    white.climb();
    black.climb();
    for _ in 0..ROUNDS {
        white.smooth(&black.heights);
        black.smooth(&white.heights);
    }
    for (own, other) in [(&white, &black), (&black, &white)] {
        for (at, top) in own.tops.iter().enumerate().filter(|&(at, _)| is_between(own.ways[at])) {
            planes[top.id as usize] = top.plane(own.heights[at], &other.heights);
        }
    }
}

impl Colour {
    fn of(tops: Vec<Top>, planes: &[Plane]) -> Colour {
        let edge = |top: &Top, step: i8| {
            let has_step = !top.is_fixed && top.beside().flatten().any(|(_, floor)| floor == step);
            if has_step { 0.5 } else { f32::INFINITY }
        };
        let ways = tops.iter().map(|top| [edge(top, -1), edge(top, 1)]).collect();
        let heights = tops.iter().map(|top| planes[top.id as usize].height() as f32).collect();
        Colour { tops, ways, heights }
    }

    fn find_ways(&mut self, others: &[[f32; 2]]) {
        self.ways.par_iter_mut().zip(&self.tops).with_min_len(1 << 12).for_each(|(ways, top)| {
            for (at, _) in top.beside().flatten().filter(|&(_, floor)| floor == 0 && !top.is_fixed) {
                for (way, beside) in ways.iter_mut().zip(others[at as usize]) {
                    *way = way.min(beside + 1.0);
                }
            }
        });
    }

    fn climb(&mut self) {
        for at in 0..self.tops.len() {
            if is_between(self.ways[at]) {
                let [down, up] = self.ways[at];
                self.heights[at] = down / (down + up);
            }
        }
    }

    /// Heights become the mean of themselves and of those beside them.
    fn smooth(&mut self, others: &[f32]) {
        let (tops, ways) = (&self.tops, &self.ways);
        self.heights.par_iter_mut().enumerate().with_min_len(1 << 12).for_each(|(at, height)| {
            if is_between(ways[at]) {
                let beside = tops[at].rises(others).into_iter().flatten();
                let (sum, count) = beside.fold((0.0, 0.0), |(sum, count), rise| (sum + rise, count + 1.0));
                let mean = if count > 0.0 { sum / count } else { *height };
                *height = (0.5 * (*height + mean)).clamp(0.0, 1.0);
            }
        });
    }
}

/// Whether a top knows both edges of a terrace that is wide enough, by its ways to them.
fn is_between([down, up]: [f32; 2]) -> bool {
    down.max(up) <= REACH && down + up >= NARROWEST
}

impl Top {
    fn beside(&self) -> impl Iterator<Item = Option<(u32, i8)>> {
        let beside = self.beside.into_iter().zip(self.floors);
        beside.map(|(at, floor)| (at != NOTHING).then_some((at, floor)))
    }

    /// Heights of the tops beside it, above the floor of its own voxel.
    fn rises(&self, others: &[f32]) -> [Option<f32>; 4] {
        std::array::from_fn(|side| {
            let (at, floor) = (self.beside[side], self.floors[side]);
            (at != NOTHING).then(|| others[at as usize] + f32::from(floor))
        })
    }

    fn plane(&self, height: f32, others: &[f32]) -> Plane {
        let [west, east, south, north] =
            self.rises(others).map(|rise| rise.map(|rise| f64::from(rise - height)));
        let slope = |before: Option<f64>, after: Option<f64>| match (before, after) {
            (Some(before), Some(after)) => 0.5 * (after - before),
            (Some(before), None) => -before,
            (None, after) => after.unwrap_or(0.0),
        };
        Plane::new(f64::from(height), [slope(west, east), slope(south, north)])
    }
}

/// White and black.
fn nearly_level(terrain: &Terrain, planes: &[Plane]) -> [Colour; 2] {
    let new = || Box::new(Surroundings::new());
    let in_block =
        |around: &mut Box<Surroundings>, block: Block| nearly_level_in(around, &block, terrain, planes);
    let blocks = terrain.tree().blocks().into_par_iter().with_min_len(8);
    let found: Vec<[Vec<Top>; 2]> = blocks.map_init(new, in_block).collect();
    let mut number = vec![NOTHING; terrain.voxel_count()];
    let mut colours = [Vec::new(), Vec::new()];
    for tops in found {
        for (colour, tops) in colours.iter_mut().zip(tops) {
            for top in tops {
                number[top.id as usize] = colour.len() as u32;
                colour.push(top);
            }
        }
    }
    colours.map(|mut tops| {
        let beside = tops.par_iter_mut().flat_map_iter(|top| &mut top.beside).filter(|at| **at != NOTHING);
        beside.for_each(|at| *at = number[*at as usize]);
        Colour::of(tops, planes)
    })
}

/// Those of a block, white and black, with ids in the place of numbers.
fn nearly_level_in(
    around: &mut Surroundings,
    block: &Block,
    terrain: &Terrain,
    planes: &[Plane],
) -> [Vec<Top>; 2] {
    let rises_at_most =
        |id: u32, bound: f64| planes[id as usize].slope().iter().all(|rise| rise.abs() <= bound);
    let [along_x, along_y] = Surroundings::STEP;
    let mut colours = [Vec::new(), Vec::new()];
    around.gather(terrain.tree(), block);
    for top in Surroundings::columns().flat_map(|column| around.tops(column)) {
        let id = around.id(top);
        if !rises_at_most(id, STEEPEST_BESIDE) {
            continue;
        }
        let (mut beside, mut floors) = ([NOTHING; 4], [0; 4]);
        for (side, step) in [-along_x, along_x, -along_y, along_y].into_iter().enumerate() {
            for rise in [0i8, 1, -1] {
                let other = surroundings::Top { column: top.column + step, z: top.z + i32::from(rise) };
                if around.is_top(other) && rises_at_most(around.id(other), STEEPEST_BESIDE) {
                    (beside[side], floors[side]) = (around.id(other), rise);
                    break;
                }
            }
        }
        let [i, j, _]: Index = terrain.index_at(around.coordinate(top));
        let is_black = (i ^ j) & 1 != 0;
        colours[usize::from(is_black)].push(Top { id, is_fixed: !rises_at_most(id, LEVEL), beside, floors });
    }
    colours
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::terrain::height_map::HeightMap;

    /// Heights at the columns' centres of bare voxels, estimated, less the true ones.
    fn errors(height: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        const SIDE: usize = 80;
        let place = |cell: usize| ((cell / SIDE) as f64 + 0.5, (cell % SIDE) as f64 + 0.5);
        let heights: Vec<f32> =
            (0..SIDE * SIDE).map(|cell| height(place(cell).0, place(cell).1) as f32).collect();
        let map = HeightMap::new(&heights, [SIDE, SIDE], 1.0).unwrap();
        let voxels = map.columns(1.0).unwrap().voxels().unwrap();
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        let inside = 12..SIDE - 12;
        inside
            .clone()
            .flat_map(|i| inside.clone().map(move |j| (i, j)))
            .map(|(i, j)| {
                let (k, id) = terrain.column(i as i32, j as i32).last().unwrap();
                f64::from(k) + terrain.plane(id).height() - height(i as f64 + 0.5, j as f64 + 0.5)
            })
            .collect()
    }

    #[test]
    fn a_stair_of_terraces_becomes_the_slope_it_was_made_from() {
        for (along_x, along_y) in [(0.08, 0.0), (0.05, 0.06), (0.1, -0.07)] {
            let errors = errors(|x, y| 30.2 + along_x * x + along_y * y);
            let worst = errors.iter().fold(0.0f64, |worst, error| worst.max(error.abs()));
            assert!(worst < 0.15, "{along_x}, {along_y}: {worst} voxels");
        }
    }

    #[test]
    fn what_is_level_stays_within_its_voxels() {
        assert!(errors(|_, _| 7.3).iter().all(|error| (error - 0.2).abs() < 1e-3), "the middle of the voxel");
        let bumps = errors(|x, y| 20.0 + 1.5 * (x / 11.0).sin() * (y / 9.0).cos());
        assert!(bumps.iter().all(|error| error.abs() <= 0.6));
    }
}
