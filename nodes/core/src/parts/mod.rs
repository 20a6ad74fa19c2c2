//! Parts in bulk on the annular tray, moved by the tray's motion at servo rate.
//!
//! A part is a point mass under Coulomb friction (Quaid Eqs 18–29, corrected, with the courier's
//! translation) and a disc where it meets walls and other parts. All parts of a bulk are of one type. They climb the ramp,
//! cross the plateau, fall off its end and land at the foot of the ramp, lying in a pose drawn from the
//! part's transition matrix.
//!
//! Each servo sample holds the tray's acceleration constant; within it, friction is solved with its switch from
//! sliding to sticking and no threshold of speed. Assumed: a part keeps its heading relative to the tray while it slides; parts on the ramp
//! touch each other as seen from above; a part does not tip at the edges. Not modelled: a part that the tray leaves
//! behind, where the acceleration exceeds g/tan φ down the slope (its normal force is taken as zero).
//!
//! The same seed, calls and motion give bit-identical results.

mod contact;
mod friction;
mod motion_check;
mod part;
mod part_type;
mod placement;
mod settings;
mod track;

#[cfg(test)]
mod tests;

use nalgebra::Vector2;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use thiserror::Error;

pub use motion_check::{
    LARGEST_ACCELERATION_M_S2, LARGEST_YAW_ACCELERATION_RAD_S2, LARGEST_YAW_RATE_RAD_S,
    LONGEST_SAMPLE_PERIOD_S, MotionError,
};
pub use part::{Part, PickedPart, Place};
pub use part_type::{PartSpec, PartType, PartTypeError, RestingPose};
pub use settings::{BulkError, BulkSettings};

use crate::gravity::STANDARD_GRAVITY_M_S2;
use crate::motion::{MotionBlock, MotionSample};
use crate::tray::{Surface, TrayGeometry};
use contact::{ContactLaw, Contacts};
use placement::{LandingZone, LoadingBand, random_pose, random_pose_after_fall, random_yaw_rad};
use track::{Drive, Passage, Track};

/// Share of its diameter that a part may move in one step; samples are split to keep to it.
const STEP_SHARE: f64 = 0.1;

/// Into how many steps a sample may be split.
const MOST_STEPS: f64 = 64.0;

/// A part that has moved by more than this share of its diameter in one step is slowed down to it: motion this violent
/// is beyond any courier, but must not throw parts through each other.
const CUT_SHARE: f64 = 0.5;

/// A falling part that found no room to land looks again after this time, s.
const LANDING_RETRY_S: f64 = 0.01;

/// What has happened to the parts since the bulk was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Parts put onto the tray.
    pub loaded: u64,
    /// Parts taken off the tray.
    pub picked: u64,
    /// Entries to the plateau from the ramp, once per part and lap however often it crosses the line.
    pub fed: u64,
    /// Parts that fell off the end of the plateau.
    pub recirculated: u64,
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
    tray: TrayGeometry,
    part: PartType,
    settings: BulkSettings,
    track: Track,
    band: LoadingBand,
    landing: LandingZone,
    contacts: Contacts,
    rng: Pcg64Mcg,
    /// In order of identity.
    parts: Vec<Part>,
    next_id: u32,
    counters: Counters,
    /// How many parts are falling.
    falling: usize,
    /// Mean speed of the fastest part over the last step, m/s.
    fastest_m_s: f64,
    /// If all parts stick: the tray's acceleration up to which they certainly stay, m/s².
    hold_m_s2: Option<f64>,
    judging_in_s: f64,
}

