//! The command line of a node's own executable, and of `feeder node NAME`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;
use clap::error::ErrorKind;

use crate::args::RosArgs;
use crate::dds::{Domain, NodeName};
use crate::launch::{Seat, parameters, run_in_loop, run_remapped};
use crate::lockstep::{LoopContract, RunError};
use crate::logging::{LogSettings, start_logging};
use crate::memory::bound_memory;
use crate::node::{FeederNode, NodeError};

/// Options of a node.
#[derive(Debug, Parser)]
struct Options {
    /// Scenario, or plan that `feeder up` wrote (YAML); without it the built-in scenario holds
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Which of the run's nodes of this kind to be, by its namespace, instead of the first
    #[arg(long)]
    namespace: Option<String>,
    /// Take part in the simulated run of this contract (JSON), as `feeder up` writes it; without it the node keeps to
    /// the wall clock, and hears, serves and calls whoever is on the ROS graph
    #[arg(long = "loop", value_name = "FILE")]
    contract: Option<PathBuf>,
    /// Leave a fingerprint of what was published in this folder
    #[arg(long, value_name = "DIR", requires = "contract")]
    digest_dir: Option<PathBuf>,
    /// Hand over what was published to the recorder that listens at this socket
    #[arg(long, value_name = "SOCKET", requires = "contract")]
    record_to: Option<PathBuf>,
}

/// Finds a node's configuration and the namespace it lives in: in the file given, or where it is found without one, and
/// for the namespace given, or the first.
pub type LoadConfig<C, E> = fn(Option<&Path>, Option<&str>) -> Result<(String, C), E>;

/// The whole `main` of the executable of node `N`, which `load` configures.
#[must_use]
pub fn main<N: FeederNode, E: std::error::Error + Send + Sync + 'static>(load: LoadConfig<N::Config, E>) -> ExitCode {
    main_with::<N, E>(load, std::env::args_os().skip(1).collect())
}

/// Runs node `N` with these arguments, the program's name left out.
#[must_use]
pub fn main_with<N: FeederNode, E: std::error::Error + Send + Sync + 'static>(
    load: LoadConfig<N::Config, E>,
    arguments: Vec<OsString>,
) -> ExitCode {
    bound_memory();
    let words = arguments.into_iter().map(|argument| argument.to_string_lossy().into_owned());
    let ros = match RosArgs::parse(words) {
        Ok(ros) => ros,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::FAILURE;
        }
    };
    let program = std::iter::once(N::NAME.to_owned());
    let options = match Options::try_parse_from(program.chain(ros.rest.iter().cloned())) {
        Ok(options) => options,
        Err(error) => {
            // Nothing is left to do when even the usage message cannot be shown.
            let _ = error.print();
            if error.kind() == ErrorKind::DisplayHelp {
                let config = load(None, None).ok().map(|(_, config)| config);
                print!("{}", ros_help::<N>(config.as_ref()));
            }
            return if error.use_stderr() { ExitCode::FAILURE } else { ExitCode::SUCCESS };
        }
    };
    // The node's log level may be given by its name, which its namespace belongs to, which may not be found.
    let found = load(options.config.as_deref(), options.namespace.as_deref()).map_err(NodeError::new);
    match run::<N>(found, options, &ros) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{}: {error}", N::NAME);
            ExitCode::FAILURE
        }
    }
}

/// What may stand behind `--ros-args`, and the node's parameters with their values in the configuration it has without a
/// file; a node that the built-in run lacks has none to show.
fn ros_help<N: FeederNode>(config: Option<&N::Config>) -> String {
    let mut help = "\nROS arguments, behind --ros-args:
  -r, --remap FROM:=TO      -p, --param NAME:=VALUE     --params-file FILE
  --log-level [NAME:=]LEVEL --disable-stdout-logs       --disable-rosout-logs
"
    .to_owned();
    let declared = config.and_then(|config| parameters::<N>(config).ok()).unwrap_or_default();
    if !declared.is_empty() {
        help += "\nParameters, with their values in the built-in scenario (* can be set while the node runs):\n";
    }
    for declaration in declared {
        let live = if declaration.read_only { ' ' } else { '*' };
        let meaning = declaration.description.split_whitespace().collect::<Vec<_>>().join(" ");
        help += &format!("{live} {} = {}\n      {meaning}\n", declaration.name, declaration.default);
    }
    help
}

fn run<N: FeederNode>(
    found: Result<(String, N::Config), NodeError>,
    options: Options,
    ros: &RosArgs,
) -> Result<(), RunError> {
    let level = found.as_ref().ok().and_then(|(namespace, _)| {
        let name = NodeName::new(namespace, N::NAME).and_then(|name| ros.node_name(&name)).ok()?;
        ros.log_level_of(&name)
    });
    start_logging(LogSettings { level: level.or(ros.log_level), no_stdout: ros.no_stdout, no_rosout: ros.no_rosout });
    let (namespace, config) = found.map_err(RunError::Node)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|error| RunError::Node(NodeError::new(error)))?;
    }
    let domain = Domain::from_env()?;
    let Some(contract) = options.contract else {
        return run_remapped::<N>(&domain, &namespace, ros, &config, &stop);
    };
    if ros.changes_anything() {
        let reason = "in a run of feeder up names and parameters are the plan's: no --remap, --param, --params-file";
        return Err(RunError::Node(NodeError::new(reason)));
    }
    let seat = Seat {
        contract: Arc::new(read_contract(&contract).map_err(RunError::Node)?),
        namespace,
        domain,
        hub: None,
        digest_dir: options.digest_dir,
        record_to: options.record_to,
        stop,
    };
    run_in_loop::<N>(&seat, &config)
}

fn read_contract(file: &std::path::Path) -> Result<LoopContract, NodeError> {
    let failed = |error: &dyn std::fmt::Display| NodeError::new(format!("{}: {error}", file.display()));
    let bytes = std::fs::read(file).map_err(|error| failed(&error))?;
    serde_json::from_slice(&bytes).map_err(|error| failed(&error))
}
