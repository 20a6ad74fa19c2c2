//! What happens at the feeding place.

use std::collections::VecDeque;
use std::time::Duration;

use super::super::choice::CandidateFrame;
use super::super::protocol::{Failure, Output, Warning};
use super::super::request::Stamp;
use super::super::tour::{Stop, Tour, best_tour};
use super::{DeliverySequencer, SequencerState, late, mean_s};

impl DeliverySequencer {
    /// Looks with nothing on the plateau after which it counts as empty.
    const EMPTY_LOOKS: u32 = 5;
    /// A slow waveform is waited for no longer than so many starvation times: the parts on the ramp are only believed to be
    /// there.
    const SLOW: f64 = 4.0;

    pub(super) fn idle(&mut self, now: Stamp) -> bool {
        let area = self.parking();
        let parked = self.leases.park(now, &area, &mut self.outputs);
        if self.queue.is_empty() {
            self.feed(false);
            return false;
        }
        match self.courier {
            Some(report) if parked && self.at_feeding_place(&report) => self.stop(now),
            Some(_) if parked => self.go_back(now),
            _ => false,
        }
    }

    pub(super) fn feeding(&mut self, now: Stamp, since: Stamp, starved: bool) -> bool {
        self.feed(true);
        let seen = self.frame.as_ref().map_or(since, |frame| frame.stamp.max(since));
        if late(now, seen, self.config.look_timeout_s) {
            return self.fail(now, Failure::NoImage);
        }
        let still = self.stands_still();
        if still && !self.still_told {
            self.outputs.push(Output::Warning(Warning::StandsStill));
        }
        self.still_told = still;
        if !starved && self.starves(now, since) {
            // Where the cause is known it has been told, by the selector where it is blind, and it is not that parts are needed.
            let is_blind = self.frame.as_ref().is_some_and(|frame| frame.is_blind);
            if self.feed_trouble().is_none() && !is_blind {
                self.outputs.push(Output::Warning(Warning::Starved(now.saturating_sub(since))));
            }
            return self.enter(SequencerState::Feeding { since, starved: true }, None);
        }
        let Some(frame) = self.frame.clone().filter(|frame| frame.stamp > since && self.fed_frame < Some(frame.stamp))
        else {
            return false;
        };
        self.fed_frame = Some(frame.stamp);
        let wanted: Vec<u64> =
            frame.candidates.iter().filter(|part| self.is_wanted(part)).map(|part| part.id).collect();
        self.drift.feed(&frame, |candidate| wanted.contains(&candidate.id));
        self.watch_feed(&frame);
        late(now, since, self.config.feed_s_min) && self.is_time_to_stop(now) && self.stop(now)
    }

    /// Whether no fitting part has come since feeding began, for the starvation time, and for as long as a slow waveform takes
    /// to bring one.
    fn starves(&self, now: Stamp, since: Stamp) -> bool {
        let starvation_s = self.config.starvation_s;
        late(now, since, starvation_s)
            && (!self.arrival_watch.is_too_soon() || late(now, since, Self::SLOW * starvation_s))
    }

    /// Whether the courier has been at rest for a while although it should feed.
    pub(super) fn stands_still(&self) -> bool {
        let (SequencerState::Feeding { since, .. } | SequencerState::Purging { since, .. }) = self.state else {
            return false;
        };
        let (Some(rest_since), Some(report)) = (self.rest_since, self.courier) else { return false };
        late(report.stamp, rest_since.max(since), Self::STILL_S)
    }

    /// Compares how the parts of a frame move with how they should, and how many come, and tells when that changes.
    fn watch_feed(&mut self, frame: &CandidateFrame) {
        let vibrates_for =
            |s: f64| self.vibrating_since.is_some_and(|since| frame.stamp >= since + Duration::from_secs_f64(s));
        let (begun, steady) = (vibrates_for(Self::BEGUN_S), vibrates_for(Self::STEADY_S));
        if begun {
            let is_told = self.arrival_watch.few().is_some();
            self.arrival_watch.see(frame);
            if let Some(share) = self.arrival_watch.few().filter(|_| !is_told) {
                self.outputs.push(Output::Warning(Warning::FewArrive { share }));
            }
        } else {
            self.arrival_watch.pause();
        }
        if !steady {
            return self.feed_watch.pause();
        }
        let is_told = self.feed_watch.off().is_some();
        self.feed_watch.see(frame);
        if let Some(ratio) = self.feed_watch.off().filter(|_| !is_told) {
            self.outputs.push(Output::Warning(Warning::FeedOff { ratio }));
        }
    }

    /// Whether it is time to go with the parts that would come to rest now: a trip with another would not be worth more, or none
    /// comes for long.
    fn is_time_to_stop(&self, now: Stamp) -> bool {
        let Some(frame) = &self.frame else { return false };
        let at_rest = self.drift.at_rest(frame, now);
        let best = best_tour(&at_rest, &self.offers(), &self.config, &self.planner, &self.overheads);
        let Some(tour) = best else { return false };
        let interval_s = self.drift.interval_s();
        let is_lost = |stop: &Stop| {
            let seen = frame.candidates.iter().find(|candidate| candidate.id == stop.choice.candidate.id);
            seen.is_none_or(|seen| self.drift.stays_s(seen) < interval_s + self.config.stop_drift_s)
        };
        let wanted = at_rest.candidates.iter().filter(|candidate| self.is_wanted(candidate)).count();
        tour.stops.len() >= self.queue.len().min(usize::try_from(self.config.stops_max).unwrap_or(1))
            || wanted > tour.stops.len()
            || tour.stops.iter().any(is_lost)
            || self.further_stop_s(&tour) >= tour.per_part_s(&self.overheads)
            || self.drift.is_lull()
    }

