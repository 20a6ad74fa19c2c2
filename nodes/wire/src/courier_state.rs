//! What a courier does, and how well, as `courier_state` tells it.

use minifactory_msgs::msg::CourierState;

/// What `fault` says of a driver that is not active, and that has nothing else wrong.
pub const NOT_ACTIVE: &str = "the courier driver is not active";

/// What a courier does, and how well it follows its commands as far as its driver knows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CourierActivity {
    /// The driver moves the courier when it is asked to. Not told of one in fault, which counts as active.
    pub active: bool,
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
        fault: activity.fault.or_else(|| (!activity.active).then(|| NOT_ACTIVE.to_owned())).unwrap_or_default(),
        warning: activity.warning.unwrap_or_default(),
        waveform_sequence: activity.waveform_sequence,
        ..CourierState::default()
    }
}

/// The activity of a message.
#[must_use]
pub fn from_message(message: CourierState) -> CourierActivity {
    let active = message.fault != NOT_ACTIVE;
    CourierActivity {
        active,
        vibrating: message.vibrating,
        moving: message.moving,
        position_error_m: message.position_error_m,
        yaw_error_rad: message.yaw_error_rad,
        fault: Some(message.fault).filter(|fault| active && !fault.is_empty()),
        warning: Some(message.warning).filter(|warning| !warning.is_empty()),
        waveform_sequence: message.waveform_sequence,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_activity_survives_the_round_trip() {
        let stopped = || Some("emergency stop".to_owned());
        for (active, vibrating, moving, fault) in
            [(true, true, false, None), (true, false, true, stopped()), (false, false, true, None)]
        {
            let (position_error_m, yaw_error_rad, waveform_sequence) = (2e-6, -3e-5, 7);
            let warning = vibrating.then(|| "not followed".to_owned());
            let sent = CourierActivity {
                active,
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

    #[test]
    fn a_fault_says_more_than_that_the_driver_is_not_active() {
        let fault = Some("emergency stop".to_owned());
        let message = to_message(CourierActivity { active: false, fault: fault.clone(), ..CourierActivity::default() });
        assert_eq!(from_message(message).fault, fault);
    }
}
