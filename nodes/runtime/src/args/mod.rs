//! The arguments every ROS 2 node understands: what stands between `--ros-args` and `--`.
//!
//! | Argument | Meaning |
//! |---|---|
//! | `-r`, `--remap [node:]from:=to` | another name for a topic or service; `__node:=`, `__ns:=` for the node itself |
//! | `-p`, `--param [node:]name:=value` | a parameter, its value in YAML |
//! | `--params-file file.yaml` | parameters of one or several nodes |
//! | `--log-level [logger:=]level` | `debug`, `info`, `warn`, `error` or `fatal` |
//! | `--enable-rosout-logs`, `--disable-rosout-logs` | whether the log goes to `/rosout` |
//! | `--enable-stdout-logs`, `--disable-stdout-logs` | whether the log goes to the terminal |
//! | `-e`, `--enclave`, `--log-config-file`, `--enable-external-lib-logs`, `--disable-external-lib-logs` | accepted, since launch files give them; nothing here is encrypted, and there is one kind of log |
//!
//! Of parameters given twice the last one holds. As elsewhere in ROS 2, `y`, `yes` and `on` without quotes are true.

mod params_file;
mod remap;

use std::{collections::BTreeMap, fs, io, path::Path, sync::Arc};

use crate::{
    dds::{DdsError, NodeName, check_absolute},
    parameters::Value,
};
use params_file::Given;
use remap::Rule;

pub use remap::NameKind;

/// How grave a log message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[expect(missing_docs, reason = "the words say it")]
pub enum LogLevel {
    Debug,
    Info,
    Warn,
    Error,
    Fatal,
}

/// Why arguments make no sense.
#[derive(Debug, thiserror::Error)]
pub enum ArgsError {
    /// There is no such argument.
    #[error("unknown argument {argument:?} after --ros-args")]
    Unknown {
        /// The argument.
        argument: String,
    },
    /// An argument needs a value, and there is none.
    #[error("argument {argument} needs a value: {expected}")]
    Missing {
        /// The argument.
        argument: &'static str,
        /// What is expected.
        expected: &'static str,
    },
    /// The value of an argument means nothing.
    #[error("argument {argument} {value:?}: {reason}; expected: {expected}")]
    Value {
        /// The argument.
        argument: &'static str,
        /// Its value.
        value: String,
        /// What is wrong with it.
        reason: String,
        /// What is expected.
        expected: &'static str,
    },
    /// A parameter file cannot be read.
    #[error("parameter file {path}: {source}")]
    File {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// A parameter file has the wrong form.
    #[error("parameter file {path}: {reason}")]
    FileForm {
        /// The file.
        path: String,
        /// What is wrong, and where.
        reason: String,
    },
}

/// A parameter's value, and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenValue {
    /// The value.
    pub value: Value,
    /// The file or the argument that gives it.
    pub source: Arc<str>,
}

/// What the command line says beside a program's own arguments.
#[derive(Debug, Clone, Default)]
pub struct RosArgs {
    rules: Vec<Rule>,
    given: Vec<Given>,
    /// The level of loggers that are not named.
    pub log_level: Option<LogLevel>,
    /// The levels of named loggers: a node's is its full name with dots, such as `feeder.courier_driver`.
    pub logger_levels: BTreeMap<String, LogLevel>,
    /// Whether the log is not to go to `/rosout`.
    pub no_rosout: bool,
    /// Whether the log is not to go to the terminal.
    pub no_stdout: bool,
    /// The program's own arguments.
    pub rest: Vec<String>,
}

const REMAP: &str = "--remap [node:]from:=to";
const PARAM: &str = "--param [node:]name:=value";
const ENCLAVE: &str = "an absolute name such as /feeder/courier_driver";
const LOG_LEVEL: &str = "[logger:=]debug, info, warn, error or fatal";

impl RosArgs {
    /// Takes the ROS arguments out of a command line (without the program's name).
    ///
    /// # Errors
    /// [`ArgsError`] names the argument or file, and what is expected.
    pub fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Self, ArgsError> {
        Self::parse_with(arguments, |path| fs::read_to_string(path))
    }

