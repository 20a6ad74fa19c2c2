//! A run as a simulation in the sense of `simulation_interfaces`: stopped, stepped, reset, its parts looked at and moved.

use std::path::Path;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use feeder_runtime::dds::{Participant, Reader};
use feeder_runtime::node::ns_of_stamp;
use feeder_scenario::Scenario;
use feeder_scenario::plan::{Loaded, load};
use feeder_wire::{nodes, services, topics};
use minifactory_msgs::action_msgs::msg::GoalStatus;
use minifactory_msgs::geometry_msgs::msg::{Point, Pose, PoseStamped};
use minifactory_msgs::interface::{ServiceSpec, simulation};
use minifactory_msgs::msg::DeliveryState;
use minifactory_msgs::simulation_interfaces::action::{SimulateSteps, SimulateStepsGoal, SimulateStepsResult};
use minifactory_msgs::simulation_interfaces::msg::{
    EntityFilters, EntityState, Resource, Result as Answer, SimulationState, SimulatorFeatures,
};
use minifactory_msgs::simulation_interfaces::srv::{
    DeleteEntityRequest, GetEntitiesRequest, GetEntitiesStatesRequest, GetEntityInfoRequest, GetEntityStateRequest,
    GetSimulationState, GetSimulationStateRequest, GetSimulatorFeaturesRequest, GetSpawnablesRequest,
    ResetSimulationRequest, SetEntityStateRequest, SetEntityStateResponse, SetSimulationStateRequest,
    SetSimulationStateResponse, SpawnEntityRequest, SpawnEntityResponse, StepSimulationRequest,
};
use minifactory_msgs::srv::LoadPartsRequest;
use minifactory_msgs::std_msgs::msg::Header;
use minifactory_msgs::unique_identifier_msgs::msg::UUID;
use minifactory_msgs::{Action, Service};
use tempfile::TempDir;

use crate::common::{FEEDER, Outcome, Run, Up, wait_for};
use crate::managed::state;
use crate::wall_clock::{PATIENCE, call, hear, participant};

const TICK_NS: u64 = 10_000_000;

/// A run that goes on until it is told to go, and who asks of it.
struct Bench {
    run: Run,
    here: Participant,
    deliveries: Receiver<DeliveryState>,
    _reader: Reader,
}

impl Bench {
    fn new(options: &str) -> Self {
        Self::of(Up::new(&format!("--duration 86400 {options}")))
    }

    fn of(up: Up) -> Self {
        let run = up.start();
        let here = participant(run.domain());
        let (_reader, deliveries) = hear(&here, &topics::DELIVERY_STATE, FEEDER);
        let bench = Self { run, here, deliveries, _reader };
        bench.wait_for(SimulationState::STATE_PLAYING);
        bench
    }

    fn call<S: Service>(&self, service: &ServiceSpec<S>, request: &S::Request) -> S::Response {
        let client = self.here.service_client::<S>(&service.name_in("")).unwrap();
        client.call(request, PATIENCE).wait().unwrap_or_else(|error| panic!("{error}: {}", self.run.stderr()))
    }

    fn state(&self) -> u8 {
        self.call(&simulation::GET_SIMULATION_STATE, &GetSimulationStateRequest::default()).state.state
    }

    fn set_state(&self, state: u8) -> u8 {
        let request = SetSimulationStateRequest { state: SimulationState { state } };
        self.call(&simulation::SET_SIMULATION_STATE, &request).result.result
    }

    /// Waits for a state, also of a run that is only about to begin.
    fn wait_for(&self, state: u8) {
        let name = simulation::GET_SIMULATION_STATE.name_in("");
        let client = self.here.service_client::<GetSimulationState>(&name).unwrap();
        wait_for(&format!("state {state}"), || {
            let response = client.call(&GetSimulationStateRequest::default(), Duration::from_secs(1)).wait();
            (response.ok()?.state.state == state).then_some(())
        });
    }

    fn step(&self, steps: u64) -> Answer {
        self.call(&simulation::STEP_SIMULATION, &StepSimulationRequest { steps }).result
    }

    /// Stops time and steps it until the planner is heard to be in a phase: time stands still then, however busy the machine.
    fn step_until(&self, phase: u8) -> DeliveryState {
        assert_eq!(self.set_state(SimulationState::STATE_PAUSED), Answer::RESULT_OK);
        wait_for(&format!("phase {phase}"), || {
            assert_eq!(self.step(10).result, Answer::RESULT_OK);
            self.deliveries.try_iter().last().filter(|state| state.phase == phase)
        })
    }

    fn names(&self, filter: &str) -> Vec<String> {
        let filters = EntityFilters { filter: filter.to_owned(), ..EntityFilters::default() };
        let found = self.call(&services::GET_ENTITIES, &GetEntitiesRequest { filters });
        assert_eq!(found.result.result, Answer::RESULT_OK, "{}", found.result.error_message);
        found.entities
    }

