//! What is watched while the courier moves, and what makes the driver stop it.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::report::{Commander, Fault};
use crate::courier::limits::CourierLimits;
use feeder_model::range::OutOfRange;
use feeder_model::range::check_ranges;
use feeder_model::trajectory::AXES;

/// When the driver takes the courier to be out of control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SafetyParameters {
    /// Distance from the set point beyond which the driver faults, m.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub tracking_error_m_max: f64,
    /// Yaw from the set point beyond which the driver faults, rad.
    #[schemars(range(min = 1e-5, max = 0.1))]
    pub tracking_error_rad_max: f64,
    /// How far beyond the bounds of platen and tether the courier may be, m.
    #[schemars(range(min = 1e-6, max = 0.1))]
    pub position_margin_m: f64,
    /// How far beyond the bound of yaw it may be, rad.
    #[schemars(range(min = 1e-6, max = 0.1))]
    pub yaw_margin_rad: f64,
    /// How much faster than the bound it may be, relative.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub speed_margin: f64,
    /// How long force or torque may be cut to their peaks without a break, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub saturation_s_max: f64,
    /// Share of a second's ticks in which force or torque may be cut.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub saturation_share_max: f64,
    /// How long the courier may stand still while its set point moves by at least ten times the distances below, s.
    #[schemars(range(min = 0.01, max = 10.0))]
    pub stuck_s_max: f64,
    /// Movement of the sensor's reading that is mere noise, m.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub still_m: f64,
    /// The same of yaw, rad.
    #[schemars(range(min = 0.0, max = 1e-2))]
    pub still_rad: f64,
    /// How long the sensor may give no number, s. Meanwhile the courier runs on feed-forward.
    #[schemars(range(min = 0.0, max = 0.1))]
    pub sensor_silence_s_max: f64,
    /// How long a commander that has been heard may be silent while the courier moves at its wish, s; 0 for ever.
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub command_silence_s_max: f64,
}

impl Default for SafetyParameters {
    fn default() -> Self {
        Self {
            tracking_error_m_max: 2e-3,
            tracking_error_rad_max: 10e-3,
            position_margin_m: 1e-3,
            yaw_margin_rad: 2e-3,
            speed_margin: 0.1,
            saturation_s_max: 0.05,
            saturation_share_max: 0.4,
            stuck_s_max: 0.1,
            still_m: 5e-6,
            still_rad: 50e-6,
            sensor_silence_s_max: 2e-3,
            command_silence_s_max: 2.0,
        }
    }
}

impl SafetyParameters {
    /// Checks every value.
    ///
    /// # Errors
    /// The first parameter that is not finite or out of range.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        check_ranges("safety.", self)
    }
}

/// What one servo tick shows.
pub(super) struct Seen {
    /// Measured position; nothing if the sensor gave none.
    pub(super) measured: Option<Vector3<f64>>,
    pub(super) set_point: Vector3<f64>,
    /// Estimated velocity.
    pub(super) velocity: Vector3<f64>,
}

/// How far something moved within a stretch of time.
#[derive(Clone, Copy, Debug)]
struct Span {
    min: Vector3<f64>,
    max: Vector3<f64>,
}

impl Span {
    fn new(first: &Vector3<f64>) -> Self {
        Self { min: *first, max: *first }
    }

    fn add(&mut self, value: &Vector3<f64>) {
        (self.min, self.max) = (self.min.inf(value), self.max.sup(value));
    }

    fn size(&self) -> Vector3<f64> {
        self.max - self.min
    }
}

/// Where set point and courier went in the present stretch, and for how many ticks it has lasted.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    set_point: Span,
    measured: Span,
    ticks: u32,
}

/// Watches over the courier, tick by tick.
#[derive(Clone, Debug)]
pub(super) struct Supervisor {
    parameters: SafetyParameters,
    limits: CourierLimits,
    period_s: f64,
    blind_ticks: u32,
    saturated_ticks: u32,
    /// Ticks of the present second, those in which the command was cut, and their share in the second before.
    second: (u32, u32),
    saturated_share: f64,
    stretch: Option<Stretch>,
    /// Ticks since each commander was last heard; nothing of one that never was.
    silent_ticks: [Option<u64>; 2],
}

impl Supervisor {
    pub(super) fn new(parameters: SafetyParameters, limits: CourierLimits, period_s: f64) -> Self {
        Self {
            parameters,
            limits,
            period_s,
            blind_ticks: 0,
            saturated_ticks: 0,
            second: (0, 0),
            saturated_share: 0.0,
            stretch: None,
            silent_ticks: [None; 2],
        }
    }

