//! Tests that a page shows a recording as it was recorded.

use crate::frames::{model, shown};
use messages::{JointCommand, Layout, Mode, RobotState, Stamp, Status, Transition};
use serde_json::{Value, json};
use std::io::Write;
use std::net::TcpStream;
use std::sync::mpsc;
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};
use view::{Field, LatestMessages, RecordingViewBuilder, Server};

type Socket = WebSocket<MaybeTlsStream<TcpStream>>;

fn page(server: &Server) -> Socket {
    let (origin, token) = server.address().split_once("/#").expect("a token");
    let mut request = format!("{}/live?token={token}", origin.replace("http", "ws")).into_client_request().unwrap();
    request.headers_mut().insert("origin", origin.parse().unwrap());
    tungstenite::connect(request).expect("it listens").0
}

fn ask(socket: &mut Socket, what: Value) {
    socket.send(Message::text(what.to_string())).expect("it listens");
}

fn until(socket: &mut Socket, at_s: f32, within_s: f32) -> Vec<f32> {
    let give_up = Instant::now() + Duration::from_secs(10);
    loop {
        assert!(Instant::now() < give_up, "never at {at_s} s");
        let Message::Binary(bytes) = socket.read().expect("frames") else { continue };
        let numbers: Vec<_> = bytes.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect();
        if (numbers[Field::AtS as usize] - at_s).abs() <= within_s {
            return numbers;
        }
    }
}

/// Ten seconds at 120 Hz. The head turns by 0.1 rad a second. The mode is Engaged from 4 s to 6 s.
fn recorded() -> view::RecordingView {
    let model = model();
    let mut builder = RecordingViewBuilder::new(&model);
    let (mut state, mut status) = (RobotState::ZERO, Status::ZERO);
    let mut command = JointCommand::ZERO;
    (state.robot, command.robot) = (model.id(), model.id());
    state.q_measured = model.home;
    for n in 0..=1200 {
        let at_s = f64::from(n) / 120.0;
        state.q_measured[1] = 0.1 * at_s;
        let mode = if (4.0..6.0).contains(&at_s) { Mode::Engaged } else { Mode::Disengaged };
        if status.mode != mode as u32 {
            let why = if mode == Mode::Engaged { Transition::ALIGNED } else { Transition::AT_REST };
            let made = Transition { k: 1, from: status.mode, to: mode as u32, why, about: 0 };
            status.transitions[status.transition_count as usize] = made;
            status.transition_count += 1;
            status.mode = mode as u32;
        }
        status.header.stamp = Stamp(1_000_000_000 + n as u64);
        let heard = LatestMessages {
            state: Some(state),
            status: Some(status),
            command: Some(command),
            ..LatestMessages::default()
        };
        builder.add(&heard, at_s);
    }
    builder.build()
}

#[test]
fn page_plays_pauses_and_seeks_recording() {
    let recording = recorded();
    assert_eq!(recording.duration_s(), 10.0);
    // The initial state and every change: three sentences.
    assert_eq!(recording.events().len(), 3, "{:?}", recording.events());
    let server = Server::recording(recording, "head.mcap", &shown(), 0).expect("a port");
    let mut socket = page(&server);
    ask(&mut socket, json!({ "do": "pause" }));
    for (to_s, mode) in [(5.0, Mode::Engaged), (2.5, Mode::Disengaged), (9.0, Mode::Disengaged), (4.5, Mode::Engaged)] {
        ask(&mut socket, json!({ "do": "seek", "to_s": to_s }));
        let frame = until(&mut socket, to_s, 0.02);
        assert_eq!(frame[Field::Mode as usize], mode as u32 as f32, "at {to_s} s");
    }
    // The recording stands still while paused, and continues when it plays.
    let frame = until(&mut socket, 4.5, 0.02);
    let stands = || until(&mut socket, 4.5, 0.02)[Field::AtS as usize] == frame[Field::AtS as usize];
    assert!(wait::holds_for(Duration::from_millis(200), stands));
    ask(&mut socket, json!({ "do": "play" }));
    until(&mut socket, 5.0, 0.1);
    // A position beyond the end becomes the end. Playing from there starts at the beginning.
    ask(&mut socket, json!({ "do": "seek", "to_s": 1e300 }));
    until(&mut socket, 10.0, 0.0);
    // Nothing that the page receives says that it has ended.
    std::thread::sleep(Duration::from_millis(50));
    ask(&mut socket, json!({ "do": "play" }));
    until(&mut socket, 0.5, 0.4);
}

