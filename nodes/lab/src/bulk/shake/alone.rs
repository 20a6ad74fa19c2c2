//! Clusters of touching parts, alone on the plateau.

use anyhow::{Context as _, Result};
use feeder_control::courier::CourierLimits;
use feeder_model::motor::Load;
use feeder_model::part::PartType;
use feeder_sim::parts::{Part, PartBulk};
use nalgebra::Vector2;
use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

use super::cluster::{self, Cluster};
use super::motion::Motion;
use super::primitives::PRIMITIVES;
use super::{Args, Seen, feeding, shake, table, waveforms};
use crate::bulk::scenario;

/// Parts in a cluster.
const SIZES: [usize; 3] = [2, 3, 6];

/// When it is told what was seen, s.
const TOLD_S: [f64; 3] = [1.0, 2.0, 5.0];

/// Waiting for as many good parts as the cluster has ends then, s.
const WAITING_S: f64 = 400.0;

/// A cluster on an otherwise empty tray.
#[derive(Clone, Debug)]
struct Laid {
    bulk: PartBulk,
    cluster: Cluster,
}

/// What came of a motion of all clusters of one size, by the times at which it is told.
type Sums = [Seen; TOLD_S.len()];

pub(super) fn run(args: &Args, part: &PartType) -> Result<()> {
    let limits = CourierLimits::default();
    let [.., last_s] = TOLD_S;
    let head =
        ["motion", "parts in the cluster", "time (s)", "parted (%)", "can be picked (%)", "right on the plateau (%)"];
    let mut csv = table(args.out.as_deref(), &format!("{}_shaken", part.name), &head)?;
    for count in SIZES {
        println!(
            "\n{} clusters of {count}\n{:26} | {:>13} | {:>13} | {:>13} | as many",
            args.tries, "% after 1, 2, 5 s", "parted", "pickable", "right"
        );
        let mut tell = |name: &str, sums: &Sums, wait_s: Option<f64>| -> Result<()> {
            let all = count as f64 * f64::from(args.tries);
            let shares = sums.map(|seen| {
                [f64::from(seen.parted), seen.pickable as f64, seen.right as f64].map(|parts| 100.0 * parts / all)
            });
            let cell = |which: usize| shares.map(|share| format!("{:3.0}", share[which])).join(", ");
            let wait = wait_s.map_or(String::new(), |wait_s| format!("{wait_s:.0} s"));
            println!("{name:26} | {} | {} | {} | {wait}", cell(0), cell(1), cell(2));
            let Some(csv) = &mut csv else { return Ok(()) };
            for (time_s, share) in TOLD_S.iter().zip(shares) {
                let [parted, pickable, right] = share.map(|share| share.to_string());
                csv.write_record([name, &count.to_string(), &time_s.to_string(), &parted, &pickable, &right])?;
            }
            Ok(())
        };
        for (index, (name, waveform)) in waveforms(part).into_iter().enumerate() {
            let (scenario, waveform, settings) = scenario(part, &waveform)?;
            let room_m = scenario.part_gap_m_min(part);
            let empty = PartBulk::new(scenario.tray.geometry, part.clone(), settings, args.seed)?;
            let clusters = clusters(&empty, count, args.tries, args.seed)?;
            if index == 0 {
                for primitive in PRIMITIVES {
                    let motion = |cluster: &Cluster| primitive.motion(cluster, last_s, &limits, &Load::default());
                    tell(primitive.name, &outcome(&clusters, room_m, motion)?, None)?;
                }
            }
            let on = Motion { bursts: vec![feeding(&waveform, 0.0, 2.0 * WAITING_S)] };
            let sums = outcome(&clusters, room_m, |_| Ok(on.clone()))?;
            tell(name, &sums, Some(median_wait_s(&clusters, &on, room_m, count)?))?;
        }
    }
    println!(
        "\nparted: could be picked at some time until then; pickable: can be picked then; right: lies right on the plateau then;\n\
         as many: median time until as many parts as the cluster has could be picked, {WAITING_S} s at most"
    );
    Ok(())
}

/// `tries` clusters of `count` parts that lie right.
fn clusters(empty: &PartBulk, count: usize, tries: u32, seed: u64) -> Result<Vec<Laid>> {
    let pose = *empty.part_type().wanted_poses.first().context("the part has no wanted pose")?;
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let lay = |_| {
        let mut bulk = empty.clone();
        anyhow::ensure!(cluster::put(&mut bulk, count, pose, &mut rng), "no room for {count} parts on the plateau");
        let centres_m: Vec<Vector2<f64>> = bulk.parts().iter().map(Part::position_m).collect();
        Ok(Laid { bulk, cluster: Cluster::of(&centres_m) })
    };
    (0..tries).map(lay).collect()
}

/// Makes a motion for each cluster and adds up what comes of it.
fn outcome(clusters: &[Laid], room_m: f64, motion: impl Fn(&Cluster) -> Result<Motion>) -> Result<Sums> {
    let mut sums = Sums::default();
    for Laid { bulk, cluster } in clusters {
        let mut left = sums.iter_mut().zip(TOLD_S).peekable();
        shake(bulk.clone(), &motion(cluster)?, room_m, |time_s, seen| {
            if let Some((sum, _)) = left.next_if(|(_, told_s)| time_s > told_s - 1e-9) {
                sum.parted += seen.parted;
                sum.pickable += seen.pickable;
                sum.right += seen.right;
            }
            left.peek().is_none()
        })?;
    }
    Ok(sums)
}

/// Median time until as many parts as the cluster has could be picked.
fn median_wait_s(clusters: &[Laid], on: &Motion, room_m: f64, count: usize) -> Result<f64> {
    let mut waits_s = Vec::new();
    for laid in clusters {
        let mut wait_s = 0.0;
        shake(laid.bulk.clone(), on, room_m, |time_s, seen| {
            wait_s = time_s;
            seen.parted as usize >= count || time_s >= WAITING_S
        })?;
        waits_s.push(wait_s);
    }
    waits_s.sort_by(f64::total_cmp);
    Ok(waits_s[waits_s.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    #[test]
    fn pairs_that_touch_are_parted_by_shear_and_neither_by_rest_nor_by_a_twist() {
        let part = PartType::new(&feeder::part::load("grommet").unwrap()).unwrap();
        let (empty, room_m) = testing::empty(&part);
        let pairs = clusters(&empty, 2, 8, 5).unwrap();
        let parted = |name: &str| {
            let primitive = PRIMITIVES.iter().find(|primitive| primitive.name == name).unwrap();
            let motion =
                |cluster: &Cluster| primitive.motion(cluster, 5.0, &CourierLimits::default(), &Load::default());
            outcome(&pairs, room_m, motion).unwrap()[2].parted
        };
        let rest = outcome(&pairs, room_m, |_| Ok(Motion::default())).unwrap();
        assert_eq!(rest, [Seen { parted: 0, pickable: 0, right: 16 }; 3]);
        assert_eq!(parted("twist, 10 Hz"), 0);
        let sheared = parted("shear, 120 mm");
        assert!(sheared >= 8, "{sheared} of 16");
    }
}
