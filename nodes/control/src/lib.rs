//! Control of the feeder: what runs on hardware as it runs on a simulation.
//!
//! Everything here is a function of its inputs. There is no clock, no file, no thread and no message type, and nothing of
//! the simulated world: what is known comes from a sensor, an image or another agent.

pub mod courier;
pub mod delivery;
pub mod manipulator;
pub mod platen;
