//! The tops that gain no pixel, as the pixels around step over them: each is asked for its middle by what the pixel over
//! that shows, and by its own ray where that says too little, see [`Painter::pixel_shows`].

use glam::DVec3;

use super::canvas::{NOBODY, Painted};
use super::tile::Piece;
use super::{Painter, Place, Row};
use crate::back_projection::tops::is_turned_away;
use crate::terrain::Plane;

/// Ground no further before a top than this, in voxels, has nothing between it and that.
const NEXT: f64 = 1.5;

/// Steps to the pixels that show what may stand before a top: a wall, the next ones; a slope that rises slowly, the others.
const AROUND: [[isize; 2]; 8] = [[1, 0], [-1, 0], [0, 1], [0, -1], [4, 0], [-4, 0], [0, 4], [0, -4]];
/// Pixels along an axis to the farthest of them.
const FARTHEST: usize = 4;

/// A top that gained no pixel, while the pixel over its middle was still free.
pub(super) struct Early {
    /// Of its sighting.
    row: u32,
    normal: DVec3,
    /// Relative to the camera.
    middle: DVec3,
    /// Column and row.
    pixel: [usize; 2],
}

impl Painter<'_> {
    /// A top that has gained no pixel.
    #[inline(always)]
    pub(super) fn paint_middle(&mut self, piece: &Piece, place: &Place) {
        let middle = place.middle(piece.solid.top() - self.origin.z);
        self.paint_middle_at(piece.id, middle, piece.solid.plane);
    }

    #[inline(always)]
    pub(super) fn paint_middle_at(&mut self, id: u32, middle: DVec3, plane: Plane) {
        if middle.length_squared() > self.range * self.range {
            return;
        }
        if let Some((column, row)) = self.pixel_over(middle) {
            self.paint_top(id, plane.normal(), middle, column, row);
        }
    }

    /// The same by its middle and the pixel over that.
    #[inline(always)]
    pub(super) fn paint_top(&mut self, id: u32, normal: DVec3, middle: DVec3, column: usize, row: usize) {
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
    pub(super) fn hidden_later(&self) -> Vec<u32> {
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
        // On level ground nothing reaches so high, and no pixel need be asked.
        if self.highest <= (middle.z + most).min(0.0) && self.canvas.is_shown_around(pixel, FARTHEST) {
            return false;
        }
        let distance = middle.length();
        AROUND.into_iter().any(|step| {
            let Some((column, row)) = self.canvas.beside(pixel, step) else { return true };
            let owner = self.canvas.owner(column, row);
            if owner == NOBODY {
                return !self.canvas.is_looked_at(column, row) || self.canvas.is_blind(column, row);
            }
            let owner = &self.rows[owner as usize];
            let top = owner.top();
            if top < middle.z + 1e-4 && middle.z < 0.0 {
                return false; // as low, and nearer to a camera above both: level ground is done with
            }
            let nearer = owner.place.as_dvec3().length();
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
