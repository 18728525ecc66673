//! Ways to damage a file, for the fuzz tests of the readers.

use proptest::prelude::*;
use proptest::sample::Index;

/// CROWDFENCE_FUZZ_CASES cases per property, or few.
pub fn config() -> ProptestConfig {
    let cases =
        std::env::var("CROWDFENCE_FUZZ_CASES").map_or(200, |cases| cases.parse().expect("a number of cases"));
    ProptestConfig { cases, failure_persistence: None, ..Default::default() }
}

#[derive(Debug, Clone)]
pub enum Mutation {
    FlipBit(Index, u8),
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Repeat(Index, usize),
    Truncate(Index),
}

impl Mutation {
    pub fn apply(&self, file: &mut Vec<u8>) {
        if file.is_empty() {
            return;
        }
        let range = |at: &Index, length: usize| {
            let start = at.index(file.len());
            start..file.len().min(start + length)
        };
        match self {
            Self::FlipBit(at, bit) => *at.get_mut(file) ^= 1 << (bit & 7),
            Self::Set(at, byte) => *at.get_mut(file) = *byte,
            Self::Insert(at, bytes) => drop(file.splice(range(at, 0), bytes.iter().copied())),
            Self::Remove(at, length) => drop(file.drain(range(at, *length))),
            Self::Repeat(at, length) => {
                let range = range(at, *length);
                let repeated = file[range.clone()].to_vec();
                file.splice(range.end..range.end, repeated);
            }
            Self::Truncate(at) => file.truncate(at.index(file.len())),
        }
    }
}

pub fn mutation() -> impl Strategy<Value = Mutation> {
    let telling_byte = prop_oneof![any::<u8>(), Just(0), Just(0xff), Just(b'\n'), b'0'..=b'9'];
    let (at, few, bytes) = (any::<Index>, 1..20_usize, prop::collection::vec(any::<u8>(), 1..20));
    prop_oneof![
        4 => (at(), any::<u8>()).prop_map(|(at, bit)| Mutation::FlipBit(at, bit)),
        4 => (at(), telling_byte).prop_map(|(at, byte)| Mutation::Set(at, byte)),
        1 => (at(), bytes).prop_map(|(at, bytes)| Mutation::Insert(at, bytes)),
        1 => (at(), few.clone()).prop_map(|(at, length)| Mutation::Remove(at, length)),
        1 => (at(), few).prop_map(|(at, length)| Mutation::Repeat(at, length)),
        1 => at().prop_map(Mutation::Truncate),
    ]
}
