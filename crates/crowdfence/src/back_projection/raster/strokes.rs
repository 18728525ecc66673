//! What is painted of some columns, in the order in which it is painted: first all of it is planned, then the pixels of
//! all hulls are found at once, then they are painted one by one.

use super::canvas::Painted;
use super::frame::Frame;
use super::ground::{Shapes, Shown};
use super::hull::{Hull, Sixteen, Tip};
use super::tile::{Piece, SIDE, Tile};
use super::{Painter, Place};
use crate::terrain::{Plane, Solid};

/// Nearest depth at which nothing has to be cut off, in voxels.
const CLEAR: f64 = 0.05;
/// Voxels of a wall from which on it pays to look whether they are hidden before they are planned.
const TALL: u32 = 4;

#[derive(Debug, Clone, Copy)]
struct Stroke {
    place: Place,
    what: What,
}

#[derive(Debug, Clone, Copy)]
enum What {
    /// The lowest solid of a column, whose pixels are known with those of its row.
    Ground,
    /// The next hull: the uppermost voxel of a solid, with the height of its middle.
    Top { id: u32, height: f64, plane: Plane },
    /// The next hull: the voxel of a wall, with the height of the top of its solid.
    Wall { z: u32, top: f64 },
    /// The top of a solid that is hidden, which may be seen between the pixels.
    Middle { id: u32, height: f64, plane: Plane },
    /// The lowest solid of a column or one of the others, by its faces.
    Faces { upper: Option<usize> },
}

#[derive(Default)]
pub struct Strokes {
    strokes: Vec<Stroke>,
    hulls: Vec<(Place, Hull)>,
    /// The pixels of each hull.
    shown: Vec<Shown>,
}

impl Strokes {
    pub fn is_empty(&self) -> bool {
        self.strokes.is_empty()
    }

    pub fn clear(&mut self) {
        self.strokes.clear();
        self.hulls.clear();
        self.shown.clear();
    }

    #[inline(always)]
    fn push(&mut self, place: &Place, what: What) {
        self.strokes.push(Stroke { place: *place, what });
    }

    #[inline(always)]
    fn push_hull(&mut self, place: &Place, what: What, hull: Hull) {
        self.push(place, what);
        self.hulls.push((*place, hull));
    }

    /// Sixteen at a time, in f32.
    #[inline(always)]
    pub fn find_pixels(&mut self, frame: &Frame, tile: &Tile, shapes: &mut Shapes) {
        let mut sixteen = Sixteen::NONE;
        let level = f64::from(tile.level);
        for hulls in self.hulls.chunks(SIDE) {
            for (number, (place, hull)) in hulls.iter().enumerate() {
                sixteen.put(number, place, hull, level);
            }
            shapes.find_hulls(frame, &sixteen);
            for number in 0..hulls.len() {
                self.shown.push(shapes.shown(number));
            }
        }
    }

    /// To be painted with care, all of them.
    pub fn find_none(&mut self) {
        self.shown.resize(self.hulls.len(), Shown::Unsure);
    }
}

