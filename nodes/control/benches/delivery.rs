//! How long a move, a trip and an area take to plan.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use feeder_control::courier::CourierLimits;
use feeder_control::delivery::tour::{Open, Overheads, best_tour};
use feeder_control::delivery::{
    CandidateFrame, DeliveryConfig, DeliveryId, DeliveryRequest, GentleParameters, MovePlanner, OfferedPart,
    Surroundings, ramp_parts,
};
use feeder_control::platen::{Arbiter, Area, Reservation};
use feeder_model::motor::Load;
use feeder_model::part::Refusals;
use feeder_model::tray::TrayGeometry;
use nalgebra::{Vector2, Vector3};

fn planner() -> MovePlanner {
    let limits = CourierLimits::default();
    MovePlanner::new(GentleParameters::default(), TrayGeometry::PAPER, limits, Load::default()).expect("valid")
}

fn moves(criterion: &mut Criterion) {
    let (from, to) = (Vector3::new(-0.3, 0.0, 0.0), Vector3::new(0.3, 0.1, 0.0));
    let selected = [Vector2::new(0.0, -0.07)];
    let all: Vec<_> = ramp_parts(&TrayGeometry::PAPER, 0.06).into_iter().chain([selected[0]; 10]).collect();
    let keep_out = vec![Area::disc(Vector2::new(0.0, 0.05), 0.05), Area::disc(Vector2::new(0.1, -0.3), 0.1)];
    let among = planner().among(Surroundings { keep_out, ..Surroundings::default() }).expect("valid");
    let straight = planner();
    let mut group = criterion.benchmark_group("plan");
    group.bench_function("straight, policy selected", |b| b.iter(|| straight.plan(black_box(from), to, &selected)));
    group.bench_function("straight, policy all (46 parts)", |b| b.iter(|| straight.plan(black_box(from), to, &all)));
    let turned = Vector3::new(to.x, to.y, 0.03);
    group.bench_function("straight with a turn", |b| b.iter(|| straight.plan(black_box(from), turned, &selected)));
    group.bench_function("round two posts", |b| b.iter(|| among.plan(black_box(from), to, &selected)));
}

fn trips(criterion: &mut Criterion) {
    // What is usual, and the most there can be: manipulators keep 20 requests open, and 60 parts fill the plateau.
    for (requests, parts) in [(4, 5), (20, 60)] {
        trip(criterion, requests, parts);
    }
}

fn trip(criterion: &mut Criterion, requests: u32, parts: u32) {
    let (config, planner) = (DeliveryConfig::default(), planner());
    let candidates = (0..parts).map(|index| {
        let (radius_m, angle_rad) = (0.04 + 0.01 * f64::from(index % 5), 4.0 + 0.15 * f64::from(index / 5));
        OfferedPart {
            id: index.into(),
            position_in_tray_m: Vector2::new(angle_rad.cos(), angle_rad.sin()) * radius_m,
            yaw_in_tray_rad: 0.0,
            part_class: "washer".into(),
            pose_class: Some("face_up".into()),
            radius_m: 0.0025,
            part_gap_m: 0.01,
            refusals: Refusals::default(),
        }
    });
    let frame = CandidateFrame { stamp: Duration::ZERO, candidates: candidates.collect(), is_blind: false };
    let request = DeliveryRequest {
        station: "station_1".into(),
        part_class: "washer".into(),
        pose_classes: vec!["face_up".into()],
        tolerance_m: 1e-3,
        part_gap_m_min: None,
        timeout: None,
    };
    let places = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)];
    let open: Vec<Open> = (1..=requests.into())
        .zip(places.into_iter().cycle())
        .map(|(id, (x, y))| Open { id: DeliveryId(id), request: &request, station_m: Vector2::new(x, y) })
        .collect();
    let overheads = Overheads { stop_s: 0.6, hand_over_s: 0.7 };
    criterion.bench_function(&format!("best trip of {requests} requests and {parts} parts"), |b| {
        b.iter(|| best_tour(black_box(&frame), &open, &config, &planner, &overheads));
    });
}

fn areas(criterion: &mut Criterion) {
    let mut arbiter = Arbiter::default();
    let reservation = |agent: String, x_m: f64, parked| Reservation {
        agent,
        area: Area { points_m: vec![Vector2::new(x_m, 0.0), Vector2::new(x_m, 0.5)], radius_m: 0.1 },
        parked,
        occupied: true,
        duration: Duration::from_secs(60),
        wait: Duration::from_secs(60),
    };
    for index in 0..20_u32 {
        arbiter.reserve(Duration::ZERO, index.into(), reservation(format!("agent_{index}"), f64::from(index), true));
    }
    arbiter.step(Duration::ZERO);
    criterion.bench_function("reserve and release an area among 20 leases", |b| {
        b.iter(|| {
            arbiter.reserve(Duration::ZERO, 99, reservation("agent".into(), -1.0, false));
            for (_, answer) in arbiter.step(Duration::ZERO) {
                arbiter.release("agent", answer.expect("free").lease).expect("held");
            }
        });
    });
}

criterion_group!(benches, moves, trips, areas);
criterion_main!(benches);
