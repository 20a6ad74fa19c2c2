//! What is shown: the cell as the plan of its run describes it, and the first message that every viewer gets.

use std::f64::consts::TAU;

use feeder_control::courier::{CourierLimits, WaveformEnvelope};
use feeder_model::area::Area;
use feeder_model::camera::{CameraModel, MountedTray};
use feeder_model::part::{PartType, PartTypeError};
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::plan::{
    CourierDriverConfig, DeliveryPlannerConfig, OverheadManipulatorConfig, PartSimulatorConfig, RunMonitorConfig,
    RunPlan, WaveformGeneratorConfig,
};
use feeder_wire::parts::TruePart;
use nalgebra::{UnitQuaternion, Vector3};
use serde_json::{Value, json};

use crate::numbers::{metres, quaternion, radians, small};

/// Version of the messages between server and page.
const PROTOCOL: u32 = 1;
/// Sides of a full circle about a feeder or station that the platen's drawing leaves room for, m.
const ROOM_M: f64 = 0.06;

/// Where what is shown comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A run of this process.
    Run,
    /// A graph that runs already.
    Graph,
    /// A bag that is being played.
    Bag,
}

impl Source {
    fn name(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Graph => "graph",
            Self::Bag => "bag",
        }
    }
}

/// A feeder of the cell.
pub(crate) struct Feeder {
    pub(crate) name: String,
    pub(crate) namespace: String,
    pub(crate) tray: MountedTray,
    pub(crate) camera: CameraModel,
    camera_period_s: f64,
    pub(crate) servo_period_s: f64,
    /// What the generator begins with, and what the courier can run.
    pub(crate) waveform: Waveform,
    pub(crate) envelope: WaveformEnvelope,
    limits: CourierLimits,
    planner: Option<DeliveryPlannerConfig>,
    footprint_radius_m: Option<f64>,
}

/// A station of the cell.
pub(crate) struct Station {
    pub(crate) name: String,
    pub(crate) namespace: String,
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    plateau_height_m: f64,
    gripper_opening_m: f64,
    pub(crate) serves: Vec<String>,
}

/// The cell that is shown.
pub(crate) struct Description {
    pub(crate) feeders: Vec<Feeder>,
    pub(crate) stations: Vec<Station>,
    pub(crate) part: PartType,
    scenario: String,
    seed: u64,
    end_s: f64,
    tick_s: f64,
}

impl Description {
    /// Of the run that a plan describes. `scenario` is what the scenario is called.
    ///
    /// # Errors
    /// A part that is none.
    pub(crate) fn new(plan: &RunPlan, scenario: &str) -> Result<Self, DescriptionError> {
        let of = |namespace: &str| namespace.to_owned();
        let monitor = plan.of_kind::<RunMonitorConfig>().next().map(|(_, config)| config);
        let mut feeders = Vec::new();
        let mut part = None;
        for (namespace, simulator) in plan.of_kind::<PartSimulatorConfig>() {
            let here = |lives_in: &str| lives_in == namespace;
            let driver = plan.of_kind::<CourierDriverConfig>().find(|(lives_in, _)| here(lives_in));
            let generator = plan.of_kind::<WaveformGeneratorConfig>().find(|(lives_in, _)| here(lives_in));
            let planner = plan.of_kind::<DeliveryPlannerConfig>().find(|(lives_in, _)| here(lives_in));
            let (Some((_, driver)), Some((_, generator))) = (driver, generator) else {
                return Err(DescriptionError::NoCourier { namespace: of(namespace) });
            };
            if part.is_none() {
                part = Some(PartType::new(&simulator.part)?);
            }
            feeders.push(Feeder {
                name: simulator.feeder.clone(),
                namespace: of(namespace),
                tray: simulator.tray,
                camera: simulator.camera.model.clone(),
                camera_period_s: simulator.camera.period_ms as f64 * 1e-3,
                servo_period_s: driver.courier.servo_period_s,
                waveform: generator.waveform.clone(),
                envelope: generator.envelope,
                limits: generator.envelope.limits,
                planner: planner.map(|(_, config)| config.clone()),
                footprint_radius_m: monitor.map(|monitor| monitor.footprint_radius_m),
            });
        }
        let stations = plan.of_kind::<OverheadManipulatorConfig>().map(|(namespace, config)| Station {
            name: config.station.clone(),
            namespace: of(namespace),
            x_m: config.x_m,
            y_m: config.y_m,
            plateau_height_m: config.plateau_height_m,
            gripper_opening_m: config.gripper_opening_m,
            serves: config.feeders.iter().map(|feeder| feeder.name.clone()).collect(),
        });
        Ok(Self {
            stations: stations.collect(),
            part: part.ok_or(DescriptionError::NoFeeder)?,
            feeders,
            scenario: scenario.to_owned(),
            seed: plan.provenance.seed,
            end_s: plan.run.duration_s,
            tick_s: plan.time.tick_ns() as f64 * 1e-9,
        })
    }

