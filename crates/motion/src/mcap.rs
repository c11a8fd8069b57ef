//! Recordings (.mcap). The reader reads any file from its beginning to its last whole chunk, in bounded memory. A
//! second function extracts the motion of the skeletons.

use crate::error::McapError;
use crate::unpack::{CHUNK_BYTES_MAX, Meter};
use crate::{FRAMES_MAX, Frame, Guesses, Motion};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use messages::{LIMBS, Limb, Message, SMPL_JOINTS, Skeleton, Smpl, skeleton_flag};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use std::collections::BTreeMap;
use std::io::Read;

/// Largest record that is read, bytes. It equals the largest chunk.
const RECORD_BYTES_MAX: usize = CHUNK_BYTES_MAX as usize;
/// Most schemas and channels of a file.
const CHANNELS_MAX: usize = 4096;
/// Bytes per read from the file.
const READ_BYTES: usize = 1 << 16;
/// Range of rates to which skeletons are resampled, Hz. It is the range of a live client.
const RATE_HZ: (f64, f64) = (30.0, 240.0);
/// A longer pause between two skeletons is cut out, s. The person was not visible.
const PAUSE_S: f64 = 0.5;
/// If a person stays exactly the same for longer, a client held a frame, s. The limit is half of the time after
/// which `ingest` assumes a stuck tracker (`frozen_after_ms`), so that `ingest` follows the recording.
const HELD_S: f64 = 0.1;

/// Largest plausible distance of a joint from the origin, m. It is farther than any camera or tracker sees.
const POSITION_MAX_M: f32 = 1e4;

/// Origin of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// The channel's topic.
    pub topic: String,
    /// Encoding of its messages: `teleopd`, `protobuf`, `json`, ...
    pub encoding: String,
    /// Name of its schema. Empty if it has none.
    pub schema: String,
}

/// An item of a recording.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the variants describe the fields")]
pub enum Item {
    /// A message.
    Message {
        /// Its channel. [`Reader::source`] names it.
        channel: u16,
        /// Sequence number of its writer.
        sequence: u32,
        /// Time of recording, ns.
        log_time: u64,
        data: Vec<u8>,
    },
    /// A table of texts.
    Metadata { name: String, entries: BTreeMap<String, String> },
    /// An embedded file.
    Attachment { name: String, data: Vec<u8> },
}

/// State of the end of reading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// There are more items.
    Open,
    /// The writer finished the file.
    Complete,
    /// The file is cut short, as after kill -9 or on a full disk. The data before the cut are valid.
    BrokenOff(String),
    /// The writer finished the file, but more data follow. They are not read.
    GoesOn,
}

/// Reads a recording from its beginning. It needs no index, so it reads a cut file up to its last chunk.
pub struct Reader<R> {
    input: R,
    reader: LinearReader,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Source>,
    ending: Ending,
    any: bool,
    meter: Meter,
}

impl<R: Read> Reader<R> {
    /// Creates a reader of `input`.
    pub fn new(input: R) -> Self {
        let options =
            LinearReaderOptions::default().with_prevalidate_chunk_crcs(true).with_record_length_limit(RECORD_BYTES_MAX);
        let reader = LinearReader::new_with_options(options);
        let (schemas, channels) = (BTreeMap::new(), BTreeMap::new());
        Self { input, reader, schemas, channels, ending: Ending::Open, any: false, meter: Meter::default() }
    }

    /// Returns the channel of a message.
    pub fn source(&self, channel: u16) -> Option<&Source> {
        self.channels.get(&channel)
    }

    /// Returns every channel seen so far.
    pub fn sources(&self) -> impl Iterator<Item = &Source> {
        self.channels.values()
    }

    /// Returns the state of the end of reading.
    pub fn ending(&self) -> &Ending {
        &self.ending
    }

    /// Bytes of records unpacked so far, including chunks.
    pub fn unpacked_bytes(&self) -> u64 {
        self.meter.came()
    }

