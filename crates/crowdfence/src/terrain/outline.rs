//! How far the voxels reach along x and y: what tells a hole of the map from the ground beside it.

use super::tree::{Ascent, Tree};

/// First and last coordinate with a voxel; first > last where there is none.
type Span = (u32, u32);

#[derive(Debug, Clone)]
pub(crate) struct Outline {
    /// Along x, for every y.
    rows: Vec<Span>,
    /// Along y, for every x.
    columns: Vec<Span>,
}

impl Outline {
    pub fn of(tree: &Tree, extent: [u32; 3]) -> Outline {
        let none = (u32::MAX, 0);
        let mut outline =
            Outline { rows: vec![none; extent[1] as usize], columns: vec![none; extent[0] as usize] };
        let mut ascent = Ascent::new(tree);
        for id in 0..tree.voxel_count() as u32 {
            let [x, y, _] = ascent.coordinate(id);
            widen(&mut outline.rows[y as usize], x);
            widen(&mut outline.columns[x as usize], y);
        }
        outline
    }

    /// Whether there are voxels, at any height, in all four directions of the compass from a place of the map's
    /// extent. Of a map without dents it is true inside and nowhere else.
    pub fn encloses(&self, x: u32, y: u32) -> bool {
        let holds = |(first, last): Span, at: u32| first < at && at < last;
        holds(self.rows[y as usize], x) && holds(self.columns[x as usize], y)
    }
}

fn widen(span: &mut Span, at: u32) {
    *span = (span.0.min(at), span.1.max(at));
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use crate::terrain::Terrain;

    /// Columns of a picture of a map seen from above, north up, and which of its empty places it encloses (o).
    #[test]
    fn holes_are_told_from_what_lies_beside() {
        let picture = [
            "...##...", //
            "..#o##..", ".#oo###.", "..####..", "....#...",
        ];
        let at = |x: usize, y: usize| picture[4 - y].as_bytes()[x];
        let places = || (0..8).flat_map(|x| (0..5).map(move |y| (x, y)));
        let voxels: Vec<[i32; 3]> = places()
            .filter(|&(x, y)| at(x, y) == b'#')
            .map(|(x, y)| [x as i32, y as i32, (7 * x + y) as i32 % 5])
            .collect();
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        for (x, y) in places().filter(|&(x, y)| at(x, y) != b'#' && (1..7).contains(&x)) {
            let is_hole = at(x, y) == b'o';
            assert_eq!(terrain.outline().encloses(x as u32 - 1, y as u32), is_hole, "({x}, {y})");
        }
    }
}
