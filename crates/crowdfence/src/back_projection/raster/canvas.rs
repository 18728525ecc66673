//! The picture being painted: which pixels something has been painted on, by whom, and what they show.

use std::borrow::Cow;
use std::ops::Range;

use glam::DVec2;

use crate::back_projection::pixel_set::{PixelSet, WORD, bits, spans};
use crate::camera::{Camera, IdealPixels};
use crate::view::View;

/// Rows up to which a rectangle of pixels is small.
const FEW_ROWS: usize = 8;
/// Owner of a pixel on which nothing is painted.
pub const NOBODY: u32 = u32::MAX;
/// Corners that a painted polygon may have.
pub const MAX_CORNERS: usize = 8;

/// Pixels that a polygon was the first to be painted on.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Painted {
    /// Of their heatmap values.
    pub sum: f64,
    pub count: u32,
}

impl std::ops::AddAssign for Painted {
    fn add_assign(&mut self, other: Painted) {
        self.sum += other.sum;
        self.count += other.count;
    }
}

/// Pixels of a part of the image, up to eight rows of eight.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Block {
    pub column: i32,
    pub row: i32,
    pub columns: i32,
    pub rows: i32,
    /// Eight bits a row; those beyond the columns and rows do not count.
    pub bits: u64,
}

impl Block {
    /// The bits of a row of the block.
    #[inline(always)]
    fn line(&self, line: usize) -> u64 {
        self.bits >> (8 * line) & ((1 << self.columns) - 1)
    }
}

pub struct Canvas<'a> {
    width: usize,
    height: usize,
    /// What is painted on, and what was not looked at: nothing is painted there.
    covered: PixelSet,
    /// None where all was looked at.
    not_looked_at: Option<PixelSet>,
    /// Who painted each pixel, row after row; nothing when nobody asks.
    owner: Vec<u32>,
    /// Heatmap value of each pixel, row after row.
    values: Cow<'a, [f32]>,
    /// Of a lens that distorts, with the camera it belongs to: polygons are then those of a pinhole.
    lens: Option<(&'a Camera, &'a IdealPixels)>,
}

