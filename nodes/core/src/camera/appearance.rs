//! How parts look, as data.

use serde::{Deserialize, Serialize};

use super::{InvalidValue, require, single};

/// Entries of a face's look from its centre to its rim.
const FACE_SAMPLES: usize = 256;

/// A ring of a face: from the radius of the ring inside it to its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceRing {
    /// Outer radius relative to the part's.
    pub radius_ratio: f64,
    /// Share of light that comes back.
    pub reflectance: f64,
    /// Rise of the surface per distance outwards: negative on a chamfer at the rim, positive in a countersink.
    #[serde(default)]
    pub slope: f64,
}

/// A round spot beside the centre that makes the part's yaw visible.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceMark {
    /// Distance of the spot from the centre along the part's x, relative to the part's radius.
    pub offset_ratio: f64,
    /// Radius of the spot, relative to the part's radius.
    pub radius_ratio: f64,
    /// Share of light that comes back.
    pub reflectance: f64,
}

/// How a face looks from above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceAppearance {
    /// Concentric rings from the centre outwards; the last reaches the rim.
    pub rings: Vec<FaceRing>,
    /// A spot beside the centre.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mark: Option<FaceMark>,
}

/// A disc-like part: its size and, for each resting pose, the face then on top.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartAppearance {
    /// Diameter, m.
    pub diameter_m: f64,
    /// Height of the upper face above the surface the part lies on, m.
    pub thickness_m: f64,
    /// Share of light that comes back from the side.
    pub side_reflectance: f64,
    /// The upper face in each resting pose.
    pub faces: Vec<FaceAppearance>,
}

impl PartAppearance {
    /// A rubber grommet of this size: in pose 0 a face with a dark hole, in pose 1 a darker flange with a bright boss.
    /// Both faces are about equally bright on the whole, so that only their structure tells them apart.
    #[must_use]
    pub fn grommet(diameter_m: f64, thickness_m: f64) -> Self {
        let ring = |radius_ratio, reflectance, slope| FaceRing { radius_ratio, reflectance, slope };
        let face = |rings| FaceAppearance { rings, mark: None };
        Self {
            diameter_m,
            thickness_m,
            side_reflectance: 0.26,
            faces: vec![
                face(vec![ring(0.30, 0.06, 0.0), ring(0.40, 0.40, 0.8), ring(0.90, 0.44, 0.0), ring(1.00, 0.38, -0.9)]),
                face(vec![
                    ring(0.42, 0.60, 0.0),
                    ring(0.50, 0.45, -1.2),
                    ring(0.60, 0.20, 0.0),
                    ring(0.92, 0.36, 0.0),
                    ring(1.00, 0.32, -0.9),
                ]),
            ],
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    ///
    /// [`InvalidValue`] naming the field out of range.
    pub fn validate(&self) -> Result<(), InvalidValue> {
        let diameter_ok = (5e-4..=0.2).contains(&self.diameter_m);
        require(diameter_ok, "part.diameter_m", self.diameter_m, "5e-4 to 0.2 m")?;
        let thickness_ok = (0.0..=0.1).contains(&self.thickness_m);
        require(thickness_ok, "part.thickness_m", self.thickness_m, "0 to 0.1 m")?;
        let share = |field, value| require((0.0..=1.0).contains(&value), field, value, "0 to 1");
        share("part.side_reflectance", self.side_reflectance)?;
        require(!self.faces.is_empty(), "part.faces", 0.0, "at least one face")?;
        for face in &self.faces {
            let mut inner = 0.0;
            for ring in &face.rings {
                let radius = ring.radius_ratio;
                require(radius > inner && radius <= 1.0, "part.faces.rings.radius_ratio", radius, "rising, up to 1")?;
                inner = radius;
                share("part.faces.rings.reflectance", ring.reflectance)?;
                let slope_ok = ring.slope.abs() <= 10.0;
                require(slope_ok, "part.faces.rings.slope", ring.slope, "-10 to 10")?;
            }
            require(inner >= 1.0, "part.faces.rings.radius_ratio", inner, "1 for the last ring")?;
            if let Some(mark) = face.mark {
                share("part.faces.mark.offset_ratio", mark.offset_ratio)?;
                share("part.faces.mark.radius_ratio", mark.radius_ratio)?;
                share("part.faces.mark.reflectance", mark.reflectance)?;
            }
        }
        Ok(())
    }
}

/// A part where it is, in the tray frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartView {
    /// Centre, x, m.
    pub x_m: f64,
    /// Centre, y, m.
    pub y_m: f64,
    /// Underside above the foot of the ramp, m.
    pub z_m: f64,
    /// Turn about the vertical, rad.
    pub yaw_rad: f64,
    /// Resting pose: which face is on top, an index into [`PartAppearance::faces`].
    pub pose: usize,
}

/// A face at one distance from its centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct FaceSample {
    /// Share of light that comes back.
    pub(super) reflectance: f32,
    /// Rise per distance outwards.
    pub(super) slope: f32,
    /// Cosine of the slope's angle.
    pub(super) flattening: f32,
}

/// A face sampled along its radius, blurred as far as a pixel does.
#[derive(Clone, Debug)]
pub(super) struct Face {
    samples: Vec<FaceSample>,
    pub(super) mark: Option<FaceMark>,
}

impl Face {
    pub(super) fn new(appearance: &FaceAppearance, pixel_ratio: f64) -> Self {
        const TAPS: usize = 9;
        let samples = (0..FACE_SAMPLES)
            .map(|sample| {
                let place = sample as f64 / (FACE_SAMPLES - 1) as f64;
                let (mut reflectance, mut slope) = (0.0, 0.0);
                for tap in 0..TAPS {
                    let offset = (tap as f64 / (TAPS - 1) as f64 - 0.5) * pixel_ratio;
                    let radius = (place + offset).abs().min(1.0);
                    // The last ring reaches 1, so one is always found.
                    if let Some(ring) = appearance.rings.iter().find(|ring| radius <= ring.radius_ratio) {
                        reflectance += ring.reflectance / TAPS as f64;
                        slope += ring.slope / TAPS as f64;
                    }
                }
                FaceSample {
                    reflectance: single(reflectance),
                    slope: single(slope),
                    flattening: single(1.0 / slope.hypot(1.0)),
                }
            })
            .collect();
        Self { samples, mark: appearance.mark }
    }

    /// The face at a distance from its centre, in radii.
    pub(super) fn at(&self, radius: f32) -> FaceSample {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a float cast saturates")]
        let index = (radius * (FACE_SAMPLES - 1) as f32 + 0.5) as usize;
        self.samples[index.min(FACE_SAMPLES - 1)]
    }
}
