//! Recordings (.mcap). The reader passes the messages on in the order of their time, whatever their order in the file, and past
//! damage, in bounded memory. A second function extracts the motion of the skeletons.

use crate::error::McapError;
use crate::parts::{CHUNK_BYTES_MAX, Part, Parts};
use crate::{FRAMES_MAX, Frame, Guesses, Motion};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use messages::{LIMBS, Limb, Message, SMPL_JOINTS, Skeleton, Smpl, skeleton_flag};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::io::{Read, Seek};

/// Bytes of messages that may wait for earlier ones for each byte of the file, in addition to one largest chunk, and the most.
/// A run in virtual time, with one chunk for each topic, unpacks to 5 times its file. Assumption: three times that.
const WAITING_PER_BYTE: u64 = 16;
const WAITING_BYTES_MAX: u64 = 1 << 30;
/// Damaged places that are named. More are counted.
const LOST_NAMED: usize = 4;
/// Range of rates to which skeletons are resampled, Hz. It is the range of a live client.
const RATE_HZ: (f64, f64) = (30.0, 240.0);
/// A longer pause between two skeletons is cut out, s. The person was not visible.
const PAUSE_S: f64 = 0.5;
/// If a person stays exactly the same for longer, a client held a frame, s. The limit is half of the time after
/// which `ingest` assumes a stuck tracker (`frozen_after_ms`), so that `ingest` follows the recording.
const HELD_S: f64 = 0.1;

/// Shortest silence after which another session may lead, ns: the least `ingest.authority_timeout_ms`. Two people whose
/// recordings were merged follow each other faster.
const SILENT_NS: u64 = 100_000_000;

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

/// A message of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// Its channel. [`Reader::source`] names it.
    pub channel: u16,
    /// Time of recording, ns.
    pub log_time: u64,
    /// Its bytes, in the channel's encoding.
    pub data: Vec<u8>,
}

/// State of the file, as far as it was read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The writer finished the file.
    Complete,
    /// The file is damaged, or cut short as after kill -9 or on a full disk. The text says what is lost. All else is valid.
    BrokenOff(String),
    /// The writer finished the file, but more data follow. They are not read.
    GoesOn,
}

/// A message that waits for earlier ones. The earliest comes first, then that of the lowest rank, then the one that its writer
/// counted first. So copies of a message follow each other.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Waiting {
    log_time: u64,
    rank: u8,
    sequence: u32,
    /// The first channel with the same source: a merge may name one twice.
    channel: u16,
    part: u32,
    /// Place and length in the data of its part, bytes.
    from: u32,
    bytes: u32,
}

/// Data of a part of which messages wait.
struct Loaded {
    data: Vec<u8>,
    waiting: usize,
    unpacked: u64,
}

/// Reads a recording in the order of time. It needs no index, so it also reads a file that was cut.
pub struct Reader<R> {
    parts: Parts<R>,
    rank: fn(&str) -> u8,
    ending: Ending,
    /// Number of the next part.
    next: usize,
    loaded: BTreeMap<u32, Loaded>,
    waiting: BinaryHeap<Reverse<Waiting>>,
    waiting_bytes: u64,
    passed: u64,
    unpacked: u64,
    is_searched: bool,
}

impl<R: Read + Seek> Reader<R> {
    /// Creates a reader of `input`. Messages of one time come in the order of `rank`, which is given their topic. Copies of a
    /// message, as after a merge of overlapping files, come once.
    ///
    /// # Errors
    /// Returns [`McapError`] if it is no MCAP file, or if it unpacks to too much.
    pub fn new(input: R, rank: fn(&str) -> u8) -> Result<Self, McapError> {
        let mut parts = Parts::find(input)?;
        parts.list.sort_by_key(|part| part.begin_ns);
        let ending = if parts.end.is_some_and(|end| end < parts.size) { Ending::GoesOn } else { Ending::Complete };
        let (loaded, waiting) = (BTreeMap::new(), BinaryHeap::new());
        let (next, passed, unpacked, waiting_bytes, is_searched) = (0, 0, 0, 0, false);
        let mut reader =
            Self { parts, rank, ending, next, loaded, waiting, waiting_bytes, passed, unpacked, is_searched };
        reader.settle();
        Ok(reader)
    }

