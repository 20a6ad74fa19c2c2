//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<courier_driver::CourierDriver, _>(feeder_scenario::plan::load_node)
}
