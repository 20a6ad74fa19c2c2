//! The overhead camera: its calibration, the pictures it takes of the tray, and how they are coded for transport.
//!
//! [`CameraModel`](feeder_model::camera::CameraModel) maps platen points to pixels and back; it is all that the selector knows.
//! [`Renderer`] takes the picture: platen, tray and parts under a light, through the lens, with sensor noise.
//! [`AllRound`] takes it under a ring of lamps instead.
//! [`codec`] turns pictures into JPEG and back.

mod all_round;
mod appearance;
pub mod codec;
mod light;
mod noise;
mod parts;
mod raster;
mod relief;
mod render;
mod scene;
mod solid;
mod surfaces;
mod tile;
mod tray;

pub use all_round::AllRound;
pub use appearance::TrayAppearance;
pub use light::LightModel;
pub use render::Renderer;
pub use scene::{Scene, SensorModel, TrayShot};
pub use solid::{PartSolid, PartView};
