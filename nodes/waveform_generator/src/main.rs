//! The executable of the node.

fn main() -> std::process::ExitCode {
    feeder_runtime::main::<waveform_generator::WaveformGenerator, _>(feeder_scenario::plan::load_node)
}
