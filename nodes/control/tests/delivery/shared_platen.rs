//! Several couriers on one platen, each with a sequencer, and one arbiter.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use feeder_control::courier::CourierConfig;
use feeder_control::delivery::{DeliveryConfig, Failure, Output, Phase};
use feeder_control::platen::{Area, Reservation};
use nalgebra::{Vector2, Vector3};

use crate::world::{Faults, Platen, World};

/// Feeders left and right whose ways cross, and stations opposite to both.
fn worlds(platen: &Rc<RefCell<Platen>>) -> Vec<World> {
    [("west", -0.35), ("east", 0.35)]
        .into_iter()
        .map(|(name, x_m)| {
            let config = DeliveryConfig {
                feeding_place: Vector3::new(x_m, -0.3, 0.0),
                stations_m: [("left".into(), Vector2::new(-0.3, 0.3)), ("right".into(), Vector2::new(0.3, 0.3))].into(),
                keep_out: vec![Area::disc(Vector2::new(-x_m, -0.3), 0.1)],
                ..DeliveryConfig::default()
            };
            let courier = CourierConfig { start: config.feeding_place, ..CourierConfig::default() };
            World::sharing(name, courier, Faults::default(), config, Some(Rc::clone(platen)))
        })
        .collect()
}

/// Runs all together; nobody may come nearer than the sum of the footprints.
fn run(platen: &Rc<RefCell<Platen>>, worlds: &mut [World], seconds: u64) {
    for _ in 0..seconds * 100 {
        platen.borrow_mut().step(worlds[0].now);
        worlds.iter_mut().for_each(World::tick);
        let apart_m = (worlds[0].position() - worlds[1].position()).xy().norm();
        assert!(apart_m >= 0.2, "{apart_m} m apart at {:?}", worlds[0].now);
    }
}

#[test]
fn couriers_whose_ways_cross_wait_for_each_other_and_all_deliver() {
    let platen = Rc::new(RefCell::new(Platen::default()));
    let mut worlds = worlds(&platen);
    for _ in 0..5 {
        for station in ["right", "left"] {
            for world in &mut worlds {
                world.request(station, None);
            }
        }
    }
    run(&platen, &mut worlds, 120);
    for world in &mut worlds {
        let finished = world.finished();
        assert_eq!(finished.len(), 10, "{}: {finished:?}", world.name);
        assert!(finished.iter().all(|(_, result)| result.is_ok()), "{}: {finished:?}", world.name);
        let reserving = world.phases().iter().filter(|phase| **phase == Phase::Reserving).count();
        assert!(reserving >= 3, "{}", world.name);
        assert!(world.driver.step(1).status.at_rest());
    }
    // What is left are the places where they park.
    let platen = platen.borrow();
    assert!(platen.arbiter.leases().len() == 2 && platen.arbiter.leases().values().all(|lease| lease.parked));
}

#[test]
fn an_area_that_somebody_else_keeps_ends_the_delivery_with_his_name() {
    let platen = Rc::new(RefCell::new(Platen::default()));
    let mut worlds = worlds(&platen);
    let intruder = Reservation {
        agent: "intruder".into(),
        area: Area::disc(Vector2::new(-0.3, 0.2), 0.1),
        parked: true,
        occupied: true,
        duration: Duration::from_secs(3600),
        wait: Duration::ZERO,
    };
    platen.borrow_mut().arbiter.reserve(Duration::ZERO, u64::MAX, intruder);
    let lost = worlds[0].request("left", None);
    let won = worlds[1].request("right", None);
    run(&platen, &mut worlds, 30);
    assert_eq!(worlds[0].finished(), [(lost, Err(Failure::Area("intruder is parked in the area".into())))]);
    assert_eq!(worlds[1].finished(), [(won, Ok(()))]);
}

#[test]
fn a_trip_cancelled_on_the_way_keeps_to_its_area() {
    let platen = Rc::new(RefCell::new(Platen::default()));
    let mut worlds = worlds(&platen);
    worlds[0].add_part(0.06, -0.03);
    worlds[0].add_part(-0.05, -0.05);
    let ids = [worlds[0].request("left", None), worlds[0].request("right", None)];
    let mut moves = 0;
    for _ in 0..2000 {
        platen.borrow_mut().step(worlds[0].now);
        worlds.iter_mut().for_each(World::tick);
        let leases = platen.borrow().arbiter.leases().clone();
        let place_m = worlds[0].position().xy();
        let inside = leases.values().any(|lease| lease.agent == "west" && lease.area.excess_m(&place_m, 0.1) < 1e-4);
        assert!(leases.is_empty() || inside, "out of its areas at {place_m:?}, {:?}", worlds[0].now);
        let now_moves = worlds[0].log.iter().filter(|(_, output)| matches!(output, Output::Move(..))).count();
        // Half a second into the second leg, from station to station.
        if now_moves == 2 && worlds[0].sequencer.phase() == Phase::Moving {
            moves += 1;
            if moves == 50 {
                let now = worlds[0].now;
                let open: Vec<_> = worlds[0].sequencer.open().map(|(id, _)| id).collect();
                assert!(open.len() == 1 && worlds[0].sequencer.cancel(now, open[0]));
            }
        }
    }
    assert!(moves >= 50);
    let finished = worlds[0].finished();
    assert_eq!(finished.len(), 2);
    assert!(ids.iter().all(|id| finished.iter().any(|(ended, _)| ended == id)));
    assert!(worlds[0].driver.step(1).status.at_rest());
    assert_eq!(worlds[0].sequencer.phase(), Phase::Idle);
}

/// The courier has hardly left, so that what is left of the way home may be too short for a move along the trip.
#[test]
fn a_trip_cancelled_as_it_begins_comes_home() {
    for after in 0..20 {
        let platen = Rc::new(RefCell::new(Platen::default()));
        let mut worlds = worlds(&platen);
        worlds[0].add_part(0.06, -0.03);
        let id = worlds[0].request("left", None);
        let mut moving = 0;
        for _ in 0..1000 {
            platen.borrow_mut().step(worlds[0].now);
            worlds.iter_mut().for_each(World::tick);
            if worlds[0].sequencer.phase() == Phase::Moving {
                if moving == after {
                    let now = worlds[0].now;
                    assert!(worlds[0].sequencer.cancel(now, id));
                }
                moving += 1;
            }
        }
        assert_eq!(worlds[0].finished(), [(id, Err(Failure::Cancelled))], "after {after} ticks");
        assert_eq!(worlds[0].sequencer.phase(), Phase::Idle, "after {after} ticks");
        let warned = worlds[0].log.iter().find(|(_, output)| matches!(output, Output::Warning(_)));
        assert!(warned.is_none(), "after {after} ticks: {warned:?}");
    }
}
