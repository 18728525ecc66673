//! A solid by its faces: top, bottom, and the sides that are turned to the camera, voxel by voxel. In any place.

use glam::{DVec2, DVec3};

use super::canvas::Painted;
use super::optics::before_camera;
use super::prism::{OVERLAP, before};
use super::tile::{Piece, Tile, corner};
use super::{Painter, Place};
use crate::back_projection::rim::mean_at_rim;
use crate::terrain::Solid;

/// Four corners, clockwise as the camera sees them, and the plane they lie in.
struct Face {
    corners: [DVec3; 4],
    normal: DVec3,
}

impl Painter<'_> {
    /// What the uppermost voxel has gained.
    #[inline(always)]
    pub(super) fn paint_faces(&mut self, tile: &Tile, piece: &Piece, place: &Place) -> Painted {
        let solid = piece.solid;
        let tops: [f64; 4] = piece.tops.map(|top| top - self.origin.z);
        let cut = self.is_cut_by_range(piece, place);
        let middle = place.middle(solid.top() - self.origin.z);

        let is_single = solid.lowest == solid.uppermost;
        let shoulder = if is_single { solid.bottom } else { solid.shoulder() } - self.origin.z;
        let is_open = tile.open_sides(piece, place);
        let side_if = |axis: usize, open: bool| {
            side(place, axis, [shoulder; 4], tops).filter(|_| is_open[axis] == open)
        };
        let own = [
            top(place, &solid, &tops, middle),
            side_if(0, false),
            side_if(1, false),
            underside(place, solid.bottom - self.origin.z).filter(|_| is_single),
        ];
        let mut of_top = self.paint_all(&own, cut);
        if is_open != [false; 2] {
            let beside = self.paint_all(&[side_if(0, true), side_if(1, true)], cut);
            of_top = self.at_rim(of_top, beside, middle);
        }
        self.add(piece.id, of_top, middle);
        if !is_single {
            self.paint_wall(tile, piece, place, shoulder, cut);
        }
        of_top
    }

    /// What a voxel of the rim has gained, of its own and on its open sides; see [`mean_at_rim`].
    #[inline(always)]
    fn at_rim(&self, own: Painted, beside: Painted, middle: DVec3) -> Painted {
        if beside.count == 0 {
            return own;
        }
        let over_middle = self.pixel_over(middle);
        let at_middle = over_middle.map(|(column, row)| f64::from(self.canvas.value(column, row)));
        let mean = mean_at_rim((own.sum, own.count), (beside.sum, beside.count), at_middle);
        let count = own.count + beside.count;
        Painted { sum: mean * f64::from(count), count }
    }

    /// The voxels below the uppermost one, up to its shoulder.
    #[inline(always)]
    fn paint_wall(&mut self, tile: &Tile, piece: &Piece, place: &Place, shoulder: f64, cut: bool) {
        let solid = piece.solid;
        let bottom = solid.bottom - self.origin.z;
        let hidden = self.hidden(tile, piece, place);
        for z in self.first_shown(piece, hidden)..solid.uppermost {
            let is_lowest = z == solid.lowest;
            let floor = if is_lowest { bottom } else { f64::from(z) - self.origin.z };
            let is_next_to_uppermost = z + 1 == solid.uppermost;
            let ceiling = f64::from(z + 1) - self.origin.z;
            let ceiling = if is_next_to_uppermost { shoulder } else { ceiling.min(shoulder) };
            let shows = |axis: usize| floor < ceiling && ceiling > hidden[axis];
            let face = |axis| side(place, axis, [floor; 4], [ceiling; 4]).filter(|_| shows(axis));
            let below = underside(place, bottom).filter(|_| is_lowest);
            let painted = self.paint_all(&[face(0), face(1), below], cut);
            let height = f64::from(z) + 0.5;
            let middle = place.middle(height - self.origin.z);
            self.add_below_top(tile.id(place.at, z), painted, middle, solid.top() - height);
        }
    }

    /// Heights up to which the columns before a piece, along each axis, hide the side that is turned to the camera.
    #[inline(always)]
    pub(super) fn hidden(&self, tile: &Tile, piece: &Piece, place: &Place) -> [f64; 2] {
        [
            hidden_up_to(tile, piece, place, 0) - self.origin.z,
            hidden_up_to(tile, piece, place, 1) - self.origin.z,
        ]
    }

    /// The lowest voxel of a wall that may be in view: nobody looks at what lies behind other columns, and under the
    /// lowest voxel only from below. `hidden` are heights along both axes, see [`Painter::hidden`].
    #[inline(always)]
    pub(super) fn first_shown(&self, piece: &Piece, hidden: [f64; 2]) -> u32 {
        let Solid { lowest, uppermost, bottom, .. } = piece.solid;
        let is_seen_from_below = bottom > self.origin.z;
        let first =
            if is_seen_from_below { f64::NEG_INFINITY } else { hidden[0].min(hidden[1]) + self.origin.z };
        first.clamp(f64::from(lowest), f64::from(uppermost)) as u32
    }

    /// Whether a part of a piece is out of range.
    #[inline(always)]
    pub(super) fn is_cut_by_range(&self, piece: &Piece, place: &Place) -> bool {
        let highest = piece.highest() - self.origin.z;
        let bottom = piece.solid.bottom - self.origin.z;
        let farthest = |axis: usize| place.low[axis].abs().max((place.low[axis] + 1.0).abs());
        let corner = DVec3::new(farthest(0), farthest(1), highest.abs().max(bottom.abs()));
        corner.length_squared() > self.range * self.range
    }

    /// The faces of one voxel.
    #[inline(always)]
    fn paint_all(&mut self, faces: &[Option<Face>], cut: bool) -> Painted {
        let owner = self.rows.len() as u32;
        let mut painted = Painted::default();
        for face in faces.iter().flatten() {
            painted += self.paint_face(face, owner, cut);
        }
        painted
    }

    #[inline(always)]
    fn paint_face(&mut self, face: &Face, owner: u32, cut: bool) -> Painted {
        let image = face.corners.map(|point| self.optics.image(point));
        let Some(polygon) = before_camera(&image) else {
            return Painted::default();
        };
        if !cut {
            return self.canvas.paint(&polygon, owner, None);
        }
        let (optics, range) = (&self.optics, self.range);
        let in_range = |place: DVec2| {
            let ray = optics.ray(place);
            let distance = face.normal.dot(face.corners[0]) / face.normal.dot(ray) * ray.length();
            distance <= range
        };
        self.canvas.paint(&polygon, owner, Some(&in_range))
    }
}

