//! Tests the page on the loopback interface against the real processes: as a program, and in a browser if there is one.

use crate::browser::Browser;
use crate::viewer::{Page, Viewer};
use harness::{Rig, config, in_real_time};
use messages::{Fault, Faults, Layout, Mode, Status};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use tungstenite::Message;

fn first_line(answer: &str) -> &str {
    answer.lines().next().unwrap_or("")
}

#[test]
fn page_engages_and_stops_and_releases_when_it_is_silent() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let client = rig.shared_memory_client();
        let (operator, viewer) = (rig.operator_session(), Viewer::start(&rig));
        operator.wait_free();
        let mut page = viewer.page();
        let scene = page.message("scene");
        assert_eq!(scene["joints"].as_array().map(Vec::len), Some(17));
        assert!(page.frame().len() > 500);
        // Keeping an enable that was never pressed has no effect.
        page.request("keep");
        page.until(Mode::Disengaged, false);
        page.request("engage");
        assert_eq!(page.message("hand")["held"], true);
        page.until(Mode::Engaged, true);
        // After silence the enable is released, and the page is informed.
        let message = page.message("hand");
        assert_eq!(
            (&message["held"], message["text"].as_str().is_some_and(|text| text.contains("stopped answering"))),
            (&json!(false), true)
        );
        operator.wait_mode(Mode::Disengaged);
        // A late `keep` engages nothing.
        for _ in 0..30 {
            page.request("keep");
            page.frame();
        }
        assert_eq!(operator.mode(), Some(Mode::Disengaged));
        page.request("engage");
        page.until(Mode::Engaged, true);
        // The robot stands under the clutch, and comes again.
        page.send(&json!({ "do": "clutch", "held": true }));
        page.until(Mode::Holding, true);
        page.send(&json!({ "do": "clutch", "held": false }));
        page.until(Mode::Engaged, true);
        // A closed page releases the enable.
        page.send(&json!({ "do": "clutch", "held": true }));
        page.until(Mode::Holding, true);
        drop(page);
        operator.wait_mode(Mode::Disengaged);
        let mut page = viewer.page();
        page.request("stop");
        operator.wait_mode(Mode::Faulted);
        page.until(Mode::Faulted, false);
        page.request("reset");
        operator.wait_mode(Mode::Disengaged);
        // The enable is refused in words, because there is no person to follow.
        drop(client);
        operator.wait("without input", |status| Faults(status.faults).has(Fault::InputStale));
        page.request("engage");
        assert_eq!(page.message("hand")["held"], true);
        let mut message = page.message("hand");
        while message["held"] == true {
            page.request("keep");
            message = page.message("hand");
        }
        drop(page);
        drop(viewer);
        rig.end_without_violations();
    });
}

#[test]
fn view_ends_when_its_parent_process_is_killed() {
    let rig = Rig::idle("");
    let (program, config, folder) = (env!("CARGO_BIN_EXE_teleopd"), config(), rig.folder());
    let view = format!("{program} view --port 0 --config {} --run-dir {}", config.display(), folder.display());
    let mut starter = Command::new("sh");
    starter.arg("-c").arg(format!("{view} --child-of $$ & wait")).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut starter = starter.spawn().expect("a shell");
    let mut printed = BufReader::new(starter.stdout.take().expect("a pipe"));
    let mut line = String::new();
    printed.read_line(&mut line).expect("its first words");
    assert!(line.contains("shows"), "{line}");
    starter.kill().expect("it runs");
    starter.wait().expect("it ends");
    // Its output ends when it ends.
    let (ended, seen) = std::sync::mpsc::channel();
    std::thread::spawn(move || ended.send(printed.read_to_string(&mut line)));
    assert!(seen.recv_timeout(harness::SOON).is_ok(), "the view goes on");
}

#[test]
fn demo_runs_once_a_page_is_open() {
    in_real_time(|| {
        let _rig = Rig::empty();
        let mut demo = Command::new(env!("CARGO_BIN_EXE_teleopd"))
            .args(["demo", "--view", "--view-port", "0", "--seconds", "1", "--quiet", "--config"])
            .arg(config())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .expect("it starts");
        let mut message = BufReader::new(demo.stdout.take().expect("its words"));
        let mut line = String::new();
        while !line.starts_with("open ") {
            line.clear();
            assert!(message.read_line(&mut line).expect("its words") > 0, "it ended without an address");
        }
        let address = line.split_whitespace().next_back().expect("an address").to_owned();
        let mut page = Page::at(&address);
        page.until(Mode::Engaged, false);
        let mut rest = String::new();
        message.read_to_string(&mut rest).expect("its report");
        let status = demo.wait().expect("it ends");
        assert!(status.success(), "{status}: {rest}");
        // The page ends with the demo.
        while page.socket.read().is_ok() {}
    });
}

