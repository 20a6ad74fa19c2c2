//! Tray motion and parts for the tests.

use feeder_model::geometry::{Loop, ShapeSpec, Solid};
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::part::{PartSpec, PartType, PoseName};
use feeder_model::tray::TrayGeometry;
use feeder_scenario::PartSource;
use feeder_sim::parts::{BulkSettings, PartBulk};
use nalgebra::Vector3;

pub(crate) const G: f64 = 9.81;

/// A periodic acceleration about the yaw axis, sampled as a perfect courier would show it.
#[derive(Clone, Debug)]
pub(crate) struct YawVibration {
    /// (duration s, acceleration rad/s²)
    segments: Vec<(f64, f64)>,
    start_rad_s: f64,
}

impl YawVibration {
    pub(crate) fn new(segments: &[(f64, f64)]) -> Self {
        let mut vibration = Self { segments: segments.to_vec(), start_rad_s: 0.0 };
        let (_, turned_rad) = vibration.within_period(vibration.period_s());
        vibration.start_rad_s = -turned_rad / vibration.period_s();
        vibration
    }

    /// Stick-slip, Quaid Eqs 1–3.
    pub(crate) fn stick_slip(period_s: f64, least_rad_s2: f64, most_rad_s2: f64) -> Self {
        let first_s = most_rad_s2 * period_s / (2.0 * (least_rad_s2 + most_rad_s2));
        Self::new(&[(first_s, least_rad_s2), (period_s - 2.0 * first_s, -most_rad_s2), (first_s, least_rad_s2)])
    }

    /// The paper's waveform for Fig. 15, 9.0 m and 66.7 m rad/s² with m = μ g as a number, μ = 0.2.
    pub(crate) fn paper() -> Self {
        Self::stick_slip(1.0 / 30.0, 9.0 * 0.2 * G, 66.7 * 0.2 * G)
    }

    /// The optimal waveform for a slope, at radius `radius_m`, with |a| up to 66.7 μ g radius.
    pub(crate) fn optimal(period_s: f64, radius_m: f64, slope_rad: f64, friction: f64) -> Self {
        let friction_rad = friction.atan();
        let stick = G * (friction_rad - slope_rad).tan();
        let slip = G * (friction_rad + slope_rad).tan();
        let most = 66.7 * friction * G * radius_m;
        let burst_s = period_s * stick / (stick + slip);
        Self::new(&[
            (period_s - burst_s, stick / radius_m),
            (burst_s * (most + slip) / (2.0 * most), -most / radius_m),
            (burst_s * (most - slip) / (2.0 * most), most / radius_m),
        ])
    }

    pub(crate) fn period_s(&self) -> f64 {
        self.segments.iter().map(|segment| segment.0).sum()
    }

    pub(crate) fn mirrored(&self) -> Self {
        let turned: Vec<_> = self.segments.iter().map(|&(time, a)| (time, -a)).collect();
        Self::new(&turned)
    }

    /// Velocity and angle at `time_s` into a period.
    fn within_period(&self, time_s: f64) -> (f64, f64) {
        let (mut velocity, mut angle, mut left) = (self.start_rad_s, 0.0, time_s);
        for &(duration, acceleration) in &self.segments {
            let step = left.min(duration);
            angle += (velocity + 0.5 * acceleration * step) * step;
            velocity += acceleration * step;
            left -= step;
        }
        (velocity, angle)
    }

    /// Samples from `first` on, with the acceleration averaged over each.
    pub(crate) fn block(&self, first: u32, count: u32, sample_period_s: f64) -> MotionBlock {
        let at = |index: u32| {
            let phase_s = (f64::from(index) * sample_period_s).rem_euclid(self.period_s());
            self.within_period(phase_s)
        };
        let samples = (first..first + count)
            .map(|index| {
                let ((velocity, angle), (next, _)) = (at(index), at(index + 1));
                MotionSample {
                    position: Vector3::new(0.0, 0.0, angle),
                    velocity: Vector3::new(0.0, 0.0, velocity),
                    acceleration: Vector3::new(0.0, 0.0, (next - velocity) / sample_period_s),
                }
            })
            .collect();
        MotionBlock { sample_period_s, samples }
    }
}

/// Samples of constant acceleration of the tray along the platen, standing at `yaw_rad`, from rest.
pub(crate) fn straight(x_m_s2: f64, y_m_s2: f64, yaw_rad: f64, count: u32) -> MotionBlock {
    let sample_period_s = 5e-4;
    let acceleration = Vector3::new(x_m_s2, y_m_s2, 0.0);
    let samples = (0..count).map(|index| {
        let time_s = f64::from(index) * sample_period_s;
        MotionSample {
            position: Vector3::new(0.0, 0.0, yaw_rad) + 0.5 * acceleration * time_s * time_s,
            velocity: acceleration * time_s,
            acceleration,
        }
    });
    MotionBlock { sample_period_s, samples: samples.collect() }
}

/// A disc with a bright and a dark face.
pub(crate) fn spec(diameter_m: f64, friction: f64) -> PartSpec {
    let outline = || Loop::Circle { radius_m: diameter_m / 2.0, centre_m: [0.0; 2] };
    let layer = |z_m, share| Solid::Extruded { outline: outline(), holes: vec![], z_m, reflectance: Some(share) };
    PartSpec {
        name: "disc".to_owned(),
        density_kg_m3: 8000.0,
        friction_static: friction,
        friction_kinetic: friction,
        friction_uncertainty_ratio: 0.1,
        reflectance: 0.5,
        shape: ShapeSpec::Solids(vec![
            layer([0.0, 0.1 * diameter_m], 0.2),
            layer([0.1 * diameter_m, 0.2 * diameter_m], 0.8),
        ]),
        poses: vec![PoseName { name: "up".to_owned(), up: [0.0, 0.0, 1.0] }],
        wanted_poses: vec!["up".to_owned()],
        drops: None,
    }
}

/// As the paper's tray wants it: clear of the critical radius of its waveform.
pub(crate) fn settings() -> BulkSettings {
    BulkSettings { loading_inner_radius_m: Some(0.075), critical_radius_m: Some(0.0576), ..BulkSettings::default() }
}

pub(crate) fn part(name: &str) -> PartType {
    PartSource::Name(name.to_owned()).part_type().expect("a part of the catalogue")
}

pub(crate) fn bulk_of(spec: &PartSpec, settings: BulkSettings, seed: u64) -> PartBulk {
    let part = PartType::new(spec).expect("a sound part");
    PartBulk::new(TrayGeometry::PAPER, part, settings, seed).expect("sound settings")
}

pub(crate) fn bulk(diameter_m: f64, seed: u64) -> PartBulk {
    bulk_of(&spec(diameter_m, 0.2), settings(), seed)
}
