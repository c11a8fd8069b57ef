//! A live view for Foxglove and Lichtblick: the channels of a recording over a WebSocket of the loopback interface. Viewers
//! only read. One that reads too slowly loses the oldest messages, and nobody waits for it.

use crate::about::Files;
use crate::file::Entry;
use crate::topic::Topic;
use foxglove::{ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};
use std::sync::Arc;

/// Messages that wait for a viewer: half a second of all at the usual rate.
const WAITING_MAX: usize = 512;

/// The running server. It ends with its process.
pub struct LiveView {
    channels: Vec<Arc<RawChannel>>,
    pub server: WebSocketServerHandle,
    /// The server and the channels know it, and do not keep it.
    _context: Arc<Context>,
}

impl LiveView {
    /// Serves at this port of 127.0.0.1. 0 means any free port. Each URDF of `files` is the asset `package://robot/NAME.urdf`.
    pub fn start(port: u16, mut files: Files) -> Result<Self, FoxgloveError> {
        let context = Context::new();
        let channel = |topic: Topic| {
            let about = topic.described();
            let schema = Schema::new(about.name, about.schema_encoding, about.schema);
            ChannelBuilder::new(about.topic)
                .context(&context)
                .message_encoding(about.encoding)
                .schema(schema)
                .build_raw()
        };
        let channels = Topic::ALL.into_iter().map(channel).collect::<Result<_, _>>()?;
        files.retain(|(name, _)| name.ends_with(".urdf"));
        let server = context.websocket_server().name("teleopd").message_backlog_size(WAITING_MAX);
        let server = server.bind("127.0.0.1", port).fetch_asset_handler_blocking_fn(move |_, uri| {
            let urdf = files.iter().find(|(name, _)| uri == format!("package://robot/{name}"));
            urdf.map(|(_, bytes)| bytes.clone())
                .ok_or_else(|| format!("there is only {:?}", files.first().map(|(name, _)| name)))
        });
        Ok(Self { channels, server: server.start_blocking()?, _context: context })
    }

    /// Sends an entry to the viewers that subscribed to its channel. It never waits.
    pub fn add(&self, entry: &Entry) {
        let metadata = PartialMetadata { log_time: Some(entry.log_time) };
        self.channels[entry.topic as usize].log_with_meta(&entry.data, metadata);
    }
}
