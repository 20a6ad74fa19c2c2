//! Whole deliveries with a courier, a camera and a manipulator around the sequencer.

use std::time::Duration;

use feeder_control::courier::CourierLimits;
use feeder_control::delivery::{
    DeliveryConfig, DeliveryId, DeliveryRequest, DeliverySequencer, Failure, HandOver, Output, Phase, Policy, Refusal,
    Stamp, Warning,
};
use feeder_control::platen::Area;
use feeder_model::motor::Load;
use feeder_model::part::Refusals;
use feeder_model::tray::TrayGeometry;
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;

use crate::world::{Faults, World, asking, config};

#[test]
fn a_delivery_goes_through_its_phases_and_the_courier_returns() {
    use Phase::{Feeding, Idle, Looking, Moving, Presented, Returning, Settling, Stopping};
    for policy in [Policy::Selected, Policy::All] {
        let mut world = World::new(Faults::default(), DeliveryConfig { policy, ..config() });
        let id = world.request("right", Some(60));
        world.run(12);
        assert_eq!(world.finished(), [(id, Ok(()))]);
        let mut phases = vec![Returning, Idle, Stopping, Settling, Looking, Feeding, Stopping, Settling, Looking];
        phases.extend([Moving, Presented, Returning, Idle]);
        assert_eq!(world.phases(), phases);
        let status = world.driver.step(1).status;
        assert!(status.at_rest() && (world.position() - Vector3::new(0.1, -0.1, 0.0)).norm() < 1e-6);
        assert_eq!(world.vibrating_moves, 0);
    }
}

#[test]
fn the_part_presented_lies_under_the_tool_axis_and_was_seen_at_rest() {
    let mut world = World::new(Faults::default(), config());
    world.request("left", None);
    world.run(12);
    let presented = world.log.iter().find_map(|(_, output)| match output {
        Output::Presented(_, delivered) => Some(delivered.clone()),
        _ => None,
    });
    let delivered = presented.unwrap();
    assert!(delivered.part_in_station_m.norm() < 20e-6);
    assert!((delivered.yaw_rad - 0.3).abs() < 1e-6);
    let settling = |(_, output): &&(Stamp, Output)| matches!(output, Output::Phase { phase: Phase::Settling, .. });
    let settling = world.log.iter().rfind(settling).unwrap().0;
    assert!(delivered.choice.look + World::LATENCY >= settling);
}

#[test]
fn two_stations_are_served_on_one_trip_when_two_parts_lie_right() {
    let mut world = World::new(Faults::default(), config());
    world.add_part(0.06, -0.03);
    world.add_part(-0.05, -0.05);
    let ids = [world.request("left", None), world.request("right", None)];
    world.run(12);
    let mut finished = world.finished();
    finished.sort_by_key(|(id, _)| *id);
    assert_eq!(finished, ids.map(|id| (id, Ok(()))));
    assert!(!world.log.iter().any(|(_, output)| *output == Output::Feed(true)));
    let moves = world.log.iter().filter(|(_, output)| matches!(output, Output::Move(..))).count();
    // To the feeding place, to one station, to the other, and back.
    assert_eq!(moves, 4);
}

#[test]
fn one_station_a_trip_takes_longer_than_two() {
    let seconds = |stops_max| {
        let mut world = World::new(Faults::default(), DeliveryConfig { stops_max, ..config() });
        world.add_part(0.06, -0.03);
        world.add_part(-0.05, -0.05);
        world.request("left", None);
        world.request("right", None);
        world.run(30);
        assert_eq!(world.finished().iter().filter(|(_, result)| result.is_ok()).count(), 2);
        let last = world.log.iter().rfind(|(_, output)| matches!(output, Output::Finished(..))).unwrap();
        last.0.as_secs_f64()
    };
    let (two_s, one_s) = (seconds(2), seconds(1));
    assert!(two_s < 0.9 * one_s, "{two_s} s against {one_s} s");
}

