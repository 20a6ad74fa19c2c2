//! How many seconds of a part's motion are computed in a second of wall time.
//!
//! Throughput is in elements per second, one element being one millisecond of one part: "Gelem/s" × 10⁶ is part-seconds
//! per wall-second. The case is Fig. 15's waveform on the paper's ramp at r = 85 mm, period 1/30 s.
#![expect(clippy::disallowed_methods, reason = "a benchmark is no part of core")]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use feeder_model::gravity::STANDARD_GRAVITY_M_S2 as G;
use feeder_model::mechanics::Friction;
use feeder_model::mechanics::annular::{AnnularTrack, PartState};
use feeder_model::mechanics::map::TrayMap;
use feeder_model::motion::MotionSample;
use feeder_model::tray::{Surface, TrayGeometry};
use feeder_model::waveform::{Axis, Waveform};
use nalgebra::Vector3;

const SAMPLE_S: f64 = 5e-4;
/// Three periods of 1/30 s are 200 samples: 0.1 s.
const BLOCK_MS: u64 = 100;

fn fig15() -> Waveform {
    let m = 0.2 * G;
    Waveform::stick_slip(Axis::Yaw, 1.0 / 30.0, 9.0 * m, 66.7 * m).expect("a valid waveform")
}

fn paper_track() -> AnnularTrack {
    let friction = Friction::uniform(0.2).expect("a valid friction");
    AnnularTrack::new(TrayGeometry::PAPER, friction, G).expect("a valid tray")
}

/// Three periods as a perfect servo samples them; with `centre_m_s2`, the tray's centre accelerates too.
fn block(waveform: &Waveform, centre_m_s2: f64) -> Vec<MotionSample> {
    let mut samples = Vec::new();
    for i in 0..200 {
        let time_s = f64::from(i) * SAMPLE_S;
        let state = waveform.state_at(time_s);
        samples.push(MotionSample {
            position: Vector3::new(0.0, 0.0, state.position),
            velocity: Vector3::new(0.0, 0.0, state.velocity),
            acceleration: Vector3::new(centre_m_s2, 0.0, waveform.mean_acceleration(time_s, SAMPLE_S)),
        });
    }
    samples
}

fn parts(count: u16) -> Vec<PartState> {
    (0..count).map(|i| PartState::at_rest(0.06 + 2.5e-5 * f64::from(i), 0.006 * f64::from(i))).collect()
}

fn step_all(track: &AnnularTrack, parts: &mut [PartState], block: &[MotionSample]) {
    for sample in block {
        for part in &mut *parts {
            track.step(part, sample, SAMPLE_S);
        }
    }
}

fn exact(criterion: &mut Criterion) {
    let (track, waveform) = (paper_track(), fig15());
    let map = TrayMap::new(&track, &waveform).expect("a yaw waveform");
    let drive = map.drive(0.085, Surface::Ramp).expect("in contact");
    let mut group = criterion.benchmark_group("exact");
    // 300 periods are 10 s.
    group.throughput(Throughput::Elements(10_000));
    group.bench_function("10 s of one part", |bencher| {
        bencher.iter(|| {
            let (mut w, mut distance_m) = (0.0, 0.0);
            for _ in 0..300 {
                w = drive.run(w, |phase| distance_m += phase.distance_m());
            }
            black_box((w, distance_m))
        });
    });
    group.finish();
    criterion.bench_function("exact/steady motion from scratch", |bencher| {
        bencher.iter(|| {
            let map = TrayMap::new(&track, black_box(&waveform)).expect("a yaw waveform");
            map.drive(0.085, Surface::Ramp).expect("in contact").steady()
        });
    });
}

fn sampled(criterion: &mut Criterion) {
    let track = paper_track();
    let mut group = criterion.benchmark_group("sampled at 2 kHz");
    for (name, centre_m_s2) in [("vibration", 0.0), ("vibration and translation", 0.5)] {
        let block = block(&fig15(), centre_m_s2);
        for count in [1, 10, 100, 1000] {
            group.throughput(Throughput::Elements(BLOCK_MS * u64::from(count)));
            let mut parts = parts(count);
            group.bench_function(BenchmarkId::new(name, count), |bencher| {
                bencher.iter(|| step_all(&track, &mut parts, &block));
            });
        }
    }
    let block = block(&fig15(), 0.0);
    group.throughput(Throughput::Elements(BLOCK_MS * 1000));
    let mut parts = parts(1000);
    group.bench_function("vibration, two threads/1000", |bencher| {
        bencher.iter(|| {
            std::thread::scope(|scope| {
                for half in parts.chunks_mut(500) {
                    scope.spawn(|| step_all(&track, half, &block));
                }
            });
        });
    });
    group.finish();
}

criterion_group!(benches, exact, sampled);
criterion_main!(benches);
