//! Recording from, and playing to, the ROS graph: over real DDS, in a domain of its own.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "../../../bags/tests/suite/common.rs"]
mod common;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bytes::Bytes;
use feeder_bag_transport::play::{Control, Done, PlaySettings, Played, Player, serve};
use feeder_bag_transport::record::{GraphRecorder, GraphSettings, definitions};
use feeder_runtime::cdr;
use feeder_runtime::dds::{Durability, NodeName, Participant, Qos, Reader, Reliability, Server};
use feeder_runtime::testing::TestDomain;
use minifactory_msgs::builtin_interfaces::msg::Time;
use minifactory_msgs::rosbag2_interfaces::srv::{
    Burst, BurstRequest, GetRate, GetRateRequest, IsPaused, IsPausedRequest, PlayNext, PlayNextRequest, Resume,
    ResumeRequest, Seek, SeekRequest, SetRate, SetRateRequest, Stop, StopRequest,
};
use minifactory_msgs::rosgraph_msgs::msg::Clock;
use minifactory_msgs::std_msgs::msg::String as Text;
use minifactory_msgs::{Message as _, Service};
use ros2_bags::{Bag, BagWriter, NewTopic, Query, Selection, WriteSettings};

use common::{STEP_NS, errors, good, messages, topic};

const PATIENCE: Duration = Duration::from_secs(30);
const UNKNOWN: &str = "other_msgs::msg::dds_::Thing_";

fn participant(domain: &TestDomain, name: &str) -> Participant {
    Participant::open(domain, &NodeName::new("/", name).unwrap()).unwrap()
}

