//! The solids over a square of columns, with those just outside on the sides that are turned to the camera. The lowest
//! solid of every column, its ground, is kept as numbers side by side.

use super::Place;
use crate::terrain::tree::{Brick, Square, Stacks};
use crate::terrain::{Plane, Solid, Surface};

/// Columns along one side of a tile.
pub const SIDE: usize = 16;
/// Columns of a brick along one side: so wide is the rim, of which the columns next to the tile are filled.
const RIM: usize = Brick::SIDE as usize;
/// From a row of columns to the next.
pub const STRIDE: usize = SIDE + 2 * RIM;
pub const COLUMNS: usize = STRIDE * STRIDE;
/// Bricks along one side, with the rim.
const BRICKS: usize = STRIDE / RIM;
/// Id of the ground where there is none.
const NOTHING: u32 = u32::MAX;

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
}

/// Number of a corner of a column: 0 and 1 along x, 0 and 2 along y.
pub fn corner(x: usize, y: usize) -> usize {
    x + 2 * y
}

impl Piece {
    #[inline(always)]
    fn new(solid: Solid, id: u32, is_lowest: bool) -> Piece {
        let [x, y] = solid.plane.slope().map(|slope| 0.5 * slope);
        let top = solid.top();
        Piece { solid, tops: [top - x - y, top + x - y, top - x + y, top + x + y], is_lowest, id }
    }

    /// Height of the highest corner of its top.
    #[inline(always)]
    pub fn highest(&self) -> f64 {
        let [a, b, c, d] = self.tops;
        let most = |a: f64, b: f64| if b > a { b } else { a };
        most(most(a, b), most(c, d))
    }
}

/// The lowest solids of all columns, by [`index`]. Heights are above [`Tile::level`] and exact.
pub struct Ground {
    /// Of the top over the centre of the column.
    pub top: [f32; COLUMNS],
    /// Rise of the top over half a column.
    pub rise: [[f32; COLUMNS]; 2],
    /// Infinite where there is no ground.
    pub bottom: [f32; COLUMNS],
    /// Down to where the side of a column is its uppermost voxel.
    pub shoulder: [f32; COLUMNS],
    /// Bottom of the next solid of the column, infinite when there is none.
    pub next_bottom: [f32; COLUMNS],
    solids: Lowest<COLUMNS>,
}

/// The lowest solids of columns as the tree tells them.
struct Lowest<const N: usize> {
    lowest: [u32; N],
    uppermost: [u32; N],
    /// As one number, see [`Plane::to_bits`].
    plane: [u32; N],
    /// Of the uppermost voxel, or [`NOTHING`].
    id: [u32; N],
}

impl<const N: usize> Lowest<N> {
    const NONE: Lowest<N> = Lowest { lowest: [0; N], uppermost: [0; N], plane: [0; N], id: [NOTHING; N] };
}

impl Lowest<16> {
    /// Of some columns of a brick, a bit each: they begin at a height.
    #[inline(always)]
    fn begin(&mut self, mut columns: u16, z: u32) {
        while columns != 0 {
            self.lowest[columns.trailing_zeros() as usize & 15] = z;
            columns &= columns - 1;
        }
    }

    /// They end at a height above the brick's lowest.
    #[inline(always)]
    fn end(&mut self, mut columns: u16, brick: &Brick, z: u32, planes: &[Plane], surface: Surface) {
        while columns != 0 {
            let number = columns.trailing_zeros() & 15;
            columns &= columns - 1;
            let id = brick.voxel_id(number, z);
            self.uppermost[number as usize] = brick.low + z;
            self.id[number as usize] = id;
            self.plane[number as usize] = match surface {
                Surface::Planes => planes[id as usize].to_bits(),
                Surface::Voxels => Plane::CEILING.to_bits(),
            };
        }
    }
}

impl Default for Ground {
    fn default() -> Ground {
        Ground {
            top: [0.0; COLUMNS],
            rise: [[0.0; COLUMNS]; 2],
            bottom: [f32::INFINITY; COLUMNS],
            shoulder: [0.0; COLUMNS],
            next_bottom: [f32::INFINITY; COLUMNS],
            solids: Lowest::NONE,
        }
    }
}

impl Ground {
    /// The columns of a brick, from a place on.
    #[inline(always)]
    fn put(&mut self, solids: &Lowest<16>, at: usize) {
        for x in 0..RIM {
            let at = at + x * STRIDE;
            put_row(&mut self.solids.lowest, at, &solids.lowest, x);
            put_row(&mut self.solids.uppermost, at, &solids.uppermost, x);
            put_row(&mut self.solids.plane, at, &solids.plane, x);
            put_row(&mut self.solids.id, at, &solids.id, x);
        }
    }

