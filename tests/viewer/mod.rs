//! `teleopd view` of an instance, and its page as seen by a program.

pub mod camera;

use harness::{Killed, Rig, SOON};
use messages::Mode;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// `teleopd view` of an instance.
pub struct Viewer {
    _child: Killed,
    pub address: String,
    /// Words that it printed until the address.
    pub printed: String,
    _output: BufReader<ChildStdout>,
}

impl Viewer {
    pub fn start(rig: &Rig) -> Self {
        Self::with(rig, &[])
    }

    /// Starts it with these additional arguments.
    pub fn with(rig: &Rig, arguments: &[&str]) -> Self {
        let mut child = Killed(command(rig, arguments).stdout(Stdio::piped()).spawn().expect("it starts"));
        let mut output = BufReader::new(child.stdout.take().expect("its words"));
        let (mut printed, mut line) = (String::new(), String::new());
        // Words about the certificate come before.
        while !line.contains(" shows ") {
            line.clear();
            assert!(output.read_line(&mut line).expect("its words") > 0, "it ended");
            printed.push_str(&line);
        }
        let address = line.trim().split(' ').next_back().expect("an address").to_owned();
        assert!(address.contains("://127.0.0.1:"), "{line}");
        Self { _child: child, address, printed, _output: output }
    }

    pub fn host(&self) -> &str {
        self.address.split('/').nth(2).expect("a host")
    }

    pub fn token(&self) -> &str {
        self.address.split('#').next_back().expect("a token")
    }

    /// Returns the raw answer to a request.
    pub fn raw(&self, request: &str) -> String {
        let mut stream = TcpStream::connect(self.host()).expect("it listens");
        stream.set_read_timeout(Some(SOON)).unwrap();
        stream.write_all(request.as_bytes()).expect("it reads");
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub fn get(&self, path: &str) -> String {
        self.raw(&format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.host()))
    }

    pub fn page(&self) -> Page {
        Page::at(&self.address)
    }
}

/// Returns the command that starts it with these additional arguments.
pub fn command(rig: &Rig, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_teleopd"));
    command
        .args(["view", "--port", "0", "--config"])
        .arg(&rig.place.config)
        .arg("--run-dir")
        .arg(rig.folder())
        .args(arguments);
    command.stdin(Stdio::null());
    command
}

/// Period of a page's message that the enable is still pressed.
const KEEP_PERIOD: Duration = Duration::from_millis(100);

/// Data that the server sends to a page.
pub enum Received {
    Message(Value),
    Frame(Vec<f32>),
}

impl Received {
    /// Returns the message, if it is one of this kind.
    pub fn message(&self, kind: &str) -> Option<&Value> {
        match self {
            Self::Message(message) if message["tell"] == kind => Some(message),
            _ => None,
        }
    }
}

/// A page without a browser.
pub struct Page {
    pub socket: WebSocket<MaybeTlsStream<TcpStream>>,
}

impl Page {
    pub fn at(address: &str) -> Self {
        let (origin, token) = address.split_once("/#").expect("a token");
        let host = origin.strip_prefix("http://").expect("a host");
        let mut request = format!("ws://{host}/live?token={token}").into_client_request().unwrap();
        request.headers_mut().insert("origin", origin.parse().unwrap());
        let (socket, _) = tungstenite::connect(request).expect("our page is let in");
        Self { socket }
    }

    pub fn request(&mut self, what: &str) {
        self.send(&json!({ "do": what }));
    }

    pub fn send(&mut self, what: &Value) {
        self.socket.send(Message::text(what.to_string())).expect("the server listens");
    }

    /// Returns the next text or frame.
    pub fn read(&mut self) -> Received {
        loop {
            match self.socket.read().expect("the server tells") {
                Message::Text(text) => return Received::Message(serde_json::from_str(&text).expect("JSON")),
                Message::Binary(bytes) => {
                    let number = |four: &[u8]| f32::from_le_bytes(four.try_into().expect("four bytes"));
                    return Received::Frame(bytes.chunks_exact(4).map(number).collect());
                }
                _ => {}
            }
        }
    }

    /// Returns the next text of this kind.
    pub fn message(&mut self, kind: &str) -> Value {
        loop {
            if let Some(message) = self.read().message(kind) {
                return message.clone();
            }
        }
    }

    /// Returns the next frame, as numbers.
    pub fn frame(&mut self) -> Vec<f32> {
        loop {
            if let Received::Frame(frame) = self.read() {
                return frame;
            }
        }
    }

    /// Returns true if the server ends the connection.
    pub fn ends(mut self) -> bool {
        let give_up = Instant::now() + SOON;
        while self.socket.read().is_ok() && Instant::now() < give_up {}
        Instant::now() < give_up
    }

    /// Calls `send` again each time that `period` has passed, and reads until `done`, which gets each message.
    pub fn drive(
        &mut self,
        what: &str,
        period: Duration,
        mut send: impl FnMut(&mut Self),
        mut done: impl FnMut(&Received) -> bool,
    ) {
        let (give_up, mut sent) = (Instant::now() + SOON, None);
        loop {
            if sent.is_none_or(|at: Instant| at.elapsed() >= period) {
                sent = Some(Instant::now());
                send(self);
            }
            if done(&self.read()) {
                return;
            }
            assert!(Instant::now() < give_up, "never {what}");
        }
    }

    /// Keeps the enable pressed until the server says that this source of a person is off. Returns its reason.
    pub fn keep_until_off(&mut self, kind: &str) -> String {
        let mut reason = String::new();
        self.drive(
            "off",
            Duration::ZERO,
            |page| page.request("keep"),
            |received| {
                let off = received.message(kind).filter(|message| message["on"] == false);
                off.inspect(|message| reason = message["text"].to_string()).is_some()
            },
        );
        reason
    }

    /// Reads until a frame is in this mode. Keeps the enable pressed if `keep` is set.
    pub fn until(&mut self, mode: Mode, keep: bool) {
        let send = |page: &mut Self| {
            if keep {
                page.request("keep")
            }
        };
        let is_there =
            |received: &Received| matches!(received, Received::Frame(frame) if frame[2] == mode as u32 as f32);
        self.drive(mode.name(), KEEP_PERIOD, send, is_there);
    }
}
