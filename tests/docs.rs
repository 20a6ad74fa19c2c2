//! What is written for people: links lead somewhere, commands are of this version, and what a tutorial says to type works.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::{Command, Stdio};

use clap::error::ErrorKind;
use feeder_runtime::testing::TestDomain;
use pulldown_cmark::{CodeBlockKind, Event, Options, Parser, Tag, TagEnd};

use crate::common::{feeder, lab, put_commands};

pub(crate) const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// What a visitor reads in a minute.
const README_BYTES_MAX: usize = 6 * 1024;
/// Blocks of these words are typed as they stand, one after another, in a folder where the clone's folders are.
pub(crate) const TRIED: &str = "sh run";
/// Typed once for each release, in a fresh clone: what builds, and what a page begins with.
pub(crate) const CLEAN: &str = "sh clean";
/// Typed once for each release, because it takes long or needs the release build.
pub(crate) const RELEASE: &str = "sh release";
/// Typed once for each release, and ended with Ctrl-C.
pub(crate) const LIVE: &str = "sh live";
/// Not typed; [CONTRIBUTING](../docs/CONTRIBUTING.md) says why.
const NOT_TYPED: &[&str] = &["sh suite", "sh ros2", "sh hosts", "sh own"];
/// Folders of the clone that a page may use; all else that it writes is its own.
const CLONE: &[&str] = &["launch_configs", "bags", "docs"];

/// A page, with what is in it.
pub(crate) struct Page {
    /// From the top level.
    pub(crate) path: PathBuf,
    /// Fenced blocks: what stands behind the fence, and the text.
    pub(crate) blocks: Vec<(String, String)>,
    /// Code within lines.
    codes: Vec<String>,
    links: Vec<String>,
    /// What links may name behind a `#`.
    anchors: BTreeSet<String>,
    headings: usize,
}

/// The anchor of a heading, as code hosts and mdBook make it.
fn anchor(heading: &str) -> String {
    let letter = |letter: char| match letter {
        ' ' | '-' => Some('-'),
        '_' => Some('_'),
        letter if letter.is_alphanumeric() => Some(letter.to_ascii_lowercase()),
        _ => None,
    };
    heading.trim().chars().filter_map(letter).collect()
}

pub(crate) fn page(path: &Path) -> Page {
    let text = std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap();
    let mut page = Page {
        path: path.to_owned(),
        blocks: Vec::new(),
        codes: Vec::new(),
        links: Vec::new(),
        anchors: BTreeSet::new(),
        headings: 0,
    };
    let (mut block, mut heading): (Option<(String, String)>, Option<String>) = (None, None);
    for event in Parser::new_ext(&text, Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH) {
        match event {
            Event::Start(Tag::CodeBlock(kind)) => {
                let words = if let CodeBlockKind::Fenced(words) = kind { words.into_string() } else { String::new() };
                block = Some((words, String::new()));
            }
            Event::End(TagEnd::CodeBlock) => page.blocks.extend(block.take()),
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::End(TagEnd::Heading(_)) => {
                page.headings += 1;
                page.anchors.extend(heading.take().map(|heading| anchor(&heading)));
            }
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                page.links.push(dest_url.into_string());
            }
            Event::Text(text) => match (&mut block, &mut heading) {
                (Some((_, block)), _) => block.push_str(&text),
                (None, Some(heading)) => heading.push_str(&text),
                (None, None) => {}
            },
            Event::Code(code) => {
                if let Some(heading) = &mut heading {
                    heading.push_str(&code);
                }
                page.codes.push(code.into_string());
            }
            _ => {}
        }
    }
    page
}

/// Every page that is in the repository or about to be.
pub(crate) fn pages() -> Vec<Page> {
    let listed = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard", "*.md"])
        .current_dir(ROOT)
        .output()
        .unwrap();
    assert!(listed.status.success(), "{}", String::from_utf8_lossy(&listed.stderr));
    let names = String::from_utf8(listed.stdout).unwrap();
    let paths = names.lines().map(Path::new).filter(|path| Path::new(ROOT).join(path).exists());
    paths.map(page).collect()
}

/// A path without `..`, from the top level.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => {}
            other => plain.push(other),
        }
    }
    plain
}

#[test]
fn every_link_leads_to_a_file_and_every_anchor_to_a_heading() {
    let pages = pages();
    let anchors: BTreeMap<&Path, &BTreeSet<String>> =
        pages.iter().map(|page| (page.path.as_path(), &page.anchors)).collect();
    let mut dead = Vec::new();
    for page in &pages {
        for link in page.links.iter().filter(|link| !link.contains("://") && !link.starts_with("mailto:")) {
            let (file, anchor) =
                link.split_once('#').map_or((link.as_str(), None), |(file, anchor)| (file, Some(anchor)));
            let target =
                if file.is_empty() { page.path.clone() } else { plain(&page.path.parent().unwrap().join(file)) };
            let there = Path::new(ROOT).join(&target).exists();
            let named = anchor
                .is_none_or(|anchor| anchors.get(target.as_path()).is_some_and(|anchors| anchors.contains(anchor)));
            if !there || !named {
                dead.push(format!("{}: {link}", page.path.display()));
            }
        }
    }
    assert!(dead.is_empty(), "{dead:#?}");
}

