//! The picture of a run on a terminal: its numbers change, and the terminal is given back whatever happens.

use std::process::Command;

use feeder_runtime::testing::TestDomain;
use rustix::process::Signal;

use crate::common::{Terminal, Up, feeder, output};

/// The time that is shown, s.
#[track_caller]
fn time_s(terminal: &mut Terminal) -> f64 {
    terminal.until(r"(\d+\.\d\d) s")[0].parse().unwrap()
}

/// Waits until a later time is shown.
#[track_caller]
fn goes_on(terminal: &mut Terminal) {
    let before_s = time_s(terminal);
    while time_s(terminal) <= before_s {}
}

fn command(domain: &TestDomain, arguments: &str) -> Command {
    let mut command = feeder();
    command.args(arguments.split(' ')).args(["--domain", &domain.id.to_string()]);
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    command
}

fn up(domain: &TestDomain, options: &str) -> Terminal {
    Terminal::start(&command(domain, &format!("up {options}")))
}

#[test]
fn a_run_on_a_terminal_is_shown_goes_on_and_gives_the_terminal_back() {
    let domain = TestDomain::claim();
    let mut terminal = up(&domain, "--duration 3600 --speed 1");
    terminal.until(r"state +(execute|idle)");
    terminal.until(r"Nodes: [1-9]\d* report");
    terminal.until(r"of [1-9]\d* seen");
    terminal.until(r"goal: a delivery was accepted");
    goes_on(&mut terminal);
    terminal.resize(34, 8);
    terminal.until(r"(?s)^ +\d+\.\d\d s.*state.*delivered \d+ of");
    terminal.resize(100, 50);
    terminal.until("Courier");
    terminal.until("Log");

    terminal.keys("\u{1a}");
    terminal.until("cannot be stopped");
    terminal.signal("SIGTSTP");
    goes_on(&mut terminal);
    let look = terminal.look();
    assert!(look.is_other_screen && !look.is_as_before, "{look:?}");

    terminal.keys("q");
    let end = terminal.ended();
    end.assert_given_back();
    assert_eq!(end.status, Some(0), "{end:?}");
    // What was logged meanwhile, then how it went.
    let (log, summary) = end.first.split_once("parts fed to the plateau").unwrap_or_else(|| panic!("{end:?}"));
    assert!(log.contains("WARN") && summary.contains("real-time factor"), "{end:?}");
}

#[test]
fn sigterm_and_the_end_of_the_run_give_the_terminal_back() {
    let domain = TestDomain::claim();
    let mut terminal = up(&domain, "--composed --duration 3600 --speed 1");
    goes_on(&mut terminal);
    terminal.signal("SIGTERM");
    let end = terminal.ended();
    end.assert_given_back();
    assert_eq!(end.status, Some(0), "{end:?}");
    let mut terminal = up(&domain, "--composed --duration 3");
    let end = terminal.ended();
    end.assert_given_back();
    assert!(end.status == Some(0) && end.first.contains("simulated time"), "{end:?}");
}

#[test]
fn a_run_that_fails_gives_the_terminal_back_and_says_why() {
    let domain = TestDomain::claim();
    let mut terminal = up(&domain, "--duration 3600 --speed 1");
    goes_on(&mut terminal);
    let node = terminal.nodes().into_iter().find(|node| node.arguments().iter().any(|word| word == "vision_selector"));
    node.unwrap().signal(Signal::KILL);
    let end = terminal.ended();
    end.assert_given_back();
    assert_eq!(end.status, Some(1), "{end:?}");
    assert!(end.first.contains("error: the run ended early") && end.first.contains("vision_selector"), "{end:?}");
}

#[test]
fn a_graph_that_runs_already_is_shown_with_its_end() {
    let run = Up::new("--duration 3600 --speed 1").start();
    let mut terminal = Terminal::start(&command(run.domain(), "top"));
    goes_on(&mut terminal);
    terminal.until("graph");
    terminal.until(r"state +(execute|idle)");
    terminal.until(r"delivered +\d+ of [1-9]");
    run.process().signal(Signal::INT);
    terminal.until("silent: the run has ended");
    terminal.keys("\u{3}");
    let end = terminal.ended();
    end.assert_given_back();
    assert_eq!(end.status, Some(0), "{end:?}");
}

#[test]
fn a_graph_that_is_not_the_scenario_is_noticed() {
    let run = Up::new("--composed --duration 3600 --speed 1").start();
    let other = concat!(env!("CARGO_MANIFEST_DIR"), "/../launch_configs/blocks.yaml");
    let mut terminal = Terminal::start(&command(run.domain(), &format!("top --scenario {other}")));
    terminal.until("▲ what runs is not the scenario that is shown");
    terminal.until("it feeds grommet, not block");
    terminal.keys("q");
    terminal.ended().assert_given_back();
}

#[test]
fn whoever_wants_lines_gets_lines() {
    let domain = TestDomain::claim();
    let dumb = {
        let mut command = command(&domain, "up --composed --duration 1");
        command.env("TERM", "dumb");
        command
    };
    for command in [command(&domain, "up --composed --duration 1 --plain"), dumb] {
        let end = Terminal::start(&command).ended();
        assert_eq!(end.status, Some(0), "{end:?}");
        assert!(end.first.contains("to see it live: feeder up --view"), "{end:?}");
        assert!(end.first.contains("simulated time"), "nothing was drawn on another screen: {end:?}");
    }
}

#[test]
fn without_a_terminal_there_is_nothing_to_draw_on() {
    let output = output(["top"]);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && output.stdout.is_empty());
    assert!(error.contains("draws on a terminal") && error.contains("feeder view"), "{error}");
}

#[test]
fn no_color_is_respected() {
    let domain = TestDomain::claim();
    let mut plain = command(&domain, "up --composed --duration 3600 --speed 1");
    plain.env("NO_COLOR", "1");
    for (command, coloured) in [(plain, false), (command(&domain, "up --composed --duration 3600 --speed 1"), true)] {
        let mut terminal = Terminal::start(&command);
        goes_on(&mut terminal);
        terminal.until("Courier");
        assert_eq!(terminal.look().has_colours, coloured);
        terminal.keys("q");
        terminal.ended().assert_given_back();
    }
}