impl<'a> Canvas<'a> {
    /// With owners if it will be asked for them.
    pub fn new(view: &'a View, lens: Option<&'a IdealPixels>, with_owners: bool) -> Canvas<'a> {
        let lens = lens.map(|pixels| (view.camera.as_ref(), pixels));
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let not_looked_at = view.looked_at_pixels().map(|looked_at| {
            let others: Vec<bool> = looked_at.iter().map(|looked_at| !looked_at).collect();
            PixelSet::of(width, &others)
        });
        Canvas {
            width,
            height,
            covered: not_looked_at.clone().unwrap_or_else(|| PixelSet::empty(width, height)),
            not_looked_at,
            owner: if with_owners { vec![NOBODY; width * height] } else { Vec::new() },
            values: view.pixel_values(),
            lens,
        }
    }

    /// Column and row of the pixel over a place of the image, that of a pinhole; None outside and where the pixel was not
    /// looked at.
    #[inline(always)]
    pub fn pixel_at(&self, place: DVec2) -> Option<(usize, usize)> {
        let pixel = match self.lens {
            None => place,
            Some((camera, _)) => camera.pixel_of_ideal(place)?,
        };
        let size = DVec2::new(self.width as f64, self.height as f64);
        let is_inside = pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all();
        let (column, row) = (pixel.x as usize, pixel.y as usize);
        (is_inside && self.is_looked_at(column, row)).then_some((column, row))
    }

    #[inline(always)]
    pub fn is_looked_at(&self, column: usize, row: usize) -> bool {
        self.not_looked_at.as_ref().is_none_or(|others| !others.contains(column, row))
    }

    /// Whether the lens model gives the centre of a pixel no ray.
    pub fn is_blind(&self, column: usize, row: usize) -> bool {
        self.lens.is_some_and(|(_, pixels)| pixels.place(column, row).is_nan())
    }

    pub fn value(&self, column: usize, row: usize) -> f32 {
        self.values[row * self.width + column]
    }

    pub fn owner(&self, column: usize, row: usize) -> u32 {
        self.owner[row * self.width + column]
    }

    /// Column and row of the pixel so many columns and rows away; None outside of the picture.
    #[inline(always)]
    pub fn beside(&self, [column, row]: [usize; 2], [right, down]: [isize; 2]) -> Option<(usize, usize)> {
        let (column, row) = (column.checked_add_signed(right)?, row.checked_add_signed(down)?);
        (column < self.width && row < self.height).then_some((column, row))
    }

    /// Whether all pixels up to so many columns and rows away are in the picture and would show what is there.
    #[inline(always)]
    pub fn is_shown_around(&self, [column, row]: [usize; 2], away: usize) -> bool {
        let is_inside = |at: usize, count: usize| at >= away && at + away < count;
        let is_whole = self.not_looked_at.is_none() && self.lens.is_none();
        is_whole && is_inside(column, self.width) && is_inside(row, self.height)
    }

    /// The pixels painted on.
    pub fn into_painted(mut self) -> PixelSet {
        if let Some(others) = &self.not_looked_at {
            self.covered.remove(others);
        }
        self.covered
    }

    /// Has the heatmap fetched under a part of the image, all of it at once: one by one, the values would be waited for.
    #[inline(always)]
    pub fn ask_for(&self, low: DVec2, high: DVec2) {
        /// Values in a line of the cache.
        const LINE: usize = 16;
        let mut asked_for = 0;
        let columns = centers_between(low.x, high.x, self.width);
        for row in centers_between(low.y, high.y, self.height) {
            let start = row * self.width;
            let mut at = start + columns.start;
            while at < start + columns.end {
                asked_for ^= self.values[at].to_bits();
                at += LINE;
            }
        }
        std::hint::black_box(asked_for);
    }

    /// Paints the pixels whose centres lie in a polygon and that are still free. `accepts` has the last word on each.
    #[inline(always)]
    pub fn paint(
        &mut self,
        polygon: &Polygon,
        owner: u32,
        accepts: Option<&dyn Fn(DVec2) -> bool>,
    ) -> Painted {
        if let Some(lens) = self.lens {
            return self.paint_through_lens(lens, polygon, owner, accepts);
        }
        let mut painted = Painted::default();
        let rows = centers_between(lowest(&polygon.y), highest(&polygon.y), self.height);
        let columns = centers_between(lowest(&polygon.x), highest(&polygon.x), self.width);
        if rows.is_empty() || columns.is_empty() {
            return painted;
        }
        // Of a small one it pays to look before anything is worked out.
        if rows.len() <= FEW_ROWS && columns.len() <= WORD && self.are_covered(rows.clone(), &columns) {
            return painted;
        }
        let outline = Outline::of(polygon);
        for row in rows {
            let (left, right) = outline.at(row as f64 + 0.5);
            let columns = centers_between(left, right, self.width);
            if !columns.is_empty() {
                painted += self.paint_span(row, columns, owner, accepts);
            }
        }
        painted
    }

    /// Whether any of a block is still free.
    #[inline(always)]
    pub fn has_free(&self, block: &Block) -> bool {
        (0..block.rows as usize).any(|line| {
            block.line(line) & !self.covered_from(block.column as usize, block.row as usize + line) != 0
        })
    }

    /// Whether pixels are painted on, a bit each from one of a row on.
    #[inline(always)]
    fn covered_from(&self, column: usize, row: usize) -> u64 {
        let (word, shift) = (column / WORD, column % WORD);
        let at = row * self.covered.words_a_row + word;
        let [first, second] = &self.covered.words[at..at + 2] else { unreachable!() };
        first >> shift | second << 1 << (WORD - 1 - shift)
    }

    /// Paints those of a block that are still free, through a pinhole.
    #[inline(always)]
    pub fn paint_block(&mut self, block: &Block, owner: u32) -> Painted {
        let mut painted = Painted::default();
        let (column, row) = (block.column as usize, block.row as usize);
        let (word, shift) = (column / WORD, column % WORD);
        let mut sums = [0.0f32; 8];
        for line in 0..block.rows as usize {
            let free = block.line(line) & !self.covered_from(column, row + line);
            if free == 0 {
                continue;
            }
            let at = (row + line) * self.covered.words_a_row + word;
            self.covered.words[at] |= free << shift;
            self.covered.words[at + 1] |= free >> 1 >> (WORD - 1 - shift);
            painted.count += free.count_ones();
            let at = (row + line) * self.width + column;
            // Eight values without a branch; they may be beyond the block, but not beyond the picture.
            if let Some(values) = self.values.get(at..at + 8) {
                for bit in 0..8 {
                    sums[bit] += if free as u32 & 1 << bit != 0 { values[bit] } else { 0.0 };
                }
            } else {
                for (bit, value) in self.values[at..].iter().enumerate() {
                    sums[bit] += if free >> bit & 1 != 0 { *value } else { 0.0 };
                }
            }
            if !self.owner.is_empty() {
                let mut rest = free;
                while rest != 0 {
                    self.owner[at + rest.trailing_zeros() as usize] = owner;
                    rest &= rest - 1;
                }
            }
        }
        let [a, b, c, d, e, f, g, h] = sums;
        painted.sum = f64::from((a + b + (c + d)) + (e + f + (g + h)));
        painted
    }

    pub fn is_of_pinhole(&self) -> bool {
        self.lens.is_none()
    }

    /// The same through a lens that distorts, pixel by pixel.
    fn paint_through_lens(
        &mut self,
        (camera, pixels): (&Camera, &IdealPixels),
        polygon: &Polygon,
        owner: u32,
        accepts: Option<&dyn Fn(DVec2) -> bool>,
    ) -> Painted {
        let mut painted = Painted::default();
        let low = DVec2::new(lowest(&polygon.x), lowest(&polygon.y));
        let high = DVec2::new(highest(&polygon.x), highest(&polygon.y));
        let (least, most) = pixels.bounds();
        let (low, high) = (low.max(least), high.min(most));
        if low.cmpgt(high).any() {
            return painted;
        }
        let (rows, columns) = self.pixels_around(camera, pixels, low, high);
        let outline = Outline::of(polygon);
        for row in rows {
            for column in columns.clone() {
                let covered = &mut self.covered.words[row * self.covered.words_a_row + column / WORD];
                if *covered >> (column % WORD) & 1 != 0 {
                    continue;
                }
                let place = pixels.place(column, row);
                // Written so that a blind pixel, without a place, lies nowhere.
                let may_lie_inside = low.cmple(place).all() && place.cmple(high).all();
                if !may_lie_inside {
                    continue;
                }
                let (left, right) = outline.at(place.y);
                if left < place.x && place.x <= right && accepts.is_none_or(|accepts| accepts(place)) {
                    *covered |= 1 << (column % WORD);
                    let at = row * self.width + column;
                    painted.sum += f64::from(self.values[at]);
                    painted.count += 1;
                    own(&mut self.owner, at, owner);
                }
            }
        }
        painted
    }

    /// Rows and columns of the pixels that may have their place in a rectangle.
    fn pixels_around(
        &self,
        camera: &Camera,
        pixels: &IdealPixels,
        low: DVec2,
        high: DVec2,
    ) -> (Range<usize>, Range<usize>) {
        let (rows, columns) = pixels.around(low, high);
        if rows.is_empty() || columns.is_empty() {
            return (0..0, 0..0);
        }
        let Some(middle) = camera.pixel_of_ideal(0.5 * (low + high)) else {
            return (rows, columns); // where the lens model ends
        };
        let reach = pixels.reach(0.5 * (high - low));
        let near_rows = centers_between(middle.y - reach.y, middle.y + reach.y, self.height);
        let near_columns = centers_between(middle.x - reach.x, middle.x + reach.x, self.width);
        (common(&rows, &near_rows), common(&columns, &near_columns))
    }

    /// Whether nothing can be painted any more on a rectangle of the image, that of a pinhole.
    pub fn is_covered(&self, low: DVec2, high: DVec2) -> bool {
        let (rows, columns) = self.pixels_in(low, high);
        columns.is_empty() || self.are_covered(rows, &columns)
    }

    /// Whether there are pixels that were not looked at.
    pub fn is_of_part(&self) -> bool {
        self.not_looked_at.is_some()
    }

    /// Whether a rectangle of the image, that of a pinhole, has pixels and none of them was looked at.
    pub fn is_not_looked_at(&self, low: DVec2, high: DVec2) -> bool {
        let Some(others) = &self.not_looked_at else { return false };
        // The middle of a top belongs to the pixel that it lies in, not to those whose centres are inside.
        let (rows, columns) = self.pixels_in(low - 1.0, high + 1.0);
        !rows.is_empty() && !columns.is_empty() && others.contain(rows, &columns)
    }

    /// Rows and columns of the pixels of a rectangle of the image, that of a pinhole.
    fn pixels_in(&self, low: DVec2, high: DVec2) -> (Range<usize>, Range<usize>) {
        match self.lens {
            None => (centers_between(low.y, high.y, self.height), centers_between(low.x, high.x, self.width)),
            Some((camera, pixels)) => {
                let (least, most) = pixels.bounds();
                self.pixels_around(camera, pixels, low.clamp(least, most), high.clamp(least, most))
            }
        }
    }

    /// Whether nothing can be painted on pixels by their rows and columns, at least one of these.
    #[inline(always)]
    fn are_covered(&self, rows: Range<usize>, columns: &Range<usize>) -> bool {
        self.covered.contain(rows, columns)
    }

    #[inline(always)]
    fn paint_span(
        &mut self,
        row: usize,
        columns: Range<usize>,
        owner: u32,
        accepts: Option<&dyn Fn(DVec2) -> bool>,
    ) -> Painted {
        let mut painted = Painted::default();
        let start = row * self.width;
        for (word, columns) in spans(&columns) {
            let span = bits(&columns);
            let covered = &mut self.covered.words[row * self.covered.words_a_row + word];
            let mut free = span & !*covered;
            if free == 0 {
                continue;
            }
            if free == span && accepts.is_none() {
                *covered |= span;
                let pixels = start + columns.start..start + columns.end;
                painted.sum += sum(&self.values[pixels.clone()]);
                if let Some(owners) = self.owner.get_mut(pixels) {
                    owners.fill(owner);
                }
                painted.count += columns.len() as u32;
                continue;
            }
            while free != 0 {
                let bit = free.trailing_zeros() as usize;
                free &= free - 1;
                let column = word * WORD + bit;
                let center = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                if accepts.is_none_or(|accepts| accepts(center)) {
                    *covered |= 1 << bit;
                    painted.sum += f64::from(self.values[start + column]);
                    painted.count += 1;
                    own(&mut self.owner, start + column, owner);
                }
            }
        }
        painted
    }
}

