//! Finds the parts of a recording by their heads: its chunks, messages outside of chunks, and its tables. So damage in one
//! part hides no other. It limits the size to which they unpack, before any is unpacked.

use crate::error::McapError;
use crate::mcap::Source;
use mcap::records::{Record, op};
use mcap::{MAGIC, parse_record};
use std::collections::BTreeMap;
use std::io::{BufReader, Read, Seek, SeekFrom};

/// Largest chunk, bytes before compression. Our own have 1 MiB. The C++, Rust and ROS 2 writers of MCAP use 768
/// KiB, the Go and Python tools 4 MiB by default. Assumption, with a margin for writers with larger settings.
pub(crate) const CHUNK_BYTES_MAX: u64 = 64 << 20;
/// Bytes that chunks may unpack to for each byte of the file before them, in addition to one largest chunk. A run
/// in virtual time with every message unpacks to 5 times its file, the chunk in which the robot rests to 12
/// times. Assumption: about ten times that. Zeros under zstd unpack to 30,000 times their length.
const RATIO_MAX: u64 = 128;
/// Most schemas and channels of a file, and bytes of all their names.
const CHANNELS_MAX: usize = 4096;
const NAMES_BYTES_MAX: usize = 1 << 22;

/// Bytes of opcode and length before every record.
const HEAD: u64 = 9;
/// Bytes of a chunk between `HEAD` and its records, without the name of its compression.
const CHUNK_HEAD: u64 = 40;
/// Longest name of a compression that is looked at, bytes. All known ones are shorter.
const PACKING_MAX: u64 = 16;
/// Bytes of a message before its data: channel, sequence, time of recording, time of publishing.
const MESSAGE_HEAD: u64 = 22;
/// Size at which a run of messages outside of chunks is closed, and of the blocks in which the next chunk is looked for, bytes.
const RUN_BYTES: u64 = 1 << 20;

/// A chunk, or a run of messages outside of chunks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    /// Time of its first message, ns.
    pub(crate) begin_ns: u64,
    /// Place in the file, and length there and unpacked, bytes.
    pub(crate) at: u64,
    pub(crate) bytes: u64,
    pub(crate) unpacked: u64,
    is_chunk: bool,
}

/// Names of schemas and channels.
#[derive(Default)]
pub(crate) struct Names {
    schemas: BTreeMap<u16, String>,
    /// The schema's number is beside the channel, because some writers put the schema behind it.
    pub(crate) channels: BTreeMap<u16, (u16, Source)>,
    bytes: usize,
}

impl Names {
    /// Notes a schema or a channel. Its first definition counts.
    pub(crate) fn add(&mut self, record: Record<'_>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, .. } if !self.schemas.contains_key(&header.id) => {
                self.bytes += header.name.len();
                for (_, source) in self.channels.values_mut().filter(|(schema, _)| *schema == header.id) {
                    source.schema.clone_from(&header.name);
                }
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) if !self.channels.contains_key(&channel.id) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                self.bytes += channel.topic.len() + channel.message_encoding.len() + schema.len();
                let source = Source { topic: channel.topic, encoding: channel.message_encoding, schema };
                self.channels.insert(channel.id, (channel.schema_id, source));
            }
            _ => {}
        }
        let most = self.schemas.len().max(self.channels.len());
        if most > CHANNELS_MAX || self.bytes > NAMES_BYTES_MAX {
            return Err(McapError::Channels { bound: CHANNELS_MAX, bytes: NAMES_BYTES_MAX });
        }
        Ok(())
    }
}

/// A file and its parts.
pub(crate) struct Parts<R> {
    input: BufReader<R>,
    /// Place in the file at which `input` stands, and the bytes that were read last.
    stands: u64,
    bytes: Vec<u8>,
    pub(crate) size: u64,
    pub(crate) list: Vec<Part>,
    pub(crate) names: Names,
    pub(crate) tables: Vec<(String, BTreeMap<String, String>)>,
    /// Number of messages, as the writer counted them.
    pub(crate) counted: Option<u64>,
    /// Sum over all chunks so far, bytes.
    unpacked: u64,
    /// Place behind the end mark.
    pub(crate) end: Option<u64>,
    /// Phrases on what is damaged or missing.
    pub(crate) lost: Vec<String>,
}

