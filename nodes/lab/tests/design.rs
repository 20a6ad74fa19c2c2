//! Designs against proven bounds (`verif_`) and against the best found elsewhere (`val_`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../../model/tests/reference/mod.rs"]
mod reference;

use feeder_lab::design::{
    DesignedTray, Effort, Loading, PartKind, Period, TrayGoal, WaveformGoal, flow_in_two_dimensions, lane_flow,
};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, AxisLimits, Waveform};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use reference::{assert_close, table};

const T30: f64 = 1.0 / 30.0;
const M: f64 = 0.2 * G;
const PART_M: f64 = 0.005;

fn goal(frictions: &[f64], slope_rad: f64, max_acceleration: f64) -> WaveformGoal {
    WaveformGoal {
        axis: Axis::X,
        lever: 1.0,
        slope_rad,
        gravity_m_s2: G,
        frictions: frictions.to_vec(),
        period_s: T30,
        limits: AxisLimits { max_acceleration, ..AxisLimits::NONE },
        slew_s: 0.0,
    }
}

#[test]
fn verif_the_search_reaches_the_proven_bound_and_never_beats_it() {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    for case in 0..100 {
        let mu: f64 = random.random_range(0.1..0.6);
        let slope_rad = random.random_range(0.0..0.7) * mu.atan();
        let hold = G * (mu.atan() + slope_rad).tan();
        let lift_off = G / slope_rad.tan();
        let limit = (random.random_range(1.3..6.0) * hold).min(0.95 * lift_off);
        let goal = WaveformGoal { period_s: random.random_range(0.01..0.15), ..goal(&[mu], slope_rad, limit) };
        let proven = goal.best(3, Effort { starts: 0, steps: 0, seed: 0 }).unwrap().unwrap();
        assert!(proven.proven && (proven.worst_feed_m_s / proven.bound_m_s.unwrap() - 1.0).abs() < 1e-9);
        let found = goal.search(4, Effort { starts: 16, steps: 1600, seed: case }).unwrap().unwrap();
        let share = found.worst_feed_m_s / proven.worst_feed_m_s;
        assert!((0.99..1.0 + 1e-9).contains(&share), "case {case}: {share} of the bound");
    }
}

#[test]
fn val_robust_waveforms_are_at_least_as_good_as_the_table() {
    for row in table(include_str!("../../model/tests/data/optimal_robust.csv")) {
        let case = row.text("case");
        if !case.contains("robust+-25%") {
            continue;
        }
        let (slope_deg, limit) = match case.split_whitespace().next() {
            Some("ramp") => (4.046_f64, 6.003),
            _ if case.contains("A=4") => (0.0, 4.0),
            _ => (0.0, 6.003),
        };
        let goal = goal(&[0.15, 0.2, 0.25], slope_deg.to_radians(), limit * M);
        let design = goal.best(4, Effort { starts: 20, steps: 3000, seed: 3 }).unwrap().unwrap();
        let table_mm_s = row.number("min_v_mm_s_over_mu");
        // The table's last digits are where its own search stopped.
        assert!(design.worst_feed_m_s * 1e3 > table_mm_s * (1.0 - 1e-6), "{case}: {}", design.worst_feed_m_s * 1e3);
        assert!(!design.proven && design.worst_feed_m_s < design.bound_m_s.unwrap());
    }
}

