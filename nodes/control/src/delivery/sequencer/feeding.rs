//! What happens at the feeding place.

use std::collections::VecDeque;
use std::time::Duration;

use super::super::choice::{CandidateFrame, OfferedPart};
use super::super::lying::Lying;
use super::super::protocol::{Failure, Output, Warning};
use super::super::request::Stamp;
use super::super::tour::{Offer, Start, Stop, Tour, best_tour};
use super::{DeliverySequencer, SequencerState, late};

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
            self.begin_cycle(now);
            return false;
        }
        match self.courier {
            Some(report) if parked && self.at_feeding_place(&report) => {
                // What was left on the plateau is known: no look is needed to see that none of it will do.
                if self.nothing_lies_ready() { self.start_feeding(now) } else { self.stop(now) }
            }
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
            // Where the cause is known it has been told, and it is not that parts are needed.
            if self.feed_trouble().is_none() {
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

    /// Whether it is time to go: the trip with the parts that would come to rest now would lose one by waiting for another, or
    /// has a part for every request, or another part would cost more time, its wait and its stop, than each of these does.
    ///
    /// What the courier would wait for a manipulator costs nothing while it feeds.
    fn is_time_to_stop(&self, now: Stamp) -> bool {
        let Some(frame) = &self.frame else { return false };
        let overheads = self.pace.overheads();
        let at_rest = self.drift.at_rest(frame, now);
        let offers = self.offers(now, overheads.stop_s);
        let spent_s = now.saturating_sub(self.cycle_since).as_secs_f64() + overheads.stop_s;
        let start = Start { place_m: self.config.feeding_place.xy(), spent_s, taken: 0 };
        let (parts, look) = (&at_rest.candidates[..], at_rest.stamp);
        let offer = Offer { parts, look, leaves_soon: &|_| false, open: &offers };
        let best = best_tour(&offer, start, &self.config, &self.planner, overheads);
        let Some(tour) = best else { return false };
        let wait_s = self.drift.interval_s();
        let is_lost = |stop: &Stop| {
            let seen = frame.candidates.iter().find(|candidate| candidate.id == stop.choice.candidate.id);
            seen.is_none_or(|seen| self.drift.stays_s(seen) < wait_s + self.config.stop_drift_s)
        };
        let most = offers.len().min(usize::try_from(self.config.stops_max).unwrap_or(1));
        tour.stops.len() >= most
            || tour.stops.iter().any(is_lost)
            || self.another_costs_s(&tour, wait_s) >= tour.per_part_s(&start)
    }

    /// What one more part on a trip costs if it is waited for so long, s.
    fn another_costs_s(&self, tour: &Tour, wait_s: f64) -> f64 {
        /// Way from one stop to the next where there is none to go by, m.
        const WAY_M: f64 = 0.05;
        let overheads = self.pace.overheads();
        let apart = || tour.stops.len() > 1 && tour.stops[0].choice.courier != tour.stops[1].choice.courier;
        let leg_s = self.planner.estimate_s(if apart() { tour.way_m / (tour.stops.len() - 1) as f64 } else { WAY_M });
        (wait_s - tour.waits_s).max(0.0) + leg_s.max(overheads.busy_s) + overheads.hand_over_s
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
        self.lying = Some(Lying::seen(&frame));
        if let Some(stops) = self.choose(now) {
            if let Some(stopped) = self.stopped.take() {
                self.pace.departed(stopped, now);
            }
            return self.depart(now, stops);
        }
        let may_get_sure = |part: &OfferedPart| {
            part.refusals.pose_unsure || part.refusals.pose_disagrees || part.refusals.part_too_near
        };
        if looks + 1 >= self.config.looks || !frame.candidates.iter().any(may_get_sure) {
            return self.start_feeding(now);
        }
        self.state = SequencerState::Looking { since, rest_since, seen: Some(frame.stamp), looks: looks + 1 };
        true
    }

    /// Feeds until a trip is worth it.
    fn start_feeding(&mut self, now: Stamp) -> bool {
        self.drift.start();
        self.arrival_watch.wait();
        self.enter(SequencerState::Feeding { since: now, starved: false }, self.expected(now))
    }

    /// Whether the parts on the plateau are known, and none will do for any request.
    fn nothing_lies_ready(&self) -> bool {
        self.lying.as_ref().is_some_and(|lying| !lying.parts.iter().any(|part| self.is_wanted(part)))
    }

    /// When the oldest request may be served if feeding begins now.
    fn expected(&self, now: Stamp) -> Option<Stamp> {
        let oldest = self.queue.front()?;
        let leg_s = self.planner.estimate_s((oldest.station_m - self.config.feeding_place.xy()).norm());
        let s = self.drift.interval_s().max(self.config.feed_s_min) + self.pace.overheads().stop_s + leg_s;
        Some(now + Duration::from_secs_f64(s))
    }

    /// The stops of a trip from where the courier is, with the parts as they lie.
    pub(super) fn choose(&self, now: Stamp) -> Option<VecDeque<Stop>> {
        let (lying, report) = (self.lying.as_ref()?, self.courier?);
        let spent_s = now.saturating_sub(self.cycle_since).as_secs_f64();
        let start = Start { place_m: report.position.xy(), spent_s, taken: self.taken };
        let (overheads, soon_s) = (self.pace.overheads(), self.drift.interval_s() + self.config.feed_s_min);
        let leaves_soon = |part: &OfferedPart| self.drift.stays_s(part) < soon_s;
        let open = self.offers(now, 0.0);
        let offer = Offer { parts: &lying.parts, look: lying.look, leaves_soon: &leaves_soon, open: &open };
        let tour = best_tour(&offer, start, &self.config, &self.planner, overheads)?;
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
        let expected = self.queue.front().map(|_| now + Duration::from_secs_f64(self.pace.overheads().stop_s));
        self.enter(SequencerState::Stopping { since: now }, expected)
    }
}
