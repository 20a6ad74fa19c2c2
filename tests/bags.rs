//! Bags of whole runs: complete, read by everybody, the same again, and whole after a crash.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use feeder_runtime::cdr;
use feeder_runtime::dds::{NodeName, Participant, Qos};
use feeder_runtime::testing::TestDomain;
use feeder_wire::topics::IMAGE_RAW;
use minifactory_msgs::rosbag2_interfaces::srv::{PlayNext, PlayNextRequest, Resume, ResumeRequest, Seek, SeekRequest};
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::{Message as _, stamp_of_ns};
use rand::RngExt as _;
use ros2_bags::check::{Severity, check};
use ros2_bags::{Bag, Query, Seconds};
use rustix::process::Signal;

use crate::common::{FEEDER, Process, Up, bag_reader, feeder, output, python, wait_for};

/// What the raw images leave of a run, small enough to be recorded again and again.
const WITHOUT_RAW: &str = "--record-exclude camera/(image_raw|annotated)$";
/// Recorders that are killed.
const KILLS: usize = 10;
/// The most that a killed recorder may lose, and how much a busy machine may be late with it.
const LOST_MAX: Duration = Duration::from_millis(1000);

/// A folder that goes away, and a path in it that does not exist yet.
fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let work = tempfile::tempdir().unwrap();
    let path = work.path().join(name);
    (work, path)
}

#[track_caller]
fn assert_good(folder: &Path) -> Bag {
    let bag = Bag::open(folder).unwrap();
    let findings = check(&bag);
    let errors: Vec<_> = findings.iter().filter(|finding| finding.severity == Severity::Error).collect();
    assert!(errors.is_empty(), "{errors:?}");
    bag
}

/// Topic → messages, as `--digest` counts them.
fn digest_counts(digest: &str) -> BTreeMap<String, u64> {
    let line = |line: &str| {
        let mut words = line.split(' ');
        (words.next().unwrap().to_owned(), words.next().unwrap().parse().unwrap())
    };
    digest.lines().map(line).collect()
}

fn counts(bag: &Bag) -> BTreeMap<String, u64> {
    // A topic on which nothing came is in the bag too.
    bag.topics().iter().filter(|topic| topic.count > 0).map(|topic| (topic.name.clone(), topic.count)).collect()
}

/// Runs a bag command; its output on both ends, and its exit code.
fn bag_command(arguments: &[&std::ffi::OsStr]) -> (String, Option<i32>) {
    let output =
        feeder().arg("bag").args(arguments).env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST").output().unwrap();
    let said = [&*output.stdout, &*output.stderr].map(String::from_utf8_lossy).concat();
    (said, output.status.code())
}

macro_rules! bag {
    ($($argument:expr),* $(,)?) => { bag_command(&[$(AsRef::<std::ffi::OsStr>::as_ref($argument)),*]) };
}

#[test]
fn a_run_is_recorded_whole_in_either_layout_and_every_reader_reads_it() {
    let (_work, folder) = place("processes");
    let processes = Up::new(&format!("--duration 4 --record {}", folder.display())).digest().success();
    let bag = assert_good(&folder);
    let expected = digest_counts(processes.digest());
    assert_eq!(counts(&bag), expected);
    assert!(expected.len() >= 15 && expected[&IMAGE_RAW.name_in(FEEDER)] > 30, "{expected:?}");
    let times: Vec<u64> = bag.messages(&Query::default()).map(|message| message.unwrap().log_ns).collect();
    assert!(times.is_sorted() && times.iter().all(|time_ns| time_ns % 10_000_000 == 0));

    let (_other, composed) = place("composed");
    Up::new(&format!("--duration 4 --composed --record {}", composed.display())).success();
    let (said, code) = bag!("diff", &folder, &composed);
    assert_eq!(code, Some(0), "{said}");

    let script = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests/interop/bag_readers.py");
    let read = Command::new(python()).arg(script).arg(&folder).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let readers: BTreeMap<String, BTreeMap<String, u64>> = serde_json::from_slice(&read.stdout).unwrap();
    assert_eq!(readers.keys().collect::<Vec<_>>(), ["mcap", "mcap-ros2-support", "rosbags"]);
    let not_silent = |mut found: BTreeMap<String, u64>| {
        found.retain(|_, count| *count > 0);
        found
    };
    for (reader, found) in readers {
        assert_eq!(not_silent(found), expected, "{reader}");
    }
    let mut node = Command::new("node");
    let read = node.arg(bag_reader()).arg(folder.join("processes_0.mcap")).output().unwrap();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let found: BTreeMap<String, u64> = serde_json::from_slice(&read.stdout).unwrap();
    assert_eq!(not_silent(found), expected, "@mcap/core");
}

