//! The exact one-dimensional engine against theory (`verif_`) and against the reference tables (`val_`).
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod bisect;
mod reference;

use std::f64::consts::FRAC_PI_2;

use bisect::bisect;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::equations::{
    best_coulomb_pump_z, coulomb_pump_feed_m_s, sliding_stick_slip_feed_m_s, stick_slip_feed_m_s,
};
use feeder_model::mechanics::slope::{Drive, LinearTrack, Steady};
use feeder_model::waveform::{Axis, OptimalDesign, Segment, Waveform};
use proptest::prelude::*;
use reference::{assert_close, table};

const T30: f64 = 1.0 / 30.0;

fn friction(mu: f64) -> Friction {
    Friction::uniform(mu).unwrap()
}

fn drive(waveform: &Waveform, mu: f64, slope_deg: f64) -> Drive {
    LinearTrack::new(friction(mu), slope_deg.to_radians(), G).unwrap().drive(waveform, 1.0).unwrap()
}

fn steady(waveform: &Waveform, mu: f64, slope_deg: f64) -> Option<Steady> {
    drive(waveform, mu, slope_deg).steady()
}

/// Steady feed in mm/s; NaN where there is none.
fn feed_mm_s(waveform: &Waveform, mu: f64, slope_deg: f64) -> f64 {
    steady(waveform, mu, slope_deg).map_or(f64::NAN, |s| s.feed_m_s * 1e3)
}

fn stick_slip(period_s: f64, a_min: f64, a_max: f64) -> Waveform {
    Waveform::stick_slip(Axis::X, period_s, a_min, a_max).unwrap()
}

fn pump(period_s: f64, a: f64, z: f64) -> Waveform {
    Waveform::coulomb_pump(Axis::X, period_s, a, z).unwrap()
}

/// The waveform of Figs 11 and 12 at a friction: 0.9 and 4 times μ g, T = 1/30 s.
fn fig11(mu: f64) -> Waveform {
    stick_slip(T30, 0.9 * mu * G, 4.0 * mu * G)
}

/// Slope at which the feed falls to zero, degrees.
fn zero_feed_slope_deg(waveform: &Waveform, mu: f64) -> f64 {
    // A standstill counts as zero feed; 1e-9 mm/s is rounding.
    bisect(0.0, 20.0, |slope_deg| feed_mm_s(waveform, mu, slope_deg) > 1e-9)
}

/// The tables print about 12 significant digits of speeds of the order of 10 mm/s.
const TABLE_MM_S: f64 = 1e-9;

#[test]
fn val_fig6_stick_slip_and_its_scans() {
    let mut rows = 0;
    for row in table(include_str!("data/fig6_fig8.csv")) {
        let (key, value) = (row.text("key").to_owned(), row.number("value"));
        let number = || key.parse::<f64>().unwrap();
        let (got, tolerance) = match row.text("case") {
            "fig6" if key == "sim mm/s" => (feed_mm_s(&stick_slip(0.05, 1.6, 10.1), 0.2, 0.0), TABLE_MM_S),
            "fig6 mu scan" => (feed_mm_s(&stick_slip(0.05, 1.6, 10.1), number(), 0.0), TABLE_MM_S),
            "fig6 amin scan mu=.2" => (feed_mm_s(&stick_slip(0.05, number(), 10.1), 0.2, 0.0), TABLE_MM_S),
            "fig6 amax scan mu=.2" => (feed_mm_s(&stick_slip(0.05, 1.6, number()), 0.2, 0.0), TABLE_MM_S),
            "fig8" if key == "sim equilibrium" => (feed_mm_s(&pump(0.05, 10.3, 0.37), 0.2, 0.0), TABLE_MM_S),
            "fig8" if key.starts_with("validity") => (best_coulomb_pump_z(10.3, &friction(0.2), G), 1e-12),
            // The table converged to the equilibrium by waiting: it is off by up to 1e-8.
            "fig8 mu scan" => (feed_mm_s(&pump(0.05, 10.3, 0.37), number(), 0.0), 1e-7),
            _ => continue,
        };
        rows += 1;
        assert_close(got, value, tolerance, &format!("{} {key}", row.text("case")));
    }
    assert_eq!(rows, 26, "rows of the table that were looked at");
}