    pub(crate) fn parse_with(
        arguments: impl IntoIterator<Item = String>,
        read: impl Fn(&Path) -> io::Result<String>,
    ) -> Result<Self, ArgsError> {
        let mut parsed = Self::default();
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            if argument == "--ros-args" {
                parsed.parse_ros(&mut arguments, &read)?;
            } else {
                parsed.rest.push(argument);
            }
        }
        Ok(parsed)
    }

    /// Reads up to `--` or the end.
    fn parse_ros(
        &mut self,
        arguments: &mut impl Iterator<Item = String>,
        read: &impl Fn(&Path) -> io::Result<String>,
    ) -> Result<(), ArgsError> {
        while let Some(argument) = arguments.next() {
            let mut value = |argument, expected| arguments.next().ok_or(ArgsError::Missing { argument, expected });
            match argument.as_str() {
                "--" => return Ok(()),
                "--ros-args" => {}
                "-r" | "--remap" => {
                    let text = value("--remap", REMAP)?;
                    let refuse = |reason| bad("--remap", &text, reason, REMAP);
                    self.rules.push(Rule::parse(&text).map_err(refuse)?);
                }
                "-p" | "--param" => {
                    let text = value("--param", PARAM)?;
                    let refuse = |reason| bad("--param", &text, reason, PARAM);
                    self.given.push(Given::parse(&text).map_err(refuse)?);
                }
                "--params-file" => {
                    let path = value("--params-file", "a YAML file")?;
                    let text =
                        read(Path::new(&path)).map_err(|source| ArgsError::File { path: path.clone(), source })?;
                    let given = params_file::read(&path, &text);
                    self.given.extend(given.map_err(|reason| ArgsError::FileForm { path, reason })?);
                }
                "--log-level" => {
                    let text = value("--log-level", LOG_LEVEL)?;
                    let (logger, level) = text.split_once(":=").map_or((None, text.as_str()), |(l, r)| (Some(l), r));
                    let level = LogLevel::parse(level)
                        .ok_or_else(|| bad("--log-level", &text, format!("{level:?} is no level"), LOG_LEVEL))?;
                    match logger {
                        Some(logger) => _ = self.logger_levels.insert(logger.to_owned(), level),
                        None => self.log_level = Some(level),
                    }
                }
                "--enable-rosout-logs" => self.no_rosout = false,
                "--disable-rosout-logs" => self.no_rosout = true,
                "--enable-stdout-logs" => self.no_stdout = false,
                "--disable-stdout-logs" => self.no_stdout = true,
                "-e" | "--enclave" => {
                    let enclave = value("--enclave", ENCLAVE)?;
                    let refuse = |error: DdsError| bad("--enclave", &enclave, error.to_string(), ENCLAVE);
                    // The root has no name to check.
                    if enclave != "/" {
                        check_absolute("enclave", &enclave).map_err(refuse)?;
                    }
                }
                "--log-config-file" => _ = value("--log-config-file", "a file")?,
                "--enable-external-lib-logs" | "--disable-external-lib-logs" => {}
                _ => return Err(ArgsError::Unknown { argument }),
            }
        }
        Ok(())
    }

    /// The name a node goes by, given the one it has unless told otherwise.
    ///
    /// # Errors
    /// [`DdsError::Name`] when the command line gives an impossible name.
    pub fn node_name(&self, default: &NodeName) -> Result<NodeName, DdsError> {
        let last = |from: &str| self.rules.iter().rev().find(|rule| rule.names_node(from, default)).map(Rule::to);
        let name = last("__node").unwrap_or(default.name());
        NodeName::new(last("__ns").unwrap_or(default.namespace()), name)
    }

    /// The absolute name of a node's topic or service, after remapping: `waveform`, `~/state` (below the node's own
    /// name) or `/clock`.
    ///
    /// # Errors
    /// [`DdsError::Name`] when the name, or the one it is remapped to, is impossible.
    pub fn resolve(&self, node: &NodeName, name: &str, kind: NameKind) -> Result<String, DdsError> {
        remap::resolve(&self.rules, node, name, kind)
    }

    /// The parameters given to a node.
    #[must_use]
    pub fn parameters(&self, node: &NodeName) -> BTreeMap<String, GivenValue> {
        let given = self.given.iter().filter(|given| given.is_for(node));
        given.map(|given| (given.name.clone(), given.given.clone())).collect()
    }

    /// The log level given to a node.
    #[must_use]
    pub fn log_level_of(&self, node: &NodeName) -> Option<LogLevel> {
        let logger = node.to_string().trim_start_matches('/').replace('/', ".");
        self.logger_levels.get(&logger).copied().or(self.log_level)
    }

    /// Whether names are changed or parameters are given.
    #[must_use]
    pub fn changes_anything(&self) -> bool {
        !(self.rules.is_empty() && self.given.is_empty())
    }
}

