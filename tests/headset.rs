//! Tests a page whose headset leads the robot, against the real processes and in a browser if there is one. A stand-in takes
//! the place of the browser's WebXR.

use crate::browser::{Browser, HIDE, text};
use crate::viewer::{Received, Viewer};
use harness::{Operator, OperatorSession, Rig, SOON, in_real_time, within};
use messages::{Fault, Mode};
use std::time::{Duration, Instant};
use view::{BODY_BYTES, HEADSET_BYTES};

const MOCK: &str = include_str!("headset/mock.js");

/// Opens the page with the stand-in, which `settings` changes. `None` if there is no browser on this machine.
fn page(viewer: &Viewer, settings: &str) -> Option<Browser> {
    let script = format!("{MOCK}\n{settings}");
    let mut browser = Browser::injected(&viewer.address, &script)?;
    browser.resize(480, 800);
    browser.wait("the panel is there", "!document.getElementById('xr').hidden && window.teleopd.frame() !== null");
    Some(browser)
}

/// Starts the headset until it leads. A machine that stalls for half a second ends it, and only a click starts it again.
fn leads(browser: &mut Browser, kind: &str) {
    let leading = format!("{}.startsWith('leads the robot with {kind}')", text("xr-state"));
    let leads = within(3 * SOON, || {
        if browser.text("xr-state") == "off" {
            browser.click("#xr-on");
        }
        browser.evaluate(&leading) == true
    });
    assert!(leads, "never leads: {}", browser.page_text());
}

/// Presses, by `press` and `open`, until the robot is in one of these modes.
fn presses(operator: &OperatorSession, browser: &mut Browser, [kind, press, open]: [&str; 3], modes: &[Mode]) {
    let is_there = || operator.mode().is_some_and(|mode| modes.contains(&mode));
    let follows = within(3 * SOON, || {
        leads(browser, kind);
        browser.evaluate(open);
        recovers(operator);
        operator.wait_control(Duration::from_millis(300));
        browser.evaluate(press);
        // It was pressed for less than half a second, or the input is not yet steady.
        within(Duration::from_secs(6), is_there)
    });
    assert!(follows, "never follows: {}", browser.page_text());
}

/// Resets a driver that has latched because this machine paused.
fn recovers(operator: &OperatorSession) {
    if operator.status().as_ref().is_some_and(Operator::is_paused) {
        operator.wait("measured at rest", |status| status.moving == 0);
        assert!(operator.raised(Fault::DriverFault) <= 3, "the driver latches too often");
        operator.reset();
        operator.wait_mode(Mode::Disengaged);
    }
}

fn stops(operator: &OperatorSession) {
    let stopped = |mode: u32| mode == Mode::Holding as u32 || mode == Mode::Disengaged as u32;
    operator.wait("stopped", |status| stopped(status.mode) || Operator::is_paused(status));
    recovers(operator);
    operator.wait_mode(Mode::Disengaged);
}

/// Inputs of the stand-in: what the page calls them, and scripts that close and open the left hand.
const CONTROLLERS: [&str; 3] = ["head and controllers", "mock.squeeze = 1", "mock.squeeze = 0"];
const HANDS: [&str; 3] = ["head and hands", "mock.pinch = 0.01", "mock.pinch = 0.08"];
const BODY: [&str; 3] = ["body tracking", "mock.pinch = 0.01", "mock.pinch = 0.08"];

#[test]
fn f131_f132_held_hand_moves_the_robot_and_every_end_of_it_releases() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let (operator, viewer) = (rig.operator_session(), Viewer::start(&rig));
        operator.wait("at rest", |status| status.moving == 0 && status.ticks > 750);
        let Some(mut browser) = page(&viewer, "mock.inputs = 'controllers';") else { return };
        leads(&mut browser, CONTROLLERS[0]);
        assert_eq!(operator.mode(), Some(Mode::Disengaged), "to lead is not to engage");
        assert_eq!(browser.evaluate("mock.asked.join(' ')"), "immersive-ar local-floor body-tracking hand-tracking");
        presses(&operator, &mut browser, CONTROLLERS, &[Mode::Engaged]);
        let before = browser.measured();
        browser.wait_moved(&before, 0.1);
        assert!(
            browser.evaluate("window.teleopd.room()").as_u64().is_some_and(|drawn| drawn > 0),
            "the robot is drawn"
        );
        browser.evaluate("mock.squeeze = 0");
        stops(&operator);
        assert_eq!(browser.evaluate("document.getElementById('engage').getAttribute('aria-pressed')"), "false");
        // Each end of what was begun with a hand, then with a tracked body.
        browser.evaluate("mock.inputs = 'hands'");
        for (input, ends, is_off) in [
            (HANDS, "mock.head = false", false),
            (HANDS, "mock.session.show('visible-blurred')", false),
            (HANDS, "mock.session.end()", true),
            (HANDS, HIDE, true),
            (BODY, "document.querySelector('#xr-on').click()", true),
        ] {
            if input == BODY {
                browser.evaluate("mock.features.push('body-tracking')");
            }
            presses(&operator, &mut browser, input, &[Mode::Engaging, Mode::Engaged]);
            browser.evaluate(&format!("(() => {{ {ends}; }})()"));
            stops(&operator);
            if is_off {
                browser.wait_text("xr-state", "off");
                assert_eq!(browser.evaluate("mock.session.isEnded"), true, "{ends}");
            }
            // The hand is still closed, and the wearer is seen again. Nothing engages by itself.
            browser
                .evaluate("(() => { mock.head = true; if (!mock.session.isEnded) mock.session.show('visible'); })()");
            operator.assert_stays(Mode::Disengaged, Duration::from_millis(800));
        }
        drop(browser);
        drop(viewer);
        rig.end_without_violations();
    });
}