#[test]
fn designs_keep_to_speed_stroke_and_slew() {
    let free = goal(&[0.2], 0.0, 6.0 * M);
    let effort = Effort { starts: 4, steps: 1200, seed: 1 };
    let best = free.best(4, effort).unwrap().unwrap();
    let limits = AxisLimits {
        max_speed: 0.7 * best.waveform.peak_speed(),
        max_stroke: 0.6 * best.waveform.stroke(),
        ..free.limits
    };
    let tight = WaveformGoal { limits, ..free.clone() }.best(4, effort).unwrap().unwrap();
    tight.waveform.check(&limits).unwrap();
    assert!(!tight.proven && tight.worst_feed_m_s < best.worst_feed_m_s);
    // Scaling the free optimum down is no better: the search found another shape.
    let scaled = best.waveform.scaled(0.6).unwrap();
    let scaled_m_s = free.feeds_m_s(&scaled).next().flatten().unwrap();
    assert!(tight.worst_feed_m_s > 1.05 * scaled_m_s, "{} {scaled_m_s}", tight.worst_feed_m_s);
    // With slew, the waveform is designed for what the amplifier makes of it.
    let slewed = WaveformGoal { slew_s: 2e-3, ..free.clone() };
    let of_the_free = slewed.feeds_m_s(&best.waveform).next().flatten().unwrap();
    let designed = slewed.best(4, effort).unwrap().unwrap();
    assert!(designed.worst_feed_m_s >= of_the_free && designed.worst_feed_m_s < best.worst_feed_m_s);
}

#[test]
fn nothing_feeds_where_friction_holds_all_there_is() {
    let effort = Effort { starts: 4, steps: 200, seed: 1 };
    assert_eq!(goal(&[0.2], 0.0, 0.9 * M).best(4, effort), Ok(None));
}

#[test]
fn bad_goals_are_refused_with_parameter_and_range() {
    let good = goal(&[0.2], 0.05, 4.0 * M);
    let effort = Effort { starts: 0, steps: 0, seed: 0 };
    for (bad, word) in [
        (WaveformGoal { period_s: 0.0, ..good.clone() }, "period_s"),
        (WaveformGoal { slope_rad: 0.3, ..good.clone() }, "slope_rad"),
        (WaveformGoal { frictions: vec![], ..good.clone() }, "frictions"),
        (WaveformGoal { frictions: vec![0.2, -0.1], ..good.clone() }, "friction"),
        (WaveformGoal { slew_s: T30, ..good.clone() }, "slew_s"),
        (WaveformGoal { limits: AxisLimits { max_acceleration: f64::NAN, ..good.limits }, ..good.clone() }, "max_acc"),
        (WaveformGoal { limits: AxisLimits { max_stroke: 0.0, ..good.limits }, ..good.clone() }, "max_stroke"),
    ] {
        let text = bad.best(4, effort).unwrap_err().to_string();
        assert!(text.contains(word) && text.contains("range"), "{text}");
    }
    let tray = tray_goal(Loading::Metered, &[0.2], 2.0, Period::Fixed(T30));
    for (bad, word) in [
        (TrayGoal { rise_min_m: 0.0, ..tray.clone() }, "rise_min_m"),
        (TrayGoal { spacing_parts: f64::NAN, ..tray.clone() }, "spacing_parts"),
        (TrayGoal { kinds: vec![PartKind { length_m: 0.1, frictions: vec![0.2] }], ..tray.clone() }, "length_m"),
        (TrayGoal { ramp_angle_max_rad: 7.0, ..tray.clone() }, "ramp_angle_max_rad"),
    ] {
        let text = bad.best(5, effort, |_| ()).unwrap_err().to_string();
        assert!(text.contains(word) && text.contains("range"), "{text}");
    }
}

/// One lane of 5 mm parts at r = 87.5 mm within the limits of the device.
fn tray_goal(loading: Loading, frictions: &[f64], spacing_parts: f64, period: Period) -> TrayGoal {
    TrayGoal {
        kinds: vec![PartKind { length_m: PART_M, frictions: frictions.to_vec() }],
        spacing_parts,
        loading,
        outer_radius_m: 0.09,
        inner_radius_m: 0.03,
        rise_min_m: 0.01,
        ramp_angle_max_rad: 300_f64.to_radians(),
        period,
        limits: AxisLimits { max_acceleration: 131.0, max_speed: f64::INFINITY, max_stroke: 4_f64.to_radians() },
        gravity_m_s2: G,
    }
}

fn track(tray: TrayGeometry, friction: f64) -> AnnularTrack {
    AnnularTrack::new(tray, Friction::uniform(friction).unwrap(), G).unwrap()
}

