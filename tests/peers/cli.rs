//! What commands of the ros2 CLI get, byte for byte.

use std::collections::BTreeSet;

use super::echo::EchoNode;
use crate::common::{Kind, Peer};

/// What commands of the ros2 CLI send and must get, from `tests/interop/cli_sequences.py`.
const SEQUENCES: &str = include_str!("../data/cli.txt");

/// Whether these are the bytes; a `.` stands for any digit. On the wire RTPS fills a sample up to a multiple of four
/// bytes, and not every reader takes the filling away.
fn matches(expected: &str, hex: &str) -> bool {
    let filling = "00".repeat(3 * (expected.len() / 2) % 4);
    let expected = format!("{expected}{filling}");
    expected.len() == hex.len() && expected.chars().zip(hex.chars()).all(|(digit, got)| digit == '.' || digit == got)
}

#[test]
fn commands_of_the_ros2_cli_get_what_they_get_in_ros_byte_for_byte() {
    for kind in Kind::BOTH {
        let node = EchoNode::start();
        let mut peer = Peer::start(kind, node.domain.id);
        let (mut compared, mut command) = (0, "");
        // Readers that have not heard anything yet, and what they were early for: the writer may find a new reader later
        // than the reader the writer, and then what it sends first is not for that reader, as in ROS.
        let (mut fresh, mut early) = (BTreeSet::new(), None);
        for line in SEQUENCES.lines() {
            let words: Vec<&str> = line.split(' ').collect();
            let got = match words[..] {
                ["#", ..] => {
                    command = line;
                    continue;
                }
                ["client" | "reader", name, ..] => {
                    peer.tell(line);
                    peer.wait_until_matched(name);
                    fresh.insert(name);
                    continue;
                }
                ["call", ..] => {
                    peer.tell(line);
                    continue;
                }
                ["reply", name, number, _] => peer.reply(name, number.parse().unwrap()),
                ["sample", name, _] => early.take().unwrap_or_else(|| peer.sample(name)),
                _ => panic!("{line:?} makes no sense"),
            };
            let expected = words[words.len() - 1];
            if words[0] == "sample" && fresh.remove(words[1]) && !matches(expected, &got.hex) {
                early = Some(got);
                continue;
            }
            assert!(matches(expected, &got.hex), "{kind:?}, {command}: expected {expected}, got {}", got.hex);
            compared += 1;
        }
        assert!(compared > 20 && !peer.has_stray_replies());
        node.stop();
    }
}
