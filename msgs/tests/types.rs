//! The generated types as their users see them.

use std::collections::BTreeMap;

use sha2::{Digest as _, Sha256};

use minifactory_msgs::{
    Action, Message, MessageVisitor, Service, TYPES,
    action::DeliverPart,
    builtin_interfaces::msg::Time,
    control_msgs::action::FollowJointTrajectory,
    geometry_msgs::msg::{PoseWithCovariance, Quaternion},
    msg::{DeliveryState, LoopStatus, Waveform},
    rcl_interfaces::{
        msg::{Log, ParameterDescriptor},
        srv::GetParameters,
    },
    sensor_msgs::msg::Image,
    srv::Pick,
    std_msgs,
    std_srvs::srv::Trigger,
    type_description_interfaces::{
        msg::{Field, FieldType, IndividualTypeDescription},
        srv::GetTypeDescriptionRequest,
    },
    unique_identifier_msgs::msg::UUID,
    visit_messages, visualization_msgs,
};

#[test]
fn types_have_the_names_that_ros_and_dds_use() {
    let names = [
        (Waveform::INFO, "minifactory_msgs/msg/Waveform", "minifactory_msgs::msg::dds_::Waveform_"),
        (
            <Pick as Service>::Request::INFO,
            "minifactory_msgs/srv/Pick_Request",
            "minifactory_msgs::srv::dds_::Pick_Request_",
        ),
        (Trigger::INFO, "std_srvs/srv/Trigger", "std_srvs::srv::dds_::Trigger_"),
        (
            <DeliverPart as Action>::SendGoalRequest::INFO,
            "minifactory_msgs/action/DeliverPart_SendGoal_Request",
            "minifactory_msgs::action::dds_::DeliverPart_SendGoal_Request_",
        ),
        (
            <DeliverPart as Action>::GetResult::INFO,
            "minifactory_msgs/action/DeliverPart_GetResult",
            "minifactory_msgs::action::dds_::DeliverPart_GetResult_",
        ),
        (
            <DeliverPart as Action>::FeedbackMessage::INFO,
            "minifactory_msgs/action/DeliverPart_FeedbackMessage",
            "minifactory_msgs::action::dds_::DeliverPart_FeedbackMessage_",
        ),
    ];
    for (info, ros, dds) in names {
        assert_eq!(info.ros_type(), ros);
        assert_eq!(info.dds_type(), dds);
    }
}

#[test]
fn hashes_are_those_that_ros_publishes() {
    assert_eq!(
        std_msgs::msg::String::INFO.type_hash,
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    );
    assert_eq!(
        <GetParameters as Service>::INFO.type_hash,
        "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"
    );
}

#[test]
fn the_registry_lists_every_type_once_in_order() {
    let names: Vec<_> = TYPES.iter().map(minifactory_msgs::TypeInfo::ros_type).collect();
    assert!(names.is_sorted_by(|a, b| a < b), "{names:?}");

    struct Hashes(BTreeMap<String, &'static str>);
    impl MessageVisitor for Hashes {
        fn visit<M: Message>(&mut self) {
            self.0.insert(M::INFO.ros_type(), M::INFO.type_hash);
        }
    }
    let mut visited = Hashes(BTreeMap::new());
    visit_messages(&mut visited);
    for (name, hash) in visited.0 {
        assert!(TYPES.iter().any(|info| info.ros_type() == name && info.type_hash == hash), "{name}");
    }
}

#[test]
fn a_definition_is_followed_by_what_it_refers_to() {
    let rule = "=".repeat(80);
    let own = include_str!("../msg/WaveformSegment.msg");
    let text = Waveform::INFO.definition;
    assert!(text.starts_with(include_str!("../msg/Waveform.msg")));
    assert!(text.contains(&format!(
        "\n{rule}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n{rule}\nMSG: minifactory_msgs/WaveformSegment\n{own}{rule}\n"
    )));
    assert!(text.ends_with(&format!("{rule}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n")));
    assert!(
        <FollowJointTrajectory as Action>::FeedbackMessage::INFO
            .definition
            .starts_with("unique_identifier_msgs/UUID goal_id\ncontrol_msgs/FollowJointTrajectory_Feedback feedback\n")
    );
}

/// The JSON form of REP-2011, spelt as Python's json module spells it.
fn json(description: &IndividualTypeDescription) -> String {
    let field = |field: &Field| {
        let FieldType { type_id, capacity, string_capacity, nested_type_name } = &field.r#type;
        format!(
            r#"{{"name": "{}", "type": {{"type_id": {type_id}, "capacity": {capacity}, "string_capacity": {string_capacity}, "nested_type_name": "{nested_type_name}"}}}}"#,
            field.name
        )
    };
    let fields: Vec<_> = description.fields.iter().map(field).collect();
    format!(r#"{{"type_name": "{}", "fields": [{}]}}"#, description.type_name, fields.join(", "))
}

/// Who asks a node what a type consists of gets what its hash stands for.
#[test]
fn descriptions_are_what_the_hashes_are_of() {
    for info in TYPES {
        let description = info.describe();
        let referenced: Vec<_> = description.referenced_type_descriptions.iter().map(json).collect();
        let text = format!(
            r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
            json(&description.type_description),
            referenced.join(", ")
        );
        let digest: String = Sha256::digest(text).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(format!("RIHS01_{digest}"), info.type_hash, "{}", info.ros_type());
    }
}

#[test]
fn defaults_are_those_of_the_definitions() {
    assert_eq!(Quaternion::default(), Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
    assert!(GetTypeDescriptionRequest::default().include_type_sources);
    assert!(!ParameterDescriptor::default().read_only);
    let pose = PoseWithCovariance::default();
    assert!(pose.covariance.iter().all(|value| value.to_bits() == 0));
    assert_eq!(pose.pose.orientation.w.to_bits(), 1.0_f64.to_bits());
    assert!(Image::default().data.is_empty());
}

#[test]
fn constants_belong_to_their_types() {
    assert_eq!(DeliveryState::FAULT, 7);
    assert_eq!(LoopStatus::NO_GOAL, u64::MAX);
    assert_eq!(visualization_msgs::msg::Marker::DELETEALL, 3);
    // A message's own constant comes before the trait's.
    assert_eq!(Log::INFO, 20);
    assert_eq!(<Log as Message>::INFO.name, "Log");
}

/// Compiles only if goals can be handled without knowing the action.
fn answer<A: Action>(request: A::SendGoalRequest) -> (UUID, A::SendGoalResponse, A::FeedbackMessage) {
    let (goal_id, _goal) = request.into();
    let response = (true, Time { sec: 3, nanosec: 5 }).into();
    (goal_id, response, (goal_id, A::Feedback::default()).into())
}

#[test]
fn actions_can_be_served_generically() {
    let goal_id = UUID { uuid: [7; 16] };
    let request = (goal_id, <DeliverPart as Action>::Goal::default()).into();
    let (found, response, feedback) = answer::<DeliverPart>(request);
    assert_eq!(found, goal_id);
    assert_eq!(feedback.goal_id, goal_id);
    assert!(response.accepted);
    assert_eq!(response.stamp.sec, 3);
}
