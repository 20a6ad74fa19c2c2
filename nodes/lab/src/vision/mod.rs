//! Teaching the selector, and scoring it.

pub(crate) mod crowd;
pub(crate) mod score;
pub(crate) mod score_pictures;
pub(crate) mod score_vision;
pub(crate) mod sensitivity;