    fn state_of(&self, entity: &str) -> Result<EntityState, u8> {
        let found = self.call(&services::GET_ENTITY_STATE, &GetEntityStateRequest { entity: entity.to_owned() });
        if found.result.result == Answer::RESULT_OK { Ok(found.state) } else { Err(found.result.result) }
    }

    fn move_to(&self, entity: &str, frame: &str, pose: Pose) -> Answer {
        let header = Header { frame_id: frame.to_owned(), ..Header::default() };
        let state = EntityState { header, pose, ..EntityState::default() };
        let request = SetEntityStateRequest { entity: entity.to_owned(), state, set_pose: true, ..Default::default() };
        self.call(&services::SET_ENTITY_STATE, &request).result
    }

    fn spawn(&self, name: &str, allow_renaming: bool, uri: &str, pose: Pose) -> SpawnEntityResponse {
        let request = SpawnEntityRequest {
            name: name.to_owned(),
            allow_renaming,
            entity_resource: Resource { uri: uri.to_owned(), ..Resource::default() },
            initial_pose: PoseStamped { header: Header { frame_id: "feeder/tray".into(), ..Header::default() }, pose },
            ..SpawnEntityRequest::default()
        };
        self.call(&services::SPAWN_ENTITY, &request)
    }

    fn delete(&self, entity: &str) -> u8 {
        self.call(&services::DELETE_ENTITY, &DeleteEntityRequest { entity: entity.to_owned() }).result.result
    }

    /// Simulated time of the parts, ns.
    fn now_ns(&self) -> u64 {
        let states = self.call(&services::GET_ENTITIES_STATES, &GetEntitiesStatesRequest::default()).states;
        ns_of_stamp(&states[0].header.stamp)
    }

    /// Ends the run, and what its monitor says of parts.
    fn end(self) -> Outcome {
        assert_eq!(self.set_state(SimulationState::STATE_QUITTING), Answer::RESULT_OK);
        let outcome = self.run.outcome();
        assert!(outcome.status.success(), "{}", outcome.stderr);
        let score = |key| outcome.number(key);
        assert_eq!((score("parts_lost"), score("parts_doubled"), score("wrong_pose_delivered")), (0.0, 0.0, 0.0));
        outcome
    }
}

/// A place on the plateau in the tray's frame; the part lies as it is drawn.
fn on_plateau(radius_m: f64, angle_rad: f64) -> Pose {
    let (y, x) = angle_rad.sin_cos();
    Pose { position: Point { x: radius_m * x, y: radius_m * y, z: 0.0 }, ..Pose::default() }
}

#[test]
fn time_stands_still_goes_on_by_steps_and_begins_again() {
    for form in ["", "--composed"] {
        let bench = Bench::new(&format!("{form} --speed 1"));
        let features = bench.call(&simulation::GET_SIMULATOR_FEATURES, &GetSimulatorFeaturesRequest::default());
        let offered = |feature: u8| features.features.features.contains(&feature.into());
        assert!(offered(SimulatorFeatures::STEP_SIMULATION_ACTION) && !offered(SimulatorFeatures::WORLD_LOADING));
        assert_eq!(bench.step(1).result, Answer::RESULT_OPERATION_FAILED, "a step while it plays");
        assert_eq!(bench.set_state(SimulationState::STATE_PAUSED), Answer::RESULT_OK);
        assert_eq!(bench.set_state(SimulationState::STATE_PAUSED), SetSimulationStateResponse::ALREADY_IN_TARGET_STATE);
        bench.step(1);
        assert_eq!(state(&bench.here, nodes::COURIER_DRIVER), "active", "who is asked answers without time");
        let before_ns = bench.now_ns();
        assert_eq!(bench.step(7).result, Answer::RESULT_OK);
        assert_eq!(bench.now_ns(), before_ns + 7 * TICK_NS, "{form}");
        assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), Answer::RESULT_OK);
        bench.wait_for(SimulationState::STATE_STOPPED);
        assert!(bench.now_ns() <= TICK_NS, "{form}: it stands after its first tick");
        assert_eq!(bench.set_state(SimulationState::STATE_PLAYING), Answer::RESULT_OK);
        bench.end();
    }
}

