//! The parts on one tray: putting them on, taking them off, looking at them.

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use thiserror::Error;

use super::contact::Contacts;
use super::impulse::ContactLaw;
use super::placement::{LandingZone, LoadingBand, is_free, random_pose, random_yaw_rad};
use super::touch::{Scratch, touch};
use super::track::TrayPath;
use crate::parts::{BulkSettings, Missed, OpenGripper, Part, PickedPart, Place, motion_check, settings};
use feeder_model::motion::MotionBlock;
use feeder_model::part::PartType;
use feeder_model::range::OutOfRange;
use feeder_model::tray::TrayGeometry;

/// What has happened to the parts since the bulk was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Parts put onto the tray.
    pub loaded: u64,
    /// Parts taken off the tray by grippers.
    pub picked: u64,
    /// Parts taken off the tray otherwise.
    pub removed: u64,
    /// Entries to the plateau from the ramp, once per part and lap however often it crosses the line.
    pub fed: u64,
    /// Parts that fell off the end of the plateau.
    pub recirculated: u64,
    /// Times that parts began to hold each other up on the ramp, or a fallen part found its foot full.
    pub jams: u64,
}

/// Result of loading parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loaded {
    /// Parts put onto the tray.
    pub loaded: usize,
    /// Parts refused because no free place was found for them.
    pub refused: usize,
}

/// Why a part was not put where it was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum PutError {
    /// There is no part of this identity.
    #[error("there is no part {id}")]
    NoSuchPart {
        /// The identity asked for.
        id: u32,
    },
    /// The resting pose does not exist.
    #[error("pose = {pose} is outside the allowed range [0, {poses})")]
    NoSuchPose {
        /// The index asked for.
        pose: usize,
        /// How many resting poses the part has.
        poses: usize,
    },
    /// The place is taken, or not on the tray.
    #[error("no room for a part at radius {radius_m} m and angle {angle_rad} rad")]
    NoRoom {
        /// Radius asked for, m.
        radius_m: f64,
        /// Angle asked for, rad.
        angle_rad: f64,
    },
}

/// The parts on one tray.
#[derive(Clone, Debug)]
pub struct PartBulk {
    pub(super) tray: TrayGeometry,
    pub(super) part: PartType,
    pub(super) settings: BulkSettings,
    pub(super) track: TrayPath,
    pub(super) band: LoadingBand,
    pub(super) landing: LandingZone,
    pub(super) contacts: Contacts,
    pub(super) scratch: Scratch,
    pub(super) rng: Pcg64Mcg,
    /// In order of identity.
    pub(super) parts: Vec<Part>,
    pub(super) next_id: u32,
    pub(super) counters: Counters,
    /// How many parts are falling.
    pub(super) falling: usize,
    /// Mean speed of the fastest part over the last step, m/s.
    pub(super) fastest_m_s: f64,
    /// If all parts stick: the tray's acceleration up to which they certainly stay, m/s².
    pub(super) hold_m_s2: Option<f64>,
    pub(super) judging_in_s: f64,
    /// Time since the last look at who climbs during which the tray shook parts loose, s.
    pub(super) shaken_s: f64,
    /// If the parts jammed when last looked at.
    pub(super) jammed: bool,
    /// Least width of the part, m.
    pub(super) width_m: f64,
}

impl PartBulk {
    /// An empty tray. `seed` decides where parts are loaded, how they lie, and how they land.
    ///
    /// # Errors
    /// If the tray's geometry, the part's size or a setting is out of range.
    pub fn new(tray: TrayGeometry, part: PartType, settings: BulkSettings, seed: u64) -> Result<Self, OutOfRange> {
        settings::check_fit(&tray, &part)?;
        settings.check(&tray, &part)?;
        let track = TrayPath::new(&tray, &part, &settings);
        let law = ContactLaw { restitution: settings.part_restitution, friction: settings.part_friction };
        Ok(Self {
            band: LoadingBand::new(tray, part.outline_radius_m(), &settings),
            landing: LandingZone::new(&settings),
            contacts: Contacts::new(law, part.width_min_m(), part.outline_radius_m()),
            scratch: Scratch::default(),
            rng: Pcg64Mcg::seed_from_u64(seed),
            parts: Vec::new(),
            next_id: 0,
            counters: Counters::default(),
            falling: 0,
            fastest_m_s: 0.0,
            hold_m_s2: None,
            judging_in_s: settings.stranding_time_s,
            shaken_s: 0.0,
            jammed: false,
            width_m: part.width_min_m(),
            tray,
            part,
            settings,
            track,
        })
    }

    /// Puts up to `count` parts at rest onto the tray: at random, clear of each other, on the ramp (and the plateau if
    /// so set) outside the loading radius, in resting poses drawn with their probabilities.
    pub fn load(&mut self, count: usize) -> Loaded {
        let mut loaded = 0;
        while loaded < count {
            let pose = random_pose(&self.part, &mut self.rng);
            let yaw_rad = random_yaw_rad(&mut self.rng);
            let mut part = Part::at_rest(Place::Ramp, pose, yaw_rad);
            if !self.band.place(&mut part, &self.parts, &self.track, &mut self.scratch, &mut self.rng) {
                break;
            }
            self.add(part);
            loaded += 1;
        }
        Loaded { loaded, refused: count - loaded }
    }

