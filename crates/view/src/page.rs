//! One open page: sends frames and receives requests.

use crate::calibration::{CalibrationRequest, CalibrationWorker, Measuring, operator_id};
use crate::counted::Counted;
use crate::headset::{BODY_BYTES, HEADSET_BYTES, HeadsetClient};
use crate::hub::{Hub, Seen};
use crate::mixer::{KeyPoses, MixRequest, Mixer};
use crate::operator_worker::{OperatorCommand, OperatorWorker};
use crate::recording_view::Position;
use crate::secure::PageStream;
use crate::shares::Shares;
use crate::sight::Sight;
use crate::webcam::{CameraRequest, Webcam};
use instance::Instance;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::io::ErrorKind;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Bytes, Error, Message, WebSocket};

/// Polling period for a page's requests. A stop waits no longer than this for the thread.
const POLL: Duration = Duration::from_millis(2);
/// Largest request, bytes.
const REQUEST_BYTES: usize = 1 << 10;
/// Largest backlog of a page that does not read, bytes: some seconds of frames. Beyond it the page counts as gone.
const WAITING_BYTES: usize = 1 << 20;
/// Largest number of requests of a page per second. A client that sends more is not our page. Browsers report a pointer
/// or a slider once per picture, and the fastest screens show 240 a second. Assumption: a little more than twice that.
const REQUESTS_PER_S_MAX: u32 = 500;
/// Longest silence of a page. A page sends something every two seconds. After this time it counts as gone.
const SILENT_MAX: Duration = Duration::from_secs(10);

/// Requests of a page. The empty braces are intended. Only in variants with braces, even empty ones, does serde
/// reject unknown keys.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
enum Request {
    /// Does nothing. It shows that the page is open.
    Here {},
    /// See [`OperatorCommand`]. Only for an instance.
    Engage {
        /// The arm that follows alone. Without it, both do.
        arm: Option<Arm>,
    },
    Keep {},
    /// See [`OperatorCommand::Clutch`].
    Clutch {
        /// It is held now.
        held: bool,
    },
    Release {},
    Reset {},
    Stop {},
    /// See [`MixRequest`]. Only for an instance with key poses. A NaN or infinite share ends the page. Shares
    /// outside the triangle become its nearest point.
    Join {},
    Mix {
        shares: [f64; 3],
    },
    Leave {},
    /// See [`CameraRequest`]. Only for an instance with a camera. Its images are binary messages.
    Camera {
        on: bool,
        /// The person's name. Without it, no measurement is used.
        name: Option<String>,
    },
    /// See [`CalibrationRequest`]. Only for an instance with a camera.
    Calibrate {
        /// The operator's name. Without it, the measurement stops.
        name: Option<String>,
    },
    /// The same for a headset.
    Headset {
        on: bool,
    },
    /// See [`Position`]. Only for a recording.
    Play {},
    Pause {},
    Seek {
        to_s: f64,
    },
}

/// An arm of the robot.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Arm {
    Left,
    Right,
}

/// Data source of a page.
#[derive(Clone)]
pub enum PageSource {
    /// A running instance, the key poses if the pages may use them, and what they need to measure if they may use a webcam.
    Instance(Instance, Option<Arc<KeyPoses>>, Option<Measuring>),
    /// A recording, with the position being shown.
    Recording(Arc<Position>),
}

struct Camera {
    webcam: Webcam,
    measurer: CalibrationWorker,
}

enum PageControl {
    OperatorWorker(OperatorWorker, Option<Mixer>, Option<Box<Camera>>, Box<HeadsetClient>),
    Position(Arc<Position>),
}

impl PageControl {
    fn open(behind: &PageSource) -> std::io::Result<Self> {
        Ok(match behind {
            PageSource::Instance(instance, key_poses, measuring) => {
                let mixer = key_poses.as_ref().map(|key_poses| Mixer::new(instance, key_poses)).transpose()?;
                let camera = |Measuring { operators, lease }: &Measuring| -> std::io::Result<_> {
                    let measurer = CalibrationWorker::new(instance, operators)?;
                    Ok(Box::new(Camera { webcam: Webcam::new(instance, *lease)?, measurer }))
                };
                let camera = measuring.as_ref().map(camera).transpose()?;
                let headset = Box::new(HeadsetClient::new(instance)?);
                Self::OperatorWorker(OperatorWorker::new(instance)?, mixer, camera, headset)
            }
            PageSource::Recording(position) => Self::Position(position.clone()),
        })
    }

