//! Tests a page whose webcam sees the person, against the real processes. Tests it as a program, and in a browser if
//! there is one. A stand-in takes the place of MediaPipe's library.

use crate::browser::Browser;
use crate::viewer::camera::{Camera, PERIOD, image};
use crate::viewer::{Seen, Viewer};
use harness::{Rig, SOON, assert_no_violations, config, repository};
use messages::{CalibrationSource, Mode, Service, Skeleton, Smpl};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::Message;

/// Passes for a pose landmarker at the start.
const MODEL: &[u8] = b"PK pose_detector.tflite pose_landmarks_detector.tflite";

fn library() -> PathBuf {
    repository().join("tests/webcam/library")
}

/// Starts a viewer with the stand-in, and with a model that nobody reads.
fn viewer(rig: &Rig, folder: &Path) -> Viewer {
    let model = folder.join("pose.task");
    std::fs::write(&model, MODEL).expect("a model");
    let [model, library] = [model, library()].map(|path| path.to_str().expect("UTF-8").to_owned());
    Viewer::with(rig, &["--camera", &model, "--vision", &library])
}

fn is_on(told: Option<&Value>) -> bool {
    told.is_some_and(|told| told["tell"] == "camera" && told["on"] == true)
}

/// Hazard f124 too: the robot stops, and late images do not start it again.
#[test]
fn f124_robot_follows_images_until_they_stop() {
    let (mut rig, folder) = (Rig::whole(), tempfile::tempdir().expect("a folder"));
    let viewer = viewer(&rig, folder.path());
    let (hand, mut camera) = (rig.hand(), Camera::of(&viewer));
    // An image before the start moves nothing.
    let first = camera.image();
    camera.send(first);
    camera.start();
    camera.until("the client", is_on);
    camera.until("free to engage", |_| {
        hand.status().is_some_and(|status| status.faults == 0 && status.moving == 0 && status.ticks > 750)
    });
    camera.page.ask("engage");
    camera.keeps = true;
    camera.until("engaged", |_| hand.mode() == Some(Mode::Engaged));
    let domain = bus::Domain::open(rig.instance.core_domain(), "test").expect("the core domain");
    let mut skeletons = domain.reader::<Skeleton>(Service::Skeleton).expect("skeletons");
    let raised = |person: Skeleton| {
        let [wrist, shoulder] = [Smpl::LeftWrist, Smpl::LeftShoulder].map(|joint| person.positions[joint as usize][2]);
        wrist - shoulder > 0.3
    };
    let begun = Instant::now();
    camera.until("a turn", |_| begun.elapsed() > Duration::from_millis(100));
    for step in 1..=30 {
        camera.angle = step as f32 * 0.03;
        let now = Instant::now();
        camera.until("a step", |_| now.elapsed() > PERIOD);
    }
    camera.until("the left hand up", |_| skeletons.latest().is_some_and(raised));
    assert_eq!(hand.mode(), Some(Mode::Engaged));
    // The camera stalls, and the page answers otherwise.
    let give_up = Instant::now() + SOON;
    let text = loop {
        camera.page.ask("keep");
        if let Seen::Told(told) = camera.page.read()
            && told["tell"] == "camera"
            && told["on"] == false
        {
            break told["text"].to_string();
        }
        assert!(Instant::now() < give_up, "never silent");
    };
    assert!(text.contains("No image came"), "{text}");
    hand.wait("holding", |status| status.mode == Mode::Holding as u32 || status.mode == Mode::Disengaged as u32);
    while skeletons.latest().is_some() {}
    for _ in 0..30 {
        let late = camera.image();
        camera.send(late);
        camera.page.frame();
    }
    assert!(skeletons.latest().is_none(), "an image after the end is no person");
    drop(camera);
    hand.wait_mode(Mode::Disengaged);
    drop(viewer);
    assert_no_violations(&rig.end("driver"));
}

