//! A running feeder on a terminal, for people who are there by ssh: the numbers of the page, as text.
//!
//! It is one more viewer of [`feeder_view`] and shows the messages that the page gets; nothing is counted here.
//! [`Picture`] holds the newest of them, [`draw`] draws them, and [`Screen`] owns the terminal from its opening until it
//! is given back, whatever happens meanwhile.

mod band;
mod draw;
mod figures;
mod held;
mod panels;
mod picture;
mod screen;
mod stderr;
mod units;

pub use crate::draw::{Palette, draw};
pub use crate::picture::Picture;
pub use crate::screen::{Screen, ScreenError, is_possible};
