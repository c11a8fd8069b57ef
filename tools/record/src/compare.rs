//! Runs the pure stages again over the inputs of a recording, and compares their outputs with the recorded ones, bit
//! for bit. `retarget` maps skeletons to targets. `control` maps targets, states and the operator to commands.

use crate::encoder::bytes_of;
use crate::error::RecordError;
use crate::file::MESSAGES;
use crate::inputs::Inputs;
use crate::read::{Content, Recorded};
use crate::topic::Topic;
use config::Loaded;
use control::STATUS_EVERY;
use messages::{Header, JOINTS_MAX, JointCommand, JointTarget, Layout, RobotState, Skeleton, Status};
use motion::mcap::Ending;
use std::path::Path;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub compared: u64,
    /// Messages that the stages made and the recording lacks.
    pub missing: u64,
    /// Messages that differ from those of the stages.
    pub different: u64,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Compared {
    /// Counts of the targets. A missing target ends the comparison, because the stages then lack an input.
    pub targets: Counts,
    pub commands: Counts,
    pub statuses: Counts,
    pub first: Option<String>,
    /// Reasons why the recording is incomplete: the first missing message, where it breaks off, and what its
    /// writer lost.
    pub flaws: Vec<String>,
}

impl Compared {
    /// Returns true if the recording is complete, has everything that the stages made, and nothing differs.
    pub fn equal(&self) -> bool {
        let all = [self.targets, self.commands, self.statuses];
        all.iter().all(|counts| counts.different == 0 && counts.missing == 0)
            && self.targets.compared > 0
            && self.commands.compared > 0
            && self.flaws.is_empty()
    }
}

pub fn compare(path: &Path, loaded: &Loaded) -> Result<Compared, RecordError> {
    let mut recorded = Recorded::open(path)?;
    let lacks = |cause: String| RecordError::Lacks { file: path.display().to_string(), cause };
    if recorded.about().get("origin").is_some_and(|origin| origin != "offline") {
        return Err(lacks(
            "is a live recording: the times at which the stages woke and the operator's edges are not on the bus, so \
             that its commands cannot be computed again; `replay FILE --offline OUT.csv --record OUT.mcap` makes one \
             that can be compared"
                .to_owned(),
        ));
    }
    let hash = format!("{:016x}", loaded.hash);
    match recorded.about().get("config_hash") {
        Some(found) if *found == hash => {}
        found => {
            let found = found.map_or("none", String::as_str);
            return Err(lacks(format!(
                "was recorded with the settings {found}, and --config with --robot gives {hash}; the file holds the ones it was \
                 recorded with as attachments"
            )));
        }
    }
    let config = |error: config::ConfigError| lacks(error.to_string());
    let retarget = world::retarget_config(loaded).map_err(config)?;
    let control = world::control_config(loaded, true).map_err(config)?;
    let mut stages = Stages {
        retarget,
        control,
        retarget_state: retarget::State::default(),
        control_state: None,
        newest: 0,
        skeleton: None,
        target: None,
        policy: None,
        state: None,
        command: None,
        status: None,
        last: None,
        found: Compared::default(),
    };
    let mut read = 0;
    while let Some((_, content)) = recorded.next_message()? {
        read += u64::from(!matches!(content, Content::Other { .. }));
        stages.compare(content);
        if !stages.found.flaws.is_empty() {
            let mut found = stages.found;
            found.flaws.extend(flaws(&recorded));
            return Ok(found);
        }
    }
    stages.missing();
    let mut found = stages.found;
    for (what, counts) in [("target", found.targets), ("command", found.commands)] {
        if counts.compared == 0 {
            found.flaws.push(format!("it holds no {what} to compare"));
        }
    }
    let written = recorded.outcome().get(MESSAGES).and_then(|count| count.parse::<u64>().ok());
    if let Some(written) = written.filter(|written| *written > read) {
        found.flaws.push(format!("{} of the {written} messages that were recorded are not in it", written - read));
    }
    found.flaws.extend(flaws(&recorded));
    Ok(found)
}

/// Says what the file and its writer lost.
fn flaws(recorded: &Recorded) -> Vec<String> {
    let mut flaws = Vec::new();
    match recorded.ending() {
        Ending::BrokenOff(why) => {
            flaws.push(format!("the file is damaged or truncated ({why}): only what is whole was compared"));
        }
        Ending::GoesOn => flaws.push("data after the end of the recording were not compared".to_owned()),
        Ending::Complete => {}
    }
    match recorded.outcome().get("samples_lost").map(String::as_str) {
        None | Some("0") => {}
        Some(lost) => flaws.push(format!("its writer lost {lost} messages")),
    }
    flaws
}

struct Stages {
    retarget: retarget::Config,
    control: control::Config,
    retarget_state: retarget::State,
    control_state: Option<control::State>,
    /// Sequence of the newest skeleton.
    newest: u64,
    /// Newest message of each kind that its stage has not taken yet.
    skeleton: Option<Skeleton>,
    target: Option<JointTarget>,
    policy: Option<JointTarget>,
    state: Option<RobotState>,
    /// Outputs of the last tick that belong in the recording and were not found yet.
    command: Option<JointCommand>,
    status: Option<Status>,
    last: Option<u64>,
    found: Compared,
}

