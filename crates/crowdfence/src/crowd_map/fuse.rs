//! One instant taken in, page by page: every voxel that was seen is looked up once.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::beliefs::BeliefsOf;
use super::history::{History, Look};
use super::instants::{Instant, Instants};
use super::pages::{PAGE_LENGTH, by_page};
use super::reading::fading;
use super::shown::ShownLook;
use crate::method::{Elapsed, FusionMethod, VoxelLook};
use crate::observation::Observation;

/// So many pages are one piece of work.
const PAGES_AT_ONCE: usize = 8;

/// Voxels that were seen, sorted, and their probability after the instant.
#[derive(Debug)]
pub(super) struct Fused {
    pub voxel_ids: Vec<u32>,
    pub probability: Vec<f64>,
    /// Pages with voxels in view, and the largest of these probabilities on each.
    pub pages: Vec<(usize, f64)>,
    /// Whether these probabilities are what the looks left, with nothing forgotten since.
    pub is_as_looked: bool,
    /// Of each view, the voxels at which its look told the method nothing, sorted.
    pub untold: Vec<Vec<u32>>,
    /// Looks that by themselves may show crowd.
    pub shown: Vec<ShownLook>,
}

impl Fused {
    /// The pages and the largest probability that the last looks left on each, or more.
    pub fn pages_at_last_looks(&self) -> Vec<(usize, f64)> {
        let most = |largest| if self.is_as_looked { largest } else { 1.0 };
        self.pages.iter().map(|&(page, largest)| (page, most(largest))).collect()
    }
}

/// The views of one instant.
#[derive(Clone, Copy)]
pub(super) struct Views<'a> {
    pub observations: &'a [Arc<Observation>],
    /// Number of each view's drone.
    pub drones: &'a [u32],
    /// When each view counts as taken.
    pub taken: &'a [Instant],
}

/// Lets the method update what it believes about the voxels of `views`, and remembers when they were seen; `now` is
/// the instant itself.
pub(super) fn fuse<M: FusionMethod>(
    beliefs: &mut BeliefsOf<M>,
    history: &mut History,
    views: Views<'_>,
    now: Instant,
) -> Fused {
    let times = Times::open(&beliefs.method, &mut history.instants, views.taken, now);
    let rows = rows_by_page(views.observations);
    let pages: Vec<&[Rows]> = rows.chunk_by(|a, b| a.page == b.page).collect();
    let numbers: Vec<usize> = pages.iter().map(|rows| rows[0].page).collect();
    let (looks, believed) = (history.looks.open(&numbers), beliefs.pages.open(&numbers));
    let (method, instants) = (&beliefs.method, &history.instants);
    let seen: Vec<PageSeen> = (pages, looks, believed)
        .into_par_iter()
        .with_min_len(PAGES_AT_ONCE)
        .map(|(rows, looks, beliefs)| {
            let seen = PageSeen::new(&times, rows.iter().map(|rows| rows.rows.len()).sum());
            let mut page = Page { codes: looks, beliefs, looks: vec![], seen };
            page.take_in(rows, views, method, instants, &times);
            page.seen
        })
        .collect();
    let count = seen.iter().map(|page| page.voxel_ids.len()).sum();
    let mut fused = Fused {
        voxel_ids: Vec::with_capacity(count),
        probability: Vec::with_capacity(count),
        pages: numbers.into_iter().zip(seen.iter().map(|page| page.largest)).collect(),
        is_as_looked: times.instants == [now],
        untold: vec![vec![]; views.observations.len()],
        shown: vec![],
    };
    for page in seen {
        fused.voxel_ids.extend_from_slice(&page.voxel_ids);
        fused.probability.extend_from_slice(&page.probability);
        page.untold.into_iter().for_each(|(view, id)| fused.untold[view as usize].push(id));
        fused.shown.extend_from_slice(&page.shown);
        times.slots.iter().zip(page.entered).for_each(|(&slot, count)| history.instants.enter(slot, count));
        page.left.into_iter().for_each(|(slot, count)| history.instants.leave(slot, count));
    }
    times.slots.iter().for_each(|&slot| history.instants.close(slot));
    fused
}

