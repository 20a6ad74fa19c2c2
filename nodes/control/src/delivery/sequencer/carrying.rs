//! What happens on a trip: reserving its area, moving, presenting, returning.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Rotation2, Vector2, Vector3};

use super::super::choice::{OfferedPart, protected_parts};
use super::super::leases::Trip;
use super::super::plan::MovePlan;
use super::super::plan_error::PlanError;
use super::super::protocol::{Delivered, Failure, HandOver, Output, Warning};
use super::super::request::{DeliveryId, MoveId, Stamp};
use super::super::slip_watch::Slip;
use super::super::tour::Stop;
use super::{DeliverySequencer, Planned, SequencerState, late, mean_s};
use crate::platen::{Area, segment_distance_m};
use feeder_model::part::Refusals;

/// Corners of the way of a move, platen frame, m.
type Route = Vec<Vector2<f64>>;

impl DeliverySequencer {
    /// Friction that moves reckon with after parts have slid, over that before.
    const GENTLER: f64 = 0.9;
    /// The least, over that which was believed at first.
    const LEAST_FRICTION: f64 = 0.5;

    /// Asks for the area of a trip, and goes when it is granted.
    pub(super) fn depart(&mut self, now: Stamp, stops: VecDeque<Stop>) -> bool {
        self.slip_watch.depart(self.frame.as_ref().map_or(&[], |frame| &frame.candidates));
        let stands: Vec<Vector3<f64>> = stops.iter().map(|stop| stop.choice.courier).collect();
        let count = stops.len() as f64;
        let (routes, moves_s) = match self.routes(&stands) {
            Ok(routes) => routes,
            Err(error) => {
                let planned = stops.into_iter().map(|stop| Planned { stop, route_m: Vec::new() });
                self.state = SequencerState::Reserving { stops: planned.collect() };
                return self.fail(now, Failure::Plan(error));
            }
        };
        self.ask(&routes, moves_s + 2.0 * self.config.hand_over_timeout_s * count);
        let planned = stops.into_iter().zip(routes).map(|(stop, route_m)| Planned { stop, route_m });
        let planned: VecDeque<Planned> = planned.collect();
        if self.leases.trip() == Trip::Granted {
            return self.next_stop(now, planned);
        }
        self.enter(SequencerState::Reserving { stops: planned }, None)
    }

    /// The ways from where the courier is over these places to the feeding place, and how long the moves take at most, s.
    fn routes(&self, stands: &[Vector3<f64>]) -> Result<(Vec<Route>, f64), PlanError> {
        let home = self.config.feeding_place;
        let mut here = self.courier.map_or(home, |report| report.position);
        let (mut routes, mut moves_s) = (Vec::new(), 0.0);
        for stand in stands.iter().chain([&home]) {
            match self.planner.plan(here, *stand, &self.protected(&[])) {
                Ok(plan) => {
                    routes.push(plan.route_m);
                    moves_s += plan.duration_s + self.config.move_grace_s;
                }
                Err(PlanError::NoDistance { .. }) => routes.push(vec![here.xy(), stand.xy()]),
                Err(error) => return Err(error),
            }
            here = *stand;
        }
        Ok((routes, moves_s))
    }

    /// Asks for the area of a trip along these ways for so long.
    fn ask(&mut self, routes: &[Route], needed_s: f64) {
        let first = routes.first().and_then(|route_m| route_m.first()).copied();
        self.trip_m =
            first.into_iter().chain(routes.iter().flat_map(|route_m| route_m.iter().skip(1).copied())).collect();
        // Straight out and back there are no corners to cut.
        let corner_m = if self.trip_m.len() > 3 { self.config.corner_m } else { 0.0 };
        let radius_m = self.config.footprint_radius_m + corner_m + Self::TRACKING_M;
        let area = Area { points_m: self.trip_m.clone(), radius_m };
        let duration = Duration::from_secs_f64(needed_s + self.config.move_grace_s);
        let wait = Duration::from_secs_f64(self.config.area_wait_s);
        self.leases.ask(area, duration, wait, &mut self.outputs);
    }

