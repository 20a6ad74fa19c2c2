//! Hands what arrives at a reader over, and counts what does not.

use std::collections::BTreeMap;
use std::sync::Arc;

use futures::{StreamExt, pin_mut};

use super::{
    Guid, Reliability, Sample,
    raw::RawReader,
    tally::{Counter, Tally},
};

/// Samples handed over before other readers get their turn.
const BURST: usize = 64;

/// What a reader did not hand over.
#[derive(Clone)]
pub(super) struct Losses {
    pub(super) refused: Arc<Counter>,
    pub(super) lost: Arc<Counter>,
    reliability: Reliability,
}

impl Losses {
    pub(super) fn new(tally: &Tally, topic: &str, reliability: Reliability) -> Self {
        let lost = match reliability {
            Reliability::Reliable => "samples lost",
            Reliability::BestEffort => "samples lost (best effort)",
        };
        Self { refused: tally.counter(topic, "samples refused"), lost: tally.counter(topic, lost), reliability }
    }

    fn lose(&self, topic: &str, writer: Guid, missing: u64) {
        if missing == 0 {
            return;
        }
        let lost = self.lost.add(missing);
        // Said when the count doubles, so that a stream of losses does not fill the log.
        let doubled = lost.checked_ilog2() != (lost - missing).checked_ilog2();
        if doubled && self.reliability == Reliability::Reliable {
            tracing::warn!(topic, %writer, lost, "samples were lost");
        }
    }
}

/// Finds gaps in the numbers that writers give their samples.
#[derive(Debug, Default)]
struct Numbers(BTreeMap<Guid, i64>);

impl Numbers {
    /// Writers that are remembered, also when they have left; when there are more, all others are forgotten.
    const WRITERS_MAX: usize = 256;

    /// How many samples of this writer are missing since its last one.
    fn missing(&mut self, writer: Guid, sequence: i64) -> u64 {
        let last = self.0.entry(writer).or_insert(sequence);
        let missing = u64::try_from(sequence.saturating_sub(*last).saturating_sub(1)).unwrap_or(0);
        *last = sequence.max(*last);
        if self.0.len() > Self::WRITERS_MAX {
            self.0.retain(|known, _| *known == writer);
        }
        missing
    }
}

/// Drains a reader that is nobody's subscription.
pub(super) async fn drain_into(raw: RawReader, deliver: impl FnMut(Sample) + Send + 'static) {
    let topic = Arc::from("ros_discovery_info");
    // Nodes announce themselves again whenever something changes, so a loss here does not last.
    let losses = Losses::new(&Tally::default(), "ros_discovery_info", Reliability::Reliable);
    drain(Arc::new(raw), topic, losses, deliver).await;
}

/// Hands every sample over as it comes.
pub(super) async fn drain(
    raw: Arc<RawReader>,
    topic: Arc<str>,
    losses: Losses,
    mut deliver: impl FnMut(Sample) + Send + 'static,
) {
    let samples = raw.as_async_stream();
    pin_mut!(samples);
    let mut numbers = Numbers::default();
    let mut run = 0;
    while let Some(sample) = samples.next().await {
        match sample {
            Ok(change) => {
                let sample = Sample::from_change(change);
                // Requests and replies go to one reader each, so that numbers are left out for the others.
                if topic.starts_with("rt/") {
                    losses.lose(&topic, sample.writer_guid, numbers.missing(sample.writer_guid, sample.sequence));
                }
                deliver(sample);
            }
            Err(error) => {
                let refused = losses.refused.add(1);
                tracing::warn!(%topic, refused, "sample refused: {error}");
            }
        }
        run += 1;
        if run % BURST == 0 {
            tokio::task::yield_now().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_for_each_writer_apart() {
        let mut numbers = Numbers::default();
        let (one, other) = (Guid([1; 16]), Guid([2; 16]));
        // Whoever comes late has lost nothing by it.
        assert_eq!([7, 8, 9].map(|sequence| numbers.missing(one, sequence)), [0, 0, 0]);
        assert_eq!([1, 3, 2, 4].map(|sequence| numbers.missing(other, sequence)), [0, 1, 0, 0]);
        assert_eq!(numbers.missing(one, 20), 10);
        assert_eq!(numbers.missing(one, i64::MIN), 0);
        assert_eq!(numbers.missing(Guid([3; 16]), i64::MAX), 0);
    }

    #[test]
    fn writers_that_come_and_go_are_forgotten() {
        let mut numbers = Numbers::default();
        for number in 0..10_000_u64 {
            let mut guid = [0; 16];
            guid[..8].copy_from_slice(&number.to_be_bytes());
            numbers.missing(Guid(guid), 1);
        }
        assert!(numbers.0.len() <= Numbers::WRITERS_MAX);
    }
}