#[test]
fn what_vision_refuses_is_never_taken_and_what_it_lets_pass_is() {
    let none = Refusals::default();
    for refusals in [
        Refusals { pose_unsure: true, ..none },
        Refusals { pose_disagrees: true, ..none },
        Refusals { off_plateau: true, ..none },
        Refusals { part_too_near: true, ..none },
        Refusals { wall_too_near: true, ..none },
    ] {
        let mut world = World::new(Faults::default(), config());
        world.barren = true;
        world.refusals = refusals;
        world.add_part(0.0, -0.07);
        let id = world.request("right", None);
        world.run(10);
        assert!(world.finished().is_empty() && world.sequencer.phase() == Phase::Feeding, "{refusals:?}");
        world.refusals = none;
        world.add_part(-0.03, -0.06);
        world.run(20);
        assert_eq!(world.finished(), [(id, Ok(()))], "{refusals:?}");
    }
}

#[test]
fn every_fault_ends_the_delivery_with_its_name() {
    let faults = Faults::default();
    let cases = [
        (Faults { blind: true, ..faults }, Failure::NoImage),
        (Faults { manipulator_silent: true, ..faults }, Failure::NoHandOver),
        (Faults { manipulator_misses: true, ..faults }, Failure::NotTaken),
        (Faults { feed_refused: true, ..faults }, Failure::FeedRefused("refused by a test".into())),
        (Faults { never_stops: true, ..faults }, Failure::DidNotStop),
    ];
    for (faults, failure) in cases {
        let mut world = World::new(faults, config());
        let id = world.request("right", None);
        world.run(30);
        assert_eq!(world.finished(), [(id, Err(failure))], "{faults:?}");
    }
}

#[test]
fn a_part_that_falls_or_turns_on_the_way_is_noticed_where_a_camera_sees_the_station() {
    let rechecked = || DeliveryConfig { rechecked_stations: ["right".to_owned()].into(), ..config() };
    let faults = Faults::default();
    for (faults, reason) in [
        (Faults { part_falls: true, ..faults }, "no part is seen at its place"),
        (Faults { part_turns: true, ..faults }, "it lies face_down, not face_up"),
    ] {
        let mut world = World::new(faults, rechecked());
        let id = world.request("right", None);
        // The move to the feeding place comes first, before there are parts.
        world.run(10);
        assert_eq!(world.finished(), [(id, Err(Failure::PartLost(reason.into())))], "{faults:?}");
        assert!(!world.log.iter().any(|(_, output)| matches!(output, Output::Presented(..))));
    }
    let mut world = World::new(faults, rechecked());
    let id = world.request("right", None);
    world.run(12);
    assert_eq!(world.finished(), [(id, Ok(()))]);
    // Where no camera sees the station, the manipulator finds out.
    let mut world = World::new(Faults { part_falls: true, manipulator_misses: true, ..faults }, config());
    let id = world.request("right", None);
    world.run(12);
    assert_eq!(world.finished()[0], (id, Err(Failure::NotTaken)));
}

#[test]
fn a_courier_that_is_not_released_stays_until_the_time_is_over() {
    let mut world = World::new(Faults { never_released: true, ..Faults::default() }, config());
    let id = world.request("right", None);
    world.run_until(Phase::Presented);
    world.run(5);
    assert_eq!(world.sequencer.phase(), Phase::Presented);
    // The part is taken: that cannot be cancelled any more.
    assert!(!world.sequencer.cancel(world.now, id));
    world.run(10);
    assert_eq!(world.finished(), [(id, Ok(()))]);
    let warned = Output::Warning(Warning::NotReleased("right".into()));
    assert!(world.log.iter().any(|(_, output)| *output == warned));
    assert_eq!(world.sequencer.phase(), Phase::Idle);
}

#[test]
fn reports_come_in_order_or_are_refused() {
    let mut world = World::new(Faults { manipulator_silent: true, ..Faults::default() }, config());
    let id = world.request("right", None);
    let refused = Err(Refusal::NotPresented(id));
    assert_eq!(world.sequencer.report_hand_over(id, HandOver::Taken), refused);
    world.run_until(Phase::Presented);
    assert_eq!(world.sequencer.report_hand_over(id, HandOver::Released), refused);
    assert_eq!(world.sequencer.report_hand_over(id, HandOver::Taken), Ok(()));
    assert_eq!(world.sequencer.report_hand_over(id, HandOver::NotTaken), refused);
    assert_eq!(world.sequencer.report_hand_over(id, HandOver::Released), Ok(()));
    world.run(3);
    assert_eq!(world.finished(), [(id, Ok(()))]);
}

