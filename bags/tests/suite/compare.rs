//! Comparing and exporting.

use std::collections::HashMap;

use minifactory_msgs::msg::{AreaLease, AreaLeases};
use ros2_bags::diff::{DiffSettings, diff};
use ros2_bags::export::export;
use ros2_bags::{Bag, BagWriter, Compression, NewTopic, Selection, WriteSettings};

use crate::common::{STEP_NS, encoded, good, joints, text, topic};

/// Ten joint states; `change` may change what is written of each.
fn bag(folder: &std::path::Path, name: &str, change: impl Fn(u64, &mut u64, &mut Vec<u8>)) -> Bag {
    let folder = folder.join(name);
    let mut writer = BagWriter::create(&folder, WriteSettings::default()).unwrap();
    let states = writer.add_topic(topic("/joints", "sensor_msgs/msg/JointState")).unwrap();
    for number in 0..10 {
        let (mut time_ns, mut data) = (number * STEP_NS, joints(number));
        change(number, &mut time_ns, &mut data);
        writer.write(states, time_ns, time_ns, &data).unwrap();
    }
    writer.finish().unwrap();
    Bag::open(&folder).unwrap()
}

fn first(a: &Bag, b: &Bag, settings: &DiffSettings) -> Option<String> {
    let diff = diff(a, b, settings);
    assert!(diff.unreadable.is_empty());
    let first: Vec<_> = diff.topics.iter().filter(|topic| topic.first.is_some()).map(ToString::to_string).collect();
    assert_eq!(first.is_empty(), diff.is_same());
    first.into_iter().next()
}

#[test]
fn the_first_difference_is_named_with_time_and_field() {
    let work = tempfile::tempdir().unwrap();
    let base = bag(work.path(), "base", |_, _, _| ());
    let exact = DiffSettings::default();
    assert_eq!(first(&base, &bag(work.path(), "same", |_, _, _| ()), &exact), None);

    let at = joints(5).windows(8).position(|bytes| bytes == 5.0_f64.to_le_bytes()).unwrap();
    let nearly = bag(work.path(), "nearly", |number, _, data| {
        if number == 5 {
            data[at..at + 8].copy_from_slice(&5.001_f64.to_le_bytes());
        }
    });
    let told = first(&base, &nearly, &exact).unwrap();
    assert!(told.contains("/joints") && told.contains("0.005000000 s"), "{told}");
    assert!(told.contains("message 5: position[0] is 5 against 5.001"), "{told}");
    for (absolute, relative, same) in [(0.002, 0.0, true), (0.0005, 0.0, false), (0.0, 1e-3, true), (0.0, 1e-4, false)]
    {
        let settings = DiffSettings { absolute, relative, ..DiffSettings::default() };
        assert_eq!(first(&base, &nearly, &settings).is_none(), same, "{absolute} {relative}");
    }
    assert_eq!(first(&base, &nearly, &DiffSettings { before_ns: Some(5 * STEP_NS), ..exact.clone() }), None);

    let late = bag(work.path(), "late", |number, time_ns, _| *time_ns += number);
    let told = first(&base, &late, &exact).unwrap();
    assert!(told.contains("message 1: time 0.001000000 s against 0.001000001 s"), "{told}");
    assert_eq!(first(&base, &late, &DiffSettings { ignore_time: true, ..exact.clone() }), None);
}