/// A file is named by its folder, so both have the same.
#[test]
fn the_same_seed_leaves_the_same_bytes() {
    let [first, second, in_processes] = ["--composed", "--composed", ""].map(|form| {
        let (work, folder) = place("bag");
        let options = format!("--duration 4 {form} {WITHOUT_RAW} --record {}", folder.display());
        Up::new(&options).success();
        let files: BTreeMap<PathBuf, Vec<u8>> = walk(&folder)
            .into_iter()
            .map(|file| (file.strip_prefix(&work).unwrap().to_owned(), std::fs::read(&file).unwrap()))
            .collect();
        files
    });
    for other in [second, in_processes] {
        assert_eq!(first.keys().collect::<Vec<_>>(), other.keys().collect::<Vec<_>>());
        for (file, bytes) in &first {
            assert!(bytes == &other[file], "{} differs", file.display());
        }
    }
}

#[test]
fn a_recorded_run_comes_out_the_same_again_and_so_does_its_selector_alone() {
    let (work, folder) = place("bag");
    Up::new(&format!("--duration 4 --seed 3 {WITHOUT_RAW} --record {}", folder.display())).success();
    let domain = TestDomain::claim();
    let (said, code) = bag!("rerun", &folder, "--domain", &domain.id.to_string());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("same    /feeder/candidates") && said.contains(" 0 differ"), "{said}");
    let (said, code) = bag!("rerun", &folder, "--only", "vision_selector");
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("same    /feeder/candidates") && said.contains("4 topics compared"), "{said}");
    let (said, code) = bag!("rerun", &folder, "--only", "delivery_planner");
    assert!(code == Some(1) && said.contains("service"), "{said}");

    // Another seed is another run, and the first difference has a time and a field.
    let other = work.path().join("other");
    Up::new(&format!("--duration 4 --seed 4 {WITHOUT_RAW} --record {}", other.display())).success();
    let (said, code) = bag!("diff", &folder, &other);
    let parts = said.lines().find(|line| line.contains("/feeder/parts ")).unwrap();
    assert!(code == Some(1) && parts.contains("first at 0.000000000 s: message 0: parts[0]."), "{said}");

    let file = folder.join("bag_0.mcap");
    let plain = work.path().join("plain");
    let (said, code) = bag!("recover", &file, "--out", &plain);
    assert_eq!(code, Some(0), "{said}");
    let (said, code) = bag!("rerun", &plain, "--only", "vision_selector");
    assert_eq!(code, Some(0), "a copy is as good as the bag: {said}");
}

type Payloads = Vec<Vec<u8>>;

/// A publisher of numbered texts at 500 Hz, until it is dropped.
struct Numbers {
    next: Arc<AtomicU64>,
    over: Arc<std::sync::atomic::AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
    _participant: Participant,
}