#[test]
fn a_cancelled_move_stops_and_the_courier_returns() {
    let mut world = World::new(Faults::default(), config());
    let id = world.request("left", None);
    world.run_until(Phase::Moving);
    for _ in 0..30 {
        world.tick();
    }
    assert!(world.sequencer.cancel(world.now, id));
    assert!(!world.sequencer.cancel(world.now, id));
    world.run(4);
    assert_eq!(world.finished(), [(id, Err(Failure::Cancelled))]);
    assert!(!world.log.iter().any(|(_, output)| matches!(output, Output::Presented(..))));
    assert!((world.position() - Vector3::new(0.1, -0.1, 0.0)).norm() < 1e-6);
}

#[test]
fn a_courier_that_does_not_return_ends_in_fault_until_reset() {
    let mut world = World::new(Faults { moves_refused: true, ..Faults::default() }, config());
    let id = world.request("right", None);
    world.run(10);
    assert_eq!(world.finished(), [(id, Err(Failure::Fault("refused by a test".into())))]);
    assert_eq!(world.sequencer.phase(), Phase::Fault);
    // The courier's own faults come and go beside it.
    world.sequencer.courier_fault(Some("it is stuck"));
    world.sequencer.courier_fault(None);
    assert_eq!(world.sequencer.fault(), Some("refused by a test"));
    assert!(matches!(world.sequencer.request(world.now, asking("left", 1e-3)), Err(Refusal::Fault(_))));
    world.faults = Faults::default();
    world.sequencer.reset();
    let id = world.request("left", None);
    world.run(15);
    assert_eq!(world.finished().last(), Some(&(id, Ok(()))));
}

#[test]
fn a_request_that_cannot_be_served_is_refused() {
    let mut world = World::new(Faults::default(), config());
    let refusal =
        |world: &mut World, request: DeliveryRequest| world.sequencer.request(Stamp::ZERO, request).unwrap_err();
    assert!(matches!(refusal(&mut world, asking("nowhere", 1e-3)), Refusal::UnknownStation { .. }));
    for tolerance_m in [-1.0, 0.0, 1e-6, f64::NAN, f64::INFINITY] {
        assert!(matches!(refusal(&mut world, asking("left", tolerance_m)), Refusal::Tolerance { .. }));
    }
    let report = world.sequencer.report_hand_over(DeliveryId(7), HandOver::Taken);
    assert_eq!(report, Err(Refusal::NotPresented(DeliveryId(7))));
    let post = Area::disc(Vector2::new(0.3, 0.1), 0.2);
    let mut blocked = World::new(Faults::default(), DeliveryConfig { keep_out: vec![post], ..config() });
    assert!(matches!(refusal(&mut blocked, asking("right", 1e-3)), Refusal::Blocked { .. }));
    let far = DeliveryConfig {
        stations_m: [("far".to_string(), Vector2::new(0.7, 0.0))].into(),
        ..DeliveryConfig::default()
    };
    let mut sequencer =
        DeliverySequencer::new(far, TrayGeometry::PAPER, CourierLimits::default(), Load::default()).unwrap();
    let refusal = sequencer.request(Stamp::ZERO, asking("far", 1e-3)).unwrap_err();
    assert!(matches!(refusal, Refusal::OutOfReach { beyond_m, .. } if (beyond_m - 0.11).abs() < 1e-12));
}

#[test]
fn starvation_is_no_fault_but_a_warning_and_the_timeout_a_failure() {
    let mut world = World::new(Faults::default(), config());
    world.barren = true;
    let id = world.request("right", Some(40));
    world.run(35);
    assert!(world.sequencer.is_starved() && world.sequencer.fault().is_none());
    assert!(
        world.log.iter().any(
            |(_, output)| matches!(output, Output::Warning(Warning::Starved(lasted)) if lasted.as_secs_f64() < 60.0)
        )
    );
    world.run(10);
    assert_eq!(world.finished(), [(id, Err(Failure::TimedOut(Phase::Feeding)))]);
    assert!(!world.sequencer.is_starved());
    assert!(world.driver.step(1).status.at_rest());
}

