//! The parts as entities of a simulation: looked at, put down, moved and taken away by the services of
//! `simulation_interfaces`. A part that is moved is a new one to all but its name: its way till then is no slip.

use std::collections::BTreeMap;

use feeder_model::camera::MountedTray;
use feeder_model::tray::Place;
use feeder_runtime::node::{Declare, Publisher, Server, StepIo, stamp_of_ns};
use feeder_scenario::plan::PartSimulatorConfig;
use feeder_sim::camera::TrayShot;
use feeder_sim::parts::{Part, PartBulk};
use feeder_wire::entity::{self, Entity, Filter, FilterError, Stand};
use feeder_wire::pick::{self, GripperClosed, TakenPart};
use feeder_wire::pose::UprightPose;
use feeder_wire::{frames, services};
use minifactory_msgs::geometry_msgs::msg::{Pose, Vector3 as Vector};
use minifactory_msgs::msg::PickEvent;
use minifactory_msgs::simulation_interfaces::msg::{
    Bounds, EntityCategory, EntityFilters, EntityInfo, EntityState, Resource, Result as Answer, Spawnable,
};
use minifactory_msgs::simulation_interfaces::srv::{
    DeleteEntity, DeleteEntityResponse, GetEntities, GetEntitiesResponse, GetEntitiesStates, GetEntitiesStatesResponse,
    GetEntityInfo, GetEntityInfoResponse, GetEntityState, GetEntityStateResponse, GetSpawnables, GetSpawnablesResponse,
    SetEntityState, SetEntityStateRequest, SetEntityStateResponse, SpawnEntity, SpawnEntityRequest,
    SpawnEntityResponse,
};
use minifactory_msgs::std_msgs::msg::Header;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// How far a part that is put down may lean away from a resting pose, rad: a ramp leans by less.
const LEAN_MAX_RAD: f64 = 0.35;

/// Longest name of a part, bytes.
const NAME_BYTES_MAX: usize = 64;

/// How the name of a part begins that was given none.
const UNNAMED: &str = "part_";

/// Handles of the entities' ports.
pub(crate) struct Ports {
    list: Server<GetEntities>,
    info: Server<GetEntityInfo>,
    state: Server<GetEntityState>,
    states: Server<GetEntitiesStates>,
    set_state: Server<SetEntityState>,
    spawn: Server<SpawnEntity>,
    delete: Server<DeleteEntity>,
    spawnables: Server<GetSpawnables>,
}

impl Ports {
    /// In the namespace where the configuration says entities are asked for.
    pub(crate) fn declare(io: &mut Declare, namespace: &str) -> Self {
        Self {
            list: io.server_in(namespace, &services::GET_ENTITIES),
            info: io.server_in(namespace, &services::GET_ENTITY_INFO),
            state: io.server_in(namespace, &services::GET_ENTITY_STATE),
            states: io.server_in(namespace, &services::GET_ENTITIES_STATES),
            set_state: io.server_in(namespace, &services::SET_ENTITY_STATE),
            spawn: io.server_in(namespace, &services::SPAWN_ENTITY),
            delete: io.server_in(namespace, &services::DELETE_ENTITY),
            spawnables: io.server_in(namespace, &services::GET_SPAWNABLES),
        }
    }
}

/// What is known of the parts as entities.
pub(crate) struct Entities {
    tray: MountedTray,
    tray_frame: String,
    /// The names that parts were given, by their numbers.
    names: BTreeMap<u32, String>,
}

/// The parts, and where their tray is.
pub(crate) struct World<'a> {
    pub(crate) bulk: &'a mut PartBulk,
    pub(crate) tray: &'a TrayShot,
    pub(crate) stamp_ns: u64,
    /// Who is told of parts that are taken away.
    pub(crate) events: Publisher<PickEvent>,
}

fn answer(result: u8, message: impl Into<String>) -> Answer {
    Answer { result, error_message: message.into() }
}

fn ok() -> Answer {
    answer(Answer::RESULT_OK, "")
}

fn refused_filter(error: &FilterError) -> Answer {
    let result = match error {
        FilterError::Unsupported(_) => Answer::RESULT_FEATURE_UNSUPPORTED,
        FilterError::Malformed(_) => Answer::RESULT_OPERATION_FAILED,
    };
    answer(result, error.to_string())
}

/// Whether a part may be called so: as a name in ROS, and not as one that was given no name.
fn is_name(name: &str) -> bool {
    let mut letters = name.chars();
    let begins_well = letters.next().is_some_and(|first| first.is_ascii_alphabetic() || first == '_');
    let reserved = name.strip_prefix(UNNAMED).is_some_and(|rest| rest.bytes().all(|byte| byte.is_ascii_digit()));
    name.len() <= NAME_BYTES_MAX
        && begins_well
        && letters.all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
        && !reserved
}

