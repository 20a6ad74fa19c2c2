//! How deliveries and purges end that do not end well, with reports made by hand: each for itself, and nothing is left behind.

use std::time::Duration;

use feeder_control::delivery::{DeliveryConfig, Failure, Output, Phase, Refusal, ReserveId};

use crate::by_hand::{ByHand, PART_M, STAND, at};
use crate::world::{asking, config};

/// The requests that ended in these outputs, and how.
fn ended(outputs: &[Output]) -> Vec<(u64, Result<(), Failure>)> {
    let end = |output: &Output| match output {
        Output::Finished(id, result) => Some((id.0, result.clone().map(|_| ()))),
        _ => None,
    };
    outputs.iter().filter_map(end).collect()
}

fn cancels_a_move(outputs: &[Output]) -> bool {
    outputs.iter().any(|output| matches!(output, Output::CancelMove(_)))
}

#[test]
fn nothing_is_known_of_a_courier_that_has_not_reported() {
    let mut hand = ByHand::unheard(config());
    assert!(!hand.sequencer.is_connected());
    hand.home(1.0, false);
    assert!(hand.sequencer.is_connected());
}

#[test]
fn a_requests_time_runs_out_on_the_way_and_while_another_part_is_presented() {
    let (mut hand, _) = ByHand::departed(config(), 0.5e-3, Some(Duration::from_secs(1)));
    assert_eq!(ended(&hand.step(1.4)), []);
    assert_eq!(ended(&hand.step(1.6)), [(1, Err(Failure::TimedOut(Phase::Moving)))]);
    let mut hand = ByHand::arrived(config(), 0.5e-3, None, 0.0);
    let mut other = asking("left", 0.5e-3);
    other.timeout = Some(Duration::from_secs(1));
    hand.sequencer.request(at(2.0), other).unwrap();
    assert!(hand.presents(2.0).is_some());
    assert_eq!(ended(&hand.step(3.0)), [(2, Err(Failure::TimedOut(Phase::Presented)))]);
    assert_eq!(hand.sequencer.phase(), Phase::Presented);
}

#[test]
fn a_move_is_stopped_when_its_request_is_given_up_and_not_when_it_has_ended_by_itself() {
    let (mut hand, _) = ByHand::departed(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.5), hand.id));
    assert!(cancels_a_move(&hand.step(1.5)));
    let (mut hand, id) = ByHand::departed(config(), 0.5e-3, None);
    hand.sequencer.move_ended(id, Err("it was refused".into()));
    let outputs = hand.step(1.5);
    assert_eq!(ended(&outputs), [(1, Err(Failure::Move("it was refused".into())))]);
    assert!(!cancels_a_move(&outputs));
}

#[test]
fn what_is_said_of_the_way_out_says_nothing_of_the_way_home() {
    let (mut hand, out) = ByHand::departed(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.5), hand.id));
    hand.courier(1.6, STAND.into(), false);
    let home = hand.departs(1.6).unwrap();
    assert_ne!(home, out);
    // The end of the move that was given up comes late.
    hand.sequencer.move_ended(out, Err("it was cancelled".into()));
    hand.home(3.0, false);
    hand.step(3.0);
    assert_eq!(hand.sequencer.phase(), Phase::Returning);
    hand.sequencer.move_ended(home, Ok(()));
    hand.step(3.1);
    assert_eq!(hand.sequencer.phase(), Phase::Idle);
}

#[test]
fn giving_up_one_of_two_requests_leaves_what_is_done_for_the_other_as_it_is() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    let other = hand.sequencer.request(at(1.0), asking("left", 0.5e-3)).unwrap();
    hand.step(1.06);
    for s in [1.10, 1.20] {
        hand.see(s, &[]);
        hand.step(s);
    }
    assert_eq!(hand.sequencer.phase(), Phase::Feeding);
    assert!(hand.sequencer.cancel(at(1.3), other));
    assert_eq!(hand.sequencer.phase(), Phase::Feeding);
    // The last one takes the reason to feed with it.
    assert!(hand.sequencer.cancel(at(1.4), hand.id));
    let outputs = hand.step(1.4);
    assert_eq!(hand.sequencer.phase(), Phase::Idle);
    assert!(outputs.contains(&Output::Feed(false)), "{outputs:?}");
}

#[test]
fn a_courier_on_its_way_home_comes_home_though_the_last_request_is_given_up() {
    let (mut hand, _) = ByHand::departed(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.5), hand.id));
    hand.courier(1.6, STAND.into(), false);
    assert!(hand.departs(1.6).is_some());
    let other = hand.sequencer.request(at(1.7), asking("left", 0.5e-3)).unwrap();
    assert!(hand.sequencer.cancel(at(1.8), other));
    assert_eq!(hand.sequencer.phase(), Phase::Returning);
}

#[test]
fn a_purge_ends_with_the_generators_refusal() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.0), hand.id));
    hand.sequencer.purge(at(1.1), Duration::from_secs(3)).unwrap();
    hand.step(1.1);
    hand.sequencer.feed_refused("the waveform is unknown".into());
    assert!(hand.step(1.2).contains(&Output::Purged(Err("the waveform is unknown".into()))));
    assert_eq!(hand.sequencer.phase(), Phase::Idle);
}

#[test]
fn a_purge_begins_only_where_the_courier_feeds() {
    let mut hand = ByHand::new(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.0), hand.id));
    hand.courier(1.1, STAND.into(), false);
    let refused = hand.sequencer.purge(at(1.2), Duration::from_secs(3));
    assert_eq!(refused, Err(Refusal::NotIdle(Phase::Idle)));
}

#[test]
fn an_area_granted_after_its_request_was_given_up_goes_back_at_once() {
    let mut hand = ByHand::new(DeliveryConfig { arbitrated: true, ..config() }, 0.5e-3, None);
    let granted = |lease: &str| Ok((lease.to_owned(), at(1e5)));
    hand.sequencer.area_answered(ReserveId(1), granted("parking"));
    hand.step(1.0);
    hand.step(1.06);
    hand.see(1.08, &[PART_M]);
    let asked = hand.step(1.1);
    let is_trip = |output: &Output| matches!(output, Output::Reserve { id: ReserveId(2), parked: false, .. });
    assert!(asked.iter().any(is_trip), "{asked:?}");
    assert_eq!(hand.sequencer.phase(), Phase::Reserving);
    assert!(hand.sequencer.cancel(at(1.2), hand.id));
    hand.sequencer.area_answered(ReserveId(2), granted("trip"));
    let outputs = hand.step(1.3);
    assert!(outputs.contains(&Output::Release("trip".into())), "{outputs:?}");
    assert_eq!(hand.sequencer.phase(), Phase::Idle);
}

#[test]
fn a_failed_return_is_tried_again_after_its_wait_and_not_before() {
    let (mut hand, _) = ByHand::departed(config(), 0.5e-3, None);
    assert!(hand.sequencer.cancel(at(1.5), hand.id));
    hand.courier(1.6, STAND.into(), false);
    let home = hand.departs(1.6).unwrap();
    hand.sequencer.move_ended(home, Err("the driver is busy".into()));
    assert_eq!(hand.departs(2.0), None);
    assert_eq!(hand.departs(2.0 + 0.9 * config().retry_s), None);
    assert!(hand.departs(2.0 + 1.1 * config().retry_s).is_some());
}