impl Stages {
    fn compare(&mut self, content: Content) {
        match content {
            Content::Skeleton(skeleton) => {
                self.newest = skeleton.header.sequence;
                self.skeleton = Some(*skeleton);
            }
            Content::Target(target) => self.retarget(*target),
            Content::State(state) => self.state = Some(*state),
            Content::Inputs(inputs) => self.control(&inputs),
            // Without the inputs of its tick, a stage made nothing to compare with.
            Content::Command(command) if self.last != Some(command.k) => self.lacks_inputs(command.k),
            Content::Status(status) if self.last != Some(status.k) => self.lacks_inputs(status.k),
            Content::Command(command) => {
                let made = self.command.take();
                self.found.commands.compared += 1;
                if made.is_none_or(|made| !same(&made, &*command)) {
                    self.found.commands.different += 1;
                    let joint = made.and_then(|made| first_joint(&made.q, &command.q));
                    self.differs(&format!("command {}{}", command.k, joint.unwrap_or_default()));
                }
            }
            Content::Status(status) => {
                let made = self.status.take();
                self.found.statuses.compared += 1;
                if made.is_none_or(|made| !same(&made, &*status)) {
                    self.found.statuses.different += 1;
                    self.differs(&format!("status of tick {}", status.k));
                }
            }
            Content::Policy(target) => self.policy = Some(*target),
            Content::Other { .. } => {}
        }
    }

    fn lacks_inputs(&mut self, k: u64) {
        let topic = Topic::Inputs.name();
        self.found.flaws.push(format!("{topic} lacks the inputs of tick {k}, so its outputs cannot be computed"));
    }

    fn retarget(&mut self, recorded: JointTarget) {
        if self.found.targets.compared == 0 && recorded.header.sequence > 1 {
            let k = recorded.k;
            self.found.flaws.push(format!("it begins at tick {k}, and what came before is missing: a run has state"));
            return;
        }
        if recorded.input_sequence > self.newest {
            let (k, skeleton, topic) = (recorded.k, recorded.input_sequence, Topic::Skeleton.name());
            self.found.flaws.push(format!("target {k} used skeleton {skeleton}, which {topic} lacks"));
            return;
        }
        let skeleton = self.skeleton.take();
        let input = retarget::Input { k: recorded.k, skeleton: skeleton.as_ref() };
        let now = recorded.header.stamp;
        let mut made = retarget::tick(&self.retarget, &mut self.retarget_state, now, input).target;
        // The shell fills in the rest of the header, not the stage.
        made.header = Header { origin: made.header.origin, ..recorded.header };
        self.found.targets.compared += 1;
        if !same(&made, &recorded) {
            self.found.targets.different += 1;
            let joint = first_joint(&made.q, &recorded.q).unwrap_or_default();
            self.differs(&format!("target {}{joint}", recorded.k));
        }
        self.target = Some(recorded);
    }

    /// Counts outputs of the last tick that the recording lacks.
    fn missing(&mut self) {
        if let Some(command) = self.command.take() {
            self.found.commands.missing += 1;
            self.differs(&format!("command {}, which is missing", command.k));
        }
        if let Some(status) = self.status.take() {
            self.found.statuses.missing += 1;
            self.differs(&format!("status of tick {}, which is missing", status.k));
        }
    }

    fn control(&mut self, inputs: &Inputs) {
        self.missing();
        if let Some(last) = self.last.replace(inputs.k).filter(|last| last.wrapping_add(1) != inputs.k) {
            self.found.flaws.push(format!("tick {} follows tick {last}: the inputs between are missing", inputs.k));
            return;
        }
        let (target, policy, state) = (self.target.take(), self.policy.take(), self.state.take());
        let headers = [target.map(|t| t.header), policy.map(|p| p.header), state.map(|s| s.header)];
        let given = headers.map(|header| header.map_or(0, |header| header.sequence));
        let used = [inputs.target, inputs.policy, inputs.state];
        if given != used {
            self.found.flaws.push(format!(
                "tick {} used the target, the policy's target and the state {used:?}, but the recording has {given:?} before it",
                inputs.k
            ));
            return;
        }
        let config = &self.control;
        let control = self.control_state.get_or_insert_with(|| control::State::new(config, inputs.incarnation));
        let &Inputs { k, operator, realtime_ok, .. } = inputs;
        let (target, policy, robot) = (target.as_ref(), policy.as_ref(), state.as_ref());
        let input = control::Input { k, target, policy, robot, operator, ingest: None, realtime_ok };
        let made = control::tick(config, control, inputs.now, input);
        self.command = made.command;
        // A recording has every `STATUS_EVERY`th status, and every transition.
        let is_recorded = made.status.k.is_multiple_of(STATUS_EVERY) || made.transition.is_some();
        self.status = is_recorded.then_some(made.status);
    }

    fn differs(&mut self, what: &str) {
        self.found.first.get_or_insert_with(|| what.to_owned());
    }
}

/// Returns true if all bytes are equal. So -0 differs from 0, and a NaN equals itself only if its bits do.
fn same<M: Layout>(a: &M, b: &M) -> bool {
    bytes_of(a) == bytes_of(b)
}

fn first_joint(made: &[f64; JOINTS_MAX], recorded: &[f64; JOINTS_MAX]) -> Option<String> {
    let joint = (0..JOINTS_MAX).find(|&j| made[j].to_bits() != recorded[j].to_bits())?;
    Some(format!(": joint {joint} is {}, recorded as {}", made[joint], recorded[joint]))
}
