//! A tray in use from which all that can be picked has been taken.

use anyhow::{Context as _, Result};
use feeder_control::courier::CourierLimits;
use feeder_model::motor::Load;
use feeder_model::part::PartType;
use feeder_model::waveform::Waveform;
use feeder_sim::parts::{BulkSettings, PartBulk};

use super::cluster::nearest_pair;
use super::motion::{FADE_PERIODS, Motion};
use super::primitives::{PRIMITIVES, Primitive};
use super::{Args, feeding, pickable, right_on_plateau, shake, table, waveforms};
use crate::bulk::{Shaking, block_s, scenario};

/// Parts on the tray.
const LOADS: [usize; 2] = [20, 80];

/// Parts circulate for so long before anything is looked at, s.
const SETTLING_S: f64 = 300.0;

/// Time between looks, at least, s.
const BETWEEN_LOOKS_S: f64 = 2.0;

/// A motion lasts so long before the tray feeds again, s.
const SHAKEN_S: f64 = 2.0;

/// What comes is counted for so long, s.
const COUNTED_S: f64 = 5.0;

/// What came of a motion in all states.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// Times until the first part could be picked, s.
    first_s: f64,
    /// Parts that could be picked.
    good: u32,
}

pub(super) fn run(args: &Args, part: &PartType, duration_s: f64) -> Result<()> {
    let head = ["waveform", "parts", "states", "motion", "time to the first (s)", "good parts"];
    let mut csv = table(args.out.as_deref(), &format!("{}_shaken_in_use", part.name), &head)?;
    println!(
        "\nA tray in use from which all that can be picked was taken, and on which two parts or more still lie right. A motion \
         of {SHAKEN_S} s,\nthen feeding again: mean time until a part can be picked, {COUNTED_S} s at most; good parts in \
         {COUNTED_S} s"
    );
    for (name, spec) in waveforms(part) {
        for load in LOADS {
            let (scenario, waveform, settings) = scenario(part, &spec)?;
            let room_m = scenario.part_gap_m_min(part);
            let settings = BulkSettings { load_plateau: true, ..settings };
            let mut bulk = PartBulk::new(scenario.tray.geometry, part.clone(), settings, args.seed)?;
            let loaded = bulk.load(load).loaded;
            let carried = scenario.load(part);
            let (looks, states) = states(bulk, &waveform, room_m, duration_s, args.tries)?;
            println!("\n{name}, {loaded} parts: {} of {looks} looks", states.len());
            let mut tell = |motion: &str, sums: Sums| -> Result<()> {
                let [first_s, good] = [sums.first_s, f64::from(sums.good)].map(|sum| sum / states.len() as f64);
                println!("{motion:26} | {first_s:5.2} s | {good:5.2}");
                let Some(csv) = &mut csv else { return Ok(()) };
                let [parts, count, first, good] =
                    [loaded.to_string(), states.len().to_string(), first_s.to_string(), good.to_string()];
                csv.write_record([name, &parts, &count, motion, &first, &good])?;
                Ok(())
            };
            if states.is_empty() {
                continue;
            }
            tell("feeding on", outcome(&states, room_m, |_| Ok(on(&waveform)))?)?;
            for primitive in PRIMITIVES {
                let motion = |bulk: &PartBulk| between(primitive, &waveform, bulk, &carried);
                tell(primitive.name, outcome(&states, room_m, motion)?)?;
            }
        }
    }
    Ok(())
}

/// Feeding on without a pause.
fn on(waveform: &Waveform) -> Motion {
    let mut on = feeding(waveform, 0.0, 2.0 * COUNTED_S);
    on.fades_s = [0.0; 2];
    Motion { bursts: vec![on] }
}

