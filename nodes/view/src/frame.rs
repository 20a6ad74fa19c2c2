//! The state of everything, as one message.

use std::collections::{BTreeMap, VecDeque};

use feeder_model::delivery::Phase;
use feeder_model::part::Refusals;
use feeder_model::tray::Place;
use feeder_wire::area::{LeasedArea, PlatenLeases, from_leases};
use feeder_wire::courier_state::{CourierActivity, NOT_ACTIVE};
use feeder_wire::delivery_state::PlannerStand;
use feeder_wire::parts::{TruePart, TrueParts};
use feeder_wire::{courier_state, delivery_state, joints, odometry, part_candidates, parts};
use minifactory_msgs::action::DeliverPartResult;
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::ns_of_stamp;
use nalgebra::Vector2;
use serde_json::{Map, Value, json};

use crate::description::{self, Description, Feeder, upright};
use crate::heard::{FeederHeard, Heard};
use crate::numbers::{coarse, fine, finite, metres, quaternion, radians, seconds};

/// Time over which the speed of a part along the track is taken, s: some periods of any waveform.
const SPEED_OVER_S: f64 = 0.5;

/// A stamp in seconds.
pub(crate) fn time_s(stamp: &Time) -> f64 {
    ns_of_stamp(stamp) as f64 * 1e-9
}

/// A phase as the page names it.
pub(crate) fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::Idle => "idle",
        Phase::Feeding => "feeding",
        Phase::Stopping => "stopping",
        Phase::Settling => "settling",
        Phase::Looking => "looking",
        Phase::Reserving => "reserving",
        Phase::Moving => "moving",
        Phase::Presented => "presented",
        Phase::Returning => "returning",
        Phase::Purging => "purging",
        Phase::Fault => "fault",
    }
}

/// What people should know of a courier although nothing is broken.
pub(crate) fn remark(activity: &CourierActivity) -> Option<String> {
    activity.warning.clone().or_else(|| (!activity.active).then(|| NOT_ACTIVE.to_owned()))
}

/// What speaks against picking a part, as the page names it.
pub(crate) fn refusal_names(refusals: &Refusals) -> Vec<&'static str> {
    let Refusals { pose_unsure, pose_disagrees, off_plateau, part_too_near, wall_too_near } = *refusals;
    let all = [
        (pose_unsure, "pose_unsure"),
        (pose_disagrees, "pose_disagrees"),
        (off_plateau, "off_plateau"),
        (part_too_near, "part_too_near"),
        (wall_too_near, "wall_too_near"),
    ];
    all.iter().filter(|(is, _)| *is).map(|(_, name)| *name).collect()
}

/// What is remembered of a feeder from frame to frame.
#[derive(Default)]
pub(crate) struct FeederMemory {
    /// How far every part has come along the track, by its id.
    tracks: BTreeMap<u32, VecDeque<TrackPoint>>,
    /// Where the planner stands, of the messages taken so far.
    pub(crate) stand: Option<PlannerStand>,
}

/// Where a part was.
struct TrackPoint {
    time_s: f64,
    /// Angle along the track, counted on beyond a turn, rad.
    angle_rad: f64,
}

impl FeederMemory {
    /// Mean speed of a part along the track of late, m/s, counter-clockwise.
    fn track_speed_m_s(&mut self, time_s: f64, part: &TruePart) -> Option<f64> {
        let track = self.tracks.entry(part.id).or_default();
        if part.place == Place::Falling || track.back().is_some_and(|last| last.time_s > time_s) {
            track.clear();
            return None;
        }
        let last_rad = track.back().map_or(part.angle_rad, |last| last.angle_rad);
        let turn_rad = std::f64::consts::TAU;
        let step_rad = (part.angle_rad - last_rad + turn_rad / 2.0).rem_euclid(turn_rad) - turn_rad / 2.0;
        if track.back().is_none_or(|last| last.time_s < time_s) {
            track.push_back(TrackPoint { time_s, angle_rad: last_rad + step_rad });
        }
        while track.len() > 2 && track[1].time_s <= time_s - SPEED_OVER_S {
            track.pop_front();
        }
        let (first, last) = (track.front()?, track.back()?);
        let over_s = last.time_s - first.time_s;
        (over_s >= 0.2 * SPEED_OVER_S).then(|| (last.angle_rad - first.angle_rad) * part.radius_m / over_s)
    }
}

/// The time that the newest odometry is for; without any, that of the newest word of the parts or the planner.
pub(crate) fn newest_time_s(heard: &Heard) -> Option<f64> {
    let largest = |times: Vec<Option<f64>>| times.into_iter().flatten().reduce(f64::max);
    let of = |stamp: fn(&FeederHeard) -> Option<f64>| largest(heard.feeders.iter().map(stamp).collect());
    of(|feeder| Some(time_s(&feeder.odometry.latest()?.header.stamp)))
        .or_else(|| of(|feeder| Some(time_s(&feeder.parts.latest()?.header.stamp))))
        .or_else(|| of(|feeder| Some(time_s(&feeder.courier_state.latest()?.header.stamp))))
}

