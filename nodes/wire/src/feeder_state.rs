//! How a feeder is, as `state` tells other agents in the terms of PackML.

use minifactory_msgs::msg::FeederState;

/// How a feeder is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// It does not work: nothing was heard of its courier yet, or who is needed for it is not active.
    Stopped,
    /// It is ready; nothing is asked for.
    Idle,
    /// It works on deliveries.
    AtWork,
    /// A part waits under a station to be taken.
    AwaitsHandOver,
    /// Another agent is in the way on the platen.
    AwaitsArea,
    /// No fitting part comes.
    Starved,
    /// No fitting part comes, and parts do not move as the waveform should move them.
    BadlyFed,
    /// No fitting part comes, and what lies on the plateau is not recognised, or the images tell nothing of it.
    Unrecognised,
    /// A fault stopped it.
    Fault,
    /// It empties the plateau.
    Purging,
}

/// State and reason of a condition.
fn numbers(condition: Condition) -> (u8, u8) {
    type S = FeederState;
    match condition {
        Condition::Stopped => (S::STOPPED, S::NO_REASON),
        Condition::Idle => (S::IDLE, S::NO_REASON),
        Condition::AtWork => (S::EXECUTE, S::NO_REASON),
        Condition::AwaitsHandOver => (S::SUSPENDED, S::WAITING_FOR_HANDOVER),
        Condition::AwaitsArea => (S::SUSPENDED, S::WAITING_FOR_AREA),
        Condition::Starved => (S::HELD, S::STARVED),
        Condition::BadlyFed => (S::HELD, S::BADLY_FED),
        Condition::Unrecognised => (S::HELD, S::UNRECOGNISED),
        Condition::Fault => (S::ABORTED, S::FAULT),
        Condition::Purging => (S::CLEARING, S::NO_REASON),
    }
}

/// The condition of state and reason.
fn condition_of(state: u8, reason: u8) -> Result<Condition, UnknownCondition> {
    type S = FeederState;
    Ok(match (state, reason) {
        (S::STOPPED, S::NO_REASON) => Condition::Stopped,
        (S::IDLE, S::NO_REASON) => Condition::Idle,
        (S::EXECUTE, S::NO_REASON) => Condition::AtWork,
        (S::SUSPENDED, S::WAITING_FOR_HANDOVER) => Condition::AwaitsHandOver,
        (S::SUSPENDED, S::WAITING_FOR_AREA) => Condition::AwaitsArea,
        (S::HELD, S::STARVED) => Condition::Starved,
        (S::HELD, S::BADLY_FED) => Condition::BadlyFed,
        (S::HELD, S::UNRECOGNISED) => Condition::Unrecognised,
        (S::ABORTED, S::FAULT) => Condition::Fault,
        (S::CLEARING, S::NO_REASON) => Condition::Purging,
        _ => return Err(UnknownCondition { state, reason }),
    })
}

/// A feeder and its open deliveries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FeederReport {
    /// How it is.
    pub condition: Condition,
    /// The same for people, where there is more to say.
    pub message: String,
    /// The recipe in force.
    pub recipe: String,
    /// The stations of the open deliveries, in the order in which they were asked for.
    pub stations: Vec<String>,
}

/// A state and a reason that do not go together, or are not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("state = {state} with reason = {reason} is none that the definition lists")]
pub struct UnknownCondition {
    /// The state.
    pub state: u8,
    /// The reason.
    pub reason: u8,
}

/// The message; its header is left to the publisher.
#[must_use]
pub fn to_message(report: &FeederReport) -> FeederState {
    let (state, reason) = numbers(report.condition);
    FeederState {
        state,
        reason,
        message: report.message.clone(),
        recipe: report.recipe.clone(),
        open: u32::try_from(report.stations.len()).unwrap_or(u32::MAX),
        stations: report.stations.clone(),
        ..FeederState::default()
    }
}

/// The report of a message.
///
/// # Errors
/// A state or a reason that is not known.
pub fn from_message(message: FeederState) -> Result<FeederReport, UnknownCondition> {
    let FeederState { state, reason, message, recipe, stations, .. } = message;
    Ok(FeederReport { condition: condition_of(state, reason)?, message, recipe, stations })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn how_a_feeder_is_survives_the_round_trip_in_every_condition() {
        type C = Condition;
        let conditions = [
            C::Stopped,
            C::Idle,
            C::AtWork,
            C::AwaitsHandOver,
            C::AwaitsArea,
            C::Starved,
            C::BadlyFed,
            C::Unrecognised,
            C::Fault,
            C::Purging,
        ];
        for condition in conditions {
            let stations = vec!["station_2".to_owned(), "station_1".to_owned()];
            let (message, recipe) = ("at station_2".to_owned(), "plain".to_owned());
            let sent = FeederReport { condition, message, recipe, stations };
            let message = to_message(&sent);
            assert_eq!(message.open, 2);
            assert_eq!(from_message(message), Ok(sent));
        }
        let unknown = FeederState { reason: FeederState::STARVED, ..FeederState::default() };
        assert_eq!(from_message(unknown), Err(UnknownCondition { state: 0, reason: 1 }));
    }
}
