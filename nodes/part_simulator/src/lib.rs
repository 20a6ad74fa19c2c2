//! The part simulator: owns the parts, moves them as the tray moves, takes the camera's pictures, and lets grippers pick.
//!
//! The state after a block of tray motion carries the stamp of the block's end.
//!
//! While it is not active the parts lie still in the tray, wherever that goes, and nobody sees them.

mod camera;
mod entities;
mod markers;

use std::time::Duration;

use feeder_model::seed::seed_for;
use feeder_runtime::node::{
    Declare, FeederNode, NodeError, Publisher, Server, Start, StepIo, Subscriber, ns_of_stamp, stamp_of_ns,
};
use feeder_scenario::plan::{NodeConfig, PartSimulatorConfig};
use feeder_sim::camera::TrayShot;
use feeder_sim::parts::{OpenGripper, Part, PartBulk, PickedPart};
use feeder_wire::parts::{self, TruePart, TrueParts};
use feeder_wire::pick::{self, GripRequest, Gripped, GripperClosed, TakenPart};
use feeder_wire::{frames, nodes, services, topics};
use minifactory_msgs::msg::{PartStates, PickEvent, TrayMotion};
use minifactory_msgs::srv::{LoadParts, LoadPartsResponse, Pick};
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::{Isometry2, Vector2};

use camera::Camera;
use entities::{Entities, World};
use markers::Drawing;

/// Largest height of a tool above the plateau at which its gripper reaches a part, m.
const GRIP_HEIGHT_M: f64 = 0.002;

/// Distance of the tray from the feeding place up to which the hopper's parts fall onto it, m.
const HOPPER_M: f64 = 1e-3;

/// Handles of the simulator's ports.
pub struct Ports {
    motion: Subscriber<TrayMotion>,
    load: Server<LoadParts>,
    picks: Vec<Server<Pick>>,
    parts: Publisher<PartStates>,
    events: Publisher<PickEvent>,
    camera: camera::Ports,
    entities: entities::Ports,
    markers: markers::Ports,
}

/// The part simulator.
pub struct PartSimulator {
    ports: Ports,
    bulk: PartBulk,
    camera: Camera,
    entities: Entities,
    drawing: Drawing,
    frame: String,
    plateau_height_m: f64,
    /// The tray at the end of the motion known so far.
    tray: TrayShot,
    /// When the motion known so far ends, ns.
    known_until_ns: u64,
    /// Where the hopper is, and below how many parts it adds some.
    hopper: (Vector2<f64>, usize),
}

impl FeederNode for PartSimulator {
    const NAME: &'static str = nodes::PART_SIMULATOR;
    const START: Option<Start> = Some(Start::Active);
    type Config = PartSimulatorConfig;
    type Ports = Ports;

    fn tick(config: &PartSimulatorConfig) -> Duration {
        Duration::from_millis(config.tick_ms)
    }

    fn check(config: &PartSimulatorConfig) -> Result<(), NodeError> {
        NodeConfig::check(config).map_err(NodeError::new)
    }

    fn declare(io: &mut Declare, config: &PartSimulatorConfig) -> Ports {
        Ports {
            motion: io.subscriber(&topics::TRAY_MOTION),
            load: io.server(&services::LOAD_PARTS),
            picks: config.pick_namespaces.iter().map(|namespace| io.server_in(namespace, &services::PICK)).collect(),
            parts: io.publisher(&topics::PARTS),
            events: io.publisher(&topics::PICKS),
            camera: camera::Ports::declare(io),
            entities: entities::Ports::declare(io, &config.entity_namespace),
            markers: markers::Ports::declare(io),
        }
    }

    fn open(ports: Ports, config: &PartSimulatorConfig) -> Result<Self, NodeError> {
        let seed = seed_for(config.seed, Self::NAME);
        let part = config.part_type().map_err(NodeError::new)?;
        let camera = Camera::open(config, &part)?;
        let drawing = Drawing::new(config, &part);
        for hazard in part.hazards() {
            tracing::warn!("{}: likely in bulk, and not modelled: {hazard}", part.name);
        }
        let mut bulk = config.parts_in_bulk(part, seed).map_err(NodeError::new)?;
        let wanted = usize::try_from(config.parts_loaded).map_err(NodeError::new)?;
        let outcome = bulk.load(wanted);
        if outcome.refused > 0 {
            tracing::warn!("{} of {wanted} parts found no room on the tray", outcome.refused);
        }
        let start = config.tray_start;
        Ok(Self {
            ports,
            bulk,
            camera,
            entities: Entities::new(config),
            drawing,
            frame: frames::tray(&config.feeder),
            plateau_height_m: config.tray.plateau_height_m(),
            tray: TrayShot::still(Isometry2::new(start.xy(), start.z)),
            known_until_ns: 0,
            hopper: (config.hopper_m, usize::try_from(config.refill_below).map_err(NodeError::new)?),
        })
    }

