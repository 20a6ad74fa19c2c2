//! Whether small motions of the tray part what touches, beside feeding on.

mod alone;
mod cluster;
mod in_use;
mod motion;
mod primitives;

use std::fs::File;
use std::path::Path;

use anyhow::{Context as _, Result};
use feeder_model::part::PartType;
use feeder_model::waveform::Waveform;
use feeder_sim::parts::{FeedObserver, PartBulk, Place, Sighting};
use nalgebra::Vector3;

use super::{Args, block_s, waveforms};
use motion::{Burst, Motion, Shape};

/// Blocks between looks.
const BLOCKS_PER_LOOK: u32 = 5;

pub(super) fn run(args: &Args, part: &PartType, duration_s: f64) -> Result<()> {
    println!("{} on the paper's tray", part.name);
    alone::run(args, part)?;
    in_use::run(args, part, duration_s)
}

/// Feeding, faded in and out.
fn feeding(waveform: &Waveform, start_s: f64, end_s: f64) -> Burst {
    Burst::faded(Shape::Periodic(waveform.clone()), Vector3::z(), start_s, end_s)
}

/// Which parts can be picked as they lie: right, wholly on the plateau, with a gripper's room.
fn pickable(bulk: &PartBulk, room_m: f64) -> Vec<u32> {
    let mut observer = FeedObserver::new(*bulk.tray(), bulk.part_type(), room_m);
    let sightings = || bulk.parts().iter().map(Sighting::from);
    observer.observe(0.0, sightings());
    // Of those that fall off the plateau the observer tells which could be picked.
    let gone = observer.observe(0.0, sightings().map(|sighting| Sighting { place: Place::Falling, ..sighting }));
    gone.iter().filter(|departure| departure.was_good).map(|departure| departure.id).collect()
}

/// How many parts lie right on the plateau.
fn right_on_plateau(bulk: &PartBulk) -> usize {
    let wanted = &bulk.part_type().wanted_poses;
    bulk.parts().iter().filter(|part| part.place == Place::Plateau && wanted.contains(&part.pose)).count()
}

/// What came of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Seen {
    /// Parts that could be picked at some time until now, each once a lap.
    parted: u32,
    /// Parts that can be picked now.
    pickable: usize,
    /// Parts that lie right on the plateau now.
    right: usize,
}

/// Moves a tray and looks at it, until there is `enough` of time (s) and of what was seen.
fn shake(mut bulk: PartBulk, motion: &Motion, room_m: f64, mut enough: impl FnMut(f64, Seen) -> bool) -> Result<()> {
    let mut observer = FeedObserver::new(*bulk.tray(), bulk.part_type(), room_m);
    let mut block = 0;
    loop {
        let time_s = f64::from(block) * block_s();
        if block % BLOCKS_PER_LOOK == 0 {
            observer.observe(time_s, bulk.parts().iter().map(Sighting::from));
            let pickable = pickable(&bulk, room_m).len();
            let seen = Seen { parted: observer.report().good, pickable, right: right_on_plateau(&bulk) };
            if enough(time_s, seen) {
                return Ok(());
            }
        }
        bulk.step(&motion.block(block))?;
        block += 1;
    }
}

/// A table to write, if a folder for it was named.
fn table(folder: Option<&Path>, stem: &str, head: &[&str]) -> Result<Option<csv::Writer<File>>> {
    let Some(folder) = folder else { return Ok(None) };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    let path = folder.join(format!("{stem}.csv"));
    let mut writer = csv::Writer::from_path(&path).with_context(|| format!("cannot write {}", path.display()))?;
    writer.write_record(head)?;
    Ok(Some(writer))
}

#[cfg(test)]
mod testing {
    use super::*;
    use crate::bulk::scenario;

    /// The tray without parts, and the room that a gripper needs.
    pub(super) fn empty(part: &PartType) -> (PartBulk, f64) {
        let (scenario, _, settings) = scenario(part, &waveforms(part)[0].1).unwrap();
        let bulk = PartBulk::new(scenario.tray.geometry, part.clone(), settings, 1).unwrap();
        (bulk, scenario.part_gap_m_min(part))
    }
}
