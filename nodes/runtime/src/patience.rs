//! How long to wait for others: what every limit of wall time in a run is measured with.
//!
//! On a busy machine a node that is well says nothing for seconds, as it does not get to run, and a machine that stands
//! still silences everybody. So only that time counts in which the others could have run: of every stretch the share of
//! the machine that one thread could expect, and of a stretch in which the waiting thread itself did not run nearly
//! nothing. On an idle machine that is wall time.

use std::sync::OnceLock;
use std::time::Duration;

/// Stretches are no shorter than this: looking costs something.
const LOOK_MIN: Duration = Duration::from_millis(20);
/// What counts of a stretch at most. Whoever waits looks more often than this, when it gets to run.
const LOOK_MAX: Duration = Duration::from_millis(200);
/// With how much of the machine a thread can reckon at the least: even then a wait ends.
const SHARE_MIN: f64 = 0.05;

/// A wait, in times since some fixed moment.
#[derive(Debug, Clone, Copy, Default)]
pub struct Patience {
    since: Duration,
    looked_at: Duration,
    spent: Duration,
}

impl Patience {
    /// A wait that begins now.
    #[must_use]
    pub fn since(now: Duration) -> Self {
        Self { since: now, looked_at: now, spent: Duration::ZERO }
    }

    /// Wall time since the wait began.
    #[must_use]
    pub fn waited(&self, now: Duration) -> Duration {
        now.saturating_sub(self.since)
    }

    /// How much of the wait counts until `now`, where `share` tells the share of the machine that a thread can expect
    /// at present, 0 to 1. Whoever waits looks about every 100 ms.
    pub fn spent(&mut self, now: Duration, share: impl FnOnce() -> f64) -> Duration {
        let passed = now.saturating_sub(self.looked_at);
        if passed >= LOOK_MIN {
            self.looked_at = now;
            self.spent += passed.min(LOOK_MAX).mul_f64(share().clamp(SHARE_MIN, 1.0));
        }
        self.spent
    }
}

/// The share of a processor that a thread can expect at present: how many processors there are for each thread that
/// wants to run, 1 at most, and where the system does not tell.
#[must_use]
pub fn share_of_machine() -> f64 {
    static PROCESSORS: OnceLock<usize> = OnceLock::new();
    let processors = *PROCESSORS.get_or_init(|| std::thread::available_parallelism().map_or(1, usize::from));
    std::fs::read_to_string("/proc/loadavg").ok().and_then(|text| share(&text, processors)).unwrap_or(1.0)
}

/// The share, from Linux's `/proc/loadavg`, whose fourth field is how many threads want to run of how many there are.
fn share(loadavg: &str, processors: usize) -> Option<f64> {
    let running: u32 = loadavg.split_whitespace().nth(3)?.split('/').next()?.parse().ok()?;
    let processors = u32::try_from(processors).ok()?;
    Some((f64::from(processors) / f64::from(running.max(1))).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn on_an_idle_machine_wall_time_counts() {
        let mut patience = Patience::since(ms(500));
        for look in 1..=30 {
            let now = ms(500 + 100 * look);
            assert_eq!(patience.spent(now, || 1.0), ms(100 * look));
            assert_eq!(patience.waited(now), ms(100 * look));
        }
        assert_eq!(patience.spent(ms(3_510), || panic!("too early for a look")), ms(3_000));
    }

    #[test]
    fn on_a_busy_machine_a_share_counts_and_of_a_standstill_next_to_nothing() {
        let mut patience = Patience::default();
        assert_eq!(patience.spent(ms(100), || 0.1), ms(10));
        assert_eq!(patience.spent(ms(11_100), || 1.0), ms(210));
        assert_eq!(patience.spent(ms(11_200), || 0.0), ms(215), "no wait lasts for ever");
    }

    #[test]
    fn the_share_is_what_the_system_says() {
        let share = |text, processors| share(text, processors).unwrap();
        assert!((share("0.10 0.20 0.30 1/512 4711\n", 2) - 1.0).abs() < 1e-9);
        assert!((share("31.0 20.2 10.3 20/612 4711\n", 2) - 0.1).abs() < 1e-9);
        assert!((share("0.1 0.2 0.3 0/512 4711\n", 4) - 1.0).abs() < 1e-9);
        for bad in ["", "0.1 0.2 0.3", "0.1 0.2 0.3 x/2 1"] {
            assert_eq!(super::share(bad, 2), None);
        }
        let here = share_of_machine();
        assert!(here > 0.0 && here <= 1.0, "{here}");
    }
}