    fn not_parameters() -> &'static [&'static str] {
        &["part"]
    }

    fn attend(&mut self, io: &mut StepIo) {
        let ready = io.check_active(Self::NAME);
        for (asker, request) in io.requests(&self.ports.load) {
            let response = match ready.clone() {
                Ok(()) => self.load(request.count),
                Err(message) => LoadPartsResponse { loaded: 0, message },
            };
            io.reply(&self.ports.load, asker, &response);
        }
        let (stamp_ns, events) = (self.known_until_ns, self.ports.events);
        let mut world = World { bulk: &mut self.bulk, tray: &self.tray, stamp_ns, events };
        self.entities.serve(io, &self.ports.entities, &mut world, &ready);
    }

    fn step(&mut self, io: &mut StepIo) -> Result<(), NodeError> {
        for message in io.take(&self.ports.motion) {
            self.move_parts(io, &message)?;
        }
        if io.is_active() {
            self.refill();
        }
        self.attend(io);
        for station in 0..self.ports.picks.len() {
            let server = self.ports.picks[station];
            for (asker, request) in io.requests(&server) {
                let gripped = io.check_active(Self::NAME).and_then(|()| self.pick(io, pick::from_request(request)));
                io.reply(&server, asker, &pick::to_response(gripped));
            }
        }
        if !io.is_active() {
            return Ok(());
        }
        io.publish(&self.ports.parts, &self.part_states());
        self.drawing.draw(io, &self.ports.markers, self.known_until_ns, &self.bulk);
        self.camera.look(io, &self.ports.camera, self.known_until_ns, &self.tray, &self.bulk)
    }
}

impl PartSimulator {
    fn move_parts(&mut self, io: &StepIo, message: &TrayMotion) -> Result<(), NodeError> {
        let block = feeder_wire::tray_motion::from_message(message).map_err(NodeError::new)?;
        if io.is_active() {
            self.bulk.step(&block).map_err(NodeError::new)?;
        }
        if let Some(last) = block.samples.last() {
            let dt = block.sample_period_s;
            let end = last.position + (last.velocity + 0.5 * dt * last.acceleration) * dt;
            let velocity = last.velocity + dt * last.acceleration;
            self.tray = TrayShot {
                platen_from_tray: Isometry2::new(end.xy(), end.z),
                velocity_m_s: velocity.xy(),
                yaw_rate_rad_s: velocity.z,
            };
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a block lasts a tick")]
        let length_ns = (block.sample_period_s * block.samples.len() as f64 * 1e9).round() as u64;
        self.known_until_ns = ns_of_stamp(&message.header.stamp) + length_ns;
        Ok(())
    }

    /// Adds a part while too few are left and the tray stands under the hopper.
    fn refill(&mut self) {
        let (place_m, least) = self.hopper;
        let away_m = (self.tray.platen_from_tray.translation.vector - place_m).norm();
        if self.bulk.parts().len() < least && away_m < HOPPER_M {
            self.bulk.load(1);
        }
    }

    fn load(&mut self, count: u32) -> LoadPartsResponse {
        let wanted = usize::try_from(count).unwrap_or(usize::MAX);
        let outcome = self.bulk.load(wanted);
        let message = match outcome.refused {
            0 => String::new(),
            refused => format!("no room for {refused} of {count} parts"),
        };
        LoadPartsResponse { loaded: u32::try_from(outcome.loaded).unwrap_or(u32::MAX), message }
    }

    /// Closes a gripper, and tells of it.
    fn pick(&mut self, io: &mut StepIo, grip: GripRequest) -> Gripped {
        let picked = self.reach(&grip);
        let taken = picked
            .as_ref()
            .ok()
            .map(|part| TakenPart { id: part.id, resting_pose: u8::try_from(part.pose).unwrap_or(u8::MAX) });
        let closed = GripperClosed { station: Some(grip.station), tool_in_platen: grip.tool_in_platen, taken };
        let event = PickEvent { header: io.header(frames::PLATEN), ..pick::to_event(&closed) };
        io.publish(&self.ports.events, &event);
        picked.map(|part| part.id)
    }

    fn reach(&mut self, grip: &GripRequest) -> Result<PickedPart, String> {
        let tool = &grip.tool_in_platen;
        let height_m = tool.z_m - self.plateau_height_m;
        if !(tool.x_m.is_finite() && tool.y_m.is_finite() && height_m.abs() <= GRIP_HEIGHT_M) {
            return Err(format!("the tool is {height_m} m above the plateau, allowed is {GRIP_HEIGHT_M} m either way"));
        }
        let width_m = self.bulk.part_type().width_min_m();
        if grip.opening_m.is_nan() || grip.opening_m <= width_m {
            return Err(format!(
                "the opening is {} m, allowed is more than the part's least width, {width_m} m",
                grip.opening_m
            ));
        }
        let in_tray = self.tray.platen_from_tray.inverse() * Isometry2::new([tool.x_m, tool.y_m].into(), tool.yaw_rad);
        let (at, yaw_rad) = (in_tray.translation, in_tray.rotation.angle());
        let gripper = OpenGripper { x_m: at.x, y_m: at.y, yaw_rad, opening_m: grip.opening_m };
        self.bulk.pick(&gripper).map_err(|missed| missed.to_string())
    }

    fn part_states(&self) -> PartStates {
        let counters = self.bulk.counters();
        let count = |value: u64| u32::try_from(value).unwrap_or(u32::MAX);
        let truth = TrueParts {
            parts: self.bulk.parts().iter().map(|part| true_part(part, &self.bulk.part_type().name)).collect(),
            fed: count(counters.fed),
            recirculated: count(counters.recirculated),
            picked: count(counters.picked),
            jams: count(counters.jams),
        };
        let header = Header { stamp: stamp_of_ns(self.known_until_ns), frame_id: self.frame.clone() };
        PartStates { header, ..parts::to_message(truth) }
    }
}

fn true_part(part: &Part, class: &str) -> TruePart {
    TruePart {
        id: part.id,
        part_class: class.to_owned(),
        place: part.place,
        resting_pose: u8::try_from(part.pose).unwrap_or(u8::MAX),
        radius_m: part.radius_m(),
        angle_rad: part.angle_rad(),
        yaw_rad: part.yaw_rad,
        radial_velocity_m_s: part.radial_velocity_m_s(),
        tangential_velocity_m_s: part.tangential_velocity_m_s(),
        sticking: part.is_sticking(),
        stranded: part.stranded,
    }
}