    /// Carries out a request. Returns false if this source does not support it.
    fn pull(&mut self, request: Request) -> bool {
        match (self, request) {
            (_, Request::Here {}) => {}
            (Self::OperatorWorker(hand, ..), Request::Engage { arm }) => {
                let left_out = arm.map(|arm| match arm {
                    Arm::Left => 1,
                    Arm::Right => 0,
                });
                hand.ask(OperatorCommand::Engage { left_out });
            }
            // A headset repeats its press by its own messages. The page's clock would repeat it without them.
            (Self::OperatorWorker(.., headset), Request::Keep {}) if headset.is_held() => {}
            (Self::OperatorWorker(hand, ..), Request::Keep {}) => hand.ask(OperatorCommand::Keep),
            (Self::OperatorWorker(hand, ..), Request::Clutch { held }) => hand.ask(OperatorCommand::Clutch(held)),
            (Self::OperatorWorker(hand, ..), Request::Release {}) => hand.ask(OperatorCommand::Release),
            (Self::OperatorWorker(hand, ..), Request::Reset {}) => hand.ask(OperatorCommand::Reset),
            (Self::OperatorWorker(hand, ..), Request::Stop {}) => hand.ask(OperatorCommand::Stop),
            (Self::OperatorWorker(_, Some(mixer), ..), Request::Join {}) => mixer.ask(MixRequest::Join),
            (Self::OperatorWorker(_, Some(mixer), ..), Request::Leave {}) => mixer.ask(MixRequest::Leave),
            (Self::OperatorWorker(_, Some(mixer), ..), Request::Mix { shares }) => match Shares::nearest(shares) {
                Some(shares) => mixer.ask(MixRequest::Mix(shares)),
                None => return false,
            },
            (Self::OperatorWorker(_, _, Some(camera), _), Request::Calibrate { name }) => {
                if let Some(name) = &name {
                    camera.webcam.ask(CameraRequest::Person(operator_id(name)));
                }
                camera.measurer.ask(name.map_or(CalibrationRequest::Stop, CalibrationRequest::Start));
            }
            (Self::OperatorWorker(_, _, Some(camera), _), Request::Camera { on, name }) => {
                let person = operator_id(&name.unwrap_or_default());
                camera.webcam.ask(if on { CameraRequest::Start(person) } else { CameraRequest::Stop });
            }
            (Self::OperatorWorker(hand, .., headset), Request::Headset { on }) => headset.turn(on, hand),
            (Self::Position(position), Request::Play {}) => position.play(true),
            (Self::Position(position), Request::Pause {}) => position.play(false),
            (Self::Position(position), Request::Seek { to_s }) => position.seek(to_s),
            _ => return false,
        }
        true
    }

    /// Passes a frame of a headset or an image on. An invalid one is counted, and the page stays open. Returns false if
    /// there is no camera.
    fn see(&mut self, bytes: &[u8]) -> bool {
        let Self::OperatorWorker(hand, _, camera, headset) = self else { return false };
        if [HEADSET_BYTES, BODY_BYTES].contains(&bytes.len()) {
            headset.see(bytes, hand);
            return true;
        }
        let Some(camera) = camera else { return false };
        camera.webcam.ask(CameraRequest::Image(rt::now(), Sight::decode(bytes)));
        true
    }
}

/// Serves a page until it closes, or until `ended`.
pub fn serve(stream: PageStream, hub: &Hub, behind: &PageSource, ended: &AtomicBool) -> Result<(), Error> {
    let config = WebSocketConfig::default()
        .max_message_size(Some(REQUEST_BYTES))
        .max_frame_size(Some(REQUEST_BYTES))
        .max_write_buffer_size(WAITING_BYTES);
    let mut page = Page {
        socket: WebSocket::from_raw_socket(stream, Role::Server, Some(config)),
        lever: PageControl::open(behind)?,
        spoke: Instant::now(),
        second: Instant::now(),
        asked: 0,
        is_playing: None,
    };
    page.send(Message::text(hub.scene()))?;
    let _open = Counted::one_more(hub.pages());
    let (mut seen, mut frame) = (Seen::default(), Vec::new());
    while !ended.load(Ordering::Relaxed) {
        page.listen()?;
        page.send_reports()?;
        let (texts, new) = hub.news(&mut seen, &mut frame);
        for text in texts {
            page.send(Message::text(text))?;
        }
        if new {
            page.send(Message::Binary(Bytes::copy_from_slice(&frame)))?;
        }
        page.flush()?;
        std::thread::sleep(POLL);
    }
    let _ = page.socket.close(None);
    let _ = page.socket.flush();
    Ok(())
}

