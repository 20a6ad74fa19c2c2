//! The server as viewers meet it, good ones and bad ones. Nothing runs on the graph.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use feeder_runtime::testing::TestDomain;
use feeder_scenario::plan::load_plan;
use feeder_view::{Place, Settings, Source, View};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::http::StatusCode;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Error, Message, WebSocket};

/// Longest wait for anything. It only keeps a failing test from hanging.
const PATIENCE: Duration = Duration::from_secs(60);

fn settings(domain: &TestDomain, place: &str) -> Settings {
    Settings {
        place: Some(place.parse().unwrap()),
        read_only: false,
        source: Source::Run,
        scenario: "default".to_owned(),
        domain: **domain,
    }
}

fn start(settings: &Settings) -> View {
    View::start(&load_plan(None).unwrap(), settings).unwrap()
}

fn loopback(view: &View) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], view.address().unwrap().port()))
}

/// A viewer that says where it comes from, and how it was let in or why not.
fn connect(view: &View, path: &str, origin: Option<&str>) -> Result<WebSocket<TcpStream>, StatusCode> {
    let address = loopback(view);
    let mut request = format!("ws://{address}{path}").into_client_request().unwrap();
    origin.into_iter().for_each(|origin| _ = request.headers_mut().insert("origin", origin.parse().unwrap()));
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    match tungstenite::client(request, stream) {
        Ok((socket, _)) => Ok(socket),
        Err(tungstenite::HandshakeError::Failure(Error::Http(response))) => Err(response.status()),
        Err(error) => panic!("{error}"),
    }
}

fn viewer(view: &View) -> WebSocket<TcpStream> {
    connect(view, "/ws", None).unwrap()
}

/// The next message of this type.
#[track_caller]
fn next(socket: &mut WebSocket<TcpStream>, wanted: &str) -> Value {
    loop {
        if let Message::Text(text) = socket.read().unwrap() {
            let message: Value = serde_json::from_str(&text).unwrap();
            if message["type"] == wanted {
                return message;
            }
        }
    }
}

/// How the server ends the conversation, and the error it tells before.
#[track_caller]
fn end(socket: &mut WebSocket<TcpStream>) -> (CloseCode, String) {
    let mut told = String::new();
    loop {
        match socket.read().unwrap() {
            Message::Text(text) => {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["type"] == "error" {
                    told = message["message"].as_str().unwrap().to_owned();
                }
            }
            Message::Close(Some(frame)) => return (frame.code, told),
            Message::Close(None) => panic!("no reason"),
            _ => {}
        }
    }
}

fn say(socket: &mut WebSocket<TcpStream>, message: &Value) {
    socket.send(Message::text(message.to_string())).unwrap();
}

fn get(view: &View, head: &str) -> String {
    let mut stream = TcpStream::connect(loopback(view)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    write!(stream, "{head}\r\nConnection: close\r\n\r\n").unwrap();
    std::io::read_to_string(stream).unwrap()
}

#[test]
fn the_page_comes_with_rules_for_the_browser() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let port = view.address().unwrap().port();
    let page = get(&view, &format!("GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}"));
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    for header in ["content-type: text/html; charset=utf-8", "default-src 'none'", "x-content-type-options: nosniff"] {
        assert!(page.contains(header), "{header} in {page}");
    }
    for missing in ["/nothing.js", "/../Cargo.toml", "/a/b", "/%2e%2e%2fCargo.toml"] {
        let answer = get(&view, &format!("GET {missing} HTTP/1.1\r\nHost: 127.0.0.1:{port}"));
        assert!(answer.starts_with("HTTP/1.1 404"), "{missing}: {answer}");
    }
    let foreign = get(&view, &format!("GET / HTTP/1.1\r\nHost: feeder.example:{port}"));
    assert!(foreign.starts_with("HTTP/1.1 403"), "{foreign}");
}

#[test]
fn a_viewer_is_greeted_with_the_cell_and_what_it_may_do() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut socket = connect(&view, "/ws", Some(&format!("http://{}", loopback(&view)))).unwrap();
    let hello = next(&mut socket, "hello");
    assert_eq!((&hello["protocol"], &hello["source"], &hello["read_only"]), (&json!(1), &json!("run"), &json!(false)));
    let tray = &hello["feeders"][0]["tray"];
    assert_eq!((&tray["outer_radius_m"], &tray["rise_m"]), (&json!(0.09), &json!(0.02)));
    assert!(hello["part"]["triangles"].as_array().unwrap().len() >= 12);
    let frame = next(&mut socket, "frame");
    assert_eq!((&frame["time_s"], &frame["feeders"]["feeder"]["courier"]), (&Value::Null, &Value::Null));
}