    /// Returns the channel of a message.
    pub fn source(&self, channel: u16) -> Option<&Source> {
        self.parts.names.channels.get(&channel).map(|(_, source)| source)
    }

    /// Returns every channel seen so far.
    pub fn sources(&self) -> impl Iterator<Item = &Source> {
        self.parts.names.channels.values().map(|(_, source)| source)
    }

    /// Returns the last table of this name, wherever it stands in the file.
    pub fn table(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.parts.tables.iter().rev().find(|(known, _)| known == name).map(|(_, table)| table)
    }

    /// Returns the state of the file, as far as it was read.
    pub fn ending(&self) -> &Ending {
        &self.ending
    }

    /// Returns what is lost, if the file is damaged or truncated.
    pub fn lost(&self) -> Option<&str> {
        match &self.ending {
            Ending::BrokenOff(lost) => Some(lost),
            Ending::Complete | Ending::GoesOn => None,
        }
    }

    /// Bytes of records unpacked so far.
    pub fn unpacked_bytes(&self) -> u64 {
        self.unpacked
    }

    /// Returns the next message. `None` at the end, whatever its kind ([`Reader::ending`]).
    ///
    /// # Errors
    /// Returns [`McapError`] if the input cannot be read, or if too many messages wait for earlier ones.
    pub fn next_message(&mut self) -> Result<Option<Recorded>, McapError> {
        loop {
            while let Some(&part) = self.parts.list.get(self.next)
                && self.waiting.peek().is_none_or(|Reverse(first)| part.begin_ns <= first.log_time)
            {
                self.load(part)?;
            }
            let Some(Reverse(first)) = self.waiting.pop() else { break };
            self.passed += 1;
            let twin = self.waiting.peek().is_some_and(|Reverse(second)| {
                (first.log_time, first.sequence) == (second.log_time, second.sequence)
                    && first.channel == second.channel
                    && self.data(&first) == self.data(second)
            });
            let data = if twin { Vec::new() } else { self.data(&first).to_vec() };
            if let Some(loaded) = self.loaded.get_mut(&first.part) {
                loaded.waiting -= 1;
                if loaded.waiting == 0 {
                    self.waiting_bytes -= loaded.unpacked;
                    self.loaded.remove(&first.part);
                }
            }
            if !twin {
                return Ok(Some(Recorded { channel: first.channel, log_time: first.log_time, data }));
            }
        }
        if let Some(counted) = self.parts.counted.filter(|counted| *counted > self.passed) {
            self.parts.counted = None;
            self.parts.lost.push(format!("{} of {counted} messages are lost", counted - self.passed));
            self.settle();
        }
        Ok(None)
    }

    fn data(&self, waiting: &Waiting) -> &[u8] {
        let (from, bytes) = (waiting.from as usize, waiting.bytes as usize);
        self.loaded.get(&waiting.part).and_then(|loaded| loaded.data.get(from..from + bytes)).unwrap_or_default()
    }

    /// Unpacks the next part. One that is damaged is left out as a whole.
    fn load(&mut self, part: Part) -> Result<(), McapError> {
        let number = self.next as u32;
        self.next += 1;
        let bound = WAITING_BYTES_MAX.min(self.parts.size * WAITING_PER_BYTE) + CHUNK_BYTES_MAX;
        if self.waiting_bytes + part.unpacked > bound {
            return Err(McapError::Disorder { bytes: self.waiting_bytes + part.unpacked, bound });
        }
        let (mut data, mut all, mut is_early) = (Vec::new(), Vec::new(), false);
        let unpacked = self.unpack(part, &mut |record| {
            if let Record::Message { header, data: bytes } = record {
                is_early |= header.log_time < part.begin_ns;
                let (from, channel) = (data.len() as u32, header.channel_id);
                let (log_time, sequence, length) = (header.log_time, header.sequence, bytes.len() as u32);
                data.extend_from_slice(&bytes);
                all.push(Waiting { log_time, rank: 0, sequence, part: number, from, bytes: length, channel });
            }
        })?;
        let cause = unpacked.err().or(is_early.then(|| "a message is earlier than its chunk".to_owned()));
        if let Some(cause) = cause {
            // They are in the order of their times. Damaged ones may have none.
            let first = self.parts.list.partition_point(|part| part.begin_ns == 0);
            let first_ns = self.parts.list.get(first).map_or(0, |part| part.begin_ns);
            let at_s = part.begin_ns.saturating_sub(first_ns) as f64 * 1e-9;
            self.parts.lost.push(format!("the chunk at byte {}, from {at_s:.3} s on, is damaged: {cause}", part.at));
            self.settle();
            return Ok(());
        }
        if all.iter().any(|one| self.source(one.channel).is_none()) {
            self.search()?;
        }
        let before = all.len();
        let mut firsts = BTreeMap::new();
        all.retain_mut(|one| {
            let channels = &self.parts.names.channels;
            let Some((_, source)) = channels.get(&one.channel) else { return false };
            one.rank = (self.rank)(&source.topic);
            let first =
                || channels.iter().find(|(_, (_, other))| other == source).map_or(one.channel, |(first, _)| *first);
            one.channel = *firsts.entry(one.channel).or_insert_with(first);
            true
        });
        if all.len() < before {
            let count = before - all.len();
            self.parts.lost.push(format!("{count} messages at byte {} have a channel without a name", part.at));
            self.settle();
        }
        if !all.is_empty() {
            self.waiting_bytes += part.unpacked;
            self.loaded.insert(number, Loaded { data, waiting: all.len(), unpacked: part.unpacked });
            self.waiting.extend(all.into_iter().map(Reverse));
        }
        Ok(())
    }

