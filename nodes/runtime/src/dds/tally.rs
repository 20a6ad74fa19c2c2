//! What endpoints have lost or refused, counted where it happens and reported by the node's `/diagnostics`.

use std::sync::{
    Arc, Mutex, PoisonError, Weak,
    atomic::{AtomicU64, Ordering},
};

/// A count that only grows.
#[derive(Debug)]
pub(crate) struct Counter {
    endpoint: Arc<str>,
    what: &'static str,
    count: AtomicU64,
}

impl Counter {
    /// Counts `more` and returns the sum.
    pub(crate) fn add(&self, more: u64) -> u64 {
        self.count.fetch_add(more, Ordering::Relaxed) + more
    }

    pub(crate) fn get(&self) -> u64 {
        self.count.load(Ordering::Relaxed)
    }
}

/// Something that happened to an endpoint's samples, and how often.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loss {
    /// DDS name of the topic, or name of the service.
    pub endpoint: Arc<str>,
    /// What happened.
    pub what: &'static str,
    /// How often.
    pub count: u64,
}

/// The counters of a participant's endpoints.
#[derive(Debug, Default)]
pub(super) struct Tally(Mutex<Vec<Weak<Counter>>>);

impl Tally {
    /// A counter for as long as its endpoint lives.
    pub(super) fn counter(&self, endpoint: &str, what: &'static str) -> Arc<Counter> {
        let counter = Arc::new(Counter { endpoint: endpoint.into(), what, count: AtomicU64::new(0) });
        let mut counters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        counters.retain(|counter| counter.strong_count() > 0);
        counters.push(Arc::downgrade(&counter));
        counter
    }

    /// Every count above zero.
    pub(super) fn losses(&self) -> Vec<Loss> {
        let counters = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let losses = counters.iter().filter_map(Weak::upgrade).map(|counter| Loss {
            endpoint: counter.endpoint.clone(),
            what: counter.what,
            count: counter.get(),
        });
        losses.filter(|loss| loss.count > 0).collect()
    }
}
