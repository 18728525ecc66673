//! Columns of smooth ground, or hulls -> the polygons that they are painted as, sixteen at once, in f32.
//!
//! Coordinates are those of a tile, from its middle, and pixels are counted from one in its image. So the numbers are
//! small: heights and places are exact, and an image is off by less than [`Frame::error`].
//!
//! The loop over the columns has neither branches nor calls, so that it becomes vectors as wide as the machine's.

use glam::DVec3;

use super::Painter;
use super::hull::Sixteen;
use super::prism::OVERLAP;
use super::tile::{COLUMNS, SIDE, STRIDE, Tile, index};
use crate::terrain::tree::Square;

/// Nearest depth of a tile, in voxels.
const NEAREST: f64 = 1.0;
/// Furthest, from the pixel that places are counted from, that anything of a tile may have its place.
const WIDEST_PX: f64 = 2000.0;
/// Height of a tile up to which the heights in it are exact: 10 bits before the point, and 13 behind it.
const HIGHEST: f64 = 1000.0;
/// How sure signs must be of lengths in voxels.
const SURE: f32 = 0.01;
/// Sine of the angle from the plumb line under the camera within which a vertical edge has no direction to rely on.
const PLUMB: f32 = 0.05;
/// How far the corners of a column are from its middle, seen from above, and a hair more.
const HALF_DIAGONAL: f32 = 0.71;
/// What may show of a column under its uppermost voxel, in voxels, for it to be painted as smooth ground all the same.
const MOST_UNDER: f32 = 0.5;
/// Sides of the polygon that a column is painted as.
pub const EDGES: usize = 6;
/// The first of the two that meet in the foot.
pub const FOOT: usize = 3;

/// A number for each column of a row.
pub type Row = [f32; SIDE];

/// How a tile lies before the camera.
pub struct Frame {
    /// Pixel coordinates times depth, and depth, of a step along each axis.
    u: [f32; 3],
    v: [f32; 3],
    depth: [f32; 3],
    /// Of the middle.
    middle_depth: f32,
    /// Of the middle, from the pixel that is counted from.
    middle_px: [f32; 2],
    /// The pixel that is counted from.
    pub pixel: [i32; 2],
    /// The bounds of the image, from there.
    low: [f32; 2],
    high: [f32; 2],
    /// Bound of the error of an image, pixels.
    error: f32,
    /// Middle, relative to the camera.
    middle: [f32; 3],
    range: f32,
    focal_px: f32,
    /// See [`Painter`].
    is_open: bool,
}

/// A row of columns along y: the polygon that each is painted as.
pub struct Outlines {
    /// Of each side: which of its sides the centre of the first pixel lies on, positive inside; and where it leads.
    pub value: [Row; EDGES],
    pub along: [[Row; EDGES]; 2],
    /// First column and row of pixels, and their number.
    pub first: [[i32; SIDE]; 2],
    pub count: [[i32; SIDE]; 2],
    /// The pixel over the middle of its top, and 1 where that is one of the image.
    pub middle: [[i32; SIDE]; 2],
    pub in_image: [i32; SIDE],
    /// How near to a side no pixel may lie.
    pub unsure_within: Row,
    /// Inside the two sides that meet in the foot, pixels up to this value may be those of what is under the uppermost
    /// voxel, or of nothing; negative where all are its own.
    pub under: [Row; 2],
    /// Negative when a column has to be painted with more care.
    pub sure: Row,
    /// Negative when a column is out of range.
    pub reach: Row,
}

impl Outlines {
    pub const NONE: Outlines = Outlines {
        value: [[0.0; SIDE]; EDGES],
        along: [[[0.0; SIDE]; EDGES]; 2],
        first: [[0; SIDE]; 2],
        count: [[0; SIDE]; 2],
        middle: [[0; SIDE]; 2],
        in_image: [0; SIDE],
        unsure_within: [0.0; SIDE],
        under: [[-1.0; SIDE]; 2],
        sure: [0.0; SIDE],
        reach: [0.0; SIDE],
    };
}