#[test]
fn where_parts_are_and_do_not_come_nobody_is_told_to_load_some() {
    let mut world = World::new(Faults::default(), config());
    world.barren = true;
    world.sequencer.expect_feed(Vec::new(), 0.0, Some(0.06));
    world.sequencer.carry(20);
    world.request("right", None);
    world.run(35);
    let said = |is: fn(&Warning) -> bool| {
        world.log.iter().filter(|(_, output)| matches!(output, Output::Warning(warning) if is(warning))).count()
    };
    assert_eq!(said(|warning| matches!(warning, Warning::FewArrive { share } if *share < 0.01)), 1);
    assert_eq!(said(|warning| matches!(warning, Warning::Starved(_))), 0);
    assert!(world.sequencer.is_starved() && world.sequencer.feed_trouble().is_some());
    // Without any the waveform cannot bring any.
    let mut empty = World::new(Faults::default(), config());
    empty.barren = true;
    empty.sequencer.expect_feed(Vec::new(), 0.0, Some(0.06));
    empty.request("right", None);
    empty.run(35);
    assert!(empty.sequencer.is_starved() && empty.sequencer.feed_trouble().is_none());
}

#[test]
fn a_slow_waveform_is_given_the_time_to_bring_the_parts_that_are_there_but_not_for_ever() {
    // One of twenty parts should come every five seconds, and one of two every fifty.
    for (parts, starved_s, is_explained) in [(20, 30, true), (2, 120, false)] {
        let mut world = World::new(Faults::default(), config());
        world.barren = true;
        world.sequencer.expect_feed(Vec::new(), 0.0, Some(0.01));
        world.sequencer.carry(parts);
        world.request("right", None);
        world.run(starved_s - 2);
        assert!(!world.sequencer.is_starved(), "{parts} parts");
        world.run(5);
        assert!(world.sequencer.is_starved(), "{parts} parts");
        world.run(20);
        assert_eq!(world.sequencer.feed_trouble().is_some(), is_explained, "{parts} parts");
    }
}

#[test]
fn what_the_courier_says_comes_and_goes_and_is_told_once() {
    let mut world = World::new(Faults::default(), config());
    let mut told = |second: u64, said: Option<&str>| {
        let before = world.log.len();
        world.sequencer.courier_warning(Stamp::from_secs(second), said.map(str::to_owned));
        let stands = world.sequencer.feed_trouble();
        assert_eq!(stands.as_deref(), said);
        world.tick();
        let is_told = |(_, output): &&(_, Output)| matches!(output, Output::Warning(Warning::Courier(_)));
        world.log[before..].iter().filter(is_told).count()
    };
    assert_eq!(told(10, Some("it swings near 451 Hz")), 1);
    assert_eq!(told(12, None), 0);
    assert_eq!(told(13, Some("it swings near 452 Hz")), 0);
    assert_eq!(told(14, Some("it is off by 5 %")), 1);
    // A minute after it was heard last it is news again.
    assert_eq!(told(72, Some("it swings near 451 Hz")), 0);
    assert_eq!(told(140, Some("it swings near 451 Hz")), 1);
}

#[test]
fn a_fault_of_the_courier_ends_every_delivery_at_once_and_is_over_when_the_couriers_is() {
    let mut world = World::new(Faults::default(), config());
    world.barren = true;
    let ids = [world.request("right", None), world.request("left", None)];
    world.run(5);
    world.sequencer.courier_fault(Some("it is stuck"));
    world.tick();
    let fault = Failure::Fault("the courier is in fault: it is stuck".to_owned());
    assert_eq!(world.finished(), ids.map(|id| (id, Err(fault.clone()))));
    assert!(world.sequencer.fault().is_some() && !world.sequencer.is_starved());
    world.sequencer.courier_fault(None);
    assert_eq!(world.sequencer.fault(), None);
}

#[test]
fn a_suspended_planner_ends_what_is_under_way_takes_nothing_and_goes_on_by_itself() {
    for phase in [Phase::Feeding, Phase::Moving] {
        let mut world = World::new(Faults::default(), config());
        world.barren = phase == Phase::Feeding;
        let id = world.request("right", None);
        while world.sequencer.phase() != phase {
            world.tick();
        }
        world.sequencer.suspend(Some("nobody is at work"));
        world.tick();
        assert_eq!(world.finished(), [(id, Err(Failure::Suspended("nobody is at work".into())))]);
        let refused = world.sequencer.request(world.now, asking("left", 1e-3));
        assert_eq!(refused, Err(Refusal::Suspended("nobody is at work".into())));
        assert!(world.sequencer.purge(world.now, Duration::from_secs(1)).is_err());
        world.run(3);
        assert!(world.driver.step(0).status.at_rest() && world.sequencer.fault().is_none());
        assert_eq!(world.sequencer.suspended(), Some("nobody is at work"));
        world.sequencer.suspend(None);
        world.barren = false;
        let id = world.request("left", None);
        world.run(30);
        assert!(
            world.finished().iter().any(|(ended, result)| *ended == id && result.is_ok()),
            "{:?}",
            world.finished()
        );
    }
}