/// The T-pose of the page's person becomes a file, and the page's next lease uses it. A second person has another file.
#[test]
fn page_measures_its_person_and_uses_the_measurement() {
    let mut rig = Rig::with_settings("");
    rig.start_all();
    let folder = tempfile::tempdir().expect("a folder");
    let viewer = viewer(&rig, folder.path());
    let (hand, mut camera) = (rig.hand(), Camera::of(&viewer));
    camera.start();
    camera.until("the client", is_on);
    let (written, said) = measure(&mut camera, "../anna");
    assert!(!written && said.contains("letters, digits"), "{said}");
    for name in ["anna", "berta"] {
        let begun = Instant::now();
        camera.until("a second later", |_| begun.elapsed() > Duration::from_secs(1));
        let (written, said) = measure(&mut camera, name);
        assert!(written && said.contains("hold still") && said.contains("is measured"), "{said}");
        let file = std::fs::read_to_string(rig.folder().join(format!("operators/{name}.toml"))).expect("the file");
        assert!(file.contains("layout = 4"), "{file}");
        camera.until("calibrated from the file", |_| {
            hand.status().is_some_and(|status| status.calibration == CalibrationSource::Stored as u32)
        });
    }
    // Nothing is measured while the robot moves.
    camera.until("free to engage", |_| hand.status().is_some_and(|status| status.faults == 0 && status.moving == 0));
    camera.page.ask("engage");
    camera.keeps = true;
    camera.until("engaged", |_| hand.mode() == Some(Mode::Engaged));
    let (written, said) = measure(&mut camera, "berta");
    assert!(!written && said.contains("robot"), "{said}");
}

/// A server that dies takes its measurement with it, and nothing is written.
#[test]
fn measurement_ends_with_a_killed_server() {
    let mut rig = Rig::with_settings("");
    rig.start_all();
    let folder = tempfile::tempdir().expect("a folder");
    let viewer = viewer(&rig, folder.path());
    let mut camera = Camera::of(&viewer);
    camera.start();
    camera.until("the client", is_on);
    camera.page.say(&json!({ "do": "calibrate", "name": "carla" }));
    camera.until("measuring", |told| {
        told.is_some_and(|told| told["tell"] == "calibrate" && told["text"].to_string().contains("hold still"))
    });
    let server = viewer.id().to_string();
    assert_eq!(measurers(&server), 1);
    // SIGKILL.
    drop(viewer);
    let give_up = Instant::now() + SOON;
    while measurers(&server) > 0 {
        assert!(Instant::now() < give_up, "it still measures");
        std::thread::sleep(Duration::from_millis(50));
    }
    assert!(!rig.folder().join("operators/carla.toml").exists());
}

/// Counts the measurements for the server with this process id.
fn measurers(server: &str) -> usize {
    let processes = std::fs::read_dir("/proc").expect("/proc").flatten();
    let words = processes.filter_map(|process| std::fs::read(process.path().join("cmdline")).ok());
    words.filter(|words| words.split(|byte| *byte == 0).any(|word| word == server.as_bytes())).count()
}

/// Measures the person of a camera. Returns true if the file was written, and all that the page was told.
fn measure(camera: &mut Camera, name: &str) -> (bool, String) {
    camera.page.say(&json!({ "do": "calibrate", "name": name }));
    let (mut said, mut end) = (String::new(), Value::Null);
    camera.until("measured", |told| {
        let Some(told) = told.filter(|told| told["tell"] == "calibrate") else { return false };
        said += told["text"].as_str().unwrap_or_default();
        end = told.clone();
        told["on"] == false
    });
    (end["written"] == true, said)
}

