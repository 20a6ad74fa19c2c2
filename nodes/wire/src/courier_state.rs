//! What a courier does, and how well, as `courier_state` tells it.

use minifactory_msgs::msg::CourierState;

/// What a courier does, and how well it follows its commands as far as its driver knows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CourierActivity {
    /// A waveform runs.
    pub vibrating: bool,
    /// A trajectory is followed.
    pub moving: bool,
    /// Distance between commanded and estimated place of the courier's centre, m.
    pub position_error_m: f64,
    /// Commanded less estimated yaw, rad.
    pub yaw_error_rad: f64,
    /// Why the courier cannot work, for people.
    pub fault: Option<String>,
    /// Why parts may not be fed as computed although the courier works, for people.
    pub warning: Option<String>,
    /// Number of the waveform that the driver has heard last; 0: none.
    pub waveform_sequence: u32,
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_message(activity: CourierActivity) -> CourierState {
    CourierState {
        vibrating: activity.vibrating,
        moving: activity.moving,
        position_error_m: activity.position_error_m,
        yaw_error_rad: activity.yaw_error_rad,
        fault: activity.fault.unwrap_or_default(),
        warning: activity.warning.unwrap_or_default(),
        waveform_sequence: activity.waveform_sequence,
        ..CourierState::default()
    }
}

/// The activity of a message.
#[must_use]
pub fn from_message(message: CourierState) -> CourierActivity {
    CourierActivity {
        vibrating: message.vibrating,
        moving: message.moving,
        position_error_m: message.position_error_m,
        yaw_error_rad: message.yaw_error_rad,
        fault: Some(message.fault).filter(|fault| !fault.is_empty()),
        warning: Some(message.warning).filter(|warning| !warning.is_empty()),
        waveform_sequence: message.waveform_sequence,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_activity_survives_the_round_trip() {
        for (vibrating, moving, fault) in [(true, false, None), (false, true, Some("emergency stop".to_owned()))] {
            let (position_error_m, yaw_error_rad, waveform_sequence) = (2e-6, -3e-5, 7);
            let warning = vibrating.then(|| "not followed".to_owned());
            let sent = CourierActivity {
                vibrating,
                moving,
                position_error_m,
                yaw_error_rad,
                fault,
                warning,
                waveform_sequence,
            };
            assert_eq!(from_message(to_message(sent.clone())), sent);
        }
    }
}