    /// The way home from anywhere on the trip's way: on or back along it, whichever is shorter. Back is no way home for a
    /// trip that began elsewhere.
    fn way_home_m(&self, here_m: Vector2<f64>) -> Vec<Vector2<f64>> {
        let off_m = |pair: &[Vector2<f64>]| segment_distance_m((pair[0], pair[1]), (here_m, here_m));
        let pieces = self.trip_m.windows(2).map(off_m).enumerate();
        let home_m = self.config.feeding_place.xy();
        let is_off = |point: &Vector2<f64>, place: &Vector2<f64>| (point - place).norm() > Self::ARRIVED_M;
        let began_at_home = self.trip_m.first().is_some_and(|first| (first - home_m).norm() <= 2.0 * Self::ARRIVED_M);
        let nearest = pieces.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(index, _)| index);
        let back = self.trip_m[..=nearest.min(self.trip_m.len().saturating_sub(1))].iter().rev();
        let on = self.trip_m.iter().skip(nearest + 1);
        let way = |rest: &mut dyn Iterator<Item = &Vector2<f64>>| {
            let mut way_m = vec![here_m];
            // Corners that the courier stands on already, or that are home, are no legs.
            rest.for_each(|point| {
                if is_off(point, &home_m) && way_m.last().is_some_and(|last| is_off(point, last)) {
                    way_m.push(*point);
                }
            });
            way_m.push(home_m);
            way_m
        };
        let (back_m, on_m) = (way(&mut back.into_iter()), way(&mut on.into_iter()));
        let length_m = |way_m: &[Vector2<f64>]| way_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>();
        if began_at_home && length_m(&back_m) < length_m(&on_m) { back_m } else { on_m }
    }

    fn protected(&self, selected: &[&OfferedPart]) -> Vec<Vector2<f64>> {
        protected_parts(&self.config, &self.planner, selected, self.frame.as_ref())
    }

    pub(super) fn reserving(&mut self, now: Stamp, stops: VecDeque<Planned>) -> bool {
        match self.leases.trip() {
            Trip::Open => false,
            Trip::Granted => self.next_stop(now, stops),
            Trip::Refused(reason) => self.fail(now, Failure::Area(reason)),
        }
    }

    /// Moves to the first of these stops whose delivery is still open, past those where it is not; back when there is
    /// none.
    pub(super) fn next_stop(&mut self, now: Stamp, mut stops: VecDeque<Planned>) -> bool {
        let Some(report) = self.courier else { return self.go_back(now) };
        let mut route_m = vec![report.position.xy()];
        while let Some(planned) = stops.front() {
            route_m.extend(planned.route_m.iter().skip(1));
            if self.delivery(planned.stop.id).is_some() {
                break;
            }
            stops.pop_front();
        }
        let Some(planned) = stops.front() else { return self.go_back(now) };
        let parts: Vec<&OfferedPart> = stops.iter().map(|planned| &planned.stop.choice.candidate).collect();
        let stand = planned.stop.choice.courier;
        match self.planner.plan_along(report.position, stand, route_m, &self.protected(&parts)) {
            Ok(plan) => {
                let (id, arrival, deadline) = self.begin(now, &plan);
                self.enter(SequencerState::Moving { stops, id, deadline, ended: false }, Some(arrival));
                self.outputs.push(Output::Move(id, plan));
                true
            }
            Err(PlanError::NoDistance { .. }) => {
                let id = self.next_move();
                self.enter(SequencerState::Moving { stops, id, deadline: now, ended: true }, Some(now))
            }
            Err(error) => {
                self.state = SequencerState::Checking { stops, since: now, seen: None };
                self.fail(now, Failure::Plan(error))
            }
        }
    }

    /// A new move's name, when it will arrive, and until when it must have.
    fn begin(&mut self, now: Stamp, plan: &MovePlan) -> (MoveId, Stamp, Stamp) {
        let arrival = now + Duration::from_secs_f64(plan.duration_s);
        (self.next_move(), arrival, arrival + Duration::from_secs_f64(self.config.move_grace_s))
    }

    pub(super) fn moving(
        &mut self,
        now: Stamp,
        stops: VecDeque<Planned>,
        id: MoveId,
        deadline: Stamp,
        ended: bool,
    ) -> bool {
        let ended = match self.move_ended.take_if(|(ended, _)| *ended == id) {
            Some((_, Err(reason))) => return self.fail(now, Failure::Move(reason)),
            Some((_, Ok(()))) => true,
            None => ended,
        };
        let Some(stop) = stops.front().map(|planned| &planned.stop) else { return self.go_back(now) };
        let offset_m = self.offset_m(stop.id, &stop.choice.candidate.position_in_tray_m);
        let tolerance_m = self.delivery(stop.id).map_or(0.0, |delivery| delivery.request.tolerance_m);
        if ended && self.rest_since.is_some() && offset_m.is_some_and(|offset_m| offset_m.norm() <= tolerance_m) {
            let station = self.delivery(stop.id).map(|delivery| &delivery.request.station);
            if station.is_some_and(|station| self.config.rechecked_stations.contains(station)) {
                return self.enter(SequencerState::Checking { stops, since: now, seen: None }, Some(now));
            }
            return self.present(now, stops);
        }
        self.state = SequencerState::Moving { stops, id, deadline, ended };
        now >= deadline && self.fail(now, Failure::DidNotArrive)
    }

    /// Where a point of the tray is relative to the tool axis of a delivery's station, m, along the platen's axes.
    fn offset_m(&self, id: DeliveryId, point_in_tray_m: &Vector2<f64>) -> Option<Vector2<f64>> {
        let (delivery, report) = (self.delivery(id)?, self.courier?);
        Some(report.position.xy() + Rotation2::new(report.position.z) * point_in_tray_m - delivery.station_m)
    }

    /// Looks at the part again where a camera sees the station: at one image, or as long as that shows the part as chosen but
    /// the images so far do not yet make its pose sure.
    pub(super) fn checking(
        &mut self,
        now: Stamp,
        mut stops: VecDeque<Planned>,
        since: Stamp,
        seen: Option<Stamp>,
    ) -> bool {
        /// One image in which a pose does not show is outweighed by those of some tenths of a second.
        const UNSURE_S_MAX: f64 = 1.0;
        let Some(stop) = stops.front_mut().map(|planned| &mut planned.stop) else { return self.go_back(now) };
        let rest = self.rest_since.map(|rest| rest.max(since));
        let fresh = self.frame.as_ref().filter(|frame| rest.is_some_and(|rest| frame.stamp >= rest));
        let Some(frame) = fresh.filter(|frame| seen < Some(frame.stamp)) else {
            return late(now, seen.unwrap_or(since), self.config.look_timeout_s) && self.fail(now, Failure::NoImage);
        };
        let Some(delivery) = self.delivery(stop.id) else { return self.go_back(now) };
        let chosen = &stop.choice.candidate;
        let distance_m = |part: &OfferedPart| (part.position_in_tray_m - chosen.position_in_tray_m).norm();
        let nearest = frame.candidates.iter().min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
        let lost = match nearest {
            Some(part) if distance_m(part) <= delivery.request.tolerance_m => {
                if is_merely_unsure(part, chosen) && !late(now, since, UNSURE_S_MAX) {
                    let seen = Some(frame.stamp);
                    self.state = SequencerState::Checking { stops, since, seen };
                    return false;
                }
                why_not(part, chosen)
            }
            Some(part) => Some(format!("the nearest part lies {:.2} mm from its place", distance_m(part) * 1e3)),
            None => Some("no part is seen at its place".to_owned()),
        };
        if let Some(reason) = lost {
            self.passed_over.insert(chosen.id);
            return self.fail(now, Failure::PartLost(reason));
        }
        if let Some(part) = nearest {
            stop.choice.candidate.position_in_tray_m = part.position_in_tray_m;
            stop.choice.candidate.yaw_in_tray_rad = part.yaw_in_tray_rad;
        }
        self.present(now, stops)
    }

    fn present(&mut self, now: Stamp, stops: VecDeque<Planned>) -> bool {
        let (Some(stop), Some(report)) = (stops.front().map(|planned| &planned.stop), self.courier) else {
            return self.go_back(now);
        };
        let candidate = &stop.choice.candidate;
        let part_in_station_m = self.offset_m(stop.id, &candidate.position_in_tray_m).unwrap_or_default();
        let yaw_rad = report.position.z + candidate.yaw_in_tray_rad;
        let delivered = Delivered { part_in_station_m, yaw_rad, choice: stop.choice.clone() };
        let (id, told) = (stop.id, delivered.clone());
        let deadline = now + Duration::from_secs_f64(self.config.hand_over_timeout_s);
        self.hand_over.clear();
        self.enter(SequencerState::Presented { stops, delivered, since: now, deadline, taken: None }, Some(now));
        self.outputs.push(Output::Presented(id, told));
        true
    }

    pub(super) fn presented(
        &mut self,
        now: Stamp,
        stops: VecDeque<Planned>,
        delivered: Delivered,
        since: Stamp,
        deadline: Stamp,
        taken: Option<bool>,
    ) -> bool {
        let Some(id) = stops.front().map(|planned| planned.stop.id) else { return self.go_back(now) };
        let result = |taken| if taken { Ok(delivered.clone()) } else { Err(Failure::NotTaken) };
        match (self.hand_over.pop_front(), taken) {
            (Some(HandOver::Released), Some(taken)) => {
                self.overheads.hand_over_s = mean_s(self.overheads.hand_over_s, since, now);
                self.finish(now, id, result(taken))
            }
            (Some(report), _) => {
                let taken = Some(report == HandOver::Taken);
                if report != HandOver::Released
                    && let Some(slip) = self.slip_watch.hand_over(report == HandOver::Taken)
                {
                    self.make_gentler(slip);
                }
                let deadline = now + Duration::from_secs_f64(self.config.hand_over_timeout_s);
                self.state = SequencerState::Presented { stops, delivered, since, deadline, taken };
                true
            }
            (None, _) if now < deadline => false,
            (None, None) => self.finish(now, id, Err(Failure::NoHandOver)),
            (None, Some(taken)) => {
                let station = self.delivery(id).map(|delivery| delivery.request.station.clone()).unwrap_or_default();
                self.outputs.push(Output::Warning(Warning::NotReleased(station)));
                self.finish(now, id, result(taken))
            }
        }
    }

    pub(super) fn go_back(&mut self, now: Stamp) -> bool {
        self.feed(false);
        self.enter(SequencerState::ToReturn { not_before: now, failures: 0 }, None)
    }

    pub(super) fn try_to_return(&mut self, now: Stamp, not_before: Stamp, failures: u32) -> bool {
        if now < not_before || self.rest_since.is_none() {
            return false;
        }
        let Some(report) = self.courier else { return false };
        if self.at_feeding_place(&report) {
            return self.come_home();
        }
        if self.leases.must_ask() {
            // The courier is on no trip, but not where it parks: at the start, after a reset, or when a lease was lost.
            if let Some(reason) = self.leases.take_refusal() {
                return self.return_failed(now, failures, reason);
            }
            return match self.routes(&[]) {
                Ok((routes, moves_s)) => {
                    self.ask(&routes, moves_s);
                    true
                }
                Err(error) => self.return_failed(now, failures, error.to_string()),
            };
        }
        if self.leases.trip() == Trip::Open {
            return false;
        }
        let (home, protected) = (self.config.feeding_place, self.protected(&[]));
        let plan = if self.config.arbitrated {
            self.planner.plan_along(report.position, home, self.way_home_m(report.position.xy()), &protected)
        } else {
            self.planner.plan(report.position, home, &protected)
        };
        match plan {
            Ok(plan) => {
                let until = now + Duration::from_secs_f64(plan.duration_s + self.config.move_grace_s);
                if !self.leases.lasts(now, until, &mut self.outputs) {
                    return true;
                }
                let (id, _, deadline) = self.begin(now, &plan);
                self.state = SequencerState::Returning { id, deadline, ended: false, failures };
                self.outputs.push(Output::Move(id, plan));
                true
            }
            Err(error) => self.return_failed(now, failures, error.to_string()),
        }
    }

    pub(super) fn returning(&mut self, now: Stamp, id: MoveId, deadline: Stamp, ended: bool, failures: u32) -> bool {
        let ended = match self.move_ended.take_if(|(ended, _)| *ended == id) {
            Some((_, Err(reason))) => return self.return_failed(now, failures, reason),
            Some((_, Ok(()))) => true,
            None => ended,
        };
        let there = self.courier.is_some_and(|report| self.at_feeding_place(&report));
        if ended && there && self.rest_since.is_some() {
            return self.come_home();
        }
        if now >= deadline {
            self.outputs.push(Output::CancelMove(id));
            return self.return_failed(now, failures, "the courier did not arrive".into());
        }
        self.state = SequencerState::Returning { id, deadline, ended, failures };
        false
    }

    /// The trip is over: the courier parks.
    fn come_home(&mut self) -> bool {
        self.leases.end_trip(&mut self.outputs);
        self.enter(SequencerState::Idle, None)
    }

    /// Why moves are gentler than what was believed of the friction would have them, if they are.
    #[must_use]
    pub fn slid(&self) -> Option<String> {
        self.slip_watch.said().map(Warning::to_string)
    }

    /// Makes moves gentler from now on, and says so.
    pub(super) fn make_gentler(&mut self, slip: Slip) {
        let believed = self.planner.gentle.friction;
        // With less there is no move that holds parts on the ramp, or it takes for ever.
        let at_rest = self.config.friction_at_rest(&self.planner.tray) / Self::GENTLER;
        let friction = (Self::GENTLER * believed).max(Self::LEAST_FRICTION * self.config.gentle.friction).max(at_rest);
        let warning = if friction < believed {
            self.planner.gentle.friction = friction;
            Warning::Slid { slip, believed, friction }
        } else {
            Warning::SlidAllTheSame(slip)
        };
        if self.slip_watch.is_news(&warning) {
            self.outputs.push(Output::Warning(warning));
        }
    }

    fn return_failed(&mut self, now: Stamp, failures: u32, reason: String) -> bool {
        self.outputs.push(Output::Warning(Warning::ReturnFailed(reason.clone())));
        if failures >= self.config.retries_max {
            return self.enter(SequencerState::Fault { reason, of_courier: false }, None);
        }
        let not_before = now + Duration::from_secs_f64(self.config.retry_s);
        self.state = SequencerState::ToReturn { not_before, failures: failures + 1 };
        true
    }
}

/// Why a part that lies where the chosen one should is not the one to be handed over, if it is not.
fn why_not(part: &OfferedPart, chosen: &OfferedPart) -> Option<String> {
    match (&part.pose_class, &chosen.pose_class) {
        (Some(lies), Some(wanted)) if lies != wanted => Some(format!("it lies {lies}, not {wanted}")),
        _ => (!part.refusals.may_be_picked()).then(|| part.refusals.to_string()),
    }
}

/// Whether a part lies as chosen by the latest image, and only earlier ones leave a doubt of its pose.
fn is_merely_unsure(part: &OfferedPart, chosen: &OfferedPart) -> bool {
    let unsure = Refusals { pose_unsure: true, ..Refusals::default() };
    part.pose_class == chosen.pose_class && part.refusals == unsure
}
