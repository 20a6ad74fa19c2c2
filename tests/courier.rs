//! The courier driver over the wire: what it refuses and why, who may command it, and how it is stopped.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;

use courier_driver::CourierDriver;
use feeder_control::courier::AXES;
use feeder_model::waveform;
use feeder_runtime::cdr;
use feeder_runtime::dds::{Participant, Reader, Writer};
use feeder_runtime::launch::run_real;
use feeder_runtime::lockstep::RunError;
use feeder_runtime::service::{ServiceCall, ServiceClient};
use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use feeder_scenario::plan::CourierDriverConfig;
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::Action;
use minifactory_msgs::control_msgs::action::{
    FollowJointTrajectory, FollowJointTrajectoryGoal, FollowJointTrajectoryResult,
};
use minifactory_msgs::control_msgs::msg::JointTolerance;
use minifactory_msgs::diagnostic_msgs::msg::DiagnosticStatus;
use minifactory_msgs::interface::ServiceSpec;
use minifactory_msgs::lifecycle_msgs::srv::{GetState, GetStateRequest};
use minifactory_msgs::msg::{CourierState, Waveform};
use minifactory_msgs::nav_msgs::msg::Odometry;
use minifactory_msgs::std_srvs::srv::{Trigger, TriggerRequest, TriggerResponse};
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use minifactory_msgs::unique_identifier_msgs::msg::UUID;

use crate::common::{FEEDER, wait_for};
use crate::wall_clock::{PATIENCE, call, hear, lead_driver, participant};

type SendGoal = <FollowJointTrajectory as Action>::SendGoal;
type GetResult = <FollowJointTrajectory as Action>::GetResult;
type GetResultResponse = <FollowJointTrajectory as Action>::GetResultResponse;

const START: [f64; 3] = [-0.1, 0.0, 0.0];

/// A driver against the wall clock, and somebody who talks to it.
struct Bench {
    here: Participant,
    odometry: Receiver<Odometry>,
    states: Receiver<CourierState>,
    waveform: Writer,
    _readers: (Reader, Reader),
    stop: Arc<AtomicBool>,
    driver: Option<JoinHandle<Result<(), RunError>>>,
    _domain: TestDomain,
}

/// A client of the action, as one of several.
struct Client {
    send: ServiceClient<SendGoal>,
    result: ServiceClient<GetResult>,
    goals: u8,
    name: u8,
}

impl Bench {
    fn new() -> Self {
        let domain = TestDomain::claim();
        let stop = Arc::new(AtomicBool::new(false));
        let driver = std::thread::spawn({
            let (domain, stop) = (*domain, stop.clone());
            move || {
                let plan = Scenario::default().plan().unwrap();
                let (namespace, config) = plan.of_kind::<CourierDriverConfig>().next().unwrap();
                run_real::<CourierDriver>(&domain, namespace, config, &stop)
            }
        });
        let here = participant(&domain);
        let (odometry_reader, odometry) = hear(&here, &topics::ODOMETRY, FEEDER);
        let (state_reader, states) = hear(&here, &topics::COURIER_STATE, FEEDER);
        let waveform = here.topic_writer(&topics::WAVEFORM, FEEDER).unwrap();
        let _readers = (odometry_reader, state_reader);
        Self { here, odometry, states, waveform, _readers, stop, driver: Some(driver), _domain: domain }
    }

    fn client(&self, name: u8) -> Client {
        let action = format!("{}/_action", services::FOLLOW_JOINT_TRAJECTORY.name_in(FEEDER));
        Client {
            send: self.here.service_client(&format!("{action}/send_goal")).unwrap(),
            result: self.here.service_client(&format!("{action}/get_result")).unwrap(),
            goals: 0,
            name,
        }
    }

    fn trigger(&self, service: &ServiceSpec<Trigger>) -> TriggerResponse {
        call(&self.here, service, &TriggerRequest::default())
    }

    /// The newest place and state known, after at least one more has come.
    fn look(&self) -> (Odometry, CourierState) {
        (newest(&self.odometry), newest(&self.states))
    }

    fn wait_at_rest(&self) -> Odometry {
        wait_for("the courier to rest", || {
            let (odometry, state) = self.look();
            (!state.moving && !state.vibrating).then_some(odometry)
        })
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let left = self.driver.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            left.unwrap().unwrap().unwrap();
        }
    }
}

