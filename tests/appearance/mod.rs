//! Tests the page's appearance in a browser, by the pixels and by the page's own data about its picture.

mod meshes;
mod robots;
mod sharpness;

use crate::browser::{Browser, Difference, text};
use crate::viewer::Viewer;
use client::PlayOptions;
use config::{Loaded, Overrides};
use harness::{Rig, SOON, holds_for, within};
use motion::CalibrationMode;
use std::time::Duration;
use view::{LatestMessages, RecordingView, RecordingViewBuilder, RobotView, Server};
use world::{Offline, PlayedTick};

/// A desktop, a laptop, a tablet on its side and upright, a phone.
const SIZES: [[u32; 2]; 5] = [[1920, 1080], [1280, 720], [1024, 768], [820, 1180], [390, 844]];
const TICK_S: f64 = 1.0 / messages::TICK_HZ as f64;

pub fn loaded() -> Loaded {
    let overrides = Overrides { engage_without_realtime: true, ..Overrides::default() };
    config::load(&harness::config(), overrides).expect("settings")
}

/// Returns the shipped robot as a page shows it.
pub fn shown() -> RobotView {
    RobotView::load(&loaded(), None).expect("the shipped look")
}

/// Plays the built-in motion through every stage in virtual time, at `speed` times its speed, for `seconds`.
pub fn played(loaded: &Loaded, speed: f64, seconds: f64) -> RecordingView {
    recording(loaded, speed, seconds, true)
}

/// Like `played`. Without a person, no skeletons are recorded.
fn recording(loaded: &Loaded, speed: f64, seconds: f64, has_person: bool) -> RecordingView {
    let _ = rt::flush_denormals();
    let (mut builder, mut heard, mut first) =
        (RecordingViewBuilder::new(&loaded.model), LatestMessages::default(), None);
    let options = PlayOptions { speed, looped: false, calibration: CalibrationMode::First10s };
    let mut offline = Offline::new(loaded, &motion::builtin(), options).expect("a run");
    let _ended = offline.try_play(|PlayedTick { moment, .. }| {
        heard.skeleton = moment.skeleton.filter(|_| has_person).or(heard.skeleton);
        heard.target = moment.target.or(heard.target);
        heard.state = moment.robot.or(heard.state);
        heard.command = moment.control.and_then(|control| control.command).or(heard.command);
        heard.status = moment.control.map(|control| control.status).or(heard.status);
        let at_s = (moment.k - *first.get_or_insert(moment.k)) as f64 * TICK_S;
        builder.add(&heard, at_s);
        if at_s > seconds { Err(()) } else { Ok(()) }
    });
    builder.build()
}

/// A page that shows a paused recording.
struct Shown {
    browser: Browser,
    _server: Server,
}

impl Shown {
    fn open(recording: RecordingView, view: &RobotView) -> Option<Self> {
        let server = Server::recording(recording, "played.mcap", view, 0).expect("a port");
        let mut browser = Browser::open(server.address())?;
        browser.wait("it draws", "window.teleopd.drawn() > 0");
        // At the end of the recording it is already paused.
        browser.evaluate(
            "document.getElementById('play').textContent === 'Pause' && document.getElementById('play').click()",
        );
        Some(Self { browser, _server: server })
    }

    /// Moves to a time.
    fn seek(&mut self, at_s: f64) {
        self.browser.evaluate(&format!(
            "(() => {{ const at = document.getElementById('at'); at.value = {at_s}; at.dispatchEvent(new Event('input')); }})()"
        ));
        self.browser.wait("it is there", &format!("Math.abs(window.teleopd.frame().at - {at_s}) < 0.05"));
    }

    /// Moves to a time, frames the figures again, and waits until the picture is still.
    fn at(&mut self, at_s: f64) {
        self.seek(at_s);
        // The page draws a received frame in its next picture.
        self.browser.evaluate("requestAnimationFrame(() => document.querySelector('[data-view=reset]').click())");
        self.stands();
    }

    fn stands(&mut self) {
        let still = Duration::from_millis(300);
        let stands = within(SOON, || {
            let before = self.drawn();
            holds_for(still, || self.drawn() == before)
        });
        assert!(stands, "the picture never stands");
    }

    /// Returns the number of pictures that the page has drawn.
    fn drawn(&mut self) -> u64 {
        self.browser.evaluate("window.teleopd.drawn()").as_u64().expect("a number")
    }

