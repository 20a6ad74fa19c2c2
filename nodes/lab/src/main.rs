//! The `feeder-lab` command.

fn main() -> std::process::ExitCode {
    feeder_lab::main()
}
