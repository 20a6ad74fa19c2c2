//! The map of speeds over the tray's radii against the reference tables.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod bisect;
mod paper;
mod reference;

use bisect::bisect;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::{SurfaceFeed, TrayMap};
use feeder_model::tray::{Surface, TrayGeometry};
use feeder_model::waveform::{Axis, Waveform};
use paper::{M, T30, fig15, optimal_at, optimal_on, paper_track, pump};
use reference::{assert_close, table};

fn mm_s(feed: Option<SurfaceFeed>) -> f64 {
    feed.map_or(f64::NAN, |feed| feed.steady.feed_m_s * 1e3)
}

#[test]
fn val_fig15_speed_against_radius() {
    let (track, waveform) = (paper_track(), fig15(T30));
    let map = TrayMap::new(&track, &waveform).unwrap();
    for row in table(include_str!("data/fig15_speed_vs_radius.csv")) {
        let feed = map.at((row.number("r_mm") * 1e-3).clamp(0.03, 0.09)).unwrap();
        let what = format!("r {} mm", row.text("r_mm"));
        assert_close(mm_s(feed.ramp), row.number("ramp_mm_s_slope"), 1e-6, &what);
        assert_close(mm_s(feed.plateau), row.number("plateau_mm_s"), 1e-9, &what);
        let deg_s = |feed: Option<SurfaceFeed>| feed.map_or(f64::NAN, |feed| feed.rate_rad_s.to_degrees());
        assert_close(deg_s(feed.ramp), row.number("ramp_deg_s"), 1e-6, &what);
        assert_close(deg_s(feed.plateau), row.number("plateau_deg_s"), 1e-9, &what);
    }
}

#[test]
fn val_fig15_critical_radius_and_rise_limit() {
    let (track, waveform) = (paper_track(), fig15(T30));
    let critical_m = TrayMap::new(&track, &waveform).unwrap().critical_radius_m().unwrap().unwrap();
    assert_close(critical_m * 1e3, 57.605_055_027_030_296, 1e-6, "critical radius");
    // Below 31.8 mm the ramp is steeper than the friction angle.
    assert_close(TrayGeometry::PAPER.pitch_m_per_rad() / 0.2, 0.0318, 5e-5, "slides at rest below");
    let climbs_mm = largest_rise_mm(0.09, &waveform);
    assert_close(climbs_mm, 23.65, 0.005, "rise beyond which nothing climbs at 90 mm");
}

/// The largest rise over half a turn that parts still climb at a radius, mm.
fn largest_rise_mm(radius_m: f64, waveform: &Waveform) -> f64 {
    let climbs = |rise_m: f64| {
        let tray = TrayGeometry { rise_m, ..TrayGeometry::PAPER };
        let track = AnnularTrack::new(tray, Friction::uniform(0.2).unwrap(), G).unwrap();
        let drive = TrayMap::new(&track, waveform).unwrap().drive(radius_m, Surface::Ramp).unwrap();
        drive.steady().is_some_and(|steady| steady.feed_m_s > 1e-12)
    };
    bisect(1e-4, 0.04, climbs) * 1e3
}

#[test]
fn val_coulomb_pump_rises() {
    for row in table(include_str!("data/coulomb_annular_max_rise.csv")) {
        let waveform = pump(row.number("alpha_max_mug_rad_s2") * M, row.number("z"));
        let what = format!("α {} z {}", row.text("alpha_max_mug_rad_s2"), row.text("z"));
        // The table's search stopped at 1e-6 mm.
        assert_close(largest_rise_mm(0.09, &waveform), row.number("max_rise_climb_r90_mm"), 1e-4, &what);
        assert_close(largest_rise_mm(0.06, &waveform), row.number("max_rise_climb_r60_mm"), 1e-4, &what);
        let tray = TrayGeometry { rise_m: 0.005, ..TrayGeometry::PAPER };
        let track = AnnularTrack::new(tray, Friction::uniform(0.2).unwrap(), G).unwrap();
        let map = TrayMap::new(&track, &waveform).unwrap();
        let feed = map.at(0.09).unwrap();
        assert_close(mm_s(feed.ramp), row.number("ramp_mm_s_r90_rise5"), 1e-5, &what);
        assert_close(mm_s(feed.plateau), row.number("plateau_r90_mm_s"), 1e-5, &what);
        let critical_mm = map.critical_radius_m().unwrap().map_or(f64::NAN, |r| r * 1e3);
        assert_close(critical_mm, row.number("crit_radius_rise5_mm"), 1e-4, &what);
    }
}