    /// Returns the places of person and robot in the picture, -1 to 1: left, bottom, right, top. Checks that both
    /// are inside it.
    fn both_inside(&mut self) -> [[f64; 4]; 2] {
        ["person", "robot"].map(|figure| {
            let edges: [f64; 4] =
                serde_json::from_value(self.browser.evaluate(&format!("window.teleopd.boxes().{figure}"))).unwrap();
            let when = self.browser.evaluate("[innerWidth, innerHeight, window.teleopd.frame().at]");
            assert!(edges.iter().all(|x| x.abs() < 1.0), "{figure} at {edges:?} (window and time: {when})");
            edges
        })
    }

    /// Stops the camera from moving when a figure is hidden, by moving it by hand.
    fn hold_camera(&mut self) {
        self.browser.evaluate(
            "document.getElementById('stage').dispatchEvent(new WheelEvent('wheel', { deltaY: 0.01, cancelable: true }))",
        );
        self.stands();
    }

    /// Returns the part of the picture that appears only while the checkbox is on. A busy processor draws fewer pixels. Two
    /// pictures of different sharpness differ everywhere, so they are taken again.
    fn layer(&mut self, checkbox: &str) -> Difference {
        let toggle = format!("document.getElementById('{checkbox}').click()");
        let sharpness = "window.teleopd.share()";
        loop {
            self.browser.evaluate(&toggle);
            self.stands();
            let (share, without) = (self.browser.evaluate(sharpness), self.browser.screenshot());
            self.browser.evaluate(&toggle);
            self.stands();
            let with = self.browser.screenshot();
            if self.browser.evaluate(sharpness) == share {
                return self.browser.difference(&without, &with);
            }
        }
    }

    /// Returns the edges of an element in the window: left, top, right, bottom.
    fn edges(browser: &mut Browser, selector: &str) -> [f64; 4] {
        let edges = browser.evaluate(&format!(
            "(() => {{ const b = document.querySelector('{selector}').getBoundingClientRect(); \
             return [b.left, b.top, b.right, b.bottom]; }})()"
        ));
        serde_json::from_value(edges).expect("four numbers")
    }
}

