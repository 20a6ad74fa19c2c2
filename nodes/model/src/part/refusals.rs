//! Why a part may not be picked.

use std::fmt;

/// What speaks against picking a part that lies on the plateau, as the selector judges it. Nothing: it may be picked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Refusals {
    /// The resting pose is unknown, or not sure enough over the images so far.
    pub pose_unsure: bool,
    /// The latest image shows another resting pose than those before.
    pub pose_disagrees: bool,
    /// The outline does not lie wholly on the plateau.
    pub off_plateau: bool,
    /// The gripper has no room towards another part or thing.
    pub part_too_near: bool,
    /// The gripper has no room towards a wall.
    pub wall_too_near: bool,
}

impl Refusals {
    /// Whether nothing speaks against picking the part.
    #[must_use]
    pub fn may_be_picked(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Refusals {
    /// The reasons, with commas between.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reasons = [
            (self.pose_unsure, "its pose is not sure"),
            (self.pose_disagrees, "the images disagree on its pose"),
            (self.off_plateau, "it is not wholly on the plateau"),
            (self.part_too_near, "another part is too near"),
            (self.wall_too_near, "a wall is too near"),
        ];
        let mut separator = "";
        for (_, reason) in reasons.iter().filter(|(holds, _)| *holds) {
            write!(f, "{separator}{reason}")?;
            separator = ", ";
        }
        Ok(())
    }
}
