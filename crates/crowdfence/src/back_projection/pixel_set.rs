//! Pixels of an image, a bit each.

use std::ops::Range;

pub(super) const WORD: usize = u64::BITS as usize;

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

    /// Those of all pixels, row after row, for which something holds.
    pub fn of(width: usize, pixels: &[bool]) -> PixelSet {
        let mut set = PixelSet::empty(width, pixels.len() / width);
        for (words, row) in set.words.chunks_mut(set.words_a_row).zip(pixels.chunks(width)) {
            for (word, pixels) in words.iter_mut().zip(row.chunks(WORD)) {
                *word = pixels.iter().rev().fold(0, |bits, &holds| bits << 1 | u64::from(holds));
            }
        }
        set
    }

    /// Takes those of another set of the same image out.
    pub fn remove(&mut self, others: &PixelSet) {
        self.words.iter_mut().zip(&others.words).for_each(|(word, others)| *word &= !others);
    }

    pub fn contains(&self, column: usize, row: usize) -> bool {
        self.words[row * self.words_a_row + column / WORD] >> (column % WORD) & 1 != 0
    }

    /// All of some rows and columns, at least one of these.
    #[inline(always)]
    pub fn contain(&self, mut rows: Range<usize>, columns: &Range<usize>) -> bool {
        rows.all(|row| {
            let words = &self.words[row * self.words_a_row..];
            spans(columns).all(|(word, columns)| bits(&columns) & !words[word] == 0)
        })
    }
}

/// Columns in a row, at least one, cut at the words that hold their bits, each part with its word.
#[inline(always)]
pub(super) fn spans(columns: &Range<usize>) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
    let Range { start, end } = *columns;
    let cut = move |word: usize| (word, start.max(word * WORD)..end.min((word + 1) * WORD));
    (start / WORD..end.div_ceil(WORD)).map(cut)
}

/// Of columns, at least one, that lie in one word.
#[inline(always)]
pub(super) fn bits(columns: &Range<usize>) -> u64 {
    (u64::MAX >> (WORD - columns.len())) << (columns.start % WORD)
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

        let mut all = vec![false; 3 * 130];
        pixels.iter().for_each(|&(column, row)| all[row * 130 + column] = true);
        let mut same = PixelSet::of(130, &all);
        assert_eq!(same.words, set.words);
        let mut first = PixelSet::empty(130, 3);
        first.insert(0, 0);
        first.insert(5, 2);
        same.remove(&first);
        assert!(!same.contains(0, 0) && same.contains(63, 0) && !same.contains(5, 2));
    }
}
