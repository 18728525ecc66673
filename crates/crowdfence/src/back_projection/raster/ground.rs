//! Smooth ground: the pixels of a row of sixteen columns at once, painted column after column. What is worked out in f32
//! is exact or is not used: where a sign could be wrong, a column is painted as a hull, in f64 if need be.

use glam::DVec3;

use super::canvas::{Block, Painted};
use super::frame::{FOOT, Frame, Outlines, Row, least};
use super::hull::Sixteen;
use super::strokes::Strokes;
use super::tile::{SIDE, Tile, index};
use super::{Painter, Place};
use crate::terrain::tree::Square;

/// Pixels along each side of the image of a column up to which it is painted here.
const LARGEST: i32 = 8;

/// What of a row of columns is painted.
pub(super) struct Shapes {
    outlines: Outlines,
    /// The pixels of each, the upper four rows and the lower. Some beside its first columns and rows may be marked.
    bits: [[u32; SIDE]; 2],
    /// Those of them that may show what is under the uppermost voxel.
    doubtful: [[u32; SIDE]; 2],
    /// A bit for each column that may show something.
    may_show: u32,
    /// The same for those that are sure and have their middle in the image.
    in_image: u32,
    pixel: [i32; 2],
}

/// What of the ground of a column is painted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shown {
    OutOfRange,
    /// No pixel, or those of a block.
    Pixels(Option<Block>),
    /// To be painted with care.
    Unsure,
}

impl Shapes {
    pub const NONE: Shapes = Shapes {
        outlines: Outlines::NONE,
        bits: [[0; SIDE]; 2],
        doubtful: [[0; SIDE]; 2],
        may_show: 0,
        in_image: 0,
        pixel: [0; 2],
    };

    /// Of row `i` of a tile that lies on side `side_x` of the camera, and each of its columns on its `side_y`.
    #[inline(always)]
    fn find_ground(&mut self, frame: &Frame, tile: &Tile, i: usize, side_x: f32, side_y: &Row) {
        frame.outline_ground(tile, i, side_x, side_y, &mut self.outlines);
        self.fill::<true>(frame.pixel);
    }

    #[inline(always)]
    pub fn find_hulls(&mut self, frame: &Frame, hulls: &Sixteen) {
        frame.outline_hulls(hulls, &mut self.outlines);
        self.fill::<false>(frame.pixel);
    }

    /// Finds the pixels, which are counted from one.
    #[inline(always)]
    fn fill<const OF_GROUND: bool>(&mut self, pixel: [i32; 2]) {
        (self.bits, self.may_show, self.in_image, self.pixel) = ([[0; SIDE]; 2], 0, 0, pixel);
        self.doubtful = [[0; SIDE]; 2];
        let Outlines { value, along, count, in_image, unsure_within, under, sure, reach, .. } =
            &mut self.outlines;
        let (mut columns, mut rows) = (0, 0);
        for j in 0..SIDE {
            let is_small = count[0][j] <= LARGEST && count[1][j] <= LARGEST;
            let is_block = is_small && count[0][j] > 0 && count[1][j] > 0 && sure[j] >= 0.0;
            columns = columns.max(if is_block { count[0][j] } else { 0 });
            rows = rows.max(if is_block { count[1][j] } else { 0 });
        }
        for line in 0..rows {
            let bits = &mut self.bits[(line / 4) as usize];
            let doubtful = &mut self.doubtful[(line / 4) as usize];
            let mut at = *value;
            for column in 0..columns {
                let shift = 8 * (line % 4) + column;
                for j in 0..SIDE {
                    let inside = least(least(at[0][j], at[1][j]), least(at[2][j], at[3][j]));
                    let inside = least(inside, least(at[4][j], at[5][j]));
                    sure[j] = least(sure[j], inside.abs() - unsure_within[j]);
                    bits[j] |= (!inside.to_bits() >> 31) << shift;
                    if OF_GROUND {
                        let own = least(at[FOOT][j] - under[0][j], at[FOOT + 1][j] - under[1][j]);
                        doubtful[j] |= (own.to_bits() >> 31) << shift;
                    }
                }
                for (at, along) in at.iter_mut().zip(&along[1]) {
                    for j in 0..SIDE {
                        at[j] -= along[j];
                    }
                }
            }
            for (value, along) in value.iter_mut().zip(&along[0]) {
                for j in 0..SIDE {
                    value[j] += along[j];
                }
            }
        }
        for j in 0..SIDE {
            let is_large = count[0][j] > LARGEST || count[1][j] > LARGEST;
            let has_pixels =
                count[0][j] > 0 && count[1][j] > 0 && (is_large || self.bits[0][j] | self.bits[1][j] != 0);
            let is_sure = sure[j] >= 0.0;
            self.may_show |= u32::from((has_pixels || !is_sure) && reach[j] >= 0.0) << j;
            self.in_image |= u32::from(is_sure && in_image[j] != 0) << j;
        }
    }

    #[inline(always)]
    pub fn shown(&self, j: usize) -> Shown {
        let Outlines { first, count, sure, reach, .. } = &self.outlines;
        let (columns, rows) = (count[0][j], count[1][j]);
        if reach[j] < 0.0 {
            return Shown::OutOfRange;
        }
        // Written so that what is no number is not sure.
        let is_sure = sure[j] >= 0.0;
        if !is_sure {
            return Shown::Unsure;
        }
        if columns <= 0 || rows <= 0 {
            return Shown::Pixels(None);
        }
        if columns > LARGEST || rows > LARGEST {
            return Shown::Unsure;
        }
        Shown::Pixels(Some(Block {
            column: first[0][j] + self.pixel[0],
            row: first[1][j] + self.pixel[1],
            columns,
            rows,
            bits: u64::from(self.bits[0][j]) | u64::from(self.bits[1][j]) << 32,
        }))
    }