/// Where a part is to be put down: radius (m), angle and yaw (rad) in the tray frame, and its resting pose.
type Spot = (f64, f64, f64, usize);

impl Entities {
    pub(crate) fn new(config: &PartSimulatorConfig) -> Self {
        Self { tray: config.tray, tray_frame: frames::tray(&config.feeder), names: BTreeMap::new() }
    }

    /// Answers what has been asked. While `refusal` says why not, nothing is changed.
    pub(crate) fn serve(&mut self, io: &mut StepIo, ports: &Ports, world: &mut World, refusal: &Result<(), String>) {
        let ready = || refusal.clone().map_err(|reason| answer(Answer::RESULT_INCORRECT_STATE, reason));
        for (asker, request) in io.requests(&ports.spawn) {
            let spawned = ready().and_then(|()| self.spawn(world, request));
            let (entity_name, result) = spawned.map_or_else(|error| (String::new(), error), |name| (name, ok()));
            io.reply(&ports.spawn, asker, &SpawnEntityResponse { result, entity_name });
        }
        for (asker, request) in io.requests(&ports.set_state) {
            let moved = ready().and_then(|()| self.set_state(io, world, request));
            io.reply(&ports.set_state, asker, &SetEntityStateResponse { result: moved.err().unwrap_or_else(ok) });
        }
        for (asker, request) in io.requests(&ports.delete) {
            let deleted = ready().and_then(|()| self.delete(io, world, &request.entity));
            io.reply(&ports.delete, asker, &DeleteEntityResponse { result: deleted.err().unwrap_or_else(ok) });
        }
        for (asker, request) in io.requests(&ports.list) {
            let found = self.find(world, request.filters);
            let (entities, result) = found.map_or_else(|error| (Vec::new(), error), |found| (names(found), ok()));
            io.reply(&ports.list, asker, &GetEntitiesResponse { result, entities });
        }
        for (asker, request) in io.requests(&ports.states) {
            let found = self.find(world, request.filters);
            let (found, result) = found.map_or_else(|error| (Vec::new(), error), |found| (found, ok()));
            let states = found.iter().map(|(_, part)| self.state(world, part)).collect();
            io.reply(&ports.states, asker, &GetEntitiesStatesResponse { result, entities: names(found), states });
        }
        for (asker, request) in io.requests(&ports.state) {
            let state = self.part_called(world, &request.entity).map(|part| self.state(world, &part));
            let (state, result) = state.map_or_else(|error| (EntityState::default(), error), |state| (state, ok()));
            io.reply(&ports.state, asker, &GetEntityStateResponse { result, state });
        }
        for (asker, request) in io.requests(&ports.info) {
            let info = self.part_called(world, &request.entity).map(|part| info(world, &part));
            let (info, result) = info.map_or_else(|error| (EntityInfo::default(), error), |info| (info, ok()));
            io.reply(&ports.info, asker, &GetEntityInfoResponse { result, info });
        }
        for (asker, request) in io.requests(&ports.spawnables) {
            io.reply(&ports.spawnables, asker, &spawnables(world, &request.sources));
        }
    }

    fn name_of(&self, part: &Part) -> String {
        self.names.get(&part.id).cloned().unwrap_or_else(|| format!("{UNNAMED}{}", part.id))
    }

    fn part_called(&self, world: &World, name: &str) -> Result<Part, Answer> {
        let found = world.bulk.parts().iter().find(|part| self.name_of(part) == name);
        found.copied().ok_or_else(|| answer(Answer::RESULT_NOT_FOUND, format!("there is no entity {name:?}")))
    }

    fn find(&self, world: &World, filters: EntityFilters) -> Result<Vec<(String, Part)>, Answer> {
        let filter = Filter::from_message(filters).map_err(|error| refused_filter(&error))?;
        let radius_m = world.bulk.part_type().mesh.radius_m();
        let admitted = |(name, part): &(String, Part)| {
            let centre_m = self.stand(world, part).platen_from_part.translation.vector.into();
            let category = EntityCategory::CATEGORY_OBJECT;
            filter.admits(&Entity { name, category, tags: &tags(world, part), centre_m, radius_m })
        };
        let named = world.bulk.parts().iter().map(|part| (self.name_of(part), *part));
        Ok(named.filter(admitted).collect())
    }

    fn platen_from_tray(&self, world: &World) -> Isometry3<f64> {
        let on_platen = world.tray.platen_from_tray;
        let (at, yaw_rad) = (on_platen.translation, on_platen.rotation.angle());
        frames::upright(at.x, at.y, self.tray.floor_height_m, yaw_rad)
    }