#[test]
fn request_without_token_or_from_other_origin_is_refused() {
    let rig = Rig::idle("");
    let viewer = Viewer::start(&rig);
    let (host, token) = (viewer.host(), viewer.token());
    let upgrade = |host: &str, path: &str, origin: &str| {
        let key = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==";
        viewer.raw(&format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n{origin}{key}\r\n\r\n"))
    };
    let own = format!("Origin: http://{host}\r\n");
    let wrong = "0".repeat(token.len());
    for (host, path, origin, what) in [
        (host, "/live".to_owned(), own.as_str(), "no token"),
        (host, format!("/live?token={wrong}"), own.as_str(), "a wrong token"),
        (host, format!("/live?token={}", &token[1..]), own.as_str(), "a part of the token"),
        (host, format!("/live?token={token}"), "Origin: http://example.com\r\n", "another origin"),
        (host, format!("/live?token={token}"), "Origin: null\r\n", "a file"),
        (host, format!("/live?token={token}"), "", "no origin"),
        ("example.com", format!("/live?token={token}"), own.as_str(), "another name of this server"),
    ] {
        let answer = upgrade(host, &path, origin);
        assert_eq!(first_line(&answer), "HTTP/1.1 403 Forbidden", "{what}: {answer}");
    }
    let page = viewer.get("/");
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("default-src 'none'"), "{page}");
    assert!(!page.contains(token), "the page itself is for anybody on this machine");
    assert_eq!(first_line(&viewer.get("/../Cargo.toml")), "HTTP/1.1 404 Not Found");
    assert_eq!(
        first_line(&viewer.raw(&format!("POST / HTTP/1.1\r\nHost: {host}\r\n\r\n"))),
        "HTTP/1.1 405 Method Not Allowed"
    );
    // Garbage, and a header without end. The server closes the connection without an answer.
    assert_eq!(viewer.raw("\0\x01\x02\r\n\r\n"), "");
    assert_eq!(viewer.raw(&"a".repeat(20_000)), "");
    // A request that is not one of our page's ends the connection.
    for bad in ["{\"do\":\"dance\"}", "[]", "{\"do\":\"stop\",\"more\":1}", &"x".repeat(5000)] {
        let mut page = viewer.page();
        page.message("scene");
        page.socket.send(Message::text(bad)).unwrap();
        while page.socket.read().is_ok() {}
    }
    assert!(viewer.page().message("scene").is_object(), "it serves on");
}

#[test]
fn silent_connections_block_no_page_and_ping_flood_is_closed() {
    let rig = Rig::idle("");
    let viewer = Viewer::start(&rig);
    let mut open = viewer.page();
    open.message("scene");
    // More connections than the server accepts, with one byte each. As many again before each request.
    let mut silent = Vec::new();
    for _ in 0..5 {
        for _ in 0..40 {
            let mut one = TcpStream::connect(viewer.host()).expect("taken");
            one.write_all(b"G").expect("sent");
            silent.push(one);
        }
        let answer = viewer.get("/");
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }
    // An open page stays.
    open.socket.send(Message::Ping(vec![0].into())).expect("the server listens");
    while !matches!(open.socket.read().expect("it answers"), Message::Pong(_)) {}
    while open.socket.send(Message::Ping(vec![0].into())).is_ok() {}
}

#[test]
fn browser_shows_the_robot_moving_and_space_stops_it() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let client = rig.client(&motion::builtin(), 1);
        let (operator, viewer) = (rig.operator_session(), Viewer::start(&rig));
        operator.wait_free();
        let Some(mut browser) = Browser::open(&viewer.address) else { return };
        browser.wait_text("mode", "Disengaged");
        browser.wait("it draws", "window.teleopd.drawn() > 3");
        let before = browser.measured();
        browser.click("#engage");
        browser.wait_text("mode", "Engaged");
        client.set_engaged(true);
        browser.wait_moved(&before, 0.3);
        // A browser with software rendering may starve the input. Then the robot holds, and follows again by itself.
        operator.wait_mode(Mode::Engaged);
        let picture = browser.screenshot();
        // Contents of the picture, by colour: the person, and the stop button. `appearance` checks the rest.
        for (what, near, least) in [("person", [217, 103, 12], 5000), ("stop", [192, 24, 43], 10_000)] {
            let seen = browser.count_pixels(&picture, near);
            assert!(seen > least, "{what}: {seen} pixels of its colour");
        }
        // Also with the focus on a button: Space never presses the button.
        browser.evaluate("document.getElementById('engage').focus()");
        browser.press(" ", "Space");
        operator.wait_mode(Mode::Faulted);
        browser.wait_text("mode", "Faulted");
        browser.wait_text_like("why", "/emergency/i");
        browser.wait_attribute("engage", "aria-pressed", "false");
        drop(browser);
        drop(viewer);
        rig.end_without_violations();
    });
}

#[test]
fn browser_recording_stops_at_its_end_and_plays_again() {
    let shown = crate::appearance::shown();
    let mut builder = view::RecordingViewBuilder::new(&shown.model);
    let heard = view::LatestMessages { status: Some(Status::ZERO), ..view::LatestMessages::default() };
    // 2.8 becomes smaller in single precision.
    (0..29).for_each(|n| builder.add(&heard, f64::from(n) / 10.0));
    let server = view::Server::recording(builder.build(), "still.mcap", &shown, 0).expect("a port");
    let Some(mut browser) = Browser::open(server.address()) else { return };
    let button = "document.getElementById('play').textContent";
    browser.wait("it stands at its end", &format!("window.teleopd.frame()?.at > 2.75 && {button} === 'Play'"));
    browser.click("#play");
    browser.wait("it plays", &format!("window.teleopd.frame().at < 2.5 && {button} === 'Pause'"));
    let mut other = Page::at(server.address());
    other.send(&json!({ "do": "pause" }));
    other.send(&json!({ "do": "seek", "to_s": 1.0 }));
    browser.wait("another page paused it", &format!("window.teleopd.frame().at < 1.5 && {button} === 'Play'"));
}