#[inline(always)]
fn own(owners: &mut [u32], at: usize, owner: u32) {
    if let Some(pixel) = owners.get_mut(at) {
        *pixel = owner;
    }
}

/// What two ranges have in common.
#[inline(always)]
fn common(some: &Range<usize>, others: &Range<usize>) -> Range<usize> {
    let start = some.start.max(others.start);
    start..some.end.min(others.end).max(start)
}

/// Pixels along one axis whose centres lie between two coordinates.
#[inline(always)]
fn centers_between(low: f64, high: f64, count: usize) -> Range<usize> {
    let end = count as f64;
    // As i32, to which a machine converts at once; images have fewer rows and columns.
    let nearest = |at: f64| (at.clamp(0.0, end) + 0.5) as i32 as usize;
    nearest(low)..nearest(high).min(count)
}

/// Of a long row in eight partial sums, so that it does not depend on the machine how wide its vectors are.
#[inline(always)]
fn sum(values: &[f32]) -> f64 {
    let mut total = 0.0;
    let mut rest = values;
    if values.len() >= 8 {
        let mut sums = [0.0f64; 8];
        let (eights, remainder) = values.as_chunks::<8>();
        for eight in eights {
            for (sum, value) in sums.iter_mut().zip(eight) {
                *sum += f64::from(*value);
            }
        }
        total = (sums[0] + sums[1] + (sums[2] + sums[3])) + (sums[4] + sums[5] + (sums[6] + sums[7]));
        rest = remainder;
    }
    rest.iter().fold(total, |total, value| total + f64::from(*value))
}

