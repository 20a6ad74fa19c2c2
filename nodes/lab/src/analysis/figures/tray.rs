//! Figs 13 and 15: the annular tray, and parts on it.

use std::f64::consts::TAU;

use anyhow::Result;
use feeder_model::mechanics::annular::PartState;
use feeder_model::mechanics::map::{RadiusFeed, SurfaceFeed, TrayMap};
use feeder_model::tray::TrayGeometry;

use super::super::chart::{Chart, Series};
use super::super::paper::{self, MU, SHORT_PERIOD_S, fig15_waveform};

/// Samples per period when parts are moved.
const SAMPLES: u32 = 400;
/// Time after which Fig. 15 shows the parts, s.
const SHOWN_S: f64 = 5.0;

/// Fig. 13: the running surface of the tray unrolled at three radii.
pub(super) fn running_surface() -> Result<Chart> {
    let tray = TrayGeometry::PAPER;
    let at = |radius_m: f64| {
        let points = (0..=720).map(|i| f64::from(i) * TAU / 720.0).filter(|&angle_rad| angle_rad < TAU);
        let points = points.map(|angle_rad| (radius_m * angle_rad * 1e3, tray.height_m(angle_rad) * 1e3)).collect();
        let slope_deg = tray.ramp_slope_rad(radius_m).to_degrees();
        Series::line(format!("r {:.0} mm, slope {slope_deg:.2}°", radius_m * 1e3), points)
    };
    Ok(Chart {
        title: "Fig. 13: height of the running surface along the track".into(),
        x: "arc from the foot of the ramp, mm".into(),
        y: "height, mm".into(),
        series: vec![at(0.03), at(0.06), at(0.09)],
    })
}

/// Fig. 15: speeds on ramp and plateau against the radius.
pub(super) fn speed_against_radius() -> Result<Chart> {
    let (track, waveform) = (paper::tray(MU)?, fig15_waveform()?);
    let map = TrayMap::new(&track, &waveform)?;
    let radii_m = (0..=120).map(|i| 0.03 + 0.06 * f64::from(i) / 120.0);
    let feeds = radii_m.map(|radius_m| Ok(map.at(radius_m)?)).collect::<Result<Vec<RadiusFeed>>>()?;
    let curve = |surface: fn(&RadiusFeed) -> Option<SurfaceFeed>| {
        feeds
            .iter()
            .filter_map(|feed| Some((feed.radius_m * 1e3, surface(feed)?.steady.feed_m_s * 1e3)))
            .filter(|&(_, mm_s)| mm_s > -10.0)
            .collect()
    };
    let mut series =
        vec![Series::line("ramp", curve(|feed| feed.ramp)), Series::line("plateau", curve(|feed| feed.plateau))];
    if let Some(critical_m) = map.critical_radius_m()? {
        let mm = critical_m * 1e3;
        series.push(Series::line(format!("critical radius, {mm:.1} mm"), vec![(mm, -10.0), (mm, 10.0)]));
    }
    Ok(Chart {
        title: "Fig. 15: speed along the track against the radius".into(),
        x: "radius, mm".into(),
        y: "speed relative to the tray, mm/s".into(),
        series,
    })
}

/// Fig. 15: an array of parts at rest, and five seconds later.
pub(super) fn parts_after_five_seconds() -> Result<Chart> {
    let (track, waveform) = (paper::tray(MU)?, fig15_waveform()?);
    let samples = waveform.samples(SAMPLES);
    let start: Vec<PartState> = (3..=9)
        .flat_map(|r| (0..12).map(move |i| PartState::at_rest(f64::from(r) * 0.01, f64::from(i) * TAU / 12.0)))
        .collect();
    let mut parts = start.clone();
    let periods = (SHOWN_S / SHORT_PERIOD_S).round();
    for _ in (0u32..).map(f64::from).take_while(|&i| i < periods) {
        for (motion, sample_s) in &samples {
            for part in &mut parts {
                track.step(part, motion, *sample_s);
            }
        }
    }
    let seen = |parts: &[PartState]| {
        let xy = |part: &PartState| {
            let (sin, cos) = part.angle_rad.sin_cos();
            (part.radius_m * cos * 1e3, part.radius_m * sin * 1e3)
        };
        parts.iter().map(xy).collect()
    };
    Ok(Chart {
        title: "Fig. 15: parts at rest and 5 s later, ramp in the upper half".into(),
        x: "x in the tray, mm".into(),
        y: "y in the tray, mm".into(),
        series: vec![Series::dots("start", seen(&start)), Series::dots("after 5 s", seen(&parts))],
    })
}
