//! What is written, typed by somebody who has a fresh clone, Rust, a C compiler and nothing else: once for each release.
//!
//! `cargo test -p feeder_tests --test suite release:: -- --ignored --nocapture` takes an hour or two. With
//! `PAGES="docs/paper.md docs/tutorial"` it types the pages that begin so, and those outside the tutorial with the commands
//! of this build.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use feeder_runtime::testing::TestDomain;
use tempfile::TempDir;

use crate::common::put_commands;
use crate::docs::{CLEAN, LIVE, Page, RELEASE, ROOT, TRIED, page, pages};

/// One after another in one shell, as a beginner types them.
const IN_ONE_SHELL: &[&str] = &[
    "docs/tutorial/1_first_run.md",
    "docs/tutorial/3_record_and_replay.md",
    "docs/tutorial/4_own_part.md",
    "docs/tutorial/5_own_waveform.md",
    "README.md",
];
/// How long what has no end of its own is let run before Ctrl-C.
const LIVE_S: u32 = 40;
/// What a machine needs to reach a package registry.
const NETWORK: &[&str] = &["PROXY", "SSL_CERT", "PIP_", "CARGO_HTTP_", "CARGO_NET_", "CARGO_SOURCE_", "CARGO_REGISTR"];

/// Somebody's machine on the first day.
struct Desk {
    home: TempDir,
    domain: TestDomain,
    /// Folders with commands that come before those of the system.
    path: Vec<PathBuf>,
}

impl Desk {
    /// With an empty home, a clone of the last commit, and the registry's cache, so that crates come from there.
    fn new() -> Self {
        let home = tempfile::tempdir().unwrap();
        let cargo_home = home.path().join(".cargo");
        std::fs::create_dir(&cargo_home).unwrap();
        let outer = std::env::var_os("CARGO_HOME").map(PathBuf::from);
        let outer = outer.or_else(|| std::env::home_dir().map(|home| home.join(".cargo"))).unwrap();
        if outer.join("registry").is_dir() {
            std::os::unix::fs::symlink(outer.join("registry"), cargo_home.join("registry")).unwrap();
        }
        let toolchain = Path::new(env!("CARGO")).parent().unwrap().to_owned();
        let desk = Self { home, domain: TestDomain::claim(), path: vec![toolchain] };
        let cloned = Command::new("git").args(["clone", "--quiet", ROOT]).arg(desk.clone()).status().unwrap();
        assert!(cloned.success());
        desk
    }

    fn clone(&self) -> PathBuf {
        self.home.path().join("feeder")
    }

    /// Types a script and tells how long each block took.
    ///
    /// # Errors
    /// What was said last before a command failed.
    fn types(&self, script: &str) -> Result<(), String> {
        let log = self.home.path().join("log");
        let mut path: Vec<String> = self.path.iter().map(|folder| folder.display().to_string()).collect();
        path.push("/usr/bin:/bin".to_owned());
        let network = std::env::vars_os().filter(|(name, _)| {
            let name = name.to_string_lossy().to_uppercase();
            NETWORK.iter().any(|part| name.contains(part))
        });
        let ended = Command::new("bash")
            .args(["-eu", "-o", "pipefail", "-c", script])
            .current_dir(self.clone())
            .env_clear()
            .envs(network)
            .env("HOME", self.home.path())
            .env("CARGO_HOME", self.home.path().join(".cargo"))
            .env("PATH", path.join(":"))
            .env("LANG", "C.UTF-8")
            .env("ROS_DOMAIN_ID", self.domain.id.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env("LOG", &log)
            .stdin(Stdio::null())
            .status()
            .unwrap();
        if ended.success() {
            return Ok(());
        }
        let said = std::fs::read(&log).unwrap_or_default();
        let said = String::from_utf8_lossy(&said);
        let last: Vec<&str> = said.lines().rev().take(40).collect();
        Err(last.into_iter().rev().collect::<Vec<_>>().join("\n"))
    }
}

/// The blocks of a page that are to be typed, as a script that says after each how long it took.
fn script(page: &Page) -> String {
    let mut script = String::new();
    for (words, text) in &page.blocks {
        let (language, rest) = words.split_once(' ').unwrap_or((words, ""));
        let line = format!("{}: {}", page.path.display(), text.lines().next().unwrap_or_default());
        let line = shlex::try_quote(&line).unwrap().into_owned();
        let typed = match words.as_str() {
            TRIED | CLEAN | RELEASE => text.clone(),
            LIVE => format!(
                "timeout --signal=INT --preserve-status {LIVE_S} bash -euc {}\n",
                shlex::try_quote(text).unwrap()
            ),
            // What the page says to save under this name.
            _ if language != "sh" && rest.contains('.') => {
                writeln!(script, "cat > {rest} <<'END_OF_FILE'\n{text}END_OF_FILE").unwrap();
                continue;
            }
            _ => continue,
        };
        writeln!(script, "echo {line} >> $LOG\nBEGAN=$(date +%s%N)").unwrap();
        writeln!(script, "{typed}printf '%8d.%d s  %s\\n' $((($(date +%s%N) - BEGAN) / 1000000000)) \\\n  $((($(date +%s%N) - BEGAN) / 100000000 % 10)) {line} >&3").unwrap();
    }
    script
}

/// What is said goes to a file, the times to the terminal.
fn whole(scripts: &str) -> String {
    format!("exec 3>&1 >>\"$LOG\" 2>&1\n{scripts}")
}

/// The scenarios of the clone where a reader of the other pages has his own, and the built-in one as `cell.yaml`.
const SCENARIOS: &str = "git clean -qfdx -e target\ncp -r launch_configs/*.yaml launch_configs/{models,parts,plants} .\ncp default.yaml cell.yaml\n";

#[test]
#[ignore = "an hour or two, once for each release"]
fn all_that_is_written_works_in_a_fresh_clone() {
    let asked = std::env::var("PAGES").ok();
    let is_asked = |path: &Path| {
        asked.as_ref().is_none_or(|asked| asked.split(' ').any(|start| path.to_str().unwrap().starts_with(start)))
    };
    let mut desk = Desk::new();
    let first: Vec<&Path> = IN_ONE_SHELL.iter().map(Path::new).collect();
    let beginner: String = first.iter().filter(|path| is_asked(path)).map(|path| script(&page(path))).collect();
    let mut failed: Vec<String> = Vec::new();
    if !beginner.is_empty() {
        failed.extend(desk.types(&whole(&beginner)).err());
    }
    let commands = if asked.is_none() {
        desk.clone().join("target/release")
    } else {
        let folder = desk.home.path().join("bin");
        std::fs::create_dir(&folder).unwrap();
        put_commands(&folder);
        folder
    };
    desk.path.insert(0, commands);
    for page in pages().iter().filter(|page| is_asked(&page.path) && !first.contains(&page.path.as_path())) {
        let script = script(page);
        if script.contains("BEGAN") {
            failed.extend(desk.types(&whole(&(SCENARIOS.to_owned() + &script))).err());
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n\n"));
}