    /// The numbers from the voxels and planes.
    #[inline(always)]
    fn level(&mut self, level: u32, surface: Surface) {
        let (skirt, sink) = match surface {
            Surface::Planes => (Solid::SKIRT as f32, f32::INFINITY),
            Surface::Voxels => (0.0, f32::NEG_INFINITY),
        };
        let Lowest { lowest, uppermost, plane, id } = &self.solids;
        let [rises_x, rises_y] = &mut self.rise;
        // Without branches, so that it becomes vectors.
        for at in 0..COLUMNS {
            let (lowest, uppermost) = (above(lowest[at], level), above(uppermost[at], level));
            let (height, [slope_x, slope_y]) = Plane::single(plane[at]);
            let (rise_x, rise_y) = (0.5 * slope_x, 0.5 * slope_y);
            let corner = height - rise_x.abs() - rise_y.abs();
            let (floor, least) = (lowest - skirt, uppermost + corner);
            let bottom = if (least < floor) & (least < sink) { least } else { floor };
            let shoulder = uppermost + if corner < 0.0 { corner } else { 0.0 };
            self.top[at] = uppermost + height;
            rises_x[at] = rise_x;
            rises_y[at] = rise_y;
            self.bottom[at] = if id[at] == NOTHING { f32::INFINITY } else { bottom };
            self.shoulder[at] = if lowest == uppermost { bottom } else { shoulder };
        }
    }
}

/// Row x of the columns x + 4 y of a brick.
#[inline(always)]
fn put_row<T: Copy>(to: &mut [T; COLUMNS], at: usize, from: &[T; 16], x: usize) {
    let row: &mut [T; RIM] = (&mut to[at..at + RIM]).try_into().expect("as long");
    *row = [from[x], from[x + 4], from[x + 8], from[x + 12]];
}

#[inline(always)]
fn above(z: u32, level: u32) -> f32 {
    z.wrapping_sub(level) as i32 as f32
}

/// Voxels of a column without a gap.
#[derive(Clone, Copy)]
struct Run<'b> {
    lowest: u32,
    uppermost: u32,
    /// Of the uppermost.
    brick: &'b Brick,
}

pub struct Tile {
    pub ground: Ground,
    /// Height that the ground's is relative to.
    pub level: u32,
    surface: Surface,
    /// By the place of their columns, from the lowest upwards.
    bricks: [Vec<Brick>; BRICKS * BRICKS],
    /// Solids that do not lie lowest in their column, and where those of a column begin and end.
    upper: Vec<Piece>,
    upper_of: Vec<(u32, u32)>,
    /// Bit j of row i for a column of the tile with something in it, and with more than its lowest solid.
    occupied: [u32; SIDE],
    stacked: [u32; SIDE],
}

impl Default for Tile {
    fn default() -> Tile {
        Tile {
            ground: Ground::default(),
            level: 0,
            surface: Surface::default(),
            bricks: [const { Vec::new() }; BRICKS * BRICKS],
            upper: Vec::new(),
            upper_of: Vec::new(),
            occupied: [0; SIDE],
            stacked: [0; SIDE],
        }
    }
}

impl Tile {
    /// What stands on a square and in a row around it. `beyond` are squares beside it, of the same size, each with the
    /// place of its lowest corner relative to that of the square.
    #[inline(always)]
    pub fn gather(
        &mut self,
        stacks: &Stacks,
        square: &Square,
        beyond: &[(Square, [i32; 2])],
        planes: &[Plane],
        surface: Surface,
    ) {
        self.surface = surface;
        let (lowest, highest) = stacks.span(square);
        self.level = lowest.midpoint(highest);
        self.clear();
        let mut asked_for = 0;
        for (square, from) in [(*square, [0; 2])].iter().chain(beyond) {
            stacks.for_bricks(square, |place, brick| {
                let at = std::array::from_fn(|axis| from[axis] + (place[axis] * Brick::SIDE) as i32);
                if at.iter().all(|at| (-(Brick::SIDE as i32)..=SIDE as i32).contains(at)) {
                    // Asked for here, the planes come from memory while the other bricks are found.
                    asked_for ^= planes[brick.first_id() as usize].to_bits();
                    self.bricks[brick_index(at)].push(brick);
                }
            });
        }
        std::hint::black_box(asked_for);
        for number in 0..BRICKS * BRICKS {
            let at = [number / BRICKS, number % BRICKS].map(|place| (place as i32 - 1) * Brick::SIDE as i32);
            self.take(at, planes);
        }
        self.ground.level(self.level, surface);
    }

