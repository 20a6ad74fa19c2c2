//! What the graph tells, as events.

use feeder_model::delivery::Phase;
use feeder_wire::courier_state;
use feeder_wire::delivery_state::PlannerStand;
use minifactory_msgs::rcl_interfaces::msg::Log;

use crate::description::Description;
use crate::events::{Event, Events, Level};
use crate::frame::{FeederMemory, phase_name, remark, stands, time_s};
use crate::heard::{FeederHeard, Heard};

/// Outcomes of deliveries by number, as people read them.
const OUTCOMES: [&str; 11] = [
    "delivered",
    "cancelled",
    "timed out",
    "feeding failed",
    "no image",
    "no gentle move",
    "area refused",
    "part lost",
    "no hand-over",
    "not taken",
    "fault",
];

/// What is known of a feeder, so that changes show.
#[derive(Default)]
pub(crate) struct Known {
    fault: Option<String>,
    warning: Option<String>,
    feeding: Option<bool>,
}

/// Takes in what was heard since the last time.
pub(crate) fn tell(
    cell: &Description,
    heard: &Heard,
    memories: &mut [FeederMemory],
    known: &mut [Known],
    events: &Events,
) {
    for (((feeder, inboxes), memory), known) in cell.feeders.iter().zip(&heard.feeders).zip(memories).zip(known) {
        for (at_s, stand) in stands(inboxes) {
            for event in changes(memory.stand.as_ref(), &stand, at_s) {
                events.add(event.of(&feeder.name));
            }
            memory.stand = Some(stand);
        }
        for pick in inboxes.picks.take() {
            let at_s = time_s(&pick.header.stamp);
            let (kind, level) = match (pick.picked, pick.station.is_empty()) {
                (true, false) => ("picked", Level::Info),
                (true, true) => ("removed", Level::Info),
                (false, _) => ("missed", Level::Warn),
            };
            let message =
                if pick.picked { format!("part {}", pick.part_id) } else { "the gripper closed on nothing".to_owned() };
            events.add(Event {
                station: Some(pick.station).filter(|station| !station.is_empty()),
                ..Event::new(kind, level, Some(at_s), message).of(&feeder.name)
            });
        }
        courier(inboxes, &feeder.name, known, events);
    }
    for log in heard.log.take().into_iter().filter(|log| log.level >= Log::WARN) {
        let level = if log.level >= Log::ERROR { Level::Error } else { Level::Warn };
        let feeder = cell.feeders.iter().find(|feeder| log.name.starts_with(&feeder.namespace[1..]));
        let event = Event { node: Some(log.name), ..Event::new("log", level, Some(time_s(&log.stamp)), log.msg) };
        events.add(Event { feeder: feeder.map(|feeder| feeder.name.clone()), ..event });
    }
}

/// What is new between two words of the planner; before the first nothing is known.
fn changes(before: Option<&PlannerStand>, now: &PlannerStand, at_s: f64) -> Vec<Event> {
    let idle = PlannerStand::idle();
    let Some(before) = before.or_else(|| (now.accepted <= 1).then_some(&idle)) else { return Vec::new() };
    let event = |kind, level, message: &str| Event {
        delivery_id: now.delivery_id.clone(),
        station: now.station.clone(),
        ..Event::new(kind, level, Some(at_s), message)
    };
    let mut new = Vec::new();
    if now.accepted > before.accepted {
        new.push(event("goal", Level::Info, "a delivery was accepted"));
    }
    if now.phase != before.phase {
        let kind = if now.phase == Phase::Presented { "presented" } else { "phase" };
        new.push(event(kind, Level::Info, phase_name(now.phase)));
    }
    // The planner has put the delivery aside when it counts it.
    let ended =
        |event: Event| Event { delivery_id: before.delivery_id.clone(), station: before.station.clone(), ..event };
    if now.delivered > before.delivered {
        new.push(ended(event("delivered", Level::Info, "the part was taken")));
    }
    for (index, outcome) in OUTCOMES.iter().enumerate() {
        if now.failed_by_outcome[index] > before.failed_by_outcome[index] {
            new.push(ended(event("failed", Level::Warn, outcome)));
        }
    }
    new.extend(fault(before.fault.as_ref(), now.fault.as_ref(), at_s));
    new
}

/// The beginning or end of a fault.
fn fault(before: Option<&String>, now: Option<&String>, at_s: f64) -> Option<Event> {
    match (before, now) {
        (before, Some(now)) if before != Some(now) => Some(Event::new("fault", Level::Error, Some(at_s), now.clone())),
        (Some(_), None) => Some(Event::new("fault_ended", Level::Info, Some(at_s), "the fault has ended")),
        _ => None,
    }
}

fn courier(heard: &FeederHeard, feeder: &str, known: &mut Known, events: &Events) {
    if let Some(message) = heard.courier_state.latest() {
        let at_s = time_s(&message.header.stamp);
        let activity = courier_state::from_message(message);
        let warning = remark(&activity);
        let now = activity.fault;
        fault(known.fault.as_ref(), now.as_ref(), at_s).into_iter().for_each(|event| events.add(event.of(feeder)));
        if warning != known.warning {
            let text = warning.clone().unwrap_or_else(|| "the courier's warning has ended".to_owned());
            let level = if warning.is_some() { Level::Warn } else { Level::Info };
            events.add(Event::new("warning", level, Some(at_s), text).of(feeder));
        }
        (known.fault, known.warning) = (now, warning);
    }
    if let Some(message) = heard.waveform.latest() {
        let before = known.feeding.replace(message.enabled);
        if before.is_some_and(|before| before != message.enabled) {
            let text = if message.enabled { "on" } else { "off" };
            events.add(Event::new("feeding", Level::Info, Some(time_s(&message.header.stamp)), text).of(feeder));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delivery_is_told_from_goal_to_end() {
        let on_the_way = PlannerStand {
            accepted: 1,
            phase: Phase::Feeding,
            delivery_id: Some("delivery_1".to_owned()),
            station: Some("station_1".to_owned()),
            ..PlannerStand::idle()
        };
        let presented = PlannerStand { phase: Phase::Presented, ..on_the_way.clone() };
        let delivered = PlannerStand {
            phase: Phase::Returning,
            delivered: 1,
            delivery_id: None,
            station: None,
            ..presented.clone()
        };
        let mut failed = PlannerStand { phase: Phase::Fault, fault: Some("stuck".to_owned()), ..delivered.clone() };
        failed.failed_by_outcome[5] = 1;
        let told = |before: Option<&PlannerStand>, now: &PlannerStand| {
            let events = changes(before, now, 1.0).into_iter();
            events.map(|event| (event.kind, event.message, event.delivery_id)).collect::<Vec<_>>()
        };
        let (text, one) = (|text: &str| text.to_owned(), Some("delivery_1".to_owned()));
        assert_eq!(
            told(None, &on_the_way),
            [("goal", text("a delivery was accepted"), one.clone()), ("phase", text("feeding"), one.clone())]
        );
        assert_eq!(told(Some(&on_the_way), &presented), [("presented", text("presented"), one.clone())]);
        assert_eq!(
            told(Some(&presented), &delivered),
            [("phase", text("returning"), None), ("delivered", text("the part was taken"), one)]
        );
        assert_eq!(
            told(Some(&delivered), &failed),
            [("phase", text("fault"), None), ("failed", text("no gentle move"), None), ("fault", text("stuck"), None)]
        );
        assert_eq!(told(Some(&delivered), &delivered), []);
        assert_eq!(told(None, &PlannerStand { accepted: 9, ..delivered }), [], "whoever comes late knows nothing");
    }
}