impl Numbers {
    fn start(domain: &TestDomain) -> Self {
        let participant = Participant::open(domain, &NodeName::new("/", "numbers").unwrap()).unwrap();
        let writer = participant.writer("/numbers", &Text::INFO.dds_type(), &Qos::command()).unwrap();
        let (next, over): (Arc<AtomicU64>, Arc<std::sync::atomic::AtomicBool>) = Default::default();
        let (shared, is_over) = (Arc::clone(&next), Arc::clone(&over));
        let thread = std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                if writer.matched_readers() > 0 {
                    let number = shared.fetch_add(1, Ordering::Relaxed);
                    let body = cdr::encode(&Text { data: number.to_string() }).unwrap();
                    // A recorder that was killed does not acknowledge.
                    let _ = writer.publish(body);
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        Self { next, over, thread: Some(thread), _participant: participant }
    }
}

impl Drop for Numbers {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

/// Kills a recorder at a random moment, recovers its bag, and says how much wall time of messages was lost.
fn kill_a_recorder(number: usize) -> Duration {
    let (work, folder) = place("bag");
    let domain = TestDomain::claim();
    let numbers = Numbers::start(&domain);
    let mut recorder = feeder()
        .args(["bag", "record", "--domain", &domain.id.to_string(), "--out"])
        .arg(&folder)
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    wait_for("the recorder", || (numbers.next.load(Ordering::Relaxed) > 0).then_some(()));
    let started = Instant::now();
    let after = Duration::from_millis(rand::rng().random_range(50..2500));
    std::thread::sleep(after);
    let published = numbers.next.load(Ordering::Relaxed);
    let lasted = started.elapsed();
    Process::new(recorder.id()).signal(Signal::KILL);
    recorder.wait().unwrap();
    drop(numbers);
    let whole = work.path().join("whole");
    let (said, code) = bag!("recover", &folder, "--out", &whole);
    assert_eq!(code, Some(0), "{number}: killed after {after:?}: {said}");
    let bag = assert_good(&whole);
    let numbers: Vec<u64> = bag
        .messages(&Query::default())
        .map(|message| cdr::decode::<Text>(&message.unwrap().data[4..], true).unwrap().data.parse().unwrap())
        .collect();
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{number}: a gap in {numbers:?}");
    let kept = numbers.last().map_or(0, |last| last + 1);
    // At the pace at which they were published.
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    let share = published.saturating_sub(kept) as f64 / published.max(1) as f64;
    lasted.mul_f64(share)
}

#[test]
fn a_recorder_that_is_killed_loses_at_most_the_last_second() {
    for number in 0..KILLS {
        let lost = kill_a_recorder(number);
        println!("killed recorder {number} lost {lost:?}");
        assert!(lost <= LOST_MAX, "{number}: {lost:?} lost");
    }
}

#[test]
fn a_recorded_run_that_is_killed_leaves_a_bag_that_is_the_same_up_to_there() {
    let (work, folder) = place("bag");
    let mut run = Up::new(&format!("--duration 3600 --composed {WITHOUT_RAW} --record {}", folder.display())).start();
    run.wait_until_simulated(Duration::from_secs(3));
    run.process().signal(Signal::KILL);
    drop(run);
    let whole = work.path().join("whole");
    let (said, code) = bag!("recover", &folder, "--out", &whole);
    assert_eq!(code, Some(0), "{said}");
    assert_good(&whole);
    let domain = TestDomain::claim();
    let (said, code) = bag!("rerun", &whole, "--domain", &domain.id.to_string());
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("the bag ends early"), "{said}");
}

/// A small file system of its own, that only this process sees.
#[test]
fn a_full_disk_ends_recording_with_a_clear_error_and_a_valid_bag() {
    let (work, copy) = place("bag");
    let small = work.path().join("small");
    std::fs::create_dir(&small).unwrap();
    let domain = TestDomain::claim();
    let script = "mount -t tmpfs -o size=12m tmpfs \"$1\" || exit 99; \"$2\" up --composed --duration 600 --domain \"$3\" \
                  --record \"$1/bag\"; code=$?; cp -r \"$1/bag\" \"$4\"; exit $code";
    let run = Command::new("unshare")
        .args(["--user", "--map-root-user", "--mount", "sh", "-c", script, "sh"])
        .arg(&small)
        .arg(env!("CARGO_BIN_EXE_feeder-under-test"))
        .arg(domain.id.to_string())
        .arg(&copy)
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    assert_ne!(run.status.code(), Some(99), "this test mounts a small disk, as root or in a user namespace: {said}");
    assert_eq!(run.status.code(), Some(1), "{said}");
    let error = said.lines().last().unwrap_or_default();
    assert!(error.contains("no space is left on the device; the bag ends at"), "{said}");
    let bag = assert_good(&copy);
    let (_, end_ns) = bag.bounds_ns().unwrap();
    assert!(error.contains(&Seconds(end_ns).to_string()), "{end_ns}: {error}");
    // It was used to the end, but for the reserve.
    assert!(bag.size_bytes() > 4 << 20, "{}", bag.size_bytes());
}

#[test]
fn bags_of_other_writers_are_checked_and_played() {
    const COUNT: usize = 300;
    let work = tempfile::tempdir().unwrap();
    let script = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("tests/interop/bag_writers.py");
    let written = Command::new(python()).arg(script).arg(work.path()).arg(COUNT.to_string()).output().unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    for (name, other_topic) in [("rosbags", "/joints"), ("foreign.mcap", "/number")] {
        let path = work.path().join(name);
        let bag = assert_good(&path);
        let expected = BTreeMap::from([("/text".to_owned(), COUNT as u64), (other_topic.to_owned(), COUNT as u64)]);
        assert_eq!(counts(&bag), expected, "{name}");
        let other_type = &bag.topics().iter().find(|topic| topic.name == other_topic).unwrap().ros_type;
        let types = [("/text", Text::INFO.dds_type()), (other_topic, ros2_bags::dds_type(other_type).unwrap())];

        let domain = TestDomain::claim();
        let listener = Participant::open(&domain, &NodeName::new("/", "listener").unwrap()).unwrap();
        let heard: Arc<Mutex<BTreeMap<&str, Payloads>>> = Arc::default();
        let qos = Qos { backlog: 2048, ..Qos::command() };
        let _readers = types.clone().map(|(topic, dds_type)| {
            let heard = Arc::clone(&heard);
            let deliver = move |sample: feeder_runtime::dds::Sample| {
                heard.lock().unwrap().entry(topic).or_default().push(sample.payload.to_vec());
            };
            listener.reader(topic, &dds_type, &qos, deliver).unwrap()
        });
        let player = feeder()
            .args(["bag", "play", "--start-paused", "--disable-keyboard-controls", "--domain", &domain.id.to_string()])
            .arg(&path)
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        wait_for("the player's writers", || {
            (_readers.iter().all(|reader| reader.matched_writers() == 1)).then_some(())
        });
        // The player may find one of the readers later than the other, and late readers miss what went before: it starts
        // from the beginning once both have heard something.
        let play_next = listener.service_client::<PlayNext>("/rosbag2_player/play_next").unwrap();
        let mut probes = 0;
        wait_for("a message of each topic", || {
            let next = play_next.call(&PlayNextRequest::default(), Duration::from_secs(30)).wait().unwrap();
            assert!(next.success, "the bag has ended");
            probes += 1;
            (heard.lock().unwrap().len() == types.len()).then_some(())
        });
        let (start_ns, _) = bag.bounds_ns().unwrap();
        let seek = listener.service_client::<Seek>("/rosbag2_player/seek").unwrap();
        let start = SeekRequest { time: stamp_of_ns(start_ns) };
        assert!(seek.call(&start, Duration::from_secs(30)).wait().unwrap().success);
        let resume = listener.service_client::<Resume>("/rosbag2_player/resume").unwrap();
        resume.call(&ResumeRequest::default(), Duration::from_secs(30)).wait().unwrap();
        let played = player.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&played.stdout);
        assert!(played.status.success() && said.contains(&format!("{} messages played", probes + 2 * COUNT)), "{said}");
        assert!(said.contains("timing error: p50"), "{said}");
        for (index, topic) in bag.topics().iter().enumerate() {
            let recorded: Vec<Vec<u8>> =
                bag.messages(&Query::topic(index)).map(|message| message.unwrap().data[4..].to_vec()).collect();
            // On the wire a body is filled up to a multiple of four bytes.
            let same = |heard: &Vec<u8>, recorded: &Vec<u8>| {
                heard.strip_prefix(&recorded[..]).is_some_and(|padding| padding.len() < 4)
            };
            // The player leaves when all has been acknowledged, which is before this reader has handed it over.
            let heard = wait_for("the last message", || {
                let heard = heard.lock().unwrap().get(topic.name.as_str()).cloned().unwrap_or_default();
                heard.last().is_some_and(|last| same(last, recorded.last().unwrap())).then_some(heard)
            });
            // The number of each message in the bag, in the order in which they came.
            let numbers: Vec<Option<usize>> =
                heard.iter().map(|heard| recorded.iter().position(|recorded| same(heard, recorded))).collect();
            let last = &numbers[numbers.len().saturating_sub(COUNT)..];
            assert!(last.iter().copied().eq((0..COUNT).map(Some)), "{name} {}: these came: {numbers:?}", topic.name);
        }
    }
}