    /// Returns the next item. `None` at the end, whatever its kind ([`Reader::ending`]).
    pub fn next_item(&mut self) -> Result<Option<Item>, McapError> {
        while self.ending == Ending::Open {
            let event = match self.reader.next_event() {
                None => {
                    let more =
                        self.input.read(&mut [0]).map_err(|error| McapError::Read { cause: error.to_string() })?;
                    self.ending = if more == 0 { Ending::Complete } else { Ending::GoesOn };
                    break;
                }
                Some(event) => event,
            };
            match event {
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    let place = self.reader.insert(need.clamp(1, READ_BYTES));
                    let count = self.input.read(place).map_err(|error| McapError::Read { cause: error.to_string() })?;
                    self.meter.see(&place[..count])?;
                    self.reader.notify_read(count);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    self.any = true;
                    self.meter.comes(data.len())?;
                    let Ok(record) = mcap::parse_record(opcode, data).map(Record::into_owned) else {
                        self.ending = Ending::BrokenOff("a record that cannot be parsed".to_owned());
                        break;
                    };
                    if let Some(item) = self.read_record(record)? {
                        return Ok(Some(item));
                    }
                }
                Err(error) if self.any => self.ending = Ending::BrokenOff(error.to_string()),
                Err(error) => return Err(McapError::NotMcap { cause: error.to_string() }),
            }
        }
        Ok(None)
    }

    fn read_record(&mut self, record: Record<'_>) -> Result<Option<Item>, McapError> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let source = Source { topic: channel.topic, encoding: channel.message_encoding, schema };
                self.channels.insert(channel.id, source);
            }
            Record::Message { header, data } => {
                return Ok(Some(Item::Message {
                    channel: header.channel_id,
                    sequence: header.sequence,
                    log_time: header.log_time,
                    data: data.into_owned(),
                }));
            }
            Record::Metadata(metadata) => {
                return Ok(Some(Item::Metadata { name: metadata.name, entries: metadata.metadata }));
            }
            Record::Attachment { header, data, .. } => {
                return Ok(Some(Item::Attachment { name: header.name, data: data.into_owned() }));
            }
            _ => {}
        }
        if self.schemas.len() > CHANNELS_MAX || self.channels.len() > CHANNELS_MAX {
            return Err(McapError::Channels { bound: CHANNELS_MAX });
        }
        Ok(None)
    }
}

/// Frames in the order of their time, without pauses and held frames.
#[derive(Default)]
struct Timed {
    /// Time from the first one, s.
    frames: Vec<(f64, Frame)>,
    /// Time that is left out: all of it, and that of held frames, s.
    cut_s: f64,
    held_s: f64,
    /// Time of the last change, s.
    changed_s: f64,
}

impl Timed {
    /// Adds a frame at `at_s` of the recording, unless it is held or its time has been.
    fn add(&mut self, at_s: f64, frame: Frame) {
        let mut at_s = at_s - self.cut_s;
        if let Some((before_s, last)) = self.frames.last() {
            if at_s <= *before_s {
                return;
            }
            let is_held = (last.positions, last.rotations) == (frame.positions, frame.rotations);
            self.changed_s = if is_held { self.changed_s } else { at_s };
            if is_held && at_s - self.changed_s > HELD_S {
                self.held_s += at_s - before_s;
                self.cut_s += at_s - before_s;
                return;
            }
            if at_s - before_s > PAUSE_S {
                self.cut_s += at_s - before_s - 1.0 / RATE_HZ.0;
                at_s = before_s + 1.0 / RATE_HZ.0;
            }
        }
        self.frames.push((at_s, frame));
    }
}