/// Invalid images are counted. Neither this page nor another one closes.
#[test]
fn invalid_images_are_counted_and_close_no_page() {
    let (rig, folder) = (Rig::whole(), tempfile::tempdir().expect("a folder"));
    let viewer = viewer(&rig, folder.path());
    let (mut other, mut camera) = (Camera::of(&viewer), Camera::of(&viewer));
    camera.start();
    camera.until("the client", is_on);
    let good = image(1.0, 20.0, 0.0);
    let with = |at: usize, number: &[u8]| {
        let mut bad = good.clone();
        bad[at..at + number.len()].copy_from_slice(number);
        bad
    };
    let bad = [
        with(20, &f32::NAN.to_le_bytes()),
        with(20, &1e9_f32.to_le_bytes()),
        with(8, &501_f64.to_le_bytes()),
        with(8, &(-1_f64).to_le_bytes()),
        with(0, &f64::INFINITY.to_le_bytes()),
        good[..good.len() - 4].to_vec(),
        vec![],
    ];
    let count = bad.len() as u64;
    bad.into_iter().for_each(|bytes| camera.send(bytes));
    camera.until("counted", |told| told.is_some_and(|told| told["refused"].as_u64() == Some(count)));
    // More images than a webcam makes. What exceeds the rate is counted.
    for _ in 0..150 {
        let more = camera.image();
        camera.send(more);
    }
    camera.until("too many", |told| told.is_some_and(|told| told["refused"].as_u64() > Some(count)));
    // Another page is another client. It learns why it moves nothing, and a closed page gives up the lease.
    other.start();
    camera.until("a turn", |told| told.is_some());
    let told = other.report(|_| true);
    assert!(told["on"] == false && told["text"].as_str().is_some_and(|text| text.contains("another one")), "{told}");
    drop(camera);
    let give_up = Instant::now() + SOON;
    loop {
        other.start();
        if other.report(|_| true)["on"] == true {
            break;
        }
        assert!(Instant::now() < give_up, "the lease ends with the page");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn camera_files_need_the_token_and_no_other_file_is_served() {
    let (rig, folder) = (Rig::empty(), tempfile::tempdir().expect("a folder"));
    let with = viewer(&rig, folder.path());
    let (token, wrong) = (with.token(), "0".repeat(with.token().len()));
    let status = |viewer: &Viewer, path: &str| viewer.get(path).lines().next().unwrap_or("").to_owned();
    for name in ["vision_bundle.mjs", "wasm/vision_wasm_module_internal.js", "model.task"] {
        assert_eq!(status(&with, &format!("/vision/{token}/{name}")), "HTTP/1.1 200 OK", "{name}");
        assert_eq!(status(&with, &format!("/vision/{wrong}/{name}")), "HTTP/1.1 403 Forbidden", "{name}");
        assert_eq!(status(&with, &format!("/vision/{name}")).split(' ').nth(1).map(|code| &code[..1]), Some("4"));
    }
    let wasm = with.get(&format!("/vision/{token}/wasm/vision_wasm_module_internal.wasm"));
    assert!(wasm.contains("Content-Type: application/wasm\r\n"), "browsers compile only this type: {wasm}");
    for bad in
        ["../library/vision_bundle.mjs", "wasm/../vision_bundle.mjs", "%2e%2e/webcam.rs", "", "wasm", "pose.task"]
    {
        assert_eq!(status(&with, &format!("/vision/{token}/{bad}")), "HTTP/1.1 404 Not Found", "{bad}");
    }
    let page = with.get("/");
    assert!(page.contains("'wasm-unsafe-eval'") && page.contains("Permissions-Policy: camera=(self)"), "{page}");
    // Without the option there is neither a camera nor a looser policy, and an image ends the page.
    let without = Viewer::of(&rig);
    assert_eq!(status(&without, &format!("/vision/{}/vision_bundle.mjs", without.token())), "HTTP/1.1 404 Not Found");
    let page = without.get("/");
    assert!(!page.contains("wasm-unsafe-eval") && !page.contains("Permissions-Policy"), "{page}");
    let mut page = without.page();
    assert_eq!(page.told("scene")["about"]["camera"], false);
    page.socket.send(Message::binary(image(0.0, 1.0, 0.0))).expect("it listens");
    assert!(page.ends());
}

#[test]
fn missing_camera_files_give_errors_that_name_the_remedy() {
    let (rig, folder) = (Rig::empty(), tempfile::tempdir().expect("a folder"));
    let [model, empty, text, hand, part] = ["pose.task", "none.task", "text.task", "hand_landmarker.task", "part.task"]
        .map(|name| folder.path().join(name));
    std::fs::write(&model, MODEL).expect("a model");
    std::fs::write(&hand, b"PK hand_detector.tflite hand_landmarks_detector.tflite").expect("another model");
    std::fs::write(&part, [MODEL, &[0; 1 << 18]].concat()).expect("a model without its end");
    let page = "https://ai.google.dev/edge/mediapipe/solutions/vision/pose_landmarker#models";
    std::fs::write(&text, b"<html>").expect("no model");
    for (arguments, code, expected) in [
        (vec![&empty], 66, "none.task: --camera: no such file; download pose_landmarker_lite.task"),
        (vec![&text], 66, "text.task: --camera: it is no .task file, which is a zip archive; download"),
        (
            vec![&hand],
            66,
            "hand_landmarker.task: --camera: it holds no pose_detector.tflite, so it is no pose landmarker",
        ),
        (vec![&part], 66, "part.task: --camera: it holds no pose_detector.tflite"),
        (vec![&model], 66, "vision_bundle.mjs: --vision: no such file; `npm ci --prefix tools/camera`"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_teleopd"))
            .args(["view", "--port", "0", "--config"])
            .arg(config())
            .arg("--run-dir")
            .arg(rig.folder())
            .arg("--vision")
            .arg(folder.path())
            .arg("--camera")
            .args(&arguments)
            .stdin(Stdio::null())
            .output()
            .expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(expected), "{arguments:?}: {output:?}");
        assert_eq!(said.contains(page), arguments != [&model], "{said}");
    }
    let recorded = Command::new(env!("CARGO_BIN_EXE_teleopd"))
        .args(["view", "a.mcap", "--camera", "pose.task"])
        .output()
        .expect("it runs");
    assert!(String::from_utf8_lossy(&recorded.stderr).contains("cannot be used with"), "{recorded:?}");
}

/// The script for the text of an element.
fn text(id: &str) -> String {
    format!("document.getElementById('{id}').textContent")
}

#[test]
fn page_says_what_to_do_about_a_camera_that_cannot_be_used() {
    let (rig, folder) = (Rig::empty(), tempfile::tempdir().expect("a folder"));
    let viewer = viewer(&rig, folder.path());
    let script =
        "navigator.mediaDevices.getUserMedia = async () => { throw new DOMException('Refused', window.why); };";
    let Some(mut browser) = Browser::injected(&viewer.address, script) else {
        return println!("skipped: no Chromium in PATH, and TELEOPD_CHROMIUM names none");
    };
    for (why, remedy) in [
        ("NotAllowedError", ". Allow the camera beside the address bar, then press the button again."),
        ("NotFoundError", ". No camera was found: plug one in, then press the button again."),
        ("AbortError", ""),
    ] {
        browser.wait("it is off", &format!("{} === 'off'", text("cam-state")));
        browser.evaluate(&format!("window.why = '{why}'"));
        browser.click("#cam-on");
        let expected = format!("The camera cannot be used: Refused{remedy}");
        browser.wait("it says what to do", &format!("{} === {expected:?}", text("cam-told")));
    }
}

/// Starts the camera until it leads and `more` is true. A camera that stalls on a busy machine goes off, and only a click
/// starts it again. Returns false if this machine's browser is too slow for a camera.
fn leads(browser: &mut Browser, more: &str) -> bool {
    let state = "document.getElementById('cam-state').textContent";
    let give_up = Instant::now() + 3 * SOON;
    while browser.evaluate(&format!("{state}.startsWith('leads the robot') && {more}")) != true {
        let shown = browser.evaluate(state).to_string();
        if Instant::now() > give_up && shown.contains("are needed") {
            println!("skipped from here: this machine's browser is too slow for a camera: {shown}");
            return false;
        }
        if shown == "\"off\"" {
            browser.click("#cam-on");
        }
        assert!(Instant::now() < give_up, "never leads: {}", browser.evaluate("document.body.innerText"));
        std::thread::sleep(Duration::from_millis(20));
    }
    true
}

/// True if the canvas over the preview is not empty.
const PAINTED: &str =
    "document.getElementById('cam-canvas').getContext('2d').getImageData(0, 0, 640, 480).data.some((x) => x > 0)";

/// The stand-in's person waves, so it is never in a T-pose for 2 s.
fn calibrates_until_stopped(browser: &mut Browser) {
    browser.evaluate("document.getElementById('cal-name').value = 'anna'");
    browser.click("#cal-on");
    browser.wait("it measures", &format!("{} === 'Stop calibrating'", text("cal-on")));
    browser.wait("it gives a hint", &format!("{}.length > 0", text("cal-told")));
    browser.click("#cal-on");
    browser.wait("it stopped", &format!("{} === 'Stopped. Nothing was written.'", text("cal-told")));
}

#[test]
fn browser_camera_leads_the_robot_until_it_is_stopped() {
    let (mut rig, folder) = (Rig::with_settings(""), tempfile::tempdir().expect("a folder"));
    rig.start_all();
    let (hand, viewer) = (rig.hand(), viewer(&rig, folder.path()));
    // Without a graphics card the robot's picture would take the time of the camera's images. The page works without it.
    let fake = ["--use-fake-device-for-media-stream=fps=30", "--use-fake-ui-for-media-stream", "--disable-gpu"];
    let Some(mut browser) = Browser::with(&viewer.address, &fake) else {
        return println!("skipped: no Chromium in PATH, and TELEOPD_CHROMIUM names none");
    };
    // Software draws a small page in time.
    browser.resize(480, 800);
    browser.wait(
        "the panel is there",
        &format!("!document.getElementById('cam').hidden && {} === 'off'", text("cam-state")),
    );
    let free = "!document.getElementById('why').textContent.includes('skeleton')";
    if !leads(&mut browser, &format!("{free} && window.teleopd.frame() !== null")) {
        return;
    }
    hand.wait("free to engage", |status| status.moving == 0 && status.ticks > 750);
    assert_eq!(hand.mode(), Some(Mode::Disengaged), "to lead is not to engage");
    assert_eq!(browser.evaluate(&text("cam-left-text")), "90 %");
    browser.wait("the skeleton is drawn", PAINTED);
    calibrates_until_stopped(&mut browser);
    browser.click("#engage");
    let give_up = Instant::now() + SOON;
    while hand.mode() != Some(Mode::Engaged) {
        let state = browser.evaluate(&text("cam-state")).to_string();
        if Instant::now() > give_up && state.contains("are needed") {
            return println!("skipped from here: this machine's browser is too slow for a camera: {state}");
        }
        assert!(Instant::now() < give_up, "never follows: {}", browser.evaluate("document.body.innerText"));
        if browser.evaluate("document.getElementById('engage').getAttribute('aria-pressed')") == "false" {
            if !leads(&mut browser, free) {
                return;
            }
            browser.click("#engage");
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let posture = "Array.from(window.teleopd.frame().q.measured)";
    let before = browser.evaluate(posture);
    browser.wait(
        "the robot moves",
        &format!("{before}.some((q, j) => Math.abs(q - window.teleopd.frame().q.measured[j]) > 0.3)"),
    );
    if let Some(file) = std::env::var_os("TELEOPD_SCREENSHOT") {
        std::fs::write(file, crate::browser::bytes_of(&browser.screenshot())).expect("the picture");
    }
    browser.click("#cam-mirrored");
    browser.wait("it is mirrored", "document.getElementById('cam-mirrored').getAttribute('aria-checked') === 'true'");
    browser.click("#cam-mirrored");
    browser.click("#cam-on");
    browser.wait("it is off", &format!("{} === 'off'", text("cam-state")));
    browser.wait("nothing is recorded any more", "document.getElementById('cam-video').srcObject === null");
    hand.wait("holding", |status| status.mode == Mode::Holding as u32 || status.mode == Mode::Disengaged as u32);
    // A hidden page turns the camera off. Shown again, it does not turn it on.
    assert!(leads(&mut browser, "true"), "it led before");
    browser.evaluate(
        "Object.defineProperty(document, 'hidden', { value: true, configurable: true }); \
         document.dispatchEvent(new Event('visibilitychange')); delete document.hidden;",
    );
    browser.wait("it says why", &format!("{}.includes('hidden')", text("cam-told")));
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(browser.evaluate(&text("cam-state")), "off");
    drop(browser);
    drop(viewer);
    assert_no_violations(&rig.end("driver"));
}
