//! The `feeder` command as the tests run it.

fn main() -> std::process::ExitCode {
    feeder::main()
}
