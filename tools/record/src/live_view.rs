//! A live view for Foxglove and Lichtblick: the channels of a recording over a WebSocket of the loopback interface, in the
//! subprotocol `foxglove.sdk.v1`. Older programs, such as Lichtblick 1.21, ask for `foxglove.websocket.v1`, and hear the same.
//!
//! A viewer needs the token of the printed address, as a page does, and only reads. One that reads too slowly loses the oldest
//! messages, and nobody waits for it.

use crate::about::Files;
use crate::file::Entry;
use crate::topic::Topic;
use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};
use view::{PageStream, Server, ViewError, or_later, waits};

/// Subprotocols of viewers, the newer one first. Foxglove's own server refuses the older one. What is used here is equal in both.
const PROTOCOLS: &[&str] = &["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Messages that wait for a viewer: half a second of all at the usual rate.
const WAITING_MAX: usize = 512;
/// Time for which a viewer may read nothing, as for a page. Then its place is another one's.
const STOPPED_MAX: Duration = Duration::from_secs(10);
/// Largest request, bytes: a subscription to all channels takes less than 1 kB.
const REQUEST_BYTES: usize = 16 << 10;
/// Polling period of a viewer.
const POLL: Duration = Duration::from_millis(4);
/// Opcodes of a message and of an asset, and the level of an error in a status.
const MESSAGE: u8 = 1;
const ASSET: u8 = 4;
const ERROR: u8 = 2;

/// One viewer's subscriptions, and the messages that wait for it.
#[derive(Default)]
struct Waiting {
    /// Number of the subscription to each topic.
    subscribed: [Option<u32>; Topic::ALL.len()],
    entries: VecDeque<Arc<Entry>>,
}

/// The running server. Dropping it sends what still waits, and ends it.
pub struct LiveView {
    viewers: Arc<Mutex<Vec<Weak<Mutex<Waiting>>>>>,
    pub server: Server,
}

#[derive(Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
enum Request {
    Subscribe {
        subscriptions: Vec<Subscription>,
    },
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    /// Asks for the URDF.
    FetchAsset {
        uri: String,
        request_id: u32,
    },
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Subscription {
    id: u32,
    channel_id: usize,
}

struct Viewer<'a> {
    socket: WebSocket<PageStream>,
    waiting: &'a Mutex<Waiting>,
    files: &'a Files,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl LiveView {
    /// Serves at this port of 127.0.0.1. 0 means any free port. Each URDF of `files` is the asset `package://robot/NAME.urdf`.
    pub fn start(port: u16, mut files: Files) -> Result<Self, ViewError> {
        files.retain(|(name, _)| name.ends_with(".urdf"));
        let viewers: Arc<Mutex<Vec<_>>> = Arc::default();
        let all = viewers.clone();
        let server = Server::programs(PROTOCOLS, port, move |stream, ended| {
            let waiting = Arc::default();
            locked(&all).push(Arc::downgrade(&waiting));
            // A viewer that breaks off needs no handling.
            let _ = Viewer::new(stream, &waiting, &files).serve(ended);
        })?;
        Ok(Self { viewers, server })
    }

    /// Sends an entry to the viewers that subscribed to its channel. It never waits for them.
    pub fn add(&self, entry: &Entry) {
        let mut shared = None;
        locked(&self.viewers).retain(|viewer| {
            let Some(waiting) = viewer.upgrade() else { return false };
            let mut waiting = locked(&waiting);
            if waiting.subscribed[entry.topic as usize].is_some() {
                if waiting.entries.len() == WAITING_MAX {
                    waiting.entries.pop_front();
                }
                waiting.entries.push_back(shared.get_or_insert_with(|| Arc::new(entry.clone())).clone());
            }
            true
        });
    }
}

impl<'a> Viewer<'a> {
    fn new(stream: PageStream, waiting: &'a Mutex<Waiting>, files: &'a Files) -> Self {
        let config = WebSocketConfig::default();
        let config = config.max_message_size(Some(REQUEST_BYTES)).max_frame_size(Some(REQUEST_BYTES));
        Self { socket: WebSocket::from_raw_socket(stream, Role::Server, Some(config)), waiting, files }
    }

    fn serve(&mut self, ended: &AtomicBool) -> Result<(), Error> {
        self.send_json(&json!({ "op": "serverInfo", "name": "teleopd", "capabilities": ["assets"] }))?;
        let channels: Vec<_> = Topic::ALL.into_iter().map(channel).collect();
        self.send_json(&json!({ "op": "advertise", "channels": channels }))?;
        let mut has_read = Instant::now();
        loop {
            // The round after the end sends the last messages.
            let is_last = ended.load(Ordering::Relaxed);
            // Nothing more is read or sent before the viewer has read what was sent.
            let mut all_sent = self.flush()?;
            if all_sent {
                has_read = Instant::now();
                all_sent = self.answer()?;
            }
            while let Some(message) = all_sent.then(|| self.next_message()).flatten() {
                all_sent = self.send(message)?;
            }
            if is_last || has_read.elapsed() > STOPPED_MAX {
                return or_later(self.socket.close(None));
            }
            std::thread::sleep(POLL);
        }
    }

    fn next_message(&self) -> Option<Message> {
        let Waiting { subscribed, entries } = &mut *locked(self.waiting);
        std::iter::from_fn(|| entries.pop_front()).find_map(|entry| {
            // It may have unsubscribed since.
            let id = subscribed[entry.topic as usize]?;
            let head = [&[MESSAGE][..], &id.to_le_bytes(), &entry.log_time.to_le_bytes()].concat();
            Some(Message::binary([&head[..], &entry.data].concat()))
        })
    }

    /// Answers at most one request, so that answers never pile up. Returns true if all was sent.
    fn answer(&mut self) -> Result<bool, Error> {
        let request = match self.socket.read() {
            Ok(Message::Text(text)) => serde_json::from_str(&text).map_err(|cause| cause.to_string()),
            Ok(Message::Binary(_)) => Err("a binary message".to_owned()),
            Ok(Message::Close(_)) => return self.socket.flush().map(|()| false),
            Ok(_) => return Ok(true),
            Err(error) if waits(&error) => return Ok(true),
            Err(error) => return Err(error),
        };
        let why = match request {
            Ok(Request::Subscribe { subscriptions }) => {
                let mut waiting = locked(self.waiting);
                let refused = subscriptions.into_iter().filter(|one| {
                    let place = waiting.subscribed.get_mut(one.channel_id).filter(|place| place.is_none());
                    place.map(|place| *place = Some(one.id)).is_none()
                });
                refused.last().map(|one| format!("channel {} does not exist, or is subscribed already", one.channel_id))
            }
            Ok(Request::Unsubscribe { subscription_ids }) => {
                let is_over = |place: &&mut Option<u32>| place.is_some_and(|id| subscription_ids.contains(&id));
                locked(self.waiting).subscribed.iter_mut().filter(is_over).for_each(|place| *place = None);
                None
            }
            Ok(Request::FetchAsset { uri, request_id }) => return self.send(self.asset(&uri, request_id)),
            Err(why) => Some(format!("viewers only read, by subscribe, unsubscribe and fetchAsset: {why}")),
        };
        why.map_or(Ok(true), |why| self.send_json(&json!({ "op": "status", "level": ERROR, "message": why })))
    }

    fn asset(&self, uri: &str, request_id: u32) -> Message {
        let urdf = self.files.iter().find(|(name, _)| uri == format!("package://robot/{name}"));
        let names: Vec<_> = self.files.iter().map(|(name, _)| format!("package://robot/{name}")).collect();
        let why = if urdf.is_some() { String::new() } else { format!("there is only {}", names.join(", ")) };
        let head = [&[ASSET][..], &request_id.to_le_bytes(), &[u8::from(urdf.is_none())]].concat();
        let length = (why.len() as u32).to_le_bytes();
        Message::binary([&head[..], &length, why.as_bytes(), urdf.map_or(&[][..], |(_, bytes)| bytes)].concat())
    }

    fn send_json(&mut self, message: &Value) -> Result<bool, Error> {
        self.send(Message::text(message.to_string()))
    }

    /// Returns true if all was sent. Otherwise it is sent later.
    fn send(&mut self, message: Message) -> Result<bool, Error> {
        or_later(self.socket.write(message))?;
        self.flush()
    }

    fn flush(&mut self) -> Result<bool, Error> {
        let flushed = self.socket.flush();
        let all_sent = flushed.is_ok();
        or_later(flushed).map(|()| all_sent)
    }
}

/// Describes a channel. A binary schema is written in base64.
fn channel(topic: Topic) -> Value {
    let about = topic.described();
    let is_binary = about.schema_encoding == "protobuf";
    let schema =
        if is_binary { BASE64_STANDARD.encode(&about.schema) } else { String::from_utf8_lossy(&about.schema).into() };
    json!({
        "id": topic as usize,
        "topic": about.topic,
        "encoding": about.encoding,
        "schemaName": about.name,
        "schemaEncoding": about.schema_encoding,
        "schema": schema,
    })
}
