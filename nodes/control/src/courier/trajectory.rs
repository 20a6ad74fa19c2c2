//! What is accepted as a trajectory, and the interpolation between its points.

use feeder_model::trajectory::{Trajectory, TrajectoryPoint};
use nalgebra::Vector3;

use super::rejection::Rejection;

/// Shortest and longest trajectory accepted, s.
const DURATION_RANGE_S: (f64, f64) = (1e-3, 600.0);

/// Checks what can be checked without knowing the courier: finite, sorted, of a sensible
/// duration, at rest in the end.
///
/// # Errors
/// The first thing found wrong.
pub(super) fn check(trajectory: &Trajectory) -> Result<(), Rejection> {
    let finite = |vector: &Vector3<f64>| vector.iter().all(|value| value.is_finite());
    let mut last_time_s = f64::NEG_INFINITY;
    for (index, point) in trajectory.points.iter().enumerate() {
        let not_finite = |field| Err(Rejection::NotFinite { index, field });
        if !point.time_s.is_finite() || point.time_s < 0.0 {
            return not_finite("time");
        }
        if !finite(&point.position) {
            return not_finite("position");
        }
        if !point.velocity.as_ref().is_none_or(finite) {
            return not_finite("velocity");
        }
        if !point.acceleration.as_ref().is_none_or(finite) {
            return not_finite("acceleration");
        }
        if point.time_s <= last_time_s {
            return Err(Rejection::Unsorted { index, time_s: point.time_s });
        }
        last_time_s = point.time_s;
    }
    let last = trajectory.points.last().ok_or(Rejection::Empty)?;
    let (min_s, max_s) = DURATION_RANGE_S;
    if !(min_s..=max_s).contains(&last.time_s) {
        return Err(Rejection::Duration { duration_s: last.time_s, min_s, max_s });
    }
    if last.velocity.is_some_and(|velocity| velocity.norm() > 1e-9) {
        return Err(Rejection::MovingEnd);
    }
    Ok(())
}

/// Position, velocity and acceleration at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct State {
    pub(crate) position: Vector3<f64>,
    pub(crate) velocity: Vector3<f64>,
    pub(crate) acceleration: Vector3<f64>,
}

impl std::ops::Add for State {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            position: self.position + other.position,
            velocity: self.velocity + other.velocity,
            acceleration: self.acceleration + other.acceleration,
        }
    }
}

/// A polynomial of degree five per axis, in the time since its start.
#[derive(Clone, Debug)]
struct Piece {
    start_s: f64,
    coefficients: [Vector3<f64>; 6],
}

/// The interpolation of a trajectory: at rest after its end.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    pieces: Vec<Piece>,
    /// Takes what the stated start differs from the real one, and fades it out over the whole trajectory.
    blend: Piece,
    end_s: f64,
    end: Vector3<f64>,
}

impl Spline {
    /// Interpolates a valid trajectory from `present`, whether it states that start, nearly states it or leaves it out.
    pub(crate) fn new(trajectory: &Trajectory, present: &State) -> Self {
        let start = TrajectoryPoint {
            time_s: 0.0,
            position: present.position,
            velocity: Some(present.velocity),
            acceleration: Some(present.acceleration),
        };
        let implied = trajectory.points.first().is_some_and(|point| point.time_s > 0.0);
        let mut points: Vec<TrajectoryPoint> =
            implied.then_some(&start).into_iter().chain(&trajectory.points).cloned().collect();
        if trajectory.points.iter().all(|point| point.velocity.is_none() && point.acceleration.is_none()) {
            choose_velocities(&mut points, present.velocity);
        }
        let last = points.last().unwrap_or(&start);
        let rest = |time_s, position| TrajectoryPoint {
            time_s,
            position,
            velocity: Some(Vector3::zeros()),
            acceleration: Some(Vector3::zeros()),
        };
        let offset = present.position - points.first().unwrap_or(&start).position;
        Self {
            pieces: points.windows(2).map(|pair| Piece::new(&pair[0], &pair[1])).collect(),
            blend: Piece::new(&rest(0.0, offset), &rest(last.time_s, Vector3::zeros())),
            end_s: last.time_s,
            end: last.position,
        }
    }

    pub(crate) fn end_s(&self) -> f64 {
        self.end_s
    }

    pub(crate) fn at(&self, time_s: f64) -> State {
        let next = self.pieces.partition_point(|piece| piece.start_s <= time_s);
        match self.pieces.get(next.saturating_sub(1)) {
            Some(piece) if time_s < self.end_s => piece.at(time_s) + self.blend.at(time_s),
            _ => State { position: self.end, ..State::default() },
        }
    }
}

