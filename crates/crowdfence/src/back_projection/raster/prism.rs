//! A column of smooth ground in one hull: its top, and the two sides that are turned to the camera down to what the
//! columns before it hide.

use super::hull::{Hull, Tip};
use super::tile::{Piece, Tile, corner};
use super::{Painter, Place};

/// How much deeper than the edge of the column before it a side is painted, in voxels: more than any rounding, so
/// that no pixel falls between the two. What is too much is hidden.
pub const OVERLAP: f64 = 1e-3;

impl Painter<'_> {
    /// None at steps, walls and edges.
    #[inline(always)]
    pub(super) fn prism(&self, tile: &Tile, piece: &Piece, place: &Place) -> Option<Hull> {
        let [side_x, side_y] = place.side;
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
        let most = |a: f64, b: f64| if b > a { b } else { a };
        let drop = most(most(most(0.0, drop[0]), drop[1]), most(drop[2], drop[3])) + OVERLAP;

        let solid = &piece.solid;
        let floor = if solid.lowest == solid.uppermost { solid.bottom } else { solid.shoulder() };
        // What reaches deeper than the columns before it shows a part of its side under them. Under ground nobody looks,
        // unless through a hole or from beside the map.
        let are_ground = piece.is_lowest && before_x.is_lowest && before_y.is_lowest;
        let is_deeper = most(before_x.solid.bottom, before_y.solid.bottom) > solid.bottom;
        let shows_underside = solid.bottom > self.origin.z && !are_ground;
        if is_deeper && (self.is_open || !are_ground) || shows_underside {
            return None;
        }
        let edges = place.edges();
        let top = |edge: usize| tops[edge];
        let lowest = top(edges.near).min(top(edges.left)).min(top(edges.right));
        if lowest - drop < floor {
            return None;
        }
        // Height of the camera over the plane of the top.
        let above = -solid.plane.normal().dot(place.middle(solid.top() - self.origin.z));
        if above + drop <= 0.0 {
            return None;
        }
        let ends = |edge: usize| [top(edge), top(edge) - drop];
        let crest = if above > 0.0 { Tip::Far(top(edges.far)) } else { Tip::Near(top(edges.near)) };
        let foot = Tip::Near(top(edges.near) - drop);
        Some(Hull { left: ends(edges.left), right: ends(edges.right), crest: Some(crest), foot: Some(foot) })
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