    fn stand(&self, world: &World, part: &Part) -> Stand {
        let pose = &world.bulk.part_type().poses[part.pose];
        let geometry = &self.tray.geometry;
        let (radius_m, angle_rad) = (part.radius_m(), part.angle_rad());
        let lying = geometry.tray_from_lying(part.place, radius_m, angle_rad, part.yaw_rad, pose.com_height_m);
        let platen_from_tray = self.platen_from_tray(world);
        let climbing = if part.place == Place::Ramp { geometry.pitch_m_per_rad() / radius_m } else { 0.0 };
        let relative = part.velocity_m_s().push(climbing * part.tangential_velocity_m_s());
        let arm = platen_from_tray.rotation * part.position_m().push(0.0);
        let turning = Vector3::new(0.0, 0.0, world.tray.yaw_rate_rad_s);
        Stand {
            platen_from_part: platen_from_tray * lying * pose.orientation,
            velocity_m_s: world.tray.velocity_m_s.push(0.0)
                + turning.cross(&arm)
                + platen_from_tray.rotation * relative,
            yaw_rate_rad_s: world.tray.yaw_rate_rad_s + part.yaw_rate_rad_s,
        }
    }

    fn state(&self, world: &World, part: &Part) -> EntityState {
        let header = Header { stamp: stamp_of_ns(world.stamp_ns), frame_id: String::new() };
        entity::to_state(&header, &self.stand(world, part))
    }

    /// Where a pose says that a part is to lie; its height follows from the tray.
    fn spot(&self, world: &World, frame: &str, pose: &Pose) -> Result<Spot, String> {
        let platen_from_tray = self.platen_from_tray(world);
        let pose = entity::pose_in_tray(frame, pose, &self.tray_frame, &platen_from_tray);
        let pose = pose.map_err(|error| error.to_string())?;
        let leans = world.bulk.part_type().poses.iter().enumerate().flat_map(|(index, resting)| {
            resting.up.iter().map(move |up| ((pose.rotation * up).angle(&Vector3::z()), index, up))
        });
        let nearest = leans.min_by(|(a, ..), (b, ..)| a.total_cmp(b));
        let (lean_rad, index, up) = nearest.ok_or("the part has no resting pose")?;
        if lean_rad > LEAN_MAX_RAD {
            return Err(format!(
                "the part leans {lean_rad:.2} rad away from its nearest resting pose, allowed are {LEAN_MAX_RAD} rad"
            ));
        }
        let resting = &world.bulk.part_type().poses[index];
        // Where symmetry makes two turns the same pose, the shortest turn stands for the other one too.
        let laid = if resting.up.first() == Some(up) {
            resting.orientation
        } else {
            UnitQuaternion::rotation_between(up, &Vector3::z()).unwrap_or(resting.orientation)
        };
        let heading = pose.rotation * laid.inverse() * Vector3::x();
        let at = pose.translation.vector;
        Ok((at.xy().norm(), at.y.atan2(at.x).rem_euclid(std::f64::consts::TAU), heading.y.atan2(heading.x), index))
    }

    fn spawn(&mut self, world: &mut World, request: SpawnEntityRequest) -> Result<String, Answer> {
        let SpawnEntityRequest { name, allow_renaming, entity_resource, entity_namespace, initial_pose } = request;
        let is_taken = world.bulk.parts().iter().any(|part| self.name_of(part) == name);
        match (is_name(&name), is_taken) {
            (true, false) => {}
            _ if allow_renaming => {}
            (true, true) => {
                return Err(answer(SpawnEntityResponse::NAME_NOT_UNIQUE, format!("{name:?} is there already")));
            }
            (false, _) => {
                let message = format!(
                    "name {name:?}: up to {NAME_BYTES_MAX} letters, digits and _, not beginning with a digit, and not {UNNAMED} with a number; \
                     or allow_renaming"
                );
                return Err(answer(SpawnEntityResponse::NAME_INVALID, message));
            }
        }
        if !entity_namespace.is_empty() {
            let message = format!("entity_namespace {entity_namespace:?}: a part has no interfaces, leave it empty");
            return Err(answer(SpawnEntityResponse::NAMESPACE_INVALID, message));
        }
        let class = &world.bulk.part_type().name;
        match (entity_resource.uri.as_str(), entity_resource.resource_string.is_empty()) {
            (uri, _) if uri == class => {}
            ("", true) => {
                return Err(answer(SpawnEntityResponse::NO_RESOURCE, format!("uri is empty, allowed is {class:?}")));
            }
            ("", false) => {
                let message = format!("parts are not made from text: leave resource_string empty, uri is {class:?}");
                return Err(answer(SpawnEntityResponse::UNSUPPORTED_FORMAT, message));
            }
            (uri, _) => {
                return Err(answer(Answer::RESULT_NOT_FOUND, format!("uri {uri:?}, allowed is {class:?}")));
            }
        }
        let invalid = |reason: String| answer(SpawnEntityResponse::INVALID_POSE, reason);
        let spot = self.spot(world, &initial_pose.header.frame_id, &initial_pose.pose).map_err(invalid)?;
        let (radius_m, angle_rad, yaw_rad, pose) = spot;
        let id = world.bulk.put(radius_m, angle_rad, yaw_rad, pose).map_err(|error| invalid(error.to_string()))?;
        if is_name(&name) && !is_taken {
            // Those that grippers took are not told of otherwise.
            self.names.retain(|id, _| world.bulk.parts().iter().any(|part| part.id == *id));
            self.names.insert(id, name.clone());
            return Ok(name);
        }
        Ok(format!("{UNNAMED}{id}"))
    }