    /// Pixels of a column's block that may show what is under its uppermost voxel.
    #[inline(always)]
    fn doubtful(&self, j: usize, block: &Block) -> Block {
        let doubtful = u64::from(self.doubtful[0][j]) | u64::from(self.doubtful[1][j]) << 32;
        Block { bits: block.bits & doubtful, ..*block }
    }

    /// Column and row of the pixel over the middle of a column.
    #[inline(always)]
    fn middle(&self, j: usize) -> (usize, usize) {
        let [columns, rows] = &self.outlines.middle;
        ((columns[j] + self.pixel[0]) as usize, (rows[j] + self.pixel[1]) as usize)
    }
}

impl Painter<'_> {
    /// The columns of a tile, outward from the camera.
    #[inline(always)]
    pub(super) fn paint_rows(&mut self, square: &Square, tile: &Tile, frame: &Frame) {
        let side = SIDE as u32;
        let mut side_y = [0.0; SIDE];
        let mut beside_y = 0;
        for (j, side_y) in side_y.iter_mut().enumerate() {
            let side = self.place(square.low, [0, j as i32]).side[1];
            *side_y = side as f32;
            beside_y |= u32::from(side == 0) << j;
        }
        let [own_i, own_j] = [0, 1].map(|axis| self.own(axis, square.low[axis], 1, side));
        let (mut shapes, mut of_hulls) = (Shapes::NONE, Shapes::NONE);
        let mut strokes = std::mem::take(&mut self.strokes);
        for i in (own_i..side).chain((0..own_i).rev()) {
            let side_x = self.place(square.low, [i as i32, 0]).side[0];
            let beside = if side_x == 0 { u32::MAX } else { beside_y };
            shapes.find_ground(frame, tile, i as usize, side_x as f32, &side_y);
            let middles = if self.between_pixels { shapes.in_image } else { 0 };
            let stacked = tile.stacked(i as usize);
            let wanted = shapes.may_show | beside | stacked | middles;
            let wanted = wanted & tile.occupied(i as usize);
            // Onwards from the camera, then backwards.
            let (mut onwards, mut backwards) = (wanted >> own_j << own_j, wanted & ((1 << own_j) - 1));
            while onwards | backwards != 0 {
                let j = if onwards != 0 { onwards.trailing_zeros() } else { 31 - backwards.leading_zeros() };
                if onwards != 0 {
                    onwards &= onwards - 1;
                } else {
                    backwards &= !(1 << j);
                }
                let shown = if beside >> j & 1 != 0 { Shown::Unsure } else { shapes.shown(j as usize) };
                let place = self.place(square.low, [i as i32, j as i32]);
                let is_alone = strokes.is_empty() && stacked >> j & 1 == 0;
                match shown {
                    // Nothing is to be painted before it.
                    Shown::Pixels(block) if is_alone => {
                        self.paint_shape(tile, &place, block, &shapes, middles);
                    }
                    shown => self.plan_column(tile, &place, &shown, &mut strokes),
                }
            }
            if !strokes.is_empty() {
                strokes.find_pixels(frame, tile, &mut of_hulls);
                self.paint_strokes(tile, &strokes, Some((&shapes, middles)));
                strokes.clear();
            }
        }
        self.strokes = strokes;
    }

    /// The lowest solid of a column; a bit for each column of the row that has its middle in the image.
    #[inline(always)]
    pub(super) fn paint_ground(&mut self, tile: &Tile, place: &Place, shapes: &Shapes, middles: u32) {
        if let Shown::Pixels(block) = shapes.shown(place.at[1] as usize) {
            self.paint_shape(tile, place, block, shapes, middles);
        }
    }

    /// The same, voxel by voxel.
    #[inline(never)]
    fn paint_with_care(&mut self, tile: &Tile, place: &Place) {
        let mut strokes = Strokes::default();
        let lowest = tile.lowest(place.at).expect("a column with ground");
        self.plan_piece(tile, &lowest, None, place, &mut strokes);
        strokes.find_none();
        self.paint_strokes(tile, &strokes, None);
    }

    #[inline(always)]
    fn paint_shape(
        &mut self,
        tile: &Tile,
        place: &Place,
        block: Option<Block>,
        shapes: &Shapes,
        middles: u32,
    ) {
        let painted = match block {
            Some(block) => {
                let doubtful = shapes.doubtful(place.at[1] as usize, &block);
                // What the columns before have taken is no doubt any more.
                if doubtful.bits != 0 && self.canvas.has_free(&doubtful) {
                    return self.paint_with_care(tile, place);
                }
                self.canvas.paint_block(&block, self.rows.len() as u32)
            }
            None => Painted::default(),
        };
        let (at, id) = (index(place.at), tile.lowest_id(place.at));
        let middle = place.middle(f64::from(tile.ground.top[at]) + f64::from(tile.level) - self.origin.z);
        let j = place.at[1] as usize;
        if painted.count > 0 {
            self.add(id, painted, middle);
        } else if middles >> j & 1 != 0 {
            let (column, row) = shapes.middle(j);
            let [rise_x, rise_y] = &tile.ground.rise;
            let normal = DVec3::new(-2.0 * f64::from(rise_x[at]), -2.0 * f64::from(rise_y[at]), 1.0);
            if self.canvas.is_looked_at(column, row) {
                self.paint_top(id, normal, middle, column, row);
            }
        }
    }
}
