//! Which part to deliver.

use std::f64::consts::TAU;

use nalgebra::{Rotation2, Vector2, Vector3};

use super::config::{DeliveryConfig, Policy};
use super::hold::ramp_parts;
use super::plan::MovePlanner;
use super::protocol::{DeliveryRequest, Stamp};

/// A part that vision sees, in the tray frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The same from frame to frame while vision follows the part.
    pub id: u64,
    /// Where it lies, m.
    pub position_in_tray_m: Vector2<f64>,
    /// How it is turned, rad.
    pub yaw_in_tray_rad: f64,
    /// Its class, as the catalogue names it.
    pub part_class: String,
    /// Its resting pose, as the catalogue names it.
    pub pose_class: String,
    /// Radius of a circle that holds its outline, m.
    pub radius_m: f64,
    /// How sure vision is of class and pose, 0 to 1.
    pub confidence: f64,
    /// Distance from its outline to the nearest other one, m; infinite when it is alone.
    pub clearance_m: f64,
    /// Its whole outline lies on the plateau.
    pub on_plateau: bool,
}

/// What vision sees in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateFrame {
    /// When the image was taken.
    pub stamp: Stamp,
    /// The parts in it whose class and pose are known.
    pub candidates: Vec<Candidate>,
    /// How many things were seen on the plateau, known or not.
    pub seen: usize,
}

/// A part chosen for a station.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The part.
    pub candidate: Candidate,
    /// When the image was taken in which it was chosen.
    pub look: Stamp,
    /// Where the courier must stand for the part to lie under the tool axis.
    pub courier: Vector3<f64>,
}

/// Where the courier must stand, its yaw kept, for a point of the tray to lie under a station's tool axis.
#[must_use]
pub fn courier_under(station_m: &Vector2<f64>, point_in_tray_m: &Vector2<f64>, yaw_rad: f64) -> Vector3<f64> {
    let position_m = station_m - Rotation2::new(yaw_rad) * point_in_tray_m;
    Vector3::new(position_m.x, position_m.y, yaw_rad)
}

/// Where a part of `request` would be taken from a frame: the candidate chosen, if it fits. It must be of the class and
/// pose asked for, sure, alone, wholly on the plateau, and within reach of the station.
#[must_use]
pub fn fitting(
    candidate: &Candidate,
    look: Stamp,
    request: &DeliveryRequest,
    station_m: &Vector2<f64>,
    config: &DeliveryConfig,
    planner: &MovePlanner,
) -> Option<Choice> {
    let fits = candidate.position_in_tray_m.iter().all(|coordinate| coordinate.is_finite())
        && candidate.part_class == request.part_class
        && (request.pose_classes.is_empty() || request.pose_classes.contains(&candidate.pose_class))
        && candidate.confidence >= config.confidence_min
        && candidate.clearance_m >= config.clearance_m_min
        && candidate.on_plateau;
    let courier = courier_under(station_m, &candidate.position_in_tray_m, config.feeding_place.z);
    (fits && planner.check_stand(&courier).is_ok()).then(|| Choice { candidate: candidate.clone(), look, courier })
}

/// Angle ψ of a candidate's centre in the tray, rad, in 0..2π: the larger, the sooner the feed loses it.
#[must_use]
pub fn angle_rad(candidate: &Candidate) -> f64 {
    let position = candidate.position_in_tray_m;
    position.y.atan2(position.x).rem_euclid(TAU)
}

/// The places in the tray at which parts must not slide during a move that takes `selected` to stations.
#[must_use]
pub fn protected_parts(
    config: &DeliveryConfig,
    planner: &MovePlanner,
    selected: &[&Candidate],
    frame: Option<&CandidateFrame>,
) -> Vec<Vector2<f64>> {
    let selected = selected.iter().map(|candidate| candidate.position_in_tray_m);
    match config.policy {
        Policy::Selected => selected.collect(),
        Policy::All => frame
            .into_iter()
            .flat_map(|frame| &frame.candidates)
            .filter(|candidate| candidate.on_plateau)
            .map(|candidate| candidate.position_in_tray_m)
            .chain(selected)
            .chain(ramp_parts(planner.tray(), config.protected_ramp_radius_m))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tour::testing::{candidate, setup};
    use super::*;

    fn chosen(candidate: &Candidate, station_m: Vector2<f64>) -> Option<Choice> {
        let (config, planner, request) = setup();
        fitting(candidate, Stamp::from_secs(1), &request, &station_m, &config, &planner)
    }

    #[test]
    fn a_part_that_lacks_anything_is_not_chosen() {
        let good = candidate(1, 0.0, -0.07);
        let station_m = Vector2::new(0.3, 0.0);
        assert!(chosen(&good, station_m).is_some());
        let bad = [
            Candidate { part_class: "screw".into(), ..good.clone() },
            Candidate { pose_class: "face_down".into(), ..good.clone() },
            Candidate { confidence: 0.1, ..good.clone() },
            Candidate { clearance_m: 0.0, ..good.clone() },
            Candidate { on_plateau: false, ..good.clone() },
            candidate(1, f64::NAN, 0.0),
        ];
        for bad in bad {
            assert_eq!(chosen(&bad, station_m), None, "{bad:?}");
        }
    }

    #[test]
    fn the_part_comes_under_the_tool() {
        let choice = chosen(&candidate(1, 0.06, -0.02), Vector2::new(0.3, 0.1)).unwrap();
        assert!((choice.courier - Vector3::new(0.24, 0.12, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn a_part_that_would_take_the_courier_off_the_platen_is_passed_over() {
        let station_m = Vector2::new(0.49, 0.0);
        assert!(chosen(&candidate(1, 0.06, -0.02), station_m).is_some());
        assert_eq!(chosen(&candidate(1, -0.07, -0.01), station_m), None);
    }

    #[test]
    fn protecting_all_adds_the_plateau_and_the_ramp() {
        let (mut config, planner, _) = setup();
        let frame = CandidateFrame { stamp: Stamp::ZERO, candidates: vec![candidate(1, 0.0, -0.07)], seen: 1 };
        let protected = |config: &DeliveryConfig| protected_parts(config, &planner, &[], Some(&frame)).len();
        assert_eq!(protected(&config), 0);
        config.policy = Policy::All;
        assert!(protected(&config) > 30);
    }
}
