//! The process's log: to the terminal, and by `/rosout` to the graph.

use std::sync::OnceLock;

use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Registry, reload};

use crate::args::LogLevel;
use crate::rosout::RosoutLayer;

/// What the DDS library reports as errors are mostly peers that come and go.
const DDS_FILTER: &str = "rustdds=off,ros2_client=off,mio=off";

/// How a process logs.
#[derive(Debug, Clone, Copy, Default)]
pub struct LogSettings {
    /// From which gravity on, where `RUST_LOG` says nothing; info where none is given.
    pub level: Option<LogLevel>,
    /// Not to the terminal.
    pub no_stdout: bool,
    /// Not to `/rosout`.
    pub no_rosout: bool,
}

struct Log {
    rosout: Option<RosoutLayer>,
    filter: reload::Handle<EnvFilter, Registry>,
}

static LOG: OnceLock<Log> = OnceLock::new();

/// Sends log messages to standard error, and those of nodes to `/rosout`: those that `RUST_LOG` chooses, else those of
/// the given level and graver. To be called once, by `main`.
pub fn start_logging(settings: LogSettings) {
    let given = || filter(settings.level.unwrap_or(LogLevel::Info));
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| given());
    let (filter, handle) = reload::Layer::new(filter);
    let terminal =
        (!settings.no_stdout).then(|| tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_target(false));
    let rosout = (!settings.no_rosout).then(RosoutLayer::new);
    let log = LOG.get_or_init(|| Log { rosout: rosout.clone(), filter: handle });
    tracing_subscriber::registry().with(filter).with(terminal).with(log.rosout.clone()).init();
}

fn filter(level: LogLevel) -> EnvFilter {
    // The terminal knows nothing graver than an error.
    let word = if level == LogLevel::Fatal { LogLevel::Error } else { level }.word();
    EnvFilter::new(format!("{word},{DDS_FILTER}"))
}

/// Where nodes send what they log, once logging has been started.
pub(crate) fn rosout() -> Option<&'static RosoutLayer> {
    LOG.get().and_then(|log| log.rosout.as_ref())
}

/// From which gravity on messages are logged now.
pub(crate) fn level() -> LogLevel {
    let hint = LOG.get().and_then(|log| log.filter.with_current(EnvFilter::max_level_hint).ok()).flatten();
    match hint {
        None | Some(LevelFilter::INFO) => LogLevel::Info,
        Some(LevelFilter::WARN) => LogLevel::Warn,
        Some(LevelFilter::ERROR | LevelFilter::OFF) => LogLevel::Error,
        Some(_) => LogLevel::Debug,
    }
}

/// Logs from another gravity on.
///
/// # Errors
/// When this process does not log.
pub(crate) fn set_level(wanted: LogLevel) -> Result<(), String> {
    if wanted == level() {
        return Ok(());
    }
    let log = LOG.get().ok_or("this process does not log")?;
    log.filter.reload(filter(wanted)).map_err(|error| error.to_string())
}
