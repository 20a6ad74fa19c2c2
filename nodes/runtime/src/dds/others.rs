//! Which other participants are there, and how those left that are not.

use std::collections::BTreeSet;

use super::Guid;

/// How another participant left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Leave {
    /// It said so.
    Announced,
    /// Its lease ran out: it was killed, or can no longer be reached.
    Silent,
}

/// The other participants of a domain, as far as has been heard.
#[derive(Debug, Default)]
pub(super) struct Others {
    there: BTreeSet<Guid>,
    /// Those that fell silent, and have not been heard of again; kept for good, 16 bytes each.
    silent: BTreeSet<Guid>,
}

impl Others {
    pub(super) fn join(&mut self, participant: Guid) {
        self.there.insert(participant);
        self.silent.remove(&participant);
    }

    pub(super) fn leave(&mut self, participant: Guid, how: Leave) {
        if self.there.remove(&participant) && how == Leave::Silent {
            self.silent.insert(participant);
        }
    }

    /// Those that are there.
    pub(super) fn there(&self) -> BTreeSet<Guid> {
        self.there.clone()
    }

    /// How the participant of an endpoint left; `None` while it is there.
    pub(super) fn leave_of(&self, endpoint: Guid) -> Option<Leave> {
        let is_its = |other: &Guid| other.participant() == endpoint.participant();
        if self.silent.iter().any(is_its) {
            return Some(Leave::Silent);
        }
        (!self.there.iter().any(is_its)).then_some(Leave::Announced)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The entity of this number in a participant.
    fn guid(participant: u8, entity: u8) -> Guid {
        let mut bytes = [participant; 16];
        bytes[12..].fill(entity);
        Guid(bytes)
    }

    #[test]
    fn how_a_participant_left_is_known_until_it_is_back() {
        let (one, other) = (guid(1, 0xC1), guid(2, 0xC1));
        let reader = guid(1, 4);
        let mut others = Others::default();
        assert_eq!(others.leave_of(reader), Some(Leave::Announced), "nobody has been heard of");
        for how in [Leave::Silent, Leave::Announced, Leave::Silent] {
            others.join(one);
            others.join(other);
            assert_eq!(others.leave_of(reader), None, "before it leaves ({how:?})");
            others.leave(one, how);
            assert_eq!(others.leave_of(reader), Some(how));
            assert_eq!(others.there(), BTreeSet::from([other]));
        }
    }

    #[test]
    fn who_was_never_there_did_not_fall_silent() {
        let mut others = Others::default();
        others.leave(guid(1, 0xC1), Leave::Silent);
        assert_eq!(others.leave_of(guid(1, 4)), Some(Leave::Announced));
    }
}
