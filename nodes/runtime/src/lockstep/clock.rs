//! The clock's side of the loop: it grants ticks, paces, notices who is missing and ends the run. No I/O.

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

use minifactory_msgs::msg::{LoopGrant, LoopStatus};

use super::contract::{LoopContract, PATIENCE_S};
use crate::patience::Patience;

/// Time without any progress after which the user is told; in a run on one host it is ended then, as [`Patience`] counts it.
pub const STALL_LIMIT: Duration = Duration::from_secs(PATIENCE_S as u64);
/// Wall time without a word after which a node counts as silent. Live nodes report at least every 100 ms.
const SILENCE_LIMIT: Duration = Duration::from_millis(1500);

/// How fast simulated time may pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// As fast as the machine allows.
    Max,
    /// At most this many simulated seconds per wall second.
    Paced(f64),
}

/// Why a run ended early.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ClockError {
    /// Nodes did not appear or could not connect in time.
    #[error("the loop did not come up within {after:?}: {missing}")]
    NotWired {
        /// How long the clock waited.
        after: Duration,
        /// Who is absent or not wired.
        missing: String,
    },
    /// The loop stands still.
    #[error("no progress at tick {tick} for {stalled_for:?}: {culprits}")]
    Stalled {
        /// The tick the slowest node stands at.
        tick: u64,
        /// For how long.
        stalled_for: Duration,
        /// Who is silent, and what each live node waits for.
        culprits: String,
    },
    /// A node reported an error.
    #[error("{node} failed: {message}")]
    NodeFailed {
        /// The node.
        node: String,
        /// Its error.
        message: String,
    },
}

#[derive(Debug)]
struct NodeProgress {
    tick: u64,
    wired: bool,
    waiting_for: String,
    heard_at: Duration,
}

/// The state of the clock. Wall time arrives as the time since the clock was made.
#[derive(Debug)]
pub struct LoopClock {
    contract: LoopContract,
    speed: Speed,
    start_up_limit: Duration,
    nodes: BTreeMap<String, NodeProgress>,
    started_at: Option<Duration>,
    /// When and at which tick the present speed began.
    paced_from: (Duration, u64),
    /// While the run is paused: the tick up to which it may go all the same.
    paused_at: Option<u64>,
    granted_until: u64,
    end_tick: u64,
    slowest: u64,
    /// The wait for the next progress.
    patience: Patience,
}

impl LoopClock {
    /// A clock for `contract` that ends the run at `end_tick` at the latest.
    #[must_use]
    pub fn new(contract: LoopContract, speed: Speed, end_tick: u64, start_up_limit: Duration) -> Self {
        Self {
            contract,
            speed,
            start_up_limit,
            nodes: BTreeMap::new(),
            started_at: None,
            paced_from: (Duration::ZERO, 0),
            paused_at: None,
            granted_until: 0,
            end_tick,
            slowest: 0,
            patience: Patience::default(),
        }
    }

    /// The tick that every node has reached.
    #[must_use]
    pub fn tick(&self) -> u64 {
        self.slowest
    }

    /// When the first tick was granted, since the clock was made.
    #[must_use]
    pub fn started_at(&self) -> Option<Duration> {
        self.started_at
    }

    /// Whether every node has reached the end.
    #[must_use]
    pub fn finished(&self) -> bool {
        self.started_at.is_some() && self.slowest >= self.end_tick
    }

    /// Ends the run at the next tick that every node can reach.
    pub fn end_early(&mut self) {
        self.end_tick = self.end_tick.min(self.granted_until);
    }

