//! Trajectories as `follow_joint_trajectory` states them: goals, how they are followed, and how they ended.

use std::time::Duration;

use feeder_model::trajectory::{AXES, Tolerances, Trajectory, TrajectoryPoint};
use minifactory_msgs::builtin_interfaces::msg::Duration as DurationMessage;
use minifactory_msgs::control_msgs::action::{
    FollowJointTrajectoryFeedback, FollowJointTrajectoryGoal, FollowJointTrajectoryResult,
};
use minifactory_msgs::control_msgs::msg::JointTolerance;
use minifactory_msgs::ns_of_stamp;
use minifactory_msgs::trajectory_msgs::msg::JointTrajectoryPoint;
use nalgebra::Vector3;

use crate::numbered::{UnknownNumber, numbered};

/// How a goal ended, in the terms of the action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrajectoryEnd {
    /// It was followed to its end, or ended by somebody's wish.
    Successful,
    /// It cannot be followed, or another goal replaced it.
    InvalidGoal,
    /// Its joints are not those of the courier.
    InvalidJoints,
    /// It was over before it arrived.
    TooOld,
    /// The courier left the tolerance about the path.
    PathViolated,
    /// The courier missed the end.
    GoalViolated,
}

numbered! {
    /// The error code of an end.
    end_number,
    /// The end of an error code.
    end_of,
    "error_code", "-5 to 0",
    TrajectoryEnd as i32 {
        Successful = FollowJointTrajectoryResult::SUCCESSFUL,
        InvalidGoal = FollowJointTrajectoryResult::INVALID_GOAL,
        InvalidJoints = FollowJointTrajectoryResult::INVALID_JOINTS,
        TooOld = FollowJointTrajectoryResult::OLD_HEADER_TIMESTAMP,
        PathViolated = FollowJointTrajectoryResult::PATH_TOLERANCE_VIOLATED,
        GoalViolated = FollowJointTrajectoryResult::GOAL_TOLERANCE_VIOLATED,
    }
}

/// How a goal ended, and the reason for people; empty: there is nothing to say.
pub type EndOfGoal = (TrajectoryEnd, String);

/// An end as a result.
#[must_use]
pub fn to_result((end, reason): EndOfGoal) -> FollowJointTrajectoryResult {
    FollowJointTrajectoryResult { error_code: end_number(end), error_string: reason }
}

/// The end of a result.
///
/// # Errors
/// An error code that is not known.
pub fn from_result(message: FollowJointTrajectoryResult) -> Result<EndOfGoal, UnknownNumber> {
    Ok((end_of(message.error_code)?, message.error_string))
}

/// How a trajectory is followed: (x, y, yaw) in m and rad, m/s and rad/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// Where the courier should be.
    pub set_point: Vector3<f64>,
    /// How fast it should move.
    pub set_point_velocity: Vector3<f64>,
    /// Where it is, as estimated.
    pub position: Vector3<f64>,
    /// How fast it moves, as estimated.
    pub velocity: Vector3<f64>,
}

/// The feedback; its header is left to the publisher. It states the difference too.
#[must_use]
pub fn to_feedback(following: &Following) -> FollowJointTrajectoryFeedback {
    let Following { set_point, set_point_velocity, position, velocity } = *following;
    let point = |position: Vector3<f64>, velocity: Vector3<f64>| JointTrajectoryPoint {
        positions: position.iter().copied().collect(),
        velocities: velocity.iter().copied().collect(),
        ..JointTrajectoryPoint::default()
    };
    FollowJointTrajectoryFeedback {
        joint_names: AXES.map(str::to_owned).to_vec(),
        desired: point(set_point, set_point_velocity),
        actual: point(position, velocity),
        error: point(set_point - position, set_point_velocity - velocity),
        ..FollowJointTrajectoryFeedback::default()
    }
}

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
pub fn from_goal(goal: &FollowJointTrajectoryGoal, now_ns: u64) -> Result<(Trajectory, Tolerances), EndOfGoal> {
    let names = &goal.trajectory.joint_names;
    let mut columns = [0; 3];
    for (axis, column) in AXES.iter().zip(&mut columns) {
        let mut places = (0..names.len()).filter(|&place| names[place] == *axis);
        *column = match (places.next(), places.next()) {
            (Some(place), None) if names.len() == AXES.len() => place,
            _ => {
                let reason = format!("joint_names = {names:?}, allowed is each of {AXES:?} once");
                return Err((TrajectoryEnd::InvalidJoints, reason));
            }
        };
    }
    let points = goal.trajectory.points.iter().enumerate().map(|(index, point)| read_point(index, point, columns));
    let trajectory = Trajectory { points: points.collect::<Result<_, _>>().map_err(invalid)? };
    check_stamp(goal, &trajectory, now_ns)?;
    Ok((trajectory, read_tolerances(goal)?))
}

