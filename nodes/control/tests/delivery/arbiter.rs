//! The platen's arbiter: order, ends, and freedom from collisions and deadlock whatever agents do.

use std::collections::BTreeMap;
use std::time::Duration;

use feeder_control::platen::{Answer, Arbiter, Area, Granted, LeaseId, Refusal, Reservation};
use nalgebra::Vector2;
use proptest::prelude::*;

fn seconds(s: u64) -> Duration {
    Duration::from_secs(s)
}

fn line(from: (f64, f64), to: (f64, f64)) -> Area {
    Area { points_m: vec![Vector2::new(from.0, from.1), Vector2::new(to.0, to.1)], radius_m: 0.1 }
}

fn trip(agent: &str, area: Area) -> Reservation {
    Reservation { agent: agent.into(), area, parked: false, occupied: true, duration: seconds(10), wait: seconds(60) }
}

/// Asks and steps at once.
fn ask(arbiter: &mut Arbiter, now: Duration, ticket: u64, reservation: Reservation) -> Vec<(u64, Answer)> {
    arbiter.reserve(now, ticket, reservation);
    arbiter.step(now)
}

fn granted(answers: &[(u64, Answer)], ticket: u64) -> Option<LeaseId> {
    answers.iter().find(|(answered, _)| *answered == ticket)?.1.as_ref().ok().map(|granted| granted.lease)
}

const EAST: ((f64, f64), (f64, f64)) = ((-1.0, 0.0), (1.0, 0.0));
const NORTH: ((f64, f64), (f64, f64)) = ((0.0, -1.0), (0.0, 1.0));
const FAR: ((f64, f64), (f64, f64)) = ((-1.0, 5.0), (1.0, 5.0));

#[test]
fn two_agents_that_want_one_area_get_it_one_after_the_other_in_the_order_of_asking() {
    let mut arbiter = Arbiter::default();
    let first = ask(&mut arbiter, seconds(0), 1, trip("a", line(EAST.0, EAST.1)));
    let lease = granted(&first, 1).unwrap();
    assert!(ask(&mut arbiter, seconds(1), 2, trip("b", line(NORTH.0, NORTH.1))).is_empty());
    assert!(ask(&mut arbiter, seconds(2), 3, trip("c", line(EAST.0, EAST.1))).is_empty());
    // Who is in nobody's way does not wait.
    assert!(granted(&ask(&mut arbiter, seconds(2), 4, trip("d", line(FAR.0, FAR.1))), 4).is_some());
    assert_eq!(arbiter.waiting().collect::<Vec<_>>(), ["b", "c"]);
    arbiter.release("a", lease).unwrap();
    let next = arbiter.step(seconds(3));
    let lease = granted(&next, 2).unwrap();
    assert_eq!(granted(&next, 3), None);
    arbiter.release("b", lease).unwrap();
    assert!(granted(&arbiter.step(seconds(4)), 3).is_some());
}

#[test]
fn a_lease_that_ends_in_time_frees_an_empty_area_and_keeps_others_out_of_an_occupied_one() {
    for occupied in [false, true] {
        let mut arbiter = Arbiter::default();
        let gone = Reservation { occupied, ..trip("gone", line(EAST.0, EAST.1)) };
        let lease = granted(&ask(&mut arbiter, seconds(0), 1, gone), 1).unwrap();
        assert!(ask(&mut arbiter, seconds(1), 2, trip("b", line(NORTH.0, NORTH.1))).is_empty());
        assert!(arbiter.step(seconds(9)).is_empty());
        let after = arbiter.step(seconds(10));
        if occupied {
            let overdue = Refusal::Overdue { agent: "gone".into(), lease };
            assert_eq!(after, [(2, Err(overdue))]);
            assert!(arbiter.leases()[&lease].overdue);
            // The holder may renew it, as nobody has come in; an operator may end it in its name.
            assert_eq!(arbiter.renew(seconds(11), "gone", lease, seconds(5)), Ok(seconds(16)));
            assert!(!arbiter.leases()[&lease].overdue);
            arbiter.release("gone", lease).unwrap();
        } else {
            assert!(granted(&after, 2).is_some());
            assert!(arbiter.renew(seconds(11), "gone", lease, seconds(5)).is_err());
            assert!(arbiter.release("gone", lease).is_err());
        }
        assert!(!arbiter.leases().contains_key(&lease));
    }
}

