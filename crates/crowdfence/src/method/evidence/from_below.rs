//! Which looks from below the top of a place say anything about it: what shows there is its side, and of what stands on
//! it at most the nearest.

/// What the looks from below that count speak for: that which is dangerous to overlook.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FromBelow {
    /// The class: it closes ground, as crowds do. That none shows clears nothing.
    For,
    /// Its absence: the class opens ground, as landing sites do. That a side looks like one opens nothing.
    Against,
}

impl FromBelow {
    /// As in configurations and reports.
    pub fn name(self) -> &'static str {
        match self {
            FromBelow::For => "for",
            FromBelow::Against => "against",
        }
    }

    /// Does a look from below with this log likelihood ratio count?
    pub(super) fn tells(self, log_ratio: f32) -> bool {
        match self {
            FromBelow::For => log_ratio > 0.0,
            FromBelow::Against => log_ratio < 0.0,
        }
    }
}