#[test]
fn the_book_has_every_page_once() {
    let summary = page(Path::new("docs/SUMMARY.md"));
    let mut listed: Vec<PathBuf> = summary.links.iter().map(|link| plain(&Path::new("docs").join(link))).collect();
    let in_docs = |path: &Path| path.starts_with("docs") && path != Path::new("docs/SUMMARY.md");
    let mut there: Vec<PathBuf> = pages().into_iter().map(|page| page.path).filter(|path| in_docs(path)).collect();
    listed.sort();
    there.sort();
    assert_eq!(listed, there);
}

/// `UPDATE=1` writes the page anew from what was measured; `feeder-lab results` measures.
#[test]
fn the_page_of_results_is_what_was_measured() {
    let made = feeder_lab::results::page(Path::new(ROOT)).unwrap();
    let path = Path::new(ROOT).join("docs/results.md");
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    assert!(made == std::fs::read_to_string(path).unwrap(), "docs/results.md is stale; write it anew with UPDATE=1");
}

/// Those that take some seconds; the others are measured for a release.
#[test]
fn quick_figures_are_those_of_the_page() {
    let commands = tempfile::tempdir().unwrap();
    put_commands(commands.path());
    let path = format!("{}:{}", commands.path().display(), std::env::var("PATH").unwrap());
    let domain = TestDomain::claim();
    let mut results = lab();
    results.args(["results", "--quick", "--compare"]).current_dir(ROOT).env("PATH", path);
    results.env("ROS_DOMAIN_ID", domain.id.to_string()).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    let output = results.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_readme_is_read_in_a_minute() {
    let bytes = std::fs::read(Path::new(ROOT).join("README.md")).unwrap().len();
    assert!(bytes <= README_BYTES_MAX, "{bytes} bytes of at most {README_BYTES_MAX}");
}

/// The words of a command of ours, from the command's name on, if the line is one.
fn words_of_ours(line: &str) -> Option<Vec<String>> {
    let mut words = shlex::split(line)?;
    if words.first().is_some_and(|word| word == "nice" || word == "time") {
        words.remove(0);
    }
    while words.first().is_some_and(|word| word.contains('=') && !word.starts_with('-')) {
        words.remove(0);
    }
    let end = words.iter().position(|word| [">", ">>", "2>", "&&", "||", ";", "&"].contains(&word.as_str()));
    words.truncate(end.unwrap_or(words.len()));
    let through_cargo = words.iter().take(6).position(|word| word == "--").filter(|_| words[0] == "cargo");
    if words.first().is_some_and(|word| word == "cargo") && words.iter().any(|word| word == "--example") {
        return None;
    }
    if let Some(dashes) = through_cargo {
        let name = if words[..dashes].iter().any(|word| word == "feeder_lab") { "feeder-lab" } else { "feeder" };
        words.drain(..=dashes);
        words.insert(0, name.to_owned());
        return Some(words);
    }
    let name = Path::new(words.first()?).file_name()?.to_str()?.to_owned();
    matches!(name.as_str(), "feeder" | "feeder-lab").then(|| {
        words[0] = name;
        words
    })
}

/// Why the command line refuses these words, if it does. A command named in a text may lack what stands behind an option.
fn refusal(words: &[String], whole: bool) -> Option<String> {
    let command = if words[0] == "feeder" { feeder::command_line() } else { feeder_lab::command_line() };
    let error = command.try_get_matches_from(words).err()?;
    let wrong = match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => false,
        ErrorKind::UnknownArgument | ErrorKind::InvalidSubcommand => true,
        _ => whole,
    };
    wrong.then(|| error.to_string().lines().next().unwrap_or_default().to_owned())
}

/// Lines of a shell block, those that a backslash continues as one, without comments.
fn lines_of(block: &str) -> Vec<String> {
    let joined = block.replace("\\\n", " ");
    let commands = joined.lines().flat_map(|line| line.split("; ")).flat_map(|line| line.split(" | "));
    commands.map(|line| line.split(" #").next().unwrap().trim().to_owned()).filter(|line| !line.is_empty()).collect()
}

#[test]
fn every_command_is_one_of_this_version() {
    let mut stale = Vec::new();
    let mut seen = 0;
    for page in pages() {
        let blocks = page.blocks.iter().filter(|(words, _)| words.split(' ').next() == Some("sh"));
        let in_blocks = blocks.flat_map(|(_, text)| lines_of(text)).map(|line| (line, true));
        // In a text, what has an ellipsis, alternatives or a placeholder shows a form.
        let in_texts = page.codes.iter().filter(|code| !code.contains(['…', '|', '[', '<', '`'])).cloned();
        for (line, whole) in in_blocks.chain(in_texts.map(|code| (code, false))) {
            let Some(words) = words_of_ours(&line).filter(|words| words.len() > 1) else { continue };
            seen += 1;
            if let Some(refusal) = refusal(&words, whole) {
                stale.push(format!("{}: {line}: {refusal}", page.path.display()));
            }
        }
    }
    assert!(stale.is_empty(), "{stale:#?}");
    assert!(seen > 50, "only {seen} commands were found");
}

