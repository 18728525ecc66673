//! A solid by the outlines of its voxels, one polygon each: of everything away from the camera's own row and column that
//! is no smooth ground.
//!
//! Both sides that are turned to the camera, with the top or the bottom that can be seen, are convex together but for
//! a notch: sides that are seen from above dip in the middle of their upper edge, sides that are seen from below in
//! that of their lower one. Voxels are painted from the camera's height upwards and downwards, so that what belongs in
//! the notch is painted already, and the polygon goes straight across.

use glam::DVec2;

use super::canvas::{MAX_CORNERS, Painted, Polygon};
use super::optics::{Imaged, Optics};
use super::prism::CLEAR;
use super::tile::{Piece, Tile, corner};
use super::{Painter, Place};

/// The vertical edges of a column as the camera sees them.
struct Edges {
    left: Edge,
    near: Edge,
    right: Edge,
    far: Edge,
}

struct Edge {
    /// Number of its corner, see [`corner`].
    corner: usize,
    /// Image of its point at the height of the camera, and of a step upwards.
    level: Imaged,
    up: Imaged,
}

/// The three edges that are seen, at one height.
#[derive(Clone, Copy)]
struct Level {
    left: DVec2,
    near: DVec2,
    right: DVec2,
}

impl Edge {
    #[inline(always)]
    fn of(optics: &Optics, place: &Place, x: usize, y: usize) -> Edge {
        let level = optics.image(place.corner(x, y, 0.0));
        let up = Imaged { u: optics.u.z, v: optics.v.z, depth: optics.depth.z };
        Edge { corner: corner(x, y), level, up }
    }

    #[inline(always)]
    fn at(&self, height: f64) -> DVec2 {
        let Imaged { u, v, depth } = self.level;
        let inverse = 1.0 / (depth + self.up.depth * height);
        DVec2::new((u + self.up.u * height) * inverse, (v + self.up.v * height) * inverse)
    }
}

impl Edges {
    #[inline(always)]
    fn of(optics: &Optics, place: &Place) -> Edges {
        let [side_x, side_y] = place.side;
        let (near_x, near_y) = (usize::from(side_x < 0), usize::from(side_y < 0));
        let (far_x, far_y) = (1 - near_x, 1 - near_y);
        let edge = |x, y| Edge::of(optics, place, x, y);
        let sides = [edge(near_x, far_y), edge(far_x, near_y)];
        let [left, right] = if side_x == side_y {
            sides
        } else {
            let [right, left] = sides;
            [left, right]
        };
        Edges { left, near: edge(near_x, near_y), right, far: edge(far_x, far_y) }
    }

    #[inline(always)]
    fn at(&self, height: f64) -> Level {
        Level { left: self.left.at(height), near: self.near.at(height), right: self.right.at(height) }
    }

    /// Least depth between two heights.
    #[inline(always)]
    fn depth(&self, low: f64, high: f64) -> f64 {
        let least = |a: f64, b: f64| if a < b { a } else { b };
        let level = least(
            least(self.left.level.depth, self.near.level.depth),
            least(self.right.level.depth, self.far.level.depth),
        );
        level + least(self.near.up.depth * low, self.near.up.depth * high)
    }
}

