//! How a manipulator asks, grips and reports.

use super::*;

fn presented(x_m: f64) -> Event {
    Event::Presented(Presented { delivery_id: "d1".into(), x_m, y_m: 0.0, yaw_rad: 1.0 })
}

/// Runs until an action comes out.
fn until_action(manipulator: &mut Manipulator, now_s: &mut f64) -> Action {
    for _ in 0..10_000 {
        *now_s += 0.01;
        if let Some(action) = manipulator.step(*now_s, &[]).pop() {
            return action;
        }
    }
    panic!("no action within 100 s")
}

fn manipulator(config: ManipulatorConfig) -> Manipulator {
    Manipulator::new(config, feeder_model::seed::generator(1, "manipulator")).unwrap()
}

/// Presents one part and says how the gripper fared; returns everything the manipulator does until it asks again.
fn pick(manipulator: &mut Manipulator, now_s: &mut f64, gripped: &Result<(), String>) -> Vec<Action> {
    let mut actions = manipulator.step(*now_s, &[presented(0.0001)]);
    while actions.last() != Some(&Action::Request) {
        let mut action = until_action(manipulator, now_s);
        while let Action::Grip { .. } = action {
            actions.push(action);
            actions.extend(manipulator.step(*now_s, &[Event::Gripped(gripped.clone())]));
            action = until_action(manipulator, now_s);
        }
        actions.push(action);
    }
    actions
}

#[test]
fn a_part_is_asked_for_gripped_at_plateau_height_reported_and_the_feeder_released() {
    let mut manipulator = manipulator(ManipulatorConfig::default());
    let mut now_s = 0.0;
    assert_eq!(manipulator.step(now_s, &[]), [Action::Request]);
    let actions = pick(&mut manipulator, &mut now_s, &Ok(()));
    let expected = [
        Action::Grip { delivery_id: "d1".into(), x_m: 0.0, y_m: 0.0, z_m: 0.0, theta_rad: 1.0 },
        Action::Report { delivery_id: "d1".into(), taken: Ok(()) },
        Action::Release { delivery_id: "d1".into() },
        Action::Request,
    ];
    assert_eq!(actions, expected);
    let [(z_m, speed_m_s), _] = manipulator.joints(now_s);
    assert_eq!((z_m, speed_m_s), (ManipulatorConfig::default().travel_height_m, 0.0));
}

#[test]
fn a_part_off_the_axis_is_not_taken() {
    let mut manipulator = manipulator(ManipulatorConfig::default());
    manipulator.step(0.0, &[]);
    let actions = manipulator.step(0.1, &[presented(0.002)]);
    assert!(matches!(&actions[0], Action::Report { taken: Err(reason), .. } if reason.contains("2.000 mm")));
    // The tool never came down, and asks for another part at once.
    assert_eq!(actions[1..], [Action::Release { delivery_id: "d1".into() }, Action::Request]);
    assert_eq!(manipulator.step(0.2, &[]), []);
}

#[test]
fn the_tolerance_is_the_one_configured() {
    let tolerance_m = ManipulatorConfig::default().tolerance_m;
    for (share, is_taken) in [(0.99, true), (1.01, false)] {
        let mut manipulator = manipulator(ManipulatorConfig::default());
        manipulator.step(0.0, &[]);
        let refused = !manipulator.step(0.1, &[presented(share * tolerance_m)]).is_empty();
        assert_eq!(refused, !is_taken);
    }
}

#[test]
fn the_gripper_closes_when_height_and_rotation_have_both_arrived() {
    let slow = AxisSpeed { speed_max: 0.5, acceleration_max: 5.0 };
    let defaults = ManipulatorConfig::default();
    let low = AxisSpeed { speed_max: 0.005, ..defaults.z };
    for config in [ManipulatorConfig { theta: slow, ..defaults }, ManipulatorConfig { z: low, ..defaults }] {
        let mut manipulator = manipulator(config);
        let mut now_s = 0.0;
        manipulator.step(now_s, &[]);
        manipulator.step(now_s, &[presented(0.0)]);
        let grip = until_action(&mut manipulator, &mut now_s);
        assert_eq!(grip, Action::Grip { delivery_id: "d1".into(), x_m: 0.0, y_m: 0.0, z_m: 0.0, theta_rad: 1.0 });
    }
}

