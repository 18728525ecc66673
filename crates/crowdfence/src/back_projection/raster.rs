//! The fast way: the solids are painted on the image from front to back, and every pixel belongs to the first one.
//!
//! Seen from above, the grid is walked outward from the camera, tile by tile and column by column. A line of sight
//! moves away from the camera along both axes, so whatever hides a column stands in a column painted before; within
//! one, solids are painted from the camera's height upwards and downwards. A mask keeps the pixels that are taken.
//! The sum and the number of the pixels that a voxel gains are all that an observation needs: no ray of a pixel is cast,
//! and no list of hits is sorted. What stands on a column is painted as polygons: its part of smooth ground ([`ground`]), the
//! hulls of its voxels ([`hull`]), or where it is close to the camera the faces that are turned to it ([`faces`]).
//!
//! What gains no pixel may be in view all the same ([`between_pixels`]).

mod between_pixels;
mod canvas;
mod faces;
mod frame;
mod ground;
mod hull;
mod optics;
mod prism;
mod strokes;
mod tile;

use glam::{DVec3, Vec3};

use super::sighting::{Sighting, seen_voxels};
use super::tops::is_turned_away;
use super::{Looked, Vantage};
use crate::camera::IdealPixels;
use crate::terrain::Solid;
use crate::terrain::tree::{Square, Stacks};
use between_pixels::Early;
use canvas::{Canvas, Painted};
use frame::Frame;
use ground::Shown;
use optics::Optics;
use strokes::Strokes;
use tile::{Tile, corner};

/// Looks through a pinhole, or through a lens by its ideal pixels. With `between_pixels`, voxels that no pixel centre
/// hits are seen as well.
pub(super) fn paint(vantage: &Vantage, lens: Option<&IdealPixels>, between_pixels: bool) -> Looked {
    let mut painter = Painter::new(vantage, lens, between_pixels);
    let root = painter.stacks.root();
    painter.walk(&root, &mut Box::default());
    let hidden = painter.hidden_later();
    let Painter { canvas, rows, mut occluded_ids, .. } = painter;
    let mut order: Vec<(u32, u32)> = rows.iter().map(|row| row.id).zip(0..).collect();
    for &row in hidden.iter().rev() {
        occluded_ids.push(rows[row as usize].id);
        order.swap_remove(row as usize);
    }
    radsort::sort_by_key(&mut order, |&(id, _)| id);
    radsort::sort(&mut occluded_ids);
    let sightings = order.iter().map(|&(_, row)| rows[row as usize].sighting(vantage));
    Looked { seen: seen_voxels(sightings, order.len()), occluded_ids, on_ground: canvas.into_painted() }
}

/// What has been painted for one voxel.
struct Row {
    id: u32,
    painted: Painted,
    /// A point of it, relative to the camera.
    place: Vec3,
    /// How far the top of its solid lies above that, in voxels: a wall goes on above each of its voxels.
    below_top: f32,
}

impl Row {
    /// Height of the top of its solid above the camera, in voxels.
    fn top(&self) -> f64 {
        f64::from(self.place.z) + f64::from(self.below_top)
    }

    fn sighting(&self, vantage: &Vantage) -> Sighting {
        let Painted { sum, count } = self.painted;
        let mean = (sum / f64::from(count.max(1))).min(1.0);
        let line = self.place.as_dvec3() * vantage.terrain.voxel_size_m();
        let is_turned_away =
            self.below_top == 0.0 && is_turned_away(line, vantage.plane_of_top(self.id).normal());
        Sighting { voxel_id: self.id, mean, pixel_count: count, line, is_turned_away }
    }
}

struct Painter<'a> {
    vantage: &'a Vantage<'a>,
    optics: Optics,
    stacks: Stacks<'a>,
    canvas: Canvas<'a>,
    rows: Vec<Row>,
    occluded_ids: Vec<u32>,
    early: Vec<Early>,
    /// The highest top of what has gained pixels, above the camera, in voxels.
    highest: f64,
    strokes: Strokes,
    /// Camera, tree coordinates. All other places are relative to it.
    origin: DVec3,
    /// Voxels.
    range: f64,
    between_pixels: bool,
    /// Whether lines of sight may have passed under the ground: over a hole of the map, or from beside it. What is
    /// turned away may show from below then.
    is_open: bool,
}

/// The work on one tile, compiled for every width of vectors and run with the widest of this machine: on all the same
/// sums in the same order.
struct PaintTile<'p, 'a> {
    painter: &'p mut Painter<'a>,
    square: &'p Square,
    tile: &'p mut Tile,
}

impl pulp::WithSimd for PaintTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.painter.paint_tile(self.square, self.tile);
    }
}