/// The parts of a frame that the graph tells.
pub(crate) fn graph_fields(cell: &Description, heard: &Heard, memories: &mut [FeederMemory]) -> Map<String, Value> {
    let leases = heard.leases.latest().map(|message| from_leases(&message)).unwrap_or_default();
    let mut feeders = Map::new();
    for ((feeder, inboxes), memory) in cell.feeders.iter().zip(&heard.feeders).zip(memories) {
        feeders.insert(feeder.name.clone(), feeder_fields(cell, feeder, inboxes, &leases, memory));
    }
    let stations = cell.stations.iter().zip(&heard.tools);
    let stations: Map<String, Value> = stations
        .map(|(station, inbox)| {
            let found = inbox.latest().and_then(|message| joints::from_message(&message).ok());
            let of = |axis: &str| {
                found.iter().flatten().find(|joint| joint.name.ends_with(axis)).map(|joint| joint.position)
            };
            let tool = of("z").map(|z_m| json!({ "tool_z_m": metres(z_m), "tool_yaw_rad": of("theta").map(radians) }));
            (station.name.clone(), tool.unwrap_or(Value::Null))
        })
        .collect();
    let mut fields = Map::new();
    fields.insert("feeders".to_owned(), Value::Object(feeders));
    fields.insert("stations".to_owned(), Value::Object(stations));
    fields.insert("leases".to_owned(), leases.leases.iter().map(lease).collect());
    fields.insert("waiting".to_owned(), json!(leases.waiting));
    fields
}

fn lease(lease: &LeasedArea) -> Value {
    let mut fields = description::area(&lease.area);
    fields["agent"] = json!(lease.agent);
    fields["lease_id"] = json!(lease.lease);
    fields["parked"] = json!(lease.parked);
    fields["occupied"] = json!(lease.occupied);
    fields["overdue"] = json!(lease.overdue);
    fields["expires_s"] = json!(seconds(lease.expires.as_secs_f64()));
    fields
}

fn feeder_fields(
    cell: &Description,
    feeder: &Feeder,
    heard: &FeederHeard,
    leases: &PlatenLeases,
    memory: &mut FeederMemory,
) -> Value {
    let odometry = heard.odometry.latest();
    let motion = odometry.as_ref().map(odometry::from_message);
    let courier = odometry.as_ref().zip(motion).map(|(message, motion)| {
        let (place, velocity) = (motion.position, motion.velocity);
        json!({
            "x_m": fine(place.x), "y_m": fine(place.y), "yaw_rad": fine(place.z),
            "vx_m_s": radians(velocity.x), "vy_m_s": radians(velocity.y), "yaw_rate_rad_s": radians(velocity.z),
            "stamp_s": seconds(time_s(&message.header.stamp)),
        })
    });
    let state = heard.courier_state.latest().map(courier_state::from_message).map(|state| {
        json!({
            "vibrating": state.vibrating, "moving": state.moving,
            "position_error_m": finite(fine(state.position_error_m)),
            "yaw_error_rad": finite(fine(state.yaw_error_rad)),
            "fault": state.fault, "warning": remark(&state),
        })
    });
    let here = motion.map(|motion| motion.position.xy());
    let trip = memory.stand.as_ref().and_then(|stand| trip(cell, feeder, leases, stand, here));
    let candidates = heard.candidates.latest().and_then(|message| {
        let seen = part_candidates::from_message(&message).ok()?;
        let parts: Vec<Value> = seen.iter().map(|part| candidate(cell, feeder, part)).collect();
        Some(json!({ "stamp_s": seconds(time_s(&message.header.stamp)), "parts": parts }))
    });
    let truth = heard.parts.latest().and_then(|message| {
        let stamp_s = time_s(&message.header.stamp);
        Some((stamp_s, parts::from_message(message).ok()?))
    });
    let (truth, speeds) = truth.map_or((Value::Null, json!({ "ramp": null, "plateau": null })), |(stamp_s, parts)| {
        truth_fields(cell, feeder, stamp_s, &parts, memory)
    });
    json!({
        "courier": courier,
        "courier_state": state,
        "delivery": memory.stand.as_ref().map(delivery),
        "trip": trip,
        "feeding": heard.waveform.latest().map(|waveform| waveform.enabled),
        "candidates": candidates,
        "truth": truth,
        "track_speed_m_s": speeds,
    })
}

fn delivery(stand: &PlannerStand) -> Value {
    let chosen = stand.chosen.as_ref().map(|chosen| {
        let place = chosen.position_in_tray_m;
        json!({ "x_m": metres(place.x), "y_m": metres(place.y), "yaw_rad": radians(chosen.yaw_in_tray_rad) })
    });
    json!({
        "phase": phase_name(stand.phase),
        "delivery_id": stand.delivery_id,
        "station": stand.station,
        "chosen": chosen,
        "fault": stand.fault,
        "accepted": stand.accepted,
        "delivered": stand.delivered,
        "failed": stand.failed_by_outcome.iter().sum::<u32>(),
        "parts_lost": stand.failed_by_outcome[usize::from(DeliverPartResult::PART_LOST)],
    })
}