    fn clear(&mut self) {
        self.ground.solids.id = [NOTHING; COLUMNS];
        self.bricks.iter_mut().for_each(Vec::clear);
        if !self.upper.is_empty() || self.upper_of.is_empty() {
            self.ground.next_bottom = [f32::INFINITY; COLUMNS];
            self.upper.clear();
            self.upper_of.clear();
            self.upper_of.resize(COLUMNS, (0, 0));
        }
        self.occupied = [0; SIDE];
        self.stacked = [0; SIDE];
    }

    /// The 4 x 4 columns of a stack of bricks, the first of them at a place; but for those beyond the rim.
    #[inline(always)]
    fn take(&mut self, at: [i32; 2], planes: &[Plane]) {
        let bricks = std::mem::take(&mut self.bricks[brick_index(at)]);
        let wanted = wanted(at);
        let mut solids = Lowest::<16>::NONE;
        // Columns of which the lowest solid has begun, and has ended; those with another above it; and the level below.
        let (mut begun, mut ended, mut stacked, mut below) = (0, 0, 0, 0);
        for (number, brick) in bricks.iter().enumerate() {
            let is_under = |next: &&Brick| next.low == brick.low + Brick::SIDE;
            let above = bricks.get(number + 1).filter(is_under).map_or(0, |next| next.level(0));
            if number > 0 && bricks[number - 1].low + Brick::SIDE != brick.low {
                below = 0;
            }
            for z in 0..Brick::SIDE {
                let level = brick.level(z) & wanted;
                let next = if z + 1 < Brick::SIDE { brick.level(z + 1) } else { above };
                let begins = level & !below;
                stacked |= begins & begun;
                solids.begin(begins & !begun, brick.low + z);
                begun |= level;
                let ends = level & !next & !ended;
                solids.end(ends, brick, z, planes, self.surface);
                ended |= ends;
                below = level;
            }
        }
        self.ground.put(&solids, index(at));
        if (0..SIDE as i32).contains(&at[0]) && (0..SIDE as i32).contains(&at[1]) {
            for x in 0..Brick::SIDE {
                // Every fourth bit, side by side.
                let column = |of: u16| {
                    let bits = u32::from(of >> x) & 0x1111;
                    (bits | bits >> 3 | bits >> 6 | bits >> 9) & 0xf
                };
                let row = at[0] as usize + x as usize;
                self.occupied[row] |= column(begun) << at[1];
                self.stacked[row] |= column(stacked) << at[1];
            }
        }
        let mut left = stacked;
        while left != 0 {
            let number = left.trailing_zeros();
            left &= left - 1;
            self.take_upper(place_of(at, number), &bricks, number, planes);
        }
        self.bricks[brick_index(at)] = bricks;
    }

    /// The solids of a column above its lowest.
    #[inline(never)]
    fn take_upper(&mut self, place: [i32; 2], bricks: &[Brick], number: u32, planes: &[Plane]) {
        let at = index(place);
        let begin = self.upper.len() as u32;
        let mut run: Option<Run> = None;
        for brick in bricks {
            let mut left = brick.column(number);
            while left != 0 {
                let (first, length) =
                    (left.trailing_zeros(), (left >> left.trailing_zeros()).trailing_ones());
                left &= !(((1 << length) - 1) << first);
                let (begins, uppermost) = (brick.low + first, brick.low + first + length - 1);
                let continued = run.filter(|run| run.uppermost + 1 == begins);
                if continued.is_none() {
                    self.push_upper(run, number, at, planes);
                }
                run = Some(Run { lowest: continued.map_or(begins, |run| run.lowest), uppermost, brick });
            }
        }
        self.push_upper(run, number, at, planes);
        self.upper_of[at] = (begin, self.upper.len() as u32);
        self.ground.next_bottom[at] =
            (self.upper[begin as usize].solid.bottom - f64::from(self.level)) as f32;
    }

    /// Unless it is the lowest of its column.
    #[inline(always)]
    fn push_upper(&mut self, run: Option<Run>, number: u32, at: usize, planes: &[Plane]) {
        if let Some(run) = run.filter(|run| run.lowest != self.ground.solids.lowest[at]) {
            let id = run.brick.voxel_id(number, run.uppermost - run.brick.low);
            let solid = self.solid(run.lowest, run.uppermost, planes[id as usize], false);
            self.upper.push(Piece::new(solid, id, false));
        }
    }

