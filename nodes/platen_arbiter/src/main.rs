//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<platen_arbiter::PlatenArbiter, _>(feeder_scenario::plan::load_node)
}