fn bad(argument: &'static str, value: &str, reason: String, expected: &'static str) -> ArgsError {
    ArgsError::Value { argument, value: value.to_owned(), reason, expected }
}

impl LogLevel {
    /// All levels, from the least grave.
    pub const ALL: [Self; 5] = [Self::Debug, Self::Info, Self::Warn, Self::Error, Self::Fatal];

    /// Its word, as ROS 2 writes it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Debug => "debug",
            Self::Info => "info",
            Self::Warn => "warn",
            Self::Error => "error",
            Self::Fatal => "fatal",
        }
    }

    /// The level of a word, in any case.
    #[must_use]
    pub fn parse(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.word().eq_ignore_ascii_case(word))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FILE: &str = "
/**:
  ros__parameters: {seed: 1, rate_hz: 2.0}
feeder:
  courier_driver:
    ros__parameters:
      rate_hz: 5.0
      limits: {jerk_m_s3: 10.5, axes: [ax, by]}
/other/*:
  ros__parameters: {seed: 9}
";

    fn parse(line: &str) -> Result<RosArgs, ArgsError> {
        RosArgs::parse_with(line.split_whitespace().map(str::to_owned), |path| match path.to_str() {
            Some("good.yaml") => Ok(FILE.to_owned()),
            Some("bad.yaml") => Ok("courier_driver: {ros__parameters: [1]}".to_owned()),
            _ => Err(io::ErrorKind::NotFound.into()),
        })
    }

    fn courier() -> NodeName {
        NodeName::new("/feeder", "courier_driver").expect("good")
    }

    #[test]
    fn ros_arguments_are_taken_out_and_the_rest_is_left() {
        let args = parse(
            "run --fast --ros-args --log-level WARN --log-level a.b:=debug --disable-rosout-logs -- -x --ros-args",
        )
        .expect("good");
        assert_eq!(args.rest, ["run", "--fast", "-x"]);
        assert_eq!(
            (args.log_level, args.logger_levels["a.b"], args.no_rosout),
            (Some(LogLevel::Warn), LogLevel::Debug, true)
        );
    }

    #[test]
    fn nodes_are_renamed() {
        let name = |line: &str| parse(line).expect("good").node_name(&courier()).map(|name| name.to_string());
        assert_eq!(name("").expect("good"), "/feeder/courier_driver");
        assert_eq!(name("--ros-args -r __node:=c -r __ns:=/two").expect("good"), "/two/c");
        assert_eq!(name("--ros-args -r other:__node:=c -r courier_driver:__name:=d").expect("good"), "/feeder/d");
        assert!(name("--ros-args -r __ns:=two").is_err());
    }

    #[test]
    fn topics_and_services_are_remapped() {
        let args = parse(
            "--ros-args -r waveform:=/w -r ~/state:=s -r other:clock:=/no -r rosservice://load:=load_parts -r waveform:=/late",
        )
        .expect("good");
        let resolve = |name: &str, kind| args.resolve(&courier(), name, kind).expect("good");
        assert_eq!(resolve("waveform", NameKind::Topic), "/w");
        assert_eq!(resolve("/feeder/waveform", NameKind::Service), "/w");
        assert_eq!(resolve("~/state", NameKind::Topic), "/feeder/s");
        assert_eq!(resolve("~/other", NameKind::Topic), "/feeder/courier_driver/other");
        assert_eq!(resolve("clock", NameKind::Topic), "/feeder/clock");
        assert_eq!(resolve("load", NameKind::Topic), "/feeder/load");
        assert_eq!(resolve("load", NameKind::Service), "/feeder/load_parts");
        assert!(args.resolve(&courier(), "~state", NameKind::Topic).is_err());
    }

    #[test]
    fn parameters_come_from_files_and_the_command_line_and_the_last_holds() {
        let args = parse("--ros-args --params-file good.yaml -p seed:=3 -p courier_driver:on:=yes -p other:x:=1")
            .expect("good");
        let given: BTreeMap<_, _> =
            args.parameters(&courier()).into_iter().map(|(name, given)| (name, given.value)).collect();
        let expected = [
            ("limits.axes", Value::Texts(vec!["ax".into(), "by".into()])),
            ("limits.jerk_m_s3", Value::Double(10.5)),
            ("on", Value::Bool(true)),
            ("rate_hz", Value::Double(5.0)),
            ("seed", Value::Integer(3)),
        ];
        assert_eq!(given, expected.map(|(name, value)| (name.to_owned(), value)).into());
        let other = NodeName::new("/other", "x").expect("good");
        let args = parse("--ros-args -p seed:=3 --params-file good.yaml").expect("good");
        let seed = &args.parameters(&other)["seed"];
        assert_eq!((&seed.value, &*seed.source), (&Value::Integer(9), "good.yaml"));
    }

    #[test]
    fn what_launch_files_add_is_accepted() {
        let args = parse("--ros-args -e /feeder/a --enclave / --log-config-file log.ini --disable-external-lib-logs --disable-stdout-logs --log-level feeder.courier_driver:=error --log-level debug")
            .expect("good");
        assert!(args.no_stdout && !args.changes_anything());
        assert_eq!(args.log_level_of(&courier()), Some(LogLevel::Error));
        let other = NodeName::new("/", "other").expect("good");
        assert_eq!(args.log_level_of(&other), Some(LogLevel::Debug));
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_name() {
        for (line, says) in [
            ("--ros-args --speed 3", "--speed"),
            ("--ros-args -r", "--remap needs a value"),
            ("--ros-args -r a=b", "a=b"),
            ("--ros-args -r :=b", ":=b"),
            ("--ros-args -p rate", "--param \"rate\""),
            ("--ros-args -p rate:=[1,", "--param \"rate:=[1,\""),
            ("--ros-args -p rate:={a:1}", "--param"),
            ("--ros-args -p rate:=[1,a]", "one type"),
            ("--ros-args --log-level loud", "\"loud\" is no level"),
            ("--ros-args -e feeder", "--enclave \"feeder\""),
            ("--ros-args --log-config-file", "--log-config-file needs a value"),
            ("--ros-args --params-file none.yaml", "none.yaml"),
            ("--ros-args --params-file bad.yaml", "bad.yaml"),
        ] {
            let message = parse(line).expect_err(line).to_string();
            assert!(message.contains(says), "{line}: {message}");
        }
    }

    proptest! {
        #[test]
        fn no_line_panics(words in prop::collection::vec("(--ros-args|-r|-p|--params-file|--log-level|--|[a-z_:=~/*{}\\[\\],. ]{0,12}|good.yaml)", 0..8)) {
            if let Ok(args) = RosArgs::parse_with(words, |_| Ok(FILE.to_owned())) {
                let _ = args.node_name(&courier());
                let _ = args.parameters(&courier());
                let _ = args.resolve(&courier(), "waveform", NameKind::Topic);
            }
        }
    }
}