fn newest<T>(heard: &Receiver<T>) -> T {
    let first = heard.recv_timeout(PATIENCE).unwrap();
    heard.try_iter().last().unwrap_or(first)
}

impl Client {
    /// Sends a goal: whether it is accepted, and its result, to be waited for.
    fn send(&mut self, goal: &FollowJointTrajectoryGoal) -> (bool, ServiceCall<GetResultResponse>) {
        self.goals += 1;
        let id = UUID { uuid: [self.name, self.goals, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1] };
        let response = self.send.call(&(id, goal.clone()).into(), PATIENCE).wait().unwrap();
        let (accepted, _) = response.into();
        (accepted, self.result.call(&id.into(), PATIENCE))
    }

    /// Sends a goal that must be refused, and gives error code and reason.
    #[track_caller]
    fn refused(&mut self, goal: &FollowJointTrajectoryGoal) -> (i32, String) {
        let (accepted, result) = self.send(goal);
        assert!(!accepted);
        let (_, FollowJointTrajectoryResult { error_code, error_string }) = result.wait().unwrap().into();
        (error_code, error_string)
    }
}

/// From the start to so far along x, in so many seconds.
fn goal(seconds: i32, way_m: f64) -> FollowJointTrajectoryGoal {
    let mut goal = FollowJointTrajectoryGoal::default();
    goal.trajectory.joint_names = AXES.map(str::to_owned).to_vec();
    let mut point = JointTrajectoryPoint {
        positions: vec![START[0] + way_m, START[1], START[2]],
        velocities: vec![0.0; 3],
        accelerations: vec![0.0; 3],
        ..JointTrajectoryPoint::default()
    };
    point.time_from_start.sec = seconds;
    goal.trajectory.points.push(point);
    goal
}

#[test]
fn bad_goals_and_waveforms_are_refused_with_the_reason_and_nothing_moves() {
    let bench = Bench::new();
    let mut client = bench.client(1);
    assert!(client.refused(&goal(1, 0.1)).1.contains("not active"));
    lead_driver(&bench.here, &["configure", "activate"]);
    let state =
        bench.here.service_client::<GetState>(&format!("{FEEDER}/{}/get_state", nodes::COURIER_DRIVER)).unwrap();
    assert_eq!(state.call(&GetStateRequest::default(), PATIENCE).wait().unwrap().current_state.label, "active");

    let (before, _) = bench.look();
    let (invalid, joints, old) = (
        FollowJointTrajectoryResult::INVALID_GOAL,
        FollowJointTrajectoryResult::INVALID_JOINTS,
        FollowJointTrajectoryResult::OLD_HEADER_TIMESTAMP,
    );
    type Spoil = fn(&mut FollowJointTrajectoryGoal);
    let cases: [(Spoil, i32, &str); 14] = [
        (|goal| goal.trajectory.points[0].positions[0] = f64::NAN, invalid, "point 0: position"),
        (|goal| goal.trajectory.points[0].positions[1] = f64::INFINITY, invalid, "point 0: position"),
        (|goal| goal.trajectory.points[0].velocities[2] = f64::NEG_INFINITY, invalid, "point 0: velocity"),
        (|goal| goal.trajectory.points.push(goal.trajectory.points[0].clone()), invalid, "point 1 at 1 s"),
        (|goal| goal.trajectory.points[0].time_from_start.sec = -1, invalid, "point 0: time"),
        (|goal| goal.trajectory.points.clear(), invalid, "no points"),
        (|goal| goal.trajectory.joint_names[2] = "elbow".to_owned(), joints, "elbow"),
        (|goal| goal.trajectory.joint_names.truncate(2), joints, "courier_yaw"),
        (|goal| goal.trajectory.points[0].positions[1] = 0.6, invalid, "courier_y (m)"),
        (|goal| goal.trajectory.points[0].positions[0] = 1e6, invalid, "acceleration (m/s²)"),
        (|goal| goal.trajectory.points[0].positions[2] = 0.1, invalid, "courier_yaw (rad)"),
        (|goal| goal.trajectory.points[0].velocities[0] = 0.1, invalid, "last point has a velocity"),
        (
            |goal| {
                let tolerance = JointTolerance { name: "wrist".to_owned(), position: 1.0, ..JointTolerance::default() };
                goal.path_tolerance.push(tolerance);
            },
            joints,
            "wrist",
        ),
        (|goal| goal.trajectory.header.stamp.sec = 1, old, "the trajectory over"),
    ];
    for (spoil, code, reason) in cases {
        let mut spoiled = goal(1, 0.1);
        spoil(&mut spoiled);
        let (error_code, error_string) = client.refused(&spoiled);
        assert!(error_code == code && error_string.contains(reason), "{error_code} {error_string:?}, not {reason:?}");
    }
    let wide = waveform::Waveform::stick_slip(waveform::Axis::Yaw, 0.3, 17.0, 100.0).unwrap();
    let strong = waveform::Waveform::stick_slip(waveform::Axis::Yaw, 0.02, 100.0, 600.0).unwrap();
    let broken = Waveform { period_s: f64::NAN, ..feeder_wire::waveform::to_message(&wide) };
    for (sequence, message) in
        (1..).zip([feeder_wire::waveform::to_message(&wide), feeder_wire::waveform::to_message(&strong), broken])
    {
        let message = Waveform { sequence, enabled: true, ..message };
        bench.waveform.publish(cdr::encode(&message).unwrap()).unwrap();
    }
    // What was published before is known to have arrived when a later goal has been answered and a state has come.
    assert!(client.refused(&goal(20, 10.0)).1.contains("courier_x (m)"));
    for _ in 0..20 {
        let (after, state) = bench.look();
        assert!(!state.moving && !state.vibrating && state.fault.is_empty(), "{state:?}");
        assert!((after.pose.pose.position.x - before.pose.pose.position.x).abs() < 2e-5);
    }
}

