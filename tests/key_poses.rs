//! Tests a page whose person is a mix of three key poses, against the real processes. Tests it as a program, and
//! in a browser if there is one.

use crate::browser::Browser;
use crate::viewer::{Page, Seen, Viewer};
use harness::{Rig, SOON, assert_no_violations, config};
use messages::{JOINTS_MAX, Mode, Service, Skeleton};
use poses::triangle::{POSES, Triangle};
use retarget::{ARMS, ArmModel, ArmQ, Limbs, PRIOR_WEIGHT, features, limb_error_deg, refine};
use serde_json::{Value, json};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::Message;

const CORNERS: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Requests `shares` ten times a second, keeps a pressed enable, and reads until `done`.
fn lead(page: &mut Page, what: &str, shares: [f64; 3], mut done: impl FnMut(Option<&Value>) -> bool) {
    let (give_up, mut asked) = (Instant::now() + SOON, None);
    loop {
        if asked.is_none_or(|at: Instant| at.elapsed() > Duration::from_millis(100)) {
            asked = Some(Instant::now());
            page.say(&json!({ "do": "mix", "shares": shares }));
            page.ask("keep");
        }
        let seen = page.read();
        if done(if let Seen::Told(told) = &seen { Some(told) } else { None }) {
            return;
        }
        assert!(Instant::now() < give_up, "never {what}");
    }
}

/// Returns the next report on whether this page's person is published.
fn mixed(told: Option<&Value>) -> Option<(bool, String)> {
    let told = told.filter(|told| told["tell"] == "mix")?;
    Some((told["on"] == true, told["text"].as_str().unwrap_or_default().to_owned()))
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
        let loaded = config::load(&config(), config::Overrides::default()).expect("settings");
        let network = &loaded.weights.as_ref().expect("weights").network;
        let triangle = Triangle::of(&loaded.model, network, &POSES.map(str::to_owned)).expect("poses");
        let arm = ArmModel::of(&loaded.model);
        let limbs = triangle.q(shares).each_ref().map(|q| arm.forward(q));
        let q = limbs.each_ref().map(|human| {
            let [start] = network.decode(&network.encode_human(&[features(human)]));
            refine(&arm, human, &start, &start, PRIOR_WEIGHT, 2).q
        });
        let joints = [0, 1].map(|side| std::array::from_fn(|j| loaded.model.arms[side].joints[j]));
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
    let loaded = config::load(&config(), config::Overrides::default()).expect("settings");
    let network = &loaded.weights.as_ref().expect("weights").network;
    let triangle = Triangle::of(&loaded.model, network, &POSES.map(str::to_owned)).expect("poses");
    let mut needs_s = 0.0_f64;
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let at = |i: u32| {
            let s = f64::from(i) / 240.0;
            triangle.q(&std::array::from_fn(|n| (1.0 - s) * CORNERS[from][n] + s * CORNERS[to][n]))
        };
        for (i, side, j) in (0..240).flat_map(|i| (0..ARMS).flat_map(move |side| (0..5).map(move |j| (i, side, j)))) {
            let limit = loaded.model.limits[loaded.model.arms[side].joints[j]].v_max;
            needs_s = needs_s.max((at(i + 1)[side][j] - at(i)[side][j]).abs() * 240.0 / limit);
        }
    }
    println!("the slowest edge takes {needs_s:.2} s at the joints' speed limits");
    assert!((1.0..view::EDGE_S).contains(&needs_s), "{needs_s} s");
}

