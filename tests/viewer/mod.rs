//! `teleopd view` of an instance, and its page as seen by a program.
#![allow(dead_code)]

pub mod camera;

use harness::{Rig, SOON};
use messages::Mode;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// `teleopd view` of an instance.
pub struct Viewer {
    child: Child,
    pub address: String,
    /// Words that it printed until the address.
    pub said: String,
    _told: BufReader<ChildStdout>,
}

impl Viewer {
    pub fn of(rig: &Rig) -> Self {
        Self::with(rig, &[])
    }

    /// Starts it with these additional arguments.
    pub fn with(rig: &Rig, arguments: &[&str]) -> Self {
        let mut child = command(rig, arguments).stdout(Stdio::piped()).spawn().expect("it starts");
        let mut told = BufReader::new(child.stdout.take().expect("its words"));
        let (mut said, mut line) = (String::new(), String::new());
        // Words about the certificate come before.
        while !line.contains(" shows ") {
            line.clear();
            assert!(told.read_line(&mut line).expect("its words") > 0, "it ended");
            said.push_str(&line);
        }
        let address = line.trim().split(' ').next_back().expect("an address").to_owned();
        assert!(address.contains("://127.0.0.1:"), "{line}");
        Self { child, address, said, _told: told }
    }

    /// Returns the process id.
    pub fn id(&self) -> u32 {
        self.child.id()
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

impl Drop for Viewer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Data that the server sends to a page.
pub enum Seen {
    Told(Value),
    Frame(Vec<f32>),
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

    pub fn ask(&mut self, what: &str) {
        self.say(&json!({ "do": what }));
    }

    pub fn say(&mut self, what: &Value) {
        self.socket.send(Message::text(what.to_string())).expect("the server listens");
    }

    /// Returns the next text or frame.
    pub fn read(&mut self) -> Seen {
        loop {
            match self.socket.read().expect("the server tells") {
                Message::Text(text) => return Seen::Told(serde_json::from_str(&text).expect("JSON")),
                Message::Binary(bytes) => {
                    let number = |four: &[u8]| f32::from_le_bytes(four.try_into().expect("four bytes"));
                    return Seen::Frame(bytes.chunks_exact(4).map(number).collect());
                }
                _ => {}
            }
        }
    }

    /// Returns the next text of this kind.
    pub fn told(&mut self, kind: &str) -> Value {
        loop {
            if let Seen::Told(told) = self.read()
                && told["tell"] == kind
            {
                return told;
            }
        }
    }

    /// Returns the next frame, as numbers.
    pub fn frame(&mut self) -> Vec<f32> {
        loop {
            if let Seen::Frame(frame) = self.read() {
                return frame;
            }
        }
    }

    /// Returns true if the server ends the connection.
    pub fn ends(mut self) -> bool {
        let give_up = Instant::now() + SOON;
        while self.socket.read().is_ok() {
            if Instant::now() > give_up {
                return false;
            }
        }
        true
    }

    /// Reads until a frame is in this mode. Keeps the enable pressed if `keep` is set.
    pub fn until(&mut self, mode: Mode, keep: bool) {
        let (give_up, mut kept) = (Instant::now() + SOON, Instant::now());
        while self.frame()[2] != mode as u32 as f32 {
            assert!(Instant::now() < give_up, "never {}", mode.name());
            if keep && kept.elapsed() > Duration::from_millis(100) {
                kept = Instant::now();
                self.ask("keep");
            }
        }
    }
}
