//! Trajectory goals as `follow_joint_trajectory` states them.

use feeder_core::courier::{AXES, Trajectory, TrajectoryPoint};
use minifactory_msgs::control_msgs::action::FollowJointTrajectoryGoal;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use nalgebra::Vector3;

/// Reads a goal; joints may come in any order, but each must be there once.
pub(crate) fn parse(goal: &FollowJointTrajectoryGoal) -> Result<Trajectory, String> {
    let names = &goal.trajectory.joint_names;
    let mut columns = [0; 3];
    for (axis, column) in AXES.iter().zip(&mut columns) {
        let mut places = (0..names.len()).filter(|&place| names[place] == *axis);
        *column = match (places.next(), places.next()) {
            (Some(place), None) if names.len() == AXES.len() => place,
            _ => return Err(format!("joint_names = {names:?}, allowed is each of {AXES:?} once")),
        };
    }
    let points = goal.trajectory.points.iter().enumerate().map(|(index, point)| read_point(index, point, columns));
    Ok(Trajectory { points: points.collect::<Result<_, _>>()? })
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