/// A column of the tile that is being painted.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// In the tile.
    at: [i32; 2],
    /// Its corner of lowest coordinates, relative to the camera.
    low: [f64; 2],
    /// Along each axis, on which side of the camera: -1, 1, or 0 when the camera is above or below it.
    side: [i32; 2],
}

/// Numbers of the corners of a column, see [`corner`], as the camera sees them.
struct Edges {
    left: usize,
    near: usize,
    right: usize,
    far: usize,
}

impl Place {
    /// Of a column away from the camera's own row and column.
    #[inline(always)]
    fn edges(&self) -> Edges {
        let [side_x, side_y] = self.side;
        let (near_x, near_y) = (usize::from(side_x < 0), usize::from(side_y < 0));
        let (far_x, far_y) = (1 - near_x, 1 - near_y);
        let (one, other) = (corner(near_x, far_y), corner(far_x, near_y));
        let (left, right) = if side_x == side_y { (one, other) } else { (other, one) };
        Edges { left, near: corner(near_x, near_y), right, far: corner(far_x, far_y) }
    }

    /// Relative to the camera, at a height that is too.
    #[inline(always)]
    fn corner(&self, x: usize, y: usize, height: f64) -> DVec3 {
        DVec3::new(self.low[0] + x as f64, self.low[1] + y as f64, height)
    }

    #[inline(always)]
    fn middle(&self, height: f64) -> DVec3 {
        DVec3::new(self.low[0] + 0.5, self.low[1] + 0.5, height)
    }
}

