//! Trajectory goals as `follow_joint_trajectory` states them.

use std::time::Duration;

use feeder_model::trajectory::{AXES, Tolerances, Trajectory, TrajectoryPoint};
use minifactory_msgs::builtin_interfaces::msg::Duration as DurationMessage;
use minifactory_msgs::control_msgs::action::{FollowJointTrajectoryGoal, FollowJointTrajectoryResult};
use minifactory_msgs::control_msgs::msg::JointTolerance;
use minifactory_msgs::ns_of_stamp;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use nalgebra::Vector3;

/// Why a goal is refused: an error code of the action's result, and the reason.
pub type Refusal = (i32, String);

/// A goal: the trajectory, begun when it arrives, and its tolerances.
#[must_use]
pub fn to_goal(trajectory: &Trajectory, tolerances: &Tolerances) -> FollowJointTrajectoryGoal {
    let values = |vector: &Vector3<f64>| vector.iter().copied().collect();
    let by_joint = |position: &Vector3<f64>, velocity: &Vector3<f64>| {
        let stated = (0..AXES.len()).filter(|&axis| position[axis] != 0.0 || velocity[axis] != 0.0);
        let tolerance = |axis: usize| JointTolerance {
            name: AXES[axis].to_owned(),
            position: position[axis],
            velocity: velocity[axis],
            acceleration: 0.0,
        };
        stated.map(tolerance).collect()
    };
    let mut goal = FollowJointTrajectoryGoal {
        path_tolerance: by_joint(&tolerances.path_position, &tolerances.path_velocity),
        goal_tolerance: by_joint(&tolerances.goal_position, &tolerances.goal_velocity),
        goal_time_tolerance: duration(tolerances.goal_time_s),
        ..FollowJointTrajectoryGoal::default()
    };
    goal.trajectory.joint_names = AXES.map(str::to_owned).to_vec();
    let points = trajectory.points.iter().map(|point| JointTrajectoryPoint {
        positions: values(&point.position),
        velocities: point.velocity.as_ref().map(values).unwrap_or_default(),
        accelerations: point.acceleration.as_ref().map(values).unwrap_or_default(),
        effort: Vec::new(),
        time_from_start: duration(point.time_s),
    });
    goal.trajectory.points = points.collect();
    goal
}

/// A duration, exact to 1 ns; negative ones are whole seconds less a part, as ROS 2 has them.
fn duration(seconds: f64) -> DurationMessage {
    let whole = seconds.floor();
    let time = Duration::try_from_secs_f64(seconds - whole).unwrap_or_default();
    #[expect(clippy::cast_possible_truncation, reason = "saturates at 68 years")]
    let sec = (whole as i32).saturating_add(i32::try_from(time.as_secs()).unwrap_or(0));
    DurationMessage { sec, nanosec: time.subsec_nanos() }
}

fn seconds(duration: &DurationMessage) -> f64 {
    f64::from(duration.sec) + f64::from(duration.nanosec) * 1e-9
}

/// Reads a goal that arrived at `now_ns`; joints may come in any order, but each must be there once.
///
/// # Errors
/// What the result of a refused goal says.
pub fn from_goal(goal: &FollowJointTrajectoryGoal, now_ns: u64) -> Result<(Trajectory, Tolerances), Refusal> {
    let names = &goal.trajectory.joint_names;
    let mut columns = [0; 3];
    for (axis, column) in AXES.iter().zip(&mut columns) {
        let mut places = (0..names.len()).filter(|&place| names[place] == *axis);
        *column = match (places.next(), places.next()) {
            (Some(place), None) if names.len() == AXES.len() => place,
            _ => {
                let reason = format!("joint_names = {names:?}, allowed is each of {AXES:?} once");
                return Err((FollowJointTrajectoryResult::INVALID_JOINTS, reason));
            }
        };
    }
    let points = goal.trajectory.points.iter().enumerate().map(|(index, point)| read_point(index, point, columns));
    let trajectory = Trajectory { points: points.collect::<Result<_, _>>().map_err(invalid)? };
    check_stamp(goal, &trajectory, now_ns)?;
    Ok((trajectory, read_tolerances(goal)?))
}

fn invalid(reason: impl Into<String>) -> Refusal {
    (FollowJointTrajectoryResult::INVALID_GOAL, reason.into())
}

/// A trajectory begins when it arrives; one that is stamped must not be over, nor wait.
fn check_stamp(goal: &FollowJointTrajectoryGoal, trajectory: &Trajectory, now_ns: u64) -> Result<(), Refusal> {
    let stamp_ns = ns_of_stamp(&goal.trajectory.header.stamp);
    if stamp_ns == 0 {
        return Ok(());
    }
    if stamp_ns > now_ns {
        return Err(invalid("header.stamp lies in the future, allowed is 0 (now) or the present"));
    }
    #[expect(clippy::cast_precision_loss, reason = "exact for 104 days")]
    let late_s = (now_ns - stamp_ns) as f64 * 1e-9;
    if late_s > trajectory.duration_s() {
        let reason = format!("header.stamp is {late_s:.3} s old, and the trajectory over");
        return Err((FollowJointTrajectoryResult::OLD_HEADER_TIMESTAMP, reason));
    }
    Ok(())
}

fn read_tolerances(goal: &FollowJointTrajectoryGoal) -> Result<Tolerances, Refusal> {
    let unread = [
        ("multi_dof_trajectory", goal.multi_dof_trajectory.points.len()),
        ("component_path_tolerance", goal.component_path_tolerance.len()),
        ("component_goal_tolerance", goal.component_goal_tolerance.len()),
    ];
    if let Some((field, _)) = unread.iter().find(|(_, count)| *count > 0) {
        return Err(invalid(format!("{field} is given, allowed is none: the courier has joints only")));
    }
    let [path_position, path_velocity] = by_axis("path_tolerance", &goal.path_tolerance)?;
    let [goal_position, goal_velocity] = by_axis("goal_tolerance", &goal.goal_tolerance)?;
    let goal_time_s = seconds(&goal.goal_time_tolerance);
    Ok(Tolerances { path_position, path_velocity, goal_position, goal_velocity, goal_time_s })
}