/// Chooses the velocities at the points so that the acceleration is continuous too: the clamped cubic spline, with
/// `first_velocity` in the beginning and at rest in the end. Straight lines between positions, as `ros2_control` makes
/// them, would have the velocity jump, which no motor does.
///
/// Its equations have three unknowns each, the velocities at a point and its neighbours; they are solved from both ends
/// (Thomas's algorithm).
fn choose_velocities(points: &mut [TrajectoryPoint], first_velocity: Vector3<f64>) {
    // What is left of the equation of each point: its velocity is `known` less `factor` times the next one's.
    let mut rows = vec![(first_velocity, 0.0)];
    for triple in points.windows(3) {
        let [before_s, after_s] = [triple[1].time_s - triple[0].time_s, triple[2].time_s - triple[1].time_s];
        let slope_before = (triple[1].position - triple[0].position) / before_s;
        let slope_after = (triple[2].position - triple[1].position) / after_s;
        let right = (slope_before * after_s + slope_after * before_s) * 3.0;
        let (known, factor) = rows[rows.len() - 1];
        let own = 2.0 * (before_s + after_s) - after_s * factor;
        rows.push(((right - known * after_s) / own, before_s / own));
    }
    // A last row for the end: at rest.
    rows.push((Vector3::zeros(), 0.0));
    let mut next = Vector3::zeros();
    for (point, (known, factor)) in points.iter_mut().zip(rows).rev() {
        next = known - next * factor;
        point.velocity = Some(next);
    }
}

impl Piece {
    fn new(from: &TrajectoryPoint, to: &TrajectoryPoint) -> Self {
        let t = to.time_s - from.time_s;
        let step = to.position - from.position;
        let zero = Vector3::zeros();
        let coefficients = match (from.velocity, to.velocity, from.acceleration, to.acceleration) {
            (Some(v0), Some(v1), Some(a0), Some(a1)) => {
                // The quintic through both positions, velocities and accelerations.
                let (d, e, f) = (step - v0 * t - a0 * (0.5 * t * t), (v1 - v0 - a0 * t) * t, (a1 - a0) * (t * t));
                [
                    from.position,
                    v0,
                    a0 * 0.5,
                    (d * 10.0 - e * 4.0 + f * 0.5) / t.powi(3),
                    (d * -15.0 + e * 7.0 - f) / t.powi(4),
                    (d * 6.0 - e * 3.0 + f * 0.5) / t.powi(5),
                ]
            }
            (Some(v0), Some(v1), _, _) => [
                from.position,
                v0,
                (step * 3.0 - (v0 * 2.0 + v1) * t) / t.powi(2),
                (step * -2.0 + (v0 + v1) * t) / t.powi(3),
                zero,
                zero,
            ],
            _ => [from.position, step / t, zero, zero, zero, zero],
        };
        Self { start_s: from.time_s, coefficients }
    }