/// Height up to which the column before a piece, along an axis, hides the side that is turned to the camera; or all of
/// it where no side is.
#[inline(always)]
fn hidden_up_to(tile: &Tile, piece: &Piece, place: &Place, axis: usize) -> f64 {
    let side = place.side[axis];
    if side == 0 {
        return f64::INFINITY;
    }
    let mut at = place.at;
    at[axis] -= side;
    let Some(before) = before(tile, at, piece).filter(|before| before.solid.bottom <= piece.solid.bottom)
    else {
        return f64::NEG_INFINITY;
    };
    // Its edge towards the piece.
    let edge = usize::from(side > 0);
    let top = |other: usize| before.tops[if axis == 0 { corner(edge, other) } else { corner(other, edge) }];
    top(0).min(top(1)) - OVERLAP
}

/// The top, when the camera is above its plane.
#[inline(always)]
fn top(place: &Place, solid: &Solid, tops: &[f64; 4], middle: DVec3) -> Option<Face> {
    let normal = solid.plane.normal();
    let at = |x, y| place.corner(x, y, tops[corner(x, y)]);
    let corners = [at(0, 0), at(0, 1), at(1, 1), at(1, 0)];
    (normal.dot(middle) < 0.0).then_some(Face { corners, normal })
}

/// The bottom, when the camera is below it.
#[inline(always)]
fn underside(place: &Place, height: f64) -> Option<Face> {
    let at = |x, y| place.corner(x, y, height);
    let corners = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
    (height > 0.0).then_some(Face { corners, normal: DVec3::Z })
}

/// The side along an axis that is turned to the camera, between heights at the four corners of the column.
#[inline(always)]
fn side(place: &Place, axis: usize, from: [f64; 4], to: [f64; 4]) -> Option<Face> {
    let near = match place.side[axis] {
        0 => return None,
        1 => 0,
        _ => 1,
    };
    // Looking along x, y grows to the left, looking along y, x grows to the right; the other way round from beyond.
    let left = if axis == 0 { 1 - near } else { near };
    let at = |other: usize, heights: &[f64; 4]| {
        let (x, y) = if axis == 0 { (near, other) } else { (other, near) };
        place.corner(x, y, heights[corner(x, y)])
    };
    let right = 1 - left;
    let corners = [at(left, &to), at(right, &to), at(right, &from), at(left, &from)];
    Some(Face { corners, normal: DVec3::AXES[axis] })
}
