//! Ground truth of the parts, as `parts` tells it.

use feeder_model::tray::Place;
use minifactory_msgs::msg::{PartState, PartStates};
use nalgebra::Vector2;

use crate::numbered::{UnknownNumber, numbered};

numbered! {
    /// The number of a place.
    place_number,
    /// The place of a number.
    place_of,
    "surface", "0 to 2",
    Place as u8 {
        Ramp = PartState::RAMP,
        Plateau = PartState::PLATEAU,
        Falling = PartState::FALLING,
    }
}

/// Where a part truly is and how it moves, in the tray's polar coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct TruePart {
    /// Names the part as long as it is in the feeder.
    pub id: u32,
    /// Class of the part, as the catalogue names it.
    pub part_class: String,
    /// What it rests on.
    pub place: Place,
    /// Index of its resting pose in its class.
    pub resting_pose: u8,
    /// Distance of its centre from the tray's centre, m.
    pub radius_m: f64,
    /// Angle of its centre about the tray's centre, from the foot of the ramp, counter-clockwise, rad.
    pub angle_rad: f64,
    /// How it is turned in the tray frame, rad.
    pub yaw_rad: f64,
    /// Velocity relative to the tray, away from the tray's centre, m/s.
    pub radial_velocity_m_s: f64,
    /// Velocity relative to the tray, counter-clockwise about the tray's centre, m/s.
    pub tangential_velocity_m_s: f64,
    /// It does not slide.
    pub sticking: bool,
    /// It rests where the waveform cannot move it on.
    pub stranded: bool,
}

impl TruePart {
    /// Its centre in the tray frame, m.
    #[must_use]
    pub fn position_in_tray_m(&self) -> Vector2<f64> {
        let (sin, cos) = self.angle_rad.sin_cos();
        Vector2::new(self.radius_m * cos, self.radius_m * sin)
    }
}

/// All parts in a feeder, and counts since the start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrueParts {
    /// The parts, by rising id.
    pub parts: Vec<TruePart>,
    /// Entries to the plateau.
    pub fed: u32,
    /// Falls over the drop-off.
    pub recirculated: u32,
    /// Parts taken out by grippers.
    pub picked: u32,
    /// Times that parts began to hold each other up.
    pub jams: u32,
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_message(truth: TrueParts) -> PartStates {
    let part = |part: TruePart| PartState {
        id: part.id,
        part_class: part.part_class,
        surface: place_number(part.place),
        resting_pose: part.resting_pose,
        radius_m: part.radius_m,
        angle_rad: part.angle_rad,
        yaw_rad: part.yaw_rad,
        radial_velocity_m_s: part.radial_velocity_m_s,
        tangential_velocity_m_s: part.tangential_velocity_m_s,
        sticking: part.sticking,
        stranded: part.stranded,
    };
    PartStates {
        parts: truth.parts.into_iter().map(part).collect(),
        fed: truth.fed,
        recirculated: truth.recirculated,
        picked: truth.picked,
        jams: truth.jams,
        ..PartStates::default()
    }
}

/// The parts of a message.
///
/// # Errors
/// A part that rests on something unknown.
pub fn from_message(message: PartStates) -> Result<TrueParts, UnknownNumber> {
    let part = |part: PartState| {
        Ok(TruePart {
            id: part.id,
            part_class: part.part_class,
            place: place_of(part.surface)?,
            resting_pose: part.resting_pose,
            radius_m: part.radius_m,
            angle_rad: part.angle_rad,
            yaw_rad: part.yaw_rad,
            radial_velocity_m_s: part.radial_velocity_m_s,
            tangential_velocity_m_s: part.tangential_velocity_m_s,
            sticking: part.sticking,
            stranded: part.stranded,
        })
    };
    Ok(TrueParts {
        parts: message.parts.into_iter().map(part).collect::<Result<_, _>>()?,
        fed: message.fed,
        recirculated: message.recirculated,
        picked: message.picked,
        jams: message.jams,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(id: u32, place: Place) -> TruePart {
        TruePart {
            id,
            part_class: "block".to_owned(),
            place,
            resting_pose: 2,
            radius_m: 0.07,
            angle_rad: 4.0,
            yaw_rad: -0.5,
            radial_velocity_m_s: 0.01,
            tangential_velocity_m_s: -0.02,
            sticking: id == 8,
            stranded: id == 9,
        }
    }

    #[test]
    fn parts_survive_the_round_trip() {
        let parts = vec![part(7, Place::Ramp), part(8, Place::Plateau), part(9, Place::Falling)];
        let sent = TrueParts { parts, fed: 11, recirculated: 5, picked: 3, jams: 1 };
        assert_eq!(from_message(to_message(sent.clone())), Ok(sent));
    }

    #[test]
    fn a_place_unknown_is_an_error() {
        let mut message = to_message(TrueParts { parts: vec![part(7, Place::Ramp)], ..TrueParts::default() });
        message.parts[0].surface = 3;
        assert_eq!(from_message(message).unwrap_err().to_string(), "surface = 3, allowed are 0 to 2");
    }

    #[test]
    fn angles_are_counted_counter_clockwise_from_the_foot_of_the_ramp() {
        let part = TruePart { angle_rad: std::f64::consts::FRAC_PI_2, ..part(7, Place::Ramp) };
        assert!((part.position_in_tray_m() - Vector2::new(0.0, 0.07)).norm() < 1e-12);
    }
}
