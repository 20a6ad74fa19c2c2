//! What the sequencer is told: requests and reports.

use std::f64::consts::TAU;
use std::time::Duration;

use nalgebra::Vector2;

use super::super::choice::{CandidateFrame, courier_under};
use super::super::protocol::{CourierReport, Failure, HandOver, Output, Refusal, Warning};
use super::super::request::{DeliveryId, DeliveryRequest, LeaseAnswer, MoveId, ReserveId, Stamp};
use super::{Delivery, DeliverySequencer, SequencerState};

impl DeliverySequencer {
    /// Takes a request that came at `now`.
    ///
    /// # Errors
    /// A station that is unknown or out of reach, a tolerance that cannot be promised, or a planner that is in fault or
    /// suspended.
    pub fn request(&mut self, now: Stamp, request: DeliveryRequest) -> Result<DeliveryId, Refusal> {
        self.check_working()?;
        let Some(&station_m) = self.config.stations_m.get(&request.station) else {
            let known = self.config.stations_m.keys().cloned().collect();
            return Err(Refusal::UnknownStation { station: request.station, known });
        };
        let (tolerance_m, min_m) = (request.tolerance_m, self.config.tolerance_m_min);
        if !(tolerance_m.is_finite() && tolerance_m >= min_m) {
            return Err(Refusal::Tolerance { tolerance_m, min_m });
        }
        let beyond_m = self.planner.distance_to_reach_m(&station_m) - self.planner.tray().outer_radius_m;
        if beyond_m > 0.0 {
            return Err(Refusal::OutOfReach { station: request.station, beyond_m });
        }
        if !self.can_serve(&station_m) {
            return Err(Refusal::Blocked { station: request.station });
        }
        self.deliveries += 1;
        let id = DeliveryId(self.deliveries);
        let deadline = request.timeout.map(|timeout| now.saturating_add(timeout));
        self.queue.push_back(Delivery { id, request, station_m, deadline });
        Ok(id)
    }

    /// Whether some point of the plateau can be brought under a tool axis: the courier may stand there, and comes there.
    fn can_serve(&self, station_m: &Vector2<f64>) -> bool {
        const STEPS: u32 = 16;
        let tray = self.planner.tray();
        let (inner_m, outer_m) = (tray.inner_radius_m, tray.outer_radius_m);
        (0..=STEPS).any(|angle| {
            let angle_rad = tray.ramp_angle_rad + (TAU - tray.ramp_angle_rad) * f64::from(angle) / f64::from(STEPS);
            (0..=STEPS).any(|radius| {
                let radius_m = inner_m + (outer_m - inner_m) * f64::from(radius) / f64::from(STEPS);
                let point_m = Vector2::new(angle_rad.cos(), angle_rad.sin()) * radius_m;
                let stand = courier_under(station_m, &point_m, self.config.feeding_place.z);
                self.planner.check_way(&stand).is_ok()
            })
        })
    }

    /// Gives a request up. Says whether it was still open; one whose part has been taken is past that.
    pub fn cancel(&mut self, now: Stamp, id: DeliveryId) -> bool {
        self.give_up(now, id, Failure::Cancelled)
    }

    /// Takes the manipulator's report on the part presented to it.
    ///
    /// # Errors
    /// The delivery does not wait for such a report: first the part is taken or not, then the feeder is released.
    pub fn report_hand_over(&mut self, id: DeliveryId, report: HandOver) -> Result<(), Refusal> {
        let SequencerState::Presented { stops, taken, .. } = &self.state else { return Err(Refusal::NotPresented(id)) };
        let first_came = taken.is_some() || !self.hand_over.is_empty();
        let expected = first_came == (report == HandOver::Released);
        if !(expected && stops.front().is_some_and(|planned| planned.stop.id == id)) {
            return Err(Refusal::NotPresented(id));
        }
        self.hand_over.push_back(report);
        Ok(())
    }

    /// Feeds until the plateau is empty, at most for `timeout`; [`Output::Purged`] tells the end.
    ///
    /// # Errors
    /// Deliveries are open, the courier is not at rest at the feeding place, or the planner is in fault or suspended.
    pub fn purge(&mut self, now: Stamp, timeout: Duration) -> Result<(), Refusal> {
        self.check_free()?;
        let there = self.courier.is_some_and(|report| self.at_feeding_place(&report));
        if !(matches!(self.state, SequencerState::Idle) && there) {
            return Err(Refusal::NotIdle(self.phase()));
        }
        let deadline = now.saturating_add(timeout);
        self.enter(SequencerState::Purging { since: now, deadline, empty: 0, seen: None }, None);
        Ok(())
    }

    /// Whether nothing is under way, so that what is fed may change.
    ///
    /// # Errors
    /// Deliveries are open, or the planner is in fault or suspended.
    pub fn check_free(&self) -> Result<(), Refusal> {
        self.check_working()?;
        if self.queue.is_empty() { Ok(()) } else { Err(Refusal::Busy(self.queue.len())) }
    }

