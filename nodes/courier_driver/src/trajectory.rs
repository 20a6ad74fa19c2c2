//! Trajectory goals as `follow_joint_trajectory` states them.

use feeder_control::courier::{AXES, Tolerances, Trajectory, TrajectoryPoint};
use feeder_runtime::node::ns_of_stamp;
use minifactory_msgs::control_msgs::action::{FollowJointTrajectoryGoal, FollowJointTrajectoryResult};
use minifactory_msgs::control_msgs::msg::JointTolerance;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use nalgebra::Vector3;

/// Why a goal is refused: an error code of the action's result, and the reason.
pub(crate) type Refusal = (i32, String);

/// Reads a goal that arrived at `now_ns`; joints may come in any order, but each must be there once.
pub(crate) fn parse(goal: &FollowJointTrajectoryGoal, now_ns: u64) -> Result<(Trajectory, Tolerances), Refusal> {
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
    let time = &goal.goal_time_tolerance;
    let goal_time_s = f64::from(time.sec) + f64::from(time.nanosec) * 1e-9;
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
        time_s: f64::from(point.time_from_start.sec) + f64::from(point.time_from_start.nanosec) * 1e-9,
        position: vector("positions", &point.positions)?,
        velocity: optional("velocities", &point.velocities)?,
        acceleration: optional("accelerations", &point.accelerations)?,
    })
}