#[test]
fn verif_fig6_friction_that_would_explain_the_printed_and_the_measured_speed() {
    // Physics: the paper prints 11.8 mm/s, which is μ = 0.2147, and measured 12.4, which is μ = 0.202 (Eq. 7).
    for (mu, mm_s) in [(0.214_661_564_882_727_33, 11.8), (0.201_978_006_848_007_03, 12.4)] {
        let by_equation = stick_slip_feed_m_s(0.05, 1.6, 10.1, &friction(mu), G).unwrap() * 1e3;
        assert_close(by_equation, mm_s, 1e-9, "Eq. 7");
    }
}

#[test]
fn val_fig8_cycle_means_from_rest_in_the_world_and_on_the_tray() {
    let drive = drive(&pump(0.05, 10.3, 0.37), 0.2, 0.0);
    for (case, start) in [("fig8 transient world-rest", drive.world_rest_m_s()), ("fig8 transient tray-rest", 0.0)] {
        let means = drive.cycle_means_m_s(start, 20);
        let expected = table(include_str!("data/fig6_fig8.csv")).filter(|row| row.text("case") == case);
        let mut compared = 0;
        for (mean, row) in means.iter().zip(expected) {
            assert_close(mean * 1e3, row.number("value"), TABLE_MM_S, case);
            compared += 1;
        }
        assert_eq!(compared, 20);
    }
}

#[test]
fn verif_fig8_distance_to_equilibrium_contracts_as_derived() {
    let (a, m) = (10.3, 0.2 * G);
    let drive = drive(&pump(0.05, a, 0.37), 0.2, 0.0);
    let equilibrium = drive.steady().unwrap().start_m_s;
    let mut w = drive.world_rest_m_s();
    for _ in 0..6 {
        let next = drive.run(w, |_| ());
        let ratio = (next - equilibrium) / (w - equilibrium);
        // The distance shrinks to 1 % of 0.1 m/s, known to 1e-17 or so.
        assert_close(ratio, ((a - m) / (a + m)).powi(2), 1e-11, "contraction per cycle");
        w = next;
    }
}

#[test]
fn val_fig11_feeds_and_zero_crossings() {
    for (slope_deg, mm_s) in [(0.0, 8.54), (1.0, 7.87), (2.0, 5.60), (3.0, 3.00), (4.0, 0.23), (5.0, -2.69)] {
        // Two decimals are given.
        assert_close(feed_mm_s(&fig11(0.2), 0.2, slope_deg), mm_s, 0.005, "Fig. 11");
    }
    for (mu, deg) in [(0.1, 2.10), (0.2, 4.08), (0.3, 5.83), (0.4, 7.27), (0.5, 8.40)] {
        assert_close(zero_feed_slope_deg(&fig11(mu), mu), deg, 0.005, "zero-feed slope");
    }
}

#[test]
fn val_fig11_and_fig12_grid() {
    for row in table(include_str!("data/fig11_fig12_grid.csv")) {
        let (mu, slope_deg) = (row.number("mu"), row.number("slope_deg"));
        let waveform = match row.text("waveform") {
            "stickslip" => fig11(mu),
            _ => pump(T30, 4.0 * mu * G, row.number("z")),
        };
        let what = format!("{} z {} μ {mu} {slope_deg}°", row.text("waveform"), row.text("z"));
        let drive = drive(&waveform, mu, slope_deg);
        assert_close(drive.min_normal_over_weight(), row.number("Nmin_over_g"), 1e-12, &what);
        let steady = drive.steady();
        let speed = |s: Steady| s.feed_m_s * 1e3;
        // The table waited for its steady state: it stopped at a residual of up to 1e-8 of μ g T.
        let tolerance = 1e-6 * mu * G * T30 * 1e3;
        assert_close(steady.map_or(f64::NAN, speed), row.number("feed_slope_mm_s"), tolerance, &what);
        if let Some(steady) = steady {
            assert_close(steady.stick_fraction, row.number("stick_frac"), 1e-6, &what);
            assert_close(-steady.slip_back_m * 1e3, row.number("slipback_mm_cycle"), 1e-6, &what);
        }
    }
}