#[test]
fn a_tray_that_stands_still_while_it_should_feed_is_told_of_once() {
    let mut world = World::new(Faults::default(), config());
    world.barren = true;
    world.request("right", None);
    world.run(5);
    assert_eq!((world.sequencer.phase(), world.sequencer.feed_trouble()), (Phase::Feeding, None));
    world.driver.halt();
    world.run(5);
    let trouble = world.sequencer.feed_trouble();
    assert!(trouble.as_ref().is_some_and(|said| said.contains("does not vibrate")), "{trouble:?}");
    let told = world.log.iter().filter(|(_, output)| *output == Output::Warning(Warning::StandsStill)).count();
    assert_eq!(told, 1);
}

#[test]
fn a_purge_feeds_until_the_plateau_is_empty_or_gives_up() {
    let purged = |world: &World| {
        world.log.iter().find_map(|(_, output)| match output {
            Output::Purged(result) => Some(result.clone()),
            _ => None,
        })
    };
    let at_home = || {
        let mut world = World::new(Faults::default(), config());
        world.barren = true;
        let id = world.request("left", None);
        assert_eq!(world.sequencer.purge(world.now, Duration::from_secs(5)), Err(Refusal::Busy(1)));
        world.run_until(Phase::Feeding);
        world.sequencer.cancel(world.now, id);
        world.run(2);
        world
    };
    let mut world = at_home();
    world.add_part(0.06, -0.03);
    world.sequencer.purge(world.now, Duration::from_secs(5)).unwrap();
    world.run(2);
    assert_eq!(world.sequencer.phase(), Phase::Purging);
    world.clear_parts();
    world.run(2);
    assert_eq!(purged(&world), Some(Ok(())));
    assert!(world.driver.step(1).status.at_rest());
    let mut world = at_home();
    world.add_part(0.06, -0.03);
    world.sequencer.purge(world.now, Duration::from_secs(3)).unwrap();
    world.run(5);
    assert!(purged(&world).unwrap().unwrap_err().contains("1 parts"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever fails and whatever is cancelled when, every request ends exactly once, no move begins while the tray
    /// vibrates, and the courier ends at rest.
    #[test]
    fn every_request_ends_exactly_once(
        blind in prop::bool::weighted(0.1), manipulator_silent in prop::bool::weighted(0.1),
        manipulator_misses in any::<bool>(), all in any::<bool>(),
        requests in prop::collection::vec((0_u64..800, any::<bool>(), 1_u64..20, prop::option::of(0_u64..600)), 1..4),
    ) {
        let faults = Faults { blind, manipulator_silent, manipulator_misses, ..Faults::default() };
        let policy = if all { Policy::All } else { Policy::Selected };
        let mut world = World::new(faults, DeliveryConfig { policy, ..config() });
        let mut ids = Vec::new();
        let mut cancels = Vec::new();
        for tick in 0..6000 {
            for &(at, left, timeout_s, cancel_after) in &requests {
                if tick == at {
                    let id = world.request(if left { "left" } else { "right" }, Some(timeout_s));
                    ids.push(id);
                    cancels.extend(cancel_after.map(|after| (tick + after, id)));
                }
            }
            for &(at, id) in &cancels {
                if tick == at {
                    world.sequencer.cancel(world.now, id);
                }
            }
            world.tick();
        }
        let mut ended: Vec<_> = world.finished().into_iter().map(|(id, _)| id).collect();
        ended.sort_unstable();
        prop_assert_eq!(ended, ids);
        prop_assert_eq!(world.vibrating_moves, 0);
        prop_assert_eq!(world.sequencer.phase(), Phase::Idle);
        prop_assert!(world.driver.step(1).status.at_rest());
    }
}
