//! Figs 4, 6, 7 and 8: one part on a flat track, in time.

use anyhow::Result;
use feeder_model::mechanics::slope::Drive;
use feeder_model::waveform::Waveform;

use super::super::chart::{Chart, Series};
use super::super::paper::{MU, fig6_waveform, fig8_waveform};
use super::drive;

/// Speed printed for the simulation of Fig. 6 and measured in it, mm/s.
pub(super) const FIG6_PRINTED_MM_S: f64 = 11.8;
pub(super) const FIG6_MEASURED_MM_S: f64 = 12.4;
/// Speed measured in Fig. 8, mm/s.
pub(super) const FIG8_MEASURED_MM_S: f64 = 22.5;

/// Points per period of a curve.
const POINTS: u32 = 400;

/// Fig. 4: speeds of tray and part under stick-slip in the steady state.
pub(super) fn stick_slip_speeds() -> Result<Chart> {
    let waveform = fig6_waveform()?;
    let drive = drive(&waveform, MU, 0.0)?;
    let start_m_s = drive.steady().map_or(0.0, |steady| steady.start_m_s);
    Ok(speeds("Fig. 4: stick-slip, T 0.05 s, 1.6 and 10.1 m/s², μ 0.2, steady", &waveform, &drive, start_m_s, 2))
}

/// Fig. 7: speeds of tray and part under the Coulomb pump, from rest in the world.
pub(super) fn coulomb_pump_speeds() -> Result<Chart> {
    let waveform = fig8_waveform()?;
    let drive = drive(&waveform, MU, 0.0)?;
    let start_m_s = drive.world_rest_m_s();
    Ok(speeds("Fig. 7: Coulomb pump, T 0.05 s, 10.3 m/s², z 0.37, μ 0.2, from rest", &waveform, &drive, start_m_s, 6))
}

/// Fig. 6: travel under stick-slip.
pub(super) fn stick_slip_travel() -> Result<Chart> {
    let waveform = fig6_waveform()?;
    let drive = drive(&waveform, MU, 0.0)?;
    let reference = [("printed in the paper", FIG6_PRINTED_MM_S), ("measured in the paper", FIG6_MEASURED_MM_S)];
    Ok(travel("Fig. 6: stick-slip, travel relative to the tray", &waveform, &drive, 0.0, 10, &reference))
}

/// Fig. 8: travel under the Coulomb pump.
pub(super) fn coulomb_pump_travel() -> Result<Chart> {
    let waveform = fig8_waveform()?;
    let drive = drive(&waveform, MU, 0.0)?;
    let start_m_s = drive.world_rest_m_s();
    let reference = [("measured in the paper", FIG8_MEASURED_MM_S)];
    Ok(travel("Fig. 8: Coulomb pump, travel relative to the tray", &waveform, &drive, start_m_s, 20, &reference))
}

/// Fig. 8: mean speed of each cycle from rest.
pub(super) fn coulomb_pump_cycle_means() -> Result<Chart> {
    let drive = drive(&fig8_waveform()?, MU, 0.0)?;
    let means = |start_m_s: f64| -> Vec<(f64, f64)> {
        drive.cycle_means_m_s(start_m_s, 20).iter().zip(1u32..).map(|(m_s, i)| (f64::from(i), m_s * 1e3)).collect()
    };
    Ok(Chart {
        title: "Fig. 8: mean speed of each cycle of the Coulomb pump".into(),
        x: "cycle".into(),
        y: "mean speed relative to the tray, mm/s".into(),
        series: vec![
            Series::dots("from rest in the world", means(drive.world_rest_m_s())),
            Series::dots("from rest on the tray", means(0.0)),
            Series::line("measured in the paper", vec![(1.0, FIG8_MEASURED_MM_S), (20.0, FIG8_MEASURED_MM_S)]),
        ],
    })
}

fn speeds(title: &str, waveform: &Waveform, drive: &Drive, start_m_s: f64, periods: u32) -> Chart {
    let history = history(waveform, drive, start_m_s, periods);
    let tray = |t: f64| waveform.state_at(t).velocity;
    Chart {
        title: title.into(),
        x: "time, s".into(),
        y: "speed in the world, m/s".into(),
        series: vec![
            Series::line("tray", history.iter().map(|p| (p.time_s, tray(p.time_s))).collect()),
            Series::line("part", history.iter().map(|p| (p.time_s, tray(p.time_s) + p.w_m_s)).collect()),
        ],
    }
}

fn travel(
    title: &str,
    waveform: &Waveform,
    drive: &Drive,
    start_m_s: f64,
    periods: u32,
    references_mm_s: &[(&str, f64)],
) -> Chart {
    let history = history(waveform, drive, start_m_s, periods);
    let end_s = f64::from(periods) * waveform.period_s();
    let straight = references_mm_s
        .iter()
        .map(|&(name, mm_s)| Series::line(format!("{name}: {mm_s} mm/s"), vec![(0.0, 0.0), (end_s, mm_s * end_s)]));
    let model = history.iter().map(|p| (p.time_s, p.travel_m * 1e3)).collect();
    Chart {
        title: title.into(),
        x: "time, s".into(),
        y: "travel, mm".into(),
        series: std::iter::once(Series::line("model", model)).chain(straight).collect(),
    }
}

/// A part at an instant.
struct Instant {
    time_s: f64,
    w_m_s: f64,
    travel_m: f64,
}

/// The motion of a part, at points dense enough to draw.
fn history(waveform: &Waveform, drive: &Drive, start_m_s: f64, periods: u32) -> Vec<Instant> {
    let mut history = vec![Instant { time_s: 0.0, w_m_s: start_m_s, travel_m: 0.0 }];
    let (mut time_s, mut travel_m, mut w_m_s) = (0.0, 0.0, start_m_s);
    let step_s = waveform.period_s() / f64::from(POINTS);
    for _ in 0..periods {
        w_m_s = drive.run(w_m_s, |phase| {
            let steps = (phase.duration_s / step_s).ceil().max(1.0);
            for i in (1u32..).map(f64::from).take_while(|&i| i <= steps) {
                let t = phase.duration_s * i / steps;
                let w_m_s = phase.from_m_s + (phase.to_m_s - phase.from_m_s) * i / steps;
                history.push(Instant {
                    time_s: time_s + t,
                    w_m_s,
                    travel_m: travel_m + (phase.from_m_s + w_m_s) / 2.0 * t,
                });
            }
            time_s += phase.duration_s;
            travel_m += phase.distance_m();
        });
    }
    history
}