#[test]
fn val_fig12_zero_crossings() {
    for row in table(include_str!("data/fig12_zero_cross.csv")) {
        let mu = row.number("mu");
        let (waveform, what) = match row.text("waveform") {
            "stickslip" => (fig11(mu), format!("stick-slip μ {mu}")),
            _ => (pump(T30, 4.0 * mu * G, row.number("z")), format!("pump z {} μ {mu}", row.text("z"))),
        };
        assert_close(zero_feed_slope_deg(&waveform, mu), row.number("zero_cross_slope_deg"), 1e-5, &what);
    }
}

#[test]
fn verif_coulomb_pump_stalls_near_atan_mu_z_squared() {
    // The rule is first order in μ; the paper's "about 3°" in Fig. 12 is z = 0.37 at μ = 0.5 or z = 0.5 at μ = 0.2.
    for (z, mu, exact_deg) in [(0.37, 0.5, 2.942), (0.5, 0.2, 2.732)] {
        assert_close(zero_feed_slope_deg(&pump(T30, 4.0 * mu * G, z), mu), exact_deg, 5e-4, "about 3°");
    }
    for z in [0.2_f64, 0.3, 0.37] {
        let excess =
            |mu: f64| (mu * z * z).atan().to_degrees() / zero_feed_slope_deg(&pump(T30, 4.0 * mu * G, z), mu) - 1.0;
        assert!(excess(0.2) < 0.06, "z {z}: {}", excess(0.2));
        // Vanishes with μ, and at least in proportion.
        assert!(excess(0.02) < excess(0.2) / 10.0, "z {z}: {}", excess(0.02));
    }
}

#[test]
fn val_optimal_waveform_table() {
    for row in table(include_str!("data/optimal_waveform.csv")) {
        let (mu, slope_deg) = (0.2, row.number("slope_deg"));
        let design = OptimalDesign {
            friction: mu,
            slope_rad: slope_deg.to_radians(),
            gravity_m_s2: G,
            limit_m_s2: row.number("A_over_mug") * mu * G,
        };
        let what = format!("A {} slope {slope_deg}", row.text("A_over_mug"));
        let waveform = Waveform::optimal(Axis::X, T30, &design).unwrap();
        assert_close(feed_mm_s(&waveform, mu, slope_deg), row.number("v_mm_s_T1_30_mu.2"), TABLE_MM_S, &what);
        assert_close(waveform.stroke() * 1e3, row.number("stroke_mm"), 1e-9, &what);
        assert_close(waveform.peak_speed() * 1e3, row.number("vpeak_mm_s"), 1e-9, &what);
    }
}

#[test]
fn val_slew_limited_table() {
    let m = 0.2 * G;
    let ramp_deg = 4.046;
    let optimal = |slope_deg: f64, limit_m_s2: f64| {
        let design = OptimalDesign { friction: 0.2, slope_rad: slope_deg.to_radians(), gravity_m_s2: G, limit_m_s2 };
        Waveform::optimal(Axis::X, T30, &design).unwrap()
    };
    let mut rows = 0;
    for row in table(include_str!("data/slew_limited.csv")) {
        let (waveform, slope_deg) = match row.text("waveform") {
            "SS fig6" => (stick_slip(0.05, 1.6, 10.1), 0.0),
            "CP fig8" => (pump(0.05, 10.3, 0.37), 0.0),
            "SS T=1/30 .9/6 flat" => (stick_slip(T30, 0.9 * m, 6.0 * m), 0.0),
            "hybrid T=1/30 A=6 flat" => (optimal(0.0, 6.0 * m), 0.0),
            "SS paper ramp r=90" => (stick_slip(T30, 0.81 * m, 6.003 * m), ramp_deg),
            "hybrid ramp r=90" => (optimal(ramp_deg, 6.003 * m), ramp_deg),
            _ => continue,
        };
        rows += 1;
        let slew_s = row.number("slew_ms") * 1e-3;
        let waveform = if slew_s > 0.0 { waveform.slew_limited(slew_s, 64).unwrap() } else { waveform };
        let feed = feed_mm_s(&waveform, 0.2, slope_deg);
        // Both sides write the ramps as staircases, each with an error of second order in the tread.
        assert_close(feed / row.number("feed_mm_s"), 1.0, 5e-4, &format!("{} at {slew_s} s", row.text("waveform")));
    }
    assert_eq!(rows, 30);
}

