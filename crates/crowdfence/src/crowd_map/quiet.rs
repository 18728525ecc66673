//! Pages of voxels without crowd that hold none until somebody looks at them: whoever asks for crowd need not
//! read them again.
//!
//! A method says from which thresholds on nothing begins by forgetting. A page whose voxels are all below such a
//! threshold at one moment is so at every later one, until an instant writes more to it. It is awake then, and read
//! once; a page with crowd stays awake. Each page is asleep from a stamp on: who asks for an older one, which an
//! instant that comes late does, reads it again.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

/// Callers ask at one or two thresholds; one that tries many reads everything each time.
const MOST_THRESHOLDS: usize = 4;

/// So far below the threshold that no rounding brings a voxel back.
const MARGIN: f64 = 1e-9;

/// Of one crowd map; its clones begin with nothing.
#[derive(Debug, Default)]
pub(super) struct Quiet {
    /// The one asked last comes last.
    by_threshold: Mutex<Vec<Pages>>,
}

/// Pages by what is known of them at one threshold.
#[derive(Debug)]
pub(super) struct Pages {
    threshold: f64,
    awake: BTreeSet<usize>,
    /// From which stamp on.
    asleep: BTreeMap<usize, i64>,
    by_stamp: BTreeSet<(i64, usize)>,
}

impl Clone for Quiet {
    fn clone(&self) -> Quiet {
        Quiet::default()
    }
}

impl Quiet {
    /// What is known at a threshold, taken out to be read and put back; `written` are all pages, for the first time.
    pub fn take(&self, threshold: f64, written: impl Iterator<Item = usize>) -> Pages {
        let mut known = self.by_threshold.lock().expect("nobody panics with it");
        let place = known.iter().position(|pages| pages.threshold == threshold);
        place.map(|place| known.remove(place)).unwrap_or_else(|| Pages::all_awake(threshold, written))
    }

    pub fn put(&self, pages: Pages) {
        let mut known = self.by_threshold.lock().expect("nobody panics with it");
        known.retain(|other| other.threshold != pages.threshold);
        known.push(pages);
        let surplus = known.len().saturating_sub(MOST_THRESHOLDS);
        known.drain(..surplus);
    }

    /// An instant has written to these pages, at each of them this probability at most, as of `stamp_ns`.
    pub fn wrote(&mut self, written: &[(usize, f64)], stamp_ns: i64) {
        for pages in self.by_threshold.get_mut().expect("nobody panics with it") {
            written.iter().for_each(|&(page, largest)| pages.wrote(page, largest, stamp_ns));
        }
    }
}

impl Pages {
    fn all_awake(threshold: f64, written: impl Iterator<Item = usize>) -> Pages {
        let awake = written.collect();
        Pages { threshold, awake, asleep: BTreeMap::new(), by_stamp: BTreeSet::new() }
    }

    /// Pages that can hold crowd at a stamp, sorted.
    pub fn to_read(&self, stamp_ns: i64) -> Vec<usize> {
        let later = self.by_stamp.range((stamp_ns.saturating_add(1), 0)..).map(|&(_, page)| page);
        let mut pages: Vec<usize> = self.awake.iter().copied().chain(later).collect();
        pages.sort_unstable();
        pages
    }

    /// What a reading at a stamp found on a page: the largest probability.
    pub fn found(&mut self, page: usize, largest: f64, stamp_ns: i64) {
        self.wake(page);
        if surely_below(largest, self.threshold) {
            self.sleep(page, stamp_ns);
        }
    }

    /// What is written to a page that holds nothing else, or nothing else of crowd, is all that can be crowd there.
    fn wrote(&mut self, page: usize, largest: f64, stamp_ns: i64) {
        let since_ns = self.asleep.get(&page).map_or(stamp_ns, |&asleep_ns| asleep_ns.max(stamp_ns));
        let is_awake = self.awake.contains(&page);
        self.wake(page);
        if !is_awake && surely_below(largest, self.threshold) {
            self.sleep(page, since_ns);
        }
    }

    fn sleep(&mut self, page: usize, stamp_ns: i64) {
        self.awake.remove(&page);
        self.asleep.insert(page, stamp_ns);
        self.by_stamp.insert((stamp_ns, page));
    }

    fn wake(&mut self, page: usize) {
        if let Some(stamp_ns) = self.asleep.remove(&page) {
            self.by_stamp.remove(&(stamp_ns, page));
        }
        self.awake.insert(page);
    }
}

/// Whether a probability is below a threshold whatever is lost by rounding.
fn surely_below(probability: f64, threshold: f64) -> bool {
    probability < threshold * (1.0 - MARGIN)
}
