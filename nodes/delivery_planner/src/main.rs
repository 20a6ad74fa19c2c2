//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<delivery_planner::DeliveryPlanner, _>(feeder_scenario::plan::load_node)
}