#[test]
fn the_bags_beside_the_code_are_good_and_small() {
    let golden = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("bags/golden");
    for name in ["waveform", "delivery", "jam"] {
        let bag = assert_good(&golden.join(name));
        assert!(bag.message_count() > 100, "{name}");
        assert!(bag.attachment("scenario.yaml").unwrap().is_some(), "{name}");
        let (said, code) = bag!("check", bag.path());
        assert!(code == Some(0) && said.contains("0 errors, 0 warnings"), "{said}");
    }
    let sizes = walk(&golden).into_iter().map(|path| path.metadata().unwrap().len());
    assert!(sizes.sum::<u64>() < 2_000_000);
}

fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = folder.read_dir().unwrap().map(|entry| entry.unwrap().path());
    entries.flat_map(|path| if path.is_dir() { walk(&path) } else { vec![path] }).collect()
}

#[test]
fn commands_say_what_is_wrong_with_what_they_are_given() {
    let (work, nowhere) = place("nowhere");
    for command in ["info", "check", "play", "rerun"] {
        let (said, code) = bag!(command, &nowhere);
        assert!(code == Some(1) && said.contains("nowhere"), "{command}: {said}");
    }
    let broken = work.path().join("broken.mcap");
    std::fs::write(&broken, b"\x89MCAP0\r\n").unwrap();
    let (said, code) = bag!("check", &broken);
    assert!(code == Some(1) && said.contains("broken.mcap: at byte 8"), "{said}");
    let out = work.path().join("out");
    for arguments in [
        vec!["record", "--out", out.to_str().unwrap(), "--max-bag-duration", "0"],
        vec!["record", "--out", out.to_str().unwrap(), "--compat", "foxy"],
        vec!["play", "x", "--remap", "a=b"],
        vec!["play", "x", "--rate", "0"],
        vec!["diff", "a", "b", "--absolute", "-1"],
    ] {
        let outcome = output(["bag"].iter().chain(&arguments));
        assert_eq!(outcome.status.code(), Some(2), "{arguments:?}");
    }
    assert!(!out.exists());
}
