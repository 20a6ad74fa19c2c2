//! What the selector sees, and what of it may be picked, as messages.

use feeder_model::part::Refusals;
use minifactory_msgs::msg::{PartCandidate, PartCandidates};
use nalgebra::Vector2;

use crate::pose::{self, UprightPose};

/// A part as the selector sees it in one image.
#[derive(Clone, Debug, PartialEq)]
pub struct SeenPart {
    /// The same from image to image while the selector follows the part.
    pub id: u64,
    /// Where it lies in the tray frame, m.
    pub position_in_tray_m: Vector2<f64>,
    /// How it is turned in the tray frame, rad; 0 if it looks the same from all sides.
    pub yaw_in_tray_rad: f64,
    /// Its resting pose, if that is known.
    pub pose_class: Option<String>,
    /// How sure the pose is, 0 to 1.
    pub confidence: f64,
    /// Radius of a circle about its position that holds its outline, m.
    pub radius_m: f64,
    /// Free gap from outline to outline to the nearest other thing, m; infinite when it is alone.
    pub part_gap_m: f64,
    /// Free gap from its outline to the nearer wall, m.
    pub wall_gap_m: f64,
    /// What speaks against picking it.
    pub refusals: Refusals,
}

/// What an image of the plateau is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageWorth {
    /// Share of the plateau on which something lies, 0 to 1.
    pub covered_ratio: f64,
    /// Share of that which recognised parts account for, 0 to 1; 1 where nothing lies.
    pub explained_ratio: f64,
    /// That no part is seen does not mean that none is there: much lies there and next to nothing of it is recognised, or the image
    /// tells nothing of the plateau.
    pub is_blind: bool,
    /// What makes the image doubtful, in words.
    pub doubts: Vec<String>,
}

impl Default for ImageWorth {
    /// Of an image that shows a bare plateau.
    fn default() -> Self {
        Self { covered_ratio: 0.0, explained_ratio: 1.0, is_blind: false, doubts: Vec::new() }
    }
}

impl ImageWorth {
    /// Of an image that tells nothing of the plateau, by the reason.
    #[must_use]
    pub fn none(reason: String) -> Self {
        Self { is_blind: true, doubts: vec![reason], ..Self::default() }
    }

    /// What a message says of its image.
    #[must_use]
    pub fn of_message(message: &PartCandidates) -> Self {
        Self {
            covered_ratio: message.covered_ratio,
            explained_ratio: message.explained_ratio,
            is_blind: message.blind,
            doubts: message.doubts.clone(),
        }
    }
}

impl SeenPart {
    /// Its pose in the tray frame.
    pub(crate) fn pose_in_tray(&self) -> UprightPose {
        let (x_m, y_m) = (self.position_in_tray_m.x, self.position_in_tray_m.y);
        UprightPose { x_m, y_m, z_m: 0.0, yaw_rad: self.yaw_in_tray_rad }
    }
}

/// A message with a reason against picking that this version does not know.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("refusals of part {id} = {found}, allowed are sums of the constants, 0 to {max}", max = all_bits())]
pub struct UnknownRefusal {
    /// The part.
    pub id: u64,
    /// What the message says.
    pub found: u8,
}

/// A reason, and where it is kept.
type Reason = (u8, fn(&mut Refusals) -> &mut bool);

const REASONS: [Reason; 5] = [
    (PartCandidate::POSE_UNSURE, |refusals| &mut refusals.pose_unsure),
    (PartCandidate::POSE_DISAGREES, |refusals| &mut refusals.pose_disagrees),
    (PartCandidate::OFF_PLATEAU, |refusals| &mut refusals.off_plateau),
    (PartCandidate::PART_TOO_NEAR, |refusals| &mut refusals.part_too_near),
    (PartCandidate::WALL_TOO_NEAR, |refusals| &mut refusals.wall_too_near),
];

