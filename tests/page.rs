//! The page in a browser: it shows what runs, controls it, and says what it cannot.

use std::path::Path;
use std::process::{Child, Command, Stdio};

use feeder_runtime::testing::TestDomain;
use feeder_scenario::Scenario;
use rustix::process::Signal;
use serde_json::json;
use tempfile::TempDir;

use crate::common::{Browser, Process, Run, Up, feeder, wait_for};

/// Where parts are drawn, by their numbers.
const PLACES: &str = "Object.fromEntries(feeder.tray.painter.shown.map(({ id, place }) => [id, place]))";

/// The address that a view has printed.
fn url(stderr: &str) -> Option<String> {
    let (_, rest) = stderr.split_once("see it live at ")?;
    Some(rest.split_once('\n')?.0.to_owned())
}

/// The height of a part that lies, that has just begun to fall, a while later, and when it has fallen, m.
const FALL: &str = "(() => {
    const { hello, name, partRadius, constructor } = feeder.tray.painter;
    const painter = new constructor(hello, name, partRadius);
    const frame = structuredClone(feeder.playback.newest);
    const height = (timeS) => {
        const moment = { older: frame, newer: frame, share: 1, timeS };
        painter.paint(moment, feeder.playback, { truth: true }, { x_m: 0, y_m: 0, yaw_rad: 0 });
        return painter.shown[0].place[2];
    };
    const lying = height(1);
    frame.feeders[name].truth.surface[0] = 2;
    return [lying, height(2), height(2.03), height(3)];
})()";

/// Where the page of a run is.
#[track_caller]
fn page_of(run: &Run) -> String {
    wait_for("the page's address", || url(&run.stderr()))
}

/// The time at which simulated time stands still: what was said of it last comes late where the machine is busy.
#[track_caller]
fn standstill_s(browser: &mut Browser) -> f64 {
    let mut last_s = browser.value("(globalThis.seen = feeder.status)?.time_s");
    loop {
        let now_s = browser.until("feeder.status !== seen && (globalThis.seen = feeder.status)?.time_s");
        if now_s == last_s {
            return now_s.as_f64().unwrap();
        }
        last_s = now_s;
    }
}

#[test]
fn the_page_shows_a_run_and_controls_it() {
    let run = Up::new("--duration 3600 --speed 1 --view=0").start();
    let mut browser = Browser::start();
    browser.open(&page_of(&run));
    browser.until("document.body.dataset.condition === 'open'");
    browser.until("feeder.tray.painter?.shown.length > 0");
    browser.until(&format!("globalThis.before = {PLACES}"));
    let far = "([x, y], [u, v]) => Math.hypot(x - u, y - v)";
    browser
        .until(&format!("Object.entries({PLACES}).some(([id, at]) => before[id] && ({far})(at, before[id]) > 0.002)"));
    browser.until("feeder.tray.scene && document.getElementById('camera-note').textContent.includes('seen')");
    browser.until("document.getElementById('period-words').textContent.includes('of this period')");

    let heights_m: Vec<f64> = serde_json::from_value(browser.value(FALL)).unwrap();
    let rise_m = browser.value("feeder.tray.tray.rise_m").as_f64().unwrap();
    let [lying, edge, falling, fallen] = heights_m[..] else { panic!("{heights_m:?}") };
    assert!((lying - edge).abs() < 1e-9 && (edge - fallen - rise_m).abs() < 1e-9, "{heights_m:?}");
    assert!((edge - falling - 0.5 * 9.80665 * 0.03 * 0.03).abs() < 1e-6, "{heights_m:?}");

    browser.click("#pause");
    browser.until("feeder.playback.newest.paused && document.getElementById('pace').textContent === 'paused'");
    let stopped_s = standstill_s(&mut browser);
    browser.click("#step");
    browser.until(&format!("feeder.playback.newest.time_s > {stopped_s}"));
    let stepped_s = standstill_s(&mut browser);
    assert!((stepped_s - stopped_s - 0.01).abs() < 1e-6, "a step went from {stopped_s} s to {stepped_s} s");
    browser.click("#speeds button:nth-child(2)");
    browser.click("#pause");
    browser.until("!feeder.playback.newest.paused && feeder.playback.newest.speed === 0.05");
    browser.until("feeder.tray.servo.blocks.length > 3");

    let parts = browser.value("feeder.tray.painter.shown.length").as_u64().unwrap();
    browser.click("[data-control=load_parts] button");
    browser.until("document.querySelector('[data-control=load_parts] .answer').classList.contains('good')");
    browser.click("#speeds button:nth-child(4)");
    // Five were loaded; some may be delivered meanwhile.
    browser.until(&format!("feeder.tray.painter.shown.length > {parts}"));
    browser.click("#stop");
    browser.until("document.getElementById('alerts').textContent.includes('Fault')");
    browser.click("[data-control=reset_fault] button");
    browser.until("!document.getElementById('alerts').textContent.includes('Fault')");

    let ran_s = browser.value("feeder.playback.newest.time_s").as_f64().unwrap();
    browser.click("#reset");
    let loaded = Scenario::default().parts_loaded;
    browser.until(&format!(
        "feeder.playback.newest?.time_s < {ran_s} - 0.5 && feeder.tray.painter.shown.length === {loaded}"
    ));

    for (width_px, height_px) in [(390, 844), (820, 1180), (1800, 1000)] {
        browser.resize(width_px, height_px);
        browser.until(&format!("innerWidth === {width_px}"));
        assert_eq!(browser.value("document.documentElement.scrollWidth"), json!(width_px));
    }
    browser.press("?");
    browser.until("document.getElementById('help').open");
    assert_eq!(browser.complaints(), json!([]));
}