#[test]
fn val_conditioning_table() {
    let m = 0.2 * G;
    for row in table(include_str!("data/conditioning.csv")) {
        // ln of the feed with μ, g and the slope multiplied by the given factors.
        let log_feed = |mu: f64, gravity: f64, slope: f64| {
            let (waveform, slope_deg) = match row.text("case") {
                "SS flat .9/4" => (stick_slip(T30, 0.9 * m, 4.0 * m), 0.0),
                "CP flat z.37 A=4" => (pump(T30, 4.0 * m, 0.37), 0.0),
                "SS ramp4.05 r90 (.81/6)" => (stick_slip(T30, 0.81 * m, 6.003 * m), 4.046),
                _ => {
                    let slope_rad = 4.046_f64.to_radians();
                    let design = OptimalDesign { friction: 0.2, slope_rad, gravity_m_s2: G, limit_m_s2: 6.003 * m };
                    (Waveform::optimal(Axis::X, T30, &design).unwrap(), 4.046)
                }
            };
            let track = LinearTrack::new(friction(0.2 * mu), f64::to_radians(slope_deg * slope), G * gravity).unwrap();
            track.drive(&waveform, 1.0).unwrap().steady().unwrap().feed_m_s.ln()
        };
        let h = 1e-3;
        let slope_of = |log_feed: &dyn Fn(f64) -> f64| (log_feed(1.0 + h) - log_feed(1.0 - h)) / (2.0 * h);
        let got = match row.text("p") {
            "mu" => slope_of(&|k| log_feed(k, 1.0, 1.0)),
            "g" => slope_of(&|k| log_feed(1.0, k, 1.0)),
            _ => slope_of(&|k| log_feed(1.0, 1.0, k)),
        };
        // The optimal waveform has a kink at its design point, which each difference quotient sees differently.
        let expected = row.number("dlnv_dlnp");
        let what = format!("{} by {}", row.text("case"), row.text("p"));
        assert_close(got, expected, 4e-3 * expected.abs() + 1e-9, &what);
    }
}

#[test]
fn verif_longer_sliding_has_its_own_closed_form() {
    for (a_min, a_max) in [(2.0, 10.1), (2.5, 4.0), (7.0, 20.0)] {
        let expected = sliding_stick_slip_feed_m_s(0.05, a_min, a_max, &friction(0.2), G).unwrap();
        let steady = steady(&stick_slip(0.05, a_min, a_max), 0.2, 0.0).unwrap();
        assert_close(steady.feed_m_s / expected, 1.0, 1e-9, "a_min beyond μ g");
        assert_close(steady.stick_fraction, 0.0, 0.0, "it never sticks");
        assert!(stick_slip_feed_m_s(0.05, a_min, a_max, &friction(0.2), G).is_none(), "Eq. 7 does not hold");
    }
}

#[test]
fn verif_no_steady_motion_beyond_the_friction_angle() {
    let angle_deg = 0.2_f64.atan().to_degrees();
    assert!(steady(&fig11(0.2), 0.2, angle_deg - 0.01).is_some());
    assert!(steady(&fig11(0.2), 0.2, angle_deg + 0.01).is_none());
    assert!(steady(&fig11(0.2), 0.2, -angle_deg - 0.01).is_none());
}

#[test]
fn a_tray_that_drops_away_is_refused_with_the_reason() {
    let waveform = stick_slip(0.05, 20.0, 30.0);
    let error = LinearTrack::new(friction(0.2), 0.5, G).unwrap().drive(&waveform, 1.0).unwrap_err();
    assert!(error.to_string().contains("leaves the tray"), "{error}");
    for slope_rad in [FRAC_PI_2, f64::NAN, -2.0] {
        assert!(LinearTrack::new(friction(0.2), slope_rad, G).unwrap_err().to_string().contains("slope_rad"));
    }
}

