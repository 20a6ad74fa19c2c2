//! What the world of the feeder and its control must agree on.
//!
//! Everything here is a function of its inputs. There is no clock, no file, no thread and no message type. Quantities are
//! SI and radians, and names carry units.
//!
//! Frames (see also the README): `platen` is fixed with z up; `tray` has its origin at the tray's centre and turns with
//! the courier. In the tray, ψ is measured counter-clockwise from the foot of the ramp: the ramp spans \[0, Θ), the
//! plateau \[Θ, 2π), and the drop-off back to the foot of the ramp lies at 2π.

pub mod area;
pub mod camera;
pub mod delivery;
pub mod geometry;
pub mod gravity;
pub mod mechanics;
pub mod motion;
pub mod motor;
pub mod part;
pub mod range;
pub mod seed;
pub mod trajectory;
pub mod tray;
pub mod waveform;
