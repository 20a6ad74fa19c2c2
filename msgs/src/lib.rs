//! The feeder's ROS 2 interfaces and the standard ones it uses, as Rust types.
//!
//! The types are generated from the definitions in `msg`, `srv`, `action` (this package's own) and `standard`: own types
//! are [`msg`], [`srv`] and [`action`], others lie in modules named after their packages, such as
//! [`sensor_msgs::msg::Image`]. A definition's `Name_Request` is `NameRequest` here. With serde's CDR crates a value's
//! encoding is the one that ROS 2 uses; `char` and `byte` are `u8`, bounds of strings and sequences are not enforced.
//!
//! ```
//! use minifactory_msgs::{Message, geometry_msgs::msg::Quaternion};
//!
//! assert_eq!(Quaternion::INFO.ros_type(), "geometry_msgs/msg/Quaternion");
//! assert_eq!(Quaternion::INFO.dds_type(), "geometry_msgs::msg::dds_::Quaternion_");
//! assert_eq!(Quaternion::default().w, 1.0);
//! ```

pub mod interface;
mod time;

use std::fmt::Debug;

use serde::{Serialize, de::DeserializeOwned};

pub use time::{ns_of_stamp, stamp_of_ns};

use crate::{
    builtin_interfaces::msg::Time,
    type_description_interfaces::msg::{Field, FieldType, IndividualTypeDescription, TypeDescription},
    unique_identifier_msgs::msg::UUID,
};

include!(concat!(env!("OUT_DIR"), "/messages.rs"));

/// What ROS 2 knows about a type beside its fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TypeInfo {
    /// Package, such as `sensor_msgs`.
    pub package: &'static str,
    /// `msg`, `srv` or `action`.
    pub namespace: &'static str,
    /// Name within the namespace, such as `Image`, `SetBool_Request` or `DeliverPart_FeedbackMessage`.
    pub name: &'static str,
    /// Definition, followed by those of all types it refers to, each after a line of 80 `=` and a line
    /// `MSG: package/Name`: the schema that bags carry under the name `ros2msg`.
    pub definition: &'static str,
    /// Type hash of REP-2011, `RIHS01_…`.
    pub type_hash: &'static str,
    /// All types that its fields refer to, directly or not, by name: `package/msg/Name`.
    pub references: &'static [&'static str],
}

/// A field as `type_description_interfaces/msg/FieldType` describes it.
struct FieldInfo {
    name: &'static str,
    type_id: u8,
    capacity: u64,
    string_capacity: u64,
    nested_type_name: &'static str,
}

impl TypeInfo {
    /// Name as ROS 2 tools show it: `sensor_msgs/msg/Image`.
    #[must_use]
    pub fn ros_type(&self) -> String {
        format!("{}/{}/{}", self.package, self.namespace, self.name)
    }

    /// Name as ROS 2 gives it to DDS: `sensor_msgs::msg::dds_::Image_`.
    #[must_use]
    pub fn dds_type(&self) -> String {
        format!("{}::{}::dds_::{}_", self.package, self.namespace, self.name)
    }

    /// What the type consists of, with all it refers to: what its hash is the hash of. Default values are left out.
    #[must_use]
    pub fn describe(&self) -> TypeDescription {
        TypeDescription {
            type_description: describe(&self.ros_type()),
            referenced_type_descriptions: self.references.iter().map(|name| describe(name)).collect(),
        }
    }
}

fn describe(type_name: &str) -> IndividualTypeDescription {
    let known = FIELDS.binary_search_by_key(&type_name, |(name, _)| name);
    let fields = known.map_or(&[][..], |index| FIELDS[index].1);
    let field = |info: &FieldInfo| Field {
        name: info.name.to_owned(),
        r#type: FieldType {
            type_id: info.type_id,
            capacity: info.capacity,
            string_capacity: info.string_capacity,
            nested_type_name: info.nested_type_name.to_owned(),
        },
        default_value: String::new(),
    };
    IndividualTypeDescription { type_name: type_name.to_owned(), fields: fields.iter().map(field).collect() }
}

/// A message: what a topic carries, or one direction of a service.
///
/// A message may have a constant `INFO` of its own (`rcl_interfaces/Log` has), so write `<M as Message>::INFO` where the
/// type is not a parameter.
pub trait Message: Serialize + DeserializeOwned + Clone + Debug + Default + PartialEq + Send + Sync + 'static {
    /// Names, definition and hash.
    const INFO: TypeInfo;
}

/// Something to be done for each message type, for code that knows a type by its name only; see [`visit_messages`].
pub trait MessageVisitor {
    /// Called once for each type.
    fn visit<M: Message>(&mut self);
}

/// A service: a request and its response.
pub trait Service: Send + Sync + 'static {
    /// What the client sends.
    type Request: Message;
    /// What the server answers.
    type Response: Message;
    /// Names, definition and hash of the service itself.
    const INFO: TypeInfo;
}

/// An action: a goal, feedback while it is pursued, and a result.
///
/// What travels are two services and a topic of messages that wrap goal, result and feedback; a wrapper converts from
/// and into its fields, in the order of its definition.
pub trait Action: Send + Sync + 'static {
    /// What is asked for.
    type Goal: Message;
    /// What came out.
    type Result: Message;
    /// How far it is.
    type Feedback: Message;
    /// A goal and the identifier that the client chose for it.
    type SendGoalRequest: Message + From<(UUID, Self::Goal)> + Into<(UUID, Self::Goal)>;
    /// Whether the goal is accepted, and since when.
    type SendGoalResponse: Message + From<(bool, Time)> + Into<(bool, Time)>;
    /// The service `Name_SendGoal`.
    type SendGoal: Service<Request = Self::SendGoalRequest, Response = Self::SendGoalResponse>;
    /// Which goal's result is asked for.
    type GetResultRequest: Message + From<UUID> + Into<UUID>;
    /// How the goal ended, a constant of [`action_msgs::msg::GoalStatus`], and the result.
    type GetResultResponse: Message + From<(i8, Self::Result)> + Into<(i8, Self::Result)>;
    /// The service `Name_GetResult`.
    type GetResult: Service<Request = Self::GetResultRequest, Response = Self::GetResultResponse>;
    /// Feedback, and the goal it belongs to.
    type FeedbackMessage: Message + From<(UUID, Self::Feedback)> + Into<(UUID, Self::Feedback)>;
    /// Names, definition and hash of the action itself.
    const INFO: TypeInfo;
}
