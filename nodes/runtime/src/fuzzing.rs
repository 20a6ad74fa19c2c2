//! Every decoder of bytes or text from outside, by name, for fuzzers: none may panic, hang, or take memory out of
//! proportion to its input, whatever that is. The package of
//! the tests adds the decoders of the other rooms.

use std::io;

use minifactory_msgs::msg::LoopBundle;

use crate::args::{NameKind, RosArgs};
use crate::dds::{self, NodeName};
use crate::lockstep::{Engine, LoopContract, LoopTiming};
use crate::{cdr, node};

/// Takes any input and returns.
pub type Target = fn(&[u8]);

/// All targets, by name.
pub const TARGETS: &[(&str, Target)] = &[
    ("announcement", dds::fuzz_announcement),
    ("bundle", bundle),
    ("params_file", params_file),
    ("ros_args", ros_args),
    ("wire", dds::fuzz_wire),
];

/// A bundle of the loop, as the node `b` gets it from `a`.
fn bundle(input: &[u8]) {
    let Ok(bundle) = cdr::decode::<LoopBundle>(input, true) else { return };
    let ports = [("a", crate::node::PortKind::Publish), ("b", node::PortKind::Subscribe(node::Latency::Forward))];
    let nodes = ports.map(|(name, kind)| {
        let port = node::Port {
            kind,
            name: "/topic".to_owned(),
            ros_type: String::new(),
            dds_types: Vec::new(),
            qos: dds::Qos::command(),
        };
        (name.to_owned(), node::Interface { ports: vec![port] })
    });
    let timing = LoopTiming { tick_ns: 1, forward_delay_ticks: 1, feedback_delay_ticks: 1, window_ticks: 8 };
    let contract = LoopContract::connect(bundle.run_id, timing, &nodes);
    let Ok(mut engine) = contract.map_err(drop).and_then(|contract| Engine::new(&contract, "b").map_err(drop)) else {
        return;
    };
    for entry in &bundle.entries {
        let _ = node::split_call(&bytes::Bytes::copy_from_slice(&entry.payload));
    }
    let _ = engine.accept_bundle(0, bundle);
    let _ = engine.inputs();
}

/// A parameter file.
fn params_file(input: &[u8]) {
    let text = String::from_utf8_lossy(input).into_owned();
    let arguments = ["--ros-args", "--params-file", "file"].map(str::to_owned);
    use_args(RosArgs::parse_with(arguments, |_| Ok(text.clone())).ok());
}

/// A command line, one argument a line.
fn ros_args(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    let arguments = std::iter::once("--ros-args").chain(text.lines()).map(str::to_owned);
    use_args(RosArgs::parse_with(arguments, |_| Err(io::ErrorKind::NotFound.into())).ok());
}

fn use_args(args: Option<RosArgs>) {
    let (Some(args), Ok(node)) = (args, NodeName::new("/feeder", "courier_driver")) else { return };
    let _ = args.node_name(&node);
    let _ = args.parameters(&node);
    let _ = args.resolve(&node, "~/state", NameKind::Service);
}
