//! `~/get_type_description`: what a type consists of, for tools that have only its name and hash (REP-2016).

use minifactory_msgs::type_description_interfaces::msg::{TypeDescription, TypeSource};
use minifactory_msgs::type_description_interfaces::srv::{
    GetTypeDescription, GetTypeDescriptionRequest, GetTypeDescriptionResponse,
};
use minifactory_msgs::{TYPES, TypeInfo};

use crate::dds::{DdsError, Participant, Server};

/// Offers the descriptions of all types this crate knows.
pub(crate) fn serve(participant: &Participant) -> Result<Server, DdsError> {
    let name = format!("{}/get_type_description", participant.node());
    participant.serve::<GetTypeDescription>(&name, |request| {
        let (description, sources) = match describe(&request) {
            Ok(found) => found,
            Err(failure_reason) => {
                return GetTypeDescriptionResponse { successful: false, failure_reason, ..Default::default() };
            }
        };
        GetTypeDescriptionResponse {
            successful: true,
            failure_reason: String::new(),
            type_description: description,
            type_sources: sources,
            extra_information: Vec::new(),
        }
    })
}

fn describe(request: &GetTypeDescriptionRequest) -> Result<(TypeDescription, Vec<TypeSource>), String> {
    let name = &request.type_name;
    let Some(info) = TYPES.iter().find(|info| info.ros_type() == *name) else {
        return Err(format!("type {name:?} is not known here"));
    };
    if request.type_hash != info.type_hash {
        return Err(format!("type {name} has the hash {} here, not {:?}", info.type_hash, request.type_hash));
    }
    let description = info.describe();
    let sources = if request.include_type_sources { sources(info) } else { Vec::new() };
    Ok((description, sources))
}

/// The definitions of a type and of all it refers to. A type that is derived from a service or an action has none of
/// its own, which ROS 2 calls implicit.
fn sources(info: &TypeInfo) -> Vec<TypeSource> {
    let heading = format!("{}\nMSG: ", "=".repeat(80));
    let mut parts = info.definition.split(heading.as_str());
    let own = parts.next().unwrap_or_default();
    let derived = info.namespace != "msg" && info.name.contains('_');
    let (encoding, contents) = if derived { ("implicit", "") } else { (info.namespace, own) };
    let source = |type_name: String, encoding: &str, contents: &str| TypeSource {
        type_name,
        encoding: encoding.to_owned(),
        raw_file_contents: contents.to_owned(),
    };
    let mut sources = vec![source(info.ros_type(), encoding, contents)];
    for part in parts {
        let (short, contents) = part.split_once('\n').unwrap_or((part, ""));
        let (package, name) = short.split_once('/').unwrap_or(("", short));
        // Of derived types only their parts are stated: goal, result and feedback.
        if let Some(known) = TYPES.iter().find(|known| known.package == package && known.name == name) {
            let implicit = known.namespace != "msg";
            let (encoding, contents) = if implicit { ("implicit", "") } else { ("msg", contents) };
            sources.push(source(known.ros_type(), encoding, contents));
        }
    }
    sources
}

#[cfg(test)]
mod tests {
    use super::*;
    use minifactory_msgs::type_description_interfaces::msg::FieldType;
    use minifactory_msgs::{Action, Message, Service, action::DeliverPart, msg::Waveform, srv::Pick};

    fn asked(info: &TypeInfo, include_type_sources: bool) -> (TypeDescription, Vec<TypeSource>) {
        let (type_name, type_hash) = (info.ros_type(), info.type_hash.to_owned());
        describe(&GetTypeDescriptionRequest { type_name, type_hash, include_type_sources }).unwrap()
    }

    #[test]
    fn a_message_is_described_with_all_it_refers_to() {
        let (description, sources) = asked(&Waveform::INFO, true);
        assert_eq!(description.type_description.type_name, "minifactory_msgs/msg/Waveform");
        let field = |name: &str| {
            let fields = &description.type_description.fields;
            fields.iter().find(|field| field.name == name).unwrap_or_else(|| panic!("no {name}")).r#type.clone()
        };
        assert_eq!(field("sequence").type_id, FieldType::FIELD_TYPE_UINT32);
        assert_eq!(field("segments").type_id, FieldType::FIELD_TYPE_NESTED_TYPE_UNBOUNDED_SEQUENCE);
        assert_eq!(field("segments").nested_type_name, "minifactory_msgs/msg/WaveformSegment");
        let referenced: Vec<_> =
            description.referenced_type_descriptions.iter().map(|known| known.type_name.as_str()).collect();
        let expected = ["builtin_interfaces/msg/Time", "minifactory_msgs/msg/WaveformSegment", "std_msgs/msg/Header"];
        assert_eq!(referenced, expected);
        let names: Vec<_> = sources.iter().map(|source| source.type_name.as_str()).collect();
        assert_eq!(names[0], "minifactory_msgs/msg/Waveform");
        assert_eq!(names[1..], expected);
        assert!(sources.iter().all(|source| source.encoding == "msg" && !source.raw_file_contents.is_empty()));
        assert!(sources[2].raw_file_contents.contains("float64"), "{sources:?}");
        assert!(asked(&Waveform::INFO, false).1.is_empty());
    }

    #[test]
    fn what_is_derived_has_no_source_of_its_own() {
        let (description, sources) = asked(&Pick::INFO, true);
        let referenced: Vec<_> =
            description.referenced_type_descriptions.iter().map(|known| &known.type_name).collect();
        assert!(referenced.iter().any(|name| *name == "minifactory_msgs/srv/Pick_Event"), "{referenced:?}");
        assert_eq!(sources[0].encoding, "srv");
        assert!(sources[0].raw_file_contents.contains("---\n"));
        let (_, sources) = asked(&<DeliverPart as Action>::FeedbackMessage::INFO, true);
        assert_eq!((sources[0].encoding.as_str(), sources[0].raw_file_contents.as_str()), ("implicit", ""));
    }

    #[test]
    fn every_type_can_be_asked_for() {
        for info in TYPES {
            let (description, sources) = asked(info, true);
            assert_eq!(description.type_description.type_name, info.ros_type());
            assert_eq!(sources[0].type_name, info.ros_type());
        }
    }

    #[test]
    fn other_names_and_hashes_are_refused() {
        let request = |type_name: &str, type_hash: &str| {
            let (type_name, type_hash) = (type_name.to_owned(), type_hash.to_owned());
            describe(&GetTypeDescriptionRequest { type_name, type_hash, include_type_sources: true }).unwrap_err()
        };
        assert!(request("std_msgs/msg/Nothing", "").contains("\"std_msgs/msg/Nothing\" is not known"));
        assert!(request("std_msgs/msg/Header", "RIHS01_00").contains("not \"RIHS01_00\""));
    }
}