#[test]
fn the_gripper_is_given_its_time_to_close() {
    let config = ManipulatorConfig { grip_s: 0.2, ..Default::default() };
    let mut manipulator = manipulator(config);
    let mut now_s = 1.0;
    manipulator.step(now_s, &[]);
    manipulator.step(now_s, &[presented(0.0)]);
    let (mut there_s, mut gripped_s) = (None, None);
    for _ in 0..200 {
        now_s += 0.01;
        let is_there = manipulator.joints(now_s) == [(0.0, 0.0), (1.0, 0.0)];
        there_s = there_s.or(is_there.then_some(now_s));
        gripped_s = gripped_s.or(manipulator.step(now_s, &[]).pop().map(|_| now_s));
    }
    let closing_s = gripped_s.unwrap() - there_s.unwrap();
    assert!((0.2 - 1e-9..0.23).contains(&closing_s), "{closing_s}");
}

#[test]
fn the_next_part_is_asked_for_when_the_last_is_put_away_and_a_while_after_a_refusal() {
    let config = ManipulatorConfig::default();
    let mut manipulator = manipulator(config);
    let mut now_s = 3.0;
    manipulator.step(now_s, &[]);
    let waits = |manipulator: &mut Manipulator, now_s: &mut f64| {
        let since_s = *now_s;
        assert_eq!(until_action(manipulator, now_s), Action::Request);
        *now_s - since_s
    };
    manipulator.step(now_s, &[Event::NoPart("none fits".into())]);
    let after_refusal_s = waits(&mut manipulator, &mut now_s);
    manipulator.step(now_s, &[presented(0.0)]);
    assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Grip { .. }));
    manipulator.step(now_s, &[Event::Gripped(Ok(()))]);
    assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Release { .. }));
    let after_pick_s = waits(&mut manipulator, &mut now_s);
    for waited_s in [after_refusal_s, after_pick_s] {
        assert!((config.place_s - 1e-9..config.place_s + 0.03).contains(&waited_s), "{waited_s}");
    }
}

#[test]
fn the_feeder_is_released_when_the_tool_is_up() {
    let mut manipulator = manipulator(ManipulatorConfig::default());
    let mut now_s = 0.0;
    manipulator.step(now_s, &[]);
    manipulator.step(now_s, &[presented(0.0)]);
    until_action(&mut manipulator, &mut now_s);
    manipulator.step(now_s, &[Event::Gripped(Ok(()))]);
    assert_eq!(until_action(&mut manipulator, &mut now_s), Action::Release { delivery_id: "d1".into() });
    let [(z_m, speed_m_s), _] = manipulator.joints(now_s);
    assert_eq!((z_m, speed_m_s), (ManipulatorConfig::default().travel_height_m, 0.0));
}

#[test]
fn picks_miss_and_fail_as_often_and_as_far_as_configured() {
    let config = ManipulatorConfig { pick_error_m: 2e-4, pick_failure_probability: 0.25, ..Default::default() };
    let mut manipulator = manipulator(config);
    let mut now_s = 0.0;
    manipulator.step(now_s, &[]);
    let (mut failed, mut errors_m) = (0, Vec::new());
    for _ in 0..400 {
        for action in pick(&mut manipulator, &mut now_s, &Ok(())) {
            match action {
                Action::Grip { x_m, y_m, .. } => errors_m.extend([x_m, y_m]),
                Action::Report { taken: Err(_), .. } => failed += 1,
                _ => {}
            }
        }
    }
    // 400 × 0.25 ± 4 √(400 × 0.25 × 0.75); the deviation of about 600 numbers is within 4/√1200 of the true one.
    assert!((65..=135).contains(&failed), "{failed}");
    let deviation_m = (errors_m.iter().map(|m| m * m).sum::<f64>() / errors_m.len() as f64).sqrt();
    assert!((deviation_m / 2e-4 - 1.0).abs() < 0.12, "{deviation_m}");
}

#[test]
fn a_silent_manipulator_says_nothing_after_its_last_pick() {
    let mut manipulator = manipulator(ManipulatorConfig { silent_after: Some(1), ..Default::default() });
    let mut now_s = 0.0;
    manipulator.step(now_s, &[]);
    manipulator.step(now_s, &[presented(0.0)]);
    assert!(matches!(until_action(&mut manipulator, &mut now_s), Action::Grip { .. }));
    for _ in 0..1000 {
        now_s += 0.01;
        assert_eq!(manipulator.step(now_s, &[Event::Gripped(Ok(()))]), []);
    }
}