/// The different instants at which the views were taken, oldest first.
struct Times<M: FusionMethod> {
    instants: Vec<Instant>,
    /// Slot of each.
    slots: Vec<u32>,
    /// What is left at each of the beliefs of every slot.
    fading: Vec<Vec<M::Fading>>,
    /// What is left of a look at each of them at each other, row by row.
    between: Vec<Vec<M::Fading>>,
    /// What is left of a look at once.
    whole: M::Fading,
    /// What is left of them after the instant.
    fading_after: Vec<M::Fading>,
    /// Position in `instants` for each view.
    of_view: Vec<usize>,
}

impl<M: FusionMethod> Times<M> {
    /// Opens the slots.
    fn open(method: &M, known: &mut Instants, taken: &[Instant], now: Instant) -> Times<M> {
        let mut instants = taken.to_vec();
        instants.sort_unstable();
        instants.dedup();
        let slots = instants.iter().map(|&instant| known.open(instant)).collect();
        let fading_at = |&instant: &Instant| fading(method, known, instant);
        let between_all = |to: &Instant| instants.iter().map(|from| method.fading(from.until(*to))).collect();
        let place = |instant: &Instant| instants.binary_search(instant).expect("it is one of them");
        Times {
            slots,
            fading: instants.iter().map(fading_at).collect(),
            between: instants.iter().map(between_all).collect(),
            whole: method.fading(Elapsed { seconds: 0.0, instants: 0 }),
            fading_after: fading_at(&now),
            of_view: taken.iter().map(place).collect(),
            instants,
        }
    }
}

/// Rows of one view's observation, all of one page.
struct Rows {
    page: usize,
    view: usize,
    rows: Range<usize>,
}

/// Sorted by page, then in the order of the views.
fn rows_by_page(observations: &[Arc<Observation>]) -> Vec<Rows> {
    let mut all = Vec::new();
    for (view, observation) in observations.iter().enumerate() {
        let mut start = 0;
        for (page, ids) in by_page(observation.voxel_ids()) {
            all.push(Rows { page, view, rows: start..start + ids.len() });
            start += ids.len();
        }
    }
    // Every view is sorted already: a stable sort merges them and keeps their order.
    all.sort_by_key(|rows| rows.page);
    all
}

/// What an instant shows of one page of voxels.
struct PageSeen {
    voxel_ids: Vec<u32>,
    probability: Vec<f64>,
    largest: f64,
    /// View and voxel, by voxel.
    untold: Vec<(u32, u32)>,
    shown: Vec<ShownLook>,
    /// How many of its voxels name each of the slots of [`Times`] now.
    entered: Vec<u32>,
    /// Slots that they named before, and how many.
    left: Vec<(u32, u32)>,
}

impl PageSeen {
    /// There is room for `most` voxels.
    fn new<M: FusionMethod>(times: &Times<M>, most: usize) -> PageSeen {
        PageSeen {
            voxel_ids: Vec::with_capacity(most),
            probability: Vec::with_capacity(most),
            largest: 0.0,
            untold: vec![],
            shown: vec![],
            entered: vec![0; times.slots.len()],
            left: vec![],
        }
    }

    fn leave(&mut self, slot: u32) {
        match self.left.last_mut() {
            Some((last, count)) if *last == slot => *count += 1,
            _ => self.left.push((slot, 1)),
        }
    }
}

struct Page<'a, M: FusionMethod> {
    /// Of [`Look`].
    codes: &'a mut [u32],
    beliefs: &'a mut [M::Belief],
    /// The looks at one voxel, and what time leaves of each.
    looks: Vec<(VoxelLook, M::Fading)>,
    seen: PageSeen,
}

/// What is left of one view's rows.
struct Next<'a> {
    view: usize,
    /// Of all its rows.
    ids: &'a [u32],
    rows: Range<usize>,
    /// Of the next row, [`Next::NONE`] after the last.
    id: u32,
}

impl<'a> Next<'a> {
    const NONE: u32 = u32::MAX;