    /// Whether anything can be delivered.
    fn check_working(&self) -> Result<(), Refusal> {
        match &self.state {
            SequencerState::Fault { reason, .. } => Err(Refusal::Fault(reason.clone())),
            SequencerState::Suspended { reason } => Err(Refusal::Suspended(reason.clone())),
            _ => Ok(()),
        }
    }

    /// Takes what vision saw; a frame older than the last one is ignored.
    pub fn candidates(&mut self, frame: CandidateFrame) {
        if self.frame.as_ref().is_none_or(|last| frame.stamp > last.stamp) {
            self.frame = Some(frame);
        }
    }

    /// Takes the courier's state; a report older than the last one is ignored.
    pub fn courier(&mut self, report: CourierReport) {
        if self.courier.is_none_or(|last| report.stamp > last.stamp) {
            let at_rest = !report.moving && !report.vibrating;
            self.vibrating_since = report.vibrating.then(|| self.vibrating_since.unwrap_or(report.stamp));
            self.not_fed.take_if(|_| report.vibrating);
            self.rest_since = at_rest.then(|| self.rest_since.unwrap_or(report.stamp));
            self.courier = Some(report);
        }
    }

    /// Takes the courier's fault, or that it has none: with a courier that cannot move nothing can be delivered, and every
    /// open delivery ends at once. The fault is over when the courier's is.
    pub fn courier_fault(&mut self, fault: Option<&str>) {
        match (fault, &self.state) {
            (Some(_), SequencerState::Fault { .. }) => {}
            (Some(fault), _) => {
                self.feed(false);
                self.end_purge_for(fault);
                let reason = format!("the courier is in fault: {fault}");
                self.enter(SequencerState::Fault { reason, of_courier: true }, None);
            }
            (None, SequencerState::Fault { of_courier: true, .. }) => {
                self.enter(SequencerState::Idle, None);
            }
            (None, _) => {}
        }
    }

    /// Takes why nothing can be delivered although nothing is wrong, such as a courier driver that is not active, or that
    /// there is no such reason: what is under way ends at once, nothing new is taken, and it goes on by itself afterwards.
    pub fn suspend(&mut self, reason: Option<&str>) {
        match (reason, &self.state) {
            (Some(_), SequencerState::Fault { .. }) => {}
            (Some(reason), SequencerState::Suspended { .. }) => {
                self.state = SequencerState::Suspended { reason: reason.to_owned() };
            }
            (Some(reason), state) => {
                if let SequencerState::Moving { id, ended: false, .. }
                | SequencerState::Returning { id, ended: false, .. } = state
                {
                    self.outputs.push(Output::CancelMove(*id));
                }
                if self.feed_on == Some(true) {
                    self.feed(false);
                }
                self.end_purge_for(reason);
                self.enter(SequencerState::Suspended { reason: reason.to_owned() }, None);
            }
            (None, SequencerState::Suspended { .. }) => {
                self.enter(SequencerState::Idle, None);
            }
            (None, _) => {}
        }
    }

    /// Ends a purge under way, before it has emptied the plateau.
    fn end_purge_for(&mut self, reason: &str) {
        if matches!(self.state, SequencerState::Purging { .. }) {
            self.outputs.push(Output::Purged(Err(reason.to_owned())));
        }
    }

    /// Takes what the courier driver says against its own feeding, or that it says nothing.
    ///
    /// The same with other numbers is no news, nor when it comes and goes with the vibration.
    pub fn courier_warning(&mut self, now: Stamp, warning: Option<String>) {
        const QUIET: Duration = Duration::from_mins(1);
        if let Some(text) = &warning {
            let kind = text.chars().filter(|sign| !sign.is_ascii_digit()).collect();
            let told_until = self.courier_told.insert(kind, now + QUIET);
            if told_until.is_none_or(|until| now >= until) {
                self.outputs.push(Output::Warning(Warning::Courier(text.clone())));
            }
        }
        self.courier_warning = warning;
    }

    /// Takes the generator's refusal to switch feeding.
    pub fn feed_refused(&mut self, reason: String) {
        self.not_fed = Some(reason.clone());
        self.feed_refusal = Some(reason);
    }

    /// Takes the end of a move: reached, or the driver's reason why not.
    pub fn move_ended(&mut self, id: MoveId, result: Result<(), String>) {
        self.move_ended = Some((id, result));
    }

    /// Takes the arbiter's answer to a request for an area.
    pub fn area_answered(&mut self, id: ReserveId, answer: LeaseAnswer) {
        if let Some(reason) = self.leases.answered(id, answer, &mut self.outputs) {
            self.outputs.push(Output::Warning(Warning::NoParking(reason.clone())));
            let reason = Warning::NoParking(reason).to_string();
            self.enter(SequencerState::Fault { reason, of_courier: false }, None);
        }
    }

    /// Leaves the fault.
    pub fn reset(&mut self) {
        if matches!(self.state, SequencerState::Fault { .. }) {
            self.enter(SequencerState::Idle, None);
        }
    }
}