    fn at(&self, time_s: f64) -> State {
        let t = time_s - self.start_s;
        let [c0, c1, c2, c3, c4, c5] = &self.coefficients;
        State {
            position: c0 + (c1 + (c2 + (c3 + (c4 + c5 * t) * t) * t) * t) * t,
            velocity: c1 + (c2 * 2.0 + (c3 * 3.0 + (c4 * 4.0 + c5 * (5.0 * t)) * t) * t) * t,
            acceleration: c2 * 2.0 + (c3 * 6.0 + (c4 * 12.0 + c5 * (20.0 * t)) * t) * t,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(time_s: f64, x_m: f64) -> TrajectoryPoint {
        let zero = Some(Vector3::zeros());
        TrajectoryPoint { time_s, position: Vector3::new(x_m, 0.0, 0.0), velocity: zero, acceleration: zero }
    }

    #[test]
    fn verif_a_quintic_from_rest_to_rest_is_the_smoothstep() {
        let trajectory = Trajectory { points: vec![point(0.0, 0.0), point(2.0, 0.3)] };
        let spline = Spline::new(&trajectory, &State::default());
        for step in 0..=20 {
            let x = f64::from(step) / 20.0;
            let expected_m = 0.3 * x.powi(3) * (10.0 - 15.0 * x + 6.0 * x * x);
            assert!((spline.at(2.0 * x).position.x - expected_m).abs() < 1e-15);
        }
    }

    #[test]
    fn interpolation_falls_back_to_cubic_and_to_linear() {
        let cubic = |time_s, x_m| TrajectoryPoint { acceleration: None, ..point(time_s, x_m) };
        let linear = |time_s, x_m| TrajectoryPoint { velocity: None, acceleration: None, ..point(time_s, x_m) };
        let trajectory = Trajectory { points: vec![cubic(0.0, 0.0), cubic(1.0, 1.0)] };
        assert!((Spline::new(&trajectory, &State::default()).at(0.25).position.x - 0.156_25).abs() < 1e-15);
        let trajectory = Trajectory { points: vec![cubic(0.0, 0.0), linear(1.0, 1.0)] };
        assert!((Spline::new(&trajectory, &State::default()).at(0.25).position.x - 0.25).abs() < 1e-15);
    }

    #[test]
    fn verif_positions_alone_are_joined_without_a_jump() {
        let at = |time_s, x_m| TrajectoryPoint { velocity: None, acceleration: None, ..point(time_s, x_m) };
        let present = State { position: Vector3::new(0.1, 0.0, 0.0), ..State::default() };
        // One point, from rest to rest: x = 3 s² − 2 s³ of the way, and 6 d/T² of acceleration in the beginning.
        let single = Spline::new(&Trajectory { points: vec![at(2.0, 0.4)] }, &present);
        assert!((single.at(0.5).position.x - (0.1 + 0.3 * 0.156_25)).abs() < 1e-15);
        assert!((single.at(0.0).acceleration.x - 6.0 * 0.3 / 4.0).abs() < 1e-12);
        let way = [(0.5, 0.15), (0.8, 0.3), (2.0, 0.2), (2.1, 0.19), (3.0, 0.4)];
        let points = way.map(|(time_s, x_m)| at(time_s, x_m)).to_vec();
        for points in [points.clone(), [vec![at(0.0, 0.1)], points].concat()] {
            let spline = Spline::new(&Trajectory { points }, &present);
            for (time_s, x_m) in way {
                let (before, after) = (spline.at(time_s - 1e-9), spline.at(time_s));
                assert!((after.position.x - x_m).abs() < 1e-12);
                assert!((after.velocity - before.velocity).norm() < 1e-6, "a jump at {time_s} s");
                if time_s < 3.0 {
                    assert!((after.acceleration - before.acceleration).norm() < 1e-5, "a jerk at {time_s} s");
                }
            }
            assert!(spline.at(0.0).velocity.norm() < 1e-12);
        }
    }

    #[test]
    fn a_trajectory_without_a_point_at_zero_starts_from_the_present() {
        let present = State { position: Vector3::new(0.1, 0.2, 0.0), ..State::default() };
        let spline = Spline::new(&Trajectory { points: vec![point(1.0, 0.4)] }, &present);
        assert_eq!(spline.at(0.0).position, present.position);
        assert_eq!(spline.at(1.0).position, Vector3::new(0.4, 0.0, 0.0));
    }

    #[test]
    fn a_start_that_is_nearly_right_is_blended_in() {
        let present = State { position: Vector3::new(1e-5, 0.0, 0.0), ..State::default() };
        let spline = Spline::new(&Trajectory { points: vec![point(0.0, 0.0), point(1.0, 0.4)] }, &present);
        assert_eq!(spline.at(0.0).position, present.position);
        assert!((spline.at(1.0 - 1e-9).position.x - 0.4).abs() < 1e-12);
    }

    #[test]
    fn malformed_trajectories_are_refused_with_the_point_named() {
        assert_eq!(check(&Trajectory::default()), Err(Rejection::Empty));
        let unsorted = Trajectory { points: vec![point(0.0, 0.0), point(1.0, 0.1), point(1.0, 0.2)] };
        assert_eq!(check(&unsorted), Err(Rejection::Unsorted { index: 2, time_s: 1.0 }));
        let mut bad = Trajectory { points: vec![point(0.0, 0.0), point(1.0, f64::NAN)] };
        assert_eq!(check(&bad), Err(Rejection::NotFinite { index: 1, field: "position" }));
        bad.points[1] = TrajectoryPoint { velocity: Some(Vector3::new(0.1, 0.0, 0.0)), ..point(1.0, 0.1) };
        assert_eq!(check(&bad), Err(Rejection::MovingEnd));
        assert!(matches!(check(&Trajectory { points: vec![point(1e9, 0.0)] }), Err(Rejection::Duration { .. })));
    }
}
