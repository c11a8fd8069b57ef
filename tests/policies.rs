//! Policies at the skeleton socket, against the real processes.

use doors::POLICY_HELLO;
use harness::{Killed, Rig, SHORT_HOLD, in_real_time, repository};
use messages::{Mode, source_flag};
use rustix::net::{RecvFlags, SendFlags, recv, send};
use serde_json::{Value, json};
use std::os::fd::OwnedFd;
use std::process::{Command, Stdio};

/// Returns block `index` of this language in the book's chapter on policies.
pub(crate) fn book_block(language: &str, index: usize) -> String {
    let book = std::fs::read_to_string(repository().join("docs/src/policies.md")).expect("the chapter");
    let block = book.split(&format!("```{language}\n")).nth(index + 1).and_then(|rest| rest.split("```").next());
    block.expect("a block").to_owned()
}

fn connect(rig: &Rig) -> OwnedFd {
    let door = doors::connect(&rig.instance.skeleton_socket(), "ingest", 10_000).expect("the socket");
    send(&door, POLICY_HELLO, SendFlags::empty()).expect("a hello");
    door
}

/// Waits for a packet, at most as long as the daemon sends 1000 of the joints.
fn receive(door: &OwnedFd, is_it: impl Fn(&Value) -> bool) -> Value {
    let (mut bytes, mut packet) = (vec![0; 1 << 16], Value::Null);
    for _ in 0..1000 {
        let (length, _) = recv(door, &mut bytes[..], RecvFlags::empty()).expect("a packet");
        packet = serde_json::from_slice(&bytes[..length]).expect("JSON");
        if is_it(&packet) {
            return packet;
        }
    }
    panic!("the last one was {packet}");
}

/// The book's program leads until it hangs. Then bad messages are answered and counted by their reasons, and the book's own
/// message is used.
#[test]
fn f137_f138_policy_of_the_book_at_the_socket_leads_until_it_hangs() {
    let (program, message) = (book_block("python", 1), book_block("json", 0));
    in_real_time(|| {
        let mut rig = Rig::with_settings(SHORT_HOLD);
        rig.start_all();
        let (operator, mut observer, door) = (rig.operator_session(), rig.state_observer(), connect(&rig));
        let socket = rig.instance.skeleton_socket();
        let program = program.replace("/tmp/teleopd/skeleton.sock", socket.to_str().expect("UTF-8"));
        let Ok(script) = Command::new("python3").args(["-c", &program]).stdin(Stdio::null()).spawn() else {
            return println!("skipped: no Python");
        };
        let script = Killed(script);
        let before = observer.wait("there", |_| true);
        operator.engage_until(Mode::Engaged);
        observer.wait_moved(&before, 0.05);
        operator.wait("led", |status| status.sources == source_flag::POLICY[0] | source_flag::POLICY[1]);
        let joints = receive(&door, |joints| joints["mode"] == "Engaged" && joints["short_of"][3] != json!(0.0));
        assert_eq!(joints["led_by"], json!({ "left": "policy", "right": "policy" }));
        let short: Vec<f64> = serde_json::from_value(joints["short_of"].clone()).expect("numbers");
        let allowed = |j: usize| if j == 3 || j == 6 { 0.1 } else { 1e-9 };
        assert!(short.iter().enumerate().all(|(j, short)| short.abs() < allowed(j)), "{short:?}");
        harness::signal(script.id(), "STOP");
        operator.wait_mode(Mode::Holding);
        observer.wait_at_rest();
        operator.wait_mode(Mode::Disengaged);
        drop(script);
        // Reads what has come meanwhile, so that there is room for an answer.
        receive(&door, |joints| joints["mode"] == "Disengaged");
        let now = rt::now().0.to_string();
        let good = message.replace("81234567890", &now);
        for (from, to, reason, why) in [
            ("arm_left_1_joint", "elbow", "shape", "joints[0]: the robot has no \"elbow\"; it has torso_"),
            ("0.31", "NaN", "value", "line 1 column"),
            ("0.31", "null", "value", "a value is not finite"),
            (&now, "1", "old", "10 s after its observation"),
            (&now, &now, "", ""),
        ] {
            send(&door, good.replace(from, to).as_bytes(), SendFlags::empty()).expect("sent");
            if !reason.is_empty() {
                let answer = receive(&door, |packet| packet["why"].is_string());
                let text = answer["why"].as_str().unwrap_or_default();
                assert!(answer["dropped"] == reason && text.contains(why), "{answer}");
            }
        }
        let counted = json!({ "shape": 1, "value": 2, "old": 1 });
        receive(&door, |joints| joints["chunks_dropped"] == counted && joints["short_of"].is_array());
        rig.end("control");
        rig.end_without_violations();
        let chunks = rig.end("ingest")["chunks"].clone();
        assert!(chunks["accepted"].as_u64() > Some(20) && chunks["dropped"] == counted, "{chunks:#}");
    });
}
