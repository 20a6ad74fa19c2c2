//! What the planner remembers from one trip to the next: where parts lie, and what they did when they were carried.

use feeder_control::delivery::{DeliveryConfig, Output, Phase, Refusal, Warning};
use feeder_control::platen::Area;
use nalgebra::Vector2;

use crate::world::{Faults, World, asking, config};

/// How often feeding was stopped for a look.
fn stops_for_a_look(world: &World) -> usize {
    world.phases().iter().filter(|phase| **phase == Phase::Stopping).count()
}

#[test]
fn it_feeds_at_once_where_it_knows_that_nothing_on_the_plateau_will_do() {
    let mut world = World::new(Faults::default(), config());
    world.add_part(0.0, -0.07);
    let first = world.request("right", None);
    world.run(12);
    assert_eq!((world.finished(), stops_for_a_look(&world)), (vec![(first, Ok(()))], 1));
    // The plateau is empty, and nothing has shaken the tray since that was seen.
    world.request("right", None);
    world.run_until(Phase::Feeding);
    assert_eq!(stops_for_a_look(&world), 1);
}

#[test]
fn it_looks_first_where_a_part_is_left() {
    let mut world = World::new(Faults::default(), config());
    world.add_part(0.0, -0.07);
    world.add_part(0.05, -0.05);
    world.request("right", None);
    world.run(12);
    let second = world.request("right", None);
    world.run(12);
    assert!(world.finished().contains(&(second, Ok(()))));
    assert!(!world.log.iter().any(|(_, output)| *output == Output::Feed(true)));
}

#[test]
fn further_requests_of_a_station_are_served_on_the_same_trip() {
    let mut world = World::new(Faults::default(), config());
    let places_m = [(0.06, -0.03), (0.03, -0.06), (0.0, -0.07), (-0.03, -0.06), (-0.06, -0.03)];
    places_m.iter().for_each(|(x_m, y_m)| world.add_part(*x_m, *y_m));
    for _ in places_m {
        world.request("right", None);
    }
    world.run(20);
    assert_eq!(world.finished().iter().filter(|(_, result)| result.is_ok()).count(), 5);
    let returns = world.phases().iter().filter(|phase| **phase == Phase::Returning).count();
    // Once at first, to the feeding place, and once when all are served.
    assert_eq!(returns, 2);
}

#[test]
fn parts_that_slide_are_told_of_and_carried_more_gently_afterwards() {
    let carried = |parts_slide| {
        let mut world = World::new(Faults { parts_slide, ..Faults::default() }, config());
        for x_m in [0.03, 0.0, -0.03] {
            world.add_part(x_m, -0.065);
        }
        for _ in 0..3 {
            world.request("right", None);
            world.run(20);
        }
        // It is never so careful that it stands.
        assert!(world.finished().len() == 3 && world.finished().iter().all(|(_, result)| result.is_ok()));
        let slips = world.log.iter().filter_map(|(_, output)| match output {
            Output::Warning(Warning::Slipped { slid_m, friction }) => Some((*slid_m, *friction)),
            _ => None,
        });
        let peaks = world.log.iter().filter_map(|(_, output)| match output {
            Output::Move(_, plan) => Some(plan.peak_acceleration_m_s2),
            _ => None,
        });
        let (slips, peaks): (Vec<_>, Vec<_>) = (slips.collect(), peaks.collect());
        (slips, peaks, world.sequencer.slip_trouble())
    };
    let (slips, held, trouble) = carried(false);
    assert_eq!((slips, trouble), (Vec::new(), None));
    let (slips, slid, trouble) = carried(true);
    let believed = DeliveryConfig::default().gentle.friction;
    assert!((slips[0].0 - 1e-3).abs() < 1e-6 && (slips[0].1 - 0.9 * believed).abs() < 1e-9, "{slips:?}");
    // It goes on lowering what it believes, but not to a standstill.
    assert!(slips.windows(2).all(|pair| pair[1].1 <= pair[0].1) && slips.len() > 1);
    assert!(slips.iter().all(|(_, friction)| *friction >= 0.3 * believed - 1e-9));
    assert!(trouble.is_some_and(|said| said.contains("slid by") && said.contains("friction")));
    let last = |peaks: &[f64]| peaks[peaks.len() - 2];
    assert!(last(&slid) < 0.9 * last(&held), "{slid:?} {held:?}");
}

#[test]
fn a_station_to_which_no_way_leads_is_refused_when_it_is_asked_for() {
    // A wall all across the platen between the feeding place and the station on the left.
    let wall = Area { points_m: [-2.0, 2.0].map(|y_m| Vector2::new(-0.14, y_m)).into(), radius_m: 0.01 };
    let mut world = World::new(Faults::default(), DeliveryConfig { keep_out: vec![wall], ..config() });
    let refused = world.sequencer.request(world.now, asking("left", 0.5e-3));
    assert!(matches!(refused, Err(Refusal::Blocked { .. })), "{refused:?}");
    world.request("right", None);
}
