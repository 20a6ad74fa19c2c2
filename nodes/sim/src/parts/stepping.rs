//! How the parts of a bulk get on during a sample: sliding, passing the edges of the surfaces, falling and landing.

use super::placement::{random_pose_after_fall, random_yaw_rad};
use super::track::Passage;
use super::{Part, PartBulk, Place};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::tray_forces::TrayDrive;
use feeder_model::motion::MotionSample;

/// Share of its least width that a part may move in one step; samples are split to keep to it.
const STEP_SHARE: f64 = 0.1;

/// Into how many steps a sample may be split. Only motion beyond any courier asks for more.
const MOST_STEPS: f64 = 64.0;

/// A falling part that found no room to land looks again after this time, s.
const LANDING_RETRY_S: f64 = 0.01;

/// A part is blocked that climbs by less than this share of its least width between two looks.
const BLOCKED_SHARE: f64 = 0.02;

/// This many blocked parts are a jam.
const JAM_PARTS: usize = 3;

impl PartBulk {
    pub(super) fn step_sample(&mut self, sample: &MotionSample, period_s: f64) {
        let whole = TrayDrive::new(sample, 0.0, period_s, 0.0);
        let acceleration_m_s2 = self.track.shaking_m_s2(&whole);
        if self.hold_m_s2.is_none_or(|hold_m_s2| acceleration_m_s2 > hold_m_s2) {
            self.shaken_s += period_s;
            let travel_m = (self.fastest_m_s + acceleration_m_s2 * period_s) * period_s;
            let steps = (travel_m / (STEP_SHARE * self.width_m)).ceil().clamp(1.0, MOST_STEPS);
            let step_s = period_s / steps;
            self.advance(&TrayDrive::new(sample, 0.0, step_s, 0.0), step_s);
            let mut done = 1.0;
            while done < steps {
                self.advance(&TrayDrive::new(sample, done * step_s, step_s, 0.0), step_s);
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

    fn advance(&mut self, drive: &TrayDrive, step_s: f64) {
        let mut farthest_m2: f64 = 0.0;
        let mut moving = false;
        for part in &mut self.parts {
            let Some(travel_m2) = self.track.advance(part, drive, step_s, &mut self.scratch) else {
                continue;
            };
            farthest_m2 = farthest_m2.max(travel_m2);
            moving = true;
        }
        let farthest_m = farthest_m2.sqrt();
        let touched = self.contacts.resolve(&mut self.parts, &self.track, farthest_m);
        self.fastest_m_s = farthest_m / step_s;
        if moving || touched {
            self.hold_m_s2 = None;
            self.pass_edges();
        } else if self.hold_m_s2.is_none() {
            self.hold_m_s2 = Some(self.track.hold_m_s2(&self.parts));
        }
    }

    pub(super) fn pass_edges(&mut self) {
        for part in &mut self.parts {
            match self.track.passage(part) {
                None => {}
                Some(Passage::RampToPlateau) => {
                    part.place = Place::Plateau;
                    (part.blocked, part.stranded) = (false, false);
                    self.counters.fed += u64::from(!part.fed);
                    part.fed = true;
                }
                Some(Passage::PlateauToRamp) => part.place = Place::Ramp,
                Some(Passage::OffThePlateau) => {
                    part.place = Place::Falling;
                    part.velocity_x_m_s = 0.0;
                    part.velocity_y_m_s = 0.0;
                    part.yaw_rate_rad_s = 0.0;
                    (part.blocked, part.stranded) = (false, false);
                    part.pose = random_pose_after_fall(&self.part, part.pose, &mut self.rng);
                    part.landing_in_s =
                        (2.0 * self.tray.rise_m / STANDARD_GRAVITY_M_S2).sqrt() + self.settings.settling_time_s;
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
            let mut part = Part { yaw_rad: random_yaw_rad(&mut self.rng), ..self.parts[index] };
            if !self.landing.place(&mut part, &self.parts, &self.track, &mut self.scratch, &mut self.rng) {
                self.parts[index].waited_s += LANDING_RETRY_S;
                self.parts[index].landing_in_s = LANDING_RETRY_S;
                continue;
            }
            part.fed = false;
            part.waited_s = 0.0;
            part.judged_angle_rad = part.angle_rad();
            self.parts[index] = part;
            self.falling -= 1;
            self.parts_changed();
        }
    }

    /// Looks at who has climbed since the last time.
    fn judge_climbing(&mut self) {
        let shaken = self.shaken_s > 0.5 * self.settings.stranding_time_s;
        let critical_m = self.settings.critical_radius_m.unwrap_or(0.0);
        let progress_m = BLOCKED_SHARE * self.width_m;
        let mut held_up = 0;
        let mut foot_full = false;
        for part in &mut self.parts {
            let angle_rad = part.angle_rad();
            let climbed_rad = angle_rad - part.judged_angle_rad;
            let inside = part.radius_m() < critical_m;
            let on_ramp = part.place == Place::Ramp;
            part.stranded = on_ramp && inside && climbed_rad <= 0.0;
            part.blocked = on_ramp && !inside && shaken && climbed_rad * part.radius_m() < progress_m;
            part.judged_angle_rad = angle_rad;
            held_up += usize::from(part.blocked);
            foot_full |= part.waited_s >= self.settings.stranding_time_s;
        }
        let jammed = held_up >= JAM_PARTS || foot_full;
        self.counters.jams += u64::from(jammed && !self.jammed);
        self.jammed = jammed;
        self.shaken_s = 0.0;
    }
}
