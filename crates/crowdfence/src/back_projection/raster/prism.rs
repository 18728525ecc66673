//! A column of smooth ground in one polygon: its top, and the two sides that are turned to the camera down to what
//! the columns before it hide.

use glam::DVec3;

use super::canvas::{Painted, highest};
use super::tile::{Piece, Tile, corner};
use super::{Painter, Place};

/// How much deeper than the edge of the column before it a side is painted, in voxels: more than any rounding, so
/// that no pixel falls between the two. What is too much is hidden.
pub const OVERLAP: f64 = 1e-3;
/// Nearest depth at which nothing has to be cut off, in voxels.
pub const CLEAR: f64 = 0.05;

impl Painter<'_> {
    /// None where it takes the faces one by one: beside and under the camera, at steps, walls and edges, and where
    /// the range ends.
    #[inline(always)]
    pub(super) fn paint_prism(&mut self, tile: &Tile, piece: &Piece, place: &Place) -> Option<Painted> {
        let [side_x, side_y] = place.side;
        if side_x == 0 || side_y == 0 {
            return None;
        }
        // Corners of a column, along each axis: the one turned to the camera and the other.
        let (near_x, near_y) = (usize::from(side_x < 0), usize::from(side_y < 0));
        let (far_x, far_y) = (1 - near_x, 1 - near_y);
        let [i, j] = place.at;
        let before_x = before(tile, [i - side_x, j], piece)?;
        let before_y = before(tile, [i, j - side_y], piece)?;
        let tops = &piece.tops;
        let step = |own: (usize, usize), before: &Piece, same: (usize, usize)| {
            tops[corner(own.0, own.1)] - before.tops[corner(same.0, same.1)]
        };
        let drop = [
            step((near_x, near_y), &before_x, (far_x, near_y)),
            step((near_x, far_y), &before_x, (far_x, far_y)),
            step((near_x, near_y), &before_y, (near_x, far_y)),
            step((far_x, near_y), &before_y, (far_x, far_y)),
        ];
        let drop = drop.into_iter().fold(0.0, |most, step| if step > most { step } else { most }) + OVERLAP;

        let solid = &piece.solid;
        let floor = if solid.lowest == solid.uppermost { solid.bottom } else { solid.shoulder() };
        // What reaches deeper than the columns before it shows a part of its side under them. Under ground nobody looks,
        // unless through a hole.
        let before = [before_x, before_y];
        let are_ground = piece.is_lowest && before.iter().all(|before| before.is_lowest);
        let is_deeper = before.iter().any(|before| before.solid.bottom > solid.bottom);
        let shows_underside = solid.bottom > self.origin.z && !are_ground;
        if is_deeper && !(are_ground && tile.is_full()) || shows_underside {
            return None;
        }
        let [left, right] = if side_x == side_y {
            [(near_x, far_y), (far_x, near_y)]
        } else {
            [(far_x, near_y), (near_x, far_y)]
        };
        let (front, back) = ((near_x, near_y), (far_x, far_y));
        let lowest = [front, left, right].map(|(x, y)| tops[corner(x, y)]);
        if lowest[0].min(lowest[1]).min(lowest[2]) - drop < floor {
            return None;
        }
        // Height of the camera over the plane of the top.
        let middle = place.middle(solid.top() - self.origin.z);
        let above = -solid.plane.normal().dot(middle);
        if above + drop <= 0.0 {
            return None;
        }
        let top = |(x, y): (usize, usize)| place.corner(x, y, tops[corner(x, y)] - self.origin.z);
        let low = |at| top(at) - DVec3::Z * drop;
        let ridge = if above > 0.0 { top(back) } else { top(front) };
        let corners = [top(left), ridge, top(right), low(right), low(front), low(left), low(left), low(left)];
        let (polygon, depth) = self.optics.polygon(&corners);
        let farthest = highest(&corners.map(DVec3::length_squared)).max(top(back).length_squared());
        if depth < CLEAR || farthest > self.range * self.range {
            return None;
        }
        let painted = self.canvas.paint(&polygon, self.rows.len() as u32, None);
        self.add(piece.id, painted, middle);
        Some(painted)
    }
}

/// The solid in the column before a piece that hides its side: the one that reaches below its top.
#[inline(always)]
pub fn before(tile: &Tile, at: [i32; 2], piece: &Piece) -> Option<Piece> {
    let reached = piece.solid.top();
    for upper in tile.upper(at).iter().rev() {
        if upper.solid.bottom <= reached {
            return Some(*upper);
        }
    }
    match tile.lowest(at) {
        Some(lowest) if lowest.solid.bottom <= reached => Some(lowest),
        _ => None,
    }
}
