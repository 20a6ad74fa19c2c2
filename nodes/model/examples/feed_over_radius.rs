//! Prints how fast parts travel on a tray at each radius: `cargo run --package feeder_model --example feed_over_radius`.

use std::error::Error;

use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::AnnularTrack;
use feeder_model::mechanics::map::TrayMap;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, Waveform};

fn main() -> Result<(), Box<dyn Error>> {
    let tray = TrayGeometry::PAPER;
    let track = AnnularTrack::new(tray, Friction::uniform(0.2)?, STANDARD_GRAVITY_M_S2)?;
    let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.658, 130.8654)?;
    let map = TrayMap::new(&track, &waveform)?;
    println!("radius_m,ramp_mm_s,plateau_mm_s");
    for step in 0..=12 {
        let share = f64::from(step) / 12.0;
        let radius_m = tray.inner_radius_m + share * (tray.outer_radius_m - tray.inner_radius_m);
        let feed = map.at(radius_m)?;
        // Where the ramp is too steep parts slide down and never reach a steady motion.
        let mm_s = |feed: Option<f64>| feed.map_or_else(|| "-".to_owned(), |feed_m_s| format!("{:.2}", 1e3 * feed_m_s));
        let [ramp, plateau] = [feed.ramp, feed.plateau].map(|feed| mm_s(feed.map(|feed| feed.steady.feed_m_s)));
        println!("{radius_m:.3},{ramp},{plateau}");
    }
    match map.critical_radius_m()? {
        Some(critical_radius_m) => println!("parts climb the ramp from {critical_radius_m:.4} m outwards"),
        None => println!("the feed on the ramp has the same direction everywhere"),
    }
    Ok(())
}
