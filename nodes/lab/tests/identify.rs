//! Friction found in noisy recordings of the rig.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the test")]

use feeder_lab::experiment::rig::Rig;
use feeder_lab::identify::{IdentifyError, VelocitySample, kinetic_friction};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2;
use feeder_model::mechanics::Friction;
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, assumed_motor};

fn rig(waveform: Waveform, mu: f64) -> Rig {
    Rig {
        courier: SimulatedCourier { motor: assumed_motor(), ..SimulatedCourier::default() },
        waveform,
        friction: Friction::uniform(mu).unwrap(),
        velocity_noise_m_s: 0.5e-3,
    }
}

#[test]
fn verif_friction_is_found_within_a_percent_whatever_the_waveform() {
    let stick_slip = Waveform::stick_slip(Axis::X, 0.05, 1.6, 10.1).unwrap();
    let pump = Waveform::coulomb_pump(Axis::X, 0.05, 10.3, 0.37).unwrap();
    for (waveform, mu) in [(&stick_slip, 0.2), (&stick_slip, 0.3), (&pump, 0.2), (&pump, 0.1)] {
        for seed in 0..4 {
            let recording = rig(waveform.clone(), mu).run(4.0, seed).unwrap();
            let found = kinetic_friction(&recording.samples, STANDARD_GRAVITY_M_S2).unwrap();
            assert!((found.kinetic / mu - 1.0).abs() < 0.01, "{mu} {found:?}");
            // Four standard errors, and what partly stuck samples add.
            assert!((found.kinetic - mu).abs() < 4.0 * found.standard_error + 1e-3 * mu, "{mu} {found:?}");
            assert!((found.noise_m_s / 0.5e-3 - 1.0).abs() < 0.2, "{found:?}");
        }
    }
}

#[test]
fn the_kinetic_friction_is_found_where_the_static_one_is_larger() {
    let waveform = Waveform::stick_slip(Axis::X, 0.05, 1.6, 10.1).unwrap();
    let rig = Rig { friction: Friction::new(0.25, 0.2).unwrap(), ..rig(waveform, 0.2) };
    let found = kinetic_friction(&rig.run(4.0, 1).unwrap().samples, STANDARD_GRAVITY_M_S2).unwrap();
    assert!((found.kinetic / 0.2 - 1.0).abs() < 0.01, "{found:?}");
}

#[test]
fn a_recording_without_slip_or_without_sense_is_refused() {
    let gentle = Waveform::stick_slip(Axis::X, 0.05, 0.8, 1.5).unwrap();
    let sticking = rig(gentle, 0.2).run(2.0, 1).unwrap().samples;
    assert!(matches!(kinetic_friction(&sticking, 9.81), Err(IdentifyError::NoSlip { .. })));
    assert!(matches!(kinetic_friction(&[], 9.81), Err(IdentifyError::NoSlip { samples: 0, .. })));
    let sample = |time_s| VelocitySample { time_s, tray_m_s: 0.0, part_m_s: 0.0 };
    let unsorted = [sample(0.0), sample(0.0)];
    assert_eq!(kinetic_friction(&unsorted, 9.81), Err(IdentifyError::Unsorted { index: 1, time_s: 0.0 }));
    let nan = [sample(0.0), VelocitySample { part_m_s: f64::NAN, ..sample(1.0) }];
    assert!(kinetic_friction(&nan, 9.81).unwrap_err().to_string().contains("part_m_s"));
    assert!(kinetic_friction(&sticking, 0.0).is_err());
}
