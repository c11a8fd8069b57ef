//! Tests a page whose webcam sees the person, against the real processes. Tests it as a program, and in a browser if
//! there is one. A stand-in takes the place of MediaPipe's library.

use crate::browser::{Browser, text};
use crate::viewer::camera::{Camera, image};
use crate::viewer::{self, Received, Viewer};
use harness::{Rig, SOON, assert_ends, holds_for, in_real_time, repository, within};
use messages::{CalibrationSource, Mode, Service, Skeleton};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;
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

fn is_on(received: &Received) -> bool {
    received.message("camera").is_some_and(|message| message["on"] == true)
}

/// The T-pose of the page's person becomes a file, and the page's next lease uses it. The robot follows the images until they
/// stop, and late images do not start it again.
#[test]
fn f124_page_measures_its_person_and_robot_follows_images_until_they_stop() {
    in_real_time(|| {
        // No network knows the figure that these images show, so its own points count.
        let mut rig = Rig::with_settings("ingest.lifter = \"\"");
        rig.start_all();
        let folder = tempfile::tempdir().expect("a folder");
        let viewer = viewer(&rig, folder.path());
        let (operator, mut camera) = (rig.operator_session(), Camera::open(&viewer));
        // An image before the start moves nothing.
        let first = camera.image();
        camera.send(first);
        camera.start();
        camera.until("the client", is_on);
        let (written, printed) = measure(&mut camera, "../anna");
        assert!(!written && printed.contains("letters, digits"), "{printed}");
        let begun = Instant::now();
        camera.until("a second later", |_| begun.elapsed() > Duration::from_secs(1));
        let (written, printed) = measure(&mut camera, "anna");
        assert!(written && printed.contains("hold still") && printed.contains("is measured"), "{printed}");
        let file = std::fs::read_to_string(rig.folder().join("operators/anna.toml")).expect("the file");
        assert!(file.contains("layout = 8"), "{file}");
        camera.until("calibrated from the file", |_| {
            operator.status().is_some_and(|status| status.calibration == CalibrationSource::Stored as u32)
        });
        // Nothing is measured while the robot moves.
        camera.until("free to engage", |_| {
            operator.status().is_some_and(|status| status.faults == 0 && status.moving == 0)
        });
        camera.page.request("engage");
        camera.keeps = true;
        camera.until("engaged", |_| operator.mode() == Some(Mode::Engaged));
        let (written, printed) = measure(&mut camera, "anna");
        assert!(!written && printed.contains("robot"), "{printed}");
        assert_eq!(operator.mode(), Some(Mode::Engaged));
        // The camera stalls, and the page answers otherwise.
        let text = camera.page.keep_until_off("camera");
        assert!(text.contains("No image came"), "{text}");
        operator.wait_stopped();
        let domain = bus::Domain::open(rig.instance.core_domain(), "test").expect("the core domain");
        let mut skeletons = domain.reader::<Skeleton>(Service::Skeleton).expect("skeletons");
        while skeletons.latest().is_some() {}
        for _ in 0..30 {
            let late = camera.image();
            camera.send(late);
            camera.page.frame();
        }
        assert!(skeletons.latest().is_none(), "an image after the end is no person");
        drop(camera);
        operator.wait_mode(Mode::Disengaged);
        drop(viewer);
        rig.end_without_violations();
    });
}

/// Measures the person of a camera. Returns true if the file was written, and all that the page was told.
fn measure(camera: &mut Camera, name: &str) -> (bool, String) {
    camera.page.send(&json!({ "do": "calibrate", "name": name }));
    let (mut printed, mut end) = (String::new(), Value::Null);
    camera.until("measured", |received| {
        let Some(message) = received.message("calibrate") else { return false };
        printed += message["text"].as_str().unwrap_or_default();
        end = message.clone();
        message["on"] == false
    });
    (end["written"] == true, printed)
}

#[test]
fn camera_files_need_the_token_and_no_other_file_is_served() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
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
    let without = Viewer::start(&rig);
    assert_eq!(status(&without, &format!("/vision/{}/vision_bundle.mjs", without.token())), "HTTP/1.1 404 Not Found");
    let page = without.get("/");
    assert!(!page.contains("wasm-unsafe-eval") && !page.contains("Permissions-Policy"), "{page}");
    let mut page = without.page();
    assert_eq!(page.message("scene")["about"]["camera"], false);
    page.socket.send(Message::binary(image(0.0, 1.0, 0.0))).expect("it listens");
    assert!(page.ends());
}

#[test]
fn missing_camera_files_give_errors_that_name_the_remedy() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let [model, empty, text, operator, part] =
        ["pose.task", "none.task", "text.task", "hand_landmarker.task", "part.task"]
            .map(|name| folder.path().join(name));
    std::fs::write(&model, MODEL).expect("a model");
    std::fs::write(&operator, b"PK hand_detector.tflite hand_landmarks_detector.tflite").expect("another model");
    std::fs::write(&part, [MODEL, &[0; 1 << 18]].concat()).expect("a model without its end");
    let made = "--camera full makes one of the networks that npm installed";
    let full = PathBuf::from("full");
    std::fs::write(&text, b"<html>").expect("no model");
    for (camera, expected) in [
        (&empty, "none.task: --camera: no such file; --camera full makes one"),
        (&text, "text.task: --camera: it is no .task file, which is a zip archive; --camera full"),
        (&operator, "hand_landmarker.task: --camera: it holds no pose_detector.tflite, so it is no pose landmarker"),
        (&part, "part.task: --camera: it holds no pose_detector.tflite"),
        (&full, "pose_solution_packed_assets.data: --camera full: No such file"),
        (&model, "vision_bundle.mjs: --vision: no such file; `npm ci --prefix tools/camera`"),
    ] {
        let mut view = viewer::command(&rig, &[]);
        let printed = assert_ends(view.arg("--vision").arg(folder.path()).arg("--camera").arg(camera), 66, &[expected]);
        assert_eq!(printed.contains(made), ![&model, &full].contains(&camera), "{printed}");
    }
    let mut view = Command::new(env!("CARGO_BIN_EXE_teleopd"));
    assert_ends(view.args(["view", "a.mcap", "--camera", "pose.task"]), 2, &["cannot be used with"]);
}