/// Images of the corners of a polygon, clockwise as the camera sees them, of which a crest or a foot that is not there
/// is the next corner.
struct Corners {
    left_top: (f32, f32),
    crest: (f32, f32),
    right_top: (f32, f32),
    right_low: (f32, f32),
    foot: (f32, f32),
    left_low: (f32, f32),
    /// Infinite where there is none, else 0.
    no_crest: f32,
    no_foot: f32,
}

impl Frame {
    /// None where too much of the tile is near the camera, or too high.
    pub fn of(painter: &Painter, square: &Square, tile: &Tile) -> Option<Frame> {
        if square.side() as usize != SIDE || !painter.canvas.is_of_pinhole() {
            return None;
        }
        let (low, high) = painter.bounds(square);
        let optics = &painter.optics;
        let (box_middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let (box_depth, spread) = (optics.depth.dot(box_middle), optics.depth.abs().dot(half));
        let nearest = box_depth - spread;
        if nearest < NEAREST || half.z > HIGHEST {
            return None;
        }
        let middle = box_middle.with_z(f64::from(tile.level) - painter.origin.z);
        let image = optics.image(middle);
        let pixel = image.pixel();
        let (u, v) = (optics.u - pixel.x * optics.depth, optics.v - pixel.y * optics.depth);
        // The level is rounded from the middle of the box.
        let half = half + DVec3::Z;
        let wide = u.abs().dot(half).max(v.abs().dot(half)) / nearest;
        if wide > WIDEST_PX {
            return None;
        }
        let from = pixel.floor();
        // Of a number that is divided and of the depth: coefficients, products and sums are rounded.
        let roundings = 6.0 + 5.0 * (box_depth + spread) / nearest;
        let error = 0.5 * f64::from(f32::EPSILON) * (wide * roundings + 4.0);
        Some(Frame {
            u: single(u),
            v: single(v),
            depth: single(optics.depth),
            middle_depth: image.depth as f32,
            middle_px: (pixel - from).as_vec2().to_array(),
            pixel: from.as_ivec2().to_array(),
            low: (optics.low - from).as_vec2().to_array(),
            high: (optics.high - from).as_vec2().to_array(),
            error: error as f32,
            middle: single(middle),
            range: painter.range as f32,
            focal_px: optics.focal_px as f32,
            is_open: painter.is_open,
        })
    }

    #[inline(always)]
    fn image(&self, x: f32, y: f32, z: f32) -> (f32, f32) {
        let depth = x * self.depth[0] + y * self.depth[1] + z * self.depth[2] + self.middle_depth;
        let inverse = 1.0 / depth;
        let u = x * self.u[0] + y * self.u[1] + z * self.u[2];
        let v = x * self.v[0] + y * self.v[1] + z * self.v[2];
        (u * inverse, v * inverse)
    }

    /// Direction in which a point that is lifted moves in the image, of length 1 as the sum of both; and that sum
    /// before.
    #[inline(always)]
    fn upwards(&self, at: (f32, f32)) -> ((f32, f32), f32) {
        let (x, y) = (self.u[2] - at.0 * self.depth[2], self.v[2] - at.1 * self.depth[2]);
        let length = x.abs() + y.abs();
        let inverse = 1.0 / length;
        ((x * inverse, y * inverse), length)
    }

    /// The pixel before which a bound lies, cut to the image.
    #[inline(always)]
    fn bound(&self, at: f32, axis: usize) -> i32 {
        nearest(least(most(at + self.middle_px[axis], self.low[axis]), self.high[axis]))
    }

    /// Of row `i` of a tile, which lies on side `side_x` of the camera, and each of its columns on its `side_y`.
    #[inline(always)]
    pub fn outline_ground(&self, tile: &Tile, i: usize, side_x: f32, side_y: &Row, outlines: &mut Outlines) {
        let ground = &tile.ground;
        let at = index([i as i32, 0]);
        let beside = if side_x > 0.0 { at - STRIDE } else { at + STRIDE };
        let (low, high) = (at - 1, at + 1);
        let [rises_x, rises_y] = &ground.rise;
        let (top, shoulder, bottom) =
            (row(&ground.top, at), row(&ground.shoulder, at), row(&ground.bottom, at));
        let (rise_x, rise_y) = (row(rises_x, at), row(rises_y, at));
        let (top_x, top_low, top_high) =
            (row(&ground.top, beside), row(&ground.top, low), row(&ground.top, high));
        let (x_rise_x, x_rise_y) = (row(rises_x, beside), row(rises_y, beside));
        let (low_rise_x, low_rise_y) = (row(rises_x, low), row(rises_y, low));
        let (high_rise_x, high_rise_y) = (row(rises_x, high), row(rises_y, high));
        let bottoms = &ground.bottom;
        let (bottom_x, bottom_low, bottom_high) =
            (row(bottoms, beside), row(bottoms, low), row(bottoms, high));
        let nexts = &ground.next_bottom;
        let (next_x, next_low, next_high) = (row(nexts, beside), row(nexts, low), row(nexts, high));
        let deepest_shown = if self.is_open { f32::NEG_INFINITY } else { f32::INFINITY };

        let x = i as f32 + 0.5 - 0.5 * SIDE as f32;
        let half_x = 0.5 * side_x;
        for j in 0..SIDE {
            let y = j as f32 + 0.5 - 0.5 * SIDE as f32;
            let (side_y, is_high) = (side_y[j], side_y[j] < 0.0);
            let half_y = 0.5 * side_y;
            let (top, rise_x, rise_y) = (top[j], rise_x[j], rise_y[j]);
            let top_y = if is_high { top_high[j] } else { top_low[j] };
            let y_rise_x = if is_high { high_rise_x[j] } else { low_rise_x[j] };
            let y_rise_y = if is_high { high_rise_y[j] } else { low_rise_y[j] };
            let bottom_y = if is_high { bottom_high[j] } else { bottom_low[j] };
            let next_y = if is_high { next_high[j] } else { next_low[j] };
            // How far the edges turned to the camera stand above those of the columns before them.
            let step_x =
                top - rise_x * side_x - (top_x[j] + x_rise_x[j] * side_x) + (rise_y - x_rise_y[j]).abs();
            let step_y = top - rise_y * side_y - (top_y + y_rise_y * side_y) + (rise_x - y_rise_x).abs();
            let step = most(most(step_x, step_y), 0.0);
            let drop = step + OVERLAP as f32;

            let (across, along) = (rise_x * side_x + rise_y * side_y, rise_y * side_x - rise_x * side_y);
            let (front, back, left, right) = (top - across, top + across, top + along, top - along);
            let lowest = least(least(front, left), right) - drop;
            // What shows under the uppermost voxel, at most: where planes meet but for their roundings, next to nothing.
            let under = shoulder[j] - lowest;
            let bottom_before = most(bottom_x[j], bottom_y);
            let next_before = least(next_x[j], next_y);
            let mut sure = least(MOST_UNDER - under, top - bottom_before);
            sure = least(sure, next_before - top - SURE);
            // Written so that it is a number where there is nothing before a column, of infinite bottom.
            sure = least(sure, most(bottom[j] - bottom_before, deepest_shown));
            let (middle_x, middle_y, middle_z) =
                (x + self.middle[0], y + self.middle[1], top + self.middle[2]);
            let above = 2.0 * (rise_x * middle_x + rise_y * middle_y) - middle_z;
            sure = least(sure, above.abs() - SURE);
            let distance = (middle_x * middle_x + middle_y * middle_y + middle_z * middle_z).sqrt();
            let (spare, size) = (self.range - distance, rise_x.abs() + rise_y.abs() + drop + HALF_DIAGONAL);
            sure = least(sure, spare - size);

            let is_above = above > 0.0;
            let ridge_side = if is_above { 1.0 } else { -1.0 };
            let ridge_height = if is_above { back } else { front };
            let corners = Corners {
                left_top: self.image(x - half_y, y + half_x, left),
                crest: self.image(x + ridge_side * half_x, y + ridge_side * half_y, ridge_height),
                right_top: self.image(x + half_y, y - half_x, right),
                right_low: self.image(x + half_y, y - half_x, right - drop),
                foot: self.image(x - half_x, y - half_y, front - drop),
                left_low: self.image(x - half_y, y + half_x, left - drop),
                no_crest: 0.0,
                no_foot: 0.0,
            };
            sure = least(sure, self.outline(&corners, j, outlines));
            let cut = |x: f32, y: f32, height: f32| self.image(x, y, most(height - drop, shoulder[j]));
            let right_cut = cut(x + half_y, y - half_x, right);
            let foot_cut = cut(x - half_x, y - half_y, front);
            let left_cut = cut(x - half_y, y + half_x, left);
            for (number, from, ends) in
                [(0, corners.right_low, [right_cut, foot_cut]), (1, corners.foot, [foot_cut, left_cut])]
            {
                let edge = FOOT + number;
                let along = (outlines.along[0][edge][j], outlines.along[1][edge][j]);
                let [one, other] = ends.map(|end| side_of(along, minus(end, from)));
                let within = most(one, other) + outlines.unsure_within[j];
                outlines.under[number][j] = if under > 0.0 { within } else { -1.0 };
            }
            // Turned away behind an edge that is no lower, it shows nothing, but for its underside.
            let is_hidden = above < 0.0 && step <= 0.0;
            let is_step_behind = above + drop < SURE && step > 0.0;
            let is_underside = is_hidden && self.is_open;
            outlines.sure[j] = if is_step_behind || is_underside { -1.0 } else { sure };
            outlines.reach[j] = spare + size;
            outlines.count[0][j] = if is_hidden && !is_underside { 0 } else { outlines.count[0][j] };

            let (u, v) = self.image(x, y, top);
            let (u, v) = (u + self.middle_px[0], v + self.middle_px[1]);
            // On the bound itself `below` could be the number before it.
            let is_in = (u > self.low[0]) & (u < self.high[0]) & (v > self.low[1]) & (v < self.high[1]);
            outlines.middle[0][j] = below(u);
            outlines.middle[1][j] = below(v);
            outlines.in_image[j] = i32::from(is_in);
        }
    }

    /// Of hulls, all of them in range.
    #[inline(always)]
    pub fn outline_hulls(&self, hulls: &Sixteen, outlines: &mut Outlines) {
        let Sixteen { place: [xs, ys], side: [sides_x, sides_y], left, right, crest, foot } = hulls;
        for j in 0..SIDE {
            let (x, y, half_x, half_y) = (xs[j], ys[j], 0.5 * sides_x[j], 0.5 * sides_y[j]);
            let (left_x, left_y, right_x, right_y) = (x - half_y, y + half_x, x + half_y, y - half_x);
            let right_top = self.image(right_x, right_y, right[0][j]);
            let left_low = self.image(left_x, left_y, left[1][j]);
            let (crest_side, foot_side) = (crest[0][j], foot[0][j]);
            let crest = self.image(x + crest_side * half_x, y + crest_side * half_y, crest[1][j]);
            let foot = self.image(x + foot_side * half_x, y + foot_side * half_y, foot[1][j]);
            let corners = Corners {
                left_top: self.image(left_x, left_y, left[0][j]),
                crest: if crest_side == 0.0 { right_top } else { crest },
                right_top,
                right_low: self.image(right_x, right_y, right[1][j]),
                foot: if foot_side == 0.0 { left_low } else { foot },
                left_low,
                no_crest: if crest_side == 0.0 { f32::INFINITY } else { 0.0 },
                no_foot: if foot_side == 0.0 { f32::INFINITY } else { 0.0 },
            };
            outlines.sure[j] = self.outline(&corners, j, outlines);
            outlines.reach[j] = 0.0;
            outlines.in_image[j] = 0;
        }
    }

    /// Puts down sides and pixels of polygon `j`. Negative when its vertical edges have no direction to rely on.
    #[inline(always)]
    fn outline(&self, corners: &Corners, j: usize, outlines: &mut Outlines) -> f32 {
        let &Corners { left_top, crest, right_top, right_low, foot, left_low, no_crest, no_foot } = corners;
        let (left_up, left_length) = self.upwards(left_top);
        let (right_up, right_length) = self.upwards(right_top);

        let lowest_x = least(least(left_top.0, crest.0), least(right_top.0, right_low.0));
        let lowest_x = least(lowest_x, least(foot.0, left_low.0));
        let lowest_y = least(least(left_top.1, crest.1), least(right_top.1, right_low.1));
        let lowest_y = least(lowest_y, least(foot.1, left_low.1));
        let highest_x = most(most(left_top.0, crest.0), most(right_top.0, right_low.0));
        let highest_x = most(highest_x, most(foot.0, left_low.0));
        let highest_y = most(most(left_top.1, crest.1), most(right_top.1, right_low.1));
        let highest_y = most(highest_y, most(foot.1, left_low.1));
        let margin = 2.0 * self.error;
        let (column, line) = (self.bound(lowest_x - margin, 0), self.bound(lowest_y - margin, 1));
        outlines.first[0][j] = column;
        outlines.first[1][j] = line;
        outlines.count[0][j] = self.bound(highest_x + margin, 0).wrapping_sub(column);
        outlines.count[1][j] = self.bound(highest_y + margin, 1).wrapping_sub(line);
        let extent = highest_x - lowest_x + (highest_y - lowest_y);
        outlines.unsure_within[j] = (4.0 * extent + 4.0) * (self.error + 2e-6);

        // Seen from the centre of the first pixel.
        let center = (column as f32 + 0.5 - self.middle_px[0], line as f32 + 0.5 - self.middle_px[1]);
        let sides = [
            (left_top, minus(crest, left_top), 0.0),
            (crest, minus(right_top, crest), no_crest),
            (right_top, (-right_up.0, -right_up.1), 0.0),
            (right_low, minus(foot, right_low), 0.0),
            (foot, minus(left_low, foot), no_foot),
            (left_top, left_up, 0.0),
        ];
        for (edge, (from, along, none)) in sides.into_iter().enumerate() {
            let place = minus(center, from);
            outlines.value[edge][j] = side_of(along, place) + none;
            outlines.along[0][edge][j] = along.0;
            outlines.along[1][edge][j] = along.1;
        }
        least(left_length, right_length) - PLUMB * self.focal_px
    }
}

/// How far a place lies to the right of a line through the origin, as one sees it, times the line's length.
#[inline(always)]
fn side_of(along: (f32, f32), place: (f32, f32)) -> f32 {
    along.0 * place.1 - along.1 * place.0
}

/// The nearest whole number, of a number of less than four millions.
#[inline(always)]
fn nearest(number: f32) -> i32 {
    /// Added to it, it leaves no bits for what is behind the point.
    const WHOLE: f32 = 12_582_912.0;
    ((number + WHOLE).to_bits() as i32).wrapping_sub(WHOLE.to_bits() as i32)
}

/// The whole number below, or on a whole number itself one of the two around.
#[inline(always)]
fn below(number: f32) -> i32 {
    nearest(number - 0.5)
}

#[inline(always)]
fn row(values: &[f32; COLUMNS], at: usize) -> &Row {
    values[at..at + SIDE].try_into().expect("a row of the tile")
}

#[inline(always)]
pub fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn minus(a: (f32, f32), b: (f32, f32)) -> (f32, f32) {
    (a.0 - b.0, a.1 - b.1)
}

fn single(vector: DVec3) -> [f32; 3] {
    vector.as_vec3().to_array()
}
