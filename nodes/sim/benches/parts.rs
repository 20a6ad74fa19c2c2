//! Cost of a sample for a bulk of parts that feed, queue and circulate.

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use feeder_model::geometry::{Loop, ShapeSpec, Solid};
use feeder_model::motion::{MotionBlock, MotionSample};
use feeder_model::part::{PartSpec, PartType};
use feeder_model::tray::TrayGeometry;
use feeder_sim::parts::{BulkSettings, PartBulk};
use nalgebra::Vector3;

const SAMPLE_PERIOD_S: f64 = 5e-4;
const SAMPLES_PER_BLOCK: usize = 20;

/// A vibration of T = 0.1 s that climbs the paper's ramp at 24 mm/s, in blocks of 10 ms: (samples, yaw acceleration).
fn vibration() -> Vec<MotionBlock> {
    let mut velocity_rad_s = 0.0;
    let accelerations = [(139, 14.222), (38, -130.9), (23, 130.9)]
        .into_iter()
        .flat_map(|(count, acceleration)| std::iter::repeat_n(acceleration, count));
    let mut samples: Vec<_> = accelerations
        .map(|acceleration| {
            let sample = MotionSample {
                velocity: Vector3::new(0.0, 0.0, velocity_rad_s),
                acceleration: Vector3::new(0.001, 0.0, acceleration),
                ..MotionSample::default()
            };
            velocity_rad_s += acceleration * SAMPLE_PERIOD_S;
            sample
        })
        .collect();
    let mean = samples.iter().map(|sample| sample.velocity.z).sum::<f64>() / 200.0;
    samples.iter_mut().for_each(|sample| sample.velocity.z -= mean);
    let blocks = samples.chunks(SAMPLES_PER_BLOCK);
    blocks.map(|samples| MotionBlock { sample_period_s: SAMPLE_PERIOD_S, samples: samples.to_vec() }).collect()
}

fn disc(diameter_m: f64) -> PartType {
    let outline = Loop::Circle { radius_m: diameter_m / 2.0, centre_m: [0.0; 2] };
    let z_m = [0.0, 0.2 * diameter_m];
    PartType::new(&PartSpec {
        name: "disc".to_owned(),
        density_kg_m3: 8000.0,
        friction_static: 0.2,
        friction_kinetic: 0.2,
        friction_uncertainty_ratio: 0.1,
        reflectance: 0.5,
        shape: ShapeSpec::Solids(vec![Solid::Extruded { outline, holes: vec![], z_m, reflectance: None }]),
        poses: vec![],
        wanted_poses: vec!["pose_1".to_owned()],
        drops: None,
    })
    .expect("the part is sound")
}

/// A bulk that has run until its parts are where they go by themselves.
fn circulating(count: usize, diameter_m: f64, blocks: &[MotionBlock]) -> PartBulk {
    let settings = BulkSettings { load_plateau: true, loading_inner_radius_m: Some(0.075), ..BulkSettings::default() };
    let mut bulk = PartBulk::new(TrayGeometry::PAPER, disc(diameter_m), settings, 1).expect("the settings are sound");
    assert_eq!(bulk.load(count).loaded, count);
    for block in blocks.iter().cycle().take(2000) {
        bulk.step(block).expect("the motion is sound");
    }
    bulk
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("parts/step");
    let blocks = vibration();
    for (count, diameter_m) in [(10, 0.006), (100, 0.005), (1000, 0.002)] {
        let bulk = circulating(count, diameter_m, &blocks);
        group.throughput(Throughput::Elements((count * SAMPLES_PER_BLOCK * blocks.len()) as u64));
        group.bench_function(BenchmarkId::new("vibrating", count), |bencher| {
            bencher.iter_batched(
                || bulk.clone(),
                |mut bulk| {
                    for block in &blocks {
                        bulk.step(block).expect("the motion is sound");
                    }
                    bulk
                },
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, step);
criterion_main!(benches);