#[test]
fn regress_a_speed_too_small_to_be_multiplied_still_turns_round() {
    // A segment of 5e-324 s leaves w at −5e-324 m/s, from where the next one pushes the part uphill, through rest.
    let waveform = |first_s: f64| {
        let pairs = [(first_s, 4.0), (0.05, -6.5), (0.01, 30.0), (0.0125, 2.0)];
        let segments = pairs.map(|(duration_s, acceleration)| Segment { duration_s, acceleration });
        Waveform::new(Axis::X, segments.to_vec()).unwrap()
    };
    let feed = |first_s: f64| steady(&waveform(first_s), 0.42, 8.0).unwrap().feed_m_s;
    assert_close(feed(5e-324), feed(1e-13), 1e-9, "feed");
}

/// Any closed waveform of 2 to 6 segments, up to 20 m/s².
fn any_waveform() -> impl Strategy<Value = Waveform> {
    prop::collection::vec((1e-3..0.02_f64, -10.0..10.0_f64), 2..7).prop_map(|raw| {
        let period_s: f64 = raw.iter().map(|r| r.0).sum();
        let mean: f64 = raw.iter().map(|r| r.0 * r.1).sum::<f64>() / period_s;
        transform(raw.iter().map(|r| Segment { duration_s: r.0, acceleration: r.1 - mean }), 1.0, 1.0)
    })
}

/// Segments with time and acceleration multiplied.
fn transform(segments: impl IntoIterator<Item = Segment>, time: f64, acceleration: f64) -> Waveform {
    let segments = segments
        .into_iter()
        .map(|s| Segment { duration_s: s.duration_s * time, acceleration: s.acceleration * acceleration });
    Waveform::new(Axis::X, segments.collect()).unwrap()
}

fn steady_on(waveform: &Waveform, friction: Friction, slope_rad: f64, gravity: f64) -> Steady {
    LinearTrack::new(friction, slope_rad, gravity).unwrap().drive(waveform, 1.0).unwrap().steady().unwrap()
}