#[test]
fn steps_by_the_action_are_told_of_and_can_be_cancelled() {
    let bench = Bench::new("--composed --speed 1");
    let client = |name: &str| format!("{}/_action/{name}", simulation::SIMULATE_STEPS.name_in(""));
    let send = bench.here.service_client::<<SimulateSteps as Action>::SendGoal>(&client("send_goal")).unwrap();
    let result = bench.here.service_client::<<SimulateSteps as Action>::GetResult>(&client("get_result")).unwrap();
    let cancel = bench.here.service_client::<minifactory_msgs::action_msgs::srv::CancelGoal>(&client("cancel_goal"));
    let cancel = cancel.unwrap();
    let steps = |number: u8, steps| {
        let goal = UUID { uuid: [number; 16] };
        let (accepted, _): (bool, _) =
            send.call(&(goal, SimulateStepsGoal { steps }).into(), PATIENCE).wait().unwrap().into();
        assert!(accepted);
        goal
    };
    let end = |goal: UUID| {
        let (status, result): (i8, SimulateStepsResult) = result.call(&goal.into(), PATIENCE).wait().unwrap().into();
        (status, result.result.result)
    };
    assert_eq!(end(steps(1, 5)), (GoalStatus::STATUS_ABORTED, Answer::RESULT_OPERATION_FAILED), "while it plays");
    bench.set_state(SimulationState::STATE_PAUSED);
    bench.step(1);
    let before_ns = bench.now_ns();
    assert_eq!(end(steps(2, 12)), (GoalStatus::STATUS_SUCCEEDED, Answer::RESULT_OK));
    assert_eq!(bench.now_ns(), before_ns + 12 * TICK_NS);
    let goal = steps(3, 1_000_000);
    let mut request = minifactory_msgs::action_msgs::srv::CancelGoalRequest::default();
    request.goal_info.goal_id = goal;
    cancel.call(&request, PATIENCE).wait().unwrap();
    assert_eq!(end(goal), (GoalStatus::STATUS_CANCELED, Answer::RESULT_OPERATION_FAILED));
    bench.end();
}

#[test]
fn a_run_is_not_reset_while_a_part_is_on_its_way_but_can_be_stopped() {
    let bench = Bench::new("--composed --speed 1");
    bench.step_until(DeliveryState::MOVING);
    // Who refuses hears of it later than this test.
    bench.step(20);
    let refused = bench.call(&simulation::RESET_SIMULATION, &ResetSimulationRequest::default()).result;
    assert_eq!(refused.result, Answer::RESULT_INCORRECT_STATE);
    assert!(refused.error_message.contains("feeder brings a part"), "{}", refused.error_message);
    assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), Answer::RESULT_OK);
    bench.wait_for(SimulationState::STATE_STOPPED);
    let scope = ResetSimulationRequest::SCOPE_TIME;
    let alone = bench.call(&simulation::RESET_SIMULATION, &ResetSimulationRequest { scope }).result;
    assert_eq!(alone.result, Answer::RESULT_FEATURE_UNSUPPORTED);
    bench.end();
}

#[test]
fn a_recorded_run_is_not_stopped_so_that_it_begins_again() {
    let work = TempDir::new().unwrap();
    let up = Up::new("--composed --duration 86400 --speed 1").record(&work.path().join("bag"));
    let bench = Bench::of(up);
    let failed = SetSimulationStateResponse::STATE_TRANSITION_ERROR;
    assert_eq!(bench.set_state(SimulationState::STATE_STOPPED), failed);
    assert_eq!(bench.state(), SimulationState::STATE_PLAYING);
    bench.end();
}

