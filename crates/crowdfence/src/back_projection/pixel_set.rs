//! Pixels of an image, a bit each.

const WORD: usize = u64::BITS as usize;

#[derive(Debug, Clone)]
pub(super) struct PixelSet {
    /// Of a row: one more than its pixels need, so that what is looked at over the end of a word has another behind it.
    pub words_a_row: usize,
    pub words: Vec<u64>,
}

impl PixelSet {
    /// None of an image.
    pub fn empty(width: usize, height: usize) -> PixelSet {
        let words_a_row = width.div_ceil(WORD) + 1;
        PixelSet { words_a_row, words: vec![0; words_a_row * height] }
    }

    pub fn insert(&mut self, column: usize, row: usize) {
        self.words[row * self.words_a_row + column / WORD] |= 1 << (column % WORD);
    }

    pub fn contains(&self, column: usize, row: usize) -> bool {
        self.words[row * self.words_a_row + column / WORD] >> (column % WORD) & 1 != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_in_when_it_was_put_in() {
        let mut set = PixelSet::empty(130, 3);
        let pixels = [(0, 0), (63, 0), (64, 1), (129, 2)];
        pixels.iter().for_each(|&(column, row)| set.insert(column, row));
        let found: Vec<_> = (0..3)
            .flat_map(|row| (0..130).map(move |column| (column, row)))
            .filter(|&(column, row)| set.contains(column, row))
            .collect();
        assert_eq!(found, pixels);
    }
}