impl<'a> Painter<'a> {
    fn new(vantage: &'a Vantage<'a>, lens: Option<&'a IdealPixels>, between_pixels: bool) -> Painter<'a> {
        let terrain = vantage.terrain;
        let origin = terrain.tree_from_world(vantage.origin);
        let stacks = Stacks::new(terrain.tree());
        let side = f64::from(stacks.root().side());
        let is_over_ground = (0.0..side).contains(&origin.x)
            && (0.0..side).contains(&origin.y)
            && terrain.tree().column(origin.x as u32, origin.y as u32).next().is_some();
        Painter {
            vantage,
            optics: Optics::of(vantage.view, lens),
            stacks,
            canvas: Canvas::new(vantage.view, lens, between_pixels),
            rows: Vec::new(),
            occluded_ids: Vec::new(),
            early: Vec::new(),
            highest: f64::NEG_INFINITY,
            strokes: Strokes::default(),
            origin,
            range: vantage.max_range_m / terrain.voxel_size_m(),
            between_pixels,
            is_open: !is_over_ground,
        }
    }

    /// Paints what stands on a square, outward from the camera.
    fn walk(&mut self, square: &Square, tile: &mut Tile) {
        let (low, high) = self.bounds(square);
        if !self.may_show(low, high) {
            return;
        }
        if square.side() as usize <= tile::SIDE {
            return pulp::Arch::new().dispatch(PaintTile { painter: self, square, tile });
        }
        let side = square.side() / Stacks::SIDE;
        for x in self.outward(0, square.low[0], side, Stacks::SIDE) {
            for y in self.outward(1, square.low[1], side, Stacks::SIDE) {
                if let Some(child) = self.stacks.child(square, x, y) {
                    self.walk(&child, tile);
                    self.stacks.release(&child);
                } else if !self.is_open {
                    let from = DVec3::new(f64::from(x * side), f64::from(y * side), 0.0);
                    let size = DVec3::new(f64::from(side), f64::from(side), high.z - low.z);
                    self.is_open = self.may_show(low + from, low + from + size);
                }
            }
        }
    }

    /// Numbers of cells in a row along an axis, so that each comes after those between it and the camera.
    #[inline(always)]
    fn outward(&self, axis: usize, low: u32, side: u32, count: u32) -> impl Iterator<Item = u32> + use<> {
        let own = self.own(axis, low, side, count);
        (own..count).chain((0..own).rev())
    }

    /// The one of these cells that the camera is in or next to.
    #[inline(always)]
    fn own(&self, axis: usize, low: u32, side: u32, count: u32) -> u32 {
        let own = (self.origin[axis] - f64::from(low)) / f64::from(side);
        own.clamp(0.0, f64::from(count - 1)) as u32
    }

    /// Corners of a box around all that stands on a square.
    fn bounds(&self, square: &Square) -> (DVec3, DVec3) {
        let (lowest, highest) = self.stacks.span(square);
        let side = f64::from(square.side());
        let [x, y] = square.low.map(f64::from);
        let low = DVec3::new(x, y, f64::from(lowest) - f64::from(Solid::SINK)) - self.origin;
        let high = DVec3::new(x + side, y + side, f64::from(highest + Solid::RISE)) - self.origin;
        (low, high)
    }

    /// False only when nothing of a box is in range and in the part of the image that was looked at.
    fn may_show(&self, low: DVec3, high: DVec3) -> bool {
        let nearest = DVec3::ZERO.clamp(low, high);
        nearest.length_squared() <= self.range * self.range
            && self.optics.may_show(low, high)
            && !(self.canvas.is_of_part() && self.is_not_looked_at(low, high))
    }

    fn is_not_looked_at(&self, low: DVec3, high: DVec3) -> bool {
        self.optics.around(low, high).is_some_and(|(low, high)| self.canvas.is_not_looked_at(low, high))
    }

    #[inline(always)]
    fn paint_tile(&mut self, square: &Square, tile: &mut Tile) {
        let (low, high) = self.bounds(square);
        let around = self.optics.around(low, high);
        // All that stands on the square may lie behind what has been painted.
        let is_covered = match around {
            Some((low, high)) => self.canvas.is_covered(low, high),
            None => false,
        };
        if is_covered && !self.between_pixels {
            return;
        }
        if let Some((low, high)) = around.filter(|_| !is_covered) {
            self.canvas.ask_for(low, high);
        }
        self.gather(square, !is_covered, tile);
        self.is_open |= !tile.is_full();
        if is_covered {
            self.paint_middles(square, tile);
        } else {
            self.paint_columns(square, tile);
        }
    }

    /// Of a tile on which no pixel is free.
    fn paint_middles(&mut self, square: &Square, tile: &Tile) {
        let side = square.side() as i32;
        for at in (0..side).flat_map(|i| (0..side).map(move |j| [i, j])) {
            let place = self.place(square.low, at);
            for piece in tile.lowest(at).iter().chain(tile.upper(at)) {
                self.paint_middle(piece, &place);
            }
        }
    }

    #[inline(always)]
    fn paint_columns(&mut self, square: &Square, tile: &Tile) {
        if let Some(frame) = Frame::of(self, square, tile) {
            return self.paint_rows(square, tile, &frame);
        }
        let side = square.side();
        let mut strokes = std::mem::take(&mut self.strokes);
        for i in self.outward(0, square.low[0], 1, side) {
            for j in self.outward(1, square.low[1], 1, side) {
                let place = self.place(square.low, [i as i32, j as i32]);
                self.plan_column(tile, &place, &Shown::Unsure, &mut strokes);
                strokes.find_none();
                self.paint_strokes(tile, &strokes, None);
                strokes.clear();
            }
        }
        self.strokes = strokes;
    }

    #[inline(always)]
    fn place(&self, corner: [u32; 2], at: [i32; 2]) -> Place {
        let (mut low, mut side) = ([0.0; 2], [0; 2]);
        for axis in 0..2 {
            low[axis] = f64::from(corner[axis]) + f64::from(at[axis]) - self.origin[axis];
            side[axis] = i32::from(low[axis] >= 0.0) - i32::from(low[axis] <= -1.0);
        }
        Place { at, low, side }
    }

    /// What stands on a square and, with a rim, just outside on the sides that are turned to the camera.
    #[inline(always)]
    fn gather(&mut self, square: &Square, with_rim: bool, tile: &mut Tile) {
        let mut beyond = Vec::with_capacity(2);
        let side = square.side() as i32;
        let near = self.place(square.low, [0, 0]).side;
        let far = self.place(square.low, [side - 1, side - 1]).side;
        for axis in 0..2 {
            let outside = match (near[axis], far[axis]) {
                (1, _) => -side,
                (_, -1) => side,
                _ => continue,
            };
            let from = std::array::from_fn(|other| if other == axis { outside } else { 0 });
            let [x, y] = std::array::from_fn(|axis| square.low[axis].checked_add_signed(from[axis]));
            if let Some(at) = x.zip(y).filter(|_| with_rim)
                && let Some(square) = self.stacks.square_at([at.0, at.1], square.levels())
            {
                beyond.push((square, from));
            }
        }
        tile.gather(&self.stacks, square, &beyond, self.vantage.terrain.planes(), self.vantage.surface);
        beyond.first().into_iter().for_each(|(square, _)| self.stacks.release(square));
    }

    #[inline(always)]
    fn add(&mut self, id: u32, painted: Painted, place: DVec3) {
        self.add_below_top(id, painted, place, 0.0);
    }

    #[inline(always)]
    fn add_below_top(&mut self, id: u32, painted: Painted, place: DVec3, below_top: f64) {
        if painted.count > 0 {
            let row = Row { id, painted, place: place.as_vec3(), below_top: below_top as f32 };
            self.highest = self.highest.max(row.top());
            self.rows.push(row);
        }
    }

    /// Column and row of the pixel over a point; None behind the camera and outside the image.
    #[inline(always)]
    fn pixel_over(&self, point: DVec3) -> Option<(usize, usize)> {
        let image = self.optics.image(point);
        if image.depth > 0.0 { self.canvas.pixel_at(image.pixel()) } else { None }
    }
}

#[cfg(test)]
mod tests;
