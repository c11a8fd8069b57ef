//! A viewer that speaks Foxglove's subprotocol, beside writers of the test.

use crate::live::{Writers, program};
use crate::support::loaded;
use foxglove::Decode;
use foxglove::messages::JointStates;
use instance::Instance;
use record::Topic;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::process::Stdio;
use std::time::Duration;
use tungstenite::client::IntoClientRequest;
use tungstenite::{Error, HandshakeError, Message, WebSocket};

type Viewer = WebSocket<TcpStream>;

/// Opens the address as a page from elsewhere does, or returns the status of the refusal.
fn open(address: &str, protocols: &str) -> Result<Viewer, u16> {
    let mut request = address.into_client_request().expect("an address");
    let host = request.uri().authority().expect("a host").to_string();
    for (name, value) in [("sec-websocket-protocol", protocols), ("origin", "https://example.org")] {
        request.headers_mut().insert(name, value.parse().expect("a value"));
    }
    let stream = TcpStream::connect(host).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a limit");
    match tungstenite::client(request, stream) {
        Ok((viewer, _)) => Ok(viewer),
        Err(HandshakeError::Failure(Error::Http(answer))) => Err(answer.status().as_u16()),
        Err(error) => panic!("{error}"),
    }
}

/// Returns a viewer and the channels that it was offered.
fn connect(address: &str) -> (Viewer, Vec<Value>) {
    let mut viewer = open(address, "foxglove.sdk.v1, other").expect("a handshake");
    assert_eq!(text(&mut viewer)["capabilities"], json!(["assets"]), "nothing to write");
    let mut channels = Vec::new();
    while channels.len() < Topic::ALL.len() {
        channels.extend(text(&mut viewer)["channels"].as_array().expect("channels").clone());
    }
    (viewer, channels)
}

fn send(viewer: &mut Viewer, message: Value) {
    viewer.send(Message::text(message.to_string())).expect("sent");
}

fn text(viewer: &mut Viewer) -> Value {
    serde_json::from_str(viewer.read().expect("a message").to_text().expect("a text")).expect("JSON")
}

/// Reads a message of a channel: the topic, the time and the data. `None` at the end.
fn message(viewer: &mut Viewer, channels: &[Value]) -> Option<(String, u64, Vec<u8>)> {
    let Ok(Message::Binary(bytes)) = viewer.read() else { return None };
    // An opcode, the subscription, the time and the message.
    let number = |from: usize, to: usize| bytes[from..to].iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
    let channel = channels.iter().find(|channel| channel["id"] == number(1, 5)).expect("its channel");
    Some((channel["topic"].as_str().expect("a topic").to_owned(), number(5, 13), bytes[13..].to_vec()))
}

/// Times of the last messages by topic.
fn last(seen: &BTreeSet<(String, u64, Vec<u8>)>) -> BTreeMap<&str, u64> {
    seen.iter().map(|(topic, time, _)| (topic.as_str(), *time)).collect()
}

/// Asks for what no viewer gets. Each time the answer says why, or the viewer ends alone.
fn abuse(address: &str, silent: &mut Viewer) {
    for (wrong, part) in [
        (json!({ "op": "advertise", "channels": [] }), "only read"),
        (json!({ "op": "subscribe", "subscriptions": [{ "id": 99, "channelId": 99 }] }), "does not exist"),
    ] {
        send(silent, wrong);
        let refusal = text(silent);
        assert!(refusal["message"].as_str().is_some_and(|text| text.contains(part)), "{refusal}");
    }
    let (without, token) = address.split_once("token=").expect("a token");
    for (address, protocol) in [
        (without.trim_end_matches("/?").to_owned(), "foxglove.sdk.v1"),
        (format!("{without}token={}0", &token[1..]), "foxglove.sdk.v1"),
        (address.to_owned(), "foxglove.sdk.v2"),
    ] {
        assert_eq!(open(&address, protocol).err(), Some(403), "{address} {protocol}");
    }
    let (mut long, _) = connect(address);
    long.get_mut().write_all(&[0x81, 0xff, 0, 0, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0]).expect("sent");
    assert!(long.read().is_err(), "the head of a frame of 1 MiB ends its viewer, because 16 kB are allowed");
    let (mut leaver, _) = connect(address);
    leaver.close(None).expect("sent");
    assert!(leaver.read().expect("an answer").is_close(), "a viewer leaves in order");
}