/// Tolerances of position and velocity of each axis; 0, the default, for an axis that is not named.
fn by_axis(field: &str, tolerances: &[JointTolerance]) -> Result<[Vector3<f64>; 2], Refusal> {
    let mut found = [Vector3::zeros(); 2];
    for tolerance in tolerances {
        let Some(axis) = AXES.iter().position(|axis| *axis == tolerance.name) else {
            let reason = format!("{field} names {:?}, allowed are {AXES:?}", tolerance.name);
            return Err((FollowJointTrajectoryResult::INVALID_JOINTS, reason));
        };
        if tolerance.acceleration > 0.0 || tolerance.acceleration.is_nan() {
            let reason = format!("{field} of {} bounds the acceleration, which is not measured", tolerance.name);
            return Err(invalid(reason));
        }
        found[0][axis] = tolerance.position;
        found[1][axis] = tolerance.velocity;
    }
    Ok(found)
}

fn read_point(index: usize, point: &JointTrajectoryPoint, columns: [usize; 3]) -> Result<TrajectoryPoint, String> {
    let vector = |field: &str, values: &[f64]| {
        if values.len() == AXES.len() {
            Ok(Vector3::from(columns.map(|column| values[column])))
        } else {
            Err(format!("point {index}: {field} has {} values, allowed is one for each joint", values.len()))
        }
    };
    let optional = |field: &str, values: &[f64]| {
        if values.is_empty() { Ok(None) } else { vector(field, values).map(Some) }
    };
    Ok(TrajectoryPoint {
        time_s: seconds(&point.time_from_start),
        position: vector("positions", &point.positions)?,
        velocity: optional("velocities", &point.velocities)?,
        acceleration: optional("accelerations", &point.accelerations)?,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-2.0..2.0_f64).prop_map(Vector3::from)
    }

    prop_compose! {
        fn point()(
            // In ns, which is what a message holds.
            time_ns in 0..600_000_000_000_u64,
            position in vector(),
            velocity in prop::option::of(vector()),
            acceleration in prop::option::of(vector()),
        ) -> TrajectoryPoint {
            TrajectoryPoint { time_s: Duration::from_nanos(time_ns).as_secs_f64(), position, velocity, acceleration }
        }
    }

    prop_compose! {
        fn tolerances()(
            path_position in vector(),
            path_velocity in vector(),
            goal_position in vector(),
            goal_velocity in vector(),
            goal_time_ms in -1_000..60_000_i32,
        ) -> Tolerances {
            let goal_time_s = f64::from(goal_time_ms) / 1e3;
            Tolerances { path_position, path_velocity, goal_position, goal_velocity, goal_time_s }
        }
    }

    proptest! {
        #[test]
        fn a_goal_survives_the_round_trip_with_its_joints_in_any_order(
            points in prop::collection::vec(point(), 1..6),
            tolerances in tolerances(),
            turn in 0..3_usize,
        ) {
            let sent = Trajectory { points };
            let mut goal = to_goal(&sent, &tolerances);
            goal.trajectory.joint_names.rotate_left(turn);
            for point in &mut goal.trajectory.points {
                for values in [&mut point.positions, &mut point.velocities, &mut point.accelerations] {
                    let turn = turn.min(values.len());
                    values.rotate_left(turn);
                }
            }
            let (came, allowed) = from_goal(&goal, 5).unwrap();
            prop_assert!((allowed.goal_time_s - tolerances.goal_time_s).abs() < 1e-9);
            prop_assert_eq!(Tolerances { goal_time_s: tolerances.goal_time_s, ..allowed }, tolerances);
            prop_assert_eq!(came.points.len(), sent.points.len());
            for (came, sent) in came.points.iter().zip(&sent.points) {
                prop_assert!((came.time_s - sent.time_s).abs() <= 1e-9);
                prop_assert_eq!(&TrajectoryPoint { time_s: sent.time_s, ..came.clone() }, sent);
            }
        }
    }

    #[test]
    fn goals_that_cannot_be_are_refused_with_a_code_and_a_reason() {
        let sent = Trajectory { points: vec![TrajectoryPoint::at_rest(1.0, Vector3::zeros())] };
        let good = to_goal(&sent, &Tolerances::default());
        let refused = |change: fn(&mut FollowJointTrajectoryGoal)| {
            let mut goal = good.clone();
            change(&mut goal);
            from_goal(&goal, 5_000_000_000).unwrap_err()
        };
        type Code = FollowJointTrajectoryResult;
        let (code, reason) = refused(|goal| "elbow".clone_into(&mut goal.trajectory.joint_names[1]));
        assert!(code == Code::INVALID_JOINTS && reason.contains("elbow"), "{reason}");
        let (code, reason) = refused(|goal| _ = goal.trajectory.points[0].velocities.pop());
        assert!(code == Code::INVALID_GOAL && reason.contains("point 0: velocities has 2 values"), "{reason}");
        let (code, _) = refused(|goal| goal.trajectory.header.stamp.sec = 3);
        assert_eq!(code, Code::OLD_HEADER_TIMESTAMP);
        let (code, reason) = refused(|goal| goal.trajectory.header.stamp.sec = 6);
        assert!(code == Code::INVALID_GOAL && reason.contains("future"), "{reason}");
    }
}
