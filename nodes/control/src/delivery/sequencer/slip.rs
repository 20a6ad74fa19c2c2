//! Parts that slide although they should be held.

use super::super::choice::{CandidateFrame, protected_parts};
use super::super::protocol::{Output, Warning};
use super::DeliverySequencer;

/// Parts have slid although they should have been held.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slip {
    slid_m: f64,
    friction: f64,
}

impl Slip {
    fn warning(self) -> Warning {
        Warning::Slipped { slid_m: self.slid_m, friction: self.friction }
    }
}

impl DeliverySequencer {
    /// What the planner found of the friction between parts and tray, if that is not as it was told.
    #[must_use]
    pub fn slip_trouble(&self) -> Option<String> {
        self.slip.map(|slip| slip.warning().to_string())
    }

    /// Takes a look at parts at rest that were not shaken since they were chosen from. If one has slid, moves reckon with less
    /// friction from now on; not with so little that parts which always are protected would slide where they lie.
    pub(super) fn watch_slip(&mut self, frame: &CandidateFrame) {
        /// What is left of the friction believed in after a slip, and the least of what was believed at first.
        const LOWERED: f64 = 0.9;
        const LEAST: f64 = 0.3;
        let Some(slid_m) = self.lying.as_mut().and_then(|lying| lying.look_again(frame)) else { return };
        let believed = self.slip.map_or(self.config.gentle.friction, |slip| slip.friction);
        let lower = (LOWERED * believed).max(LEAST * self.config.gentle.friction);
        let always = protected_parts(&self.config, &self.planner, &[], None);
        // A step more must hold them too, or next to nothing would be left for moves.
        let holds = self.planner.clone().believing(LOWERED * lower).holds_at_rest(&always);
        let slip = Slip { slid_m, friction: if holds { lower } else { believed } };
        self.planner = self.planner.clone().believing(slip.friction);
        self.slip = Some(slip);
        self.outputs.push(Output::Warning(slip.warning()));
    }
}
