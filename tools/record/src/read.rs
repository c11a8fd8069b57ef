//! Reads a recording back: our own messages, bit for bit.

use crate::error::RecordError;
use crate::inputs::Inputs;
use crate::topic::Topic;
use crate::{ABOUT, OUTCOME};
use messages::{JointCommand, JointTarget, Message, RobotState, Skeleton, Status};
use motion::mcap::{Ending, Reader};
use robot::Model;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    Skeleton(Box<Skeleton>),
    Target(Box<JointTarget>),
    Policy(Box<JointTarget>),
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

/// Largest `Inputs` that are read, bytes. Those of a tick have some 600, also with payloads.
const INPUTS_BYTES_MAX: usize = 1 << 14;

/// The messages of a recording in the order of their time, with its tables. Other programs write messages topic by topic, or
/// the tables last.
pub struct Recorded {
    file: PathBuf,
    reader: Reader<File>,
    about: BTreeMap<String, String>,
    outcome: BTreeMap<String, String>,
}

impl Recorded {
    /// Opens a recording, and reads the heads of its parts.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let open = |error: std::io::Error| RecordError::Open { cause: rt::unreadable(path, &error) };
        if !std::fs::metadata(path).map_err(open)?.is_file() {
            return Err(open(std::io::Error::other("is not a regular file")));
        }
        let reader = Reader::new(File::open(path).map_err(open)?, rank);
        let reader = reader.map_err(|source| RecordError::Read { file: path.display().to_string(), source })?;
        let table = |name| reader.table(name).cloned().unwrap_or_default();
        Ok(Self { file: path.to_path_buf(), about: table(ABOUT), outcome: table(OUTCOME), reader })
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

    /// Returns what is lost if the file is damaged or truncated.
    pub(crate) fn broken_off(&self) -> Option<String> {
        self.reader.lost().map(str::to_owned)
    }

    pub fn next_message(&mut self) -> Result<Option<(u64, Content)>, RecordError> {
        let file = || self.file.display().to_string();
        let next = self.reader.next_message().map_err(|source| RecordError::Read { file: file(), source })?;
        let Some(motion::mcap::Recorded { channel, log_time, data }) = next else { return Ok(None) };
        let Some(source) = self.reader.source(channel) else { return Ok(None) };
        let content = decode(&source.topic, &source.encoding, &source.schema, data);
        Ok(Some((log_time, content.map_err(|cause| RecordError::Lacks { file: file(), cause })?)))
    }
}

/// Place among the messages of one tick: `retarget` takes a skeleton and makes a target, `control` takes both inputs.
fn rank(topic: &str) -> u8 {
    use Topic::{Command, Inputs, Policy, Skeleton, State, StatusRaw, Target};
    const OF_A_TICK: [Topic; 7] = [Skeleton, Target, Policy, Inputs, Command, StatusRaw, State];
    Topic::named(topic).map_or(u8::MAX, |topic| {
        let place = OF_A_TICK.iter().position(|known| *known == topic);
        place.unwrap_or(topic as usize) as u8
    })
}

fn decode(topic: &str, encoding: &str, schema: &str, data: Vec<u8>) -> Result<Content, String> {
    let ours = Topic::named(topic).filter(|_| encoding == "teleopd" || topic == Topic::Inputs.name());
    let Some(ours) = ours else { return Ok(Content::Other { topic: topic.to_owned(), data }) };
    if ours == Topic::Inputs {
        let inputs = Some(&data).filter(|data| data.len() <= INPUTS_BYTES_MAX).and_then(|data| Inputs::from_json(data));
        return inputs.map(Content::Inputs).ok_or_else(|| format!("{topic}: a message without the keys of Inputs"));
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
        Topic::Policy => Content::Policy(boxed(topic, schema, &data)?),
        Topic::Command => Content::Command(boxed(topic, schema, &data)?),
        Topic::State => Content::State(boxed(topic, schema, &data)?),
        Topic::StatusRaw => Content::Status(boxed(topic, schema, &data)?),
        _ => Content::Other { topic: topic.to_owned(), data },
    })
}