    fn set_state(&mut self, io: &mut StepIo, world: &mut World, request: SetEntityStateRequest) -> Result<(), Answer> {
        let SetEntityStateRequest { entity, state, set_pose, set_twist, set_acceleration } = request;
        let part = self.part_called(world, &entity)?;
        if set_twist || set_acceleration {
            let message = "a part is put down at rest: set_pose alone can be asked for";
            return Err(answer(Answer::RESULT_FEATURE_UNSUPPORTED, message));
        }
        if !set_pose {
            return Err(answer(Answer::RESULT_OPERATION_FAILED, "set_pose is false: there is nothing to set"));
        }
        let invalid = |reason: String| answer(SetEntityStateResponse::INVALID_POSE, reason);
        let spot = self.spot(world, &state.header.frame_id, &state.pose).map_err(invalid)?;
        let (radius_m, angle_rad, yaw_rad, pose) = spot;
        let put = world.bulk.replace(part.id, radius_m, angle_rad, yaw_rad, pose);
        let id = put.map_err(|error| invalid(error.to_string()))?;
        self.names.remove(&part.id);
        self.names.insert(id, entity);
        tell(io, world, &part);
        Ok(())
    }

    fn delete(&mut self, io: &mut StepIo, world: &mut World, name: &str) -> Result<(), Answer> {
        let part = self.part_called(world, name)?;
        world.bulk.remove(part.id);
        self.names.remove(&part.id);
        tell(io, world, &part);
        Ok(())
    }
}

fn names(found: Vec<(String, Part)>) -> Vec<String> {
    found.into_iter().map(|(name, _)| name).collect()
}

fn tags<'a>(world: &'a World, part: &Part) -> [&'a str; 3] {
    let kind = world.bulk.part_type();
    let place = match part.place {
        Place::Ramp => "ramp",
        Place::Plateau => "plateau",
        Place::Falling => "falling",
    };
    [&kind.name, &kind.poses[part.pose].name, place]
}

fn info(world: &World, part: &Part) -> EntityInfo {
    let tags = tags(world, part);
    let [class, pose, place] = tags;
    EntityInfo {
        category: EntityCategory { category: EntityCategory::CATEGORY_OBJECT },
        description: format!("{class} in the resting pose {pose}, place: {place}"),
        tags: tags.map(str::to_owned).to_vec(),
    }
}

fn spawnables(world: &World, sources: &[String]) -> GetSpawnablesResponse {
    let kind = world.bulk.part_type();
    let bounds = [Vector::default(), Vector { x: kind.mesh.radius_m(), y: 0.0, z: 0.0 }];
    let part = Spawnable {
        entity_resource: Resource { uri: kind.name.clone(), resource_string: String::new() },
        description: format!("the part that is fed, {} g", 1e3 * kind.mass_kg),
        spawn_bounds: Bounds { r#type: Bounds::TYPE_SPHERE, points: bounds.to_vec() },
    };
    let unknown = if sources.is_empty() { String::new() } else { format!("no such sources: {}", sources.join(", ")) };
    GetSpawnablesResponse { result: answer(Answer::RESULT_OK, unknown), spawnables: vec![part] }
}

/// Says that a part was taken out of its place by hand, so that nobody misses it.
fn tell(io: &mut StepIo, world: &World, part: &Part) {
    let taken = TakenPart { id: part.id, resting_pose: u8::try_from(part.pose).unwrap_or(u8::MAX) };
    let closed = GripperClosed { station: None, tool_in_platen: UprightPose::default(), taken: Some(taken) };
    io.publish(&world.events, &PickEvent { header: io.header(frames::PLATEN), ..pick::to_event(&closed) });
}