#[test]
fn parts_are_looked_at_moved_put_down_and_taken_away_also_while_time_stands_still() {
    let bench = Bench::new("--speed 1");
    bench.set_state(SimulationState::STATE_PAUSED);
    bench.step(1);
    let at_ns = bench.now_ns();
    let names = bench.names("");
    let loaded = names.len();
    assert_eq!(loaded, Scenario::default().parts_loaded as usize);
    let tagged = bench.call(&services::GET_ENTITY_INFO, &GetEntityInfoRequest { entity: names[0].clone() }).info.tags;
    assert_eq!(tagged[0], "grommet");
    assert_eq!(bench.state_of("nobody"), Err(Answer::RESULT_NOT_FOUND));
    assert_eq!(bench.delete("nobody"), Answer::RESULT_NOT_FOUND);
    assert_eq!(call(&bench.here, &services::LOAD_PARTS, &LoadPartsRequest { count: 2 }).loaded, 2);
    assert_eq!(bench.names("").len(), loaded + 2);

    // Two to a place that is free, and one to where that is.
    let plateau = on_plateau(0.060, 5.0);
    assert_eq!(bench.move_to(&names[0], "feeder/tray", plateau).result, Answer::RESULT_OK);
    let there = bench.state_of(&names[0]).unwrap();
    assert_eq!((there.header.frame_id.as_str(), ns_of_stamp(&there.header.stamp)), ("platen", at_ns));
    assert_eq!(bench.move_to(&names[1], "platen", there.pose).result, SetEntityStateResponse::INVALID_POSE);
    assert_eq!(bench.move_to(&names[0], "platen", there.pose).result, Answer::RESULT_OK, "where it is");
    let again = bench.state_of(&names[0]).unwrap();
    for (a, b) in [(again.pose.position.x, there.pose.position.x), (again.pose.position.y, there.pose.position.y)] {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    assert_eq!(bench.move_to(&names[1], "map", there.pose).result, SetEntityStateResponse::INVALID_POSE);
    let twisted = SetEntityStateRequest { entity: names[0].clone(), set_twist: true, ..Default::default() };
    let refused = bench.call(&services::SET_ENTITY_STATE, &twisted).result.result;
    assert_eq!(refused, Answer::RESULT_FEATURE_UNSUPPORTED);

    let spawnables = bench.call(&services::GET_SPAWNABLES, &GetSpawnablesRequest::default()).spawnables;
    let uri = spawnables[0].entity_resource.uri.as_str();
    let spawned = bench.spawn("mine", false, uri, on_plateau(0.060, 5.4));
    assert_eq!((spawned.result.result, spawned.entity_name.as_str()), (Answer::RESULT_OK, "mine"));
    let result = |spawned: SpawnEntityResponse| spawned.result.result;
    assert_eq!(result(bench.spawn("mine", false, uri, on_plateau(0.060, 5.6))), SpawnEntityResponse::NAME_NOT_UNIQUE);
    assert_eq!(result(bench.spawn("", false, uri, on_plateau(0.060, 5.6))), SpawnEntityResponse::NAME_INVALID);
    assert_eq!(result(bench.spawn("x", false, "", on_plateau(0.060, 5.6))), SpawnEntityResponse::NO_RESOURCE);
    assert_eq!(result(bench.spawn("x", false, "table", on_plateau(0.060, 5.6))), Answer::RESULT_NOT_FOUND);
    assert_eq!(result(bench.spawn("x", false, uri, on_plateau(0.2, 5.6))), SpawnEntityResponse::INVALID_POSE);
    let renamed = bench.spawn("mine", true, uri, on_plateau(0.060, 5.7));
    assert!(renamed.entity_name.starts_with("part_"), "{renamed:?}");
    assert_eq!(bench.names("").len(), loaded + 4);
    assert_eq!(bench.names("^mine$"), ["mine"]);
    assert_eq!(bench.delete("mine"), Answer::RESULT_OK);
    assert_eq!(bench.state_of("mine"), Err(Answer::RESULT_NOT_FOUND));

    // What was put down is fed and picked as any other part, and nobody misses those taken away.
    bench.set_state(SimulationState::STATE_PLAYING);
    let delivered = |state: &DeliveryState| state.delivered > 0;
    wait_for("a delivery", || bench.deliveries.try_iter().find(delivered));
    bench.end();
}

/// A hand turns the part under the open gripper: it is another part to the monitor then, which cannot tell how far that slid, and
/// it is not turned as it was presented.
#[test]
fn what_a_hand_turns_under_the_gripper_is_counted() {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs/blocks.yaml"));
    let Loaded::Scenario(mut scenario, _) = load(Some(file)).unwrap() else { panic!("no scenario") };
    // Wide enough for a block that is turned, and slow, so that there is time for the hand.
    scenario.stations[0].gripper.opening_m = Some(0.012);
    scenario.stations[0].manipulator.z.speed_max = 0.004;
    let bench = Bench::of(Up::new("--composed --duration 86400 --speed 1").scenario(&scenario));
    let presented = bench.step_until(DeliveryState::PRESENTED);
    let states = bench.call(&services::GET_ENTITIES_STATES, &GetEntitiesStatesRequest::default());
    let station = (scenario.stations[0].x_m, scenario.stations[0].y_m);
    let offset_m = |state: &EntityState| (state.pose.position.x - station.0).hypot(state.pose.position.y - station.1);
    let found = states.entities.iter().zip(&states.states).min_by(|a, b| offset_m(a.1).total_cmp(&offset_m(b.1)));
    let (name, state) = found.unwrap();
    assert!(offset_m(state) < 1e-3, "{name} lies {} m from the axis", offset_m(state));
    let mut pose = state.pose;
    let yaw_rad = 2.0 * pose.orientation.z.atan2(pose.orientation.w) + 0.3;
    (pose.orientation.z, pose.orientation.w) = (0.5 * yaw_rad).sin_cos();
    let moved = bench.move_to(name, "platen", pose);
    assert_eq!(moved.result, Answer::RESULT_OK, "{}", moved.error_message);
    let before = presented.delivered;
    bench.set_state(SimulationState::STATE_PLAYING);
    wait_for("its delivery", || bench.deliveries.try_iter().find(|state| state.delivered > before));
    let outcome = bench.end();
    assert!(outcome.number("slips_unknown") >= 1.0, "{}", outcome.summary());
    assert!(outcome.number("wrong_yaw_delivered") >= 1.0, "{}", outcome.summary());
    assert!(outcome.number("max_yaw_error_rad") > 0.2, "{}", outcome.summary());
}
