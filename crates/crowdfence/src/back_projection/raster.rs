//! The fast way: the solids are painted on the image from front to back, and every pixel belongs to the first one.
//!
//! Seen from above, the grid is walked outward from the camera, tile by tile and column by column. A line of sight
//! moves away from the camera along both axes, so whatever hides a column stands in a column painted before; within
//! one, solids are painted from the camera's height upwards and downwards. A mask keeps the pixels that are taken.
//! The sum and the number of the pixels that a voxel gains are all that an observation needs: no ray of a pixel is cast,
//! and no list of hits is sorted. What stands on a column is painted as polygons: its part of smooth ground ([`ground`]), the
//! hulls of its voxels ([`hull`]), or where it is close to the camera the faces that are turned to it ([`faces`]).
//!
//! A voxel whose top gains no pixel, as the pixels around step over it, is asked for its middle by what the pixel over it
//! shows, and by its own ray where that says too little, see [`Painter::pixel_shows`].

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
use crate::terrain::tree::{Square, Stacks};
use crate::terrain::{Plane, Solid};
use canvas::{Canvas, NOBODY, Painted};
use frame::Frame;
use ground::Shown;
use optics::Optics;
use strokes::Strokes;
use tile::{Piece, Tile, corner};

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

/// Ground no further before a top than this, in voxels, has nothing between it and that.
const NEXT: f64 = 1.5;

/// Steps to the pixels that show what may stand before a top: a wall, the next ones; a slope that rises slowly, the others.
const AROUND: [[isize; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [4, 0], [-4, 0], [0, 4], [0, -4]];

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
    fn sighting(&self, vantage: &Vantage) -> Sighting {
        let Painted { sum, count } = self.painted;
        let mean = (sum / f64::from(count.max(1))).min(1.0);
        let line = self.place.as_dvec3() * vantage.terrain.voxel_size_m();
        let is_turned_away =
            self.below_top == 0.0 && is_turned_away(line, vantage.plane_of_top(self.id).normal());
        Sighting { voxel_id: self.id, mean, pixel_count: count, line, is_turned_away }
    }
}

/// A top that gained no pixel, while the pixel over its middle was still free.
struct Early {
    /// Of its sighting.
    row: u32,
    normal: DVec3,
    /// Relative to the camera.
    middle: DVec3,
    /// Column and row.
    pixel: [usize; 2],
}