fn playing(socket: &mut Socket) -> Value {
    loop {
        let Message::Text(text) = socket.read().expect("it tells") else { continue };
        let message: Value = serde_json::from_str(&text).expect("JSON");
        if message["tell"] == "reel" {
            return message["playing"].clone();
        }
    }
}

#[test]
fn every_page_is_told_whether_the_recording_plays() {
    let server = Server::recording(recorded(), "head.mcap", &shown(), 0).expect("a port");
    let mut first = page(&server);
    assert_eq!(playing(&mut first), true);
    ask(&mut first, json!({ "do": "pause" }));
    assert_eq!(playing(&mut first), false);
    let mut second = page(&server);
    assert_eq!(playing(&mut second), false, "it was paused before this page came");
    ask(&mut second, json!({ "do": "play" }));
    assert_eq!((playing(&mut first), playing(&mut second)), (true.into(), true.into()));
    ask(&mut first, json!({ "do": "seek", "to_s": 1e300 }));
    assert_eq!(playing(&mut second), false, "it stands at its end");
}

#[test]
fn unknown_request_to_recording_closes_page() {
    let server = Server::recording(recorded(), "head.mcap", &shown(), 0).expect("a port");
    for bad in [
        json!({ "do": "engage" }),
        json!({ "do": "stop" }),
        json!({ "do": "join" }),
        json!({ "do": "mix", "shares": [1, 0, 0] }),
        json!({ "do": "seek" }),
        json!({ "do": "seek", "to_s": "a" }),
        json!({ "do": "here", "x": 1 }),
        json!({ "do": "play", "to_s": 1.0 }),
        json!({ "do": "seek", "to_s": 1.0, "x": 1 }),
    ] {
        let mut socket = page(&server);
        ask(&mut socket, bad.clone());
        // The page sends `here`, so its silence does not end it. It receives none of the 60 frames a second any more.
        let mut goes_on = |_| socket.send(Message::text(r#"{"do":"here"}"#)).is_ok() && socket.read().is_ok();
        assert!(!(0..200).all(&mut goes_on), "{bad} is taken");
    }
}

#[test]
fn page_with_endless_message_does_not_block_server_end() {
    let server = Server::recording(recorded(), "head.mcap", &shown(), 0).expect("a port");
    let mut socket = page(&server);
    let MaybeTlsStream::Plain(stream) = socket.get_mut() else { panic!("no TLS on the loopback") };
    let mut stream = stream.try_clone().expect("a twin");
    stream.set_write_timeout(Some(Duration::from_secs(1))).expect("a limit");
    // Sends a text frame that is not the last of its message, then empty frames of the same message without end.
    stream.write_all(&[0x01, 0x81, 0, 0, 0, 0, b'a']).expect("taken");
    let more = [0x00, 0x80, 0, 0, 0, 0].repeat(1000);
    let talker = std::thread::spawn(move || while stream.write_all(&more).is_ok() {});
    // The server reads the endless message by then. Nothing says so.
    std::thread::sleep(Duration::from_millis(200));
    let (ended, seen) = mpsc::channel();
    let end = std::thread::spawn(move || {
        drop(server);
        let _ = ended.send(());
    });
    assert!(seen.recv_timeout(Duration::from_secs(10)).is_ok(), "it never ends");
    end.join().expect("no panic");
    talker.join().expect("no panic");
}
