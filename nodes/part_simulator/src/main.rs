//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<part_simulator::PartSimulator, _>(feeder_scenario::plan::load_node)
}