impl Painter<'_> {
    /// What stands on one column: what is at the camera's height, then downwards and upwards. The ground's pixels are
    /// known unless they are unsure.
    #[inline(always)]
    pub(super) fn plan_column(&self, tile: &Tile, place: &Place, ground: &Shown, strokes: &mut Strokes) {
        let upper = tile.upper(place.at);
        let below = upper.partition_point(|piece| piece.solid.bottom <= self.origin.z);
        for (number, piece) in upper.iter().enumerate().take(below).rev() {
            self.plan_piece(tile, piece, Some(number), place, strokes);
        }
        match ground {
            Shown::OutOfRange => (),
            Shown::Pixels(_) => strokes.push(place, What::Ground),
            Shown::Unsure => {
                if let Some(piece) = tile.lowest(place.at) {
                    self.plan_piece(tile, &piece, None, place, strokes);
                }
            }
        }
        for (number, piece) in upper.iter().enumerate().skip(below) {
            self.plan_piece(tile, piece, Some(number), place, strokes);
        }
    }

    /// By its faces beside, over, under and close to the camera, and where the range ends.
    #[inline(always)]
    pub(super) fn plan_piece(
        &self,
        tile: &Tile,
        piece: &Piece,
        upper: Option<usize>,
        place: &Place,
        strokes: &mut Strokes,
    ) {
        let is_beside = place.side[0] == 0 || place.side[1] == 0;
        if is_beside || self.is_cut_by_range(piece, place) || self.nearest_depth(piece, place) < CLEAR {
            return strokes.push(place, What::Faces { upper });
        }
        let solid = &piece.solid;
        let top = What::Top { id: piece.id, height: solid.top(), plane: solid.plane };
        let middle = What::Middle { id: piece.id, height: solid.top(), plane: solid.plane };
        if let Some(hull) = self.prism(tile, piece, place) {
            return strokes.push_hull(place, top, hull);
        }
        // On an OctoMap four in five of what stands out of smooth ground gain no pixel.
        if self.is_covered(place, solid.bottom, piece.highest()) {
            return strokes.push(place, middle);
        }
        if tile.open_sides(piece, place) != [false; 2] {
            return strokes.push(place, What::Faces { upper });
        }
        if solid.lowest == solid.uppermost {
            let is_seen_from_below = solid.bottom > self.origin.z;
            let foot = if is_seen_from_below { Tip::Far } else { Tip::Near }(solid.bottom);
            return strokes.push_hull(place, top, self.uppermost(piece, place, solid.bottom, Some(foot)));
        }
        let shoulder = solid.shoulder();
        let first = self.first_shown(piece, self.hidden(tile, piece, place));
        let first = self.first_uncovered(piece, place, first, shoulder);
        if first > solid.uppermost {
            return strokes.push(place, middle);
        }
        if shoulder > self.origin.z {
            self.plan_wall(piece, place, first, shoulder, strokes);
            strokes.push_hull(place, top, self.uppermost(piece, place, shoulder, None));
        } else {
            let foot = Some(Tip::Near(shoulder));
            strokes.push_hull(place, top, self.uppermost(piece, place, shoulder, foot));
            self.plan_wall(piece, place, first, shoulder, strokes);
        }
    }

    /// The lowest voxel of a wall, from one on, that may gain a pixel, roughly; one above the uppermost if none does.
    #[inline(always)]
    fn first_uncovered(&self, piece: &Piece, place: &Place, first: u32, shoulder: f64) -> u32 {
        let Solid { lowest, uppermost, bottom, .. } = piece.solid;
        if uppermost - first < TALL {
            return first;
        }
        let floor_of = |z: u32| if z == lowest { bottom } else { f64::from(z).min(shoulder) };
        if self.is_covered(place, floor_of(first), piece.highest()) {
            return uppermost + 1;
        }
        let mut first = first;
        while uppermost - first >= TALL {
            let half = first.midpoint(uppermost);
            if !self.is_covered(place, floor_of(first), floor_of(half)) {
                break;
            }
            first = half;
        }
        first
    }

    /// Whether nothing of a column between two heights can gain a pixel.
    #[inline(always)]
    fn is_covered(&self, place: &Place, floor: f64, ceiling: f64) -> bool {
        let low = place.corner(0, 0, floor - self.origin.z);
        let high = place.corner(1, 1, ceiling - self.origin.z);
        self.optics.around(low, high).is_some_and(|(low, high)| self.canvas.is_covered(low, high))
    }

    /// Top and sides of the uppermost voxel down to a floor, in the middle of which lies a foot.
    #[inline(always)]
    fn uppermost(&self, piece: &Piece, place: &Place, floor: f64, foot: Option<Tip>) -> Hull {
        let middle = place.middle(piece.solid.top() - self.origin.z);
        let is_seen_from_above = piece.solid.plane.normal().dot(middle) < 0.0;
        let edges = place.edges();
        let crest = if is_seen_from_above {
            Tip::Far(piece.tops[edges.far])
        } else {
            Tip::Near(piece.tops[edges.near])
        };
        Hull {
            left: [piece.tops[edges.left], floor],
            right: [piece.tops[edges.right], floor],
            crest: Some(crest),
            foot,
        }
    }

    /// The voxels below the uppermost one, from one on up to its shoulder.
    #[inline(always)]
    fn plan_wall(&self, piece: &Piece, place: &Place, first: u32, shoulder: f64, strokes: &mut Strokes) {
        let solid = piece.solid;
        let camera = self.origin.z;
        let floor_of = |z: u32| if z == solid.lowest { solid.bottom } else { f64::from(z) };
        // Begins the voxels that lie above the camera.
        let split = (camera.ceil().max(0.0) as u32).clamp(first, solid.uppermost);
        let mut ceiling = f64::from(split).min(shoulder);
        for z in (first..split).rev() {
            let floor = floor_of(z);
            if floor >= ceiling {
                continue;
            }
            let crest = (ceiling > camera).then_some(Tip::Near(ceiling));
            let ends = [ceiling, floor];
            let hull = Hull { left: ends, right: ends, crest, foot: Some(Tip::Near(floor)) };
            strokes.push_hull(place, What::Wall { z, top: solid.top() }, hull);
            ceiling = floor;
        }
        for z in split..solid.uppermost {
            let floor = floor_of(z);
            let ceiling = f64::from(z + 1).min(shoulder);
            if floor >= ceiling {
                continue;
            }
            let is_over_air = z == solid.lowest;
            let foot = if floor > camera { Tip::Far } else { Tip::Near }(floor);
            let ends = [ceiling, floor];
            let crest = Some(Tip::Near(ceiling));
            let hull = Hull { left: ends, right: ends, crest, foot: is_over_air.then_some(foot) };
            strokes.push_hull(place, What::Wall { z, top: solid.top() }, hull);
        }
    }

    /// Of any point of a piece.
    #[inline(always)]
    fn nearest_depth(&self, piece: &Piece, place: &Place) -> f64 {
        let axis = self.optics.depth;
        let height = if axis.z > 0.0 { piece.solid.bottom } else { piece.highest() };
        let middle = place.middle(height - self.origin.z);
        axis.dot(middle) - 0.5 * (axis.x.abs() + axis.y.abs())
    }

    /// Paints all strokes; `row` are the shapes of the ground of a row of columns, and a bit for each that may be asked
    /// for its middle.
    #[inline(always)]
    pub(super) fn paint_strokes(&mut self, tile: &Tile, strokes: &Strokes, row: Option<(&Shapes, u32)>) {
        let mut hulls = strokes.hulls.iter().zip(&strokes.shown);
        for Stroke { place, what } in &strokes.strokes {
            match *what {
                What::Ground => {
                    let (shapes, middles) = row.expect("no ground is known without its row");
                    self.paint_ground(tile, place, shapes, middles);
                }
                What::Faces { upper } => {
                    let piece =
                        upper.map_or_else(|| tile.lowest(place.at), |at| Some(tile.upper(place.at)[at]));
                    let piece = piece.expect("a piece of the tile");
                    let painted = self.paint_faces(tile, &piece, place);
                    if painted.count == 0 && self.between_pixels {
                        self.paint_middle(&piece, place);
                    }
                }
                What::Middle { id, height, plane } => {
                    if self.between_pixels {
                        self.paint_middle_at(id, place.middle(height - self.origin.z), plane);
                    }
                }
                What::Wall { z, top } => {
                    let painted = self.paint_shown(&mut hulls);
                    if painted.count > 0 {
                        let height = f64::from(z) + 0.5;
                        let middle = place.middle(height - self.origin.z);
                        self.add_below_top(tile.id(place.at, z), painted, middle, top - height);
                    }
                }
                What::Top { id, height, plane } => {
                    let painted = self.paint_shown(&mut hulls);
                    let middle = place.middle(height - self.origin.z);
                    if painted.count > 0 {
                        self.add(id, painted, middle);
                    } else if self.between_pixels {
                        self.paint_middle_at(id, middle, plane);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn paint_shown<'s>(
        &mut self,
        hulls: &mut impl Iterator<Item = (&'s (Place, Hull), &'s Shown)>,
    ) -> Painted {
        let ((place, hull), shown) = hulls.next().expect("a hull a stroke");
        match shown {
            Shown::OutOfRange | Shown::Pixels(None) => Painted::default(),
            Shown::Pixels(Some(block)) => self.canvas.paint_block(block, self.rows.len() as u32),
            Shown::Unsure => self.paint_hull(place, hull),
        }
    }
}
