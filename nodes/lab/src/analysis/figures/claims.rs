//! What becomes of the paper's claims, with the numbers.

use std::fmt::Write;

use anyhow::{Context, Result};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::equations::{
    best_coulomb_pump_z, coulomb_pump_feed_m_s, sliding_stick_slip_feed_m_s, stick_slip_feed_m_s,
};
use feeder_model::mechanics::map::{SurfaceFeed, TrayMap};
use feeder_model::waveform::{Axis, OptimalDesign, Waveform};

use super::super::paper::{
    self, LONG_PERIOD_S, MU, SHORT_PERIOD_S, fig6_waveform, fig8_waveform, fig15_waveform, mu_g,
};
use super::incline::{fig11_waveform, fig12_waveform, zero_feed_slope_deg};
use super::motion::{FIG6_MEASURED_MM_S, FIG6_PRINTED_MM_S, FIG8_MEASURED_MM_S};
use super::{drive, feed_mm_s};

/// What becomes of a claim.
#[derive(Clone, Copy, Debug)]
enum Verdict {
    Reproduced,
    Refuted,
    NotDecidable,
}

struct Claim {
    of: &'static str,
    claim: &'static str,
    verdict: Verdict,
    numbers: String,
}

/// The page.
pub(super) fn page() -> Result<String> {
    let mut page = String::from(
        "# What becomes of the paper's claims\n\n\
         D. Quaid, \"Design and simulation of a miniature mobile parts feeder\". Part = point mass, Coulomb friction, \
         ideal tray motion, g = 9.81 m/s², μ = 0.2 unless said otherwise. \"Printed\" and \"measured\" are the paper's.\n\n\
         | Of | Claim | Verdict | Numbers |\n|---|---|---|---|\n",
    );
    let claims = [
        fig6_printed()?,
        fig6_measured()?,
        eq7_range()?,
        fig8_measured()?,
        eq10()?,
        fig11()?,
        fig12()?,
        critical_radius()?,
        fig15_speeds()?,
        optimal()?,
    ];
    for Claim { of, claim, verdict, numbers } in claims {
        let verdict = match verdict {
            Verdict::Reproduced => "reproduced",
            Verdict::Refuted => "refuted",
            Verdict::NotDecidable => "not decidable",
        };
        writeln!(page, "| {of} | {claim} | {verdict} | {numbers} |")?;
    }
    page.push_str(
        "\nCorrected on the way: Eq. 7 beyond a_min = μ g; the steady state of the Coulomb pump beyond z*; the signs and \
         missing factors of Eqs 11–17, 21, 23, 24, 28 and 29. The corrected forms are in the documentation of \
         `feeder_model::mechanics`. Fig. 13 is drawn here as the running surface of the tray.\n",
    );
    Ok(page)
}