#[test]
fn robot_follows_the_dragged_handle_until_the_page_is_silent() {
    let mut rig = Rig::whole();
    let (hand, viewer, mut eyes) = (rig.hand(), Viewer::of(&rig), rig.eyes());
    let mut page = viewer.page();
    assert_eq!(page.told("scene")["about"]["key_poses"], json!(POSES));
    // Requested without being a client.
    page.say(&json!({ "do": "mix", "shares": CORNERS[1] }));
    page.ask("join");
    lead(&mut page, "its person", CORNERS[0], |told| mixed(told).is_some_and(|(on, _)| on));
    lead(&mut page, "free to engage", CORNERS[0], |_| {
        hand.status().is_some_and(|status| status.faults == 0 && status.moving == 0 && status.ticks > 750)
    });
    assert_eq!(hand.mode(), Some(Mode::Disengaged), "to lead is not to engage");
    page.ask("engage");
    lead(&mut page, "engaged", CORNERS[0], |_| hand.mode() == Some(Mode::Engaged));
    for (shares, pose) in [(CORNERS[0], POSES[0]), (CORNERS[1], POSES[1]), ([0.0, 0.5, 0.5], "half way")] {
        let goal = Goal::at(&shares);
        lead(&mut page, pose, shares, |_| {
            hand.mode() == Some(Mode::Engaged) && eyes.robot().is_some_and(|state| goal.is_met(&state.q_measured))
        });
        let (joint_rad, limb_deg) = eyes.robot().map(|state| goal.away(&state.q_measured)).expect("a robot");
        println!("{pose}: {joint_rad:.4} rad, {limb_deg:.2} degrees; retargeting misses {:.2}", goal.misses_deg);
    }
    // A point outside the triangle becomes its nearest corner. This is no fault.
    let goal = Goal::at(&CORNERS[1]);
    lead(&mut page, "the corner", [-1e300, 1e12, 0.5], |_| {
        eyes.robot().is_some_and(|state| goal.is_met(&state.q_measured))
    });
    // The page stops sending the handle while the enable is held. The person disappears, and the robot holds.
    let give_up = Instant::now() + SOON;
    let silent = loop {
        page.ask("keep");
        if let Seen::Told(told) = page.read()
            && let Some((false, text)) = mixed(Some(&told))
        {
            break text;
        }
        assert!(Instant::now() < give_up, "never silent");
    };
    assert!(silent.contains("stopped answering"), "{silent}");
    hand.wait("holding", |status| status.mode == Mode::Holding as u32 || status.mode == Mode::Disengaged as u32);
    let domain = bus::Domain::open(rig.instance.core_domain(), "test").expect("the core domain");
    let mut skeletons = domain.reader::<Skeleton>(Service::Skeleton).expect("skeletons");
    for _ in 0..30 {
        page.say(&json!({ "do": "mix", "shares": CORNERS[0] }));
        page.frame();
    }
    assert!(skeletons.latest().is_none(), "what is asked late is no person");
    drop(page);
    hand.wait_mode(Mode::Disengaged);
    drop(viewer);
    assert_no_violations(&rig.end("driver"));
}