#[test]
fn val_optimal_annular_table() {
    let track = paper_track();
    for row in table(include_str!("data/optimal_annular.csv")) {
        let waveform = match row.text("waveform") {
            "paper stick-slip 9.0/66.7" => fig15(T30),
            "stick-slip best amin=7.10" => Waveform::stick_slip(Axis::Yaw, T30, 7.1 * M, 66.7 * M).unwrap(),
            "hybrid designed r=90 ramp" => optimal_at(0.090, T30),
            "hybrid designed r=85 ramp" => optimal_at(0.085, T30),
            "hybrid designed r=75 ramp" => optimal_at(0.075, T30),
            "hybrid designed r=90 flat" => optimal_on(0.0, 0.09, T30),
            "coulomb z=.4167" => pump(66.7 * M, 0.4167),
            "coulomb z=.5" => pump(66.7 * M, 0.5),
            _ => pump(66.7 * M, 0.6),
        };
        let map = TrayMap::new(&track, &waveform).unwrap();
        let feed = map.at(row.number("r_mm") * 1e-3).unwrap();
        let what = format!("{} r {}", row.text("waveform"), row.text("r_mm"));
        // Four decimals are printed.
        assert_close(mm_s(feed.ramp), row.number("ramp_mm_s"), 6e-5, &what);
        assert_close(mm_s(feed.plateau), row.number("plateau_mm_s"), 6e-5, &what);
        let critical_mm = map.critical_radius_m().unwrap().map_or(f64::NAN, |r| r * 1e3);
        // The table's search stopped at 1e-6 mm or so.
        assert_close(critical_mm, row.number("crit_radius_mm"), 1e-5, &what);
    }
}

#[test]
fn val_longer_periods_and_radial_drift() {
    let track = paper_track();
    for row in table(include_str!("data/longer_period.csv")) {
        let period_s = row.number("T");
        let waveform = if row.text("waveform") == "SS" { fig15(period_s) } else { optimal_at(0.085, period_s) };
        let feed = TrayMap::new(&track, &waveform).unwrap().at(0.085).unwrap();
        let feed = if row.text("surface") == "ramp" { feed.ramp } else { feed.plateau }.unwrap();
        let what = format!("{} T {period_s} {}", row.text("waveform"), row.text("surface"));
        let feed_mm_s = feed.steady.feed_m_s * 1e3;
        assert_close(feed_mm_s, row.number("oneD_mm_s"), 1e-9, &what);
        // The local-slope model against the table's two-dimensional one: coupling grows with the square of the stroke.
        let coupling = if period_s < 0.06 { 6e-4 } else { 6e-3 };
        assert_close(feed_mm_s / row.number("twoD_mm_s"), 1.0, coupling, &what);
        // The table's drift is the mean over a run that starts at rest and moves outward; this is the drift at r = 85 mm.
        assert_close(feed.radial_drift_m_s * 1e6 / row.number("radial_drift_um_s"), 1.0, 0.03, &what);
        assert_close(waveform.stroke().to_degrees(), row.number("yaw_pp_deg"), 1e-9, &what);
        assert_close(waveform.peak_speed(), row.number("yaw_peak_rad_s"), 1e-9, &what);
    }
}
