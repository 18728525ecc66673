//! The solids over a square of columns, with those just outside on the sides that are turned to the camera.

use crate::terrain::tree::Layer;
use crate::terrain::{Plane, Solid, Surface};

/// Columns along one side of a tile.
pub const SIDE: usize = 16;
/// With a column outside on either side.
const RIM: usize = SIDE + 2;

/// A solid as it is painted.
#[derive(Debug, Clone, Copy)]
pub struct Piece {
    pub solid: Solid,
    /// Heights of its top over the four corners of the column, see [`corner`].
    pub tops: [f64; 4],
    /// Whether nothing lies below it in its column.
    pub is_lowest: bool,
    /// Of the uppermost voxel.
    pub id: u32,
    /// Place of the ids of all its voxels among those of the tile.
    run: u32,
}

/// Number of a corner of a column: 0 and 1 along x, 0 and 2 along y.
pub fn corner(x: usize, y: usize) -> usize {
    x + 2 * y
}

#[derive(Default)]
pub struct Tile {
    /// Per column, row after row along x, where its solids begin and end.
    columns: Vec<(u32, u32)>,
    pieces: Vec<Piece>,
    ids: Vec<u32>,
    /// Columns with something in them, without the rim.
    occupied: usize,
}

impl Tile {
    /// Empties the tile.
    pub fn clear(&mut self) {
        self.columns.clear();
        self.columns.resize(RIM * RIM, (0, 0));
        self.pieces.clear();
        self.ids.clear();
        self.occupied = 0;
    }

    /// Takes the solids of a column at (i, j) from the tile's corner; one that is neither in the tile nor next to it is
    /// let go.
    #[inline]
    pub fn take(&mut self, at: [i32; 2], column: &[Layer], planes: &[Plane], surface: Surface) {
        if at.iter().any(|place| !(-1..=SIDE as i32).contains(place)) {
            return;
        }
        let first = self.pieces.len() as u32;
        for (solid, run) in Solid::of_column(column, planes, surface) {
            let [x, y] = solid.plane.slope().map(|slope| 0.5 * slope);
            let top = solid.top();
            let tops = [top - x - y, top + x - y, top - x + y, top + x + y];
            let uppermost = run[run.len() - 1].voxel_id();
            let start = self.ids.len() as u32;
            self.ids.extend(run.iter().map(|layer| layer.voxel_id()));
            let is_lowest = self.pieces.len() as u32 == first;
            self.pieces.push(Piece { solid, tops, is_lowest, id: uppermost, run: start });
        }
        let is_inside = at.iter().all(|place| (0..SIDE as i32).contains(place));
        self.occupied += usize::from(is_inside);
        self.columns[index(at)] = (first, self.pieces.len() as u32);
    }

    /// From the lowest upwards.
    #[inline(always)]
    pub fn column(&self, at: [i32; 2]) -> &[Piece] {
        let (first, end) = self.columns[index(at)];
        &self.pieces[first as usize..end as usize]
    }

    /// Whether there is something in every column.
    #[inline(always)]
    pub fn is_full(&self) -> bool {
        self.occupied == SIDE * SIDE
    }

    /// Id of a voxel of a solid by its z.
    pub fn id(&self, piece: &Piece, z: u32) -> u32 {
        self.ids[(piece.run + z - piece.solid.lowest) as usize]
    }
}

#[inline(always)]
fn index(at: [i32; 2]) -> usize {
    (at[0] + 1) as usize * RIM + (at[1] + 1) as usize
}
