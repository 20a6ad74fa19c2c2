//! The command line of a node's own executable, and of `feeder node NAME`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Parser;

use crate::args::RosArgs;
use crate::dds::{Domain, NodeName};
use crate::launch::{Seat, read_config, run_in_loop, run_remapped};
use crate::lockstep::{LoopContract, RunError};
use crate::logging::{LogSettings, start_logging};
use crate::node::{FeederNode, NodeError};

/// Options of a node.
#[derive(Debug, Parser)]
struct Options {
    /// Scenario file (YAML); without it the built-in scenario holds
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Namespace, instead of the first one the scenario asks for
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

/// The whole `main` of the executable of node `N`.
#[must_use]
pub fn main<N: FeederNode>() -> ExitCode {
    main_with::<N>(std::env::args_os().skip(1).collect())
}

/// Runs node `N` with these arguments, the program's name left out.
#[must_use]
pub fn main_with<N: FeederNode>(arguments: Vec<OsString>) -> ExitCode {
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
            return if error.use_stderr() { ExitCode::FAILURE } else { ExitCode::SUCCESS };
        }
    };
    match run::<N>(options, &ros) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{}: {error}", N::NAME);
            ExitCode::FAILURE
        }
    }
}

fn run<N: FeederNode>(options: Options, ros: &RosArgs) -> Result<(), RunError> {
    let namespace_of = |config: &N::Config| match &options.namespace {
        Some(namespace) => Ok(namespace.clone()),
        None => N::namespaces(config)
            .into_iter()
            .next()
            .ok_or_else(|| NodeError::new(format!("the scenario asks for no {}", N::NAME))),
    };
    // The node's log level may be given by its name, which the configuration says, which may be wrong.
    let config = read_config::<N>(options.config.as_deref());
    let named = config.and_then(|config| namespace_of(&config).map(|namespace| (config, namespace)));
    let level = named.as_ref().ok().and_then(|(_, namespace)| {
        let name = NodeName::new(namespace, N::NAME).and_then(|name| ros.node_name(&name)).ok()?;
        ros.log_level_of(&name)
    });
    start_logging(LogSettings { level: level.or(ros.log_level), no_stdout: ros.no_stdout, no_rosout: ros.no_rosout });
    let (config, namespace) = named.map_err(RunError::Node)?;
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
        let reason =
            "in a run of feeder up names and parameters are the scenario's: no --remap, --param, --params-file";
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
