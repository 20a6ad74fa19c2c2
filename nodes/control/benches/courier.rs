//! What a servo tick, a plan and a check cost.
#![expect(clippy::unwrap_used, reason = "what fails to set up fails the bench")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use feeder_control::courier::{CourierConfig, CourierLimits, LearningParameters};
use feeder_control::delivery::{GentleParameters, MovePlanner, ramp_parts};
use feeder_model::motor::Load;
use feeder_model::tray::TrayGeometry;
use feeder_model::waveform::{Axis, Waveform};
use feeder_scenario::{SimulatedCourier, assumed_motor};
use feeder_sim::motor::MotorParameters;
use nalgebra::Vector3;

fn servo(criterion: &mut Criterion) {
    let waveform = Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 17.66, 130.9).unwrap();
    let (ideal, assumed) = (MotorParameters::IDEAL, assumed_motor());
    for (name, motor, enabled) in [("ideal", ideal, false), ("assumed", assumed, false), ("learned", assumed, true)] {
        let learning = LearningParameters { enabled, ..LearningParameters::default() };
        let config = CourierConfig { learning, ..CourierConfig::default() };
        let mut driver = SimulatedCourier { config, motor }.driver(1).unwrap();
        driver.set_waveform(&waveform, true).unwrap();
        criterion.bench_function(&format!("20 servo ticks, {name} motor"), |bencher| {
            bencher.iter(|| {
                black_box(driver.step(20));
                driver.motor_mut().take_block()
            });
        });
    }
}

fn planning(criterion: &mut Criterion) {
    let tray = TrayGeometry::PAPER;
    let planner =
        MovePlanner::new(GentleParameters::default(), tray, CourierLimits::default(), Load::default()).unwrap();
    let (from, to) = (Vector3::zeros(), Vector3::new(0.3, 0.1, 0.0));
    criterion.bench_function("plan a move, one part", |bencher| {
        bencher.iter(|| planner.plan(black_box(from), black_box(to), &[]).unwrap());
    });
    let parts = ramp_parts(&tray, 0.06);
    criterion.bench_function("plan a move, parts all over the ramp", |bencher| {
        bencher.iter(|| planner.plan(black_box(from), black_box(to), &parts).unwrap());
    });
    let trajectory = planner.plan(from, to, &[]).unwrap().trajectory();
    criterion.bench_function("check and accept a trajectory of 0.8 s", |bencher| {
        bencher.iter_batched(
            || SimulatedCourier::default().driver(1).unwrap(),
            |mut driver| driver.execute(1, &trajectory).unwrap(),
            criterion::BatchSize::SmallInput,
        );
    });
}

criterion_group!(benches, servo, planning);
criterion_main!(benches);