    pub(super) fn hear(&mut self, commander: Commander) {
        self.silent_ticks[commander as usize] = Some(0);
    }

    pub(super) fn note_given(&mut self, in_full: bool) {
        self.saturated_ticks = if in_full { 0 } else { self.saturated_ticks + 1 };
        let (ticks, cut) = (self.second.0 + 1, self.second.1 + u32::from(!in_full));
        self.second = (ticks, cut);
        if f64::from(ticks) * self.period_s >= 1.0 {
            self.saturated_share = f64::from(cut) / f64::from(ticks);
            self.second = (0, 0);
        }
    }

    /// Forgets what led to a fault that has been reset.
    pub(super) fn reset(&mut self) {
        (self.blind_ticks, self.saturated_ticks, self.stretch) = (0, 0, None);
        (self.second, self.saturated_share) = ((0, 0), 0.0);
        self.silent_ticks = [None; 2];
    }

    /// The fault that a tick shows, if it shows one.
    pub(super) fn watch(&mut self, seen: &Seen) -> Option<Fault> {
        let SafetyParameters { saturation_s_max, saturation_share_max, sensor_silence_s_max, .. } = self.parameters;
        let Some(measured) = &seen.measured else {
            self.blind_ticks += 1;
            let too_long = f64::from(self.blind_ticks) * self.period_s > sensor_silence_s_max;
            return too_long.then_some(Fault::SensorLost);
        };
        self.blind_ticks = 0;
        let saturated_s = f64::from(self.saturated_ticks) * self.period_s;
        self.tracking_fault(&(seen.set_point - measured))
            .or_else(|| self.envelope_fault(measured, &seen.velocity))
            .or_else(|| self.stuck_fault(&seen.set_point, measured))
            .or_else(|| (saturated_s > saturation_s_max).then_some(Fault::Saturated { for_s: saturated_s }))
            .or_else(|| {
                let share = self.saturated_share;
                (share > saturation_share_max).then_some(Fault::OftenSaturated { share })
            })
    }

    /// The commander of a courier that does what it is asked who has been silent for too long.
    pub(super) fn silence(&mut self, asked_by: impl IntoIterator<Item = Commander>) -> Option<Fault> {
        for silent_ticks in self.silent_ticks.iter_mut().flatten() {
            *silent_ticks += 1;
        }
        let limit_s = self.parameters.command_silence_s_max;
        asked_by.into_iter().find_map(|of| {
            let for_s = self.silent_ticks[of as usize]? as f64 * self.period_s;
            (limit_s > 0.0 && for_s > limit_s).then_some(Fault::Silence { of, for_s })
        })
    }

    fn tracking_fault(&self, error: &Vector3<f64>) -> Option<Fault> {
        let (m, rad) = (self.parameters.tracking_error_m_max, self.parameters.tracking_error_rad_max);
        [m, m, rad].into_iter().enumerate().find_map(|(axis, allowed)| {
            let error = error[axis];
            (error.abs() > allowed).then_some(Fault::TrackingError { axis, error, allowed })
        })
    }

    /// A courier that does not move at all while its set point does is stuck, however little it is off.
    fn stuck_fault(&mut self, set_point: &Vector3<f64>, measured: &Vector3<f64>) -> Option<Fault> {
        let SafetyParameters { stuck_s_max, still_m, still_rad, .. } = self.parameters;
        let stretch = self.stretch.get_or_insert_with(|| Stretch {
            set_point: Span::new(set_point),
            measured: Span::new(measured),
            ticks: 0,
        });
        stretch.set_point.add(set_point);
        stretch.measured.add(measured);
        stretch.ticks += 1;
        if f64::from(stretch.ticks) * self.period_s < stuck_s_max {
            return None;
        }
        let (asked, moved) = (stretch.set_point.size(), stretch.measured.size());
        self.stretch = None;
        let still = [still_m, still_m, still_rad];
        let stuck = (0..3).find(|&axis| moved[axis] < still[axis] && asked[axis] > 10.0 * still[axis]);
        stuck.map(|axis| Fault::Stuck { axis, asked: asked[axis] })
    }

