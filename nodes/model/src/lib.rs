//! What the world of the feeder and its control must agree on.
//!
//! Everything here is a function of its inputs. There is no clock, no file, no thread and no message type. Quantities are
//! SI and radians, and names carry units.
//!
//! Frames: `platen` is fixed with z up; `tray` has its origin at the tray's centre and turns with
//! the courier. In the tray, ψ is measured counter-clockwise from the foot of the ramp: the ramp spans \[0, Θ), the
//! plateau \[Θ, 2π), and the drop-off back to the foot of the ramp lies at 2π.
//!
//! How fast a part is fed up a slope:
//!
//! ```
//! use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
//! use feeder_model::mechanics::{Friction, slope::LinearTrack};
//! use feeder_model::waveform::{Axis, Waveform};
//!
//! let waveform = Waveform::stick_slip(Axis::X, 0.05, 1.6, 10.1)?;
//! let track = LinearTrack::new(Friction::uniform(0.2)?, 2_f64.to_radians(), STANDARD_GRAVITY_M_S2)?;
//! let steady = track.drive(&waveform, 1.0)?.steady().ok_or("parts slide down for ever")?;
//! assert!(steady.feed_m_s > 0.0 && steady.slip_back_m >= 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Speeds of tray and part under stick-slip on a level track:
//!
#![doc = include_str!("../pictures/stick_slip_motion.svg")]

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

/// The front page's code, which is tried with the documentation's.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct FrontPage;
