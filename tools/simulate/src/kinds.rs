//! Every kind of fault that a schedule can hold, and the identities of the hazards that each one stands for.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum ProcessId {
    Ingest = 0,
    Retarget = 1,
    Control = 2,
    Driver = 3,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkFault {
    Drop,
    Delay,
    Double,
    Reorder,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

#[derive(Clone, Copy, Debug)]
pub struct Kind {
    pub name: &'static str,
    /// Identities of the hazards that the kind stands for.
    pub ids: &'static [&'static str],
    pub fault: Fault,
    /// Shortest and longest episode, ticks.
    pub ticks: (u32, u32),
}

macro_rules! kinds {
    ($($name:literal [$($id:literal)*] $fault:expr, $low:literal..$high:literal;)*) => {
        pub const KINDS: [Kind; [$($name),*].len()] = [$(Kind {
            name: $name,
            ids: &[$($id),*],
            fault: $fault,
            ticks: ($low, $high),
        },)*];
    };
}

use Content as C;
use Delivery as D;
use Fault::{
    Content as Of, Delivery as Del, Frame as Fr, Link, Operator as Op, Policy as Po, Process as Pr, Robot as Ro,
};

kinds! {
    "frame-nan" ["f001"] Fr(Frame::Nan), 60..900;
    "frame-infinite" ["f002"] Fr(Frame::Infinite), 60..900;
    "frame-denormal" ["f003"] Fr(Frame::Denormal), 60..900;
    "frame-huge" ["f003"] Fr(Frame::Huge), 60..900;
    "frame-not-unit" ["f004"] Fr(Frame::NotUnit), 60..900;
    "frame-sign-flip" ["f005"] Fr(Frame::SignFlip), 60..900;
    "limb-length" ["f006"] Fr(Frame::LimbLength), 60..900;
    "limb-creep" ["f006"] Fr(Frame::LimbCreep), 600..2000;
    "teleport" ["f007"] Fr(Frame::Teleport), 60..900;
    "walk-away" ["f008"] Fr(Frame::WalkAway), 300..2000;
    "sides-swapped" ["f009"] Fr(Frame::SidesSwapped), 60..900;
    "mirrored" ["f010"] Fr(Frame::Mirrored), 60..900;
    "other-unit" ["f010"] Fr(Frame::Unit), 60..900;
    "other-axes" ["f010"] Fr(Frame::Axes), 60..900;
    "low-confidence" ["f011"] Fr(Frame::LowConfidence), 60..900;
    "frozen-payload" ["f012" "f013"] Fr(Frame::Frozen), 100..1200;
    "joints-missing" ["f015"] Fr(Frame::JointsMissing), 60..900;
    "operator-change" ["f016"] Fr(Frame::OperatorChange), 60..900;
    "noise-burst" ["f017"] Fr(Frame::Noise), 60..900;
    "wrong-layout" ["f018"] Fr(Frame::Layout), 60..900;
    "torn-frame" ["f019"] Fr(Frame::Torn), 60..900;
    "skeleton-age" ["f020" "f022"] Del(D::Loss), 60..149;
    "skeleton-loss" ["f021"] Del(D::Loss), 160..1200;
    "flood" ["f023"] Del(D::Flood), 30..300;
    "stranger-floods" ["f023" "f068"] Del(D::StrangerFloods), 30..300;
    "starve" ["f024"] Del(D::Starve), 600..3000;
    "burst" ["f025"] Del(D::Burst), 600..2000;
    "stamp-back" ["f026"] Del(D::StampBack), 60..900;
    "stamp-future" ["f027"] Del(D::StampFuture), 60..900;
    "stamp-double" ["f028"] Del(D::StampDouble), 60..900;
    "clock-drift" ["f029"] Del(D::Drift), 3000..20000;
    "clock-step" ["f029"] Del(D::ClockStep), 300..3000;
    "sequence-wrap" ["f032"] Del(D::SequenceWrap), 300..1200;
    "old-frames" ["f014"] Del(D::Replayed), 60..900;
    "old-session" ["f014"] Del(D::OldSession), 60..900;
    "stranger" ["f068"] Del(D::Stranger), 300..3000;
    "holder-pauses" ["f069"] Del(D::HolderPauses), 1600..3000;
    "reconnect" ["f070"] Del(D::Reconnect), 30..3000;
    "pause-all" ["f031"] Pr(Process::PauseAll), 8..1500;
    "target-nan" ["f033"] Of(C::TargetNan), 1..60;
    "target-infinite" ["f033"] Of(C::TargetInfinite), 1..60;
    "target-jump" ["f034"] Of(C::TargetJump), 30..1500;
    "target-late" ["f035"] Of(C::TargetLate), 30..600;
    "hang-retarget" ["f036" "f074"] Pr(Process::Stop(ProcessId::Retarget)), 2..1500;
    "target-beyond" ["f040"] Of(C::TargetBeyond), 30..3000;
    "target-fast" ["f041"] Of(C::TargetFast), 30..600;
    "target-posture" ["f045" "f047" "f048"] Of(C::TargetPosture), 1500..6000;
    "target-torso" ["f049"] Of(C::TargetTorso), 300..2000;
    "target-bits" ["f109"] Of(C::TargetBits), 1..300;
    "skeleton-lies" ["f109"] Of(C::SkeletonLies), 300..2000;
    "found-outside" ["f043"] Pr(Process::FoundOutside), 3..300;
    "found-close" ["f044"] Pr(Process::FoundClose), 3..300;
    "control-late" ["f046" "f078"] Pr(Process::ControlLate), 60..900;
    "stop-ingest" ["f074"] Pr(Process::Stop(ProcessId::Ingest)), 2..1500;
    "stop-control" ["f058" "f074" "f078"] Pr(Process::Stop(ProcessId::Control)), 2..1500;
    "stop-driver" ["f051" "f074"] Pr(Process::Stop(ProcessId::Driver)), 2..1500;
    "kill-ingest" ["f073"] Pr(Process::Kill(ProcessId::Ingest)), 60..900;
    "kill-retarget" ["f073"] Pr(Process::Kill(ProcessId::Retarget)), 60..900;
    "kill-control" ["f058" "f073"] Pr(Process::Kill(ProcessId::Control)), 60..900;
    "kill-driver" ["f051" "f073"] Pr(Process::Kill(ProcessId::Driver)), 60..900;
    "state-silent" ["f051"] Of(C::StateSilent), 4..100;
    "feedback-frozen" ["f052"] Ro(Robot::Frozen), 15..900;
    "encoder-jump" ["f053"] Ro(Robot::EncoderJump), 1..60;
    "encoder-spike" ["f053"] Ro(Robot::EncoderSpike), 1..60;
    "feedback-nan" ["f054"] Ro(Robot::Nan), 1..60;
    "state-nan" ["f054"] Of(C::StateNan), 1..60;
    "feedback-swapped" ["f054" "f056"] Ro(Robot::Swapped), 15..300;
    "state-swapped" ["f054" "f056"] Of(C::StateSwapped), 1..200;
    "feedback-inverted" ["f056"] Ro(Robot::Inverted), 60..600;
    "not-followed" ["f055"] Ro(Robot::NotFollowed), 60..600;
    "sign-inverted" ["f056"] Ro(Robot::SignInverted), 60..600;
    "joint-swings" ["f055"] Ro(Robot::Swing), 300..1500;
    "command-rejected" ["f057"] Ro(Robot::Rejected), 1..60;
    "command-old" ["f059"] Of(C::CommandOld), 15..300;
    "robot-estop" ["f060"] Ro(Robot::Stopped), 15..900;
    "drive-fault" ["f063"] Ro(Robot::DriveFault), 1..300;
    "power-returns" ["f064"] Ro(Robot::PowerReturns), 30..900;
    "release" ["f067"] Op(OperatorFault::Release), 60..900;
    "operator-silent" ["f067"] Op(OperatorFault::Silent), 100..900;
    "operator-gone" [] Op(OperatorFault::Disconnect), 60..900;
    "estop" ["f050" "f060"] Op(OperatorFault::Stop), 300..900;
    "estop-engaging" ["f061"] Op(OperatorFault::StopEngaging), 600..6000;
    "estop-chatter" ["f062"] Op(OperatorFault::StopChatter), 30..300;
    "engage-elsewhere" ["f065"] Op(OperatorFault::Elsewhere), 300..2000;
    "enable-stuck" ["f066"] Op(OperatorFault::Stuck), 300..1500;
    "conflicting-edges" ["f071"] Op(OperatorFault::Conflict), 2..60;
    "reset-held" ["f072"] Op(OperatorFault::ResetHeld), 60..900;
    "drop-raw" [] Link(0, LinkFault::Drop), 300..3000;
    "drop-skeleton" [] Link(1, LinkFault::Drop), 300..3000;
    "drop-target" [] Link(2, LinkFault::Drop), 60..3000;
    "drop-command" [] Link(3, LinkFault::Drop), 60..3000;
    "drop-state" [] Link(4, LinkFault::Drop), 60..3000;
    "delay-raw" [] Link(0, LinkFault::Delay), 300..3000;
    "delay-skeleton" [] Link(1, LinkFault::Delay), 300..3000;
    "delay-target" [] Link(2, LinkFault::Delay), 60..3000;
    "delay-command" ["f059"] Link(3, LinkFault::Delay), 60..3000;
    "delay-state" ["f051"] Link(4, LinkFault::Delay), 60..3000;
    "double-raw" ["f028"] Link(0, LinkFault::Double), 300..3000;
    "double-skeleton" [] Link(1, LinkFault::Double), 300..3000;
    "double-target" [] Link(2, LinkFault::Double), 60..3000;
    "double-command" ["f059"] Link(3, LinkFault::Double), 60..3000;
    "double-state" [] Link(4, LinkFault::Double), 60..3000;
    "reorder-raw" ["f026"] Link(0, LinkFault::Reorder), 300..3000;
    "reorder-skeleton" [] Link(1, LinkFault::Reorder), 300..3000;
    "reorder-target" [] Link(2, LinkFault::Reorder), 60..3000;
    "reorder-command" ["f059"] Link(3, LinkFault::Reorder), 60..3000;
    "reorder-state" [] Link(4, LinkFault::Reorder), 60..3000;
    "freeze-skeleton" [] Of(C::SkeletonFrozen), 60..900;
    "freeze-target" [] Of(C::TargetFrozen), 2..300;
    "freeze-command" ["f059"] Of(C::CommandFrozen), 2..300;
    "freeze-state" ["f052"] Of(C::StateFrozen), 2..300;
    "corrupt-raw" [] Fr(Frame::BitFlips), 60..900;
    "corrupt-skeleton" [] Of(C::SkeletonBits), 60..900;
    "corrupt-target" [] Of(C::TargetFlips), 2..300;
    "policy-nan" ["f137"] Po(Policy::Nan), 300..3000;
    "policy-shape" ["f137"] Po(Policy::Shape), 300..3000;
    "policy-other-robot" ["f139"] Po(Policy::OtherRobot), 300..3000;
    "policy-late" ["f140"] Po(Policy::Late), 300..3000;
    "policy-frozen" ["f140"] Po(Policy::Frozen), 300..3000;
    "policy-jump" ["f141"] Po(Policy::Jump), 150..1500;
    "policy-walk" ["f141"] Po(Policy::Walk), 300..6000;
    "policy-contradict" ["f141"] Po(Policy::Contradict), 300..3000;
    "policy-posture" ["f141"] Po(Policy::Posture), 1500..6000;
    "policy-silent" ["f138"] Po(Policy::Silent), 150..3000;
    "policy-ends" ["f138"] Po(Policy::Ends), 30..3000;
    "policy-stranger" ["f142"] Po(Policy::Stranger), 300..3000;
    "takeover" ["f143" "f144"] Po(Policy::Takeover), 300..6000;
}

pub const KIND_COUNT: usize = KINDS.len();

/// Indices of all kinds. Without a policy those of a policy are left out.
pub fn all(is_policy: bool) -> Vec<usize> {
    (0..KIND_COUNT).filter(|&kind| is_policy || !self::is_policy(kind)).collect()
}

pub fn is_policy(kind: usize) -> bool {
    matches!(KINDS[kind].fault, Fault::Policy(_))
}

pub fn named(text: &str) -> Vec<usize> {
    (0..KIND_COUNT).filter(|&kind| KINDS[kind].name == text || KINDS[kind].ids.contains(&text)).collect()
}

pub fn by_name(name: &str) -> Option<usize> {
    KINDS.iter().position(|kind| kind.name == name)
}
