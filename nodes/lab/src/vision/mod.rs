//! Teaching the selector, and scoring it.

pub(crate) mod crowd;
pub(crate) mod score;
pub(crate) mod score_vision;