#[test]
fn what_can_lead_to_no_good_is_refused_at_once_and_by_name() {
    let mut arbiter = Arbiter::default();
    let parked = Reservation { parked: true, ..trip("parked", Area::disc(Vector2::zeros(), 0.1)) };
    let lease = granted(&ask(&mut arbiter, seconds(0), 1, parked), 1).unwrap();
    let through = ask(&mut arbiter, seconds(1), 2, trip("b", line(EAST.0, EAST.1)));
    assert_eq!(through, [(2, Err(Refusal::Parked { agent: "parked".into() }))]);
    // Its own place is in nobody's way but others'.
    assert!(granted(&ask(&mut arbiter, seconds(1), 3, trip("parked", line(EAST.0, EAST.1))), 3).is_some());
    // On a trip one does not wait for another.
    assert!(granted(&ask(&mut arbiter, seconds(1), 4, trip("far", line(FAR.0, FAR.1))), 4).is_some());
    let second = ask(&mut arbiter, seconds(1), 5, trip("far", line(EAST.0, EAST.1)));
    assert!(matches!(&second[0].1, Err(Refusal::Parked { .. })), "{second:?}");
    arbiter.release("parked", lease).unwrap();
    let second = ask(&mut arbiter, seconds(1), 6, trip("far", line(EAST.0, EAST.1)));
    assert!(matches!(&second[0].1, Err(Refusal::OnATrip { taken_by, .. }) if taken_by == "parked"), "{second:?}");
    // Nobody waits for longer than it wants to.
    let hurried = Reservation { wait: seconds(2), ..trip("hurried", line(NORTH.0, NORTH.1)) };
    assert!(ask(&mut arbiter, seconds(2), 7, hurried).is_empty());
    assert_eq!(arbiter.step(seconds(4)), [(7, Err(Refusal::Taken { taken_by: "parked".into() }))]);
    for (index, bad) in [
        Reservation { agent: String::new(), ..trip("x", line(FAR.0, FAR.1)) },
        Reservation { duration: Duration::ZERO, ..trip("x", line(FAR.0, FAR.1)) },
        Reservation { area: Area { points_m: vec![], radius_m: 0.1 }, ..trip("x", line(FAR.0, FAR.1)) },
        Reservation { area: Area::disc(Vector2::new(f64::NAN, 0.0), 0.1), ..trip("x", line(FAR.0, FAR.1)) },
    ]
    .into_iter()
    .enumerate()
    {
        let ticket = 10 + index as u64;
        assert!(matches!(ask(&mut arbiter, seconds(5), ticket, bad)[..], [(answered, Err(_))] if answered == ticket));
    }
    assert!(arbiter.release("b", lease).is_err());
    assert!("nonsense".parse::<LeaseId>().is_err());
}

#[test]
fn who_overlaps_only_somebody_who_waits_does_not_overtake_him() {
    let mut arbiter = Arbiter::default();
    let west = line((-2.0, 0.0), (-1.0, 0.0));
    let both = line((-2.0, 0.0), (2.0, 0.0));
    let east = line((1.0, 0.0), (2.0, 0.0));
    let lease = granted(&ask(&mut arbiter, seconds(0), 1, trip("a", west)), 1).unwrap();
    assert!(ask(&mut arbiter, seconds(1), 2, trip("b", both)).is_empty());
    assert!(ask(&mut arbiter, seconds(2), 3, trip("c", east)).is_empty());
    arbiter.release("a", lease).unwrap();
    let answers = arbiter.step(seconds(3));
    assert!(granted(&answers, 2).is_some() && granted(&answers, 3).is_none());
}

#[test]
fn nobody_renews_or_ends_the_lease_of_another() {
    let mut arbiter = Arbiter::default();
    let lease = granted(&ask(&mut arbiter, seconds(0), 1, trip("a", line(EAST.0, EAST.1))), 1).unwrap();
    assert!(arbiter.renew(seconds(1), "b", lease, seconds(100)).is_err());
    assert!(arbiter.release("b", lease).is_err());
    assert_eq!(arbiter.leases()[&lease].expires, seconds(10));
}