#[test]
fn bad_parameters_are_named() {
    let bad = [
        (ManipulatorConfig { grip_s: f64::NAN, ..Default::default() }, "grip_s"),
        (ManipulatorConfig { pick_error_m: -1.0, ..Default::default() }, "pick_error_m"),
        (ManipulatorConfig { pick_failure_probability: 1.5, ..Default::default() }, "pick_failure_probability"),
    ];
    for (config, named) in bad {
        assert!(config.validate().unwrap_err().to_string().contains(named));
    }
}

/// Steps until `done`, and returns everything that was done meanwhile; a gripper that closes holds its part.
fn work(
    manipulator: &mut Manipulator,
    now_s: &mut f64,
    events: &[Event],
    done: impl Fn(&Action) -> bool,
) -> Vec<Action> {
    let mut actions = manipulator.step(*now_s, events);
    while !actions.iter().any(&done) {
        *now_s += 0.01;
        assert!(*now_s < 100.0, "{actions:?}");
        let holds = matches!(actions.last(), Some(Action::Grip { .. })).then_some(Event::Gripped(Ok(())));
        actions.extend(manipulator.step(*now_s, holds.as_slice()));
    }
    actions
}

fn of(delivery_id: &str) -> Presented {
    Presented { delivery_id: delivery_id.into(), x_m: 0.0, y_m: 0.0, yaw_rad: 0.0 }
}

fn releases(delivery_id: &'static str) -> impl Fn(&Action) -> bool {
    move |action| matches!(action, Action::Release { delivery_id: released } if released == delivery_id)
}

#[test]
fn as_many_requests_are_open_as_configured_until_their_parts_are_put_away() {
    let config = ManipulatorConfig { goals_open: 3, ..Default::default() };
    let mut manipulator = manipulator(config);
    let mut now_s = 0.0;
    assert_eq!(manipulator.step(now_s, &[]), [Action::Request, Action::Request, Action::Request]);
    let actions = work(&mut manipulator, &mut now_s, &[Event::Presented(of("d1"))], releases("d1"));
    assert!(!actions.contains(&Action::Request), "{actions:?}");
    let released_s = now_s;
    work(&mut manipulator, &mut now_s, &[], |action| *action == Action::Request);
    assert!((now_s - released_s - config.place_s).abs() < 0.02, "{}", now_s - released_s);
    // One that comes to nothing is made up for after a while.
    assert_eq!(manipulator.step(now_s, &[Event::NoPart("timed out".into())]), []);
    let refused_s = now_s;
    work(&mut manipulator, &mut now_s, &[], |action| *action == Action::Request);
    assert!((now_s - refused_s - config.place_s).abs() < 0.02);
}

#[test]
fn a_part_presented_while_another_is_put_away_waits_for_the_gripper() {
    let config = ManipulatorConfig { goals_open: 2, ..Default::default() };
    let mut manipulator = manipulator(config);
    let mut now_s = 0.0;
    manipulator.step(now_s, &[]);
    work(&mut manipulator, &mut now_s, &[Event::Presented(of("d1"))], releases("d1"));
    let released_s = now_s;
    let actions = work(&mut manipulator, &mut now_s, &[Event::Presented(of("d2"))], releases("d2"));
    let grips: Vec<_> = actions.iter().filter(|action| matches!(action, Action::Grip { .. })).collect();
    assert!(matches!(&grips[..], [Action::Grip { delivery_id, .. }] if delivery_id == "d2"), "{actions:?}");
    assert!(now_s - released_s > config.place_s);
}

#[test]
fn a_part_that_is_withdrawn_while_it_waits_is_not_gripped() {
    let config = ManipulatorConfig { goals_open: 2, ..Default::default() };
    let mut manipulator = manipulator(config);
    let mut now_s = 0.0;
    manipulator.step(now_s, &[]);
    work(&mut manipulator, &mut now_s, &[Event::Presented(of("d1"))], releases("d1"));
    manipulator.step(now_s, &[Event::Presented(of("d2"))]);
    // It is made up for at once.
    assert_eq!(manipulator.step(now_s, &[Event::Withdrawn { delivery_id: "d2".into() }]), [Action::Request]);
    work(&mut manipulator, &mut now_s, &[], |action| *action == Action::Request);
    for _ in 0..300 {
        now_s += 0.01;
        assert_eq!(manipulator.step(now_s, &[]), []);
    }
}