fn all_bits() -> u8 {
    REASONS.iter().map(|(bit, _)| bit).sum()
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_message(part_class: &str, parts: &[SeenPart], image: &ImageWorth) -> PartCandidates {
    let parts = parts.iter().map(|part| {
        let mut refusals = part.refusals;
        PartCandidate {
            id: part.id,
            pose: pose::to_message(&part.pose_in_tray()),
            pose_class: part.pose_class.clone().unwrap_or_default(),
            confidence: part.confidence,
            radius_m: part.radius_m,
            part_gap_m: part.part_gap_m,
            wall_gap_m: part.wall_gap_m,
            refusals: REASONS.iter().filter(|(_, kept)| *kept(&mut refusals)).map(|(bit, _)| bit).sum(),
        }
    });
    PartCandidates {
        part_class: part_class.to_owned(),
        parts: parts.collect(),
        covered_ratio: image.covered_ratio,
        explained_ratio: image.explained_ratio,
        blind: image.is_blind,
        doubts: image.doubts.clone(),
        ..PartCandidates::default()
    }
}

/// The parts of a message.
///
/// # Errors
/// A part that may not be picked for a reason unknown.
pub fn from_message(message: &PartCandidates) -> Result<Vec<SeenPart>, UnknownRefusal> {
    let part = |part: &PartCandidate| {
        if part.refusals & !all_bits() != 0 {
            return Err(UnknownRefusal { id: part.id, found: part.refusals });
        }
        let mut refusals = Refusals::default();
        for (bit, kept) in REASONS {
            *kept(&mut refusals) = part.refusals & bit != 0;
        }
        let UprightPose { x_m, y_m, yaw_rad, .. } = pose::from_message(&part.pose);
        Ok(SeenPart {
            id: part.id,
            position_in_tray_m: Vector2::new(x_m, y_m),
            yaw_in_tray_rad: yaw_rad,
            pose_class: (!part.pose_class.is_empty()).then(|| part.pose_class.clone()),
            confidence: part.confidence,
            radius_m: part.radius_m,
            part_gap_m: part.part_gap_m,
            wall_gap_m: part.wall_gap_m,
            refusals,
        })
    };
    message.parts.iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(refusals: Refusals) -> SeenPart {
        SeenPart {
            id: 7,
            position_in_tray_m: Vector2::new(0.03, -0.06),
            yaw_in_tray_rad: 0.5,
            pose_class: Some("flat".to_owned()),
            confidence: 0.95,
            radius_m: 0.0036,
            part_gap_m: f64::INFINITY,
            wall_gap_m: 0.012,
            refusals,
        }
    }

    #[test]
    fn what_goes_out_comes_in_whatever_speaks_against_a_part() {
        for bits in 0..32_u8 {
            let mut refusals = Refusals::default();
            for (index, (_, kept)) in REASONS.iter().enumerate() {
                *kept(&mut refusals) = bits >> index & 1 == 1;
            }
            let sent = [part(refusals), SeenPart { pose_class: None, ..part(refusals) }];
            let image = ImageWorth {
                covered_ratio: 0.1,
                explained_ratio: 0.2,
                is_blind: bits % 2 == 1,
                doubts: vec!["the light differs".to_owned()],
            };
            let message = to_message("block", &sent, &image);
            assert_eq!(ImageWorth::of_message(&message), image);
            assert_eq!(message.parts[0].refusals == 0, refusals.may_be_picked());
            let mut came = from_message(&message).unwrap();
            for part in &mut came {
                assert!((part.yaw_in_tray_rad - 0.5).abs() < 1e-12);
                part.yaw_in_tray_rad = 0.5;
            }
            assert_eq!((message.part_class.as_str(), came.as_slice()), ("block", sent.as_slice()));
        }
    }

    #[test]
    fn a_reason_unknown_is_an_error_that_names_the_part() {
        let mut message = to_message("block", &[part(Refusals::default())], &ImageWorth::default());
        message.parts[0].refusals = 33;
        let error = from_message(&message).unwrap_err();
        assert_eq!(error.to_string(), "refusals of part 7 = 33, allowed are sums of the constants, 0 to 31");
    }
}