    fn new(rows: &Rows, views: Views<'a>) -> Next<'a> {
        let ids = views.observations[rows.view].voxel_ids();
        Next { view: rows.view, ids, rows: rows.rows.clone(), id: ids[rows.rows.start] }
    }

    /// The next row, which is passed.
    fn pass(&mut self) -> usize {
        let row = self.rows.start;
        self.rows.start += 1;
        self.id = if self.rows.is_empty() { Next::NONE } else { self.ids[self.rows.start] };
        row
    }
}

impl<M: FusionMethod> Page<'_, M> {
    /// `rows` are those of this page.
    fn take_in(
        &mut self,
        rows: &[Rows],
        views: Views<'_>,
        method: &M,
        instants: &Instants,
        times: &Times<M>,
    ) {
        let mut coming: Vec<Next<'_>> = rows.iter().map(|rows| Next::new(rows, views)).collect();
        loop {
            let id = coming.iter().map(|next| next.id).min().unwrap_or(Next::NONE);
            if id == Next::NONE {
                break;
            }
            self.looks.clear();
            for next in coming.iter_mut().filter(|next| next.id == id) {
                let look = views.look(next.view, next.pass());
                match method.tells(&look) {
                    true => self.looks.push((look, times.whole)),
                    false => self.seen.untold.push((look.view, id)),
                }
            }
            match self.looks.is_empty() {
                true => Look::hide(&mut self.codes[id as usize % PAGE_LENGTH]),
                false => self.see(id, method, instants, times),
            }
        }
    }

    fn see(&mut self, id: u32, method: &M, instants: &Instants, times: &Times<M>) {
        let at = id as usize % PAGE_LENGTH;
        let time_of = |look: &VoxelLook| times.of_view[look.view as usize];
        let newest = self.looks.iter().map(|(look, _)| time_of(look)).max().expect("it was seen");
        let last = match Look::from_code(self.codes[at]) {
            Look::At(slot) => Some(slot),
            Look::Never | Look::Occluded => None,
        };
        // An older look than the last one does not make it older.
        let newer = last.map(|slot| instants.at(slot)).filter(|&last| last > times.instants[newest]);
        for (look, fading) in &mut self.looks {
            let time = time_of(look);
            if let Some(log_odds) = method.log_odds_alone(look) {
                self.seen.shown.push(ShownLook { id, stamp_ns: times.instants[time].stamp_ns, log_odds });
            }
            *fading = match newer {
                Some(last) => method.fading(times.instants[time].until(last)),
                None => times.between[newest][time],
            };
        }
        let believed = last.map(|slot| (self.beliefs[at], slot as usize));
        // To an older look no time passes, and no instant either.
        let fading = |slot: usize| if newer.is_some() { times.whole } else { times.fading[newest][slot] };
        let before = believed.map(|(belief, slot)| (belief, fading(slot)));
        let belief = method.update(before, &self.looks);
        self.beliefs[at] = belief;
        let slot = match last {
            Some(slot) if newer.is_some() => slot,
            _ => {
                last.into_iter().for_each(|slot| self.seen.leave(slot));
                self.seen.entered[newest] += 1;
                times.slots[newest]
            }
        };
        let as_of_now = |(belief, slot): (M::Belief, usize)| (belief, times.fading_after[slot]);
        let after = as_of_now((belief, slot as usize));
        self.codes[at] = Look::had(slot, method.speaks_for_crowd(believed.map(as_of_now), after));
        let probability = method.probability(after.0, after.1);
        self.seen.largest = self.seen.largest.max(probability);
        self.seen.voxel_ids.push(id);
        self.seen.probability.push(probability);
    }
}

impl Views<'_> {
    /// What row `row` of a view's observation says.
    fn look(&self, view: usize, row: usize) -> VoxelLook {
        let seen = self.observations[view].seen();
        VoxelLook {
            voxel_id: seen.ids[row],
            view: view as u32,
            drone: self.drones[view],
            mean: seen.mean[row],
            pixel_count: seen.pixel_count[row],
            range_m: seen.range_m[row],
            tilt_deg: seen.tilt_deg[row],
            focal_px: self.observations[view].focal_px(),
        }
    }
}
