//! Looks that by themselves show crowd.
//!
//! Beliefs average what all drones saw, so one that sees nobody, because it is blind or too far to tell, outweighs another
//! that shows a crowd at the same time. A look that is clear by itself therefore stands for a while beside the beliefs:
//! those who see nobody there may be right, but they are not believed at once.
//!
//! For so long it closes its ground. Its place is not empty until somebody has looked after that: time alone clears nothing,
//! and neither does a look that the clear one outlives.

use crate::method::clearly_above;

/// So long such a look stands, whatever others show.
const STANDS_NS: i64 = 2_000_000_000;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShownLook {
    pub id: u32,
    pub stamp_ns: i64,
    /// Of crowd, as if nobody else had ever looked.
    pub log_odds: f32,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Shown {
    /// By voxel, newest first; each shows more than all newer ones of its voxel. What shows no more than a newer look
    /// says nothing that this one does not say, and longer: a fleet that hovers above a crowd adds none.
    looks: Vec<ShownLook>,
}

impl Shown {
    /// Takes in looks of an instant, and forgets those that did not stand any more when their voxel was last looked at.
    pub fn add(&mut self, looks: &[ShownLook], last_look_ns: impl Fn(u32) -> Option<i64>) {
        self.looks.extend_from_slice(looks);
        self.looks.retain(|look| last_look_ns(look.id).is_some_and(|last_ns| stands(look, last_ns)));
        self.looks.sort_by(|a, b| {
            (a.id, b.stamp_ns).cmp(&(b.id, a.stamp_ns)).then(b.log_odds.total_cmp(&a.log_odds))
        });
        self.looks.dedup_by(|older, newer| older.id == newer.id && older.log_odds <= newer.log_odds);
    }

    pub fn looks(&self) -> &[ShownLook] {
        &self.looks
    }

    /// The voxels that are shown, clearly above a threshold, at a stamp not before the newest instant; sorted.
    pub fn ids(&self, stamp_ns: i64, threshold: f64) -> Vec<u32> {
        self.ids_where(threshold, |look| stands(look, stamp_ns))
    }

    /// The voxels that were when somebody last looked at them; sorted.
    pub fn ids_at_last_looks(&self, threshold: f64) -> Vec<u32> {
        self.ids_where(threshold, |_| true)
    }

    fn ids_where(&self, threshold: f64, counts: impl Fn(&ShownLook) -> bool) -> Vec<u32> {
        let shows = |look: &&ShownLook| counts(look) && clearly_above(look.log_odds, threshold);
        let mut ids: Vec<u32> = self.looks.iter().filter(shows).map(|look| look.id).collect();
        ids.dedup();
        ids
    }

    /// Whether a look showed a voxel as crowd when somebody last looked at it, clearly above the prior: whatever the
    /// threshold of a zone, nobody calls that place empty.
    pub fn holds(&self, id: u32) -> bool {
        self.looks.binary_search_by_key(&id, |look| look.id).is_ok()
    }
}

fn stands(look: &ShownLook, stamp_ns: i64) -> bool {
    stamp_ns.saturating_sub(look.stamp_ns) <= STANDS_NS
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn look(id: u32, second: i64, log_odds: f32) -> ShownLook {
        ShownLook { id, stamp_ns: second * SECOND, log_odds }
    }

    /// Every voxel was last looked at then.
    fn last(second: i64) -> impl Fn(u32) -> Option<i64> {
        move |_| Some(second * SECOND)
    }

    #[test]
    fn a_look_stands_for_two_seconds() {
        let mut shown = Shown::default();
        shown.add(&[look(7, 10, 2.5), look(3, 10, 3.5)], last(10));
        // Log odds of 0 are the threshold .5, and 2 more are clearly above it.
        assert_eq!(shown.ids(12 * SECOND, 0.5), [3, 7]);
        assert_eq!(shown.ids(12 * SECOND, 0.8), [3]);
        assert!(shown.ids(12 * SECOND, 1.0).is_empty());
        assert!(shown.ids(12 * SECOND + 1, 0.5).is_empty());
    }

    #[test]
    fn a_place_is_shown_until_somebody_looks_who_the_look_does_not_outlive() {
        let mut shown = Shown::default();
        shown.add(&[look(7, 10, 2.5), look(3, 10, 3.5)], last(10));
        // Nobody has looked again, or just before it was over.
        for newest in [10, 12] {
            shown.add(&[], last(newest));
            assert_eq!(shown.ids_at_last_looks(0.5), [3, 7]);
            assert!(shown.holds(7) && shown.holds(3));
            assert!(!shown.holds(5) && !shown.holds(8));
        }
        shown.add(&[], |id| Some(if id == 7 { 12 * SECOND + 1 } else { 12 * SECOND }));
        assert_eq!(shown.ids_at_last_looks(0.5), [3]);
        // A look that comes late, and was taken 1 s before somebody else's last one, and 3 s.
        shown.add(&[look(8, 20, 4.0), look(9, 20, 4.0)], |id| Some(if id == 9 { 23 } else { 21 } * SECOND));
        assert_eq!(shown.ids_at_last_looks(0.5), [8]);
    }

    #[test]
    fn what_does_not_stand_any_more_is_not_kept_in_whatever_order_it_comes() {
        let looks = [look(7, 10, 2.5), look(7, 11, 2.0), look(7, 9, 4.0), look(2, 12, 2.0), look(7, 11, 2.2)];
        let mut at_once = Shown::default();
        at_once.add(&looks, last(12));
        let mut one_by_one = Shown::default();
        for (number, look) in looks.iter().enumerate() {
            one_by_one.add(&[*look], last(if number < 3 { 11 } else { 12 }));
        }
        assert_eq!(at_once, one_by_one);
        assert_eq!(at_once.looks(), [looks[3], looks[4], looks[0]]);
        assert_eq!(at_once.ids(12 * SECOND, 0.5), [2, 7]);
    }

    #[test]
    fn many_looks_at_a_crowd_are_no_more_than_one_of_them() {
        let mut shown = Shown::default();
        for drone in 0..12 {
            let looks: Vec<ShownLook> = (0..20).map(|id| look(id, 10 + drone / 6, 4.0)).collect();
            shown.add(&looks, last(11));
        }
        assert_eq!(shown.looks().len(), 20);
        // A weaker look later stands longer, for a lower threshold.
        shown.add(&[look(7, 12, 2.5), look(8, 12, 4.5)], last(12));
        assert_eq!(shown.looks().len(), 21);
        assert_eq!(shown.ids(13 * SECOND, 0.8).len(), 20);
        assert_eq!(shown.ids(14 * SECOND, 0.5), [7, 8]);
        assert_eq!(shown.ids(14 * SECOND, 0.8), [8]);
    }
}
