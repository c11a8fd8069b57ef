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
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};
use view::{PageStream, Server, ViewError, or_later, waits};

/// Subprotocols of viewers, the newer one first. Foxglove's own server refuses the older one. What is used here is equal in both.
const PROTOCOLS: &[&str] = &["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Messages that wait for a viewer: half a second of all at the usual rate.
const WAITING_MAX: usize = 512;
/// Most subscriptions of a viewer: several to each channel.
const SUBSCRIPTIONS_MAX: usize = 64;
/// Largest request, bytes: a subscription to all channels takes less than 1 kB.
const REQUEST_BYTES: usize = 16 << 10;
/// Polling period of a viewer.
const POLL: Duration = Duration::from_millis(4);
/// Opcodes of a message, and of an asset.
const MESSAGE: u8 = 1;
const ASSET: u8 = 4;
/// Level of an error in a status.
const ERROR: u8 = 2;

/// Messages that wait for one viewer.
type Waiting = Mutex<VecDeque<Arc<Entry>>>;

/// The running server. Dropping it ends it.
pub struct LiveView {
    viewers: Arc<Mutex<Vec<Weak<Waiting>>>>,
    server: Server,
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
    /// Number of the topic of each subscription.
    subscribed: BTreeMap<u32, usize>,
    files: &'a Files,
}

impl LiveView {
    /// Serves at this port of 127.0.0.1. 0 means any free port. Each URDF of `files` is the asset `package://robot/NAME.urdf`.
    pub fn start(port: u16, mut files: Files) -> Result<Self, ViewError> {
        files.retain(|(name, _)| name.ends_with(".urdf"));
        let viewers: Arc<Mutex<Vec<Weak<Waiting>>>> = Arc::default();
        let all = viewers.clone();
        let server = Server::programs(PROTOCOLS, port, move |stream, ended| {
            let waiting = Arc::default();
            all.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::downgrade(&waiting));
            // A viewer that breaks off needs no handling.
            let _ = Viewer::new(stream, &files).serve(&waiting, ended);
        })?;
        Ok(Self { viewers, server })
    }

    /// Returns the address with its token.
    pub fn address(&self) -> &str {
        self.server.address()
    }

    /// Sends an entry to the viewers that subscribed to its channel. It never waits for them.
    pub fn add(&self, entry: &Entry) {
        let mut viewers = self.viewers.lock().unwrap_or_else(PoisonError::into_inner);
        viewers.retain(|viewer| viewer.strong_count() > 0);
        if viewers.is_empty() {
            return;
        }
        let entry = Arc::new(entry.clone());
        for waiting in viewers.iter().filter_map(Weak::upgrade) {
            let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
            if waiting.len() == WAITING_MAX {
                waiting.pop_front();
            }
            waiting.push_back(entry.clone());
        }
    }
}

impl<'a> Viewer<'a> {
    fn new(stream: PageStream, files: &'a Files) -> Self {
        let config = WebSocketConfig::default().max_message_size(Some(REQUEST_BYTES));
        let socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
        Self { socket, subscribed: BTreeMap::new(), files }
    }

    fn serve(&mut self, waiting: &Waiting, ended: &AtomicBool) -> Result<(), Error> {
        self.send(Message::text(
            json!({ "op": "serverInfo", "name": "teleopd", "capabilities": ["assets"] }).to_string(),
        ))?;
        let channels: Vec<_> = Topic::ALL.into_iter().map(channel).collect();
        self.send(Message::text(json!({ "op": "advertise", "channels": channels }).to_string()))?;
        while !ended.load(Ordering::Relaxed) {
            // Nothing more is read or sent before the viewer has read what was sent.
            match self.socket.flush() {
                Ok(()) => {
                    self.answer()?;
                    let entries = std::mem::take(&mut *waiting.lock().unwrap_or_else(PoisonError::into_inner));
                    entries.iter().try_for_each(|entry| self.show(entry))?;
                }
                later => or_later(later)?,
            }
            std::thread::sleep(POLL);
        }
        or_later(self.socket.close(None))
    }

    fn show(&mut self, entry: &Entry) -> Result<(), Error> {
        let numbers: Vec<u32> =
            self.subscribed.iter().filter(|(_, topic)| **topic == entry.topic as usize).map(|(id, _)| *id).collect();
        numbers.into_iter().try_for_each(|id| {
            let head = [&[MESSAGE][..], &id.to_le_bytes(), &entry.log_time.to_le_bytes()].concat();
            self.send(Message::binary([head, entry.data.clone()].concat()))
        })
    }

    /// Answers at most one request, so that answers never pile up.
    fn answer(&mut self) -> Result<(), Error> {
        let request = match self.socket.read() {
            Ok(Message::Text(text)) => serde_json::from_str(&text),
            Ok(Message::Binary(_)) => serde_json::from_str("null"),
            Ok(_) => return Ok(()),
            Err(error) if waits(&error) => return Ok(()),
            Err(error) => return Err(error),
        };
        match request {
            Ok(Request::Subscribe { subscriptions }) => {
                let room = SUBSCRIPTIONS_MAX - self.subscribed.len();
                self.subscribed.extend(subscriptions.iter().take(room).map(|one| (one.id, one.channel_id)));
                Ok(())
            }
            Ok(Request::Unsubscribe { subscription_ids }) => {
                self.subscribed.retain(|id, _| !subscription_ids.contains(id));
                Ok(())
            }
            Ok(Request::FetchAsset { uri, request_id }) => {
                let urdf = self.files.iter().find(|(name, _)| uri == format!("package://robot/{name}"));
                let name = self.files.first().map_or("no URDF", |(name, _)| name);
                let why = if urdf.is_some() { String::new() } else { format!("there is only package://robot/{name}") };
                let head = [&[ASSET][..], &request_id.to_le_bytes(), &[u8::from(urdf.is_none())]].concat();
                let length = (why.len() as u32).to_le_bytes();
                let bytes = urdf.map_or(&[][..], |(_, bytes)| bytes);
                self.send(Message::binary([&head[..], &length, why.as_bytes(), bytes].concat()))
            }
            Err(_) => {
                let why = "viewers only read: subscribe, unsubscribe and fetchAsset are answered";
                self.send(Message::text(json!({ "op": "status", "level": ERROR, "message": why }).to_string()))
            }
        }
    }

    fn send(&mut self, message: Message) -> Result<(), Error> {
        or_later(self.socket.send(message))
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
