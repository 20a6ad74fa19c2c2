//! Parameter services over real DDS.

use std::{
    collections::BTreeMap,
    sync::{Arc, mpsc},
    time::Duration,
};

use crate::common::participant;
use feeder_runtime::{
    dds::{Participant, Qos},
    parameters::{Declaration, ParameterServer, Range, Store, Value},
    testing::TestDomain,
};
use minifactory_msgs::{
    Message, Service,
    builtin_interfaces::msg::Time,
    rcl_interfaces::{
        msg::{Parameter, ParameterEvent, SetParametersResult},
        srv::{
            DescribeParameters, DescribeParametersRequest, GetParameterTypes, GetParameterTypesRequest, GetParameters,
            GetParametersRequest, ListParameters, ListParametersRequest, SetParameters, SetParametersAtomically,
            SetParametersAtomicallyRequest, SetParametersRequest,
        },
    },
};

const PATIENCE: Duration = Duration::from_secs(20);
const STAMP: Time = Time { sec: 1, nanosec: 2 };

/// A node whose `low` must stay below its `high`.
fn serve(participant: &Participant) -> ParameterServer {
    let number = |name: &str, value| {
        Declaration::new(name, Value::Double(value), "A bound").range(Range::Double { from: 0.0, to: 10.0, step: 0.0 })
    };
    let declarations = [
        number("low", 1.0),
        number("high", 5.0).constraints("above low"),
        Declaration::new("seed", Value::Integer(7), "Seed").read_only(),
    ];
    let store = Store::new(declarations).expect("sound");
    let mut bounds = BTreeMap::from([("low".to_owned(), 1.0), ("high".to_owned(), 5.0)]);
    let accept = move |changes: &[(String, Value)]| {
        let mut wanted = bounds.clone();
        for (name, value) in changes {
            if let Value::Double(value) = value {
                wanted.insert(name.clone(), *value);
            }
        }
        if wanted["low"] >= wanted["high"] {
            return Err("low must be below high".to_owned());
        }
        bounds = wanted;
        Ok(())
    };
    ParameterServer::new(participant, store, Arc::new(|| STAMP), accept).expect("a server")
}

fn call<S: Service>(asking: &Participant, service: &str, request: &S::Request) -> S::Response {
    let client = asking.service_client::<S>(&format!("/test/node/{service}")).expect("a client");
    client.call(request, PATIENCE).wait().expect("an answer")
}

fn parameter(name: &str, value: &Value) -> Parameter {
    Parameter { name: name.to_owned(), value: value.to_message() }
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn failed(reason: &str) -> SetParametersResult {
    SetParametersResult { successful: false, reason: reason.to_owned() }
}

#[test]
fn parameters_are_listed_read_described_and_set() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "node"));
    let server = serve(&answering);

    let list = call::<ListParameters>(&asking, "list_parameters", &ListParametersRequest::default());
    assert_eq!(list.result.names, ["high", "low", "seed"]);
    let request = GetParametersRequest { names: names(&["seed", "nothing", "low"]) };
    let values = call::<GetParameters>(&asking, "get_parameters", &request).values;
    assert_eq!(
        values.into_iter().map(Value::from_message).collect::<Vec<_>>(),
        [Some(Value::Integer(7)), None, Some(Value::Double(1.0))]
    );
    let request = GetParameterTypesRequest { names: names(&["low", "nothing"]) };
    assert_eq!(call::<GetParameterTypes>(&asking, "get_parameter_types", &request).types, [3, 0]);
    let request = DescribeParametersRequest { names: names(&["high", "seed"]) };
    let described = call::<DescribeParameters>(&asking, "describe_parameters", &request).descriptors;
    assert_eq!((described[0].additional_constraints.as_str(), described[0].read_only), ("above low", false));
    assert_eq!((described[0].floating_point_range[0].to_value, described[1].read_only), (10.0, true));

    let parameters = vec![
        parameter("low", &Value::Double(2.0)),
        parameter("low", &Value::Double(6.0)),
        parameter("low", &Value::Double(-1.0)),
        parameter("low", &Value::Integer(2)),
        parameter("seed", &Value::Integer(8)),
        parameter("nothing", &Value::Bool(true)),
        Parameter { name: "low".to_owned(), ..Default::default() },
    ];
    let results = call::<SetParameters>(&asking, "set_parameters", &SetParametersRequest { parameters }).results;
    let expected = [
        SetParametersResult { successful: true, reason: String::new() },
        failed("low must be below high"),
        failed("parameter low: -1.0 is not in 0.0 … 10.0"),
        failed("parameter low: 2 is not a double (write 1.0, not 1)"),
        failed("parameter seed is read-only: it can be set at the start of the node"),
        failed("parameter nothing is not declared"),
        failed("parameter low cannot be deleted: it is declared"),
    ];
    assert_eq!(results, expected);
    assert_eq!(server.get("low"), Some(Value::Double(2.0)));
}

#[test]
fn atomic_sets_are_all_or_nothing_and_every_change_is_told() {
    let domain = TestDomain::claim();
    let (asking, answering) = (participant(&domain, "asking"), participant(&domain, "node"));
    let (sender, events) = mpsc::channel::<ParameterEvent>();
    let deliver = move |sample: feeder_runtime::dds::Sample| {
        sender.send(sample.decode().expect("an event")).expect("the test waits");
    };
    let _reader = asking
        .reader("/parameter_events", &ParameterEvent::INFO.dds_type(), &Qos::command(), deliver)
        .expect("a reader");
    let server = serve(&answering);
    let set = |parameters| {
        let request = SetParametersAtomicallyRequest { parameters };
        call::<SetParametersAtomically>(&asking, "set_parameters_atomically", &request).result
    };
    let both = |low, high| vec![parameter("low", &Value::Double(low)), parameter("high", &Value::Double(high))];
    // Neither order of two single sets would be allowed all the way.
    assert!(set(both(6.0, 9.0)).successful);
    assert_eq!(set(both(3.0, 11.0)), failed("parameter high: 11.0 is not in 0.0 … 10.0"));
    assert_eq!(set(both(9.0, 8.0)), failed("low must be below high"));
    assert_eq!((server.get("low"), server.get("high")), (Some(Value::Double(6.0)), Some(Value::Double(9.0))));
    server.set("low", Value::Double(0.5)).expect("allowed");
    assert_eq!(server.set("low", Value::Double(9.5)), Err("low must be below high".to_owned()));

    // The declarations may have been told before the reader was found.
    let mut changes = events.iter().filter(|event| event.new_parameters.is_empty());
    let first = changes.next().expect("an event");
    assert_eq!((first.node.as_str(), first.stamp, first.changed_parameters), ("/test/node", STAMP, both(6.0, 9.0)));
    let second = changes.next().expect("an event");
    assert_eq!(second.changed_parameters, [parameter("low", &Value::Double(0.5))]);
}
