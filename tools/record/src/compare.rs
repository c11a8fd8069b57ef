//! Runs the pure stages again over the inputs of a recording, and compares what they make of them with what was recorded, bit
//! for bit: `retarget` from skeletons to targets, `control` from targets, states and the operator to commands.

use crate::error::RecordError;
use crate::read::{Content, Recorded};
use messages::{Header, JOINTS, JointTarget, Layout, RobotState, Skeleton};
use pipeline::{ControlConfig, ControlInput, ControlOutput, ControlState, Loaded};
use std::path::Path;

/// What a comparison found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Compared {
    /// Targets compared, and how many of them differ.
    pub targets: (u64, u64),
    /// Commands compared, and how many of them differ.
    pub commands: (u64, u64),
    /// Statuses compared, and how many of them differ.
    pub statuses: (u64, u64),
    /// The first difference, in words.
    pub first: Option<String>,
    /// Why the comparison ended before the recording: a message that a stage had taken is not in the file.
    pub broken_off: Option<String>,
}

impl Compared {
    /// Whether something was compared and nothing differs.
    pub fn equal(&self) -> bool {
        let differ = self.targets.1 + self.commands.1 + self.statuses.1;
        differ == 0 && self.targets.0 > 0 && self.commands.0 > 0 && self.broken_off.is_none()
    }
}

/// Compares the recording at `path`.
///
/// # Errors
/// The file cannot be read, was recorded with other settings, or lacks what the stages were given.
pub fn compare(path: &Path, loaded: &Loaded) -> Result<Compared, RecordError> {
    let mut recorded = Recorded::open(path)?;
    let lacks = |cause: String| RecordError::Lacks { file: path.display().to_string(), cause };
    if recorded.about().get("origin").is_some_and(|origin| origin != "offline") {
        return Err(lacks(
            "is a live recording: the times at which the stages woke and the operator's edges are not on the bus, so that its \
             commands cannot be computed again; `replay FILE --offline OUT.csv --record OUT.mcap` makes one that can be \
             compared"
                .to_owned(),
        ));
    }
    let hash = format!("{:016x}", loaded.hash);
    match recorded.about().get("config_hash") {
        Some(found) if *found == hash => {}
        found => {
            let found = found.map_or("none", String::as_str);
            return Err(lacks(format!(
                "was recorded with the settings {found}, and --config gives {hash}; the file holds the ones it was recorded with \
                 as attachments"
            )));
        }
    }
    let config = |error: pipeline::ConfigError| lacks(error.to_string());
    let retarget = pipeline::retarget_config(loaded).map_err(config)?;
    let control = ControlConfig::new(loaded, true).map_err(config)?;
    let mut stages = Stages {
        retarget,
        control,
        retarget_state: retarget::State::default(),
        control_state: None,
        skeleton: None,
        target: None,
        state: None,
        output: None,
        found: Compared::default(),
    };
    while let Some((_, content)) = recorded.next_message()? {
        stages.take(content);
        if stages.found.broken_off.is_some() {
            break;
        }
    }
    Ok(stages.found)
}

struct Stages {
    retarget: retarget::Config,
    control: ControlConfig,
    retarget_state: retarget::State,
    control_state: Option<ControlState>,
    /// Newest of each that its stage has not taken yet.
    skeleton: Option<Skeleton>,
    target: Option<JointTarget>,
    state: Option<RobotState>,
    output: Option<ControlOutput>,
    found: Compared,
}

impl Stages {
    fn take(&mut self, content: Content) {
        match content {
            Content::Skeleton(skeleton) => self.skeleton = Some(*skeleton),
            Content::Target(target) => self.retarget(*target),
            Content::State(state) => self.state = Some(*state),
            Content::Inputs(inputs) => self.control(&inputs),
            Content::Command(command) => {
                let made = self.output.and_then(|output| output.command);
                self.found.commands.0 += 1;
                if made.is_none_or(|made| !same(&made, &*command)) {
                    self.found.commands.1 += 1;
                    let joint = made.and_then(|made| first_joint(&made.q, &command.q));
                    self.differs(&format!("command {}{}", command.k, joint.unwrap_or_default()));
                }
            }
            Content::Status(status) => {
                let made = self.output.map(|output| output.status);
                self.found.statuses.0 += 1;
                if made.is_none_or(|made| !same(&made, &*status)) {
                    self.found.statuses.1 += 1;
                    self.differs(&format!("status of tick {}", status.k));
                }
            }
            Content::Other { .. } => {}
        }
    }

    fn retarget(&mut self, recorded: JointTarget) {
        let skeleton = self.skeleton.take();
        let input = retarget::Input { k: recorded.k, skeleton: skeleton.as_ref() };
        let now = recorded.header.stamp;
        let mut made = retarget::tick(&self.retarget, &mut self.retarget_state, now, input).target;
        // The rest of the header is the shell's, not the stage's.
        made.header = Header { origin: made.header.origin, ..recorded.header };
        self.found.targets.0 += 1;
        if !same(&made, &recorded) {
            self.found.targets.1 += 1;
            let joint = first_joint(&made.q, &recorded.q).unwrap_or_default();
            self.differs(&format!("target {}{joint}", recorded.k));
        }
        self.target = Some(recorded);
    }

    fn control(&mut self, inputs: &crate::Inputs) {
        let taken = |sequence: Option<u64>| sequence.unwrap_or_default();
        let (target, state) = (self.target.take(), self.state.take());
        let given =
            (taken(target.map(|target| target.header.sequence)), taken(state.map(|state| state.header.sequence)));
        if given != (inputs.target, inputs.state) {
            self.found.broken_off = Some(format!(
                "tick {} took target {} and state {}, and the recording has {} and {} before it",
                inputs.k, inputs.target, inputs.state, given.0, given.1
            ));
            return;
        }
        let config = &self.control;
        let control = self.control_state.get_or_insert_with(|| ControlState::new(config, inputs.incarnation));
        let input = ControlInput {
            k: inputs.k,
            target: target.as_ref(),
            robot: state.as_ref(),
            operator: inputs.operator,
            realtime_ok: inputs.realtime_ok,
        };
        self.output = Some(pipeline::control_tick(config, control, inputs.now, input));
    }

    fn differs(&mut self, what: &str) {
        self.found.first.get_or_insert_with(|| what.to_owned());
    }
}

/// Whether all bytes are equal: -0 is not 0, and no number equals itself only if its bits do.
fn same<M: Layout>(a: &M, b: &M) -> bool {
    let bytes = |message: &M| {
        let mut bytes = vec![0; size_of::<M>()];
        message.put(&mut bytes);
        bytes
    };
    bytes(a) == bytes(b)
}

fn first_joint(made: &[f64; JOINTS], recorded: &[f64; JOINTS]) -> Option<String> {
    let joint = (0..JOINTS).find(|&j| made[j].to_bits() != recorded[j].to_bits())?;
    Some(format!(": joint {joint} is {}, recorded as {}", made[joint], recorded[joint]))
}
