//! Reads a recording back: our own messages, bit for bit.

use crate::error::RecordError;
use crate::inputs::Inputs;
use crate::topic::Topic;
use crate::{ABOUT, OUTCOME};
use messages::{JointCommand, JointTarget, Message, RobotState, Skeleton, Status};
use motion::mcap::{Ending, Item, Reader};
use robot::Model;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    Skeleton(Box<Skeleton>),
    Target(Box<JointTarget>),
    Command(Box<JointCommand>),
    State(Box<RobotState>),
    Status(Box<Status>),
    Inputs(Inputs),
    /// A message for viewers, or from another program.
    Other {
        topic: String,
        data: Vec<u8>,
    },
}

/// Most bytes of messages that are sorted in memory: half an hour of a whole run.
const SORTED_BYTES_MAX: u64 = 1 << 30;

/// The messages of a recording in the order of their time, with its tables. Other programs write messages topic by topic, or
/// the tables last.
pub struct Recorded {
    file: PathBuf,
    reader: Reader<BufReader<File>>,
    about: BTreeMap<String, String>,
    outcome: BTreeMap<String, String>,
    /// All messages, if the file has them in another order.
    sorted: Option<std::vec::IntoIter<(u64, Content)>>,
}

impl Recorded {
    /// Opens a recording, and reads it once to find its tables and the order of its messages.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let mut recorded = Self::begin(path)?;
        let (mut ordered, mut newest, mut bytes) = (true, 0, 0_u64);
        while let Some(item) = recorded.item()? {
            match item {
                Item::Message { log_time, data, .. } => {
                    (ordered, newest) = (ordered && log_time >= newest, newest.max(log_time));
                    bytes += data.len() as u64;
                }
                Item::Metadata { name, entries } if name == ABOUT => recorded.about = entries,
                Item::Metadata { name, entries } if name == OUTCOME => recorded.outcome = entries,
                Item::Metadata { .. } | Item::Attachment { .. } => {}
            }
        }
        let again = Self::begin(path)?;
        let mut recorded = Self { about: recorded.about, outcome: recorded.outcome, ..again };
        if !ordered {
            recorded.sort(bytes)?;
        }
        Ok(recorded)
    }

    fn begin(path: &Path) -> Result<Self, RecordError> {
        let open = |error: std::io::Error| RecordError::Open { cause: rt::unreadable(path, &error) };
        if !std::fs::metadata(path).map_err(open)?.is_file() {
            return Err(open(std::io::Error::other("is not a regular file")));
        }
        let reader = Reader::new(BufReader::new(File::open(path).map_err(open)?));
        let (about, outcome) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { file: path.to_path_buf(), reader, about, outcome, sorted: None })
    }

    /// Sorts all messages by their time. Those of one tick come in the order in which the stages take and make them.
    fn sort(&mut self, bytes: u64) -> Result<(), RecordError> {
        if bytes > SORTED_BYTES_MAX {
            let cause = format!(
                "its messages are not in the order of their time, and {bytes} bytes are more than the {SORTED_BYTES_MAX} that \
                 are sorted here; `pymcap-cli sort` writes them in that order"
            );
            return Err(RecordError::Lacks { file: self.file.display().to_string(), cause });
        }
        let mut all = Vec::new();
        while let Some(message) = self.read()? {
            all.push(message);
        }
        all.sort_by_key(|(log_time, content)| (*log_time, content.rank()));
        self.sorted = Some(all.into_iter());
        Ok(())
    }

    /// Returns the table of the run's settings.
    pub fn about(&self) -> &BTreeMap<String, String> {
        &self.about
    }

    /// Returns an error if the file names another robot than `model`. A robot keeps its name if its limits change.
    pub fn check_robot(&self, model: &Model) -> Result<(), RecordError> {
        match self.about.get("robot") {
            Some(name) if *name != model.name => {
                let own = &model.name;
                let cause =
                    format!("was recorded with the robot {name}, not {own}: give --robot or --config of {name}");
                Err(RecordError::Lacks { file: self.file.display().to_string(), cause })
            }
            _ => Ok(()),
        }
    }

    pub fn outcome(&self) -> &BTreeMap<String, String> {
        &self.outcome
    }

    pub fn ending(&self) -> &Ending {
        self.reader.ending()
    }

    /// Returns the reason if the file breaks off.
    pub(crate) fn broken_off(&self) -> Option<String> {
        match self.ending() {
            Ending::BrokenOff(why) => Some(why.clone()),
            Ending::Open | Ending::Complete | Ending::GoesOn => None,
        }
    }

    pub fn next_message(&mut self) -> Result<Option<(u64, Content)>, RecordError> {
        match &mut self.sorted {
            Some(sorted) => Ok(sorted.next()),
            None => self.read(),
        }
    }

    fn item(&mut self) -> Result<Option<Item>, RecordError> {
        let file = || self.file.display().to_string();
        self.reader.next_item().map_err(|source| RecordError::Read { file: file(), source })
    }

    fn read(&mut self) -> Result<Option<(u64, Content)>, RecordError> {
        while let Some(item) = self.item()? {
            let Item::Message { channel, log_time, data, .. } = item else { continue };
            let Some(source) = self.reader.source(channel) else { continue };
            let message = decode(&source.topic, &source.encoding, &source.schema, data);
            let file = || self.file.display().to_string();
            return Ok(Some((log_time, message.map_err(|cause| RecordError::Lacks { file: file(), cause })?)));
        }
        Ok(None)
    }
}

impl Content {
    /// Place among the messages of one tick: `retarget` takes a skeleton and makes a target, `control` takes both inputs.
    fn rank(&self) -> u32 {
        match self {
            Self::Skeleton(_) => 0,
            Self::Target(_) => 1,
            Self::Inputs(_) => 2,
            Self::Command(_) => 3,
            Self::Status(_) => 4,
            Self::State(_) => 5,
            Self::Other { .. } => 6,
        }
    }
}

fn decode(topic: &str, encoding: &str, schema: &str, data: Vec<u8>) -> Result<Content, String> {
    let ours = Topic::named(topic).filter(|_| encoding == "teleopd" || topic == Topic::Inputs.name());
    let Some(ours) = ours else { return Ok(Content::Other { topic: topic.to_owned(), data }) };
    if ours == Topic::Inputs {
        let inputs =
            Inputs::from_json(&data).ok_or_else(|| format!("{topic}: a message without the keys of Inputs"))?;
        return Ok(Content::Inputs(inputs));
    }
    fn boxed<M: Message>(topic: &str, schema: &str, data: &[u8]) -> Result<Box<M>, String> {
        let (expected, size) = (M::TYPE_NAME, size_of::<M>());
        if schema != expected.as_str() {
            return Err(format!("{topic} has the layout {schema}, this version reads {}", expected.as_str()));
        }
        let message = M::from_le_bytes(data).map(Box::new);
        message.ok_or_else(|| format!("{topic}: a message of {} bytes, not {size}", data.len()))
    }
    Ok(match ours {
        Topic::Skeleton => Content::Skeleton(boxed(topic, schema, &data)?),
        Topic::Target => Content::Target(boxed(topic, schema, &data)?),
        Topic::Command => Content::Command(boxed(topic, schema, &data)?),
        Topic::State => Content::State(boxed(topic, schema, &data)?),
        Topic::StatusRaw => Content::Status(boxed(topic, schema, &data)?),
        _ => Content::Other { topic: topic.to_owned(), data },
    })
}