prop_compose! {
    /// A friction, and a slope within 0.9 of its angle.
    fn any_track()(kinetic in 0.05..0.6_f64, excess in prop_oneof![Just(1.0), 1.0..1.5_f64], share in -0.9..0.9_f64) -> (Friction, f64) {
        (Friction::new(kinetic * excess, kinetic).unwrap(), share * kinetic.atan())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn verif_stick_slip_equals_equation_7(period_s in 0.005..0.2_f64, mu in 0.05..1.0_f64, low in 0.05..1.0_f64, high in 1.01..8.0_f64) {
        let (a_min, a_max) = (low * mu * G, high * mu * G);
        let expected = stick_slip_feed_m_s(period_s, a_min, a_max, &friction(mu), G).unwrap();
        let feed = steady(&stick_slip(period_s, a_min, a_max), mu, 0.0).unwrap().feed_m_s;
        prop_assert!((feed - expected).abs() < 1e-9 * mu * G * period_s, "{feed} {expected}");
    }

    #[test]
    fn verif_coulomb_pump_equals_equation_10_and_its_extension(period_s in 0.005..0.2_f64, mu in 0.05..1.0_f64, high in 1.05..8.0_f64, z in 0.02..0.98_f64) {
        let a = high * mu * G;
        let expected = coulomb_pump_feed_m_s(period_s, a, z, &friction(mu), G).unwrap();
        let feed = steady(&pump(period_s, a, z), mu, 0.0).unwrap().feed_m_s;
        prop_assert!((feed - expected).abs() < 1e-9 * mu * G * period_s, "{feed} {expected}");
    }

    #[test]
    fn verif_optimal_waveform_reaches_its_speed(period_s in 0.005..0.2_f64, mu in 0.05..0.8_f64, share in -0.9..0.9_f64, excess in 1.05..6.0_f64) {
        let slope_rad = share * mu.atan().min(FRAC_PI_2 - mu.atan());
        let limit_m_s2 = excess * G * (mu.atan() + slope_rad.abs()).tan();
        prop_assume!(limit_m_s2 < G / slope_rad.abs().tan());
        let design = OptimalDesign { friction: mu, slope_rad, gravity_m_s2: G, limit_m_s2 };
        let waveform = Waveform::optimal(Axis::X, period_s, &design).unwrap();
        let expected = design.best_feed_m_s(period_s).unwrap();
        let feed = steady_on(&waveform, friction(mu), slope_rad, G).feed_m_s;
        prop_assert!((feed - expected).abs() < 1e-9 * limit_m_s2 * period_s, "{feed} {expected}");
    }

    #[test]
    fn verif_steady_motion_repeats_and_is_what_waiting_gives(waveform in any_waveform(), (friction, slope_rad) in any_track()) {
        let drive = LinearTrack::new(friction, slope_rad, G).unwrap().drive(&waveform, 1.0).unwrap();
        let steady = drive.steady().unwrap();
        prop_assert!((drive.run(steady.start_m_s, |_| ()) - steady.start_m_s).abs() < 1e-13);
        // Waiting converges linearly; 3000 periods are enough unless friction is weak against the vibration.
        let waited = *drive.cycle_means_m_s(0.0, 3000).last().unwrap();
        prop_assert!((waited - steady.feed_m_s).abs() < 1e-6, "{waited} {}", steady.feed_m_s);
    }

    #[test]
    fn verif_feed_scales_with_time_and_gravity_and_mirrors(waveform in any_waveform(), (friction, slope_rad) in any_track(), k in 0.2..5.0_f64) {
        let feed = steady_on(&waveform, friction, slope_rad, G).feed_m_s;
        let tolerance = 1e-9 * (1.0 + k);
        let slower = steady_on(&transform(waveform.segments().to_vec(), k, 1.0), friction, slope_rad, G).feed_m_s;
        prop_assert!((slower - k * feed).abs() < tolerance, "T → kT: {slower} {}", k * feed);
        let heavier = steady_on(&transform(waveform.segments().to_vec(), 1.0, k), friction, slope_rad, k * G).feed_m_s;
        prop_assert!((heavier - k * feed).abs() < tolerance, "g, a → kg, ka: {heavier} {}", k * feed);
        let mirrored = steady_on(&transform(waveform.segments().to_vec(), 1.0, -1.0), friction, -slope_rad, G).feed_m_s;
        prop_assert!((mirrored + feed).abs() < tolerance, "mirror: {mirrored} {feed}");
    }

    #[test]
    fn verif_friction_never_adds_energy(waveform in any_waveform(), (friction, slope_rad) in any_track(), start in -0.3..0.3_f64) {
        let drive = LinearTrack::new(friction, slope_rad, G).unwrap().drive(&waveform, 1.0).unwrap();
        let (mut phases, mut at_s) = (Vec::new(), 0.0);
        drive.run(start, |phase| {
            phases.push((at_s, phase));
            at_s += phase.duration_s;
        });
        prop_assert!((at_s - waveform.period_s()).abs() < 1e-12);
        for (at_s, phase) in phases {
            let a = waveform.state_at(at_s + phase.duration_s / 2.0).acceleration;
            let (sin, cos) = slope_rad.sin_cos();
            let work = -(G * sin + a * cos) * phase.distance_m();
            let gained = (phase.to_m_s.powi(2) - phase.from_m_s.powi(2)) / 2.0;
            prop_assert!(gained <= work + 1e-12, "friction put in {}", gained - work);
        }
    }

    #[test]
    fn verif_no_waveform_beats_the_bound(waveform in any_waveform(), mu in 0.05..0.5_f64, share in 0.0..0.9_f64) {
        let slope_rad = share * mu.atan();
        let limit_m_s2 = waveform.peak_acceleration();
        let design = OptimalDesign { friction: mu, slope_rad, gravity_m_s2: G, limit_m_s2 };
        if let Ok(bound) = design.best_feed_m_s(waveform.period_s()) {
            let feed = steady_on(&waveform, friction(mu), slope_rad, G).feed_m_s;
            prop_assert!(feed <= bound * (1.0 + 1e-9) , "{feed} > {bound}");
        }
    }
}