/// Where the courier goes, as far as is told: along the line of its lease, else straight.
fn trip(
    cell: &Description,
    feeder: &Feeder,
    leases: &PlatenLeases,
    stand: &PlannerStand,
    here: Option<Vector2<f64>>,
) -> Option<Value> {
    let leased = leases.leases.iter().find(|lease| lease.agent == feeder.name && !lease.parked);
    let points = if let Some(lease) = leased {
        lease.area.points_m.clone()
    } else {
        let to = match stand.phase {
            Phase::Moving => {
                let station = cell.stations.iter().find(|station| Some(&station.name) == stand.station.as_ref())?;
                Vector2::new(station.x_m, station.y_m)
            }
            Phase::Returning => feeder.feeding_place().xy(),
            _ => return None,
        };
        vec![here?, to]
    };
    let points: Vec<[f64; 2]> = points.iter().map(|point| [metres(point.x), metres(point.y)]).collect();
    Some(json!({ "station": stand.station, "points_m": points }))
}

fn candidate(cell: &Description, feeder: &Feeder, part: &part_candidates::SeenPart) -> Value {
    let place = part.position_in_tray_m;
    let pose = part.pose_class.as_ref().and_then(|name| cell.part.poses.iter().find(|pose| pose.name == *name));
    let rise_m = feeder.tray.geometry.rise_m;
    json!({
        "id": part.id,
        "x_m": metres(place.x), "y_m": metres(place.y), "z_m": metres(rise_m),
        "yaw_rad": radians(part.yaw_in_tray_rad),
        "orientation_xyzw": pose.map(|pose| quaternion(&(upright(part.yaw_in_tray_rad) * pose.orientation))),
        "origin_z_m": pose.map(|pose| metres(rise_m + pose.com_height_m)),
        "pose_class": part.pose_class,
        "confidence": coarse(part.confidence),
        "radius_m": metres(part.radius_m),
        "part_gap_m": finite(metres(part.part_gap_m)),
        "wall_gap_m": finite(metres(part.wall_gap_m)),
        "may_be_picked": part.refusals.may_be_picked(),
        "refusals": refusal_names(&part.refusals),
    })
}

fn surface_number(place: Place) -> u8 {
    match place {
        Place::Ramp => 0,
        Place::Plateau => 1,
        Place::Falling => 2,
    }
}

/// The true parts in columns, and their mean speed on both surfaces.
fn truth_fields(
    cell: &Description,
    feeder: &Feeder,
    stamp_s: f64,
    truth: &TrueParts,
    memory: &mut FeederMemory,
) -> (Value, Value) {
    memory.tracks.retain(|id, _| truth.parts.iter().any(|part| part.id == *id));
    let lying: Vec<_> = truth.parts.iter().filter_map(|part| Some((part, cell.lying(&feeder.tray, part)?))).collect();
    let speeds: Vec<Option<f64>> = lying.iter().map(|(part, _)| memory.track_speed_m_s(stamp_s, part)).collect();
    let mean = |place: Place| {
        let on = lying.iter().zip(&speeds).filter(|((part, _), _)| part.place == place);
        let (sum, count) =
            on.filter_map(|(_, speed)| *speed).fold((0.0, 0_u32), |(sum, n), speed| (sum + speed, n + 1));
        (count > 0).then(|| metres(sum / f64::from(count)))
    };
    let means = json!({ "ramp": mean(Place::Ramp), "plateau": mean(Place::Plateau) });
    let column = |value: &dyn Fn(&TruePart) -> Value| lying.iter().map(|(part, _)| value(part)).collect::<Vec<_>>();
    let places: Vec<f64> = lying.iter().flat_map(|(_, (place, _))| [place.x, place.y, place.z].map(metres)).collect();
    let turns: Vec<f64> = lying.iter().flat_map(|(_, (_, turn))| quaternion(turn)).collect();
    let fields = json!({
        "stamp_s": seconds(stamp_s),
        "id": column(&|part| json!(part.id)),
        "surface": column(&|part| json!(surface_number(part.place))),
        "pose": column(&|part| json!(part.resting_pose)),
        "position_m": places,
        "orientation_xyzw": turns,
        "track_speed_m_s": speeds.into_iter().map(|speed| speed.map(metres)).collect::<Vec<_>>(),
        "sticking": column(&|part| json!(u8::from(part.sticking))),
        "stranded": column(&|part| json!(u8::from(part.stranded))),
    });
    (fields, means)
}

/// Takes in what the planner has said since the last time, each word in turn.
pub(crate) fn stands(heard: &FeederHeard) -> Vec<(f64, PlannerStand)> {
    let messages = heard.deliveries.take().into_iter();
    let stand = |message: minifactory_msgs::msg::DeliveryState| {
        let at_s = time_s(&message.header.stamp);
        Some((at_s, delivery_state::from_message(message).ok()?))
    };
    messages.filter_map(stand).collect()
}
