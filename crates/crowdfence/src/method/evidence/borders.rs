//! Borders between the bins of a table, counted for 100,000 values a view: a ruler of even steps says how many lie in the
//! steps before a value's own, and only those in its own are compared.

/// Steps of a ruler.
const STEPS: usize = 256;

/// Numbers above 0, increasing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Borders {
    borders: Vec<f32>,
    /// How many lie in the steps before each step.
    before: Vec<u32>,
    /// In a unit of the values.
    steps: f32,
}

impl Borders {
    pub fn new(borders: Vec<f32>) -> Borders {
        // The last border lies in the last step but one, so that what lies beyond it is compared with none.
        let steps = borders.last().map_or(0.0, |&last| (STEPS - 2) as f32 / last);
        let steps = if steps.is_finite() { steps } else { 0.0 };
        let mut ruler = Borders { borders, before: vec![0; STEPS], steps };
        for step in 0..STEPS {
            let is_before = |border: &&f32| ruler.step_of(**border) < step;
            ruler.before[step] = ruler.borders.iter().filter(is_before).count() as u32;
        }
        ruler
    }

    pub fn count(&self) -> usize {
        self.borders.len()
    }

    pub fn as_slice(&self) -> &[f32] {
        &self.borders
    }

    /// How many are at most as large as a value.
    #[inline(always)]
    pub fn up_to(&self, value: f32) -> usize {
        self.count_before(value, |border| border <= value)
    }

    /// How many are smaller than a value.
    #[inline(always)]
    pub fn below(&self, value: f32) -> usize {
        self.count_before(value, |border| border < value)
    }

    #[inline(always)]
    fn count_before(&self, value: f32, is_before: impl Fn(f32) -> bool) -> usize {
        let mut count = self.before[self.step_of(value)] as usize;
        while count < self.borders.len() && is_before(self.borders[count]) {
            count += 1;
        }
        count
    }

    /// The larger a value, the later its step, however it is rounded: a border of an earlier step is smaller.
    #[inline(always)]
    fn step_of(&self, value: f32) -> usize {
        ((value * self.steps) as usize).min(STEPS - 1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_value_on_a_border_is_up_to_it_and_not_below() {
        let borders = Borders::new(vec![0.25, 0.5, 1.0]);
        assert_eq!([0.0, 0.25, 0.3, 0.5, 1.0, 7.0].map(|value| borders.up_to(value)), [0, 1, 1, 2, 3, 3]);
        assert_eq!([0.0, 0.25, 0.3, 0.5, 1.0, 7.0].map(|value| borders.below(value)), [0, 0, 1, 1, 2, 3]);
        let none = Borders::new(vec![]);
        assert_eq!((none.up_to(3.0), none.below(3.0)), (0, 0));
    }

    proptest! {
        #[test]
        fn borders_are_counted_as_one_by_one(
            mut borders in prop::collection::vec(prop_oneof![1e-40f32..1e-3, 0.01f32..1.0, 1.0f32..1e38], 0..40),
            values in prop::collection::vec(
                prop_oneof![Just(f32::INFINITY), Just(0.0), -90.0f32..0.0, 0.0f32..2.0, 0.0f32..f32::MAX], 1..40),
        ) {
            borders.sort_unstable_by(f32::total_cmp);
            borders.dedup();
            let ruler = Borders::new(borders.clone());
            for value in values.into_iter().chain(borders.iter().copied()) {
                prop_assert_eq!(ruler.up_to(value), borders.iter().filter(|&&border| border <= value).count());
                prop_assert_eq!(ruler.below(value), borders.iter().filter(|&&border| border < value).count());
            }
        }
    }
}