fn number(bytes: &[u8], at: usize) -> u64 {
    bytes.get(at..at + 8).map_or(0, |bytes| u64::from_le_bytes(std::array::from_fn(|i| bytes[i])))
}

fn read_error(error: std::io::Error) -> McapError {
    McapError::Read { cause: error.to_string() }
}

/// Returns the lengths of a chunk's head and of its packed records. `bytes` begin behind `HEAD`. `None` if they end before.
fn packed(bytes: &[u8]) -> Option<(u64, u64)> {
    let name = u64::from(u32::from_le_bytes(std::array::from_fn(|i| *bytes.get(28 + i).unwrap_or(&u8::MAX))));
    let length_at = 32 + usize::try_from(name).ok().filter(|_| name <= PACKING_MAX)?;
    (bytes.len() >= length_at + 8).then(|| (CHUNK_HEAD + name, number(bytes, length_at)))
}

impl<R: Read + Seek> Parts<R> {
    pub(crate) fn find(mut input: R) -> Result<Self, McapError> {
        let size = input.seek(SeekFrom::End(0)).map_err(read_error)?;
        input.rewind().map_err(read_error)?;
        let mut parts = Self {
            input: BufReader::new(input),
            stands: 0,
            bytes: Vec::new(),
            size,
            list: Vec::new(),
            names: Names::default(),
            tables: Vec::new(),
            counted: None,
            unpacked: 0,
            end: None,
            lost: Vec::new(),
        };
        let mut at = MAGIC.len() as u64;
        if !parts.fill(0, at)? || parts.bytes != MAGIC || size == at {
            return Err(McapError::NotMcap { cause: "it does not begin with \\x89MCAP0 and a record".to_owned() });
        }
        while parts.end.is_none() {
            at = match parts.record(at)? {
                Some(next) => next,
                None => match parts.next_chunk(at)? {
                    Some(next) => {
                        parts.lost.push(format!("bytes {at} to {next} are damaged"));
                        next
                    }
                    None => {
                        parts.lost.push(format!("there is no end; nothing after byte {at} of {size} could be read"));
                        break;
                    }
                },
            };
        }
        Ok(parts)
    }

    /// Reads bytes of the file. Returns false if it ends before.
    fn fill(&mut self, at: u64, count: u64) -> Result<bool, McapError> {
        if at.checked_add(count).is_none_or(|end| end > self.size) {
            return Ok(false);
        }
        self.input.seek_relative(at.wrapping_sub(self.stands).cast_signed()).map_err(read_error)?;
        self.bytes.resize(count as usize, 0);
        self.input.read_exact(&mut self.bytes).map_err(read_error)?;
        self.stands = at + count;
        Ok(true)
    }

    /// Returns the bytes of a part, with the head of its record.
    pub(crate) fn read(&mut self, part: Part) -> Result<&[u8], McapError> {
        if !self.fill(part.at, part.bytes)? {
            return Err(McapError::Read { cause: "it became shorter".to_owned() });
        }
        Ok(&self.bytes)
    }

