//! What is kept per voxel, in pages that exist only where something was seen.

/// What is known about a voxel. Unseen is never the same as empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum VoxelState {
    /// No view has ever seen it.
    NeverSeen = 0,
    /// Never seen: a camera pointed at it and something hid it.
    Occluded = 1,
    /// Seen lately, not crowd.
    Empty = 2,
    /// Seen, not crowd, but too long ago to be evidence of absence.
    Stale = 3,
    Crowd = 4,
}

/// The last look at a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    Never,
    Occluded,
    /// Number of the instant.
    At(u32),
}

impl Look {
    const NEVER: u32 = u32::MAX;
    const OCCLUDED: u32 = u32::MAX - 1;

    pub(super) fn from_code(code: u32) -> Look {
        match code {
            Look::NEVER => Look::Never,
            Look::OCCLUDED => Look::Occluded,
            instant => Look::At(instant),
        }
    }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Belief {
    /// P~ as of its last look.
    pub probability: f64,
    /// Number of the instant of that look.
    pub instant: u32,
}

pub(super) const PAGE_VOXELS: usize = 1024;

#[derive(Debug, Clone)]
pub(super) struct Page {
    pub probability: Vec<f64>,
    /// Coded as in [`Look`]: 12 bytes a voxel instead of 16.
    pub look: Vec<u32>,
}

impl Page {
    fn new() -> Page {
        Page { probability: vec![0.0; PAGE_VOXELS], look: vec![Look::NEVER; PAGE_VOXELS] }
    }
}

#[derive(Debug, Clone)]
pub(super) struct BeliefStore {
    pages: Vec<Option<Box<Page>>>,
}

impl BeliefStore {
    pub fn new(voxel_count: usize) -> BeliefStore {
        BeliefStore { pages: vec![None; voxel_count.div_ceil(PAGE_VOXELS)] }
    }

    pub fn look(&self, id: u32) -> Look {
        self.pages[id as usize / PAGE_VOXELS]
            .as_ref()
            .map_or(Look::Never, |page| Look::from_code(page.look[id as usize % PAGE_VOXELS]))
    }

    pub fn belief(&self, id: u32) -> Option<Belief> {
        let page = self.pages[id as usize / PAGE_VOXELS].as_ref()?;
        let slot = id as usize % PAGE_VOXELS;
        match Look::from_code(page.look[slot]) {
            Look::At(instant) => Some(Belief { probability: page.probability[slot], instant }),
            Look::Never | Look::Occluded => None,
        }
    }

    pub fn store(&mut self, id: u32, probability: f64, instant: u32) {
        let slot = id as usize % PAGE_VOXELS;
        let page = self.page_mut(id);
        page.probability[slot] = probability;
        page.look[slot] = instant;
    }

    /// A voxel that was seen before stays seen.
    pub fn mark_occluded(&mut self, id: u32) {
        let slot = id as usize % PAGE_VOXELS;
        let look = &mut self.page_mut(id).look[slot];
        if *look == Look::NEVER {
            *look = Look::OCCLUDED;
        }
    }

    pub fn seen_ids(&self) -> Vec<u32> {
        let pages = self.pages.iter().enumerate().filter_map(|(number, page)| Some((number, page.as_ref()?)));
        pages
            .flat_map(|(number, page)| {
                let looks = page.look.iter().enumerate();
                looks
                    .filter(|&(_, &look)| matches!(Look::from_code(look), Look::At(_)))
                    .map(move |(slot, _)| (number * PAGE_VOXELS + slot) as u32)
            })
            .collect()
    }

    fn page_mut(&mut self, id: u32) -> &mut Page {
        self.pages[id as usize / PAGE_VOXELS].get_or_insert_with(|| Box::new(Page::new()))
    }

    pub fn pages(&self) -> &[Option<Box<Page>>] {
        &self.pages
    }

    pub fn put_page(&mut self, number: usize, probability: Vec<f64>, look: Vec<u32>) {
        self.pages[number] = Some(Box::new(Page { probability, look }));
    }
}