    /// Looks for channels in all parts, once: a file without a summary may name them in a later part.
    fn search(&mut self) -> Result<(), McapError> {
        if !std::mem::replace(&mut self.is_searched, true) {
            for part in self.parts.list.clone() {
                let _ = self.unpack(part, &mut |_| {})?;
            }
        }
        Ok(())
    }

    /// Passes every message of a part to `each`, and notes its channels. The inner error says how it is damaged.
    fn unpack(&mut self, part: Part, each: &mut dyn FnMut(Record<'_>)) -> Result<Result<(), String>, McapError> {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(CHUNK_BYTES_MAX as usize);
        let mut reader = LinearReader::new_with_options(options);
        let mut names = std::mem::take(&mut self.parts.names);
        let mut rest = self.parts.read(part)?;
        let mut outcome = Ok(Ok(()));
        while let Some(event) = reader.next_event() {
            match event.and_then(|event| match event {
                LinearReadEvent::ReadRequest(need) => Ok(Err(need)),
                LinearReadEvent::Record { opcode, data } => {
                    self.unpacked += data.len() as u64;
                    mcap::parse_record(opcode, data).map(Ok)
                }
            }) {
                Ok(Err(need)) => {
                    let (now, later) = rest.split_at(need.min(rest.len()));
                    reader.insert(now.len()).copy_from_slice(now);
                    reader.notify_read(now.len());
                    rest = later;
                }
                Ok(Ok(record @ (Record::Schema { .. } | Record::Channel(_)))) => {
                    if let Err(error) = names.add(record.into_owned()) {
                        outcome = Err(error);
                        break;
                    }
                }
                Ok(Ok(record)) => each(record),
                Err(error) => {
                    outcome = Ok(Err(error.to_string()));
                    break;
                }
            }
        }
        self.parts.names = names;
        outcome
    }

    /// Says what is lost so far.
    fn settle(&mut self) {
        let lost = &self.parts.lost;
        if !lost.is_empty() {
            let mut text = lost.iter().take(LOST_NAMED).cloned().collect::<Vec<_>>().join("; ");
            if lost.len() > LOST_NAMED {
                text += &format!("; and {} more", lost.len() - LOST_NAMED);
            }
            self.ending = Ending::BrokenOff(text);
        }
    }
}

/// Frames in the order of their time, without pauses and held frames.
#[derive(Default)]
struct Timed {
    /// Time from the first one, s.
    frames: Vec<(f64, Frame)>,
    begin_ns: Option<u64>,
    /// Number of frames whose time had been.
    late: usize,
    /// Time that is left out: all of it, and that of held frames, s.
    cut_s: f64,
    held_s: f64,
    /// Time of the last change, s.
    changed_s: f64,
}

impl Timed {
    /// Adds a frame of this time, unless it is held or its time has been.
    fn add(&mut self, origin_ns: u64, frame: Frame) {
        let begin_ns = *self.begin_ns.get_or_insert(origin_ns);
        let mut at_s = origin_ns.saturating_sub(begin_ns) as f64 * 1e-9 - self.cut_s;
        if let Some((before_s, last)) = self.frames.last() {
            if at_s <= *before_s {
                self.late += 1;
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

/// Reads the motion of the skeletons that `ingest` published, in the order of time. The motion gets the name `name`.
///
/// # Errors
/// Returns [`McapError`] if the file is none or too large, or if it holds fewer than two skeletons.
pub fn parse_mcap(input: impl Read + Seek, name: &str) -> Result<Motion, McapError> {
    let mut reader = Reader::new(input, |topic| u8::from(topic != "/teleop/skeleton"))?;
    let mut timed = Timed::default();
    let (mut unusable, mut others) = (0_usize, 0_usize);
    // Topic, session and newest time of the person that is read.
    let mut led: Option<(String, u64, u64)> = None;
    while let Some(Recorded { channel, data, .. }) = reader.next_message()? {
        let skeletons = |source: &&Source| source.schema == Skeleton::TYPE_NAME.as_str();
        let Some(source) = reader.source(channel).filter(skeletons) else { continue };
        let skeleton = Skeleton::from_le_bytes(&data);
        let Some((skeleton, frame)) = skeleton.and_then(|skeleton| Some((skeleton, frame_of(&skeleton)?))) else {
            unusable += 1;
            continue;
        };
        let (session, at_ns) = (skeleton.session_nonce, skeleton.header.origin.0);
        let is_other = led.as_ref().is_some_and(|(topic, led, newest_ns)| {
            *topic != source.topic || *led != session && at_ns.saturating_sub(*newest_ns) < SILENT_NS
        });
        if is_other {
            others += 1;
            continue;
        }
        led = Some((source.topic.clone(), session, at_ns));
        if timed.frames.len() >= FRAMES_MAX {
            return Err(McapError::Frames { bound: FRAMES_MAX });
        }
        // Time at which the person was seen, from the header.
        timed.add(skeleton.header.origin.0, frame);
    }
    let Timed { frames: timed, cut_s, held_s, late, .. } = timed;
    let lost = reader.lost().map(str::to_owned);
    let (Some((last_s, _)), true) = (timed.last(), timed.len() >= 2) else {
        return Err(no_skeletons(&reader, timed.len()));
    };
    let rate_hz = ((timed.len() - 1) as f64 / last_s).clamp(RATE_HZ.0, RATE_HZ.1);
    let count = (last_s * rate_hz).round() as usize + 1;
    if count > FRAMES_MAX {
        return Err(McapError::Frames { bound: FRAMES_MAX });
    }
    let mut warnings = Vec::new();
    if let Some(cause) = &lost {
        warnings.push(format!("the recording is damaged or truncated ({cause}); what is whole is used"));
    }
    if held_s > 0.0 {
        warnings.push(format!("{held_s:.1} s with a held (repeated) frame are left out"));
    }
    if cut_s > held_s {
        warnings.push(format!("{:.1} s of pauses without a person are left out", cut_s - held_s));
    }
    for (count, which) in [
        (late, "that were seen before others"),
        (unusable, "without both arms, or of a wrong length,"),
        (others, "of a second person (another topic or session)"),
    ] {
        warnings.extend((count > 0).then(|| format!("{count} skeletons {which} are left out")));
    }
    let frames = (0..count).map(|i| at(&timed, i as f64 / rate_hz)).collect();
    let stature_m = stature_m(&timed[0].1.positions);
    let guesses = Guesses { scale_m_per_unit: 1.0, unit: "m", stature_m, up: "+Z", warnings, lost };
    Ok(Motion { name: name.to_owned(), frame_rate_hz: rate_hz, frames, first: None, has_rotations: true, guesses })
}

fn no_skeletons(reader: &Reader<impl Read + Seek>, count: usize) -> McapError {
    let source = |source: &Source| match source.schema.as_str() {
        "" => format!("{} without a schema", source.topic),
        schema => format!("{} ({schema})", source.topic),
    };
    let topics = reader.sources().map(source).take(16).collect::<Vec<_>>().join(", ");
    let topics = if topics.is_empty() { "none".to_owned() } else { topics };
    let broken = reader.lost().map_or(String::new(), |lost| format!("; the file is damaged or truncated: {lost}"));
    McapError::NoSkeletons { count, layout: Skeleton::TYPE_NAME.as_str(), topics, broken }
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
