//! The services and actions of the feeder: name, type, who serves, who calls and how late a call may be.

use minifactory_msgs::action::DeliverPart;
use minifactory_msgs::control_msgs::action::FollowJointTrajectory;
use minifactory_msgs::interface::User::{Feedback, Outside};
use minifactory_msgs::interface::{ActionSpec, ServiceSpec};
use minifactory_msgs::simulation_interfaces::srv::{
    DeleteEntity, GetEntities, GetEntitiesStates, GetEntityInfo, GetEntityState, GetSpawnables, SetEntityState,
    SpawnEntity,
};
use minifactory_msgs::srv::{
    ChangeRecipe, LoadParts, Pick, Purge, ReleaseArea, ReportHandover, ReserveArea, SetWaveform,
};
use minifactory_msgs::std_srvs::srv::{SetBool, Trigger};

use crate::interface::interface;
use crate::interface::namespaces::{FEEDER, PLATEN, STATION};
use crate::interface::nodes::{
    COURIER_DRIVER, DELIVERY_PLANNER, OVERHEAD_MANIPULATOR, PART_SIMULATOR, PLATEN_ARBITER, WAVEFORM_GENERATOR,
};

interface! {
    /// All services and actions of this module.
    all;

    /// Moves the courier along a trajectory, x and y in m, yaw in rad
    FOLLOW_JOINT_TRAJECTORY: ActionSpec<FollowJointTrajectory> = ActionSpec::new(FEEDER, "follow_joint_trajectory"),
        [COURIER_DRIVER] => [Feedback(DELIVERY_PLANNER), Outside("operators")];

    /// Brings a part under a station's tool, within a tolerance in m and a time in s
    DELIVER_PART: ActionSpec<DeliverPart> = ActionSpec::new(FEEDER, "deliver_part"),
        [DELIVERY_PLANNER] => [Feedback(OVERHEAD_MANIPULATOR), Outside("agents")];

    /// Whether a presented part was taken, and that the tool is clear
    REPORT_HANDOVER: ServiceSpec<ReportHandover> = ServiceSpec::new(FEEDER, "report_handover"),
        [DELIVERY_PLANNER] => [Feedback(OVERHEAD_MANIPULATOR), Outside("agents")];

    /// Changes what is fed
    CHANGE_RECIPE: ServiceSpec<ChangeRecipe> = ServiceSpec::new(FEEDER, "change_recipe"),
        [DELIVERY_PLANNER] => [Outside("agents")];

    /// Feeds until the plateau is empty, within a time in s
    PURGE: ServiceSpec<Purge> = ServiceSpec::new(FEEDER, "purge"),
        [DELIVERY_PLANNER] => [Outside("agents")];

    /// Ends the planner's fault
    RESET: ServiceSpec<Trigger> = ServiceSpec::new(FEEDER, "reset"),
        [DELIVERY_PLANNER] => [Outside("agents")];

    /// Turns feeding on and off
    SET_FEEDING: ServiceSpec<SetBool> = ServiceSpec::new(FEEDER, "set_feeding"),
        [WAVEFORM_GENERATOR] => [Feedback(DELIVERY_PLANNER), Outside("operators")];

    /// Replaces the waveform, m/s² or rad/s² by s
    SET_WAVEFORM: ServiceSpec<SetWaveform> = ServiceSpec::new(FEEDER, "set_waveform"),
        [WAVEFORM_GENERATOR] => [Feedback(DELIVERY_PLANNER), Outside("operators")];

    /// Brings the courier to rest
    HALT: ServiceSpec<Trigger> = ServiceSpec::new(FEEDER, "halt"),
        [COURIER_DRIVER] => [Outside("operators")];

    /// Drives the courier to where it started
    HOME: ServiceSpec<Trigger> = ServiceSpec::new(FEEDER, "home"),
        [COURIER_DRIVER] => [Outside("operators")];

    /// Stops the courier until `reset_fault`
    EMERGENCY_STOP: ServiceSpec<Trigger> = ServiceSpec::new(FEEDER, "emergency_stop"),
        [COURIER_DRIVER] => [Outside("operators")];

    /// Ends the courier's fault
    RESET_FAULT: ServiceSpec<Trigger> = ServiceSpec::new(FEEDER, "reset_fault"),
        [COURIER_DRIVER] => [Outside("operators")];

    /// Drops parts onto the tray
    LOAD_PARTS: ServiceSpec<LoadParts> = ServiceSpec::new(FEEDER, "load_parts"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// The names of the parts that match a filter; in no namespace where the run has one feeder
    GET_ENTITIES: ServiceSpec<GetEntities> = ServiceSpec::new(FEEDER, "get_entities"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// What a part is; in no namespace where the run has one feeder
    GET_ENTITY_INFO: ServiceSpec<GetEntityInfo> = ServiceSpec::new(FEEDER, "get_entity_info"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Ground truth of a part, m and rad; in no namespace where the run has one feeder
    GET_ENTITY_STATE: ServiceSpec<GetEntityState> = ServiceSpec::new(FEEDER, "get_entity_state"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Ground truth of the parts that match a filter, m and rad; in no namespace where the run has one feeder
    GET_ENTITIES_STATES: ServiceSpec<GetEntitiesStates> = ServiceSpec::new(FEEDER, "get_entities_states"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Puts a part elsewhere on the tray, m; in no namespace where the run has one feeder
    SET_ENTITY_STATE: ServiceSpec<SetEntityState> = ServiceSpec::new(FEEDER, "set_entity_state"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Puts a new part onto the tray, m; in no namespace where the run has one feeder
    SPAWN_ENTITY: ServiceSpec<SpawnEntity> = ServiceSpec::new(FEEDER, "spawn_entity"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Takes a part off the tray; in no namespace where the run has one feeder
    DELETE_ENTITY: ServiceSpec<DeleteEntity> = ServiceSpec::new(FEEDER, "delete_entity"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// What can be put onto the tray; in no namespace where the run has one feeder
    GET_SPAWNABLES: ServiceSpec<GetSpawnables> = ServiceSpec::new(FEEDER, "get_spawnables"),
        [PART_SIMULATOR] => [Outside("operators")];

    /// Closes a simulated gripper, its place and opening in m; with several feeders it lies in `/<station>/<feeder>`
    PICK: ServiceSpec<Pick> = ServiceSpec::new(STATION, "pick"),
        [PART_SIMULATOR] => [Feedback(OVERHEAD_MANIPULATOR)];

    /// Leases an area of the platen, m, for a time in s, or renews a lease
    RESERVE_AREA: ServiceSpec<ReserveArea> = ServiceSpec::new(PLATEN, "reserve_area"),
        [PLATEN_ARBITER] => [Feedback(DELIVERY_PLANNER), Outside("agents")];

    /// Ends a lease
    RELEASE_AREA: ServiceSpec<ReleaseArea> = ServiceSpec::new(PLATEN, "release_area"),
        [PLATEN_ARBITER] => [Feedback(DELIVERY_PLANNER), Outside("agents")];
}
