//! Figs 11 and 12: feed on a slope.

use anyhow::Result;
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::waveform::{Axis, Waveform};

use super::super::chart::{Chart, Series};
use super::super::paper::{MU, SHORT_PERIOD_S};
use super::feed_mm_s;

/// Frictions of the curves.
const FRICTIONS: [f64; 5] = [0.1, 0.2, 0.3, 0.4, 0.5];
/// Slopes of the curves, degrees: 0 to 6 in steps of a tenth.
const SLOPE_STEPS: u32 = 60;

/// The waveform of Fig. 11 at a friction: 0.9 and 4 times μ g.
pub(super) fn fig11_waveform(mu: f64) -> Result<Waveform> {
    let mu_g = mu * STANDARD_GRAVITY_M_S2;
    Ok(Waveform::stick_slip(Axis::X, SHORT_PERIOD_S, 0.9 * mu_g, 4.0 * mu_g)?)
}

/// The waveform of Fig. 12 at a friction: 4 times μ g.
pub(super) fn fig12_waveform(mu: f64, z: f64) -> Result<Waveform> {
    Ok(Waveform::coulomb_pump(Axis::X, SHORT_PERIOD_S, 4.0 * mu * STANDARD_GRAVITY_M_S2, z)?)
}

/// Fig. 11: stick-slip.
pub(super) fn stick_slip() -> Result<Chart> {
    let curves = FRICTIONS.iter().map(|&mu| curve(format!("μ {mu}"), &fig11_waveform(mu)?, mu));
    chart("Fig. 11: stick-slip, 0.9 and 4 times μ g, T 1/30 s", curves.collect::<Result<_>>()?)
}

/// Fig. 12: the Coulomb pump.
pub(super) fn coulomb_pump() -> Result<Chart> {
    let cases = FRICTIONS.iter().map(|&mu| (mu, 0.37)).chain([(MU, 0.5)]);
    let curves = cases.map(|(mu, z)| curve(format!("μ {mu}, z {z}"), &fig12_waveform(mu, z)?, mu));
    chart("Fig. 12: Coulomb pump, 4 times μ g, T 1/30 s", curves.collect::<Result<_>>()?)
}

/// Figs 11 and 12: the slope at which nothing is fed any more, against friction.
pub(super) fn zero_feed_slopes() -> Result<Chart> {
    let frictions = || (2..=10).map(|i| f64::from(i) * 0.05);
    let pump = |z: f64| -> Result<Series> {
        let points = frictions().map(|mu| Ok((mu, zero_feed_slope_deg(&fig12_waveform(mu, z)?, mu)?)));
        Ok(Series::line(format!("Coulomb pump, z {z}"), points.collect::<Result<_>>()?))
    };
    let stick_slip = frictions().map(|mu| Ok((mu, zero_feed_slope_deg(&fig11_waveform(mu)?, mu)?)));
    let rule = frictions().map(|mu: f64| (mu, (mu * 0.37_f64.powi(2)).atan().to_degrees()));
    Ok(Chart {
        title: "Figs 11 and 12: slope at which the feed falls to zero".into(),
        x: "friction μ".into(),
        y: "slope, degrees".into(),
        series: vec![
            Series::line("stick-slip", stick_slip.collect::<Result<_>>()?),
            pump(0.37)?,
            pump(0.5)?,
            Series::dots("atan(μ z²), z 0.37", rule.collect()),
            Series::line("printed for the Coulomb pump: about 3°", vec![(0.1, 3.0), (0.5, 3.0)]),
        ],
    })
}

/// The slope at which the feed falls to zero, degrees.
pub(super) fn zero_feed_slope_deg(waveform: &Waveform, mu: f64) -> Result<f64> {
    let (mut low, mut high) = (0.0, mu.atan().to_degrees());
    while high - low > 1e-9 {
        let middle = f64::midpoint(low, high);
        if feed_mm_s(waveform, mu, middle)? > 1e-9 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(f64::midpoint(low, high))
}

fn curve(name: String, waveform: &Waveform, mu: f64) -> Result<Series> {
    let points = (0..=SLOPE_STEPS).map(|i| {
        let slope_deg = f64::from(i) * 0.1;
        Ok((slope_deg, feed_mm_s(waveform, mu, slope_deg)?))
    });
    Ok(Series::line(name, points.collect::<Result<_>>()?))
}

fn chart(title: &str, series: Vec<Series>) -> Result<Chart> {
    Ok(Chart { title: title.into(), x: "slope, degrees".into(), y: "feed along the slope, mm/s".into(), series })
}
