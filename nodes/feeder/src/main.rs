//! The `feeder` command.

fn main() -> std::process::ExitCode {
    feeder::main()
}
