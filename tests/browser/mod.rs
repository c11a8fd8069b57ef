//! A headless Chromium, driven by its DevTools protocol. The tests see pages as users do.
#![allow(dead_code)]

use base64::Engine;
use harness::Killed;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{ChildStderr, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// Longest time for any expected event. Software rendering on a busy machine is slow.
const SOON: Duration = Duration::from_secs(30);
/// Names of the browser, in order of preference.
const PROGRAMS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome-headless-shell"];

/// A script that lets the page believe that it is hidden, for a moment.
pub const HIDE: &str = "Object.defineProperty(document, 'hidden', { value: true, configurable: true }); \
     document.dispatchEvent(new Event('visibilitychange')); delete document.hidden;";

/// Functions over pictures for the page.
const PICTURES: &str = include_str!("pictures.js");

/// A browser with one page.
pub struct Browser {
    _child: Killed,
    socket: WebSocket<MaybeTlsStream<TcpStream>>,
    session: String,
    asked: u64,
    _output: BufReader<ChildStderr>,
    _folder: tempfile::TempDir,
    _turn: MutexGuard<'static, ()>,
}

/// Allows one browser at a time, because each draws with all cores.
static TURN: Mutex<()> = Mutex::new(());

/// Difference of two pictures.
#[derive(Debug)]
pub struct Difference {
    /// Number of pixels that differ.
    pub pixels: u64,
    /// Left, top, right and bottom edge of all of them.
    pub edges: [f64; 4],
    /// Mean colour of them in the second picture: red, green, blue.
    pub mean: [f64; 3],
}

/// Returns the browser: the path in TELEOPD_CHROMIUM, or one of the usual names in PATH. Without one it prints that the test
/// is skipped.
fn program() -> Option<PathBuf> {
    if let Some(path) = std::env::var_os("TELEOPD_CHROMIUM") {
        return Some(path.into());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<_> = std::env::split_paths(&path).collect();
    let mut places = PROGRAMS.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    let found = places.find(|path| path.is_file());
    if found.is_none() {
        println!("skipped: no Chromium in PATH, and TELEOPD_CHROMIUM names none");
    }
    found
}

impl Browser {
    /// Opens `address`. `None` if there is no browser on this machine.
    pub fn open(address: &str) -> Option<Self> {
        Self::with(address, &[])
    }

    /// Opens `address` in a browser with these additional arguments.
    pub fn with(address: &str, arguments: &[&str]) -> Option<Self> {
        let mut browser = Self::blank(arguments)?;
        browser.create(address);
        Some(browser)
    }

    /// Opens `address` in a page in which `script` runs before the page's own scripts.
    pub fn injected(address: &str, script: &str) -> Option<Self> {
        let mut browser = Self::blank(&[])?;
        browser.create("about:blank");
        browser.ask("Page.enable", &json!({}));
        browser.ask("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": script }));
        browser.ask("Page.navigate", &json!({ "url": address }));
        Some(browser)
    }

    /// Starts a browser without a page.
    fn blank(arguments: &[&str]) -> Option<Self> {
        let program = program()?;
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().expect("a folder");
        let mut child = Command::new(program)
            .args(["--headless=new", "--remote-debugging-port=0", "--no-first-run", "--disable-gpu-sandbox"])
            // Root cannot use the sandbox, and the page is our own. There is no graphics card, so software renders.
            .args(["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1280,800"])
            .args(["--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"])
            .args(arguments)
            .arg(format!("--user-data-dir={}", folder.path().display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the browser starts");
        let mut printed = BufReader::new(child.stderr.take().expect("its messages"));
        let mut line = String::new();
        let door = loop {
            line.clear();
            assert!(printed.read_line(&mut line).expect("its messages") > 0, "the browser ended before it listened");
            if let Some((_, door)) = line.split_once("DevTools listening on ") {
                break door.trim().to_owned();
            }
        };
        let (socket, _) = tungstenite::connect(door).expect("its door");
        Some(Self {
            _child: Killed(child),
            socket,
            session: String::new(),
            asked: 0,
            _output: printed,
            _folder: folder,
            _turn: turn,
        })
    }

    /// Creates the page at `address`, and attaches to it.
    fn create(&mut self, address: &str) {
        let target = self.ask("Target.createTarget", &json!({ "url": address }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = self.ask("Target.attachToTarget", &attach);
        self.session = session["sessionId"].as_str().expect("a session").to_owned();
    }

    /// Sends a request of the DevTools protocol and returns its result.
    pub fn ask(&mut self, method: &str, with: &Value) -> Value {
        self.asked += 1;
        let mut request = json!({ "id": self.asked, "method": method, "params": with });
        if !self.session.is_empty() {
            request["sessionId"] = json!(self.session);
        }
        self.socket.send(Message::text(request.to_string())).expect("the browser listens");
        loop {
            let Message::Text(text) = self.socket.read().expect("the browser answers") else { continue };
            let answer: Value = serde_json::from_str(&text).expect("JSON");
            if answer["id"] == self.asked {
                assert!(answer.get("error").is_none(), "{method}: {answer}");
                return answer["result"].clone();
            }
        }
    }

    /// Evaluates an expression in the page.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let result = self.ask("Runtime.evaluate", &json!({ "expression": expression, "returnByValue": true }));
        assert!(result.get("exceptionDetails").is_none(), "{expression}: {result}");
        result["result"]["value"].clone()
    }

    /// Evaluates an asynchronous function's body in the page, and returns its result.
    pub fn evaluate_async(&mut self, body: &str) -> Value {
        let expression = format!("(async () => {{ {body} }})()");
        let with = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        let result = self.ask("Runtime.evaluate", &with);
        assert!(result.get("exceptionDetails").is_none(), "{body}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, what: &str, expression: &str) {
        // Before the page has loaded, its elements do not exist.
        let guarded = format!("(() => {{ try {{ return {expression}; }} catch {{ return false; }} }})()");
        let is_true = harness::within(SOON, || self.evaluate(&guarded) == true);
        assert!(is_true, "{what}: {expression} never was true; the page says {}", self.page_text());
    }

    /// Returns the text of the whole page.
    pub fn page_text(&mut self) -> String {
        self.evaluate("document.body.innerText").to_string()
    }

    /// Returns the text of the element with this id.
    pub fn text(&mut self, id: &str) -> String {
        self.evaluate(&text(id)).as_str().unwrap_or_default().to_owned()
    }

    /// Waits until the element with this id has this text.
    pub fn wait_text(&mut self, id: &str, expected: &str) {
        self.wait(&format!("{expected} in {id}"), &format!("{} === {expected:?}", text(id)));
    }

    /// Waits until the text of the element with this id matches an expression of JavaScript.
    pub fn wait_text_like(&mut self, id: &str, expression: &str) {
        self.wait(&format!("{expression} in {id}"), &format!("{expression}.test({})", text(id)));
    }

    /// Waits until the element with this id has this attribute, such as `aria-checked`.
    pub fn wait_attribute(&mut self, id: &str, name: &str, expected: &str) {
        let attribute = format!("document.getElementById('{id}').getAttribute('{name}')");
        self.wait(&format!("{name} of {id}"), &format!("{attribute} === {expected:?}"));
    }

    /// Returns the measured joint positions that the page shows, rad or m.
    pub fn measured(&mut self) -> Vec<f64> {
        serde_json::from_value(self.evaluate("Array.from(window.teleopd.frame().q.measured)")).expect("numbers")
    }

    /// Waits until a joint is more than `by` from its old position, rad or m.
    pub fn wait_moved(&mut self, before: &[f64], by: f64) {
        let moved = format!("{before:?}.some((q, j) => Math.abs(q - window.teleopd.frame().q.measured[j]) > {by})");
        self.wait("the robot moves", &moved);
    }

    /// Lets the page believe that it is hidden, for a moment.
    pub fn hide(&mut self) {
        self.evaluate(HIDE);
    }

    /// Presses and releases a key.
    pub fn press(&mut self, key: &str, code: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.ask("Input.dispatchKeyEvent", &json!({ "type": kind, "key": key, "code": code }));
        }
    }

    /// Clicks the middle of the element that `selector` names, like a user.
    pub fn click(&mut self, selector: &str) {
        let place = self.middle(selector);
        for kind in ["mousePressed", "mouseReleased"] {
            self.mouse(kind, &place);
        }
    }

    /// Returns the middle of the element in the window, x and y.
    pub fn middle(&mut self, selector: &str) -> Value {
        self.evaluate(&format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{ block: 'nearest' }}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; }})()"
        ))
    }

    /// Sends an event of the left mouse button, at x and y in the window.
    pub fn mouse(&mut self, kind: &str, place: &Value) {
        let at = json!({ "type": kind, "x": place[0], "y": place[1], "button": "left", "buttons": 1, "clickCount": 1 });
        self.ask("Input.dispatchMouseEvent", &at);
    }

    /// Counts the pixels of a picture with about this colour, under any light.
    pub fn count_pixels(&mut self, picture: &str, near: [u8; 3]) -> u64 {
        let count = self.evaluate_async(&format!("{PICTURES} return countPixels('{picture}', {near:?});"));
        count.as_u64().expect("a count")
    }

    /// Counts the pixels of a sparkline that have its own colour.
    pub fn count_inked(&mut self, name: &str) -> u64 {
        let count = self.evaluate_async(&format!("{PICTURES} return countInked('{name}');"));
        count.as_u64().expect("a count")
    }

    /// Sets the size of the window, in pixels.
    pub fn resize(&mut self, width: u32, height: u32) {
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.ask("Emulation.setDeviceMetricsOverride", &size);
    }

    /// Returns the difference of two pictures.
    pub fn difference(&mut self, before: &str, after: &str) -> Difference {
        let numbers = self.evaluate_async(&format!("{PICTURES} return difference('{before}', '{after}');"));
        let numbers: Vec<f64> = serde_json::from_value(numbers).expect("numbers");
        let [pixels, left, top, right, bottom, r, g, b] = numbers[..] else { panic!("{numbers:?}") };
        Difference { pixels: pixels as u64, edges: [left, top, right, bottom], mean: [r, g, b] }
    }

    /// Returns the page as a PNG, in base64.
    pub fn screenshot(&mut self) -> String {
        let shot = self.ask("Page.captureScreenshot", &json!({ "format": "png" }));
        shot["data"].as_str().expect("a picture").to_owned()
    }
}

/// The expression for the text of the element with this id.
pub fn text(id: &str) -> String {
    format!("document.getElementById('{id}').textContent")
}

/// Returns the bytes of a picture in base64.
pub fn decode_base64(picture: &str) -> Vec<u8> {
    base64::engine::general_purpose::STANDARD.decode(picture).expect("base64")
}
