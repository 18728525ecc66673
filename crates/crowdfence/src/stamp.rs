//! Stamps: nanoseconds since the Unix epoch, or since a simulation began. What is surely meant in another unit is
//! refused, because every age that follows from it would be wrong.

use crate::error::{Error, Result};

/// A unit that clocks also count in: what the stamps of this century look like in it, and how close together
/// two instants are then. A simulation's clock passes through the same numbers, but not in steps this small.
struct OtherUnit {
    name: &'static str,
    per_second: i64,
    nearest_ns: u64,
}

const OTHER_UNITS: [OtherUnit; 3] = [
    OtherUnit { name: "seconds", per_second: 1, nearest_ns: 1_000 },
    OtherUnit { name: "milliseconds", per_second: 1_000, nearest_ns: 10_000 },
    OtherUnit { name: "microseconds", per_second: 1_000_000, nearest_ns: 200_000 },
];

/// Seconds since the epoch from September 2001 to October 2096.
const THIS_CENTURY_S: std::ops::Range<i64> = 1_000_000_000..4_000_000_000;

/// Refuses a stamp that no clock gives.
pub(crate) fn check_stamp(stamp_ns: i64) -> Result<()> {
    if stamp_ns < 0 { Err(Error::NegativeStamp { stamp_ns }) } else { Ok(()) }
}

/// Refuses two different stamps of one clock that are nanoseconds in name only.
pub(crate) fn check_unit(before_ns: i64, stamp_ns: i64) -> Result<()> {
    let apart_ns = stamp_ns.abs_diff(before_ns);
    let unit = OTHER_UNITS.iter().find(|unit| {
        let looks_like_today = THIS_CENTURY_S.contains(&(stamp_ns / unit.per_second));
        looks_like_today && (1..unit.nearest_ns).contains(&apart_ns)
    });
    match unit {
        Some(unit) => Err(Error::StampUnit { before_ns, stamp_ns, apart_ns, unit: unit.name }),
        None => Ok(()),
    }
}

pub(crate) fn seconds_between(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_frames_of_today_in_a_smaller_unit_are_told_by_their_unit() {
        let now_s = 1_763_780_000;
        for (earlier, later, unit) in [
            (now_s, now_s + 1, "seconds"),
            (now_s * 1_000, now_s * 1_000 + 100, "milliseconds"),
            (now_s * 1_000_000, now_s * 1_000_000 + 100_000, "microseconds"),
        ] {
            let message = check_unit(earlier, later).unwrap_err().to_string();
            assert!(message.contains(&format!("look like {unit}")), "{message}");
        }
    }

    #[test]
    fn clocks_of_simulations_and_of_today_pass() {
        let now_ns = 1_763_780_000_000_000_000;
        check_unit(now_ns, now_ns + 1).unwrap();
        // 10 Hz from second 1, 1000 and 1,000,000 of a simulation on: the very numbers of the other units.
        for start_ns in [1_500_000_000, 1_763_780_000_000, 1_763_780_000_000_000] {
            check_unit(start_ns, start_ns + 100_000_000).unwrap();
        }
    }

    #[test]
    fn no_clock_runs_before_its_epoch() {
        check_stamp(0).unwrap();
        let message = check_stamp(-1).unwrap_err().to_string();
        assert_eq!(message, "stamp -1 ns is negative; stamps are nanoseconds since the Unix epoch");
    }
}
