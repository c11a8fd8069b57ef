//! Tests a page whose person is a mix of three key poses, against the real processes. Tests it as a program, and
//! in a browser if there is one.

use crate::browser::Browser;
use crate::viewer::{self, Page, Received, Viewer};
use harness::{Operator, Rig, SOON, assert_ends, config, in_real_time};
use messages::{Fault, Faults, JOINTS_MAX, Mode, Service, Skeleton};
use poses::triangle::{POSES, Triangle};
use retarget::{ARMS, ArmModel, ArmQ, Limbs, PRIOR_WEIGHT, features, limb_error_deg, refine};
use serde_json::json;
use std::time::{Duration, Instant};
use tungstenite::Message;

const CORNERS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Requests `shares` ten times a second, keeps a pressed enable, and reads until `done`.
fn lead(page: &mut Page, what: &str, shares: [f64; 3], done: impl FnMut(&Received) -> bool) {
    let send = |page: &mut Page| {
        page.send(&json!({ "do": "mix", "shares": shares }));
        page.request("keep");
    };
    page.drive(what, Duration::from_millis(100), send, done);
}

/// The shipped settings, and the default poses of their robot.
fn default_poses() -> (config::Loaded, Triangle) {
    let loaded = config::load(&config(), config::Overrides::default()).expect("settings");
    let network = &loaded.weights.as_ref().expect("weights").network;
    let triangle = Triangle::new(&loaded.model, network, &POSES.map(str::to_owned)).expect("poses");
    (loaded, triangle)
}

/// Goal of the robot: the limb directions, and the joint positions that retargeting finds for them.
struct Goal {
    arm: ArmModel,
    limbs: [Limbs; ARMS],
    q: [ArmQ; ARMS],
    joints: [[usize; 5]; ARMS],
    /// Error of the retargeted limbs, degrees.
    misses_deg: f64,
}

impl Goal {
    fn at(shares: &[f64; 3]) -> Self {
        let (loaded, triangle) = default_poses();
        let network = &loaded.weights.as_ref().expect("weights").network;
        let arm = ArmModel::from_model(&loaded.model, 0);
        let limbs = triangle.q(shares).each_ref().map(|q| arm.forward(q));
        let q = limbs.each_ref().map(|human| {
            let [start] = network.decode(&network.encode_human(&[features(human)]));
            refine(&arm, human, &start, &start, PRIOR_WEIGHT, 2).q
        });
        let joints = [0, 1].map(|side| std::array::from_fn(|j| loaded.model.arms[side].range().start + j));
        let mut goal = Self { arm, limbs, q, joints, misses_deg: 0.0 };
        goal.misses_deg = goal.limbs_deg(&q);
        goal
    }

    fn limbs_deg(&self, q: &[ArmQ; ARMS]) -> f64 {
        let error = |side: usize| limb_error_deg(&self.arm.forward(&q[side]), &self.limbs[side]);
        (0..ARMS).flat_map(error).fold(0.0, f64::max)
    }

    /// Returns the distance of a posture from the goal: the worst joint, rad, and the worst limb, degrees.
    fn away(&self, posture: &[f64; JOINTS_MAX]) -> (f64, f64) {
        let q: [ArmQ; ARMS] = self.joints.map(|joints| joints.map(|joint| posture[joint]));
        let away = q.as_flattened().iter().zip(self.q.as_flattened()).map(|(a, b)| (a - b).abs());
        (away.fold(0.0, f64::max), self.limbs_deg(&q))
    }

    /// Half a degree allows for the person's sway and the rest of the way. A joint may differ by three. If an
    /// elbow is nearly straight, the joints beside it may share a twist differently than in the first guess.
    fn is_met(&self, posture: &[f64; JOINTS_MAX]) -> bool {
        let (joint_rad, limb_deg) = self.away(posture);
        joint_rad < 3_f64.to_radians() && limb_deg < self.misses_deg + 0.5
    }
}

