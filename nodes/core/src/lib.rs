//! The feeder without its middleware: what moves, what slides, what is seen and what is chosen.
//!
//! Everything here is a function of its inputs. There is no clock, no file, no thread and no message type; nodes feed
//! this crate with stamped inputs and publish what comes out. Quantities are SI and radians, and names carry units.
//!
//! Frames (see also the README): `platen` is fixed with z up; `tray` has its origin at the tray's centre and turns with
//! the courier. In the tray, ψ is measured counter-clockwise from the foot of the ramp: the ramp spans \[0, Θ), the
//! plateau \[Θ, 2π), and the drop-off back to the foot of the ramp lies at 2π.

pub mod camera;
pub mod courier;
pub mod delivery;
pub mod experiment;
pub mod geometry;
pub mod gravity;
pub mod manipulator;
pub mod mechanics;
pub mod motion;
pub mod parts;
pub mod platen;
pub mod range;
pub mod scenario;
pub mod seed;
pub mod selection;
pub mod source;
pub mod tray;
pub mod waveform;