#[test]
fn as_many_wait_as_may_and_the_next_is_told_so() {
    let mut arbiter = Arbiter::default();
    ask(&mut arbiter, seconds(0), 0, trip("a", line(EAST.0, EAST.1)));
    for ticket in 1..=Arbiter::WAITING_MAX as u64 {
        assert!(ask(&mut arbiter, seconds(1), ticket, trip("b", line(NORTH.0, NORTH.1))).is_empty(), "{ticket}");
    }
    let one_more = ask(&mut arbiter, seconds(1), 1000, trip("b", line(NORTH.0, NORTH.1)));
    assert_eq!(one_more, [(1000, Err(Refusal::Full { waiting: Arbiter::WAITING_MAX }))]);
}

proptest! {
    /// Agents that park apart and make trips wherever they like: leases never overlap, every request is answered, and
    /// as soon as nobody holds a trip any more nobody waits.
    #[test]
    fn agents_never_meet_and_never_block_each_other(
        trips in prop::collection::vec((0_usize..5, (-1.0..1.0, -1.0..1.0), 1_u64..8), 1..60),
    ) {
        let home = |agent: usize| Vector2::new(agent as f64 - 2.0, 1.5);
        let name = |agent: usize| format!("agent_{agent}");
        let mut arbiter = Arbiter::default();
        for agent in 0..5 {
            let area = Area::disc(home(agent), 0.1);
            let duration = Arbiter::DURATION_MAX;
            let parking = Reservation { parked: true, duration, ..trip(&name(agent), area) };
            arbiter.reserve(seconds(0), agent as u64, parking);
        }
        prop_assert!(arbiter.step(seconds(0)).iter().all(|(_, answer)| answer.is_ok()));
        let mut plans: BTreeMap<usize, Vec<(Vector2<f64>, u64)>> = BTreeMap::new();
        for (agent, (x, y), lasts) in trips {
            plans.entry(agent).or_default().push((Vector2::new(x, y), lasts));
        }
        let mut asked: BTreeMap<u64, (usize, u64)> = BTreeMap::new();
        let mut on_trip: BTreeMap<usize, (LeaseId, Duration)> = BTreeMap::new();
        let mut tickets = 100;
        for second in 1..2000 {
            let now = seconds(second);
            for agent in 0..5 {
                let waits = asked.values().any(|(asking, _)| *asking == agent);
                if waits || on_trip.contains_key(&agent) {
                    continue;
                }
                if let Some((to, lasts)) = plans.get_mut(&agent).and_then(Vec::pop) {
                    tickets += 1;
                    asked.insert(tickets, (agent, lasts));
                    let area = Area { points_m: vec![home(agent), to, home(agent)], radius_m: 0.1 };
                    let wait = Arbiter::WAIT_MAX;
                    arbiter.reserve(now, tickets, Reservation { wait, ..trip(&name(agent), area) });
                }
            }
            for (ticket, answer) in arbiter.step(now) {
                let (agent, lasts) = asked.remove(&ticket).unwrap();
                match answer {
                    Ok(Granted { lease, .. }) => drop(on_trip.insert(agent, (lease, now + seconds(lasts)))),
                    Err(refusal) => prop_assert!(matches!(refusal, Refusal::Parked { .. }), "{}", refusal),
                }
            }
            let leases: Vec<_> = arbiter.leases().values().collect();
            for (index, lease) in leases.iter().enumerate() {
                for other in &leases[..index] {
                    prop_assert!(lease.agent == other.agent || !lease.area.overlaps(&other.area));
                }
            }
            prop_assert!(!on_trip.is_empty() || asked.is_empty());
            on_trip.retain(|agent, (lease, until)| {
                if *until <= now {
                    arbiter.release(&name(*agent), *lease).unwrap();
                }
                *until > now
            });
            if plans.values().all(Vec::is_empty) && asked.is_empty() && on_trip.is_empty() {
                return Ok(());
            }
        }
        prop_assert!(false, "agents still wait: {:?}", asked);
    }
}
