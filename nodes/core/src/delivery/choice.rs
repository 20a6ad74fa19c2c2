//! Which part to deliver.

use std::cmp::Ordering;
use std::f64::consts::TAU;

use nalgebra::{Rotation2, Vector2, Vector3};

use super::config::{DeliveryConfig, Policy};
use super::hold::ramp_parts;
use super::plan::MovePlanner;
use super::protocol::{DeliveryRequest, Stamp};

/// A part that vision sees, in the tray frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Where it lies, m.
    pub position_in_tray_m: Vector2<f64>,
    /// How it is turned, rad.
    pub yaw_in_tray_rad: f64,
    /// Its class, as the catalogue names it.
    pub part_class: String,
    /// Its resting pose, as the catalogue names it.
    pub pose_class: String,
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
    /// The parts in it.
    pub candidates: Vec<Candidate>,
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

/// The part to take from a frame, if one fits: of the class and pose asked for, sure, alone, wholly on the plateau, and
/// reachable for the station. Of several the one nearest to the drop-off, which the feed would lose next.
#[must_use]
pub fn choose(
    frame: &CandidateFrame,
    request: &DeliveryRequest,
    station_m: &Vector2<f64>,
    config: &DeliveryConfig,
    planner: &MovePlanner,
) -> Option<Choice> {
    let angle_rad = |candidate: &Candidate| {
        let position = candidate.position_in_tray_m;
        position.y.atan2(position.x).rem_euclid(TAU)
    };
    frame
        .candidates
        .iter()
        .filter(|candidate| {
            candidate.position_in_tray_m.iter().all(|coordinate| coordinate.is_finite())
                && candidate.part_class == request.part_class
                && (request.pose_class.is_empty() || candidate.pose_class == request.pose_class)
                && candidate.confidence >= config.confidence_min
                && candidate.clearance_m >= config.clearance_m_min
                && candidate.on_plateau
        })
        .map(|candidate| Choice {
            candidate: candidate.clone(),
            look: frame.stamp,
            courier: courier_under(station_m, &candidate.position_in_tray_m, config.feeding_place.z),
        })
        .filter(|choice| planner.check_reach(&choice.courier).is_ok())
        .max_by(|a, b| angle_rad(&a.candidate).partial_cmp(&angle_rad(&b.candidate)).unwrap_or(Ordering::Equal))
}

/// The places in the tray at which parts must not slide during a move with `selected` on board.
#[must_use]
pub fn protected_parts(
    config: &DeliveryConfig,
    planner: &MovePlanner,
    selected: Option<&Candidate>,
    frame: Option<&CandidateFrame>,
) -> Vec<Vector2<f64>> {
    let selected = selected.map(|candidate| candidate.position_in_tray_m);
    match config.policy {
        Policy::Selected => selected.into_iter().collect(),
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
    use super::*;
    use crate::courier::{CourierLimits, Load};
    use crate::tray::TrayGeometry;

    fn setup() -> (DeliveryConfig, MovePlanner, DeliveryRequest) {
        let config = DeliveryConfig::default();
        let limits = CourierLimits::default();
        let planner = MovePlanner::new(config.gentle, TrayGeometry::PAPER, limits, Load::default()).unwrap();
        let request = DeliveryRequest {
            station: "station_1".into(),
            part_class: "washer".into(),
            pose_class: "face_up".into(),
            tolerance_m: 1e-3,
            timeout: None,
        };
        (config, planner, request)
    }

    fn candidate(x_m: f64, y_m: f64) -> Candidate {
        Candidate {
            position_in_tray_m: Vector2::new(x_m, y_m),
            yaw_in_tray_rad: 0.0,
            part_class: "washer".into(),
            pose_class: "face_up".into(),
            confidence: 0.9,
            clearance_m: 0.01,
            on_plateau: true,
        }
    }

    fn chosen(candidates: &[Candidate], station_m: Vector2<f64>) -> Option<Choice> {
        let (config, planner, request) = setup();
        let frame = CandidateFrame { stamp: Stamp::from_secs(1), candidates: candidates.to_vec() };
        choose(&frame, &request, &station_m, &config, &planner)
    }

    #[test]
    fn a_part_that_lacks_anything_is_not_chosen() {
        let good = candidate(0.0, -0.07);
        let station_m = Vector2::new(0.3, 0.0);
        assert!(chosen(std::slice::from_ref(&good), station_m).is_some());
        let bad = [
            Candidate { part_class: "screw".into(), ..good.clone() },
            Candidate { pose_class: "face_down".into(), ..good.clone() },
            Candidate { confidence: 0.1, ..good.clone() },
            Candidate { clearance_m: 0.0, ..good.clone() },
            Candidate { on_plateau: false, ..good.clone() },
            candidate(f64::NAN, 0.0),
        ];
        assert_eq!(chosen(&bad, station_m), None);
    }

    #[test]
    fn the_part_nearest_to_the_drop_off_is_chosen_and_comes_under_the_tool() {
        let choice = chosen(&[candidate(0.0, -0.07), candidate(0.06, -0.02)], Vector2::new(0.3, 0.1)).unwrap();
        assert_eq!(choice.candidate, candidate(0.06, -0.02));
        assert!((choice.courier - Vector3::new(0.24, 0.12, 0.0)).norm() < 1e-15);
    }

    #[test]
    fn a_part_that_would_take_the_courier_off_the_platen_is_passed_over() {
        let station_m = Vector2::new(0.49, 0.0);
        let choice = chosen(&[candidate(-0.07, -0.01), candidate(0.06, -0.02)], station_m).unwrap();
        assert_eq!(choice.candidate, candidate(0.06, -0.02));
        assert_eq!(chosen(&[candidate(-0.07, -0.01)], station_m), None);
    }

    #[test]
    fn protecting_all_adds_the_plateau_and_the_ramp() {
        let (mut config, planner, _) = setup();
        let frame = CandidateFrame { stamp: Stamp::ZERO, candidates: vec![candidate(0.0, -0.07)] };
        let protected = |config: &DeliveryConfig| protected_parts(config, &planner, None, Some(&frame)).len();
        assert_eq!(protected(&config), 0);
        config.policy = Policy::All;
        assert!(protected(&config) > 30);
    }
}