/// Reads the motion of the skeletons that `ingest` published, in the order in which the person was seen. Other programs write
/// messages in another order. The motion gets the name `name`.
pub fn parse_mcap(input: impl Read, name: &str) -> Result<Motion, McapError> {
    let mut reader = Reader::new(input);
    let mut seen: Vec<(u64, Frame)> = Vec::new();
    let mut unusable = 0_usize;
    while let Some(item) = reader.next_item()? {
        let Item::Message { channel, data, .. } = item else { continue };
        let skeletons = reader.source(channel).is_some_and(|source| source.schema == Skeleton::TYPE_NAME.as_str());
        if !skeletons {
            continue;
        }
        let Some(skeleton) = Skeleton::from_le_bytes(&data) else { continue };
        let Some(frame) = frame_of(&skeleton) else {
            unusable += 1;
            continue;
        };
        if seen.len() >= FRAMES_MAX {
            return Err(McapError::Frames { bound: FRAMES_MAX });
        }
        // Time at which the person was seen, from the header.
        seen.push((skeleton.header.origin.0, frame));
    }
    seen.sort_by_key(|(origin, _)| *origin);
    let begin_ns = seen.first().map_or(0, |(origin, _)| *origin);
    let mut timed = Timed::default();
    seen.into_iter().for_each(|(origin, frame)| timed.add((origin - begin_ns) as f64 * 1e-9, frame));
    let Timed { frames: timed, cut_s, held_s, .. } = timed;
    let broken = match reader.ending() {
        Ending::BrokenOff(cause) => Some(cause.clone()),
        Ending::Open | Ending::Complete | Ending::GoesOn => None,
    };
    let (Some((last_s, _)), true) = (timed.last(), timed.len() >= 2) else {
        let source = |source: &Source| match source.schema.as_str() {
            "" => format!("{} without a schema", source.topic),
            schema => format!("{} ({schema})", source.topic),
        };
        let topics = reader.sources().map(source).take(16).collect::<Vec<_>>().join(", ");
        let topics = if topics.is_empty() { "none".to_owned() } else { topics };
        let broken = broken.map_or(String::new(), |cause| format!("; the file is damaged or truncated: {cause}"));
        return Err(McapError::NoSkeletons {
            count: timed.len(),
            layout: Skeleton::TYPE_NAME.as_str(),
            topics,
            broken,
        });
    };
    let rate_hz = ((timed.len() - 1) as f64 / last_s).clamp(RATE_HZ.0, RATE_HZ.1);
    let count = (last_s * rate_hz).round() as usize + 1;
    if count > FRAMES_MAX {
        return Err(McapError::Frames { bound: FRAMES_MAX });
    }
    let mut warnings = Vec::new();
    if let Some(cause) = broken {
        warnings
            .push(format!("the recording is damaged or truncated ({cause}); it is used up to its last whole chunk"));
    }
    if held_s > 0.0 {
        warnings.push(format!("{held_s:.1} s with a held (repeated) frame are left out"));
    }
    if cut_s > held_s {
        warnings.push(format!("{:.1} s of pauses without a person are left out", cut_s - held_s));
    }
    if unusable > 0 {
        warnings.push(format!("{unusable} skeletons without both arms are left out"));
    }
    let frames = (0..count).map(|i| at(&timed, i as f64 / rate_hz)).collect();
    let stature_m = stature_m(&timed[0].1.positions);
    let guesses = Guesses { scale_m_per_unit: 1.0, unit: "m", stature_m, up: "+Z", warnings };
    Ok(Motion { name: name.to_owned(), frame_rate_hz: rate_hz, frames, first: None, has_rotations: true, guesses })
}

/// Returns the frame that gives the recorded limbs with the hinges of `CalibrationMode::Rig`. `None` if an arm is
/// missing, or a number is NaN, infinite or too large.
fn frame_of(skeleton: &Skeleton) -> Option<Frame> {
    let near = skeleton.positions.iter().flatten().all(|x| x.abs() < POSITION_MAX_M);
    if !near
        || !skeleton.limbs.iter().flatten().all(|x| x.is_finite())
        || skeleton.flags & skeleton_flag::ALL != skeleton_flag::ALL
    {
        return None;
    }
    let torso: Matrix3<f64> = skeleton::torso_rotation(&skeleton.positions)?;
    let torso = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(torso));
    let known = |side: usize| skeleton.flags & skeleton_flag::CLOSURE[side] != 0;
    let closure = [0, 1].map(|side| Some(skeleton.closure[side]).filter(|closure| known(side) && closure.is_finite()));
    let mut frame = Frame { positions: skeleton.positions, closure, ..Frame::ZERO };
    const CARRIES: [(Limb, &[Smpl]); LIMBS] = [
        (Limb::LeftUpper, &[Smpl::LeftShoulder]),
        (Limb::LeftFore, &[Smpl::LeftElbow, Smpl::LeftWrist]),
        (Limb::RightUpper, &[Smpl::RightShoulder]),
        (Limb::RightFore, &[Smpl::RightElbow, Smpl::RightWrist]),
    ];
    for (limb, joints) in CARRIES {
        let [x, y, z, w] = skeleton.limbs[limb as usize].map(f64::from);
        let local = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-3)?;
        let global = (torso * local).cast::<f32>();
        for &joint in joints {
            frame.rotations[joint as usize] = [global.i, global.j, global.k, global.w];
        }
    }
    Some(frame)
}

/// Returns the stature computed from the legs and the spine, m.
fn stature_m(positions: &[[f32; 3]; SMPL_JOINTS]) -> f64 {
    let pose = |p: &[f32; 3]| crate::bvh::Pose { position: (*p).map(f64::from).into(), rotation: Default::default() };
    crate::canonical::stature_m(&positions.each_ref().map(pose))
}

/// Returns the person at `at_s`, interpolated between the adjacent frames.
fn at(timed: &[(f64, Frame)], at_s: f64) -> Frame {
    let after = timed.partition_point(|(t, _)| *t <= at_s).clamp(1, timed.len() - 1);
    let ((t0, a), (t1, b)) = (&timed[after - 1], &timed[after]);
    let t = ((at_s - t0) / (t1 - t0)).clamp(0.0, 1.0) as f32;
    // At a frame's own time, returns that frame unchanged.
    if t == 0.0 {
        *a
    } else if t == 1.0 {
        *b
    } else {
        crate::resample::mix(a, b, t)
    }
}