/// Parts per minute of the paper's tray and waveform.
fn paper_parts_per_min() -> f64 {
    let waveform = Waveform::stick_slip(Axis::Yaw, T30, 9.0 * M, 66.7 * M).unwrap();
    let flow = lane_flow(&track(TrayGeometry::PAPER, 0.2), &waveform, PART_M, Loading::Queued, 1.0).unwrap().unwrap();
    assert_close(flow.plateau_spacing_parts, 3.93, 0.005, "spacing on the paper's tray");
    flow.parts_per_min
}

/// Designs a tray, checks it against the goal and in two dimensions, and gives its parts per minute over the paper's.
fn times_the_paper(goal: &TrayGoal, effort: Effort) -> f64 {
    let DesignedTray { tray, waveform, flows, parts_per_min, critical_radius_m, .. } =
        goal.best(5, effort, |_| ()).unwrap().unwrap();
    waveform.check(&goal.limits).unwrap();
    assert!(tray.rise_m >= goal.rise_min_m && tray.ramp_angle_rad <= goal.ramp_angle_max_rad);
    assert!(critical_radius_m.is_none_or(|critical_m| critical_m <= tray.inner_radius_m));
    for (flow, &friction) in flows[0].iter().zip(&goal.kinds[0].frictions) {
        assert!(flow.ramp_spacing_parts >= 1.0 && flow.plateau_spacing_parts >= goal.spacing_parts);
        let measured = flow_in_two_dimensions(&track(tray, friction), &waveform, PART_M, flow).unwrap().unwrap();
        assert_close(measured.parts_per_min / flow.parts_per_min, 1.0, 1e-3, "flow in two dimensions");
        // Fewer places of entry are tried: it may come out larger, but not smaller by more than steps and samples make.
        let spacing = measured.plateau_spacing_parts / flow.plateau_spacing_parts;
        assert!((0.999..1.05).contains(&spacing), "spacing in two dimensions over that computed: {spacing}");
    }
    parts_per_min / paper_parts_per_min()
}

#[test]
fn val_the_papers_tray_passes_25_parts_a_minute() {
    assert_close(paper_parts_per_min(), 25.2, 0.05, "parts per minute");
}

/// Designs for cases of spacing, period and the multiple of the paper's parts per minute asked for.
fn beats_the_paper(loading: Loading, frictions: &[f64], cases: &[(f64, Period, f64)]) {
    for &(spacing_parts, period, asked) in cases {
        let effort = Effort { starts: 4, steps: 1000, seed: 7 };
        let times = times_the_paper(&tray_goal(loading, frictions, spacing_parts, period), effort);
        println!("{loading:?}, S = {spacing_parts}, {period:?}, {} frictions: {times:.2} times", frictions.len());
        assert!(times >= asked, "S = {spacing_parts}, {period:?}: {times} times the paper instead of {asked}");
    }
}

const FREE: Period = Period::UpTo(1.0);
const FIXED: Period = Period::Fixed(T30);
const ROBUST: &[f64] = &[0.15, 0.2, 0.25];

#[test]
fn val_trays_for_one_friction_beat_the_paper_by_more_than_asked() {
    let cases = [(2.0, FIXED, 5.0), (2.0, FREE, 17.0), (3.93, FIXED, 2.6), (3.93, FREE, 9.0)];
    beats_the_paper(Loading::Metered, &[0.2], &cases);
}

#[test]
fn val_trays_for_uncertain_friction_beat_the_paper_by_more_than_asked() {
    let cases = [(2.0, FIXED, 4.4), (2.0, FREE, 16.0), (3.93, FIXED, 2.5), (3.93, FREE, 8.5)];
    beats_the_paper(Loading::Metered, ROBUST, &cases);
}

#[test]
fn val_a_tray_for_queued_parts_of_uncertain_friction_beats_the_paper() {
    beats_the_paper(Loading::Queued, ROBUST, &[(3.93, FIXED, 1.2)]);
}
