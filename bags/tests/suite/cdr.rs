//! Messages taken apart by their definitions.

use feeder_runtime::cdr;
use minifactory_msgs::Message as _;
use minifactory_msgs::geometry_msgs::msg::PoseStamped;
use minifactory_msgs::sensor_msgs::msg::JointState;
use minifactory_msgs::tf2_msgs::msg::TFMessage;
use proptest::prelude::*;
use ros2_bags::cdr::MessageType;

fn with_header(body: &[u8], little_endian: bool) -> Vec<u8> {
    [&[0, u8::from(little_endian), 0, 0], body].concat()
}

fn joint_state() -> (MessageType, Vec<u8>) {
    let mut message = JointState { name: vec!["x".into(), "yaw".into()], ..JointState::default() };
    message.header.stamp.sec = -3;
    message.header.frame_id = "platen".into();
    message.position = vec![0.5, -2.25];
    let ty = MessageType::parse("sensor_msgs/msg/JointState", JointState::INFO.definition).unwrap();
    (ty, with_header(&cdr::encode(&message).unwrap(), true))
}

fn leaves(ty: &MessageType, data: &[u8]) -> Vec<String> {
    let mut leaves = Vec::new();
    ty.walk(data, &mut |path, leaf| leaves.push(format!("{path}={leaf}"))).unwrap();
    leaves
}

#[test]
fn a_message_is_taken_apart() {
    let (ty, data) = joint_state();
    let expected = [
        "header.stamp.sec=-3",
        "header.stamp.nanosec=0",
        "header.frame_id=\"platen\"",
        "name[0]=\"x\"",
        "name[1]=\"yaw\"",
        "position[0]=0.5",
        "position[1]=-2.25",
    ];
    assert_eq!(leaves(&ty, &data), expected);
}

#[test]
fn the_other_byte_order_reads_the_same() {
    let (ty, data) = joint_state();
    let swapped = ty.swapped(&data).unwrap();
    assert_ne!(swapped, data);
    assert_eq!(leaves(&ty, &swapped), leaves(&ty, &data));
    assert_eq!(ty.swapped(&swapped).unwrap(), data);
}

#[test]
fn hashes_follow_from_definitions() {
    for info in [JointState::INFO, PoseStamped::INFO, TFMessage::INFO] {
        let ty = MessageType::parse(&info.ros_type(), info.definition).unwrap();
        assert_eq!(ty.type_hash().as_deref(), Some(info.type_hash));
    }
}

#[test]
fn messages_that_do_not_fit_are_refused_with_field_and_byte() {
    let (ty, data) = joint_state();
    let mut huge = data.clone();
    huge[4 + 20..4 + 24].copy_from_slice(&u32::MAX.to_le_bytes());
    for (data, reason) in [
        (&huge[..], "name at byte 28 is said to have more elements"),
        (&data[..data.len() - 9], "position[1] at byte"),
        (&[data.clone(), vec![0; 9]].concat()[..], "left over"),
        (&data[..2], "encapsulation header"),
        (&[&[0, 7], &data[2..]].concat()[..], "not plain CDR"),
    ] {
        let error = ty.walk(data, &mut |_, _| ()).unwrap_err();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn definitions_that_cannot_be_used_are_refused() {
    for (ros_type, schema, reason) in [
        ("a/msg/B", "C c\n", "lacks a/msg/C"),
        ("a/msg/B", "B b\n", "contains itself"),
        ("B", "float64 x\n", "no name"),
        ("a/msg/B", "float64\n", "expected a type and a name"),
    ] {
        let error = MessageType::parse(ros_type, schema).unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

proptest! {
    /// Whatever the bytes, an answer comes at once.
    #[test]
    fn foreign_bytes_never_panic(body in prop::collection::vec(any::<u8>(), 0..300), little_endian in any::<bool>()) {
        for info in [JointState::INFO, TFMessage::INFO] {
            let ty = MessageType::parse(&info.ros_type(), info.definition).unwrap();
            let _ = ty.walk(&with_header(&body, little_endian), &mut |_, _| ());
            let _ = ty.swapped(&with_header(&body, little_endian));
        }
    }

    #[test]
    fn foreign_definitions_never_panic(schema in "([a-z0-9/]{1,8}(\\[[0-9]{0,3}\\])? [a-z_]{1,6}\n){0,6}(={80}\nMSG: [a-zA-Z/]{0,8}\n)?") {
        if let Ok(ty) = MessageType::parse("a/msg/B", &schema) {
            let _ = ty.walk(&[0, 1, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8], &mut |_, _| ());
        }
    }
}