    /// How fast simulated time may pass.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.speed
    }

    /// Changes the speed from now on. It changes no result.
    pub fn set_speed(&mut self, speed: Speed, now: Duration) {
        self.speed = speed;
        self.paced_from = (now, self.granted_until.saturating_sub(1));
    }

    /// Stops simulated time at the tick that is granted already, or lets it go on from there. It changes no result.
    pub fn set_paused(&mut self, paused: bool, now: Duration) {
        match (paused, self.paused_at) {
            (true, None) => self.paused_at = Some(self.granted_until),
            (false, Some(_)) => {
                self.paused_at = None;
                self.set_speed(self.speed, now);
            }
            (true, Some(_)) | (false, None) => {}
        }
    }

    /// Whether simulated time stands still.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.paused_at.is_some()
    }

    /// Lets a paused run go on for so many ticks. Says from which tick to which; nothing when it is not paused.
    pub fn step(&mut self, ticks: u64) -> Option<Range<u64>> {
        let paused_at = self.paused_at.as_mut()?;
        let from = *paused_at;
        *paused_at = from.saturating_add(ticks);
        Some(from..*paused_at)
    }

    /// Takes back what steps have still to go, as far as it is not granted.
    pub fn stop_stepping(&mut self) {
        if let Some(paused_at) = &mut self.paused_at {
            *paused_at = self.granted_until;
        }
    }

    /// The last grant, as it was sent.
    #[must_use]
    pub fn last_grant(&self) -> LoopGrant {
        LoopGrant {
            run_id: self.contract.run_id,
            until_tick: self.granted_until,
            end_tick: self.end_tick,
            ended: self.finished(),
        }
    }

    /// Takes in what a node says of itself; a status of another run, or of a node outside the loop, is ignored.
    ///
    /// # Errors
    /// [`ClockError::NodeFailed`] when the node reports an error.
    pub fn accept(&mut self, status: &LoopStatus, now: Duration) -> Result<(), ClockError> {
        if status.run_id != self.contract.run_id || self.contract.node_index(&status.node).is_none() {
            return Ok(());
        }
        if !status.error.is_empty() {
            return Err(ClockError::NodeFailed { node: status.node.clone(), message: status.error.clone() });
        }
        // No grant reaches beyond goal + window before this arrives, so every run of a seed ends at the same tick.
        if status.goal_tick != LoopStatus::NO_GOAL {
            self.end_tick = self.end_tick.min(status.goal_tick + self.contract.timing.window_ticks);
        }
        let seen = self.nodes.entry(status.node.clone()).or_insert_with(|| NodeProgress {
            tick: 0,
            wired: false,
            waiting_for: String::new(),
            heard_at: now,
        });
        seen.tick = seen.tick.max(status.tick);
        seen.wired |= status.wired;
        seen.waiting_for.clone_from(&status.waiting_for);
        seen.heard_at = now;
        let slowest = self.slowest_tick();
        if slowest > self.slowest {
            self.slowest = slowest;
            self.patience = Patience::since(now);
        }
        Ok(())
    }

    /// The grant to send now, if it differs enough from the last one or `renew` asks for it.
    pub fn grant(&mut self, now: Duration, renew: bool) -> Option<LoopGrant> {
        if self.started_at.is_none() {
            if !self.all_wired() {
                return None;
            }
            self.started_at = Some(now);
            self.paced_from = (now, 0);
            self.patience = Patience::since(now);
        }
        let window = self.contract.timing.window_ticks;
        let allowed = self.paused_at.unwrap_or_else(|| self.paced_tick(now));
        let until = (self.slowest + window).min(allowed).min(self.end_tick);
        let due = until > self.granted_until
            && (until >= self.granted_until + (window / 4).max(1)
                || until == self.end_tick
                || self.paused_at.is_some()
                || matches!(self.speed, Speed::Paced(_)));
        if !(due || renew) {
            return None;
        }
        if self.granted_until == self.slowest && until > self.granted_until {
            // Waiting for the pace is no stall.
            self.patience = Patience::since(now);
        }
        self.granted_until = self.granted_until.max(until);
        Some(self.last_grant())
    }

    /// Checks that the loop lives, as far as the machine lets it: `share` tells the share of it that a thread can
    /// expect at present. To be called about every 100 ms.
    ///
    /// # Errors
    /// [`ClockError::NotWired`] or [`ClockError::Stalled`], naming the nodes at fault.
    pub fn check(&mut self, now: Duration, share: impl FnOnce() -> f64) -> Result<(), ClockError> {
        let limit = if self.started_at.is_none() {
            self.start_up_limit
        } else {
            Duration::from_secs(self.contract.patience_s.into())
        };
        if self.rests() || self.patience.spent(now, share) < limit {
            return Ok(());
        }
        let waited = self.patience.waited(now);
        if self.started_at.is_none() {
            return Err(ClockError::NotWired { after: waited, missing: self.missing(now) });
        }
        Err(ClockError::Stalled { tick: self.slowest, stalled_for: waited, culprits: self.culprits(now) })
    }

    /// Whom the loop waits for, and for how long already, where that is longer than a machine with time to spare takes.
    #[must_use]
    pub fn delay(&self, now: Duration) -> Option<(Duration, String)> {
        let waited = self.patience.waited(now);
        if self.rests() {
            return None;
        }
        match self.started_at {
            None => (waited >= self.start_up_limit).then(|| (waited, self.missing(now))),
            Some(_) => (waited >= STALL_LIMIT).then(|| (waited, self.culprits(now))),
        }
    }

    /// Whether nobody owes a tick.
    fn rests(&self) -> bool {
        self.started_at.is_some() && (self.finished() || self.granted_until == self.slowest)
    }

    fn slowest_tick(&self) -> u64 {
        if self.nodes.len() < self.contract.nodes.len() {
            return 0;
        }
        self.nodes.values().map(|seen| seen.tick).min().unwrap_or(0)
    }

    fn all_wired(&self) -> bool {
        self.nodes.len() == self.contract.nodes.len() && self.nodes.values().all(|seen| seen.wired)
    }

    /// The tick that wall time allows.
    fn paced_tick(&self, now: Duration) -> u64 {
        let Speed::Paced(speed) = self.speed else { return u64::MAX };
        let (since, from_tick) = self.paced_from;
        let elapsed_s = now.saturating_sub(since).as_secs_f64();
        let tick_s = Duration::from_nanos(self.contract.timing.tick_ns).as_secs_f64();
        let ticks = elapsed_s * speed / tick_s;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, and is never negative")]
        let whole = ticks as u64;
        from_tick.saturating_add(whole).saturating_add(1)
    }

    fn missing(&self, now: Duration) -> String {
        let mut missing = Vec::new();
        for node in &self.contract.nodes {
            match self.nodes.get(node) {
                None => missing.push(format!("{node} was never heard")),
                Some(seen) if now.saturating_sub(seen.heard_at) > SILENCE_LIMIT => {
                    missing.push(format!("{node} has gone silent"));
                }
                Some(seen) if !seen.wired => missing.push(format!("{node} is up but waits for {}", seen.waiting_for)),
                Some(_) => {}
            }
        }
        missing.join(", ")
    }

    /// Who is silent, or when nobody is, what each node waits for. A machine that stands still silences all nodes for a
    /// while; the one that has stopped the loop has been silent for longest.
    fn culprits(&self, now: Duration) -> String {
        let silent_for = |seen: &NodeProgress| now.saturating_sub(seen.heard_at);
        let longest = self.nodes.values().map(silent_for).max().unwrap_or_default();
        let limit = SILENCE_LIMIT.max(longest * 3 / 4);
        let silent: Vec<String> = self
            .nodes
            .iter()
            .filter(|(_, seen)| silent_for(seen) > limit)
            .map(|(node, seen)| format!("{node} has been silent for {:.1} s", silent_for(seen).as_secs_f64()))
            .collect();
        if !silent.is_empty() {
            return silent.join(", ");
        }
        let waiting: Vec<String> =
            self.nodes.iter().map(|(node, seen)| format!("{node} waits for {}", seen.waiting_for)).collect();
        waiting.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::LoopTiming;

    fn clock(speed: Speed) -> LoopClock {
        let timing =
            LoopTiming { tick_ns: 10_000_000, forward_delay_ticks: 1, feedback_delay_ticks: 10, window_ticks: 32 };
        let contract = LoopContract {
            run_id: 7,
            timing,
            nodes: vec!["a".into(), "b".into()],
            edges: Vec::new(),
            shared_topics: Vec::new(),
            patience_s: PATIENCE_S,
        };
        LoopClock::new(contract, speed, 1000, Duration::from_secs(10))
    }

    fn status(node: &str, tick: u64) -> LoopStatus {
        LoopStatus {
            run_id: 7,
            node: node.into(),
            tick,
            wired: true,
            goal_tick: LoopStatus::NO_GOAL,
            ..Default::default()
        }
    }

    /// Looks every 100 ms from the last progress until `until`, on an idle machine.
    fn check(clock: &mut LoopClock, until: Duration) -> Result<(), ClockError> {
        check_with(clock, until, 1.0)
    }

    fn check_with(clock: &mut LoopClock, until: Duration, share: f64) -> Result<(), ClockError> {
        let mut now = until.saturating_sub(clock.patience.waited(until));
        while now < until {
            now = (now + ms(100)).min(until);
            if now == until {
                break;
            }
            clock.check(now, || share)?;
        }
        clock.check(until, || share)
    }

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn nothing_is_granted_before_every_node_is_wired() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(1)).unwrap();
        assert_eq!(clock.grant(ms(2), true), None);
        clock.accept(&status("b", 0), ms(3)).unwrap();
        assert_eq!(clock.grant(ms(4), false).unwrap().until_tick, 32);
    }

    #[test]
    fn grants_follow_the_slowest_node() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(0)).unwrap();
        clock.accept(&status("b", 0), ms(0)).unwrap();
        clock.grant(ms(0), false).unwrap();
        clock.accept(&status("a", 30), ms(1)).unwrap();
        assert_eq!(clock.grant(ms(1), false), None);
        clock.accept(&status("b", 8), ms(2)).unwrap();
        assert_eq!(clock.grant(ms(2), false).unwrap().until_tick, 40);
    }

    #[test]
    fn pacing_holds_back_and_is_no_stall() {
        let mut clock = clock(Speed::Paced(1.0));
        clock.accept(&status("a", 0), ms(0)).unwrap();
        clock.accept(&status("b", 0), ms(0)).unwrap();
        assert_eq!(clock.grant(ms(0), false).unwrap().until_tick, 1);
        clock.accept(&status("a", 1), ms(1)).unwrap();
        clock.accept(&status("b", 1), ms(1)).unwrap();
        assert_eq!(clock.grant(ms(5), false), None);
        assert_eq!(clock.grant(ms(25), false).unwrap().until_tick, 3);
        assert_eq!(check(&mut clock, ms(25)), Ok(()));
    }

    #[test]
    fn another_speed_holds_from_where_the_run_is() {
        let mut clock = clock(Speed::Paced(1.0));
        let reach = |clock: &mut LoopClock, tick, now| {
            for node in ["a", "b"] {
                clock.accept(&status(node, tick), now).unwrap();
            }
        };
        reach(&mut clock, 0, ms(0));
        assert_eq!(clock.grant(ms(0), false).unwrap().until_tick, 1);
        reach(&mut clock, 1, ms(1));
        assert_eq!(clock.grant(ms(95), false).unwrap().until_tick, 10);
        reach(&mut clock, 10, ms(96));
        clock.set_speed(Speed::Paced(0.5), ms(100));
        assert_eq!(clock.grant(ms(115), false), None);
        assert_eq!(clock.grant(ms(145), false).unwrap().until_tick, 12);
        clock.set_speed(Speed::Max, ms(150));
        assert_eq!(clock.grant(ms(150), false).unwrap().until_tick, 42);
        reach(&mut clock, 42, ms(160));
        clock.set_speed(Speed::Paced(1.0), ms(200));
        assert_eq!(clock.grant(ms(225), false).unwrap().until_tick, 44);
    }

    #[test]
    fn a_paused_run_goes_on_step_by_step_and_is_no_stall() {
        let mut clock = clock(Speed::Max);
        let reach = |clock: &mut LoopClock, tick, now| {
            for node in ["a", "b"] {
                clock.accept(&status(node, tick), now).unwrap();
            }
        };
        reach(&mut clock, 0, ms(0));
        assert_eq!(clock.step(1), None, "a run that is not paused takes no steps");
        assert_eq!(clock.grant(ms(0), false).unwrap().until_tick, 32);
        clock.set_paused(true, ms(1));
        clock.set_paused(true, ms(2));
        reach(&mut clock, 32, ms(3));
        assert_eq!(clock.grant(ms(60_000), false), None);
        assert_eq!(check(&mut clock, ms(60_000)), Ok(()));
        assert_eq!(clock.step(2), Some(32..34));
        assert_eq!(clock.grant(ms(60_000), false).unwrap().until_tick, 34);
        assert_eq!(clock.grant(ms(60_001), false), None);
        reach(&mut clock, 34, ms(60_002));
        assert_eq!(clock.step(100), Some(34..134), "more than the window takes some grants");
        assert_eq!(clock.grant(ms(60_003), false).unwrap().until_tick, 66);
        reach(&mut clock, 66, ms(60_004));
        assert_eq!(clock.grant(ms(60_005), false).unwrap().until_tick, 98);
        reach(&mut clock, 98, ms(60_006));
        assert_eq!(clock.grant(ms(60_007), false).unwrap().until_tick, 130);
        reach(&mut clock, 130, ms(60_008));
        assert_eq!(clock.grant(ms(60_009), false).unwrap().until_tick, 134);
        reach(&mut clock, 134, ms(60_010));
        clock.step(1000);
        assert_eq!(clock.grant(ms(60_010), false).unwrap().until_tick, 166);
        clock.stop_stepping();
        reach(&mut clock, 166, ms(60_010));
        assert_eq!(clock.grant(ms(60_011), false), None, "steps that are taken back");
        clock.set_speed(Speed::Paced(1.0), ms(60_011));
        assert_eq!(clock.grant(ms(70_000), false), None, "another speed does not end the pause");
        clock.set_paused(false, ms(80_000));
        assert_eq!(clock.grant(ms(80_015), false).unwrap().until_tick, 167);
        assert_eq!(check(&mut clock, ms(80_015)), Ok(()));
    }

    #[test]
    fn a_silent_node_is_named() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(0)).unwrap();
        clock.accept(&status("b", 0), ms(0)).unwrap();
        clock.grant(ms(0), false).unwrap();
        clock.accept(&status("a", 11), ms(2900)).unwrap();
        let error = check(&mut clock, ms(3100)).unwrap_err();
        assert!(error.to_string().contains("b has been silent"), "{error}");
        assert!(!error.to_string().contains("a has been silent"), "{error}");
    }

    #[test]
    fn regress_a_machine_that_stood_still_leaves_the_others_above_suspicion() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(0)).unwrap();
        clock.accept(&status("b", 0), ms(0)).unwrap();
        clock.grant(ms(0), false).unwrap();
        clock.accept(&status("a", 11), ms(2200)).unwrap();
        check(&mut clock, ms(2900)).unwrap();
        let error = clock.check(ms(4100), || 1.0).unwrap_err().to_string();
        assert!(error.contains("b has been silent for 4.1 s"), "{error}");
        assert!(!error.contains("a has been silent"), "{error}");
    }

    #[test]
    fn a_busy_machine_gets_more_time_and_says_whom_it_waits_for() {
        let mut clock = clock(Speed::Max);
        assert_eq!(check_with(&mut clock, ms(60_000), 0.1), Ok(()), "coming up takes longer too");
        let (_, missing) = clock.delay(ms(60_000)).unwrap();
        assert!(missing.contains("a was never heard"), "{missing}");
        clock.accept(&status("a", 0), ms(60_000)).unwrap();
        clock.accept(&status("b", 0), ms(60_000)).unwrap();
        clock.grant(ms(60_000), false).unwrap();
        clock.accept(&status("a", 11), ms(62_000)).unwrap();
        assert_eq!(clock.delay(ms(62_000)), None);
        assert_eq!(check_with(&mut clock, ms(85_000), 0.1), Ok(()));
        let (waited, whom) = clock.delay(ms(85_000)).unwrap();
        assert_eq!(waited, ms(25_000));
        assert!(whom.contains("b has been silent"), "{whom}");
        assert!(check_with(&mut clock, ms(95_000), 0.1).is_err(), "not for ever");
        clock.accept(&status("b", 11), ms(95_000)).unwrap();
        assert_eq!(clock.delay(ms(97_000)), None);
    }

    #[test]
    fn a_missing_node_is_named_after_the_start_up_limit() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(9900)).unwrap();
        let error = check(&mut clock, ms(10_000)).unwrap_err();
        assert!(error.to_string().contains("b was never heard"), "{error}");
    }

    #[test]
    fn a_goal_ends_the_run_one_window_later() {
        let mut clock = clock(Speed::Max);
        clock.accept(&status("a", 0), ms(0)).unwrap();
        clock.accept(&status("b", 0), ms(0)).unwrap();
        clock.grant(ms(0), false).unwrap();
        clock.accept(&LoopStatus { goal_tick: 20, ..status("a", 21) }, ms(1)).unwrap();
        clock.accept(&status("b", 32), ms(1)).unwrap();
        let grant = clock.grant(ms(1), false).unwrap();
        assert_eq!((grant.until_tick, grant.end_tick), (52, 52));
        clock.accept(&status("a", 52), ms(2)).unwrap();
        clock.accept(&status("b", 52), ms(2)).unwrap();
        assert!(clock.grant(ms(2), true).unwrap().ended);
    }

    #[test]
    fn statuses_of_other_runs_are_ignored() {
        let mut clock = clock(Speed::Max);
        clock.accept(&LoopStatus { run_id: 8, error: "boom".into(), ..status("a", 5) }, ms(0)).unwrap();
        assert!(check(&mut clock, ms(10_000)).unwrap_err().to_string().contains("a was never heard"));
    }
}