#[test]
fn page_gets_no_lease_while_another_client_holds_it() {
    let rig = Rig::whole();
    let client = rig.client(&motion::builtin(), 1);
    let (hand, viewer) = (rig.hand(), Viewer::of(&rig));
    hand.wait("free to engage", |status| status.faults == 0 && status.moving == 0 && status.ticks > 750);
    let mut page = viewer.page();
    page.ask("join");
    let told = page.told("mix");
    assert_eq!(told["on"], false);
    assert!(told["text"].as_str().is_some_and(|text| text.contains("Another client")), "{told}");
    drop(client);
    let give_up = Instant::now() + SOON;
    loop {
        page.ask("join");
        if page.told("mix")["on"] == true {
            break;
        }
        assert!(Instant::now() < give_up, "the lease ends with its holder");
        std::thread::sleep(Duration::from_millis(50));
    }
    // The second page is another client. A page that closes gives up its lease.
    lead(&mut page, "the person", CORNERS[0], |_| hand.status().is_some_and(|status| status.faults == 0));
    let mut second = viewer.page();
    second.ask("join");
    lead(&mut page, "there", CORNERS[0], |told| told.is_none());
    assert_eq!(second.told("mix")["on"], false);
    drop(page);
    loop {
        second.ask("join");
        if second.told("mix")["on"] == true {
            break;
        }
        assert!(Instant::now() < give_up, "the lease ends with the page");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn invalid_mix_or_flood_ends_the_page() {
    let rig = Rig::empty();
    let viewer = Viewer::with(&rig, &["--key-poses", "rest,clap,tools/keyposes/motions/box.bvh@2.5"]);
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
        assert_eq!(page.told("scene")["about"]["key_poses"][1], "clap");
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
    page.ask("join");
    let told = page.told("mix");
    assert!(told["on"] == false && told["text"].as_str().is_some_and(|text| text.contains("ingest")), "{told}");
}

#[test]
fn invalid_key_poses_are_refused_by_name() {
    let rig = Rig::empty();
    for (arguments, code, expected) in [
        (vec!["--key-poses", "t-pose,rest"], 64, "--key-poses: pose t-pose,rest: 2 poses; a triangle needs 3"),
        (vec!["--key-poses", "t-pose,rest,headstand"], 64, "pose headstand: must be FILE.bvh:FRAME"),
        (vec!["--key-poses", "t-pose,rest,missing.bvh:1"], 66, "missing.bvh"),
        (vec!["--key-poses", "t-pose,rest,clap", "a.mcap"], 2, "cannot be used with"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_teleopd"))
            .args(["view", "--port", "0", "--config"])
            .arg(config())
            .arg("--run-dir")
            .arg(rig.folder())
            .args(&arguments)
            .stdin(Stdio::null())
            .output()
            .expect("it runs");
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && text.contains(expected), "{arguments:?}: {output:?}");
    }
}

#[test]
fn browser_handle_is_moved_by_mouse_and_by_keys() {
    let mut rig = Rig::whole();
    let (hand, viewer) = (rig.hand(), Viewer::of(&rig));
    let Some(mut browser) = Browser::open(&viewer.address) else {
        return println!("skipped: no Chromium in PATH, and TELEOPD_CHROMIUM names none");
    };
    let spoken = "document.getElementById('mix-handle').getAttribute('aria-valuetext')";
    browser.wait("the triangle is there", &format!("{spoken} === 't-pose 100 %, hands-up 0 %, box 0 %'"));
    browser.click("#mix > summary");
    browser.click("#mix-on");
    browser.wait("it is on", "document.getElementById('mix-on').getAttribute('aria-checked') === 'true'");
    hand.wait("free to engage", |status| status.faults == 0 && status.moving == 0 && status.ticks > 750);
    browser.click("#engage");
    browser.wait("it follows", "document.getElementById('mode').textContent === 'Engaged'");
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
    let goal = Goal::at(&CORNERS[1]);
    let posture = "Array.from(window.teleopd.frame().q.measured)";
    let give_up = Instant::now() + SOON;
    loop {
        let shown: Vec<f64> = serde_json::from_value(browser.evaluate(posture)).expect("numbers");
        let mut q = [0.0; JOINTS_MAX];
        q[..shown.len()].copy_from_slice(&shown);
        if goal.is_met(&q) {
            break;
        }
        assert!(Instant::now() < give_up, "never there: {}", browser.evaluate("document.body.innerText"));
    }
    assert_eq!(browser.evaluate(spoken), "t-pose 0 %, hands-up 100 %, box 0 %");
    hand.wait_mode(Mode::Engaged);
    if let Some(file) = std::env::var_os("TELEOPD_SCREENSHOT") {
        std::fs::write(file, crate::browser::bytes_of(&browser.screenshot())).expect("the picture");
    }
    // The handle has had the focus since it was pressed.
    for _ in 0..10 {
        browser.press("ArrowLeft", "ArrowLeft");
    }
    browser.wait("keys move it", &format!("/^t-pose 2\\d %, hands-up 7\\d %/.test({spoken})"));
    browser.wait("the person follows", "document.getElementById('mix-person').cx.baseVal.value < 90");
    browser.click("#mix-on");
    browser.wait("it is off", "document.getElementById('mix-on').getAttribute('aria-checked') === 'false'");
    hand.wait("holding", |status| status.mode == Mode::Holding as u32 || status.mode == Mode::Disengaged as u32);
    drop(browser);
    drop(viewer);
    assert_no_violations(&rig.end("driver"));
}
