//! Positions and velocities of joints as `joint_states` holds them.

use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::std_msgs::msg::Header;

/// A joint: m and m/s if it slides, rad and rad/s if it turns.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Position.
    pub position: f64,
    /// Velocity.
    pub velocity: f64,
}

/// The joints as a message.
#[must_use]
pub fn to_message(header: Header, joints: &[Joint]) -> JointState {
    JointState {
        header,
        name: joints.iter().map(|joint| joint.name.clone()).collect(),
        position: joints.iter().map(|joint| joint.position).collect(),
        velocity: joints.iter().map(|joint| joint.velocity).collect(),
        effort: Vec::new(),
    }
}

/// Not one position and one velocity for each joint.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{names} joints have {positions} positions and {velocities} velocities; one of each is needed")]
pub struct JointsDiffer {
    /// Number of names.
    pub names: usize,
    /// Number of positions.
    pub positions: usize,
    /// Number of velocities.
    pub velocities: usize,
}

/// The joints of a message.
///
/// # Errors
/// Arrays of different lengths.
pub fn from_message(message: &JointState) -> Result<Vec<Joint>, JointsDiffer> {
    let (names, positions, velocities) = (message.name.len(), message.position.len(), message.velocity.len());
    if names != positions || names != velocities {
        return Err(JointsDiffer { names, positions, velocities });
    }
    let values = message.position.iter().zip(&message.velocity);
    let joint = |(name, (position, velocity)): (&String, (&f64, &f64))| Joint {
        name: name.clone(),
        position: *position,
        velocity: *velocity,
    };
    Ok(message.name.iter().zip(values).map(joint).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_survive_the_round_trip() {
        let joint = |name: &str, position, velocity| Joint { name: name.to_owned(), position, velocity };
        let sent = [joint("courier_x", 0.1, -1.5), joint("courier_yaw", 0.02, 3.0)];
        assert_eq!(from_message(&to_message(Header::default(), &sent)).unwrap(), sent);
    }

    #[test]
    fn ragged_joints_are_refused() {
        let message = JointState { name: vec!["x".to_owned()], ..JointState::default() };
        assert_eq!(
            from_message(&message).unwrap_err().to_string(),
            "1 joints have 0 positions and 0 velocities; one of each is needed"
        );
    }
}
