//! How samples of a topic are delivered.

use std::fmt;

/// Whether lost samples are sent again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Reliability {
    /// Lost samples are sent again. A reader that asks for this matches reliable writers only.
    Reliable,
    /// A lost sample stays lost.
    BestEffort,
}

/// Whether a late reader gets what was published before it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Durability {
    /// No.
    Volatile,
    /// Yes, as long as the writer lives. A reader that asks for this matches such writers only.
    TransientLocal,
}

/// How samples of a topic are delivered. Made for a purpose, and changed field by field where needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Qos {
    /// Whether lost samples are sent again.
    pub reliability: Reliability,
    /// Whether late readers get earlier samples.
    pub durability: Durability,
    /// History depth in samples, as announced to peers.
    pub depth: u16,
    /// Samples that may wait at this end, never announced. In a reader, samples that have arrived
    /// and were not drained yet: more are lost. In a reliable writer, samples that some reader has not
    /// acknowledged: then publishing is refused. Memory is `backlog` times the size of a sample in a
    /// reader, and in a reliable writer up to four seconds' worth of what it published.
    pub backlog: u16,
    /// How long a sample is good for after it was published, seconds, as announced to peers, who drop older ones; `None`
    /// for ever.
    pub lifespan_s: Option<u16>,
}

/// Why a reader does not match a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum QosMismatch {
    /// The reader asks for lost samples to be sent again, the writer does not offer it.
    Reliability,
    /// The reader asks for earlier samples, the writer does not keep them.
    Durability,
}

impl fmt::Display for QosMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Reliability => "RELIABLE is asked for, BEST_EFFORT is offered",
            Self::Durability => "TRANSIENT_LOCAL is asked for, VOLATILE is offered",
        })
    }
}

impl Qos {
    /// Streams of which only the newest counts: raw images, ground truth, copies for onlookers.
    #[must_use]
    pub const fn sensor() -> Self {
        Self {
            reliability: Reliability::BestEffort,
            durability: Durability::Volatile,
            depth: 5,
            backlog: 8,
            lifespan_s: None,
        }
    }

    /// Ordinary topics: commands, states, detections, compressed images.
    #[must_use]
    pub const fn command() -> Self {
        Self {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            depth: 10,
            backlog: 256,
            lifespan_s: None,
        }
    }

    /// What is published rarely and holds until replaced: waveform, descriptions, fact sheets.
    /// A late reader gets up to `backlog` of the last values, oldest first: take the newest.
    #[must_use]
    pub const fn latched() -> Self {
        Self {
            reliability: Reliability::Reliable,
            durability: Durability::TransientLocal,
            depth: 1,
            backlog: 16,
            lifespan_s: None,
        }
    }

    /// Requests and replies of services, parameters included. A client that has crashed acknowledges nothing until it is
    /// known to be gone, which takes up to 20 s: replies to others must find room meanwhile.
    #[must_use]
    pub const fn service() -> Self {
        Self {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            depth: 10,
            backlog: 2_048,
            lifespan_s: None,
        }
    }

    /// Topics of the simulation loop, whose engine bounds what is in flight to less than `backlog`.
    #[must_use]
    pub const fn loop_edge() -> Self {
        Self {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            depth: 64,
            backlog: 256,
            lifespan_s: None,
        }
    }

    /// Checks that a writer that offers this matches a reader that asks for `reliability` and `durability`, by the rule
    /// of DDS: the offer is at least what is asked for.
    ///
    /// # Errors
    /// The first policy that differs.
    pub fn check_offer(self, reliability: Reliability, durability: Durability) -> Result<(), QosMismatch> {
        if self.reliability == Reliability::BestEffort && reliability == Reliability::Reliable {
            return Err(QosMismatch::Reliability);
        }
        if self.durability == Durability::Volatile && durability == Durability::TransientLocal {
            return Err(QosMismatch::Durability);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offer_must_be_at_least_what_is_asked_for() {
        let kinds = [
            (Reliability::BestEffort, Durability::Volatile),
            (Reliability::BestEffort, Durability::TransientLocal),
            (Reliability::Reliable, Durability::Volatile),
            (Reliability::Reliable, Durability::TransientLocal),
        ];
        let checked = kinds.map(|(reliability, durability)| {
            let offer = Qos { reliability, durability, ..Qos::command() };
            kinds.map(|(reliability, durability)| offer.check_offer(reliability, durability).err())
        });
        let (r, d) = (Some(QosMismatch::Reliability), Some(QosMismatch::Durability));
        assert_eq!(checked, [[None, d, r, r], [None, None, r, r], [None, d, None, d], [None, None, None, None]]);
    }

    #[test]
    fn depth_and_backlog_are_no_reason_to_refuse() {
        assert_eq!(Qos::command().check_offer(Qos::service().reliability, Qos::loop_edge().durability), Ok(()));
    }
}
