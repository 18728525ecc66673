//! One value per voxel, in pages that exist only where something was written.

use std::{iter, mem};

pub(super) const PAGE_LENGTH: usize = 1024;

/// Ids, sorted and each there once, with the number of the page that holds them.
pub(super) fn by_page(mut ids: &[u32]) -> impl Iterator<Item = (usize, &[u32])> {
    let page_of = |id: u32| id as usize / PAGE_LENGTH;
    iter::from_fn(move || {
        let page = page_of(*ids.first()?);
        let within = &ids[..ids.len().min(PAGE_LENGTH)];
        let (of_page, rest) = ids.split_at(within.partition_point(|&id| page_of(id) == page));
        ids = rest;
        Some((page, of_page))
    })
}

#[derive(Debug, Clone)]
pub(super) struct Pages<T> {
    pages: Vec<Option<Box<[T]>>>,
    /// The value where nothing was written.
    absent: T,
}

impl<T: Copy> Pages<T> {
    pub fn new(length: usize, absent: T) -> Pages<T> {
        Pages { pages: vec![None; length.div_ceil(PAGE_LENGTH)], absent }
    }

    pub fn get(&self, at: usize) -> T {
        self.pages[at / PAGE_LENGTH].as_ref().map_or(self.absent, |page| page[at % PAGE_LENGTH])
    }

    pub fn get_mut(&mut self, at: usize) -> &mut T {
        &mut self.page_mut(at / PAGE_LENGTH)[at % PAGE_LENGTH]
    }

    /// Page `number`; made where nothing was written.
    pub fn page_mut(&mut self, number: usize) -> &mut [T] {
        let absent = self.absent;
        self.pages[number].get_or_insert_with(|| vec![absent; PAGE_LENGTH].into())
    }

    /// The pages of these numbers, increasing; made where nothing was written.
    pub fn open(&mut self, numbers: &[usize]) -> Vec<&mut [T]> {
        let absent = self.absent;
        let (mut rest, mut passed) = (self.pages.as_mut_slice(), 0);
        let open = |&number| {
            let (page, after) = mem::take(&mut rest)[number - passed..].split_first_mut().expect("a page");
            (rest, passed) = (after, number + 1);
            &mut **page.get_or_insert_with(|| vec![absent; PAGE_LENGTH].into())
        };
        numbers.iter().map(open).collect()
    }

    /// Page `number`, if anything was written there.
    pub fn page(&self, number: usize) -> Option<&[T]> {
        self.pages[number].as_deref()
    }

    /// Number of pages, written or not.
    pub fn count(&self) -> usize {
        self.pages.len()
    }

    /// The pages that were written, with their numbers.
    pub fn written(&self) -> impl Iterator<Item = (usize, &[T])> {
        self.pages.iter().enumerate().filter_map(|(number, page)| Some((number, page.as_deref()?)))
    }

    /// Every value on a written page, with its place.
    pub fn values(&self) -> impl Iterator<Item = (usize, T)> {
        self.written().flat_map(|(number, page)| {
            page.iter().enumerate().map(move |(slot, &value)| (number * PAGE_LENGTH + slot, value))
        })
    }

    /// Replaces page `number` (below `count`) by as many values as a page holds.
    pub fn put(&mut self, number: usize, page: Vec<T>) {
        debug_assert_eq!(page.len(), PAGE_LENGTH);
        self.pages[number] = Some(page.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_parted_where_pages_end() {
        let whole: Vec<u32> = (2048..3072).collect();
        let ids = [&[0, 1023, 1024], &whole[..], &[7000]].concat();
        let parts: Vec<(usize, &[u32])> = by_page(&ids).collect();
        assert_eq!(parts, [(0, &ids[..2]), (1, &ids[2..3]), (2, &whole[..]), (6, &ids[1027..])]);
        assert_eq!(by_page(&[]).count(), 0);
    }
}