    fn envelope_fault(&self, measured: &Vector3<f64>, velocity: &Vector3<f64>) -> Option<Fault> {
        let SafetyParameters { position_margin_m: m, yaw_margin_rad: rad, speed_margin, .. } = self.parameters;
        let (min, max) = (self.limits.position_min(), self.limits.position_max());
        let bounds = [m, m, rad].into_iter().enumerate().flat_map(|(axis, margin)| {
            let (low, high) = (min[axis] - margin, max[axis] + margin);
            [
                (AXES[axis], measured[axis], low, measured[axis] < low),
                (AXES[axis], measured[axis], high, measured[axis] > high),
            ]
        });
        let (tether_m, tether_m_max) = (self.limits.tether_m(measured), self.limits.tether_length_m + m);
        let (speed_m_s, speed_m_s_max) = (velocity.xy().norm(), self.limits.speed_m_s_max * (1.0 + speed_margin));
        bounds
            .chain([
                ("distance from the tether's anchor (m)", tether_m, tether_m_max, tether_m > tether_m_max),
                ("speed (m/s)", speed_m_s, speed_m_s_max, speed_m_s > speed_m_s_max),
            ])
            .find(|&(.., outside)| outside)
            .map(|(quantity, value, allowed, _)| Fault::LeftEnvelope { quantity, value, allowed })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.5e-3;

    fn supervisor() -> Supervisor {
        Supervisor::new(SafetyParameters::default(), CourierLimits::default(), PERIOD_S)
    }

    fn ticks_of(duration_s: f64) -> usize {
        (1_u32..).take_while(|&ticks| f64::from(ticks) * PERIOD_S < duration_s + 0.5 * PERIOD_S).count()
    }

    fn at_rest() -> Seen {
        Seen { measured: Some(Vector3::zeros()), set_point: Vector3::zeros(), velocity: Vector3::zeros() }
    }

    #[test]
    fn the_tracking_error_counts_on_every_axis_and_to_either_side() {
        let SafetyParameters { tracking_error_m_max: m, tracking_error_rad_max: rad, .. } = SafetyParameters::default();
        for (axis, allowed) in [(0, m), (1, m), (2, rad)] {
            for side in [-1.0, 1.0] {
                let off = |share: f64| {
                    let mut set_point = Vector3::zeros();
                    set_point[axis] = side * share * allowed;
                    supervisor().watch(&Seen { set_point, ..at_rest() })
                };
                assert_eq!(off(0.99), None);
                let fault = off(1.01);
                assert!(matches!(fault, Some(Fault::TrackingError { axis: found, .. }) if found == axis), "{fault:?}");
            }
        }
    }

    #[test]
    fn the_envelope_has_bounds_of_place_yaw_tether_and_speed() {
        let limits = CourierLimits { tether_anchor_m: [0.0, 0.8], tether_length_m: 0.8, ..CourierLimits::default() };
        let within = |limits: CourierLimits, measured: Vector3<f64>, velocity: Vector3<f64>| {
            let mut supervisor = Supervisor::new(SafetyParameters::default(), limits, PERIOD_S);
            match supervisor.watch(&Seen { measured: Some(measured), set_point: measured, velocity }) {
                Some(Fault::LeftEnvelope { quantity, .. }) => Some(quantity),
                other => other.map(|fault| panic!("{fault:?}")),
            }
        };
        let found = |measured, velocity| within(limits, measured, velocity);
        let (centre, still) = (Vector3::zeros(), Vector3::zeros());
        let margin_m = SafetyParameters::default().position_margin_m;
        assert_eq!(found(centre, still), None);
        let away = |m: f64| Vector3::new(0.0, -m, 0.0);
        assert_eq!(found(away(0.9 * margin_m), still), None);
        assert_eq!(found(away(1.1 * margin_m), still), Some("distance from the tether's anchor (m)"));
        // The bounds of place and yaw hold to either side; here no tether holds the courier back before.
        let yaw_margin_rad = SafetyParameters::default().yaw_margin_rad;
        for (axis, margin) in [(0, margin_m), (1, margin_m), (2, yaw_margin_rad)] {
            for (side, bound) in [(-1.0, limits.position_min()[axis]), (1.0, limits.position_max()[axis])] {
                let beyond = |share: f64| {
                    let mut place = Vector3::zeros();
                    place[axis] = bound + side * share * margin;
                    within(CourierLimits { tether_length_m: 9.0, ..limits }, place, still)
                };
                assert_eq!((beyond(0.9), beyond(1.1)), (None, Some(AXES[axis])), "{side}");
            }
        }
        let fast_m_s = limits.speed_m_s_max * (1.0 + SafetyParameters::default().speed_margin);
        for direction in [Vector3::new(0.6, 0.8, 0.0), Vector3::new(-1.0, 0.0, 0.0)] {
            assert_eq!(found(centre, direction * (0.99 * fast_m_s)), None);
            assert_eq!(found(centre, direction * (1.01 * fast_m_s)), Some("speed (m/s)"));
        }
    }

    #[test]
    fn force_cut_for_too_long_is_a_fault_and_a_tick_in_full_begins_anew() {
        let ticks = ticks_of(SafetyParameters::default().saturation_s_max);
        let mut supervisor = supervisor();
        for _ in 0..2 {
            for _ in 0..ticks {
                supervisor.note_given(false);
                assert_eq!(supervisor.watch(&at_rest()), None);
            }
            supervisor.note_given(true);
        }
        let fault = (0..=ticks).find_map(|_| {
            supervisor.note_given(false);
            supervisor.watch(&at_rest())
        });
        assert!(matches!(fault, Some(Fault::Saturated { .. })), "{fault:?}");
    }

    #[test]
    fn a_blind_sensor_is_a_fault_after_a_while_and_a_number_begins_anew() {
        let ticks = ticks_of(SafetyParameters::default().sensor_silence_s_max);
        let blind = Seen { measured: None, ..at_rest() };
        let mut supervisor = supervisor();
        for _ in 0..3 {
            assert!((0..ticks).all(|_| supervisor.watch(&blind).is_none()));
            assert_eq!(supervisor.watch(&at_rest()), None);
        }
        assert!((0..ticks).all(|_| supervisor.watch(&blind).is_none()));
        assert_eq!(supervisor.watch(&blind), Some(Fault::SensorLost));
        // What led to the fault is forgotten with it.
        supervisor.reset();
        assert_eq!(supervisor.watch(&blind), None);
    }

    #[test]
    fn force_cut_in_too_many_ticks_of_a_second_is_a_fault_although_never_for_long() {
        let share_of = |every: u32| {
            let mut supervisor = supervisor();
            let seen = at_rest();
            (0..2001).find_map(|tick| {
                supervisor.note_given(tick % every != 0);
                supervisor.watch(&seen)
            })
        };
        assert_eq!(share_of(2), Some(Fault::OftenSaturated { share: 0.5 }));
        assert_eq!(share_of(3), None);
    }

    #[test]
    fn a_courier_that_stands_while_its_set_point_moves_is_stuck_wherever_it_stands() {
        let SafetyParameters { still_m, still_rad, stuck_s_max, .. } = SafetyParameters::default();
        for (axis, still) in [(0, still_m), (1, still_m), (2, still_rad)] {
            for place in [-0.3, 0.0, 0.3] {
                let watched = |asked: f64, moved: f64| {
                    let mut supervisor = Supervisor::new(
                        SafetyParameters::default(),
                        CourierLimits { yaw_rad_max: 0.5, ..CourierLimits::default() },
                        PERIOD_S,
                    );
                    (0..ticks_of(stuck_s_max)).find_map(|tick| {
                        let swing = if tick % 2 == 0 { -0.5 } else { 0.5 };
                        let at = |size: f64| {
                            let mut position = Vector3::zeros();
                            position[axis] = place + swing * size;
                            position
                        };
                        let seen = Seen { measured: Some(at(moved)), set_point: at(asked), velocity: Vector3::zeros() };
                        supervisor.watch(&seen)
                    })
                };
                let fault = watched(11.0 * still, 0.9 * still);
                assert!(matches!(fault, Some(Fault::Stuck { axis: found, .. }) if found == axis), "{place} {fault:?}");
                // It moves, or it was hardly asked to.
                assert_eq!((watched(11.0 * still, 1.1 * still), watched(9.0 * still, 0.9 * still)), (None, None));
            }
        }
    }

    #[test]
    fn a_commander_may_be_silent_for_its_time_and_for_ever_where_that_is_0() {
        for (limit_s, is_limited) in [(0.5, true), (0.0, false)] {
            let parameters = SafetyParameters { command_silence_s_max: limit_s, ..SafetyParameters::default() };
            let mut supervisor = Supervisor::new(parameters, CourierLimits::default(), PERIOD_S);
            supervisor.hear(Commander::Planner);
            for _ in 0..1000 {
                assert_eq!(supervisor.silence([Commander::Planner]), None);
            }
            // Half a second is over. What nobody asked for does not depend on anybody's word.
            assert_eq!(supervisor.silence([]), None);
            let fault = supervisor.silence([Commander::Planner]);
            assert_eq!(fault.is_some(), is_limited, "{fault:?}");
        }
    }

    #[test]
    fn bad_parameters_are_named() {
        let bad = SafetyParameters { tracking_error_m_max: f64::NAN, ..SafetyParameters::default() };
        assert!(bad.validate().unwrap_err().to_string().contains("safety.tracking_error_m_max"));
    }
}