    #[inline(always)]
    fn solid(&self, lowest: u32, uppermost: u32, plane: Plane, is_lowest: bool) -> Solid {
        match self.surface {
            Surface::Planes => Solid::under_plane(lowest, uppermost, plane, is_lowest),
            Surface::Voxels => Solid::of_cubes(lowest, uppermost),
        }
    }

    /// The lowest solid of a column.
    #[inline(always)]
    pub fn lowest(&self, at: [i32; 2]) -> Option<Piece> {
        let (at, solids) = (index(at), &self.ground.solids);
        if solids.id[at] == NOTHING {
            return None;
        }
        let plane = Plane::from_bits(solids.plane[at]);
        let solid = self.solid(solids.lowest[at], solids.uppermost[at], plane, true);
        Some(Piece::new(solid, solids.id[at], true))
    }

    /// Id of its uppermost voxel.
    #[inline(always)]
    pub fn lowest_id(&self, at: [i32; 2]) -> u32 {
        self.ground.solids.id[index(at)]
    }

    /// The others, from below.
    #[inline(always)]
    pub fn upper(&self, at: [i32; 2]) -> &[Piece] {
        let (first, end) = self.upper_of[index(at)];
        &self.upper[first as usize..end as usize]
    }

    /// Along each axis: whether the side of a piece that is turned to the camera is an open one, see
    /// [`Rim`](crate::back_projection::rim::Rim). What stands beside a tile must have been gathered.
    #[inline(always)]
    pub fn open_sides(&self, piece: &Piece, place: &Place) -> [bool; 2] {
        let is_ground = piece.is_lowest && self.surface == Surface::Planes;
        std::array::from_fn(|axis| {
            let mut before = place.at;
            before[axis] -= place.side[axis];
            is_ground && place.side[axis] != 0 && self.lowest_id(before) == NOTHING
        })
    }

    /// Whether there is something in every column.
    #[inline(always)]
    pub fn is_full(&self) -> bool {
        self.occupied == [(1 << SIDE) - 1; SIDE]
    }

    /// Bit j for a column of row i with something in it.
    #[inline(always)]
    pub fn occupied(&self, i: usize) -> u32 {
        self.occupied[i]
    }

    /// The same for those with more than their lowest solid.
    #[inline(always)]
    pub fn stacked(&self, i: usize) -> u32 {
        self.stacked[i]
    }

    /// Id of the voxel of a solid at a height.
    pub fn id(&self, at: [i32; 2], z: u32) -> u32 {
        let bricks = &self.bricks[brick_index(at)];
        // Without gaps it lies as many bricks above the lowest.
        let likely = bricks.get(((z - bricks[0].low) / Brick::SIDE) as usize);
        let brick =
            likely.filter(|brick| brick.contains(z)).or_else(|| bricks.iter().find(|b| b.contains(z)));
        let brick = brick.expect("a voxel of the tile");
        let [x, y] = at.map(|place| place.rem_euclid(Brick::SIDE as i32) as u32);
        brick.voxel_id(x + y * Brick::SIDE, z)
    }
}

/// Columns of a brick at a place, a bit each, that lie in the tile or right beside it.
#[inline(always)]
fn wanted(at: [i32; 2]) -> u16 {
    const BEFORE: i32 = -(Brick::SIDE as i32);
    let x = match at[0] {
        BEFORE => 0x8888,
        outside if outside == SIDE as i32 => 0x1111,
        _ => 0xffff,
    };
    let y = match at[1] {
        BEFORE => 0xf000,
        outside if outside == SIDE as i32 => 0x000f,
        _ => 0xffff,
    };
    x & y
}

/// Place of column x + 4 y of a brick at a place.
#[inline(always)]
fn place_of(at: [i32; 2], number: u32) -> [i32; 2] {
    [at[0] + (number % Brick::SIDE) as i32, at[1] + (number / Brick::SIDE) as i32]
}

#[inline(always)]
pub fn index(at: [i32; 2]) -> usize {
    (at[0] + RIM as i32) as usize * STRIDE + (at[1] + RIM as i32) as usize
}

#[inline(always)]
fn brick_index(at: [i32; 2]) -> usize {
    let [x, y] = at.map(|place| (place + Brick::SIDE as i32) as usize / Brick::SIDE as usize);
    x * BRICKS + y
}