fn apart(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn figures_ghost_and_lines_are_in_the_frame() {
    let (loaded, view) = (loaded(), shown());
    let Some(mut shown) = Shown::open(played(&loaded, 1.0, 18.0), &view) else { return };
    // Far ahead, and back. The numbers and their lines are there right after it.
    for at_s in [16.0, 4.0] {
        shown.at(at_s);
        for name in ["behind", "delay", "clearance"] {
            shown.browser.wait("its number", &format!("/^[\\d.]+/.test({})", text(name)));
            let inked = shown.browser.count_inked(name);
            assert!(inked > 4, "{name} at {at_s} s: {inked} pixels are drawn");
        }
    }
    // Arms hanging, both up, one up: the widest and the highest poses of the motion.
    for ([width, height], at_s) in SIZES.into_iter().zip([8.0, 12.0, 16.0, 1.0, 8.0]) {
        shown.browser.resize(width, height);
        shown.at(at_s);
        for [left, bottom, right, top] in shown.both_inside() {
            let large = (right - left).max(top - bottom);
            assert!(large > 0.5, "{width} x {height}, {at_s} s: a figure is tiny, {large}");
        }
    }
    shown.browser.resize(1280, 720);
    check_ghost(&mut shown);
}

/// The ghost appears while the robot is behind. The figures are where the page says, and their colours differ.
fn check_ghost(shown: &mut Shown) {
    // The robot was just enabled, and the person stands in a T-pose.
    shown.at(1.2);
    let behind = shown.browser.evaluate("window.teleopd.frame().limbMeasured");
    assert!(behind.as_f64() > Some(10.0), "{behind} degrees behind");
    shown.browser.wait("the ghost is there", "window.teleopd.ghost() > 0.3");
    shown.hold_camera();
    let (person, robot) = (shown.layer("show-person"), shown.layer("show-measured"));
    let [left, top, right, bottom] = Shown::edges(&mut shown.browser, "#stage");
    for seen in [&person, &robot] {
        let [l, t, r, b] = seen.edges;
        // The legend names the layers, so the lower edge may belong to the legend.
        let inside = l > left && t > top && r < right - 1.0 && (b < bottom - 1.0 || b > bottom - 40.0);
        assert!(seen.pixels > 2000 && inside, "{seen:?}");
    }
    let mut choose = |value: &str| {
        shown.browser.evaluate(&format!(
            "(() => {{ const target = document.getElementById('show-target'); target.value = '{value}'; \
             target.dispatchEvent(new Event('change')); }})()"
        ));
        shown.stands();
        shown.browser.screenshot()
    };
    let [without, with] = ["off", "auto"].map(&mut choose);
    let ghost = shown.browser.difference(&without, &with);
    println!("mean colours: person {:?}, robot {:?}, ghost {:?}", person.mean, robot.mean, ghost.mean);
    assert!(ghost.pixels > 2000, "{ghost:?}");
    for (a, b, what) in [
        (&person, &robot, "person and robot"),
        (&person, &ghost, "person and ghost"),
        (&robot, &ghost, "robot and ghost"),
    ] {
        assert!(apart(a.mean, b.mean) > 30.0, "{what} look alike: {a:?} {b:?}");
    }
    // The robot follows. The ghost disappeared by itself.
    shown.at(7.0);
    let behind = shown.browser.evaluate("window.teleopd.frame().limbMeasured");
    assert!(behind.as_f64() < Some(2.0), "{behind} degrees behind");
    shown.browser.wait("the ghost has gone", "window.teleopd.ghost() === 0");
}

#[test]
fn robot_alone_is_in_the_middle() {
    let (loaded, view) = (loaded(), shown());
    let Some(mut shown) = Shown::open(recording(&loaded, 1.0, 2.0, false), &view) else { return };
    let person = shown.browser.evaluate("document.querySelector('#legend [data-layer=person]').hidden");
    assert_eq!(person, true, "the legend names a person");
    for [width, height] in [SIZES[1], SIZES[4]] {
        shown.browser.resize(width, height);
        shown.at(1.0);
        let [left, bottom, right, top]: [f64; 4] =
            serde_json::from_value(shown.browser.evaluate("window.teleopd.boxes().robot")).unwrap();
        assert!((left + right).abs() < 0.1, "{width} x {height}: from {left} to {right}");
        assert!(bottom > -1.0 && top < 1.0 && top - bottom > 0.5, "{width} x {height}: from {bottom} to {top}");
    }
    sharpness::check(&mut shown.browser);
}

/// Without an instance the page says so, and scene and buttons fit one screen. It shows an instance that starts, and
/// clears what it showed at its end.
#[test]
fn page_fits_one_screen_and_shows_begin_and_end_of_an_instance() {
    let mut rig = Rig::empty();
    let viewer = Viewer::start(&rig);
    let Some(mut browser) = Browser::open(&viewer.address) else { return };
    browser.wait("it draws", "window.teleopd.drawn() > 1");
    browser.wait_text("curtain-title", "No instance");
    browser.wait_text_like("curtain-text", "/teleopd up/");
    browser.wait_text("mode", "no instance");
    for [width, height] in SIZES {
        browser.resize(width, height);
        browser.evaluate("document.querySelector('main').scrollTo(0, 0)");
        let (w, h) = (f64::from(width), f64::from(height));
        for selector in ["#stage", "#stop", "#engage", "#release", "#mode", "#tools"] {
            let [left, top, right, bottom] = Shown::edges(&mut browser, selector);
            let visible = left >= 0.0 && top >= 0.0 && right <= w && bottom <= h && right > left && bottom > top;
            assert!(visible, "{width} x {height}: {selector} at {left}, {top}, {right}, {bottom}");
        }
        let [left, top, right, bottom] = Shown::edges(&mut browser, "#stage");
        let share = (right - left) * (bottom - top) / (w * h);
        assert!(share > 0.45, "{width} x {height}: the scene has {share} of the window");
    }
    let (mode, clearance) = (text("mode"), text("clearance"));
    rig.start_all();
    browser.wait("it is shown", &format!("{mode} === 'Disengaged' && document.getElementById('curtain').hidden"));
    browser.wait("with its numbers", &format!("/mm$/.test({clearance})"));
    for name in teleopd::PROCESSES {
        rig.kill(name);
    }
    browser.wait("it is missed", &format!("{mode} === 'no instance' && !document.getElementById('curtain').hidden"));
    browser.wait("without numbers of before", &format!("{clearance} === '–'"));
    drop(viewer);
    browser.wait("so is the view", &format!("{mode} === 'not connected' && {clearance} === '–'"));
}