/// Feeding ends, a motion for the two nearest parts, and feeding again.
fn between(primitive: &Primitive, waveform: &Waveform, bulk: &PartBulk, load: &Load) -> Result<Motion> {
    let pair = nearest_pair(bulk).context("no two parts lie right")?;
    let fade_s = FADE_PERIODS * waveform.period_s();
    let mut ending = feeding(waveform, 0.0, fade_s);
    ending.fades_s = [0.0, fade_s];
    let mut motion = primitive.motion(&pair, SHAKEN_S, &CourierLimits::default(), load)?;
    for burst in &mut motion.bursts {
        burst.start_s += fade_s;
        burst.end_s += fade_s;
    }
    let again = feeding(waveform, motion.end_s(), motion.end_s() + 2.0 * COUNTED_S);
    motion.bursts.extend([ending, again]);
    Ok(motion)
}

/// Makes a motion for each state and adds up what comes of it.
fn outcome(states: &[PartBulk], room_m: f64, motion: impl Fn(&PartBulk) -> Result<Motion>) -> Result<Sums> {
    let mut sums = Sums::default();
    for bulk in states {
        let (mut first_s, mut good) = (COUNTED_S, 0);
        shake(bulk.clone(), &motion(bulk)?, room_m, |time_s, seen| {
            if seen.parted > 0 {
                first_s = first_s.min(time_s);
            }
            good = seen.parted;
            time_s > COUNTED_S - 1e-9
        })?;
        sums.first_s += first_s;
        sums.good += good;
    }
    Ok(sums)
}

/// Looks at a tray that feeds, each time takes away what can be picked, one after the other, and keeps the states in which two
/// parts or more still lie right, `most` of them. Also tells how often it looked.
fn states(
    mut bulk: PartBulk,
    waveform: &Waveform,
    room_m: f64,
    duration_s: f64,
    most: u32,
) -> Result<(u32, Vec<PartBulk>)> {
    let mut shaking = Shaking::new(waveform.clone());
    let mut states = Vec::new();
    let (mut looks, mut looked_s) = (0, SETTLING_S);
    let mut block = 0_u32;
    let mut time_s = 0.0;
    while time_s < SETTLING_S + duration_s && states.len() < most as usize {
        bulk.step(&shaking.next_block())?;
        block += 1;
        time_s = f64::from(block) * block_s();
        // Between two periods, so that what goes on from there may begin with one.
        let periods = time_s / waveform.period_s();
        if time_s < looked_s + BETWEEN_LOOKS_S || (periods - periods.round()).abs() > 1e-6 {
            continue;
        }
        looked_s = time_s;
        looks += 1;
        let mut left = bulk.clone();
        while let Some(&id) = pickable(&left, room_m).first() {
            left.remove(id);
        }
        if right_on_plateau(&left) >= 2 {
            states.push(left);
        }
    }
    Ok((looks, states))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_the_states_kept_nothing_can_be_picked_and_two_parts_lie_right() {
        let part = PartType::new(&feeder::part::load("grommet").unwrap()).unwrap();
        let (_, spec) = &waveforms(&part)[2];
        let (scenario, waveform, settings) = scenario(&part, spec).unwrap();
        let room_m = scenario.part_gap_m_min(&part);
        let mut bulk = PartBulk::new(scenario.tray.geometry, part.clone(), settings, 1).unwrap();
        bulk.load(80);
        let (looks, states) = states(bulk, &waveform, room_m, 30.0, 3).unwrap();
        assert!(looks >= 3 && states.len() == 3, "{looks}");
        for bulk in &states {
            assert!(pickable(bulk, room_m).is_empty() && right_on_plateau(bulk) >= 2 && bulk.is_conserved());
        }
        // Feeding on brings good parts where resting brings none.
        let fed = outcome(&states, room_m, |_| Ok(on(&waveform))).unwrap();
        let rest = outcome(&states, room_m, |_| Ok(Motion::default())).unwrap();
        assert!(fed.good > 0 && fed.first_s < rest.first_s, "{fed:?}");
        assert_eq!(rest.good, 0);
    }
}