impl Painter<'_> {
    /// What the uppermost voxel has gained; None where it takes the faces one by one: beside, over, under and close to
    /// the camera, and where the range ends.
    #[inline(always)]
    pub(super) fn paint_outlines(&mut self, tile: &Tile, piece: &Piece, place: &Place) -> Option<Painted> {
        if place.side[0] == 0 || place.side[1] == 0 || self.is_cut_by_range(piece, place) {
            return None;
        }
        let edges = Edges::of(&self.optics, place);
        let solid = piece.solid;
        let bottom = solid.bottom - self.origin.z;
        if edges.depth(bottom, piece.highest() - self.origin.z) < CLEAR {
            return None;
        }
        if solid.lowest == solid.uppermost {
            let foot = if bottom > 0.0 { &edges.far } else { &edges.near };
            return Some(self.paint_uppermost(piece, place, &edges, bottom, Some(foot.at(bottom))));
        }
        let shoulder = solid.shoulder() - self.origin.z;
        if shoulder > 0.0 {
            self.paint_wall_outlines(tile, piece, place, &edges, shoulder);
            return Some(self.paint_uppermost(piece, place, &edges, shoulder, None));
        }
        let of_uppermost =
            self.paint_uppermost(piece, place, &edges, shoulder, Some(edges.near.at(shoulder)));
        self.paint_wall_outlines(tile, piece, place, &edges, shoulder);
        Some(of_uppermost)
    }

    /// Top and sides of the uppermost voxel down to a floor, in the middle of which lies a foot.
    #[inline(always)]
    fn paint_uppermost(
        &mut self,
        piece: &Piece,
        place: &Place,
        edges: &Edges,
        floor: f64,
        foot: Option<DVec2>,
    ) -> Painted {
        let top = |edge: &Edge| edge.at(piece.tops[edge.corner] - self.origin.z);
        let middle = place.middle(piece.solid.top() - self.origin.z);
        let is_seen_from_above = piece.solid.plane.normal().dot(middle) < 0.0;
        let crest = top(if is_seen_from_above { &edges.far } else { &edges.near });
        let (left, right) = (edges.left.at(floor), edges.right.at(floor));
        let outline = [top(&edges.left), crest, top(&edges.right), right, foot.unwrap_or(left), left];
        let painted = self.canvas.paint(&polygon(outline), self.rows.len() as u32, None);
        self.add(piece.id, painted, middle);
        painted
    }

    /// The voxels below the uppermost one, up to its shoulder.
    #[inline(always)]
    fn paint_wall_outlines(
        &mut self,
        tile: &Tile,
        piece: &Piece,
        place: &Place,
        edges: &Edges,
        shoulder: f64,
    ) {
        let solid = piece.solid;
        let first = self.first_shown(piece, self.hidden(tile, piece, place));
        let camera = self.origin.z;
        let floor = |z: u32| if z == solid.lowest { solid.bottom - camera } else { f64::from(z) - camera };
        // Begins the voxels that lie above the camera.
        let split = (camera.ceil().max(0.0) as u32).clamp(first, solid.uppermost);
        let mut ceiling = (f64::from(split) - camera).min(shoulder);
        let mut above = edges.at(ceiling);
        let split_level = above;
        for z in (first..split).rev() {
            let floor = floor(z);
            if floor >= ceiling {
                continue;
            }
            let below = edges.at(floor);
            let crest = if ceiling > 0.0 { above.near } else { above.right };
            let outline = [above.left, crest, above.right, below.right, below.near, below.left];
            self.paint_wall_voxel(tile, place, z, outline);
            (above, ceiling) = (below, floor);
        }
        let mut below = split_level;
        for z in split..solid.uppermost {
            let floor = floor(z);
            let ceiling = (f64::from(z + 1) - camera).min(shoulder);
            if floor >= ceiling {
                continue;
            }
            let mut foot = below.left;
            if z == solid.lowest {
                below = edges.at(floor);
                foot = if floor > 0.0 { edges.far.at(floor) } else { below.near };
            }
            let above = edges.at(ceiling);
            let outline = [above.left, above.near, above.right, below.right, foot, below.left];
            self.paint_wall_voxel(tile, place, z, outline);
            below = above;
        }
    }

    #[inline(always)]
    fn paint_wall_voxel(&mut self, tile: &Tile, place: &Place, z: u32, outline: [DVec2; 6]) {
        let painted = self.canvas.paint(&polygon(outline), self.rows.len() as u32, None);
        if painted.count > 0 {
            let middle = place.middle(f64::from(z) + 0.5 - self.origin.z);
            self.add(tile.id(place.at, z), painted, middle);
        }
    }
}

/// Six corners, clockwise as the camera sees them.
#[inline(always)]
fn polygon(corners: [DVec2; 6]) -> Polygon {
    let mut polygon = Polygon { x: [corners[5].x; MAX_CORNERS], y: [corners[5].y; MAX_CORNERS] };
    for (at, corner) in corners.iter().enumerate() {
        polygon.x[at] = corner.x;
        polygon.y[at] = corner.y;
    }
    polygon
}