    /// The first message of every viewer.
    pub(crate) fn hello(&self, source: Source, read_only: bool, controls: &Value) -> Value {
        json!({
            "type": "hello",
            "protocol": PROTOCOL,
            "version": env!("CARGO_PKG_VERSION"),
            "read_only": read_only,
            "source": source.name(),
            "scenario": self.scenario,
            "seed": self.seed,
            "end_s": (source == Source::Run).then_some(self.end_s),
            "tick_s": self.tick_s,
            "platen": self.platen(),
            "part": self.part(),
            "feeders": self.feeders.iter().map(|feeder| self.feeder(feeder)).collect::<Vec<_>>(),
            "stations": self.stations.iter().map(station).collect::<Vec<_>>(),
            "controls": controls,
        })
    }

    /// Names of the poses that may be asked for.
    pub(crate) fn pose_classes(&self) -> impl Iterator<Item = &str> {
        self.part.poses.iter().map(|pose| pose.name.as_str())
    }

    /// How a part truly lies in the tray frame: the place of its centre of mass, m, and how it is turned.
    pub(crate) fn lying(&self, tray: &MountedTray, part: &TruePart) -> Option<(Vector3<f64>, UnitQuaternion<f64>)> {
        let pose = self.part.poses.get(usize::from(part.resting_pose))?;
        let TruePart { place, radius_m, angle_rad, yaw_rad, .. } = *part;
        let lying = tray.geometry.tray_from_lying(place, radius_m, angle_rad, yaw_rad, pose.com_height_m);
        Some((lying.translation.vector, lying.rotation * pose.orientation))
    }

    /// The rectangle of the platen that is worth drawing.
    fn platen(&self) -> Value {
        let mut bounds = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        let mut cover = |x_m: f64, y_m: f64, radius_m: f64| {
            bounds[0] = bounds[0].min(x_m - radius_m);
            bounds[1] = bounds[1].max(x_m + radius_m);
            bounds[2] = bounds[2].min(y_m - radius_m);
            bounds[3] = bounds[3].max(y_m + radius_m);
        };
        for station in &self.stations {
            // A courier stands under it with the part, which lies up to its radius off the courier's centre.
            let reach_m = self.feeders.iter().map(Feeder::radius_m).fold(0.0, f64::max);
            cover(station.x_m, station.y_m, 2.0 * reach_m);
        }
        for feeder in &self.feeders {
            let place = feeder.feeding_place();
            cover(place.x, place.y, feeder.radius_m() + ROOM_M);
        }
        let [x_m_min, x_m_max, y_m_min, y_m_max] = bounds.map(metres);
        json!({ "x_m_min": x_m_min, "x_m_max": x_m_max, "y_m_min": y_m_min, "y_m_max": y_m_max })
    }

    fn part(&self) -> Value {
        let part = &self.part;
        let vertices: Vec<f64> =
            part.mesh.vertices().iter().flat_map(|vertex| [vertex.x, vertex.y, vertex.z].map(small)).collect();
        let triangles: Vec<u32> = part.mesh.triangles().iter().flatten().copied().collect();
        let poses = part.poses.iter().enumerate().map(|(index, pose)| {
            json!({
                "name": pose.name,
                "orientation_xyzw": quaternion(&pose.orientation),
                "height_m": small(pose.com_height_m),
                "drawn": self.drawn(index),
                "wanted": part.wanted_poses.contains(&index),
            })
        });
        json!({
            "name": part.name,
            "vertices_m": vertices,
            "triangles": triangles,
            "poses": poses.collect::<Vec<_>>(),
            "friction_static": part.friction.static_coefficient(),
            "friction_kinetic": part.friction.kinetic_coefficient(),
        })
    }

    /// The part in few triangles as it lies in a pose, in its own frame.
    fn drawn(&self, pose: usize) -> Value {
        let turned_back = self.part.poses[pose].orientation.inverse();
        let corners = self.part.drawn(pose).into_iter().flatten().map(|corner| turned_back * corner);
        let vertices: Vec<f64> = corners.flat_map(|corner| [corner.x, corner.y, corner.z].map(small)).collect();
        json!({ "triangles": (0..vertices.len() / 3).collect::<Vec<_>>(), "vertices_m": vertices })
    }

