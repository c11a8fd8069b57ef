//! The file that is written. It consists of chunks of at most a second, each flushed as a whole. So an end of
//! the writer costs at most the last chunk.

use crate::error::RecordError;
use crate::topic::Topic;
use mcap::records::MessageHeader;
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::path::Path;

/// Size at which a chunk is closed, bytes before compression.
const CHUNK_BYTES: u64 = 1 << 20;

/// Key of the number of messages that `replay` reads back. Another program may have left some out.
pub(crate) const MESSAGES: &str = "messages";

#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub topic: Topic,
    /// Sequence number of its writer, modulo 2^32.
    pub sequence: u32,
    pub log_time: u64,
    pub data: Vec<u8>,
}

pub struct Recording<W: Write + Seek> {
    writer: Writer<W>,
    channels: Vec<u16>,
    /// Number of messages that `replay` reads back.
    own: u64,
}

impl<W: Write + Seek> Recording<W> {
    /// Begins a file that describes every channel, with `about` as its metadata and `files` as attachments.
    pub fn begin(sink: W, about: &BTreeMap<String, String>, files: &[(String, Vec<u8>)]) -> Result<Self, RecordError> {
        // Nothing is changed after it was written. So a chunk is on the disk as a whole, or not at all.
        let options = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .compression_level(1)
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true)
            .profile("")
            .library(concat!("teleopd ", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(sink).map_err(RecordError::write)?;
        let metadata = mcap::records::Metadata { name: crate::ABOUT.to_owned(), metadata: about.clone() };
        writer.write_metadata(&metadata).map_err(RecordError::write)?;
        for (name, data) in files {
            let attachment = Attachment {
                log_time: 0,
                create_time: 0,
                name: name.clone(),
                media_type: media_type(name).to_owned(),
                data: Cow::Borrowed(data),
            };
            writer.attach(&attachment).map_err(RecordError::write)?;
        }
        let mut channels = Vec::new();
        for topic in Topic::ALL {
            let about = topic.described();
            let schema = writer.add_schema(&about.name, &about.schema_encoding, &about.schema);
            let schema = schema.map_err(RecordError::write)?;
            let channel = writer.add_channel(schema, about.topic, about.encoding, &BTreeMap::new());
            channels.push(channel.map_err(RecordError::write)?);
        }
        writer.flush().map_err(RecordError::write)?;
        Ok(Self { writer, channels, own: 0 })
    }

    pub fn add(&mut self, entry: &Entry) -> Result<(), RecordError> {
        let header = MessageHeader {
            channel_id: self.channels[entry.topic as usize],
            sequence: entry.sequence,
            log_time: entry.log_time,
            publish_time: entry.log_time,
        };
        self.writer.write_to_known_channel(&header, &entry.data).map_err(RecordError::write)?;
        self.own += u64::from(entry.topic <= Topic::Inputs);
        Ok(())
    }

    pub fn flush(&mut self) -> Result<(), RecordError> {
        self.writer.flush().map_err(RecordError::write)
    }

    /// Closes the file, with `last` and the number of messages as a second table of metadata.
    pub fn finish(&mut self, last: &BTreeMap<String, String>) -> Result<(), RecordError> {
        let mut metadata = last.clone();
        metadata.insert(MESSAGES.to_owned(), self.own.to_string());
        let metadata = mcap::records::Metadata { name: crate::OUTCOME.to_owned(), metadata };
        self.writer.write_metadata(&metadata).map_err(RecordError::write)?;
        self.writer.finish().map(drop).map_err(RecordError::write)
    }

    pub fn into_sink(self) -> W {
        self.writer.into_inner()
    }
}

fn media_type(name: &str) -> &'static str {
    match Path::new(name).extension().and_then(|extension| extension.to_str()) {
        Some("toml") => "application/toml",
        Some("urdf") => "application/xml",
        _ => "application/octet-stream",
    }
}