/// The friction at which Eq. 7 gives a speed for the waveform of Fig. 6.
fn fig6_friction_for(mm_s: f64) -> Result<f64> {
    // Feed falls with friction once a_min ≤ μ g.
    let (mut low, mut high) = (1.6 / G, 1.0);
    while high - low > 1e-12 {
        let middle = f64::midpoint(low, high);
        let feed = stick_slip_feed_m_s(LONG_PERIOD_S, 1.6, 10.1, &Friction::uniform(middle)?, G);
        if feed.is_none_or(|feed| feed * 1e3 > mm_s) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}

fn fig6_printed() -> Result<Claim> {
    let model = feed_mm_s(&fig6_waveform()?, MU, 0.0)?;
    Ok(Claim {
        of: "Fig. 6, Eq. 7",
        claim: "stick-slip feeds 11.8 mm/s by Eq. 7",
        verdict: Verdict::Refuted,
        numbers: format!(
            "Eq. 7 and the exact engine give {model:.3} mm/s; {FIG6_PRINTED_MM_S} needs μ = {:.4}",
            fig6_friction_for(FIG6_PRINTED_MM_S)?
        ),
    })
}

fn fig6_measured() -> Result<Claim> {
    let model = feed_mm_s(&fig6_waveform()?, MU, 0.0)?;
    Ok(Claim {
        of: "Fig. 6",
        claim: "theory agrees with the measured 12.4 mm/s",
        verdict: Verdict::Reproduced,
        numbers: format!(
            "{model:.3} mm/s; {FIG6_MEASURED_MM_S} is μ = {:.3}, nearer than friction is known",
            fig6_friction_for(FIG6_MEASURED_MM_S)?
        ),
    })
}

fn eq7_range() -> Result<Claim> {
    let (a_min, a_max, friction) = (2.2, 10.1, Friction::uniform(MU)?);
    let exact = feed_mm_s(&Waveform::stick_slip(Axis::X, LONG_PERIOD_S, a_min, a_max)?, MU, 0.0)?;
    let eq7 = LONG_PERIOD_S * a_min / 2.0 * (1.0 / (1.0 + a_min / a_max) - 1.0 / (1.0 + a_min / mu_g())) * 1e3;
    let right =
        sliding_stick_slip_feed_m_s(LONG_PERIOD_S, a_min, a_max, &friction, G).context("a_min is beyond μ g")?;
    Ok(Claim {
        of: "Eq. 7",
        claim: "mean feed of stick-slip (no range stated)",
        verdict: Verdict::Refuted,
        numbers: format!(
            "right for a_min ≤ μ g only: at a_min {a_min} m/s² it gives {eq7:.2} mm/s, the engine {exact:.2}, \
             (m T/4)(a_max − a_min)/(a_max + a_min) {:.2}",
            right * 1e3
        ),
    })
}

fn fig8_measured() -> Result<Claim> {
    let model = feed_mm_s(&fig8_waveform()?, MU, 0.0)?;
    let drive = drive(&fig8_waveform()?, MU, 0.0)?;
    let means = drive.cycle_means_m_s(drive.world_rest_m_s(), 5);
    let means: Vec<String> = means.iter().map(|m_s| format!("{:.2}", m_s * 1e3)).collect();
    let friction = Friction::uniform(MU)?;
    let z = best_coulomb_pump_z(10.3, &friction, G);
    let most = coulomb_pump_feed_m_s(LONG_PERIOD_S, 10.3, z, &friction, G).context("the amplitude is beyond μ g")?;
    Ok(Claim {
        of: "Fig. 8",
        claim: "the Coulomb pump was measured at 22.5 mm/s",
        verdict: Verdict::NotDecidable,
        numbers: format!(
            "an ideal tray gives {model:.3} mm/s (cycle means {} mm/s) and at most {:.2} at any z; {FIG8_MEASURED_MM_S} is \
             out of its reach, but not out of that of a tray with tracking error",
            means.join(", "),
            most * 1e3
        ),
    })
}

fn eq10() -> Result<Claim> {
    let model = feed_mm_s(&fig8_waveform()?, MU, 0.0)?;
    let z = best_coulomb_pump_z(10.3, &Friction::uniform(MU)?, G);
    Ok(Claim {
        of: "Eq. 10",
        claim: "the Coulomb pump settles at a T z²/4",
        verdict: Verdict::Reproduced,
        numbers: format!(
            "{model:.6} mm/s against {:.6}; exact up to z* = ½(1 − μ g/a) = {z:.4}, too fast beyond",
            10.3 * LONG_PERIOD_S * 0.37_f64.powi(2) / 4.0 * 1e3
        ),
    })
}

fn fig11() -> Result<Claim> {
    let speeds = (0..=5).map(|deg| Ok(format!("{:.2}", feed_mm_s(&fig11_waveform(MU)?, MU, f64::from(deg))?)));
    let speeds = speeds.collect::<Result<Vec<_>>>()?;
    let zeros = [0.1, 0.2, 0.3, 0.4, 0.5].map(|mu| zero_feed_slope_deg(&fig11_waveform(mu)?, mu));
    let zeros = zeros.into_iter().map(|deg| Ok(format!("{:.2}", deg?))).collect::<Result<Vec<_>>>()?;
    Ok(Claim {
        of: "Fig. 11",
        claim: "stick-slip climbs slopes of several degrees",
        verdict: Verdict::Reproduced,
        numbers: format!("μ 0.2, 0–5°: {} mm/s; zero feed at {}° for μ 0.1–0.5", speeds.join(", "), zeros.join(", ")),
    })
}

fn fig12() -> Result<Claim> {
    let at = |z: f64, mu: f64| zero_feed_slope_deg(&fig12_waveform(mu, z)?, mu);
    Ok(Claim {
        of: "Fig. 12",
        claim: "the Coulomb pump stops feeding at about 3°",
        verdict: Verdict::NotDecidable,
        numbers: format!(
            "true for z 0.37 at μ 0.5 ({:.2}°) or z 0.5 at μ 0.2 ({:.2}°), not for z 0.37 at μ 0.2 ({:.2}°); \
             about atan(μ z²)",
            at(0.37, 0.5)?,
            at(0.5, 0.2)?,
            at(0.37, 0.2)?
        ),
    })
}

fn critical_radius() -> Result<Claim> {
    let (track, waveform) = (paper::tray(MU)?, fig15_waveform()?);
    let map = TrayMap::new(&track, &waveform)?;
    let critical_m = map.critical_radius_m()?.context("the paper's tray has one")?;
    let tray = track.tray();
    let (inner, outer) = (tray.inner_radius_m, tray.outer_radius_m);
    let share = (critical_m * critical_m - inner * inner) / (outer * outer - inner * inner);
    let drift_um_s = map.at(0.05)?.ramp.map_or(f64::NAN, |ramp| ramp.radial_drift_m_s * 1e6);
    Ok(Claim {
        of: "Fig. 15",
        claim: "the simulated tray works: parts climb the ramp",
        verdict: Verdict::Reproduced,
        numbers: format!(
            "outside {:.1} mm only; inside, on {:.0} % of the tray's area, parts slide back, below {:.1} mm even with the \
             tray at rest, and a drift of {drift_um_s:.1} µm/s (r 50 mm) does not bring them out",
            critical_m * 1e3,
            share * 100.0,
            tray.pitch_m_per_rad() / MU * 1e3
        ),
    })
}

fn fig15_speeds() -> Result<Claim> {
    let (track, waveform) = (paper::tray(MU)?, fig15_waveform()?);
    let map = TrayMap::new(&track, &waveform)?;
    let mm_s = |feed: Option<SurfaceFeed>| feed.map_or(f64::NAN, |feed| feed.steady.feed_m_s * 1e3);
    let mut numbers = String::new();
    for radius_m in [0.06, 0.08, 0.09] {
        let feed = map.at(radius_m)?;
        let ratio = mm_s(feed.plateau) / mm_s(feed.ramp);
        write!(
            numbers,
            "r {:.0} mm: ramp {:.3}, plateau {:.2} mm/s, ratio {ratio:.1}; ",
            radius_m * 1e3,
            mm_s(feed.ramp),
            mm_s(feed.plateau)
        )?;
    }
    numbers.push_str("plateau and ramp differ most where the ramp hardly feeds");
    Ok(Claim {
        of: "Fig. 15",
        claim: "parts travel faster on the plateau than on the ramp, which separates them",
        verdict: Verdict::Reproduced,
        numbers,
    })
}

fn optimal() -> Result<Claim> {
    let design = OptimalDesign { friction: MU, slope_rad: 0.0, gravity_m_s2: G, limit_m_s2: 4.0 * mu_g() };
    let best = design.best_feed_m_s(SHORT_PERIOD_S)? * 1e3;
    let stick_slip = feed_mm_s(&fig11_waveform(MU)?, MU, 0.0)?;
    let friction = Friction::uniform(MU)?;
    let z = best_coulomb_pump_z(design.limit_m_s2, &friction, G);
    let pump = coulomb_pump_feed_m_s(SHORT_PERIOD_S, design.limit_m_s2, z, &friction, G)
        .context("the amplitude is beyond μ g")?;
    Ok(Claim {
        of: "Discussion",
        claim: "the optimal waveform is an open problem",
        verdict: Verdict::Refuted,
        numbers: format!(
            "solved: stick at a_s, then −A, then +A; flat, A = 4 μ g, T 1/30 s: {best:.2} mm/s against {stick_slip:.2} (stick-slip) \
             and {:.2} (best Coulomb pump)",
            pump * 1e3
        ),
    })
}
