//! Which part to deliver.

use std::f64::consts::TAU;

use nalgebra::{Rotation2, Vector2, Vector3};

use super::config::{DeliveryConfig, Policy};
use super::holding::ramp_parts;
use super::planner::MovePlanner;
use super::request::{DeliveryRequest, Stamp};
use feeder_model::part::Refusals;

/// A part that vision sees wholly on the plateau, in the tray frame.
#[derive(Clone, Debug, PartialEq)]
pub struct OfferedPart {
    /// The same from frame to frame while vision follows the part.
    pub id: u64,
    /// Where it lies, m.
    pub position_in_tray_m: Vector2<f64>,
    /// How it is turned, rad.
    pub yaw_in_tray_rad: f64,
    /// Its class, as the catalogue names it.
    pub part_class: String,
    /// Its resting pose, as the catalogue names it, if that is known.
    pub pose_class: Option<String>,
    /// Radius of a circle that holds its outline, m.
    pub radius_m: f64,
    /// Free gap from its outline to that of the nearest other part, m, as vision measured it; infinite when it is alone.
    pub part_gap_m: f64,
    /// What speaks against picking it: vision judges that, nobody else.
    pub refusals: Refusals,
}

/// What vision sees in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateFrame {
    /// When the image was taken.
    pub stamp: Stamp,
    /// The parts in it, and things that may be parts, that lie wholly on the plateau.
    pub candidates: Vec<OfferedPart>,
    /// Nothing seen does not mean that nothing is there: what lies on the plateau is not recognised, or the image tells nothing of it.
    pub is_blind: bool,
}

/// A part chosen for a station.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The part.
    pub candidate: OfferedPart,
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

/// Where a part of `request` would be taken from a frame: the candidate chosen, if it fits. It must be one
/// that may be picked, of the class and pose and as free as asked for, and within reach of the station.
#[must_use]
pub fn fitting(
    candidate: &OfferedPart,
    look: Stamp,
    request: &DeliveryRequest,
    station_m: &Vector2<f64>,
    config: &DeliveryConfig,
    planner: &MovePlanner,
) -> Option<Choice> {
    let fits = candidate.position_in_tray_m.iter().all(|coordinate| coordinate.is_finite())
        && candidate.part_class == request.part_class
        && candidate.pose_class.as_ref().is_some_and(|pose_class| request.accepts(pose_class))
        && request.part_gap_m_min.is_none_or(|least_m| candidate.part_gap_m >= least_m)
        && candidate.refusals.may_be_picked();
    let courier = courier_under(station_m, &candidate.position_in_tray_m, config.feeding_place.z);
    (fits && planner.check_way(&courier).is_ok()).then(|| Choice { candidate: candidate.clone(), look, courier })
}

/// Angle ψ of a candidate's centre in the tray, rad, in 0..2π: the larger, the sooner the feed loses it.
#[must_use]
pub fn angle_rad(candidate: &OfferedPart) -> f64 {
    let position = candidate.position_in_tray_m;
    position.y.atan2(position.x).rem_euclid(TAU)
}

/// The places in the tray at which parts must not slide during a move that takes `selected` to stations.
#[must_use]
pub fn protected_parts(
    config: &DeliveryConfig,
    planner: &MovePlanner,
    selected: &[&OfferedPart],
    frame: Option<&CandidateFrame>,
) -> Vec<Vector2<f64>> {
    let selected = selected.iter().map(|candidate| candidate.position_in_tray_m);
    match config.policy {
        Policy::Selected => selected.collect(),
        Policy::All => frame
            .into_iter()
            .flat_map(|frame| &frame.candidates)
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

    fn chosen(candidate: &OfferedPart, station_m: Vector2<f64>) -> Option<Choice> {
        let (config, planner, request) = setup();
        fitting(candidate, Stamp::from_secs(1), &request, &station_m, &config, &planner)
    }

    #[test]
    fn a_part_that_lacks_anything_is_not_chosen() {
        let good = candidate(1, 0.0, -0.07);
        let station_m = Vector2::new(0.3, 0.0);
        assert!(chosen(&good, station_m).is_some());
        let bad = [
            OfferedPart { part_class: "screw".into(), ..good.clone() },
            OfferedPart { pose_class: Some("face_down".into()), ..good.clone() },
            OfferedPart { pose_class: None, ..good.clone() },
            OfferedPart { refusals: Refusals { part_too_near: true, ..Refusals::default() }, ..good.clone() },
            OfferedPart { refusals: Refusals { pose_unsure: true, ..Refusals::default() }, ..good.clone() },
            candidate(1, f64::NAN, 0.0),
        ];
        for bad in bad {
            assert_eq!(chosen(&bad, station_m), None, "{bad:?}");
        }
    }

    #[test]
    fn how_free_a_part_is_matters_only_to_who_asks_for_it() {
        let (config, planner, mut request) = setup();
        let close = OfferedPart { part_gap_m: -0.001, ..candidate(1, 0.0, -0.07) };
        let station_m = Vector2::new(0.3, 0.0);
        let mut is_chosen = |part_gap_m_min| {
            request.part_gap_m_min = part_gap_m_min;
            fitting(&close, Stamp::ZERO, &request, &station_m, &config, &planner).is_some()
        };
        // Vision has judged the room that the gripper needs.
        assert!(is_chosen(None) && is_chosen(Some(-0.001)) && !is_chosen(Some(0.001)));
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
        let frame = CandidateFrame { stamp: Stamp::ZERO, candidates: vec![candidate(1, 0.0, -0.07)], is_blind: false };
        let protected = |config: &DeliveryConfig| protected_parts(config, &planner, &[], Some(&frame)).len();
        assert_eq!(protected(&config), 0);
        config.policy = Policy::All;
        assert!(protected(&config) > 30);
    }
}