#[test]
fn topics_types_and_counts_are_compared() {
    let work = tempfile::tempdir().unwrap();
    let folders = ["a", "b", "c", "d"].map(|name| work.path().join(name));
    good(&folders[0], WriteSettings::default(), 20);
    good(&folders[1], WriteSettings { compression: Compression::Lz4, ..WriteSettings::default() }, 20);
    good(&folders[2], WriteSettings::default(), 19);
    let mut writer = BagWriter::create(&folders[3], WriteSettings::default()).unwrap();
    let other = writer.add_topic(NewTopic { name: "/joints".into(), ..topic("/x", "std_msgs/msg/String") }).unwrap();
    writer.write(other, 0, 0, &text(0)).unwrap();
    writer.finish().unwrap();
    let bags = folders.map(|folder| Bag::open(&folder).unwrap());
    let settings = DiffSettings::default();
    assert!(diff(&bags[0], &bags[1], &settings).is_same());
    let told = first(&bags[0], &bags[2], &settings).unwrap();
    assert!(told.contains("20 and 19 messages") && told.contains("no more messages"), "{told}");
    let told: Vec<String> = diff(&bags[0], &bags[3], &settings).topics.iter().map(ToString::to_string).collect();
    assert!(told[0].contains("type sensor_msgs/msg/JointState against std_msgs/msg/String"), "{told:?}");
    assert!(told[1].contains("only in the first bag"), "{told:?}");
    let selection = Selection::of(vec!["/nothing".into()]);
    assert!(diff(&bags[0], &bags[3], &DiffSettings { selection, ..settings }).is_same());
}

#[test]
fn numbers_and_texts_become_tables() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), 3);
    let tables = work.path().join("tables");
    let exported = export(&Bag::open(&folder).unwrap(), &Selection::default(), &tables).unwrap();
    let outcomes: Vec<_> = exported.iter().map(|exported| (&*exported.topic, exported.outcome.is_ok())).collect();
    assert_eq!(outcomes, [("/joints", true), ("/text", true)]);
    let table = std::fs::read_to_string(tables.join("joints.csv")).unwrap();
    let expected = "log_time_ns,publish_time_ns,header.stamp.sec,header.stamp.nanosec,header.frame_id,name[0],name[1],\
                    position[0],position[1]\n\
                    0,0,0,0,,x,y,0.0,0.5\n1000000,1000000,0,0,,x,y,1.0,0.5\n2000000,2000000,0,0,,x,y,2.0,0.5\n";
    assert_eq!(table, expected);
    let texts = std::fs::read_to_string(tables.join("text.csv")).unwrap();
    assert!(texts.starts_with("log_time_ns,publish_time_ns,data\n0,0,message 0\n"), "{texts}");
}

/// Names stand in messages within lists, and in lists of texts: a table that left them out would not tell whose lease a row shows.
#[test]
fn whose_leases_are_whose_and_who_waits_is_told_by_name() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    let lease = |lease_id: &str, agent: &str| AreaLease {
        lease_id: lease_id.into(),
        agent: agent.into(),
        ..AreaLease::default()
    };
    let sent = [
        AreaLeases {
            leases: vec![lease("lease 1", "feeder")],
            waiting: vec!["feeder_2".into(), "feeder, \"the third\"".into()],
            ..AreaLeases::default()
        },
        AreaLeases { leases: vec![lease("lease 1", "feeder"), lease("lease 2", "feeder_2")], ..AreaLeases::default() },
    ];
    let mut writer = BagWriter::create(&folder, WriteSettings::default()).unwrap();
    let leases = writer.add_topic(topic("/platen/leases", "minifactory_msgs/msg/AreaLeases")).unwrap();
    for (time_ns, message) in (0..).step_by(1_000_000).zip(&sent) {
        writer.write(leases, time_ns, time_ns, &encoded(message)).unwrap();
    }
    writer.finish().unwrap();

    let tables = work.path().join("tables");
    export(&Bag::open(&folder).unwrap(), &Selection::default(), &tables).unwrap();
    let mut table = csv::Reader::from_path(tables.join("platen.leases.csv")).unwrap();
    let rows: Vec<HashMap<String, String>> = table.deserialize().map(Result::unwrap).collect();
    let told = |name: &str| [&*rows[0][name], &*rows[1][name]];
    assert_eq!(told("leases[0].lease_id"), ["lease 1", "lease 1"]);
    assert_eq!(told("leases[0].agent"), ["feeder", "feeder"]);
    assert_eq!(told("leases[1].lease_id"), ["", "lease 2"]);
    assert_eq!(told("leases[1].agent"), ["", "feeder_2"]);
    assert_eq!(told("waiting[0]"), ["feeder_2", ""]);
    assert_eq!(told("waiting[1]"), ["feeder, \"the third\"", ""]);
}
