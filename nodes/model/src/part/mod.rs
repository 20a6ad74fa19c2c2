//! The part: its shape, mass, friction and the ways it can lie.

mod drawn;
mod hazard;
mod part_type;
mod refusals;
mod spec;

pub use hazard::Hazard;
pub use part_type::{PartProblem, PartType, PartTypeError};
pub use refusals::Refusals;
pub use spec::{DropTable, PartSpec, PoseName};
