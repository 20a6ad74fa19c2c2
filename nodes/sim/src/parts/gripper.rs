//! A gripper with two parallel jaws that closes in the tray.

use nalgebra::{Isometry2, Point2};
use thiserror::Error;

use feeder_model::part::PartType;

use super::{Part, Place};

/// An open gripper in the tray frame. Its jaws close along its own x axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenGripper {
    /// The middle between the jaws, x, m.
    pub x_m: f64,
    /// The middle between the jaws, y, m.
    pub y_m: f64,
    /// Direction in which the jaws close, rad.
    pub yaw_rad: f64,
    /// Width between the open jaws, m.
    pub opening_m: f64,
}

/// Why a gripper takes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum Missed {
    /// No part lies where the jaws close.
    #[error("nothing lies between the gripper's fingers")]
    Nothing,
    /// One does, but a jaw comes down on it.
    #[error(
        "a finger comes down on part {id}, which reaches {reach_m} m from the middle across the jaws; allowed is half the \
         opening of {opening_m} m"
    )]
    OnPart {
        /// Identity of the part.
        id: u32,
        /// How far it reaches from the middle between the jaws, in the direction in which they close, m.
        reach_m: f64,
        /// Width between the open jaws, m.
        opening_m: f64,
    },
}

impl OpenGripper {
    /// Which of the parts it takes, by its place in the list: the one whose centre is nearest to the middle of the jaws, within
    /// the play that the part has between them when it is turned best, if it fits between them as it is turned. Falling parts
    /// are out of reach.
    ///
    /// # Errors
    /// No part is that near, or the nearest does not fit.
    pub(super) fn taken(&self, parts: &[Part], kind: &PartType) -> Result<usize, Missed> {
        let within = |part: &Part| {
            let outline = &kind.poses.get(part.pose)?.outline;
            let play_m = 0.5 * (self.opening_m - outline.narrowest().0);
            let distance_m = part.squared_distance_m2(self.x_m, self.y_m).sqrt();
            (part.place != Place::Falling && distance_m <= play_m).then_some(distance_m)
        };
        let near = parts.iter().enumerate().filter_map(|(index, part)| within(part).map(|m| (index, m)));
        let (index, _) = near.min_by(|(_, a), (_, b)| a.total_cmp(b)).ok_or(Missed::Nothing)?;
        let part = &parts[index];
        let reach_m = self.reach_m(part, kind);
        if reach_m <= 0.5 * self.opening_m {
            return Ok(index);
        }
        Err(Missed::OnPart { id: part.id, reach_m, opening_m: self.opening_m })
    }

    /// How far a part reaches from the middle between the jaws, in the direction in which they close, m.
    fn reach_m(&self, part: &Part, kind: &PartType) -> f64 {
        let outline = &kind.poses[part.pose].outline;
        let frame = Isometry2::new([self.x_m, self.y_m].into(), self.yaw_rad);
        if outline.round {
            return frame.inverse_transform_point(&Point2::from(part.position_m())).x.abs() + outline.radius_m;
        }
        let corners = outline.at(&Isometry2::new(part.position_m(), part.yaw_rad));
        let reach_m = corners.iter().map(|corner| frame.inverse_transform_point(corner).x.abs());
        // Of numbers and what is none the latter is the largest: a tool without a yaw takes nothing.
        reach_m.max_by(f64::total_cmp).unwrap_or(f64::NAN)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::parts::tests::disc;

    /// 6 mm long and 4 mm wide.
    fn block() -> PartType {
        crate::parts::tests::block(0.006, 0.004, 0.003)
    }

    fn at_origin(yaw_rad: f64) -> Part {
        Part { id: 7, ..Part::at_rest(Place::Plateau, 0, yaw_rad) }
    }

    fn gripper(yaw_rad: f64, opening_m: f64) -> OpenGripper {
        OpenGripper { x_m: 0.0, y_m: 0.0, yaw_rad, opening_m }
    }

    #[test]
    fn a_part_with_a_yaw_is_taken_across_its_narrow_side_alone() {
        let kind = block();
        let (width_m, across_rad) = kind.poses[0].outline.narrowest();
        assert!((width_m - 0.004).abs() < 1e-9);
        for yaw_rad in [0.0, 0.7, -2.0] {
            let part = at_origin(yaw_rad);
            let takes = |turned_rad: f64| gripper(yaw_rad + across_rad + turned_rad, 0.005).taken(&[part], &kind);
            assert_eq!(takes(0.0), Ok(0));
            assert_eq!(takes(std::f64::consts::PI), Ok(0));
            // 4 cos δ + 6 sin δ = 5 at 0.178.
            assert_eq!(takes(0.175), Ok(0));
            assert!(matches!(takes(0.18), Err(Missed::OnPart { id: 7, .. })));
            assert!(matches!(takes(-0.18), Err(Missed::OnPart { .. })));
            let Err(Missed::OnPart { reach_m, .. }) = takes(FRAC_PI_2) else { panic!("taken across its long side") };
            assert!((reach_m - 0.003).abs() < 1e-9);
        }
        assert_eq!(gripper(FRAC_PI_2 + across_rad, 0.0061).taken(&[at_origin(0.0)], &kind), Ok(0));
    }

    #[test]
    fn a_part_beside_the_middle_is_met_by_a_finger_when_it_reaches_beyond_the_opening() {
        let kind = block();
        let across_rad = kind.poses[0].outline.narrowest().1;
        let shifted = |m: f64| {
            let (sin, cos) = across_rad.sin_cos();
            Part { x_m: m * cos, y_m: m * sin, ..at_origin(0.0) }
        };
        assert_eq!(gripper(across_rad, 0.005).taken(&[shifted(0.00049)], &kind), Ok(0));
        assert_eq!(gripper(across_rad, 0.005).taken(&[shifted(0.00051)], &kind), Err(Missed::Nothing));
        // Within the play, but turned besides.
        assert!(gripper(across_rad + 0.1, 0.005).taken(&[shifted(0.0003)], &kind).is_err());
    }

    #[test]
    fn a_round_part_is_taken_at_any_yaw_within_its_play() {
        let kind = disc(0.006, 0.2);
        for yaw_rad in [0.0, 0.5, 2.0] {
            let off = |m: f64| Part { x_m: m, ..at_origin(0.3) };
            assert_eq!(gripper(yaw_rad, 0.007).taken(&[off(0.000_49)], &kind), Ok(0));
            assert_eq!(gripper(yaw_rad, 0.007).taken(&[off(0.000_51)], &kind), Err(Missed::Nothing));
            assert_eq!(gripper(yaw_rad, 0.005).taken(&[off(0.0)], &kind), Err(Missed::Nothing));
        }
    }

    #[test]
    fn the_nearest_is_taken_and_none_that_falls() {
        let kind = disc(0.006, 0.2);
        let part = |x_m: f64, place| Part { x_m, place, ..at_origin(0.0) };
        let parts = [part(0.002, Place::Plateau), part(0.001, Place::Ramp), part(0.0, Place::Falling)];
        assert_eq!(gripper(0.0, 0.02).taken(&parts, &kind), Ok(1));
        assert_eq!(gripper(0.0, 0.02).taken(&parts[2..], &kind), Err(Missed::Nothing));
        assert_eq!(gripper(0.0, f64::NAN).taken(&parts, &kind), Err(Missed::Nothing));
        assert_eq!(OpenGripper { x_m: f64::NAN, ..gripper(0.0, 0.02) }.taken(&parts, &kind), Err(Missed::Nothing));
        assert!(gripper(f64::NAN, 0.02).taken(&[at_origin(0.0)], &block()).is_err());
    }
}