#[test]
fn one_client_commands_anyone_halts_and_faults_stay_until_reset() {
    let bench = Bench::new();
    lead_driver(&bench.here, &["configure", "activate"]);
    let (_reader, diagnostics) = hear(&bench.here, &topics::DIAGNOSTICS, "");
    let (mut first, mut second) = (bench.client(1), bench.client(2));

    // The same client replaces its goal, another one may not.
    let (accepted, replaced) = first.send(&goal(20, 0.3));
    assert!(accepted);
    let (accepted, long) = first.send(&goal(20, 0.25));
    assert!(accepted);
    let (_, result) = replaced.wait().unwrap().into();
    assert!(result.error_string.contains("replaced"), "{result:?}");
    assert!(second.refused(&goal(1, 0.1)).1.contains("commands the courier"));
    assert!(!bench.trigger(&services::HOME).success);
    wait_for("the courier to move", || (bench.look().0.twist.twist.linear.x > 1e-3).then_some(()));
    assert!(bench.trigger(&services::HALT).success);
    let (status, result) = long.wait().unwrap().into();
    assert!(status == 5 && result.error_string == "halted", "{status} {result:?}");
    let stopped = bench.wait_at_rest().pose.pose.position.x;
    assert!(stopped > START[0] && stopped < START[0] + 0.2);

    // An emergency stop ends what is under way, and nothing is taken until it is reset.
    let (accepted, under_way) = second.send(&goal(20, 0.3));
    assert!(accepted);
    assert!(bench.trigger(&services::EMERGENCY_STOP).success);
    let (status, result) = under_way.wait().unwrap().into();
    assert!(status == 6 && result.error_string == "emergency stop", "{status} {result:?}");
    let refused = second.refused(&goal(1, 0.1)).1;
    assert!(refused.contains("emergency stop"), "{refused}");
    wait_for("a fault in the diagnostics", || {
        let status = &newest(&diagnostics).status[0];
        (status.level == DiagnosticStatus::ERROR && status.message == "emergency stop").then_some(())
    });
    wait_for("the fault to be reset", || bench.trigger(&services::RESET_FAULT).success.then_some(()));
    assert!(bench.trigger(&services::HOME).success);
    wait_for("the courier at home", || {
        let place = bench.wait_at_rest().pose.pose.position;
        ((place.x - START[0]).abs() < 2e-5).then_some(())
    });

    // An inactive driver stops and refuses. The way home is another client's goal until it has ended.
    let stopped = wait_for("the way home to end", || {
        let (accepted, result) = second.send(&goal(20, 0.3));
        accepted.then_some(result)
    });
    lead_driver(&bench.here, &["deactivate"]);
    let (status, _) = stopped.wait().unwrap().into();
    assert_eq!(status, 5);
    assert!(second.refused(&goal(1, 0.1)).1.contains("not active"));
}
