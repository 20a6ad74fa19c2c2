//! Prints the name and the hash of every type, one a line.

use minifactory_msgs::TYPES;

fn main() {
    for info in TYPES {
        println!("{} {}", info.ros_type(), info.type_hash);
    }
}