/// One viewer sees what is recorded. Another one never reads, and tries to write.
#[test]
fn f145_viewer_sees_what_is_recorded_whatever_another_one_does() {
    let folder = tempfile::tempdir().unwrap();
    let instance = Instance::new(&folder.path().join("run")).unwrap();
    let (mut writers, out) = (Writers::new(&instance), folder.path().join("out.mcap"));
    let mut child = program(instance.run_dir(), &out).arg("--foxglove=0").stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    let line = lines.next().expect("a line").expect("a text");
    let address = line.rsplit(' ').next().filter(|address| address.starts_with("ws://127.0.0.1:")).expect(&line);

    let (mut silent, channels) = connect(address);
    let other = format!("file:///etc/{}passwd", "./".repeat(1 << 12));
    for (uri, failed, part) in [("package://robot/tiago_dual.urdf", 0, "<robot"), (&other, 1, "there is only")] {
        send(&mut silent, json!({ "op": "fetchAsset", "uri": uri, "requestId": 7 }));
        let Message::Binary(bytes) = silent.read().expect("a message") else { panic!("an asset") };
        assert_eq!(bytes[..6], [4, 7, 0, 0, 0, failed]);
        assert!(String::from_utf8_lossy(&bytes[10..]).contains(part) && bytes.len() < 1 << 20, "{part}");
    }
    let (mut viewer, _) = connect(address);
    let all = channels[..1].iter().chain(&channels).map(|one| json!({ "id": one["id"], "channelId": one["id"] }));
    let subscribe = json!({ "op": "subscribe", "subscriptions": all.collect::<Vec<_>>() });
    for viewer in [&mut silent, &mut viewer] {
        send(viewer, subscribe.clone());
        assert!(text(viewer)["message"].as_str().is_some_and(|text| text.contains("channel 0 does not exist, or is")));
    }
    abuse(address, &mut silent);
    let shown = channels.clone();
    let reading =
        std::thread::spawn(move || std::iter::from_fn(|| message(&mut viewer, &shown)).collect::<BTreeSet<_>>());
    writers.publish_for(Duration::from_secs(5));
    rt::terminate(child.id());
    assert!(child.wait().expect("it ends").success());
    let (seen, sent) = (reading.join().expect("messages"), writers.sent);
    let file = std::fs::read(&out).unwrap();
    let recorded: BTreeSet<_> = mcap::MessageStream::new(&file)
        .unwrap()
        .map(|message| {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().expect("a schema");
            let shown = channels.iter().find(|shown| shown["topic"] == message.channel.topic).expect("a channel");
            assert!(shown["schemaName"] == schema.name, "{shown}");
            assert!(shown["encoding"] == message.channel.message_encoding, "{shown}");
            (message.channel.topic.clone(), message.log_time, message.data.into_owned())
        })
        .collect();
    assert!(seen.is_subset(&recorded), "bit for bit");
    assert_eq!(last(&seen), last(&recorded), "only the oldest are lost");
    for topic in ["/tf", "/joint_states/measured", "/joint_states/command", "/scene/robot", "/teleop/status"] {
        assert!(seen.iter().filter(|(of, ..)| of == topic).count() > 30, "{topic}");
    }
    let model = loaded().model;
    for (.., bytes) in seen.iter().filter(|(topic, ..)| topic == "/joint_states/measured") {
        let shown = JointStates::decode(&bytes[..]).expect("joints");
        let shown: Vec<_> = shown.joints.iter().map(|joint| joint.position.expect("a position")).collect();
        assert!(sent.iter().any(|command| command.q[..model.count] == shown), "the robot's joints");
    }
    instance.retire();
}