/// A page without the button says why, below everything else.
#[test]
fn page_without_a_headset_says_why() {
    let rig = Rig::idle("");
    let viewer = Viewer::start(&rig);
    let without = "Object.defineProperty(navigator, 'xr', { value: undefined });";
    let insecure = format!("{without} Object.defineProperty(window, 'isSecureContext', {{ value: false }});");
    let none = "Object.defineProperty(navigator, 'xr', { value: { isSessionSupported: async () => false } });";
    for (script, expected) in [
        (without, "This browser has no WebXR"),
        (&insecure, "A headset needs https or localhost: see --https."),
        (none, "This browser has WebXR, but finds no headset."),
    ] {
        let Some(mut browser) = Browser::injected(&viewer.address, script) else { return };
        browser.wait("it says why", &format!("{}.startsWith({expected:?})", text("xr-none")));
        assert_eq!(browser.evaluate("document.getElementById('xr').hidden"), true);
    }
    // A headset that does not show the room has a session without it.
    let script = format!("{MOCK}\nmock.modes = ['immersive-vr'];");
    let Some(mut browser) = Browser::injected(&viewer.address, &script) else { return };
    browser.wait("the panel is there", "!document.getElementById('xr').hidden");
    browser.wait_text("xr-none", "");
    browser.click("#xr-on");
    browser.wait("another session", "mock.asked[0] === 'immersive-vr'");
}

/// A message of a wearer who holds both hands ahead, with the left pinch of this distance.
fn message(sent_ms: f64, pinch_m: f32) -> Vec<u8> {
    let tremble = 2e-4 * (0.7 * sent_ms as f32).sin();
    let pose = |x: f32, y: f32, z: f32| [x + tremble, y, z, 0.0, 0.0, 0.0, 1.0, 1.0];
    let mut numbers = vec![1.75];
    numbers.extend(pose(0.0, 1.638, 0.0));
    for (x, pinch) in [(-0.2, pinch_m), (0.2, 0.06)] {
        numbers.push(0.0);
        numbers.extend(pose(x, 1.15, -0.4));
        numbers.extend([pinch, -1.0, -1.0]);
    }
    let mut bytes = [sent_ms, 20.0].map(f64::to_le_bytes).concat();
    numbers.iter().for_each(|number: &f32| bytes.extend(number.to_le_bytes()));
    assert!(bytes.len() == HEADSET_BYTES && bytes.len() < BODY_BYTES);
    bytes
}

/// Without a browser: messages that stop end the press, although the page answers and repeats it.
#[test]
fn f132_press_ends_with_the_messages_of_the_headset() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let viewer = Viewer::start(&rig);
        let (operator, mut page, begun) = (rig.operator_session(), viewer.page(), Instant::now());
        page.message("scene");
        page.send(&serde_json::json!({ "do": "headset", "on": true }));
        let give_up = Instant::now() + 3 * SOON;
        let mut open_until = Instant::now() + Duration::from_secs(2);
        while operator.mode() != Some(Mode::Engaged) {
            let pinch_m = if Instant::now() < open_until { 0.08 } else { 0.01 };
            page.socket
                .send(tungstenite::Message::binary(message(begun.elapsed().as_secs_f64() * 1e3, pinch_m)))
                .expect("sent");
            let turn = Instant::now();
            while turn.elapsed() < Duration::from_millis(14) {
                if let Received::Message(message) = page.read() {
                    // The enable was refused, or a pause of this machine ended the person: open the hand again.
                    if message["tell"] == "hand" && message["held"] == false {
                        open_until = Instant::now() + Duration::from_secs(1);
                    }
                    if message["tell"] == "headset" && message["on"] == false {
                        page.send(&serde_json::json!({ "do": "headset", "on": true }));
                        open_until = Instant::now() + Duration::from_secs(2);
                    }
                }
            }
            assert!(Instant::now() < give_up, "never engaged");
        }
        // No message comes any more. The page repeats the press, which does not count.
        harness::wait_until("released", || {
            page.request("keep");
            page.frame();
            operator.mode() == Some(Mode::Disengaged)
        });
        // Messages of a closed hand engage nothing, neither before nor after another start.
        page.send(&serde_json::json!({ "do": "headset", "on": true }));
        let again = Instant::now();
        while again.elapsed() < Duration::from_secs(1) {
            page.socket
                .send(tungstenite::Message::binary(message(begun.elapsed().as_secs_f64() * 1e3, 0.01)))
                .expect("sent");
            page.frame();
        }
        assert_eq!(operator.mode(), Some(Mode::Disengaged));
        drop(page);
        drop(viewer);
        rig.end_without_violations();
    });
}
