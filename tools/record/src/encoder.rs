//! Turns messages into entries of the file: our own bit for bit, and pictures at a limited rate.

use crate::file::Entry;
use crate::inputs::Inputs;
use crate::pauses::PauseFinder;
use crate::picture;
use crate::topic::Topic;
use explain::Severity;
use foxglove::Encode;
use foxglove::messages::log::Level;
use messages::{
    ALL_JOINTS, JointCommand, JointTarget, Layout, Message, RobotId, RobotState, Skeleton, Stamp, Status, comes_after,
};
use robot::{Frames, Model, Names};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Pictures per second. Unless `full` is set, also targets, commands and states per second.
    pub pictures_hz: f64,
    pub full: bool,
}

#[derive(Clone, Copy, Debug)]
pub enum Sample<'a> {
    Skeleton(&'a Skeleton),
    Target(&'a JointTarget),
    Policy(&'a JointTarget),
    Command(&'a JointCommand),
    State(&'a RobotState),
    Status(&'a Status),
    Inputs(&'a Inputs),
}

#[derive(Clone, Copy, Debug, Default)]
struct Counted {
    last: Option<(u32, u64)>,
    missed: u64,
}

impl Counted {
    fn add(&mut self, incarnation: u32, sequence: u64) {
        if let Some((writer, last)) = self.last
            && writer == incarnation
            && comes_after(sequence, last)
        {
            self.missed += sequence.wrapping_sub(last + 1);
        }
        self.last = Some((incarnation, sequence));
    }
}

/// Next due time of entries that are written at a limited rate.
#[derive(Clone, Copy, Debug, Default)]
struct Paced(u64);

impl Paced {
    fn due(&mut self, at_ns: u64, period_ns: u64) -> bool {
        if at_ns < self.0 {
            return false;
        }
        // The due time stays on the grid, so that the rate does not drift. After a pause a new grid begins.
        self.0 = if at_ns - self.0 < period_ns { self.0 + period_ns } else { at_ns + period_ns };
        true
    }
}

pub struct RecordingEncoder {
    model: Model,
    names: Names,
    frames: Frames,
    rates: Rates,
    /// Offset that is added to every stamp. It converts the monotonic clock to that of the file.
    offset_ns: u64,
    counted: [Counted; 6],
    pictures: [Paced; 5],
    kept: [Paced; 6],
    status: Option<Status>,
    pauses: PauseFinder,
    log_sequence: u32,
}

impl RecordingEncoder {
    /// Creates an encoder that has seen nothing. `offset_ns` is added to every stamp.
    pub fn new(model: &Model, rates: Rates, offset_ns: u64) -> Self {
        Self {
            names: Names::from_model(model),
            model: model.clone(),
            frames: Frames::default(),
            rates,
            offset_ns,
            counted: Default::default(),
            pictures: Default::default(),
            kept: Default::default(),
            status: None,
            pauses: PauseFinder::default(),
            log_sequence: 0,
        }
    }

    /// Returns the published messages that were never read, by service: skeletons, targets, commands, states.
    /// The counts come from gaps in the sequence numbers.
    pub fn missed(&self) -> [(Topic, u64); 4] {
        [Topic::Skeleton, Topic::Target, Topic::Command, Topic::State]
            .map(|topic| (topic, self.counted[topic as usize].missed))
    }

    pub fn encode(&mut self, sample: Sample<'_>, write: &mut dyn FnMut(Entry)) {
        let pause = match sample {
            Sample::Target(target) => self.pauses.target(target).zip(Some(target.header.stamp)),
            Sample::State(state) => self.pauses.state(state).zip(Some(state.header.stamp)),
            Sample::Status(status) => self.pauses.status(status).zip(Some(status.header.stamp)),
            _ => None,
        };
        if let Some((pause, stamp)) = pause {
            self.log(self.file_time(stamp), Level::Warning, pause.text(), write);
        }
        match sample {
            Sample::Skeleton(skeleton) => self.skeleton(skeleton, write),
            Sample::Target(target) => self.target([Topic::Target, Topic::Wanted], target, write),
            Sample::Policy(target) => self.target([Topic::Policy, Topic::PolicyWanted], target, write),
            Sample::Command(command) => {
                let at_ns = self.write_own(Topic::Command, command, &command.header, write);
                if self.is_own(command.robot) && self.pictures[2].due(at_ns, self.period_ns()) {
                    let shown = picture::joint_states(&self.model, at_ns, &command.q, &command.v, ALL_JOINTS);
                    write_message(Topic::Commanded, command.header.sequence, at_ns, &shown, write);
                }
            }
            Sample::State(state) => self.state(state, write),
            Sample::Status(status) => self.status(status, write),
            Sample::Inputs(inputs) => {
                let at_ns = self.file_time(inputs.now);
                let data = inputs.to_json().to_string().into_bytes();
                write(Entry { topic: Topic::Inputs, sequence: inputs.k as u32, log_time: at_ns, data });
            }
        }
    }

    /// Returns true for the robot of the model. The joints of another robot have other names.
    fn is_own(&self, robot: RobotId) -> bool {
        robot == self.model.id()
    }

    fn file_time(&self, stamp: Stamp) -> u64 {
        stamp.0.saturating_add(self.offset_ns)
    }

    fn period_ns(&self) -> u64 {
        (1e9 / self.rates.pictures_hz) as u64
    }

    /// Counts a message, writes it if it is due, and returns its time in the file.
    fn write_own<M: Message>(
        &mut self,
        topic: Topic,
        message: &M,
        header: &messages::Header,
        write: &mut dyn FnMut(Entry),
    ) -> u64 {
        let at_ns = self.file_time(header.stamp);
        self.counted[topic as usize].add(header.incarnation, header.sequence);
        let always = self.rates.full || topic == Topic::Skeleton || topic == Topic::StatusRaw;
        if always || self.kept[topic as usize].due(at_ns, self.period_ns()) {
            write(Entry { topic, sequence: header.sequence as u32, log_time: at_ns, data: bytes_of(message) });
        }
        at_ns
    }

    /// Writes a target, and shows its valid joints.
    fn target(&mut self, [own, shown]: [Topic; 2], target: &JointTarget, write: &mut dyn FnMut(Entry)) {
        let at_ns = self.write_own(own, target, &target.header, write);
        let picture = if own == Topic::Target { 1 } else { 4 };
        if self.is_own(target.robot) && self.pictures[picture].due(at_ns, self.period_ns()) {
            let states = picture::joint_states(&self.model, at_ns, &target.q, &target.dq, target.valid_mask);
            write_message(shown, target.header.sequence, at_ns, &states, write);
        }
    }

    fn skeleton(&mut self, skeleton: &Skeleton, write: &mut dyn FnMut(Entry)) {
        let at_ns = self.write_own(Topic::Skeleton, skeleton, &skeleton.header, write);
        if self.pictures[0].due(at_ns, self.period_ns()) {
            let shown = picture::person(&skeleton.positions, at_ns);
            write_message(Topic::Person, skeleton.header.sequence, at_ns, &shown, write);
        }
    }

    fn state(&mut self, state: &RobotState, write: &mut dyn FnMut(Entry)) {
        let at_ns = self.write_own(Topic::State, state, &state.header, write);
        if !self.is_own(state.robot) || !self.pictures[3].due(at_ns, self.period_ns()) {
            return;
        }
        let sequence = state.header.sequence;
        let shown = picture::joint_states(&self.model, at_ns, &state.q_measured, &state.dq_measured, ALL_JOINTS);
        write_message(Topic::Measured, sequence, at_ns, &shown, write);
        // Positions with NaN or infinity cannot be drawn.
        if state.q_measured.iter().all(|q| q.is_finite()) {
            let shown = picture::transforms(&self.model, &mut self.frames, at_ns, &state.q_measured);
            write_message(Topic::Transforms, sequence, at_ns, &shown, write);
            write_message(
                Topic::Capsules,
                sequence,
                at_ns,
                &picture::capsules(&self.model, &self.frames, at_ns),
                write,
            );
        }
    }

    fn status(&mut self, status: &Status, write: &mut dyn FnMut(Entry)) {
        // Its sequence counts ticks, and one in thirty is published. So gaps mean nothing.
        let at_ns = self.write_own(Topic::StatusRaw, status, &status.header, write);
        let data = explain::status_json(status, &self.names).to_string().into_bytes();
        let sequence = status.header.sequence as u32;
        write(Entry { topic: Topic::Status, sequence, log_time: at_ns, data });
        for sentence in explain::sentences(self.status.as_ref(), status, &self.names) {
            self.log(at_ns, level(sentence.gravity), sentence.text, write);
        }
        self.status = Some(*status);
    }

    fn log(&mut self, at_ns: u64, level: Level, message: String, write: &mut dyn FnMut(Entry)) {
        self.log_sequence = self.log_sequence.wrapping_add(1);
        let log = foxglove::messages::Log {
            timestamp: Some(picture::timestamp(at_ns)),
            level: level as i32,
            message,
            name: "control".to_owned(),
            ..foxglove::messages::Log::default()
        };
        write_message(Topic::Log, u64::from(self.log_sequence), at_ns, &log, write);
    }
}

pub fn bytes_of<M: Layout>(message: &M) -> Vec<u8> {
    let mut bytes = vec![0; size_of::<M>()];
    message.write_to(&mut bytes);
    bytes
}

fn level(gravity: Severity) -> Level {
    match gravity {
        Severity::Note => Level::Info,
        Severity::Warning => Level::Warning,
        Severity::Error => Level::Error,
    }
}

fn write_message<M: Encode>(topic: Topic, sequence: u64, log_time: u64, message: &M, write: &mut dyn FnMut(Entry)) {
    let mut data = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    if message.encode(&mut data).is_ok() {
        write(Entry { topic, sequence: sequence as u32, log_time, data });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sequence_gaps_count_as_missed_but_writer_restarts_do_not() {
        let mut counted = Counted::default();
        for (incarnation, sequence) in [(1, 5), (1, 6), (1, 9), (2, 1), (2, 2), (2, 2)] {
            counted.add(incarnation, sequence);
        }
        assert_eq!(counted.missed, 2);
    }

    #[test]
    fn topic_paced_at_60_hz_keeps_its_rate() {
        let mut paced = Paced(0);
        let period = 16_666_666;
        let due = (0..1500_u64).filter(|k| paced.due(k * 1_000_000_000 / 1500, period)).count();
        assert!((59..=61).contains(&due), "{due}");
    }
}
