//! A column of smooth ground in one polygon: its top, and the two sides that are turned to the camera down to what
//! the columns before it hide.

use glam::{DVec2, DVec3};

use super::canvas::Painted;
use super::tile::{Piece, Tile, corner};
use super::{Painter, Place};

/// How much deeper than the edge of the column before it a side is painted, in voxels: more than any rounding, so
/// that no pixel falls between the two. What is too much is hidden.
const OVERLAP: f64 = 1e-3;
/// Nearest depth at which nothing has to be cut off, in voxels.
const CLEAR: f64 = 0.05;

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
        let before_x = before(tile.column([i - side_x, j]), piece)?;
        let before_y = before(tile.column([i, j - side_y]), piece)?;
        let tops = &piece.tops;
        let step = |own: (usize, usize), before: &Piece, same: (usize, usize)| {
            tops[corner(own.0, own.1)] - before.tops[corner(same.0, same.1)]
        };
        let drop = [
            step((near_x, near_y), before_x, (far_x, near_y)),
            step((near_x, far_y), before_x, (far_x, far_y)),
            step((near_x, near_y), before_y, (near_x, far_y)),
            step((far_x, near_y), before_y, (far_x, far_y)),
        ];
        let drop = drop.into_iter().fold(0.0, |most, step| if step > most { step } else { most }) + OVERLAP;

        let solid = &piece.solid;
        let floor = if solid.lowest == solid.uppermost { solid.bottom } else { solid.shoulder() };
        let reach_down = [before_x, before_y].iter().all(|before| before.solid.bottom <= solid.bottom);
        let shows_underside =
            solid.bottom > self.origin.z && !(piece.is_lowest && before_x.is_lowest && before_y.is_lowest);
        if !reach_down || shows_underside {
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
        let [slope_x, slope_y] = solid.plane.slope();
        let middle = place.middle(solid.top() - self.origin.z);
        let above = slope_x * middle.x + slope_y * middle.y - middle.z;
        if above + drop <= 0.0 {
            return None;
        }
        let top = |(x, y): (usize, usize)| place.corner(x, y, tops[corner(x, y)] - self.origin.z);
        let low = |at| top(at) - DVec3::Z * drop;
        let ridge = if above > 0.0 { top(back) } else { top(front) };
        let outline = [top(left), ridge, top(right), low(right), low(front), low(left)];
        let mut corners = [DVec2::ZERO; 6];
        let range = self.range * self.range;
        for (corner, point) in corners.iter_mut().zip(outline) {
            let image = self.optics.image(point);
            if image.depth < CLEAR || point.length_squared() > range {
                return None;
            }
            *corner = image.pixel();
        }
        if top(back).length_squared() > range {
            return None;
        }
        let painted = self.canvas.paint(&corners, self.rows.len() as u32, None);
        self.add(piece.id, painted, middle);
        Some(painted)
    }
}

/// The solid in the column before a piece that hides its side: the one that reaches below its top.
fn before<'t>(column: &'t [Piece], piece: &Piece) -> Option<&'t Piece> {
    let reached = piece.solid.top();
    column.iter().rev().find(|other| other.solid.bottom <= reached)
}