/// From corner to corner in `view::EDGE_S` no joint exceeds its speed limit. The robot keeps up with the mix.
#[test]
fn arms_between_default_poses_keep_up_with_the_handle() {
    let (loaded, triangle) = default_poses();
    let mut needs_s = 0.0_f64;
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let at = |i: u32| {
            let s = f64::from(i) / 240.0;
            triangle.q(&std::array::from_fn(|n| (1.0 - s) * CORNERS[from][n] + s * CORNERS[to][n]))
        };
        for (i, side, j) in (0..240).flat_map(|i| (0..ARMS).flat_map(move |side| (0..5).map(move |j| (i, side, j)))) {
            let limit = loaded.model.limits[loaded.model.arms[side].range().start + j].v_max;
            needs_s = needs_s.max((at(i + 1)[side][j] - at(i)[side][j]).abs() * 240.0 / limit);
        }
    }
    println!("the slowest edge takes {needs_s:.2} s at the joints' speed limits");
    assert!((1.0..view::EDGE_S).contains(&needs_s), "{needs_s} s");
}

#[test]
fn robot_follows_the_dragged_handle_until_the_page_is_silent() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let (operator, viewer, mut observer) = (rig.operator_session(), Viewer::start(&rig), rig.state_observer());
        let mut page = viewer.page();
        assert_eq!(page.message("scene")["about"]["key_poses"], json!(POSES));
        // Requested without being a client.
        page.send(&json!({ "do": "mix", "shares": CORNERS[1] }));
        page.request("join");
        lead(&mut page, "its person", CORNERS[0], |received| {
            received.message("mix").is_some_and(|message| message["on"] == true)
        });
        lead(&mut page, "free to engage", CORNERS[0], |_| operator.status().as_ref().is_some_and(Operator::is_free));
        assert_eq!(operator.mode(), Some(Mode::Disengaged), "to lead is not to engage");
        page.request("engage");
        lead(&mut page, "engaged", CORNERS[0], |_| operator.mode() == Some(Mode::Engaged));
        // A point outside the triangle becomes its nearest corner. This is no fault.
        for (shares, goal) in [([0.0, 0.5, 0.5], [0.0, 0.5, 0.5]), ([-1e300, 1e12, 0.5], CORNERS[1])] {
            let goal = Goal::at(&goal);
            lead(&mut page, "at the goal", shares, |_| {
                operator.mode() == Some(Mode::Engaged)
                    && observer.robot().is_some_and(|state| goal.is_met(&state.q_measured))
            });
        }
        // The page stops sending the handle while the enable is held. The person disappears, and the robot holds.
        let silent = page.keep_until_off("mix");
        assert!(silent.contains("stopped answering"), "{silent}");
        operator.wait_stopped();
        let domain = bus::Domain::open(rig.instance.core_domain(), "test").expect("the core domain");
        let mut skeletons = domain.reader::<Skeleton>(Service::Skeleton).expect("skeletons");
        for _ in 0..30 {
            page.send(&json!({ "do": "mix", "shares": CORNERS[0] }));
            page.frame();
        }
        assert!(skeletons.latest().is_none(), "what is asked late is no person");
        drop(page);
        operator.wait_mode(Mode::Disengaged);
        drop(viewer);
        rig.end_without_violations();
    });
}

