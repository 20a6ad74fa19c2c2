//! Prints the largest of each number that a topic of a bag carries, by its field:
//! `cargo run --package ros2_bags --example largest -- bags/golden/delivery /station_1/joint_states`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::PathBuf;

use ros2_bags::cdr::MessageType;
use ros2_bags::{Bag, Query};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let (Some(bag), Some(name)) = (arguments.next(), arguments.next()) else {
        return Err("which bag, and which topic?".into());
    };
    let bag = Bag::open(&PathBuf::from(bag))?;
    let index = bag.topics().iter().position(|topic| *topic.name == *name).ok_or("no such topic")?;
    let topic = &bag.topics()[index];
    let definition = MessageType::parse(&topic.ros_type, &topic.schema)?;
    let mut largest: BTreeMap<String, f64> = BTreeMap::new();
    for message in bag.messages(&Query::topic(index)) {
        definition.walk(&message?.data, &mut |field, value| {
            if let Some(number) = value.number() {
                largest.entry(field.to_owned()).and_modify(|most| *most = most.max(number)).or_insert(number);
            }
        })?;
    }
    for (field, number) in largest {
        println!("{field} {number}");
    }
    Ok(())
}
