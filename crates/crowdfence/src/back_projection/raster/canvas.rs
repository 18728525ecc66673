//! The picture being painted: which pixels something has been painted on, by whom, and what they show.

use std::borrow::Cow;
use std::ops::Range;

use crate::view::View;

const WORD: usize = u64::BITS as usize;
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

pub struct Canvas<'a> {
    width: usize,
    height: usize,
    words_a_row: usize,
    /// A bit a pixel.
    covered: Vec<u64>,
    /// Who painted each pixel, row after row.
    owner: Vec<u32>,
    /// Heatmap value of each pixel, row after row.
    values: Cow<'a, [f32]>,
}

impl<'a> Canvas<'a> {
    pub fn new(view: &'a View) -> Canvas<'a> {
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let words_a_row = width.div_ceil(WORD);
        Canvas {
            width,
            height,
            words_a_row,
            covered: vec![0; words_a_row * height],
            owner: vec![NOBODY; width * height],
            values: view.pixel_values(),
        }
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn height(&self) -> usize {
        self.height
    }

    pub fn value(&self, column: usize, row: usize) -> f32 {
        self.values[row * self.width + column]
    }

    pub fn owner(&self, column: usize, row: usize) -> u32 {
        self.owner[row * self.width + column]
    }

    /// Whether each pixel, row after row, is painted on.
    pub fn painted(&self) -> Vec<bool> {
        self.owner.iter().map(|&owner| owner != NOBODY).collect()
    }

    /// Paints the pixels whose centres lie in a polygon and that are still free. `accepts` has the last word on each.
    #[inline(always)]
    pub fn paint(
        &mut self,
        polygon: &Polygon,
        owner: u32,
        accepts: Option<&dyn Fn(usize, usize) -> bool>,
    ) -> Painted {
        let mut painted = Painted::default();
        let rows = centers_between(lowest(&polygon.y), highest(&polygon.y), self.height);
        let columns = centers_between(lowest(&polygon.x), highest(&polygon.x), self.width);
        if rows.is_empty() || columns.is_empty() || !self.is_free(&rows, &columns) {
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

    /// Whether any pixel of a rectangle is free; true without a look where it is large.
    #[inline(always)]
    fn is_free(&self, rows: &Range<usize>, columns: &Range<usize>) -> bool {
        let word = columns.start / WORD;
        if word != (columns.end - 1) / WORD || rows.len() > 8 {
            return true;
        }
        let span = (u64::MAX >> (WORD - columns.len())) << (columns.start % WORD);
        rows.clone().any(|row| span & !self.covered[row * self.words_a_row + word] != 0)
    }

    #[inline(always)]
    fn paint_span(
        &mut self,
        row: usize,
        columns: Range<usize>,
        owner: u32,
        accepts: Option<&dyn Fn(usize, usize) -> bool>,
    ) -> Painted {
        let mut painted = Painted::default();
        let start = row * self.width;
        for word in columns.start / WORD..=(columns.end - 1) / WORD {
            let first = columns.start.max(word * WORD);
            let end = columns.end.min((word + 1) * WORD);
            let span = (u64::MAX >> (WORD - (end - first))) << (first % WORD);
            let covered = &mut self.covered[row * self.words_a_row + word];
            let mut free = span & !*covered;
            if free == 0 {
                continue;
            }
            if free == span && accepts.is_none() {
                *covered |= span;
                painted.sum += sum(&self.values[start + first..start + end]);
                self.owner[start + first..start + end].fill(owner);
                painted.count += (end - first) as u32;
                continue;
            }
            while free != 0 {
                let bit = free.trailing_zeros() as usize;
                free &= free - 1;
                let column = word * WORD + bit;
                if accepts.is_none_or(|accepts| accepts(column, row)) {
                    *covered |= 1 << bit;
                    painted.sum += f64::from(self.values[start + column]);
                    painted.count += 1;
                    self.owner[start + column] = owner;
                }
            }
        }
        painted
    }
}

/// Pixels along one axis whose centres lie between two coordinates.
#[inline(always)]
fn centers_between(low: f64, high: f64, count: usize) -> Range<usize> {
    let end = count as f64;
    let nearest = |at: f64| (at.clamp(0.0, end) + 0.5) as usize;
    nearest(low)..nearest(high).min(count)
}

/// In eight partial sums, so that it does not depend on the machine how wide its vectors are.
#[inline(always)]
fn sum(values: &[f32]) -> f64 {
    let mut sums = [0.0f64; 8];
    let mut eights = values.chunks_exact(8);
    for eight in &mut eights {
        for (sum, value) in sums.iter_mut().zip(eight) {
            *sum += f64::from(*value);
        }
    }
    for (sum, value) in sums.iter_mut().zip(eights.remainder()) {
        *sum += f64::from(*value);
    }
    (sums[0] + sums[1] + (sums[2] + sums[3])) + (sums[4] + sums[5] + (sums[6] + sums[7]))
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