    fn feeder(&self, feeder: &Feeder) -> Value {
        let Feeder { name, namespace, tray, camera, limits, planner, .. } = feeder;
        let geometry = &tray.geometry;
        let (pose, intrinsics) = (camera.pose(), camera.intrinsics_px());
        let place = feeder.feeding_place();
        let keep_out = planner.iter().flat_map(|planner| &planner.keep_out).map(area).collect::<Vec<_>>();
        json!({
            "name": name,
            "namespace": namespace,
            "tray": {
                "outer_radius_m": geometry.outer_radius_m,
                "inner_radius_m": geometry.inner_radius_m,
                "rise_m": geometry.rise_m,
                "ramp_angle_rad": geometry.ramp_angle_rad,
                "floor_height_m": tray.floor_height_m,
                "lip_m": tray.lip_m,
                "wall_thickness_m": tray.wall_thickness_m,
            },
            "footprint_radius_m": feeder.footprint_radius_m.map(metres),
            "feeding_place": { "x_m": metres(place.x), "y_m": metres(place.y), "yaw_rad": radians(place.z) },
            "keep_out": keep_out,
            "tether": { "anchor_m": limits.tether_anchor_m, "length_m": limits.tether_length_m },
            "camera": {
                "width_px": camera.width_px(),
                "height_px": camera.height_px(),
                "period_s": feeder.camera_period_s,
                "focal_length_px": camera.focal_length_px(),
                "principal_point_px": [intrinsics[(0, 2)], intrinsics[(1, 2)]],
                "position_in_platen_m": [pose.x_m, pose.y_m, pose.height_m],
                "yaw_rad": pose.yaw_rad,
            },
            "limits": {
                "x_m_min": limits.x_m_min,
                "x_m_max": limits.x_m_max,
                "y_m_min": limits.y_m_min,
                "y_m_max": limits.y_m_max,
                "yaw_rad_max": limits.yaw_rad_max,
                "speed_m_s_max": limits.speed_m_s_max,
                "acceleration_m_s2_max": limits.acceleration_m_s2_max,
                "force_n_max": limits.force_n_max,
                "torque_n_m_max": limits.torque_n_m_max,
            },
            "waveform": waveform_fields(&feeder.waveform),
            "servo_period_s": feeder.servo_period_s,
            "pose_classes": self.pose_classes().collect::<Vec<_>>(),
            "part_class": self.part.name,
        })
    }
}

impl Feeder {
    /// Where the courier feeds: x and y on the platen, m, and yaw, rad.
    pub(crate) fn feeding_place(&self) -> Vector3<f64> {
        self.planner.as_ref().map_or(self.envelope.start, |planner| planner.delivery.feeding_place)
    }

    fn radius_m(&self) -> f64 {
        self.footprint_radius_m.unwrap_or(self.tray.geometry.outer_radius_m)
    }
}

fn station(station: &Station) -> Value {
    json!({
        "name": station.name,
        "x_m": station.x_m,
        "y_m": station.y_m,
        "tool_height_m": metres(station.plateau_height_m),
        "gripper_opening_m": metres(station.gripper_opening_m),
        "serves": station.serves,
    })
}

/// An area as the page reads it.
pub(crate) fn area(area: &Area) -> Value {
    let points: Vec<[f64; 2]> = area.points_m.iter().map(|point| [metres(point.x), metres(point.y)]).collect();
    json!({ "points_m": points, "radius_m": metres(area.radius_m) })
}

/// The name of a waveform's axis.
pub(crate) fn axis_name(axis: Axis) -> &'static str {
    match axis {
        Axis::X => "x",
        Axis::Y => "y",
        Axis::Yaw => "yaw",
    }
}

/// A waveform as the page reads it, but for its number, its name and whether it runs.
pub(crate) fn waveform_fields(waveform: &Waveform) -> Value {
    let segments = waveform.segments().iter();
    let segments: Vec<Value> = segments
        .map(|segment| json!({ "duration_s": segment.duration_s, "acceleration": segment.acceleration }))
        .collect();
    json!({
        "axis": axis_name(waveform.axis()),
        "period_s": waveform.period_s(),
        "start_velocity": waveform.start_velocity(),
        "segments": segments,
        "velocity_peak": waveform.peak_speed(),
        "acceleration_peak": waveform.peak_acceleration(),
    })
}

/// A turn about the vertical.
pub(crate) fn upright(yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad.rem_euclid(TAU))
}

/// A plan that describes nothing that can be shown.
#[derive(Debug, thiserror::Error)]
pub enum DescriptionError {
    /// A part that is none.
    #[error(transparent)]
    Part(#[from] PartTypeError),
    /// Nothing feeds.
    #[error("the plan has no part_simulator: there is no feeder to show")]
    NoFeeder,
    /// A feeder that cannot move.
    #[error("the plan has no courier_driver or no waveform_generator in {namespace}")]
    NoCourier {
        /// Where they should be.
        namespace: String,
    },
}