    /// Notes the record at `at`. Returns the place behind it, or `None` if there is no whole record.
    fn record(&mut self, at: u64) -> Result<Option<u64>, McapError> {
        if !self.fill(at, HEAD)? {
            return Ok(None);
        }
        let (opcode, length) = (self.bytes[0], number(&self.bytes, 1));
        let Some(next) = at.saturating_add(HEAD).checked_add(length).filter(|next| *next <= self.size) else {
            return Ok(None);
        };
        match opcode {
            op::CHUNK => return Ok(self.chunk(at, length)?.then_some(next)),
            op::MESSAGE => return Ok(self.message(at, length)?.then_some(next)),
            op::FOOTER => {
                let end = next + MAGIC.len() as u64;
                let is_end = self.fill(next, MAGIC.len() as u64)? && self.bytes == MAGIC;
                self.end = is_end.then_some(end);
                return Ok(self.end);
            }
            op::SCHEMA | op::CHANNEL | op::METADATA | op::STATISTICS => {
                if length > CHUNK_BYTES_MAX {
                    return Ok(None);
                }
                self.fill(at + HEAD, length)?;
                let Ok(record) = parse_record(opcode, &self.bytes).map(Record::into_owned) else { return Ok(None) };
                match record {
                    Record::Metadata(table) => self.tables.push((table.name, table.metadata)),
                    Record::Statistics(counts) => self.counted = Some(counts.message_count),
                    record => self.names.add(record)?,
                }
            }
            // Indices and attachments, the header, and records of other programs.
            op::HEADER..=op::DATA_END | 0x80.. => {}
            _ => return Ok(None),
        }
        Ok(Some(next))
    }

    fn chunk(&mut self, at: u64, length: u64) -> Result<bool, McapError> {
        self.fill(at + HEAD, length.min(CHUNK_HEAD + PACKING_MAX))?;
        let Some((head, packed)) = packed(&self.bytes) else { return Ok(false) };
        if head.checked_add(packed).is_none_or(|end| end > length) {
            return Ok(false);
        }
        let (begin_ns, unpacked) = (number(&self.bytes, 0), number(&self.bytes, 16));
        let (bytes, bound) = (unpacked.max(packed), CHUNK_BYTES_MAX);
        if bytes > bound {
            // A flipped bit, or a writer of larger chunks. The other chunks are read.
            let bound = format!("at most {bound} are read (`pymcap-cli rechunk` writes smaller ones)");
            self.lost.push(format!("the chunk at byte {at} claims to unpack to {bytes} bytes, {bound}"));
            return Ok(true);
        }
        self.unpacked += unpacked;
        let bound = CHUNK_BYTES_MAX.saturating_add(at.saturating_mul(RATIO_MAX));
        if self.unpacked > bound {
            return Err(McapError::Unpacked { offset: at, bytes: self.unpacked, bound });
        }
        self.list.push(Part { begin_ns, at, bytes: HEAD + length, unpacked, is_chunk: true });
        Ok(true)
    }

    fn message(&mut self, at: u64, length: u64) -> Result<bool, McapError> {
        if !(MESSAGE_HEAD..=CHUNK_BYTES_MAX).contains(&length) {
            return Ok(false);
        }
        self.fill(at + HEAD, MESSAGE_HEAD)?;
        let (time_ns, bytes) = (number(&self.bytes, 6), HEAD + length);
        match self.list.last_mut() {
            Some(run) if !run.is_chunk && run.at + run.bytes == at && run.bytes < RUN_BYTES => {
                run.begin_ns = run.begin_ns.min(time_ns);
                run.bytes += bytes;
                run.unpacked += bytes;
            }
            _ => self.list.push(Part { begin_ns: time_ns, at, bytes, unpacked: bytes, is_chunk: false }),
        }
        Ok(true)
    }

    /// Looks for a chunk after `at`. All lengths in its head agree, which no other data do by chance.
    fn next_chunk(&mut self, at: u64) -> Result<Option<u64>, McapError> {
        let mut from = at + 1;
        while from < self.size {
            let block = RUN_BYTES.min(self.size - from);
            self.fill(from, (block + HEAD + CHUNK_HEAD + PACKING_MAX).min(self.size - from))?;
            let is_chunk = |i: &usize| {
                let (length, place) = (number(&self.bytes, i + 1), from + *i as u64 + HEAD);
                self.bytes[*i] == op::CHUNK
                    && packed(self.bytes.get(i + HEAD as usize..).unwrap_or_default())
                        .is_some_and(|(head, packed)| head.checked_add(packed) == Some(length))
                    && place.checked_add(length).is_some_and(|end| end <= self.size)
            };
            if let Some(found) = (0..block as usize).find(is_chunk) {
                return Ok(Some(from + found as u64));
            }
            from += block;
        }
        Ok(None)
    }
}