#[track_caller]
fn wait_for(what: &str, mut happened: impl FnMut() -> bool) {
    let give_up = Instant::now() + PATIENCE;
    while !happened() {
        assert!(Instant::now() < give_up, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// What a topic has brought, as (topic, body).
#[derive(Clone, Default)]
struct Heard(Arc<Mutex<Vec<(&'static str, Bytes)>>>);

impl Heard {
    fn listen(&self, participant: &Participant, topic: &'static str, dds_type: &str, qos: &Qos) -> Reader {
        let heard = self.clone();
        participant
            .reader(topic, dds_type, qos, move |sample| heard.0.lock().unwrap().push((topic, sample.payload)))
            .unwrap()
    }

    fn of(&self, topic: &str) -> Vec<Bytes> {
        self.0.lock().unwrap().iter().filter(|(heard, _)| *heard == topic).map(|(_, body)| body.clone()).collect()
    }

    fn texts(&self, topic: &str) -> Vec<String> {
        self.of(topic).iter().map(|body| cdr::decode::<Text>(body, true).unwrap().data).collect()
    }
}

#[test]
fn known_and_unknown_types_are_recorded_and_nothing_is_lost() {
    const COUNT: usize = 500;
    let domain = TestDomain::claim();
    let publisher = participant(&domain, "publisher");
    let text_type = Text::INFO.dds_type();
    let text_writer = publisher.writer("/text", &text_type, &Qos::command()).unwrap();
    let latched_writer = publisher.writer("/latched", &text_type, &Qos::latched()).unwrap();
    let thing_writer = publisher.writer("/thing", UNKNOWN, &Qos::sensor()).unwrap();
    let left_out = publisher.writer("/camera/raw", &text_type, &Qos::command()).unwrap();
    let body = |text: &str| cdr::encode(&Text { data: text.to_owned() }).unwrap();
    latched_writer.publish(body("before anybody listened")).unwrap();

    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    let exclude_regex = Some(regex_of("raw$"));
    let selection = Selection { exclude_regex, ..Selection::default() };
    let stop = Arc::new(AtomicBool::new(false));
    let recorder = {
        let (stop, folder) = (Arc::clone(&stop), folder.clone());
        let here = participant(&domain, "rosbag2_recorder");
        std::thread::spawn(move || {
            let writer = BagWriter::create(&folder, WriteSettings::default()).unwrap();
            let settings = GraphSettings { selection, ..GraphSettings::default() };
            let mut recorder = GraphRecorder::new(writer, definitions(), settings);
            recorder.run(&here, &stop, |_, _| ()).unwrap();
            let counts = recorder.counts();
            recorder.into_writer().finish().unwrap();
            counts
        })
    };
    wait_for("the recorder", || text_writer.matched_readers() == 1 && thing_writer.matched_readers() == 1);
    // A volatile reader hears what comes after it has found the writer: the first that arrives shows that it has.
    for number in 0..COUNT {
        text_writer.publish(body(&format!("{number}"))).unwrap();
        thing_writer.publish(Bytes::from(vec![u8::try_from(number % 256).unwrap(); 8])).unwrap();
        let _ = left_out.publish(body("raw"));
        std::thread::sleep(Duration::from_micros(500));
    }
    assert!(text_writer.wait_acknowledged(PATIENCE));
    wait_for("the last message on the disk", || {
        Bag::open(&folder).is_ok_and(|bag| bag.topics().iter().any(|topic| topic.name == "/text" && topic.count > 0))
    });
    stop.store(true, Ordering::Relaxed);
    let counts = recorder.join().unwrap();
    let names: Vec<&str> = counts.iter().map(|count| count.topic.as_str()).collect();
    assert_eq!(names, ["/latched", "/text", "/thing"]);
    // Of a best-effort topic a busy machine may lose some; each is counted.
    let [latched, texts, things] = &counts[..] else { panic!("{counts:?}") };
    assert_eq!([latched.lost, texts.lost, texts.dropped, things.dropped], [0; 4]);
    assert!(things.recorded > 0 && things.recorded + things.lost <= COUNT as u64, "{counts:?}");

    let bag = Bag::open(&folder).unwrap();
    assert_eq!(errors(&bag), []);
    let of = |name: &str| bag.topics().iter().position(|topic| topic.name == name).unwrap();
    // On the wire a body is filled up to a multiple of four bytes.
    let texts_of = |name: &str| -> Vec<String> {
        let decode = |data: &[u8]| cdr::decode::<Text>(data, true).unwrap().data;
        bag.messages(&Query::topic(of(name))).map(|message| decode(&message.unwrap().data[4..])).collect()
    };
    assert_eq!(texts_of("/latched"), ["before anybody listened"]);
    // Without a gap to the last one.
    let recorded = texts_of("/text");
    assert!(recorded.len() > COUNT / 2, "{}", recorded.len());
    assert!((COUNT - recorded.len()..COUNT).map(|number| number.to_string()).eq(recorded));
    let thing = &bag.topics()[of("/thing")];
    assert_eq!((thing.ros_type.as_str(), thing.schema.as_str()), ("other_msgs/msg/Thing", ""));
    assert!(thing.qos.contains("best_effort") && bag.topics()[of("/latched")].qos.contains("transient_local"));
}

fn regex_of(text: &str) -> regex::Regex {
    regex::Regex::new(text).unwrap()
}

/// A player of a bag in a thread.
struct Playing {
    controls: Sender<Control>,
    thread: JoinHandle<Played>,
    _services: Vec<Server>,
}

impl Playing {
    fn start(domain: &TestDomain, bag: Arc<Bag>, settings: PlaySettings) -> Self {
        let here = participant(domain, "rosbag2_player");
        let (controls, inbox): (Sender<Control>, Receiver<Control>) = channel();
        let services = serve(&here, &controls).unwrap();
        let player = Player::new(&here, bag, settings, &controls, inbox).unwrap();
        Self { controls, thread: std::thread::spawn(move || player.run(|_, _| ())), _services: services }
    }

    fn end(self) -> Played {
        // One that has come to its end does not listen any more.
        let _ = self.controls.send(Control::Stop(Done::nobody()));
        self.thread.join().unwrap()
    }
}

/// Has these topics played to late readers too: the player may find a reader some time after it was started.
fn for_late_readers(topics: &[&str]) -> PlaySettings {
    let yaml: String = topics.iter().map(|topic| format!("{topic}:\n  durability: transient_local\n")).collect();
    PlaySettings { qos_overrides: ros2_bags::qos::parse_overrides(&yaml).unwrap(), ..PlaySettings::default() }
}

/// A reader that gets what was published before it came.
fn late_reader() -> Qos {
    Qos { durability: Durability::TransientLocal, backlog: 4096, ..Qos::command() }
}

fn text_of(number: u64) -> String {
    format!("message {number}")
}

#[test]
fn a_bag_is_played_as_it_was_recorded_to_other_names_and_without_its_types() {
    let domain = TestDomain::claim();
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    let mut writer = BagWriter::create(&folder, WriteSettings::default()).unwrap();
    let (name, ros_type) = ("/thing".to_owned(), "other_msgs/msg/Thing".to_owned());
    let things = writer.add_topic(NewTopic { name, ros_type, ..NewTopic::default() }).unwrap();
    let texts = writer.add_topic(topic("/text", "std_msgs/msg/String")).unwrap();
    let clocks = writer.add_topic(topic("/clock", "rosgraph_msgs/msg/Clock")).unwrap();
    let big_endian = [0, 0, 0, 0, 0, 0, 0, 3, b'h', b'i', 0];
    for number in 0..200 {
        let time_ns = number * STEP_NS;
        writer.write(things, time_ns, time_ns, &[0, 1, 0, 0, u8::try_from(number).unwrap()]).unwrap();
        writer.write(texts, time_ns, time_ns, &big_endian).unwrap();
        writer.write(clocks, time_ns, time_ns, &common::encoded(&Clock::default())).unwrap();
    }
    writer.finish().unwrap();

    let listener = participant(&domain, "listener");
    let heard = Heard::default();
    let _readers = [
        heard.listen(&listener, "/thing", UNKNOWN, &late_reader()),
        heard.listen(&listener, "/renamed", &Text::INFO.dds_type(), &late_reader()),
        heard.listen(&listener, "/clock", &Clock::INFO.dds_type(), &Qos::sensor()),
    ];
    let settings = PlaySettings {
        start_paused: true,
        remaps: [("/text".to_owned(), "/renamed".to_owned())].into(),
        clock_hz: Some(100.0),
        ..for_late_readers(&["/text", "/thing"])
    };
    let playing = Playing::start(&domain, Arc::new(Bag::open(&folder).unwrap()), settings);
    wait_for("the player", || {
        let graph = listener.discovered();
        ["/thing", "/renamed", "/clock"].iter().all(|topic| graph.writers_of(topic).count() == 1)
    });
    let graph = listener.discovered();
    let offered = graph.writers_of("/renamed").next().unwrap();
    assert_eq!((offered.reliability, offered.durability), (Reliability::Reliable, Durability::TransientLocal));
    // Time stands still, and /clock says so again and again.
    wait_for("a reader of each", || heard.of("/clock").len() > 3);
    assert_eq!(heard.of("/thing").len(), 0);
    playing.controls.send(Control::Resume(Done::nobody())).unwrap();
    wait_for("all messages", || heard.of("/thing").len() == 200 && heard.texts("/renamed").len() == 200);
    let played = playing.end();
    assert_eq!((played.messages, played.failed.len()), (400, 0), "{played:?}");
    assert!(heard.texts("/renamed").iter().all(|text| text == "hi"));
    let order: Vec<u8> = heard.of("/thing").iter().map(|body| body[0]).collect();
    assert!(order.iter().copied().eq(0..200), "{order:?}");
    let clocks = heard.of("/clock");
    let times: Vec<Time> = clocks.iter().map(|body| cdr::decode::<Clock>(body, true).unwrap().clock).collect();
    assert!(times.is_sorted_by_key(|time| (time.sec, time.nanosec)), "{times:?}");
    assert!(times.last().unwrap().nanosec > 100_000_000 && times[0].nanosec == 0, "{times:?}");
}

#[test]
fn the_services_of_rosbag2s_player_control_ours() {
    let domain = TestDomain::claim();
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), 1000);
    let client = participant(&domain, "client");
    let heard = Heard::default();
    let _reader = heard.listen(&client, "/text", &Text::INFO.dds_type(), &late_reader());
    let settings = PlaySettings {
        start_paused: true,
        selection: Selection::of(vec!["/text".to_owned()]),
        ..for_late_readers(&["/text"])
    };
    let playing = Playing::start(&domain, Arc::new(Bag::open(&folder).unwrap()), settings);
    wait_for("the player", || client.discovered().writers_of("/text").count() == 1);
    fn call<S: Service>(client: &Participant, name: &str, request: &S::Request) -> S::Response {
        let service = client.service_client::<S>(&format!("/rosbag2_player/{name}")).unwrap();
        service.call(request, PATIENCE).wait().unwrap()
    }
    assert!(call::<IsPaused>(&client, "is_paused", &IsPausedRequest::default()).paused);
    assert!(call::<PlayNext>(&client, "play_next", &PlayNextRequest::default()).success);
    wait_for("one message", || heard.texts("/text") == [text_of(0)]);
    assert_eq!(call::<Burst>(&client, "burst", &BurstRequest { num_messages: 5 }).actually_burst, 5);
    wait_for("six messages", || heard.texts("/text").len() == 6);
    let seek = |nanosec| SeekRequest { time: Time { sec: 0, nanosec } };
    assert!(call::<Seek>(&client, "seek", &seek(990_000_000)).success);
    assert!(!call::<Seek>(&client, "seek", &SeekRequest { time: Time { sec: 7, nanosec: 0 } }).success);
    assert!(!call::<SetRate>(&client, "set_rate", &SetRateRequest { rate: -1.0 }).success);
    assert!(call::<SetRate>(&client, "set_rate", &SetRateRequest { rate: 2.0 }).success);
    let rate = call::<GetRate>(&client, "get_rate", &GetRateRequest::default()).rate;
    assert!((rate - 2.0).abs() < 1e-12, "{rate}");
    call::<Resume>(&client, "resume", &ResumeRequest::default());
    wait_for("the end", || heard.texts("/text").len() == 16);
    let expected: Vec<String> = (0..6).chain(990..1000).map(text_of).collect();
    assert_eq!(heard.texts("/text"), expected);
    assert_eq!(playing.end().messages, 16);

    let stopped = Playing::start(
        &domain,
        Arc::new(Bag::open(&folder).unwrap()),
        PlaySettings { start_paused: true, ..PlaySettings::default() },
    );
    call::<Stop>(&client, "stop", &StopRequest::default());
    assert_eq!(stopped.thread.join().unwrap().messages, 0);
}

/// On a busy machine every reader is now and then as late as this one.
#[test]
fn a_reader_that_is_late_has_the_last_messages_of_a_bag_too() {
    const COUNT: u64 = 20;
    let domain = TestDomain::claim();
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), COUNT);
    let listener = participant(&domain, "listener");
    let heard = Arc::new(Mutex::new(0));
    let deliver = {
        let heard = Arc::clone(&heard);
        move |_| {
            let mut heard = heard.lock().unwrap();
            if *heard == 0 {
                // Longer than the bag.
                std::thread::sleep(Duration::from_millis(100));
            }
            *heard += 1;
        }
    };
    let reader = listener.reader("/text", &Text::INFO.dds_type(), &late_reader(), deliver).unwrap();
    let selection = Selection::of(vec!["/text".to_owned()]);
    let settings = PlaySettings { start_paused: true, selection, ..for_late_readers(&["/text"]) };
    let playing = Playing::start(&domain, Arc::new(Bag::open(&folder).unwrap()), settings);
    wait_for("the player", || reader.matched_writers() == 1);
    playing.controls.send(Control::Resume(Done::nobody())).unwrap();
    let played = playing.thread.join().unwrap();
    assert_eq!((played.messages, played.failed.len()), (COUNT, 0), "{played:?}");
    wait_for("the last message", || *heard.lock().unwrap() == COUNT);
}

#[test]
fn an_external_clock_drives_playing() {
    let domain = TestDomain::claim();
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("bag");
    good(&folder, WriteSettings::default(), 100);
    let master = participant(&domain, "master");
    let heard = Heard::default();
    let _reader = heard.listen(&master, "/text", &Text::INFO.dds_type(), &late_reader());
    let clock = master.writer("/clock", &Clock::INFO.dds_type(), &Qos::command()).unwrap();
    let settings = PlaySettings { follow_clock: true, ..for_late_readers(&["/text"]) };
    let playing = Playing::start(&domain, Arc::new(Bag::open(&folder).unwrap()), settings);
    wait_for("the player", || clock.matched_readers() == 1 && master.discovered().writers_of("/text").count() == 1);
    let tell = |nanosec| {
        let message = Clock { clock: Time { sec: 0, nanosec } };
        clock.publish(cdr::encode(&message).unwrap()).unwrap();
    };
    // Until the player has found the clock, what it is told may get lost.
    wait_for("the first ten", || {
        tell(9_500_000);
        heard.texts("/text").len() == 10
    });
    tell(20_000_000);
    wait_for("eleven more", || heard.texts("/text").len() == 21);
    tell(99_000_000);
    wait_for("the rest", || heard.texts("/text").len() == 100);
    let played = playing.end();
    assert_eq!(played.messages, 200);
    assert_eq!(messages(&Bag::open(&folder).unwrap()).len(), 200);
}