impl PartBulk {
    /// An empty tray. `seed` decides where parts are loaded, how they lie, and how they land.
    ///
    /// # Errors
    /// If the tray's geometry, the part's size or a setting is out of range.
    pub fn new(
        tray: TrayGeometry,
        part: PartType,
        settings: BulkSettings,
        seed: u64,
    ) -> Result<Self, BulkError> {
        settings::check_tray(&tray, &part)?;
        settings.check(&tray, &part)?;
        let track = Track::new(&tray, &part, &settings);
        let law = ContactLaw {
            restitution: settings.part_restitution,
            friction: settings.part_friction,
        };
        Ok(Self {
            band: LoadingBand::new(tray, &track, &settings),
            landing: LandingZone::new(&settings),
            contacts: Contacts::new(law, part.diameter_m),
            rng: Pcg64Mcg::seed_from_u64(seed),
            parts: Vec::new(),
            next_id: 0,
            counters: Counters::default(),
            falling: 0,
            fastest_m_s: 0.0,
            hold_m_s2: None,
            judging_in_s: settings.stranding_time_s,
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
            let free = self
                .band
                .find_place(&self.parts, self.part.diameter_m, &mut self.rng);
            let Some((place, x_m, y_m)) = free else {
                break;
            };
            let pose = random_pose(&self.part, &mut self.rng);
            let yaw_rad = random_yaw_rad(&mut self.rng);
            self.add(place, x_m, y_m, yaw_rad, pose);
            loaded += 1;
        }
        Loaded {
            loaded,
            refused: count - loaded,
        }
    }

    /// Puts one part at rest onto the tray with its centre at radius `radius_m` and angle ψ = `angle_rad`, heading
    /// `yaw_rad` in the tray frame, lying in the resting pose of index `pose`. Returns its identity.
    ///
    /// # Errors
    /// If the pose does not exist, or the place is not clear of the walls, the drop-off's face or another part.
    pub fn put(
        &mut self,
        radius_m: f64,
        angle_rad: f64,
        yaw_rad: f64,
        pose: usize,
    ) -> Result<u32, PutError> {
        let poses = self.part.resting_poses.len();
        if pose >= poses {
            return Err(PutError::NoSuchPose { pose, poses });
        }
        let place = match self.tray.surface(angle_rad) {
            Surface::Ramp => Place::Ramp,
            Surface::Plateau => Place::Plateau,
        };
        let (x_m, y_m) = (radius_m * angle_rad.cos(), radius_m * angle_rad.sin());
        let clear = self.track.has_room(place, x_m, y_m)
            && placement::is_free(&self.parts, x_m, y_m, self.part.diameter_m);
        if clear && yaw_rad.is_finite() {
            Ok(self.add(place, x_m, y_m, yaw_rad, pose))
        } else {
            Err(PutError::NoRoom {
                radius_m,
                angle_rad,
            })
        }
    }

    fn add(&mut self, place: Place, x_m: f64, y_m: f64, yaw_rad: f64, pose: usize) -> u32 {
        let mut part = Part {
            id: self.next_id,
            place,
            pose,
            x_m,
            y_m,
            yaw_rad,
            velocity_x_m_s: 0.0,
            velocity_y_m_s: 0.0,
            stranded: false,
            fed: place == Place::Plateau,
            landing_in_s: 0.0,
            judged_angle_rad: 0.0,
        };
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
    pub fn step(&mut self, block: &MotionBlock) -> Result<(), MotionError> {
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

    /// Takes the part whose centre is nearest to (`x_m`, `y_m`) in the tray frame, if it is within `reach_m`. Falling
    /// parts are out of reach.
    pub fn pick(&mut self, x_m: f64, y_m: f64, reach_m: f64) -> Option<PickedPart> {
        let reachable = self.parts.iter().enumerate().filter(|(_, part)| {
            part.place != Place::Falling && part.squared_distance_m2(x_m, y_m) <= reach_m * reach_m
        });
        let (index, _) = reachable.min_by(|(_, a), (_, b)| {
            let distance = |part: &Part| part.squared_distance_m2(x_m, y_m);
            distance(a).total_cmp(&distance(b))
        })?;
        let part = self.parts.remove(index);
        self.counters.picked += 1;
        self.parts_changed();
        Some(PickedPart {
            id: part.id,
            pose: part.pose,
            offset_m: part.position_m() - Vector2::new(x_m, y_m),
            yaw_rad: part.yaw_rad,
        })
    }

    /// All parts present, in order of identity.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
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

    /// Whether every part loaded is either present, exactly once and within the walls, or was picked.
    #[must_use]
    pub fn is_conserved(&self) -> bool {
        let distinct = self.parts.windows(2).all(|pair| pair[0].id < pair[1].id);
        // The face of the drop-off may press a part against the outer wall by a rounding error's worth.
        let slack_m = 1e-3 * self.part.diameter_m;
        let inside = self.parts.iter().all(|part| {
            (self.track.innermost_m - slack_m..=self.track.outermost_m + slack_m)
                .contains(&part.radius_m())
        });
        distinct && inside && self.counters.loaded == self.counters.picked + self.parts.len() as u64
    }

    fn parts_changed(&mut self) {
        self.contacts.invalidate();
        self.hold_m_s2 = None;
    }

    fn step_sample(&mut self, sample: &MotionSample, period_s: f64) {
        let whole = Drive::new(sample, 0.0, period_s);
        let acceleration_m_s2 = whole.bound_m_s2(self.track.outermost_m);
        if self
            .hold_m_s2
            .is_none_or(|hold_m_s2| acceleration_m_s2 > hold_m_s2)
        {
            let travel_m = (self.fastest_m_s + acceleration_m_s2 * period_s) * period_s;
            let steps = (travel_m / (STEP_SHARE * self.part.diameter_m))
                .ceil()
                .clamp(1.0, MOST_STEPS);
            let step_s = period_s / steps;
            self.advance(&Drive::new(sample, 0.0, step_s), step_s);
            let mut done = 1.0;
            while done < steps {
                self.advance(&Drive::new(sample, done * step_s, step_s), step_s);
                done += 1.0;
            }
        }
        if self.falling > 0 {
            self.fall(period_s);
        }
        self.judging_in_s -= period_s;
        if self.judging_in_s <= 0.0 {
            self.judging_in_s += self.settings.stranding_time_s;
            self.judge_climbing();
        }
    }

    fn advance(&mut self, drive: &Drive, step_s: f64) {
        let cut_m = CUT_SHARE * self.part.diameter_m;
        let mut farthest_m2: f64 = 0.0;
        let mut moving = false;
        for part in &mut self.parts {
            let Some(travel_m2) = self.track.advance(part, drive, step_s) else {
                continue;
            };
            if travel_m2 > cut_m * cut_m {
                let kept = cut_m / travel_m2.sqrt();
                part.velocity_x_m_s *= kept;
                part.velocity_y_m_s *= kept;
            }
            farthest_m2 = farthest_m2.max(travel_m2);
            moving = true;
        }
        let farthest_m = farthest_m2.sqrt();
        let touched = self
            .contacts
            .resolve(&mut self.parts, &self.track, farthest_m);
        self.fastest_m_s = farthest_m / step_s;
        if moving || touched {
            self.hold_m_s2 = None;
            self.pass_edges();
        } else if self.hold_m_s2.is_none() {
            self.hold_m_s2 = Some(self.track.hold_m_s2(&self.parts));
        }
    }

    fn pass_edges(&mut self) {
        for part in &mut self.parts {
            match self.track.passage(part) {
                None => {}
                Some(Passage::RampToPlateau) => {
                    part.place = Place::Plateau;
                    part.stranded = false;
                    self.counters.fed += u64::from(!part.fed);
                    part.fed = true;
                }
                Some(Passage::PlateauToRamp) => part.place = Place::Ramp,
                Some(Passage::OffThePlateau) => {
                    part.place = Place::Falling;
                    part.velocity_x_m_s = 0.0;
                    part.velocity_y_m_s = 0.0;
                    part.pose = random_pose_after_fall(&self.part, part.pose, &mut self.rng);
                    part.landing_in_s = (2.0 * self.tray.rise_m / STANDARD_GRAVITY_M_S2).sqrt()
                        + self.settings.settling_time_s;
                    self.falling += 1;
                    self.counters.recirculated += 1;
                    self.contacts.invalidate();
                }
            }
        }
    }

    fn fall(&mut self, period_s: f64) {
        for index in 0..self.parts.len() {
            if self.parts[index].place != Place::Falling {
                continue;
            }
            self.parts[index].landing_in_s -= period_s;
            if self.parts[index].landing_in_s > 0.0 {
                continue;
            }
            let left_at_m = self.parts[index].radius_m();
            let free = self
                .landing
                .find_place(&self.parts, left_at_m, &self.track, &mut self.rng);
            let part = &mut self.parts[index];
            let Some((x_m, y_m)) = free else {
                part.landing_in_s = LANDING_RETRY_S;
                continue;
            };
            part.place = Place::Ramp;
            part.x_m = x_m;
            part.y_m = y_m;
            part.yaw_rad = random_yaw_rad(&mut self.rng);
            part.fed = false;
            part.judged_angle_rad = part.angle_rad();
            self.falling -= 1;
            self.parts_changed();
        }
    }

    fn judge_climbing(&mut self) {
        for part in &mut self.parts {
            let angle_rad = part.angle_rad();
            part.stranded = part.place == Place::Ramp
                && part.radius_m() < self.settings.critical_radius_m
                && angle_rad <= part.judged_angle_rad;
            part.judged_angle_rad = angle_rad;
        }
    }
}
