//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<vision_selector::VisionSelector, _>(feeder_scenario::plan::load_node)
}