struct Page {
    socket: WebSocket<PageStream>,
    lever: PageControl,
    spoke: Instant,
    /// Start of the current second, and the requests in it.
    second: Instant,
    asked: u32,
    /// True if the recording plays by the last message to the page.
    is_playing: Option<bool>,
}

impl Page {
    /// Sends the outcome of earlier requests, of this page or of another one.
    fn send_reports(&mut self) -> Result<(), Error> {
        let playing =
            if let PageControl::Position(position) = &self.lever { Some(position.is_playing()) } else { None };
        if playing != self.is_playing {
            self.is_playing = playing;
            self.report("reel", &json!({ "playing": playing }))?;
        }
        while let PageControl::OperatorWorker(hand, .., headset) = &mut self.lever
            && let Some(outcome) = hand.answer()
        {
            if !outcome.held {
                headset.release(hand);
            }
            self.report("hand", &outcome)?;
        }
        while let PageControl::OperatorWorker(_, Some(mixer), ..) = &self.lever
            && let Some(mixed) = mixer.answer()
        {
            self.report("mix", &mixed)?;
        }
        while let PageControl::OperatorWorker(_, _, Some(camera), _) = &self.lever
            && let Some(report) = camera.webcam.answer()
        {
            self.report("camera", &report)?;
        }
        while let PageControl::OperatorWorker(_, _, Some(camera), _) = &self.lever
            && let Some(report) = camera.measurer.answer()
        {
            if report.written {
                camera.webcam.ask(CameraRequest::Renew);
            }
            self.report("calibrate", &report)?;
        }
        while let PageControl::OperatorWorker(hand, .., headset) = &mut self.lever
            && let Some(report) = headset.answer(hand)
        {
            self.report("headset", &report)?;
        }
        Ok(())
    }

    fn keeps_measure(&mut self) -> bool {
        if self.second.elapsed() > Duration::from_secs(1) {
            (self.second, self.asked) = (Instant::now(), 0);
        }
        self.asked += 1;
        self.asked <= REQUESTS_PER_S_MAX
    }

    fn listen(&mut self) -> Result<(), Error> {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => {
                    self.spoke = Instant::now();
                    // A client that sends anything else is not our page.
                    if !self.keeps_measure()
                        || !serde_json::from_str(&text).is_ok_and(|request| self.lever.pull(request))
                    {
                        return Err(Error::ConnectionClosed);
                    }
                }
                Ok(Message::Binary(image)) => {
                    self.spoke = Instant::now();
                    if !self.keeps_measure() || !self.lever.see(&image) {
                        return Err(Error::ConnectionClosed);
                    }
                }
                Ok(_) if self.keeps_measure() => {}
                Ok(_) => return Err(Error::ConnectionClosed),
                Err(error) if waits(&error) => break,
                Err(error) => return Err(error),
            }
        }
        if self.spoke.elapsed() > SILENT_MAX { Err(Error::ConnectionClosed) } else { Ok(()) }
    }

    fn report(&mut self, kind: &str, report: &impl Serialize) -> Result<(), Error> {
        self.send(Message::text(json!(PageReport { kind, report }).to_string()))
    }

    fn send(&mut self, message: Message) -> Result<(), Error> {
        or_later(self.socket.send(message))
    }

    fn flush(&mut self) -> Result<(), Error> {
        or_later(self.socket.flush())
    }
}

/// A report of this kind.
#[derive(Serialize)]
struct PageReport<'a, T> {
    #[serde(rename = "tell")]
    kind: &'a str,
    #[serde(flatten)]
    report: &'a T,
}

/// Passes an error on, but for that of a peer who does not read now: what waits is sent later.
pub fn or_later(outcome: Result<(), Error>) -> Result<(), Error> {
    outcome.or_else(|error| if waits(&error) { Ok(()) } else { Err(error) })
}

/// Returns true if there is nothing to read now, or no room to write.
pub fn waits(error: &Error) -> bool {
    matches!(error, Error::Io(cause) if cause.kind() == ErrorKind::WouldBlock)
}
