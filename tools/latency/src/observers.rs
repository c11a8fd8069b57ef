//! Runs a page and a recorder beside a running instance, as `demo --view --record` does. The page is read as a
//! browser reads it, but never drawn.

use crate::error::invalid;
use instance::Instance;
use rt::Failure;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use teleopd::{InstanceArgs, Recorder};
use tungstenite::client::IntoClientRequest;
use tungstenite::stream::MaybeTlsStream;
use tungstenite::{Message, WebSocket};

/// Time between two heartbeats of the page: half of a browser's.
const HERE: Duration = Duration::from_secs(1);
/// Longest wait for a frame. There are 60 frames a second.
const FRAME_WITHIN: Duration = Duration::from_millis(500);
/// Smallest number of frames per second that a page which keeps up has received.
const FRAMES_PER_S_MIN: f64 = 30.0;

pub struct Observers {
    view: Child,
    _stdout: BufReader<ChildStdout>,
    page: JoinHandle<u64>,
    end: Arc<AtomicBool>,
    recorder: Recorder,
    begun: Instant,
}

impl Observers {
    /// Starts both, and waits until both receive data of the instance.
    pub fn start(instance: &Instance, place: &InstanceArgs) -> Result<Self, Failure> {
        let failed = |cause: String| invalid(format!("onlookers: {cause}"));
        let file = instance.run_dir().join("watched.mcap");
        let recorder = Recorder::start(&file, instance, place).map_err(|failure| failed(failure.text))?;
        let own = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        let mut view = Command::new(own)
            .args(["view", "--port", "0", "--config"])
            .arg(&place.config)
            .arg("--run-dir")
            .arg(instance.run_dir())
            // If this process is killed, the view must end too, because it could operate a robot.
            .arg("--child-of")
            .arg(std::process::id().to_string())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| failed(error.to_string()))?;
        let mut stdout = BufReader::new(view.stdout.take().ok_or_else(|| failed("no words".into()))?);
        let opened = open(&mut stdout);
        let socket = opened.map_err(|cause| {
            let _ = view.kill();
            let _ = view.wait();
            failed(cause)
        })?;
        let end = Arc::new(AtomicBool::new(false));
        let twin = Arc::clone(&end);
        let page = std::thread::spawn(move || look(socket, &twin));
        Ok(Self { view, _stdout: stdout, page, end, recorder, begun: Instant::now() })
    }

    pub fn stop(mut self) -> Vec<String> {
        let seconds = self.begun.elapsed().as_secs_f64();
        self.end.store(true, Ordering::Relaxed);
        let frames = self.page.join().unwrap_or_default() as f64;
        let ended = self.view.try_wait().ok().flatten();
        rt::terminate(self.view.id());
        let _ = self.view.wait();
        let mut trouble: Vec<_> = self.recorder.stop().into_iter().collect();
        trouble.extend(ended.map(|status| format!("the page's server ended by itself ({status})")));
        if frames < FRAMES_PER_S_MIN * seconds {
            trouble.push(format!("the page was sent {frames} frames in {seconds:.1} s"));
        }
        trouble
    }
}

type Page = WebSocket<MaybeTlsStream<TcpStream>>;

/// Opens the page at the address that the view printed.
fn open(stdout: &mut BufReader<ChildStdout>) -> Result<Page, String> {
    let mut line = String::new();
    stdout.read_line(&mut line).map_err(|error| error.to_string())?;
    let address = line.trim().split(' ').next_back().unwrap_or_default();
    let (origin, token) = address.split_once("/#").ok_or_else(|| format!("no address: {line}"))?;
    let host = origin.trim_start_matches("http://");
    let mut request =
        format!("ws://{host}/live?token={token}").into_client_request().map_err(|error| error.to_string())?;
    request.headers_mut().insert("origin", origin.parse().map_err(|_| format!("no origin: {origin}"))?);
    let (socket, _) = tungstenite::connect(request).map_err(|error| error.to_string())?;
    if let MaybeTlsStream::Plain(stream) = socket.get_ref() {
        stream.set_read_timeout(Some(FRAME_WITHIN)).map_err(|error| error.to_string())?;
    }
    Ok(socket)
}

/// Reads frames until `end`. Returns their number.
fn look(mut socket: Page, end: &AtomicBool) -> u64 {
    let (mut frames, mut reported_at) = (0, Instant::now());
    while !end.load(Ordering::Relaxed) {
        match socket.read() {
            Ok(Message::Binary(_)) => frames += 1,
            Ok(_) => {}
            Err(_) => break,
        }
        if reported_at.elapsed() > HERE {
            reported_at = Instant::now();
            let _ = socket.send(Message::text(r#"{"do":"here"}"#));
        }
    }
    frames
}