    /// Puts one part at rest onto the tray with its centre of mass at radius `radius_m` and angle ψ = `angle_rad`, heading
    /// `yaw_rad` in the tray frame, lying in the resting pose of index `pose`. Returns its identity.
    ///
    /// # Errors
    /// If the pose does not exist, or the place is not clear of the walls, the drop-off's face or another part.
    pub fn put(&mut self, radius_m: f64, angle_rad: f64, yaw_rad: f64, pose: usize) -> Result<u32, PutError> {
        let poses = self.part.poses.len();
        if pose >= poses {
            return Err(PutError::NoSuchPose { pose, poses });
        }
        let place = Place::from(self.tray.surface(angle_rad));
        let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
        let part = Part { x_m, y_m, ..Part::at_rest(place, pose, yaw_rad) };
        let clear = self.track.has_room(&part, &mut self.scratch)
            && is_free(&part, &self.parts, &self.track, &mut self.scratch);
        if clear && yaw_rad.is_finite() { Ok(self.add(part)) } else { Err(PutError::NoRoom { radius_m, angle_rad }) }
    }

    fn add(&mut self, mut part: Part) -> u32 {
        part.id = self.next_id;
        part.fed = part.place == Place::Plateau;
        part.judged_angle_rad = part.angle_rad();
        self.parts.push(part);
        self.next_id += 1;
        self.counters.loaded += 1;
        self.parts_changed();
        part.id
    }

    /// Moves all parts through a block of tray motion.
    ///
    /// # Errors
    /// If the block holds a value that is not finite or beyond what a tray can do. Nothing has moved then.
    pub fn step(&mut self, block: &MotionBlock) -> Result<(), OutOfRange> {
        motion_check::check(block)?;
        for sample in &block.samples {
            self.step_sample(sample, block.sample_period_s);
        }
        if self.hold_m_s2.is_none() {
            self.contacts.separate(&mut self.parts, &self.track);
            self.pass_edges();
        }
        Ok(())
    }

    /// Closes a gripper, and takes the part that comes to lie between its jaws off the tray.
    ///
    /// # Errors
    /// Nothing lies there, or a jaw comes down on what does. Nothing moves then.
    pub fn pick(&mut self, gripper: &OpenGripper) -> Result<PickedPart, Missed> {
        let index = gripper.taken(&self.parts, &self.part)?;
        let part = self.parts.remove(index);
        self.counters.picked += 1;
        self.parts_changed();
        Ok(PickedPart { id: part.id, pose: part.pose })
    }

    /// Takes a part off the tray, wherever it is. Returns whether there was one of this identity.
    pub fn remove(&mut self, id: u32) -> bool {
        let Some(index) = self.parts.iter().position(|part| part.id == id) else { return false };
        self.take_out(index);
        true
    }

    /// Takes a part off the tray and puts it down elsewhere, as [`put`](Self::put) does, under a new identity.
    ///
    /// # Errors
    /// As [`put`](Self::put); the part is where it was then.
    pub fn replace(
        &mut self,
        id: u32,
        radius_m: f64,
        angle_rad: f64,
        yaw_rad: f64,
        pose: usize,
    ) -> Result<u32, PutError> {
        let Some(index) = self.parts.iter().position(|part| part.id == id) else {
            return Err(PutError::NoSuchPart { id });
        };
        // Its own place is free for it.
        let part = self.parts.remove(index);
        let put = self.put(radius_m, angle_rad, yaw_rad, pose);
        self.parts.insert(index, part);
        if put.is_ok() {
            self.take_out(index);
        }
        put
    }

    fn take_out(&mut self, index: usize) {
        let part = self.parts.remove(index);
        self.falling -= usize::from(part.place == Place::Falling);
        self.counters.removed += 1;
        self.parts_changed();
    }

    /// All parts present, in order of identity.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Deepest overlap of two parts that are not above each other at the drop-off, m.
    #[must_use]
    pub fn overlap_m(&self) -> f64 {
        let mut scratch = Scratch::default();
        let mut deepest_m: f64 = 0.0;
        let on_surface = |part: &&Part| part.place != Place::Falling;
        for (index, one) in self.parts.iter().enumerate().filter(|(_, part)| part.place != Place::Falling) {
            for other in self.parts[index + 1..].iter().filter(on_surface) {
                if (one.angle_rad() - other.angle_rad()).abs() < std::f64::consts::PI {
                    let (a, b) = ((self.track.body(one), one), (self.track.body(other), other));
                    deepest_m = touch(a, b, &mut scratch).map_or(deepest_m, |touch| deepest_m.max(touch.depth_m));
                }
            }
        }
        deepest_m
    }

    /// The type of the parts.
    #[must_use]
    pub fn part_type(&self) -> &PartType {
        &self.part
    }

    /// The tray they are on.
    #[must_use]
    pub fn tray(&self) -> &TrayGeometry {
        &self.tray
    }

    /// What has happened so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Whether every part loaded is either present, exactly once and within the walls, or was taken off.
    #[must_use]
    pub fn is_conserved(&self) -> bool {
        let distinct = self.parts.windows(2).all(|pair| pair[0].id < pair[1].id);
        // The face of the drop-off may press a part against the outer wall by a rounding error's worth.
        let slack_m = 1e-3 * self.width_m;
        let on_surface = self.parts.iter().filter(|part| part.place != Place::Falling);
        let inside = on_surface.into_iter().all(|part| self.track.is_inside(part, slack_m));
        let Counters { loaded, picked, removed, .. } = self.counters;
        distinct && inside && loaded == picked + removed + self.parts.len() as u64
    }

    pub(super) fn parts_changed(&mut self) {
        self.contacts.invalidate();
        self.hold_m_s2 = None;
    }
}