#[test]
fn every_block_says_when_it_is_typed() {
    let contributing = std::fs::read_to_string(Path::new(ROOT).join("docs/CONTRIBUTING.md")).unwrap();
    let marks: Vec<&str> = [TRIED, CLEAN, RELEASE, LIVE].iter().chain(NOT_TYPED).copied().collect();
    for mark in &marks {
        assert!(contributing.contains(&format!("| `{mark}` |")), "CONTRIBUTING says nothing of {mark}");
    }
    for page in pages() {
        for (words, text) in page.blocks.iter().filter(|(words, _)| words.split(' ').next() == Some("sh")) {
            assert!(
                marks.contains(&words.as_str()),
                "{}: `{words}` is none of {marks:?}:\n{text}",
                page.path.display()
            );
        }
    }
}

/// Types the tried blocks of a page, each after the other, as a user who stands in the clone.
fn type_in(page: &Page) {
    let work = tempfile::tempdir().unwrap();
    let bin = work.path().join("bin");
    std::fs::create_dir(&bin).unwrap();
    put_commands(&bin);
    let clone = work.path().join("clone");
    std::fs::create_dir(&clone).unwrap();
    for folder in CLONE {
        std::os::unix::fs::symlink(Path::new(ROOT).canonicalize().unwrap().join(folder), clone.join(folder)).unwrap();
    }
    let domain = TestDomain::claim();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    for (_, text) in page.blocks.iter().filter(|(words, _)| words == TRIED) {
        let typed = Command::new("bash")
            .args(["-eu", "-o", "pipefail", "-c", text])
            .current_dir(&clone)
            .env("PATH", &path)
            .env("ROS_DOMAIN_ID", domain.id.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .env_remove("RUST_LOG")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let said = [typed.stdout, typed.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
        assert!(typed.status.success(), "{}:\n{text}\n{said}", page.path.display());
    }
}

/// The tried blocks of the page of this name, of which there is at least one.
fn try_page(path: &str) {
    let page = page(Path::new(path));
    assert!(page.blocks.iter().any(|(words, _)| words == TRIED), "{path} has nothing to try");
    type_in(&page);
}

#[test]
fn the_first_run_goes_as_the_tutorial_says() {
    try_page("docs/tutorial/1_first_run.md");
}

#[test]
fn recording_and_replaying_goes_as_the_tutorial_says() {
    try_page("docs/tutorial/3_record_and_replay.md");
}

#[test]
fn an_own_part_is_delivered_as_the_tutorial_says() {
    try_page("docs/tutorial/4_own_part.md");
}

#[test]
fn an_own_waveform_feeds_as_the_tutorial_says() {
    try_page("docs/tutorial/5_own_waveform.md");
}

/// A page outside the tutorial that has something to try must be tried too.
#[test]
fn every_block_that_is_to_be_tried_is() {
    let in_tutorial = |path: &Path| path.starts_with("docs/tutorial");
    let tried = |page: &Page| page.blocks.iter().any(|(words, _)| words == TRIED);
    for page in pages().iter().filter(|page| tried(page) && !in_tutorial(&page.path)) {
        type_in(page);
    }
    let pages = pages();
    let in_tutorial: Vec<&Path> =
        pages.iter().filter(|page| tried(page) && in_tutorial(&page.path)).map(|page| page.path.as_path()).collect();
    assert_eq!(in_tutorial.len(), 4, "a page of the tutorial has no test: {in_tutorial:?}");
}

#[test]
fn commands_are_found_in_what_is_written() {
    let words = |line: &str| words_of_ours(line).map(|words| words.join(" "));
    assert_eq!(words("cargo run --release -- up --view").as_deref(), Some("feeder up --view"));
    assert_eq!(
        words("cargo run --release -p feeder_lab -- drop a.yaml > b").as_deref(),
        Some("feeder-lab drop a.yaml")
    );
    assert_eq!(words("RUST_LOG=debug target/release/feeder part").as_deref(), Some("feeder part"));
    assert_eq!(words("cargo test --workspace"), None);
    assert_eq!(words("ros2 topic list"), None);
    let refused = |line: &str, whole| refusal(&words_of_ours(line).unwrap(), whole).is_some();
    assert!(
        refused("feeder up --no-such", false) && refused("feeder fly", false) && refused("feeder up --record", true)
    );
    assert!(!refused("feeder up --record", false) && !refused("feeder up --help", true));
}

/// As in `feeder-lab tray-map … | head -1`.
#[test]
fn a_reader_who_has_seen_enough_gets_no_panic() {
    for mut command in [feeder(), lab()] {
        let name = Path::new(command.get_program()).display().to_string();
        let arguments: &[&str] = if name.contains("lab") { &["plan-move", "--sweep"] } else { &["check", "--schema"] };
        let mut child = command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let said = child.wait_with_output().unwrap();
        assert!(!String::from_utf8_lossy(&said.stderr).contains("panicked"), "{name}");
    }
}
