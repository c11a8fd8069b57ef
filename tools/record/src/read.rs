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

pub struct Recorded {
    file: PathBuf,
    reader: Reader<BufReader<File>>,
    about: BTreeMap<String, String>,
    outcome: BTreeMap<String, String>,
    waiting: Option<(u64, Content)>,
}

impl Recorded {
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let open = |error: std::io::Error| RecordError::Open { cause: rt::unreadable(path, &error) };
        if !std::fs::metadata(path).map_err(open)?.is_file() {
            return Err(open(std::io::Error::other("is not a regular file")));
        }
        let file = File::open(path).map_err(open)?;
        let reader = Reader::new(BufReader::new(file));
        let (about, outcome) = (BTreeMap::new(), BTreeMap::new());
        let mut recorded = Self { file: path.to_path_buf(), reader, about, outcome, waiting: None };
        recorded.waiting = recorded.read()?;
        Ok(recorded)
    }

    /// Returns the metadata at the beginning of the file.
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
        match self.waiting.take() {
            Some(message) => Ok(Some(message)),
            None => self.read(),
        }
    }

    fn read(&mut self) -> Result<Option<(u64, Content)>, RecordError> {
        loop {
            let item = self.reader.next_item();
            let file = || self.file.display().to_string();
            match item.map_err(|source| RecordError::Read { file: file(), source })? {
                None => return Ok(None),
                Some(Item::Message { channel, log_time, data, .. }) => {
                    let Some(source) = self.reader.source(channel) else { continue };
                    let message = decode(&source.topic, &source.encoding, &source.schema, data)
                        .map_err(|cause| RecordError::Lacks { file: file(), cause })?;
                    return Ok(Some((log_time, message)));
                }
                Some(Item::Metadata { name, entries }) if name == ABOUT => self.about = entries,
                Some(Item::Metadata { name, entries }) if name == OUTCOME => self.outcome = entries,
                Some(_) => {}
            }
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
