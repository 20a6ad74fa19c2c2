//! Parts that slide while they are carried.

use std::time::Duration;

use feeder_control::delivery::Output;

use super::world::{Faults, World, config};

#[test]
fn after_a_slip_moves_are_gentler_and_it_is_said() {
    let mut world = World::new(Faults { parts_slide: true, ..Faults::default() }, config());
    world.barren = true;
    // Of those that are seen before a trip one stays on the tray and shows what the trip did to it, at the next look.
    world.add_part(0.0, -0.07);
    world.add_part(-0.03, -0.06);
    let mut places_m = (0..16).map(|index| 0.03 + 0.003 * f64::from(index));
    let mut deliver = |world: &mut World| {
        let before = world.log.len();
        world.add_part(places_m.next().unwrap(), -0.04);
        world.request("right", None);
        world.run(12);
        let log = &world.log[before..];
        let said: Vec<String> = log
            .iter()
            .filter_map(|(_, output)| match output {
                Output::Warning(warning) => Some(warning.to_string()),
                _ => None,
            })
            .collect();
        let moves_s = log.iter().filter_map(|(_, output)| match output {
            Output::Move(_, plan) => Some(plan.duration_s),
            _ => None,
        });
        (said, moves_s.fold(0.0, f64::max))
    };
    let (_, first_s) = deliver(&mut world);
    let (said, _) = deliver(&mut world);
    assert!(
        said.iter().any(|said| said.contains("parts slid by 0.40 mm") && said.contains("in place of 0.200")),
        "{said:?}"
    );
    assert!(world.sequencer.slid().is_some());
    world.faults.parts_slide = false;
    let (_, _) = deliver(&mut world);
    let (said, gentler_s) = deliver(&mut world);
    assert!(said.is_empty() && gentler_s > 1.03 * first_s, "{said:?} {first_s} {gentler_s}");
    // It does not go on for ever.
    world.faults.parts_slide = true;
    for _ in 0..9 {
        deliver(&mut world);
    }
    let (said, _) = deliver(&mut world);
    let slid = world.sequencer.slid().unwrap();
    assert!(said.is_empty() && slid.contains("as gentle as they get"), "{said:?} {slid}");
}

#[test]
fn parts_that_are_not_taken_are_carried_more_gently_as_if_they_had_slid() {
    let mut world = World::new(Faults { manipulator_misses: true, ..Faults::default() }, config());
    world.barren = true;
    world.add_part(0.0, -0.07);
    world.request("right", None);
    world.run(12);
    assert_eq!(world.sequencer.slid(), None);
    world.request("right", None);
    world.run(12);
    let said = world.sequencer.slid().unwrap();
    assert!(said.contains("2 parts in a row were not taken") && said.contains("0.180 from now on"), "{said}");
}

#[test]
fn what_feeding_moves_has_not_slid() {
    let mut world = World::new(Faults::default(), config());
    world.barren = true;
    world.add_part(0.0, -0.07);
    world.add_part(-0.03, -0.06);
    world.request("right", None);
    world.run(12);
    world.clear_parts();
    world.sequencer.purge(world.now, Duration::from_secs(5)).unwrap();
    world.run(6);
    // Not where the one that was left lay, but close by.
    world.add_part(-0.029_5, -0.06);
    world.add_part(0.000_5, -0.07);
    world.run(1);
    world.request("right", None);
    world.run(12);
    assert_eq!((world.finished().len(), world.sequencer.slid()), (2, None));
}