struct Painter<'a> {
    vantage: &'a Vantage<'a>,
    optics: Optics,
    stacks: Stacks<'a>,
    canvas: Canvas<'a>,
    rows: Vec<Row>,
    occluded_ids: Vec<u32>,
    early: Vec<Early>,
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
            self.rows.push(Row { id, painted, place: place.as_vec3(), below_top: below_top as f32 });
        }
    }

    /// A top that has gained no pixel.
    #[inline(always)]
    fn paint_middle(&mut self, piece: &Piece, place: &Place) {
        let middle = place.middle(piece.solid.top() - self.origin.z);
        self.paint_middle_at(piece.id, middle, piece.solid.plane);
    }

    #[inline(always)]
    fn paint_middle_at(&mut self, id: u32, middle: DVec3, plane: Plane) {
        if middle.length_squared() > self.range * self.range {
            return;
        }
        if let Some((column, row)) = self.pixel_over(middle) {
            self.paint_top(id, plane.normal(), middle, column, row);
        }
    }

    /// Column and row of the pixel over a point; None behind the camera and outside the image.
    #[inline(always)]
    fn pixel_over(&self, point: DVec3) -> Option<(usize, usize)> {
        let image = self.optics.image(point);
        if image.depth > 0.0 { self.canvas.pixel_at(image.pixel()) } else { None }
    }

    /// The same by its middle and the pixel over that.
    #[inline(always)]
    fn paint_top(&mut self, id: u32, normal: DVec3, middle: DVec3, column: usize, row: usize) {
        let is_turned_away = is_turned_away(middle, normal);
        let owner = self.canvas.owner(column, row);
        if !is_turned_away && owner == NOBODY {
            self.early.push(Early { row: self.rows.len() as u32, normal, middle, pixel: [column, row] });
        }
        if !is_turned_away && (owner == NOBODY || self.shows_middle(id, normal, middle, [column, row])) {
            let painted = Painted { sum: f64::from(self.canvas.value(column, row)), count: 0 };
            self.rows.push(Row { id, painted, place: middle.as_vec3(), below_top: 0.0 });
        } else {
            self.occluded_ids.push(id);
        }
    }

    /// Tops that were asked for while the pixel over their middle was free, and that what was painted there later hides:
    /// the ray of its centre passes other columns than that of the middle, and these may come later.
    fn hidden_later(&self) -> Vec<u32> {
        let hidden = self.early.iter().filter(|early| !self.shows_early(early));
        hidden.map(|early| early.row).collect()
    }

    fn shows_early(&self, Early { row, normal, middle, pixel: [column, line] }: &Early) -> bool {
        let id = self.rows[*row as usize].id;
        let owner = self.canvas.owner(*column, *line);
        if owner == NOBODY {
            // On a pixel of which the lens model says nothing nothing is ever painted.
            return !self.canvas.is_blind(*column, *line) || self.is_met_by_its_ray(id, *middle, 0.0);
        }
        let distance = self.rows[owner as usize].place.as_dvec3().length();
        distance >= middle.length()
            || self.pixel_shows(*normal, *middle, [*column, *line]) == Some(true)
            || self.is_met_by_its_ray(id, *middle, distance - 2.0)
    }

    #[inline(always)]
    fn shows_middle(&self, id: u32, normal: DVec3, middle: DVec3, pixel_over: [usize; 2]) -> bool {
        self.pixel_shows(normal, middle, pixel_over).unwrap_or_else(|| {
            let owner = &self.rows[self.canvas.owner(pixel_over[0], pixel_over[1]) as usize];
            self.is_met_by_its_ray(id, middle, owner.place.as_dvec3().length() - 2.0)
        })
    }

    /// Whether the middle of a top that faces the camera is in view, by who owns the pixel over it. Its own ray passes the
    /// centre of that pixel by less than the pixel's size, so it is in view when what the pixel shows is the same ground a
    /// little nearer: no further than the pixel's own footprint on the ground reaches, and with its top no higher above it
    /// than half a voxel and half a pixel. Close to the camera that much hides far more, a steep top, here or there, does not
    /// go on as far as the footprint, a ramp rises further up to its edge, and on a long footprint a wall may stand, which the
    /// next pixel shows: None there, and the ray itself is to be cast.
    #[inline(always)]
    fn pixel_shows(&self, normal: DVec3, middle: DVec3, pixel_over: [usize; 2]) -> Option<bool> {
        let (height, distance) = (-normal.dot(middle), middle.length());
        let owner = &self.rows[self.canvas.owner(pixel_over[0], pixel_over[1]) as usize];
        let nearer = owner.place.as_dvec3();
        let pixel = distance / self.optics.focal_px;
        let footprint = pixel * distance * normal.length() / height;
        let gap = distance - nearer.length();
        let rise = normal.dot(nearer - middle) + normal.z * f64::from(owner.below_top);
        let most = 0.5 + 0.5 * pixel;
        if gap > 1.5 * footprint + 2.0 || rise > most {
            return Some(false);
        }
        let level_footprint = pixel * distance / (-middle.z).max(0.0);
        if owner.below_top > 0.0 || gap > 1.5 * level_footprint + 2.0 {
            return None;
        }
        let own = self.vantage.plane_of_top(owner.id).normal();
        // How much higher than its middle the highest corner of what the pixel shows stands over this top.
        let lean = 0.5 * ((own.x - normal.x).abs() + (own.y - normal.y).abs());
        let own_footprint =
            nearer.length_squared() * own.length() / (self.optics.focal_px * -own.dot(nearer));
        let is_sure = (rise + lean) * distance <= most * nearer.length()
            && gap <= 1.5 * own_footprint.max(0.0) + 2.0
            && (gap <= NEXT || !self.stands_before(middle, most, pixel_over));
        is_sure.then_some(true)
    }

    /// Whether a pixel around one shows what is nearer than a middle and stands so high above the line to it that more than
    /// `most` of what is there is hidden, or nobody knows what it shows.
    #[inline(always)]
    fn stands_before(&self, middle: DVec3, most: f64, pixel: [usize; 2]) -> bool {
        let distance = middle.length();
        AROUND.into_iter().any(|step| {
            let Some((column, row)) = self.canvas.beside(pixel, step) else { return true };
            let owner = self.canvas.owner(column, row);
            if owner == NOBODY {
                return !self.canvas.is_looked_at(column, row) || self.canvas.is_blind(column, row);
            }
            let Row { place, below_top, .. } = &self.rows[owner as usize];
            let top = f64::from(place.z) + f64::from(*below_top);
            if top < middle.z + 1e-4 && middle.z < 0.0 {
                return false; // as low, and nearer to a camera above both: level ground is done with
            }
            let nearer = place.as_dvec3().length();
            nearer < distance && top * distance - middle.z * nearer > most * nearer
        })
    }

    /// Whether nothing hides a middle, from a distance on: the ray of the pixel has met nothing before its owner.
    #[cold]
    fn is_met_by_its_ray(&self, id: u32, middle: DVec3, from: f64) -> bool {
        let terrain = self.vantage.terrain;
        let start = middle * (from / middle.length()).max(0.0);
        let origin = self.vantage.origin + start * terrain.voxel_size_m();
        let hit = terrain.raycast(self.vantage.surface, origin, middle, self.vantage.max_range_m);
        hit.is_some_and(|hit| hit.voxel_id == id)
    }
}

#[cfg(test)]
mod tests;