#[inline(always)]
pub fn lowest(values: &[f64; MAX_CORNERS]) -> f64 {
    let mut low = *values;
    for half in [4, 2, 1] {
        for at in 0..half {
            low[at] = if low[at + half] < low[at] { low[at + half] } else { low[at] };
        }
    }
    low[0]
}

#[inline(always)]
pub fn highest(values: &[f64; MAX_CORNERS]) -> f64 {
    -lowest(&values.map(|value| -value))
}

/// A convex polygon in the image, in continuous pixel coordinates. Its corners go clockwise as one sees them; corners
/// may be repeated.
#[derive(Debug, Clone, Copy)]
pub struct Polygon {
    pub x: [f64; MAX_CORNERS],
    pub y: [f64; MAX_CORNERS],
}

/// The sides of a polygon as functions of y.
struct Outline {
    x: [f64; MAX_CORNERS],
    y: [f64; MAX_CORNERS],
    slope: [f64; MAX_CORNERS],
    /// What to add to the x of a side for it not to count on the left, and on the right.
    not_left: [f64; MAX_CORNERS],
    not_right: [f64; MAX_CORNERS],
}

impl Outline {
    #[inline(always)]
    fn of(polygon: &Polygon) -> Outline {
        let Polygon { x, y } = *polygon;
        let mut next = *polygon;
        next.x.rotate_left(1);
        next.y.rotate_left(1);
        let mut outline = Outline {
            x,
            y,
            slope: [0.0; MAX_CORNERS],
            not_left: [0.0; MAX_CORNERS],
            not_right: [0.0; MAX_CORNERS],
        };
        for side in 0..MAX_CORNERS {
            let (run, rise) = (next.x[side] - x[side], next.y[side] - y[side]);
            let slope = run / rise;
            outline.slope[side] = if rise == 0.0 { 0.0 } else { slope };
            // Clockwise, with y downwards: what goes down is on the right. A level side is on neither.
            outline.not_left[side] = if rise < 0.0 { 0.0 } else { f64::NEG_INFINITY };
            outline.not_right[side] = if rise > 0.0 { 0.0 } else { f64::INFINITY };
        }
        outline
    }

    #[inline(always)]
    fn at(&self, y: f64) -> (f64, f64) {
        let (mut left, mut right) = ([0.0; MAX_CORNERS], [0.0; MAX_CORNERS]);
        for side in 0..MAX_CORNERS {
            let x = self.x[side] + self.slope[side] * (y - self.y[side]);
            left[side] = x + self.not_left[side];
            right[side] = x + self.not_right[side];
        }
        (highest(&left), lowest(&right))
    }
}