#[test]
fn the_page_comes_back_after_the_suite_was_started_again() {
    let run = Up::new("--duration 3600 --speed 10 --view=0").start();
    let page = page_of(&run);
    let mut browser = Browser::start();
    browser.open(&page);
    browser.until("feeder.playback.newest?.time_s > 20");
    drop(run);
    browser.until("!document.getElementById('banner').hidden");
    assert_eq!(browser.value("document.getElementById('pause').getAttribute('aria-disabled')"), json!("true"));
    let place = page.trim_start_matches("http://").trim_end_matches('/');
    let again = Up::new(&format!("--duration 3600 --speed 1 --view={place}")).start();
    browser.until("document.getElementById('banner').hidden && document.body.dataset.condition === 'open'");
    browser.until("feeder.playback.newest?.time_s < 20 && feeder.tray.painter.shown.length > 0");
    drop(again);
}

#[test]
fn a_page_that_is_read_only_says_so_and_controls_nothing() {
    let run = Up::new("--duration 3600 --speed 1 --view=0 --view-read-only").start();
    let mut browser = Browser::start();
    browser.open(&page_of(&run));
    browser.until("feeder.playback.newest?.time_s > 0.5");
    let buttons = "[...document.querySelectorAll('#pause, #step, #speeds button, #stop, #controls button')]";
    assert!(browser.value(&format!("{buttons}.length")).as_u64().unwrap() > 12);
    let shut = format!("{buttons}.every((button) => button.getAttribute('aria-disabled') === 'true' && button.title)");
    assert_eq!(browser.value(&shut), json!(true));
    assert_eq!(browser.value("document.getElementById('read-only').hidden"), json!(false));
    browser.press(" ");
    browser.value("document.getElementById('stop').click()");
    browser.value("globalThis.before = feeder.playback.newest.time_s");
    browser.until("feeder.playback.newest.time_s > before + 1");
    assert_eq!(browser.value("feeder.playback.newest.feeders.feeder.courier_state.fault"), json!(null));
}

#[test]
fn the_page_shows_a_bag_that_is_played() {
    let work = TempDir::new().unwrap();
    let bag = work.path().join("bag");
    Up::new("--composed --duration 6").record(&bag).success();
    let domain = TestDomain::claim();
    let stderr = work.path().join("stderr");
    let mut view = quiet(&domain, "view 0 --scenario", &bag, Stdio::from(std::fs::File::create(&stderr).unwrap()));
    let page = wait_for("the page's address", || url(&std::fs::read_to_string(&stderr).unwrap()));
    let mut browser = Browser::start();
    browser.open(&page);
    let mut player = quiet(&domain, "bag play --loop --disable-keyboard-controls", &bag, Stdio::null());
    browser.until("document.getElementById('scenario').textContent.includes('replayed bag')");
    browser.until("feeder.playback.newest?.time_s > 1 && feeder.tray.painter.shown.length > 0");
    browser.until("document.getElementById('camera-note').textContent.includes('seen')");
    let load = "document.querySelector('[data-control=load_parts] button')";
    assert_eq!(browser.value(&format!("{load}.getAttribute('aria-disabled')")), json!("true"));
    assert!(browser.value(&format!("{load}.title")).as_str().unwrap().contains("bag"));
    browser.click("#pause");
    browser.until("feeder.playback.newest.paused");
    for child in [&mut player, &mut view] {
        Process::new(child.id()).signal(Signal::INT);
        child.wait().unwrap();
    }
}

/// A subcommand in this domain, on a bag.
fn quiet(domain: &TestDomain, subcommand: &str, bag: &Path, stderr: Stdio) -> Child {
    let mut command: Command = feeder();
    command.args(subcommand.split(' ')).arg(bag).args(["--domain", &domain.id.to_string()]);
    command.env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(stderr).spawn().unwrap()
}
