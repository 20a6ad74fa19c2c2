//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<overhead_manipulator::OverheadManipulator, _>(feeder_scenario::plan::load_node)
}