    /// What a further stop adds to a trip beside the feeding for its part, s: the way to the nearest station that waits, and a
    /// hand-over there.
    fn further_stop_s(&self, tour: &Tour) -> f64 {
        /// Way from one part to the next under the same tool, m.
        const PARTS_APART_M: f64 = 0.05;
        let is_served = |id| tour.stops.iter().any(|stop| stop.id == id);
        let served = || self.queue.iter().filter(|delivery| is_served(delivery.id));
        let waiting = self.queue.iter().filter(|delivery| !is_served(delivery.id));
        let ways_m = waiting.flat_map(|delivery| served().map(|other| (other.station_m - delivery.station_m).norm()));
        let way_m = ways_m.fold(f64::INFINITY, f64::min);
        self.planner.estimate_s(way_m.max(PARTS_APART_M)) + self.overheads.hand_over_s
    }

    pub(super) fn purging(
        &mut self,
        now: Stamp,
        since: Stamp,
        deadline: Stamp,
        empty: u32,
        seen: Option<Stamp>,
    ) -> bool {
        self.feed(true);
        if now >= deadline {
            let reason = match &self.frame {
                Some(frame) if frame.is_blind => "what lies on the plateau is not recognised".to_owned(),
                frame => {
                    let left = frame.as_ref().map_or(0, |frame| frame.candidates.len());
                    format!("{left} parts are still on the plateau")
                }
            };
            return self.end_purge(Err(reason));
        }
        let Some(frame) = self.frame.as_ref().filter(|frame| frame.stamp > since && seen < Some(frame.stamp)) else {
            return false;
        };
        let empty = if frame.candidates.is_empty() && !frame.is_blind { empty + 1 } else { 0 };
        self.state = SequencerState::Purging { since, deadline, empty, seen: Some(frame.stamp) };
        empty >= Self::EMPTY_LOOKS && self.end_purge(Ok(()))
    }

    pub(super) fn end_purge(&mut self, result: Result<(), String>) -> bool {
        self.outputs.push(Output::Purged(result));
        self.enter(SequencerState::Idle, None)
    }

    pub(super) fn stopping(&mut self, now: Stamp, since: Stamp) -> bool {
        let stopped = self.rest_since.is_some() && self.courier.is_some_and(|report| report.stamp >= since);
        if stopped {
            return self.enter(SequencerState::Settling, None);
        }
        late(now, since, self.config.stop_timeout_s) && self.fail(now, Failure::DidNotStop)
    }

    pub(super) fn settling(&mut self, now: Stamp) -> bool {
        match self.rest_since {
            None => self.stop(now),
            Some(rest_since) if now >= rest_since + self.config.settle() => {
                self.enter(SequencerState::Looking { since: now, rest_since, seen: None, looks: 0 }, None)
            }
            Some(_) => false,
        }
    }

    pub(super) fn looking(
        &mut self,
        now: Stamp,
        since: Stamp,
        rest_since: Stamp,
        seen: Option<Stamp>,
        looks: u32,
    ) -> bool {
        if self.rest_since != Some(rest_since) {
            return self.stop(now);
        }
        let settled = rest_since + self.config.settle();
        let fresh = self.frame.clone().filter(|frame| frame.stamp >= settled && seen < Some(frame.stamp));
        let Some(frame) = fresh else {
            return late(now, seen.unwrap_or(since), self.config.look_timeout_s) && self.fail(now, Failure::NoImage);
        };
        self.drift.rest(&frame);
        if let Some(slip) = self.slip_watch.arrive(&frame) {
            self.make_gentler(slip);
        }
        if let Some(stops) = self.choose() {
            if let Some(stopped) = self.stopped.take() {
                self.overheads.stop_s = mean_s(self.overheads.stop_s, stopped, now);
            }
            return self.depart(now, stops);
        }
        if looks + 1 >= self.config.looks {
            self.drift.start();
            self.passed_over.clear();
            self.arrival_watch.wait();
            return self.enter(SequencerState::Feeding { since: now, starved: false }, self.expected(now));
        }
        self.state = SequencerState::Looking { since, rest_since, seen: Some(frame.stamp), looks: looks + 1 };
        true
    }

    /// When the oldest request may be served if feeding begins now.
    fn expected(&self, now: Stamp) -> Option<Stamp> {
        let oldest = self.queue.front()?;
        let leg_s = self.planner.estimate_s((oldest.station_m - self.config.feeding_place.xy()).norm());
        let s = self.drift.interval_s().max(self.config.feed_s_min) + self.overheads.stop_s + leg_s;
        Some(now + Duration::from_secs_f64(s))
    }

    /// The stops of the next trip with the parts as they lie.
    fn choose(&self) -> Option<VecDeque<Stop>> {
        let mut frame = self.frame.clone()?;
        frame.candidates.retain(|part| !self.passed_over.contains(&part.id));
        let tour = best_tour(&frame, &self.offers(), &self.config, &self.planner, &self.overheads)?;
        Some(tour.stops.into())
    }

    /// Feeding off, and on to a look at the parts at rest.
    pub(super) fn stop(&mut self, now: Stamp) -> bool {
        if self.feed_on == Some(true) {
            self.drift.stop(now);
            self.feed_watch.pause();
            self.arrival_watch.pause();
        }
        self.feed(false);
        self.stopped = Some(now);
        let expected = self.queue.front().map(|_| now + Duration::from_secs_f64(self.overheads.stop_s));
        self.enter(SequencerState::Stopping { since: now }, expected)
    }
}
