//! The `feeder-lab` command as the tests run it.

fn main() -> std::process::ExitCode {
    feeder_lab::main()
}