#[test]
fn invalid_mix_or_flood_ends_the_page() {
    let rig = Rig::idle("");
    let viewer = Viewer::with(&rig, &["--key-poses", "rest,clap,tools/replay/motions/box.bvh@2.5"]);
    for bad in [
        r#"{"do":"mix"}"#,
        r#"{"do":"mix","shares":[1,0]}"#,
        r#"{"do":"mix","shares":[1,0,0,0]}"#,
        r#"{"do":"mix","shares":[null,0,1]}"#,
        r#"{"do":"mix","shares":[NaN,0,1]}"#,
        r#"{"do":"mix","shares":[1e999,0,1]}"#,
        r#"{"do":"join","shares":[1,0,0]}"#,
    ] {
        let mut page = viewer.page();
        assert_eq!(page.message("scene")["about"]["key_poses"][1], "clap");
        page.socket.send(Message::text(bad)).expect("it listens");
        assert!(page.ends(), "{bad}");
    }
    let mut page = viewer.page();
    // A server that has closed its end and reads no more may block the sender. This also counts as not accepted.
    if let tungstenite::stream::MaybeTlsStream::Plain(stream) = page.socket.get_ref() {
        stream.set_write_timeout(Some(Duration::from_secs(5))).expect("a time-out");
    }
    let flood = json!({ "do": "mix", "shares": CORNERS[2] }).to_string();
    let give_up = Instant::now() + SOON;
    while page.socket.send(Message::text(flood.clone())).is_ok() {
        assert!(Instant::now() < give_up, "a flood is taken");
    }
    // There is no instance, and the reply says so in words.
    let mut page = viewer.page();
    page.request("join");
    let message = page.message("mix");
    assert!(message["on"] == false, "{message}");
    assert!(message["text"].as_str().is_some_and(|text| text.contains("ingest")), "{message}");
}

#[test]
fn invalid_key_poses_are_refused_by_name() {
    let rig = Rig::idle("");
    for (arguments, code, expected) in [
        (&["--key-poses", "t-pose,rest"][..], 64, "--key-poses: pose t-pose,rest: 2 poses; a triangle needs 3"),
        (&["--key-poses", "t-pose,rest,headstand"], 64, "pose headstand: must be FILE.bvh:FRAME"),
        (&["--key-poses", "t-pose,rest,missing.bvh:1"], 66, "missing.bvh"),
        (&["--key-poses", "t-pose,rest,clap", "a.mcap"], 2, "cannot be used with"),
    ] {
        assert_ends(&mut viewer::command(&rig, arguments), code, &[expected]);
    }
}

#[test]
fn browser_handle_is_moved_by_mouse_and_by_keys() {
    in_real_time(|| {
        let mut rig = Rig::whole();
        let (operator, viewer) = (rig.operator_session(), Viewer::start(&rig));
        let Some(mut browser) = Browser::open(&viewer.address) else { return };
        let spoken = "document.getElementById('mix-handle').getAttribute('aria-valuetext')";
        browser.wait("the triangle is there", &format!("{spoken} === 't-pose 100 %, hands-up 0 %, box 0 %'"));
        browser.click("#mix > summary");
        browser.click("#mix-on");
        browser.wait_attribute("mix-on", "aria-checked", "true");
        operator.wait_free();
        // The whole triangle, then the handle in it.
        browser.middle("#mix-plane");
        let from = browser.middle("#mix-handle");
        // A drag beyond the corner: the handle stays in the triangle.
        let to = browser.evaluate(
        "(() => { const b = document.getElementById('mix-plane').getBoundingClientRect(); return [b.right - 2, b.bottom - 2]; })()",
    );
        browser.mouse("mousePressed", &from);
        for part in 1..=10 {
            let between =
                |n: usize| from[n].as_f64().zip(to[n].as_f64()).map(|(a, b)| a + (b - a) * f64::from(part) / 10.0);
            browser.mouse("mouseMoved", &json!([between(0), between(1)]));
        }
        browser.mouse("mouseReleased", &to);
        browser.wait("the corner", &format!("{spoken} === 't-pose 0 %, hands-up 100 %, box 0 %'"));
        // The handle has had the focus since it was pressed.
        for _ in 0..10 {
            browser.press("ArrowLeft", "ArrowLeft");
        }
        browser.wait("keys move it", &format!("/^t-pose 2\\d %, hands-up 7\\d %/.test({spoken})"));
        browser.wait("the person follows", "document.getElementById('mix-person').cx.baseVal.value < 90");
        browser.click("#mix-on");
        browser.wait_attribute("mix-on", "aria-checked", "false");
        operator.wait("without a person", |status| Faults(status.faults).has(Fault::InputStale));
        drop(browser);
        drop(viewer);
        rig.end_without_violations();
    });
}