#[test]
fn a_page_of_somewhere_else_is_turned_away() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    for origin in ["http://example.com", "https://127.0.0.1", "null"] {
        assert_eq!(connect(&view, "/ws", Some(origin)).err(), Some(StatusCode::FORBIDDEN), "{origin}");
    }
    next(&mut viewer(&view), "hello");
}

#[test]
fn whoever_comes_from_elsewhere_needs_the_token() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0.0.0.0:0"));
    let (_, token) = view.url().unwrap().split_once("?token=").unwrap();
    assert_eq!(token.len(), 32);
    let wrong = token.replace(token.chars().next().unwrap(), "z");
    for path in ["/ws", "/ws?token=", &format!("/ws?token={wrong}"), &format!("/ws?token={token}0")] {
        assert_eq!(connect(&view, path, None).err(), Some(StatusCode::UNAUTHORIZED), "{path}");
    }
    next(&mut connect(&view, &format!("/ws?token={token}"), None).unwrap(), "hello");
}

#[test]
fn what_makes_no_sense_ends_the_conversation_and_no_other() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut good = viewer(&view);
    next(&mut good, "hello");
    for (nonsense, why) in [
        (Message::text("{"), "cannot be read"),
        (Message::text("[1, 2]"), "cannot be read"),
        (Message::text(r#"{"type": "dance"}"#), "dance"),
        (Message::text(r#"{"type": "subscribe", "channels": ["telepathy"]}"#), "telepathy"),
        (Message::text(r#"{"type": "subscribe", "channels": [], "feeder": "bird"}"#), "bird"),
        (Message::text(r#"{"type": "control", "name": "pause"}"#), "id"),
        (Message::binary(vec![0_u8; 5]), "not text"),
    ] {
        let mut bad = viewer(&view);
        bad.send(nonsense).unwrap();
        let (code, told) = end(&mut bad);
        assert_eq!(code, CloseCode::Policy);
        assert!(told.contains(why), "{told}");
    }
    say(&mut good, &json!({ "type": "control", "id": 7, "name": "speed", "arguments": { "speed": 5000 } }));
    assert_eq!(next(&mut good, "reply")["id"], 7);
}

#[test]
fn a_message_beyond_the_limit_ends_the_conversation() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut bad = viewer(&view);
    bad.send(Message::text("x".repeat(17 * 1024))).unwrap();
    let (code, told) = end(&mut bad);
    assert_eq!(code, CloseCode::Size);
    assert!(told.contains("17408 bytes, allowed are 16384"), "{told}");
    next(&mut viewer(&view), "hello");
}

#[test]
fn a_flood_ends_the_conversation() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut bad = viewer(&view);
    let subscribe = json!({ "type": "subscribe", "channels": [] });
    // More than may come at once; the rest finds nobody who listens.
    for _ in 0..60 {
        if bad.send(Message::text(subscribe.to_string())).is_err() {
            break;
        }
    }
    // Ends the conversation in any case, for another reason where the flood was let through.
    let _ = bad.send(Message::text("{"));
    let (code, told) = end(&mut bad);
    assert_eq!(code, CloseCode::Policy);
    assert!(told.contains("20 messages a second"), "{told}");
    next(&mut viewer(&view), "hello");
}

#[test]
fn half_a_message_and_half_a_request_hold_nobody_up() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut half = TcpStream::connect(loopback(&view)).unwrap();
    half.write_all(b"GET / HTTP/1.1\r\nHost: 127").unwrap();
    let mut halting = viewer(&view);
    next(&mut halting, "hello");
    // A text of 126 bytes or more is announced, and two bytes of its length are missing.
    halting.get_mut().write_all(&[0x81, 0xfe]).unwrap();
    next(&mut viewer(&view), "hello");
    drop(view);
}

#[test]
fn whoever_never_reads_loses_the_place() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let _silent = viewer(&view);
    assert_eq!(view.viewers(), 1);
    // After some questions without an answer whether it is still there.
    let since = Instant::now();
    while view.viewers() > 0 {
        assert!(since.elapsed() < PATIENCE, "it is still there");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn half_requests_take_so_many_places_and_no_more() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let half = || {
        let mut stream = TcpStream::connect(loopback(&view)).unwrap();
        // Whoever finds no place may find the connection closed already.
        let _ = stream.write_all(b"GET / HTTP/1.1\r\nHost: 127");
        stream
    };
    let halves: Vec<TcpStream> = (0..128).map(|_| half()).collect();
    let answer = |stream: &mut TcpStream| {
        let mut answer = Vec::new();
        let _ = stream.write_all(b".0.0.1\r\nConnection: close\r\n\r\n");
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8(answer).unwrap()
    };
    assert_eq!(answer(&mut half()), "", "there is no place left");
    drop(halves);
    while !answer(&mut half()).starts_with("HTTP/1.1 200") {
        std::thread::yield_now();
    }
}

#[test]
fn controls_that_cannot_be_are_refused_with_the_reason() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut socket = viewer(&view);
    for (control, words) in [
        (json!({ "name": "speed", "arguments": { "speed": -1 } }), "allowed are 0.001 to 1000"),
        (json!({ "name": "load_parts", "arguments": { "count": 101 } }), "whole numbers from 1 to 100"),
        (json!({ "name": "set_waveform", "arguments": { "scale": 3.99 } }), "scale = 3.99"),
        (json!({ "name": "fly" }), "\"fly\" is no control"),
        (json!({ "name": "cancel" }), "no delivery"),
        (json!({ "name": "load_parts", "feeder": "bird" }), "bird"),
    ] {
        let mut message = control;
        message["type"] = json!("control");
        message["id"] = json!(3);
        say(&mut socket, &message);
        let reply = next(&mut socket, "reply");
        assert_eq!((&reply["id"], &reply["ok"]), (&json!(3), &json!(false)));
        assert!(reply["message"].as_str().unwrap().contains(words), "{reply}");
    }
}

#[test]
fn so_many_controls_are_under_way_and_no_more() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut socket = viewer(&view);
    // Nobody answers them.
    for id in 1..=9 {
        say(&mut socket, &json!({ "type": "control", "id": id, "name": "load_parts" }));
    }
    let reply = loop {
        let reply = next(&mut socket, "reply");
        if reply["id"] == 9 {
            break reply;
        }
    };
    assert!(reply["message"].as_str().unwrap().contains("too much is under way"), "{reply}");
}

#[test]
fn a_view_that_only_shows_refuses_everything() {
    let domain = TestDomain::claim();
    let view = start(&Settings { read_only: true, ..settings(&domain, "0") });
    let mut socket = viewer(&view);
    let hello = next(&mut socket, "hello");
    for control in hello["controls"].as_array().unwrap() {
        assert_eq!(control["permitted"], false, "{control}");
        say(&mut socket, &json!({ "type": "control", "id": 1, "name": control["name"] }));
        let reply = next(&mut socket, "reply");
        assert_eq!((&reply["ok"], &reply["message"]), (&json!(false), &json!("this view only shows")));
    }
}

#[test]
fn there_is_room_for_so_many_viewers() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let inside: Vec<_> = (0..16).map(|_| viewer(&view)).collect();
    assert_eq!(connect(&view, "/ws", None).err(), Some(StatusCode::SERVICE_UNAVAILABLE));
    assert_eq!(view.viewers(), 16);
    drop(inside);
    while view.viewers() > 0 {
        std::thread::yield_now();
    }
    next(&mut viewer(&view), "hello");
}

#[test]
fn viewers_hear_that_the_server_leaves() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let mut socket = viewer(&view);
    next(&mut socket, "hello");
    drop(view);
    assert_eq!(end(&mut socket).0, CloseCode::Away);
}

#[test]
fn a_port_that_is_taken_is_an_error_unless_any_will_do() {
    let domain = TestDomain::claim();
    let view = start(&settings(&domain, "0"));
    let taken = Settings { place: Some(Place::At(view.address().unwrap())), ..settings(&domain, "0") };
    let error = View::start(&load_plan(None).unwrap(), &taken).err().unwrap();
    assert!(error.to_string().contains(&view.address().unwrap().to_string()), "{error}");
}