#[test]
fn page_says_what_to_do_about_a_camera_that_cannot_be_used() {
    let (rig, folder) = (Rig::idle(""), tempfile::tempdir().expect("a folder"));
    let viewer = viewer(&rig, folder.path());
    let script =
        "navigator.mediaDevices.getUserMedia = async () => { throw new DOMException('Refused', window.why); };";
    let Some(mut browser) = Browser::injected(&viewer.address, script) else { return };
    for (why, remedy) in [
        ("NotAllowedError", ". Allow the camera beside the address bar, then press the button again."),
        ("NotFoundError", ". No camera was found: plug one in, then press the button again."),
        ("AbortError", ""),
    ] {
        browser.wait_text("cam-state", "off");
        browser.evaluate(&format!("window.why = '{why}'"));
        browser.click("#cam-on");
        let expected = format!("The camera cannot be used: Refused{remedy}");
        browser.wait_text("cam-told", &expected);
    }
}

/// Starts the camera until it leads and `more` is true. A camera that stalls on a busy machine goes off, and only a click
/// starts it again. Returns false if this machine's browser is too slow for a camera.
fn leads(browser: &mut Browser, more: &str) -> bool {
    let leading = format!("{}.startsWith('leads the robot') && {more}", text("cam-state"));
    let (begun, mut is_slow) = (Instant::now(), false);
    let leads = within(3 * SOON, || {
        let state = browser.text("cam-state");
        is_slow = begun.elapsed() > 2 * SOON && state.contains("are needed");
        if state == "off" {
            browser.click("#cam-on");
        }
        is_slow || browser.evaluate(&leading) == true
    });
    assert!(leads, "never leads: {}", browser.page_text());
    if is_slow {
        println!(
            "note: ends here, because this machine's browser is too slow for a camera: {}",
            browser.text("cam-state")
        );
    }
    !is_slow
}

/// True if the canvas over the preview is not empty.
const PAINTED: &str =
    "document.getElementById('cam-canvas').getContext('2d').getImageData(0, 0, 640, 480).data.some((x) => x > 0)";

/// The stand-in's person waves, so it is never in a T-pose for 2 s.
fn calibrates_until_stopped(browser: &mut Browser) {
    browser.evaluate("document.getElementById('cal-name').value = 'anna'");
    browser.click("#cal-on");
    browser.wait_text("cal-on", "Stop calibrating");
    browser.wait("it gives a hint", &format!("{}.length > 0", text("cal-told")));
    browser.click("#cal-on");
    browser.wait_text("cal-told", "Stopped. Nothing was written.");
}

#[test]
fn browser_camera_leads_the_robot_until_it_is_stopped() {
    in_real_time(|| {
        let (mut rig, folder) = (Rig::with_settings(""), tempfile::tempdir().expect("a folder"));
        rig.start_all();
        let (operator, viewer) = (rig.operator_session(), viewer(&rig, folder.path()));
        // Without a graphics card the robot's picture would take the time of the camera's images. The page works without it.
        let fake = ["--use-fake-device-for-media-stream=fps=30", "--use-fake-ui-for-media-stream", "--disable-gpu"];
        let Some(mut browser) = Browser::with(&viewer.address, &fake) else { return };
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
        operator.wait("free to engage", |status| status.moving == 0 && status.ticks > 750);
        assert_eq!(operator.mode(), Some(Mode::Disengaged), "to lead is not to engage");
        assert_eq!(browser.text("cam-left-text"), "90 %");
        browser.wait("the skeleton is drawn", PAINTED);
        calibrates_until_stopped(&mut browser);
        browser.click("#engage");
        let mut is_slow = false;
        let follows = within(3 * SOON, || {
            if browser.evaluate("document.getElementById('engage').getAttribute('aria-pressed')") == "false" {
                is_slow = !leads(&mut browser, free);
                browser.click("#engage");
            }
            let modes = [Some(Mode::Engaging), Some(Mode::Engaged)];
            is_slow || within(Duration::from_millis(100), || modes.contains(&operator.mode()))
        });
        if is_slow {
            return;
        }
        assert!(follows, "never follows: {}", browser.page_text());
        let before = browser.measured();
        browser.wait_moved(&before, 0.1);
        browser.click("#cam-mirrored");
        browser.wait_attribute("cam-mirrored", "aria-checked", "true");
        browser.click("#cam-mirrored");
        browser.click("#cam-on");
        browser.wait_text("cam-state", "off");
        browser.wait("nothing is recorded any more", "document.getElementById('cam-video').srcObject === null");
        operator.wait_stopped();
        // A hidden page turns the camera off. Shown again, it does not turn it on.
        assert!(leads(&mut browser, "true"), "it led before");
        browser.hide();
        browser.wait_text_like("cam-told", "/hidden/");
        assert!(holds_for(Duration::from_secs(1), || browser.text("cam-state") == "off"));
        drop(browser);
        drop(viewer);
        rig.end_without_violations();
    });
}
