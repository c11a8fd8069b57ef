//! What counts as plausible, and the reasons for dropping what is not.

/// Bounds of a plausible person. The defaults suit motion capture; each can be tightened or, for a noisy
/// tracker, loosened by its owner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// A frame whose origin is older than this on arrival is dropped (ns): one stale-after of `skeleton`.
    pub age_max_ns: u64,
    /// A frame whose origin lies further in the future than this is dropped (ns): two clocks of one machine agree, the
    /// rest is scheduling.
    pub future_max_ns: u64,
    /// Joints below this confidence are not used.
    pub confidence_min: f32,
    /// Largest error of a quaternion's norm that is renormalised; beyond it the frame is dropped.
    pub quaternion_error_max: f64,
    /// Largest distance of a joint from the pelvis (m): arms up is 1.3 m at 2.2 m of stature. Catches mm and cm.
    pub reach_max_m: f64,
    /// Largest coordinate (m): a large hall.
    pub coordinate_max_m: f64,
    /// Hips to shoulders (m): 0.288 of a stature of 1.2 to 2.2 m (Winter, Biomechanics, 4th ed., fig. 4.1), widened by 15 %.
    pub trunk_m: [f64; 2],
    /// Upper arm and forearm over hips to shoulders: 0.186 and 0.146 of the stature over 0.288 (Winter, fig. 4.1) are 0.65
    /// and 0.51; an elbow or a wrist of the other side makes them 0.95 and more. The rigs of the CMU clips lie between.
    pub arm_per_trunk: [f64; 2],
    /// Largest change of a limb's length against the session's first second (fraction).
    pub length_change_max: f64,
    /// Largest change of a limb's length from frame to frame (fraction).
    pub length_step_max: f64,
    /// Largest speed of shoulders, elbows and wrists relative to the middle of the hips (m/s), whatever the rate. The fist of
    /// boxers reaches 9.1 with a deviation of 2.1 (Walilko et al., Br J Sports Med 39, 2005, 710); of recorded dancers 4.7,
    /// 8.9 and 9.5 are the fastest, and half as much again, an eighth and a quarter more are allowed (assumption).
    pub speed_max_m_per_s: [f64; 3],
    /// Coherent frames after a teleport before what jumped is used again.
    pub coherent_frames: u32,
    /// A payload that repeats bit for bit for this long after it had moved is a stuck tracker (ns), until it has done so
    /// for `learning_ns`; 0 turns it off. With one stale-after of `skeleton` after it, robots stop 200 ms after the tracker.
    pub frozen_after_ns: u64,
    /// Frames that were refused for what they say of the person, and none accepted, for longer than this (ns): whoever is
    /// seen next counts as another person, whom nobody has enabled. One stale-after of `skeleton`: robots have stopped.
    pub distrust_after_ns: u64,
    /// Lengths are learnt for so long (ns). Whoever has other lengths for so long counts as another person.
    pub learning_ns: u64,
    /// After a gap of this length (ns) the person may have changed: lengths are learnt and uprightness is asked for again,
    /// and the person counts as another one. A client that was silent for a second keeps its person.
    pub gap_ns: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            age_max_ns: 100_000_000,
            future_max_ns: 2_000_000,
            confidence_min: 0.5,
            quaternion_error_max: 1e-3,
            reach_max_m: 1.5,
            coordinate_max_m: 100.0,
            trunk_m: [0.29, 0.73],
            arm_per_trunk: [0.3, 0.9],
            length_change_max: 0.05,
            length_step_max: 0.02,
            speed_max_m_per_s: [7.0, 10.0, 12.0],
            coherent_frames: 5,
            frozen_after_ns: 100_000_000,
            distrust_after_ns: 100_000_000,
            learning_ns: 1_000_000_000,
            gap_ns: 1_500_000_000,
        }
    }
}

macro_rules! reasons {
    ($($(#[$meta:meta])* $name:ident,)*) => {
        /// Why a frame was dropped.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(usize)]
        pub enum DropReason { $($(#[$meta])* $name,)* }

        impl DropReason {
            /// Every reason, by its number.
            pub const ALL: [Self; DROP_REASONS] = [$(Self::$name),*];

            /// Name in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name),)* }
            }
        }

        /// Number of reasons.
        pub const DROP_REASONS: usize = [$(stringify!($name)),*].len();
    };
}

reasons! {
    /// The layout is unknown.
    Layout,
    /// The count of joints is not that of the layout, or an unknown flag is set.
    Count,
    /// Left and right are swapped by a mirrored image.
    Mirrored,
    /// The frame has no origin.
    NoOrigin,
    /// The origin lies in the future.
    Future,
    /// The origin is too old.
    Old,
    /// The session nonce changed: everything is learnt anew, from the next frame on.
    SessionChanged,
    /// The operator changed: everything is learnt anew, from the next frame on.
    OperatorChanged,
    /// The origin or the sequence was seen before.
    Duplicate,
    /// The origin or the sequence went backwards.
    Backwards,
    /// A number of a used joint or of the calibration is not finite.
    NotFinite,
    /// A coordinate, a confidence or a distance from the pelvis is out of range.
    OutOfRange,
    /// A quaternion or a calibrated hinge is not a unit vector.
    NotUnit,
    /// Shoulders or hips are not seen.
    TrunkLost,
    /// The trunk's size, or that of an arm against it, is no person's.
    Size,
    /// The trunk does not stand upright at the start of a session: probably another up-axis.
    NotUpright,
    /// Shoulders and hips disagree on left and right, or the body is a mirror image.
    Chirality,
    /// A joint jumped, or frames after a jump are not coherent for long enough.
    Teleport,
    /// A limb's length jumped from one frame to the next.
    LengthStep,
    /// A limb's length left that of the session's first second.
    LengthChange,
    /// The payload repeats bit for bit.
    Frozen,
}

impl DropReason {
    /// Whether frames that are dropped for this reason say something wrong of the person. Those that come late or twice, or
    /// say that the person is not seen, do not: they are as good as silence.
    pub(crate) const fn contradicts(self) -> bool {
        match self {
            Self::NoOrigin | Self::Future | Self::Old | Self::Duplicate | Self::Backwards | Self::TrunkLost => false,
            Self::Layout
            | Self::Count
            | Self::Mirrored
            | Self::SessionChanged
            | Self::OperatorChanged
            | Self::NotFinite
            | Self::OutOfRange
            | Self::NotUnit
            | Self::Size
            | Self::NotUpright
            | Self::Chirality
            | Self::Teleport
            | Self::LengthStep
            | Self::LengthChange
            | Self::Frozen => true,
        }
    }
}
