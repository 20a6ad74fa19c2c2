//! What the driver does about each fault of its hardware and of those who command it, and how it recovers.

use nalgebra::Vector3;

use super::feed::FeedTrial;
use feeder_control::courier::{Commander, DriverEvent, GoalOutcome, Rejection, Trajectory, TrajectoryPoint};
use feeder_scenario::{SimulatedCourier, SimulatedDriver};
use feeder_sim::motor::{FaultHooks, SizedWindow, Window};

/// When faults begin, and how long they last, s.
const ONSET_S: f64 = 2.0;
const LASTING_S: f64 = 1.5;
/// Slower than this the courier counts as standing, m/s and rad/s.
const STANDING: f64 = 5e-3;
/// The client that moves the courier.
const CLIENT: u64 = 1;

/// What the courier does when the fault begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doing {
    /// The middle of a move of 300 mm in 1 s.
    Moving,
    /// It vibrates as the paper's tray does.
    Vibrating,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Hardware(FaultHooks),
    Silent(Commander),
    EmergencyStop,
}

/// What became of a fault.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultReport {
    /// What went wrong.
    pub fault: &'static str,
    /// What the courier did then.
    pub doing: Doing,
    /// What the driver did about it.
    pub reaction: String,
    /// From the fault's beginning until the driver reacted, s.
    pub noticed_s: Option<f64>,
    /// From the fault's beginning until the courier stood for good, s.
    pub safe_s: Option<f64>,
    /// How far the courier's centre went in that time, m.
    pub way_m: f64,
    /// Whether the courier worked again, after a reset where one was needed: it went home.
    pub recovered: bool,
}

/// Every fault with every thing that the courier may be doing.
///
/// # Errors
/// A configuration out of its range, or one that refuses the move or the waveform.
pub fn matrix(courier: SimulatedCourier) -> Result<Vec<FaultReport>, Rejection> {
    let window = Some(Window { from_s: ONSET_S, to_s: ONSET_S + LASTING_S });
    let short = Some(Window { from_s: ONSET_S, to_s: ONSET_S + 1e-3 });
    let sized = |size| Some(SizedWindow { from_s: ONSET_S, to_s: ONSET_S + LASTING_S, size });
    let none = FaultHooks::NONE;
    let hardware = [
        ("courier freezes", FaultHooks { freeze: window, ..none }),
        ("sensor silent for 1 ms", FaultHooks { sensor_dropout: short, ..none }),
        ("sensor silent for 1.5 s", FaultHooks { sensor_dropout: window, ..none }),
        ("forcers give 1 % of their force", FaultHooks { saturation: sized(0.01), ..none }),
        ("commands 1 ms late", FaultHooks { latency: sized(1e-3), ..none }),
        ("commands 10 ms late", FaultHooks { latency: sized(10e-3), ..none }),
        ("every fifth command lost", FaultHooks { message_loss: sized(0.2), ..none }),
        ("all commands lost", FaultHooks { message_loss: sized(1.0), ..none }),
    ];
    let mut cases: Vec<_> = hardware.map(|(name, hooks)| (name, Wrong::Hardware(hooks))).into();
    cases.push(("emergency stop", Wrong::EmergencyStop));
    let mut reports = Vec::new();
    for doing in [Doing::Moving, Doing::Vibrating] {
        let commander = match doing {
            Doing::Moving => ("planner falls silent", Wrong::Silent(Commander::Planner)),
            Doing::Vibrating => ("generator falls silent", Wrong::Silent(Commander::Generator)),
        };
        for (name, wrong) in cases.iter().copied().chain([commander]) {
            reports.push(try_out(courier, name, doing, wrong)?);
        }
    }
    Ok(reports)
}

fn try_out(
    mut courier: SimulatedCourier,
    fault: &'static str,
    doing: Doing,
    wrong: Wrong,
) -> Result<FaultReport, Rejection> {
    if let Wrong::Hardware(hooks) = wrong {
        courier.motor.faults = hooks;
    }
    let mut driver = courier.driver(1)?;
    let period_s = courier.config.servo_period_s;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some seconds of servo ticks")]
    let ticks = |duration_s: f64| (duration_s / period_s).round() as usize;
    match doing {
        // Silence is noticed after seconds: that move is a longer one.
        Doing::Moving => {
            let duration_s: f64 = if matches!(wrong, Wrong::Silent(_)) { 10.0 } else { 1.0 };
            driver.step(ticks(ONSET_S - 0.5 * duration_s.min(1.0)));
            let target = courier.config.start + Vector3::new(0.3, 0.0, 0.0);
            driver.execute(CLIENT, &Trajectory { points: vec![TrajectoryPoint::at_rest(duration_s, target)] })?;
            driver.step(ticks(0.5 * duration_s.min(1.0)));
        }
        Doing::Vibrating => {
            driver.set_waveform(FeedTrial::paper(period_s).waveform(), true)?;
            driver.step(ticks(ONSET_S));
        }
    }
    match wrong {
        Wrong::Hardware(_) => {}
        Wrong::Silent(commander) => driver.hear(commander),
        Wrong::EmergencyStop => driver.emergency_stop(),
    }
    let watched_s = if matches!(wrong, Wrong::Silent(_)) { 2.0 * LASTING_S } else { LASTING_S };
    let begun = driver.step(1);
    let from = driver.motor_mut().motion().0;
    let mut seen = FaultSeen::default();
    seen.take(&begun.events, 0.0);
    let (mut moved_s, mut rest) = (0.0, from);
    for tick in 1..ticks(watched_s) {
        let output = driver.step(1);
        let time_s = tick as f64 * period_s;
        seen.take(&output.events, time_s);
        let (position, velocity) = driver.motor_mut().motion();
        if velocity.norm() > STANDING {
            (moved_s, rest) = (time_s, position);
        }
    }
    let stopped = seen.noticed_s.is_some();
    driver.step(ticks(0.5));
    Ok(FaultReport {
        fault,
        doing,
        reaction: seen.reaction.unwrap_or_else(|| "carries on".to_owned()),
        noticed_s: seen.noticed_s,
        safe_s: stopped.then_some(moved_s),
        way_m: if stopped { (rest - from).xy().norm() } else { 0.0 },
        recovered: recovers(&mut driver, ticks(5.0)),
    })
}

/// The first thing that the driver did about a fault.
#[derive(Debug, Default)]
struct FaultSeen {
    reaction: Option<String>,
    noticed_s: Option<f64>,
}

impl FaultSeen {
    fn take(&mut self, events: &[DriverEvent], time_s: f64) {
        for event in events {
            let reaction = match event {
                DriverEvent::Fault(fault) | DriverEvent::GoalEnded(_, GoalOutcome::Faulted(fault)) => {
                    format!("fault: {fault}")
                }
                DriverEvent::GoalEnded(_, GoalOutcome::Succeeded) => continue,
                DriverEvent::GoalEnded(_, outcome) => format!("goal ended: {outcome:?}"),
            };
            if self.reaction.is_none() {
                (self.reaction, self.noticed_s) = (Some(reaction), Some(time_s));
            }
        }
    }
}

/// Resets what is to be reset, and goes home.
fn recovers(driver: &mut SimulatedDriver, ticks: usize) -> bool {
    driver.halt();
    driver.step(ticks / 10);
    if driver.reset_fault().is_err() || driver.home(CLIENT).is_err() {
        return false;
    }
    let output = driver.step(ticks);
    output.status.fault.is_none()
        && output.events.iter().any(|event| matches!(event, DriverEvent::GoalEnded(_, GoalOutcome::Succeeded)))
}