fn invalid(reason: impl Into<String>) -> EndOfGoal {
    (TrajectoryEnd::InvalidGoal, reason.into())
}

/// A trajectory begins when it arrives; one that is stamped must not be over, nor wait.
fn check_stamp(goal: &FollowJointTrajectoryGoal, trajectory: &Trajectory, now_ns: u64) -> Result<(), EndOfGoal> {
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
        return Err((TrajectoryEnd::TooOld, reason));
    }
    Ok(())
}

fn read_tolerances(goal: &FollowJointTrajectoryGoal) -> Result<Tolerances, EndOfGoal> {
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
fn by_axis(field: &str, tolerances: &[JointTolerance]) -> Result<[Vector3<f64>; 2], EndOfGoal> {
    let mut found = [Vector3::zeros(); 2];
    for tolerance in tolerances {
        let Some(axis) = AXES.iter().position(|axis| *axis == tolerance.name) else {
            let reason = format!("{field} names {:?}, allowed are {AXES:?}", tolerance.name);
            return Err((TrajectoryEnd::InvalidJoints, reason));
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
        type End = TrajectoryEnd;
        let (end, reason) = refused(|goal| "elbow".clone_into(&mut goal.trajectory.joint_names[1]));
        assert!(end == End::InvalidJoints && reason.contains("elbow"), "{reason}");
        let (end, reason) = refused(|goal| _ = goal.trajectory.points[0].velocities.pop());
        assert!(end == End::InvalidGoal && reason.contains("point 0: velocities has 2 values"), "{reason}");
        let (end, _) = refused(|goal| goal.trajectory.header.stamp.sec = 3);
        assert_eq!(end, End::TooOld);
        let (end, reason) = refused(|goal| goal.trajectory.header.stamp.sec = 6);
        assert!(end == End::InvalidGoal && reason.contains("future"), "{reason}");
    }

    #[test]
    fn results_survive_the_round_trip_with_every_end() {
        let ends: Vec<TrajectoryEnd> = (-128..128).filter_map(|code| end_of(code).ok()).collect();
        assert_eq!(ends.len(), 6);
        for end in ends {
            let sent = (end, "why".to_owned());
            assert_eq!(from_result(to_result(sent.clone())), Ok(sent));
        }
        assert_eq!(end_of(1).unwrap_err().to_string(), "error_code = 1, allowed are -5 to 0");
    }

    #[test]
    fn feedback_states_where_the_courier_should_be_where_it_is_and_the_difference() {
        let feedback = to_feedback(&Following {
            set_point: Vector3::new(1.0, 2.0, 3.0),
            set_point_velocity: Vector3::new(4.0, 5.0, 6.0),
            position: Vector3::new(0.5, 0.25, 0.125),
            velocity: Vector3::new(8.0, 16.0, 32.0),
        });
        assert_eq!(feedback.joint_names, AXES);
        let told = [&feedback.desired, &feedback.actual, &feedback.error];
        let told = told.map(|point| (point.positions.as_slice(), point.velocities.as_slice()));
        let expected: [(&[f64], &[f64]); 3] = [
            (&[1.0, 2.0, 3.0], &[4.0, 5.0, 6.0]),
            (&[0.5, 0.25, 0.125], &[8.0, 16.0, 32.0]),
            (&[0.5, 1.75, 2.875], &[-4.0, -11.0, -26.0]),
        ];
        assert_eq!(told, expected);
    }
}
