//! Every kind of fault that a schedule can hold, and the identities of the hazards that each one stands for.

use serde::Deserialize;
use std::sync::LazyLock;

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Frame {
    /// NaN in a position, rotation or confidence.
    Nan,
    /// An infinity in a position, rotation or confidence.
    Infinite,
    /// A denormal number or a negative zero in one of these fields.
    Denormal,
    /// The largest finite number in one of these fields.
    Huge,
    NotUnit,
    /// A rotation with its sign flipped: the same rotation.
    SignFlip,
    /// An arm that is suddenly longer or shorter.
    LimbLength,
    /// An arm that grows slowly.
    LimbCreep,
    /// An arm that is suddenly elsewhere.
    Teleport,
    WalkAway,
    SidesSwapped,
    /// A mirror image, flagged as such or not.
    Mirrored,
    Unit,
    Axes,
    LowConfidence,
    /// The same payload with fresh stamps.
    Frozen,
    JointsMissing,
    OperatorChange,
    /// Ten times the noise of a tracker.
    Noise,
    /// A layout, count or flag that does not exist.
    Layout,
    /// One half of this frame, one half of the last.
    Torn,
    BitFlips,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Delivery {
    Loss,
    /// 10 kHz by the lease holder.
    Flood,
    /// 10 kHz by another client.
    StrangerFloods,
    /// Only 5 Hz.
    Starve,
    /// All frames of 200 ms at once.
    Burst,
    StampBack,
    /// A stamp in the future.
    StampFuture,
    /// The stamp or sequence of the frame before.
    StampDouble,
    /// A clock that runs 500 ppm fast or slow.
    Drift,
    ClockStep,
    SequenceWrap,
    /// Frames of the past, as they were.
    Replayed,
    OldSession,
    Stranger,
    /// The holder pauses for longer than the lease timeout, and another client comes.
    HolderPauses,
    Reconnect,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Content {
    TargetNan,
    TargetInfinite,
    TargetJump,
    TargetLate,
    TargetBeyond,
    /// Targets that require more speed than the robot has.
    TargetFast,
    /// Random postures, colliding ones among them.
    TargetPosture,
    TargetTorso,
    TargetBits,
    /// Well-formed but false skeletons from `ingest`.
    SkeletonLies,
    StateSilent,
    StateNan,
    StateSwapped,
    CommandOld,
    SkeletonBits,
    TargetFlips,
    SkeletonFrozen,
    TargetFrozen,
    CommandFrozen,
    StateFrozen,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
#[repr(usize)]
pub enum ProcessId {
    Ingest = 0,
    Retarget = 1,
    Control = 2,
    Driver = 3,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Process {
    Kill(ProcessId),
    Stop(ProcessId),
    PauseAll,
    /// `control` misses 1 to 3 deadlines now and then.
    ControlLate,
    /// The driver dies, and finds the robot outside its limits.
    FoundOutside,
    /// The driver dies, and finds the robot too close to itself.
    FoundClose,
}

/// Faults of a link. [`world::Links`] defines the order of the links.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum LinkFault {
    Drop,
    Delay,
    Double,
    Reorder,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Robot {
    EncoderJump,
    /// An encoder is wrong for one sample.
    EncoderSpike,
    Frozen,
    Nan,
    /// The measurement of a joint has the wrong sign.
    Inverted,
    Swapped,
    NotFollowed,
    /// A joint moves in the wrong direction.
    SignInverted,
    Swing,
    Rejected,
    DriveFault,
    /// The robot's own emergency stop is pressed and released.
    Stopped,
    /// No motor has power, then all motors have it again.
    PowerReturns,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum OperatorFault {
    Release,
    /// The device falls silent with the enable held.
    Silent,
    Disconnect,
    Stop,
    StopEngaging,
    StopChatter,
    /// The operator releases, waits while the person moves on, and engages at another posture.
    Elsewhere,
    /// The enable is already held when `control` starts.
    Stuck,
    Conflict,
    ResetHeld,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Policy {
    Nan,
    /// Rows, period or joints that no chunk has.
    Shape,
    OtherRobot,
    /// Start or observation in the past or the future.
    Late,
    Frozen,
    Jump,
    Walk,
    /// Successive chunks that overlap and lead to two postures.
    Contradict,
    Posture,
    Silent,
    Ends,
    Stranger,
    Takeover,
}

#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Fault {
    Policy(Policy),
    Frame(Frame),
    Delivery(Delivery),
    Content(Content),
    Process(Process),
    /// A fault of the link with this index.
    Link(usize, LinkFault),
    Robot(Robot),
    Operator(OperatorFault),
}

/// A row of `kinds.toml`.
#[derive(Clone, Debug, Deserialize)]
pub struct Kind {
    pub name: String,
    /// Identities of the hazards that the kind stands for.
    pub ids: Vec<String>,
    pub fault: Fault,
    /// Shortest and longest episode, ticks.
    pub ticks: (u32, u32),
    /// Number of times that a rare kind is drawn more than others.
    #[serde(default)]
    pub more: usize,
}

pub const KIND_COUNT: usize = 127;

/// The rows of `kinds.toml`, in the order of the file.
pub static KINDS: LazyLock<[Kind; KIND_COUNT]> = LazyLock::new(|| {
    #[derive(Deserialize)]
    struct Rows {
        kinds: Vec<Kind>,
    }
    let rows: Rows = toml::from_str(include_str!("kinds.toml")).unwrap_or_else(|error| panic!("{error}"));
    rows.kinds.try_into().expect("KIND_COUNT rows")
});

/// Indices of all kinds. Without a policy those of a policy are left out.
pub fn all(is_policy: bool) -> Vec<usize> {
    (0..KIND_COUNT).filter(|&kind| is_policy || !self::is_policy(kind)).collect()
}

pub fn is_policy(kind: usize) -> bool {
    matches!(KINDS[kind].fault, Fault::Policy(_))
}

pub fn named(text: &str) -> Vec<usize> {
    (0..KIND_COUNT).filter(|&kind| KINDS[kind].name == text || KINDS[kind].ids.iter().any(|id| id == text)).collect()
}

pub fn by_name(name: &str) -> Option<usize> {
    KINDS.iter().position(|kind| kind.name == name)
}
