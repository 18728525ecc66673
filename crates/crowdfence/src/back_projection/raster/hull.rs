//! Hull: what the camera sees of a part of a column, one polygon between heights over the column's vertical edges. Of
//! everything away from the camera's own row and column.
//!
//! Both sides that are turned to the camera, with the top or the bottom that can be seen, are convex together but for
//! a notch: sides that are seen from above dip in the middle of their upper edge, sides that are seen from below in
//! that of their lower one. Voxels are painted from the camera's height upwards and downwards, so that what belongs in
//! the notch is painted already, and the hull goes straight across.

use glam::DVec3;

use super::canvas::Painted;
use super::frame::Row;
use super::tile::SIDE;
use super::{Painter, Place};

/// Heights are tree coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Hull {
    /// Over the edges that the camera sees on the left and on the right: of the upper corner and of the lower one.
    pub left: [f64; 2],
    pub right: [f64; 2],
    /// What stands out between the upper corners, and between the lower ones.
    pub crest: Option<Tip>,
    pub foot: Option<Tip>,
}

/// A corner over the edge that is turned to the camera, or over the one behind it.
#[derive(Debug, Clone, Copy)]
pub enum Tip {
    Near(f64),
    Far(f64),
}

impl Tip {
    /// On which side of the column's middle it stands, seen from the camera, and its height.
    #[inline(always)]
    fn parts(tip: Option<Tip>) -> (f64, f64) {
        match tip {
            Some(Tip::Near(height)) => (-1.0, height),
            Some(Tip::Far(height)) => (1.0, height),
            None => (0.0, 0.0),
        }
    }
}

/// Sixteen hulls as numbers side by side, in the coordinates of a tile from its middle.
pub struct Sixteen {
    /// Of the middle of the column.
    pub place: [Row; 2],
    /// Side of the camera.
    pub side: [Row; 2],
    pub left: [Row; 2],
    pub right: [Row; 2],
    /// Its side, 0 where there is none, and height.
    pub crest: [Row; 2],
    pub foot: [Row; 2],
}

impl Sixteen {
    pub const NONE: Sixteen = Sixteen {
        place: [[0.0; SIDE]; 2],
        side: [[0.0; SIDE]; 2],
        left: [[0.0; SIDE]; 2],
        right: [[0.0; SIDE]; 2],
        crest: [[0.0; SIDE]; 2],
        foot: [[0.0; SIDE]; 2],
    };

    /// Heights from a level on; they are exact, see [`super::frame`].
    #[inline(always)]
    pub fn put(&mut self, number: usize, place: &Place, hull: &Hull, level: f64) {
        let above = |height: f64| (height - level) as f32;
        for axis in 0..2 {
            self.place[axis][number] = place.at[axis] as f32 + 0.5 - 0.5 * SIDE as f32;
            self.side[axis][number] = place.side[axis] as f32;
            self.left[axis][number] = above(hull.left[axis]);
            self.right[axis][number] = above(hull.right[axis]);
        }
        let (crest, foot) = (Tip::parts(hull.crest), Tip::parts(hull.foot));
        self.crest[0][number] = crest.0 as f32;
        self.crest[1][number] = above(crest.1);
        self.foot[0][number] = foot.0 as f32;
        self.foot[1][number] = above(foot.1);
    }
}

impl Painter<'_> {
    /// In f64.
    #[inline(always)]
    pub(super) fn paint_hull(&mut self, place: &Place, hull: &Hull) -> Painted {
        let camera = self.origin.z;
        let [half_x, half_y] = place.side.map(|side| 0.5 * f64::from(side));
        let middle = place.middle(-camera);
        let corner = |x: f64, y: f64, height: f64| middle + DVec3::new(x, y, height);
        let left = |end: usize| corner(-half_y, half_x, hull.left[end]);
        let right = |end: usize| corner(half_y, -half_x, hull.right[end]);
        let tip = |tip: Option<Tip>, else_at: DVec3| match Tip::parts(tip) {
            (0.0, _) => else_at,
            (side, height) => corner(side * half_x, side * half_y, height),
        };
        let (right_top, left_low) = (right(0), left(1));
        let crest = tip(hull.crest, right_top);
        let foot = tip(hull.foot, left_low);
        let corners = [left(0), crest, right_top, right(1), foot, left_low, left_low, left_low];
        let (polygon, _) = self.optics.polygon(&corners);
        self.canvas.paint(&polygon, self.rows.len() as u32, None)
    }
}
