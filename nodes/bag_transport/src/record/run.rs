//! A simulated run: everything that its nodes publish, in the order of simulated time.

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use feeder_runtime::recording::{RunEvent, RunListener, RunTopic};

use super::{described, with_header};
use ros2_bags::BagError;
use ros2_bags::BagWriter;
use ros2_bags::Definitions;
use ros2_bags::qos::{Durability, QosProfile, Reliability};

/// Between looks whether the run is over, and whether a chunk is due.
const POLL: Duration = Duration::from_millis(100);

/// Records a run whose tick lasts `tick_ns` until all its nodes have come to their end, or until it is `over` and nothing
/// more comes. Times in the bag are simulated ones, from zero.
///
/// # Errors
/// When the bag cannot be written; dropping `listener` then ends the run.
pub fn record_run(
    writer: &mut BagWriter,
    listener: &RunListener,
    tick_ns: u64,
    definitions: &Definitions,
    over: &AtomicBool,
) -> Result<(), BagError> {
    let mut topics: HashMap<Arc<str>, usize> = HashMap::new();
    let mut data = Vec::new();
    loop {
        match listener.next(POLL) {
            RunEvent::Topic(topic) => {
                let qos = vec![profile(&topic)];
                let at = writer.add_topic(described(definitions, &topic.name, &topic.ros_type, qos))?;
                topics.insert(Arc::from(topic.name), at);
            }
            RunEvent::Message { topic, tick, payload } => {
                if let Some(&topic) = topics.get(&topic) {
                    with_header(&mut data, &payload, true);
                    let time_ns = tick * tick_ns;
                    writer.write(topic, time_ns, time_ns, &data)?;
                }
            }
            RunEvent::Idle => {
                writer.flush_if_due()?;
                if over.load(Ordering::Relaxed) {
                    return Ok(());
                }
            }
            RunEvent::End => return Ok(()),
        }
    }
}

fn profile(topic: &RunTopic) -> QosProfile {
    QosProfile {
        depth: topic.depth.into(),
        reliability: if topic.reliable { Reliability::Reliable } else { Reliability::BestEffort },
        durability: if topic.transient_local { Durability::TransientLocal } else { Durability::Volatile },
        ..QosProfile::default()
    }
}
