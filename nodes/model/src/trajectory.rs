//! Trajectories of the courier as `follow_joint_trajectory` states them, and how far it may be from them.

use nalgebra::Vector3;

/// Names of the courier's axes, in the order of the components of every motion vector.
pub const AXES: [&str; 3] = ["courier_x", "courier_y", "courier_yaw"];

/// A point of a trajectory. Vectors are (`courier_x`, `courier_y`, `courier_yaw`).
#[derive(Clone, Debug, PartialEq)]
pub struct TrajectoryPoint {
    /// Time since the start of the trajectory, s.
    pub time_s: f64,
    /// Position, m and rad.
    pub position: Vector3<f64>,
    /// Velocity, m/s and rad/s.
    pub velocity: Option<Vector3<f64>>,
    /// Acceleration, m/s² and rad/s².
    pub acceleration: Option<Vector3<f64>>,
}

impl TrajectoryPoint {
    /// A point at which the courier rests.
    #[must_use]
    pub fn at_rest(time_s: f64, position: Vector3<f64>) -> Self {
        let zero = Some(Vector3::zeros());
        Self { time_s, position, velocity: zero, acceleration: zero }
    }
}

/// Points in order of time, interpolated as `ros2_control` does: quintic between points with velocities and
/// accelerations, cubic between points with velocities, else linear. Where no point has either, by the cubic spline
/// through the positions, which `ros2_control` joins by straight lines: no courier's velocity can jump.
///
/// A first point at time 0 says where the trajectory starts; without one it starts from the present set point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// The points.
    pub points: Vec<TrajectoryPoint>,
}

impl Trajectory {
    /// Time of the last point, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.time_s)
    }
}

/// Tolerances of a goal as `ros2_control` understands them: for each axis 0 stands for the driver's default, a negative
/// number for none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerances {
    /// While the trajectory is followed: distance from the set point, m and rad. There is none by default, beyond what
    /// the driver faults at.
    pub path_position: Vector3<f64>,
    /// While the trajectory is followed: velocity from the set point's, m/s and rad/s. There is none by default.
    pub path_velocity: Vector3<f64>,
    /// At the end: distance from the goal, m and rad.
    pub goal_position: Vector3<f64>,
    /// At the end: velocity, m/s and rad/s. There is none by default.
    pub goal_velocity: Vector3<f64>,
    /// Time after the end within which the goal must be reached, s.
    pub goal_time_s: f64,
}
