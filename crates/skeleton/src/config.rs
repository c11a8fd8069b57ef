//! Bounds of a plausible person, and the reasons for dropping a frame.

/// Bounds of a plausible person. The defaults suit motion capture. An owner can tighten each bound, or loosen it
/// for a noisy tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Largest age of a frame's origin on arrival (ns). An older frame is dropped. It is one stale-after of `skeleton`.
    pub age_max_ns: u64,
    /// Largest time by which a frame's origin may lie in the future (ns), else the frame is dropped. Two clocks of
    /// one machine agree, so this covers scheduling.
    pub future_max_ns: u64,
    /// Smallest confidence of a joint. Joints below it are not used.
    pub confidence_min: f32,
    /// Largest error of a quaternion's norm that is renormalised. Beyond it the frame is dropped.
    pub quaternion_error_max: f64,
    /// Largest distance of a joint from the pelvis (m): 1.3 m with arms up at 2.2 m of stature. It catches
    /// millimetres and centimetres.
    pub reach_max_m: f64,
    /// Largest coordinate (m): that of a large room.
    pub coordinate_max_m: f64,
    /// Hips to shoulders (m): 0.288 of a stature of 1.2 to 2.2 m (Winter, Biomechanics, 4th ed., fig. 4.1), widened by 15 %.
    pub trunk_m: [f64; 2],
    /// Length of upper arm and forearm over hips to shoulders. 0.186 and 0.146 of the stature over 0.288 (Winter,
    /// fig. 4.1) are 0.65 and 0.51. A swapped elbow or wrist of the other side makes them 0.95 and more. The
    /// skeletons of the CMU clips lie between.
    pub arm_per_trunk: [f64; 2],
    /// Largest change of a limb's length compared with the session's first second (fraction).
    pub length_change_max: f64,
    /// Largest change of a limb's length from frame to frame (fraction).
    pub length_step_max: f64,
    /// Largest speed of shoulders, elbows and wrists relative to the middle of the hips (m/s), at any frame rate.
    /// Boxers' fists reach 9.1 with a deviation of 2.1 (Walilko et al., Br J Sports Med 39, 2005, 710). The fastest
    /// recorded dancers reach 4.7, 8.9 and 9.5. The bounds are half, an eighth and a quarter above these (assumption).
    pub speed_max_m_per_s: [f64; 3],
    /// Time of coherent frames after a teleport before the part that jumped is used again (ns): five frames at 60 Hz, with
    /// a little for jitter.
    pub coherent_ns: u64,
    /// Time after which a payload that had moved and now repeats bit for bit is a stuck tracker (ns). The frames
    /// are dropped until it has repeated for `learning_ns`. 0 turns the check off. One stale-after of `skeleton`
    /// follows, so robots stop 200 ms after the tracker.
    pub frozen_after_ns: u64,
    /// If every frame is implausible for longer than this (ns), the next valid person counts as another one and
    /// must be enabled again. Robots stop after one stale-after of `skeleton`, which is shorter. A jump costs a camera of
    /// 15 images a second 200 ms until it is believed. Nobody takes another one's place in that time (assumption).
    pub distrust_after_ns: u64,
    /// Time in which limb lengths are learnt (ns). A person who shows other lengths for as long counts as another
    /// person.
    pub learning_ns: u64,
    /// Gap after which the person may have changed (ns). Lengths are learnt again. The person must stand upright
    /// again, and counts as another one. A client that was silent for a second keeps its person.
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
            coherent_ns: 80_000_000,
            frozen_after_ns: 100_000_000,
            distrust_after_ns: 250_000_000,
            learning_ns: 1_000_000_000,
            gap_ns: 1_500_000_000,
        }
    }
}

messages::named! {
    /// Reason for which a frame was dropped.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[repr(usize)]
    pub enum DropReason {
        Layout => "Layout": "the layout's number is unknown (is the client as old as this program?)",
        Count => "Count": "the number of joints, or a flag, is not the layout's (is it the client's layout?)",
        Mirrored => "Mirrored": "the frame is mirrored, and its layout does not allow that (clear its flag)",
        NoOrigin => "NoOrigin": "header.origin, when the person was seen, is 0; it is CLOCK_MONOTONIC, ns",
        Future => "Future": "header.origin lies in the future; it is CLOCK_MONOTONIC of this machine, ns",
        Old => "Old": "header.origin is more than 100 ms ago; it is CLOCK_MONOTONIC of this machine, ns",
        /// The state is learnt again from the next frame on.
        SessionChanged => "SessionChanged": "the session changed; its first frame is never used",
        /// The state is learnt again from the next frame on.
        OperatorChanged => "OperatorChanged": "operator_id changed; the first frame of another person is never used",
        Duplicate => "Duplicate": "header.origin or header.sequence equals the frame before (do two clients send?)",
        Backwards => "Backwards": "header.origin or header.sequence went backwards (do two clients send?)",
        /// It is one of a used joint or of the calibration.
        NotFinite => "NotFinite": "a number is NaN or infinite (an unseen joint needs the confidence 0)",
        OutOfRange => "OutOfRange":
            "a coordinate is beyond 100 m, a joint more than 1.5 m from the pelvis, or a confidence not 0 to 1 \
             (are the units those of the layout?)",
        NotUnit => "NotUnit": "a quaternion or a hinge is not of length 1 (is the order x, y, z, w?)",
        TrunkLost => "TrunkLost": "shoulders or hips are below a confidence of 0.5 (is the whole trunk in view?)",
        Size => "Size":
            "hips to shoulders are not 0.29 to 0.73 m, or an upper arm or a forearm is not 0.3 to 0.9 of that \
             (are the units and the order of the joints those of the layout?)",
        NotUpright => "NotUpright":
            "trunk and legs lean by more than 60 degrees at the start (is the up axis the layout's?)",
        /// Shoulders and hips disagree on left and right, or the body is a mirror image.
        Chirality => "Chirality": "left and right are swapped, or the person is mirrored (is the image?)",
        /// Or too little time of coherent frames has passed since.
        Teleport => "Teleport":
            "a shoulder went faster than 7 m/s, an elbow faster than 10 m/s, or a wrist faster than 12 m/s, \
             relative to the hips; or the trunk jumped in a camera's image",
        LengthStep => "LengthStep": "a limb changed its length from one frame to the next (is it one person?)",
        LengthChange => "LengthChange": "a limb's length is not that of the session's first second (is it one person?)",
        Frozen => "Frozen": "the same numbers repeat: the tracker is stuck (start it again)",
    }
}

/// Number of reasons.
pub const DROP_REASONS: usize = DropReason::ALL.len();

impl DropReason {
    /// Returns true if frames that are dropped for this reason contradict the person. Late or repeated frames do
    /// not, and neither do frames in which the person is not visible. They count like silence.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drop_reason_texts_give_bounds_in_force() {
        let bounds = Config::default();
        let [low, high] = bounds.trunk_m;
        let [arm_low, arm_high] = bounds.arm_per_trunk;
        let [shoulder, elbow, wrist] = bounds.speed_max_m_per_s;
        for (reason, word) in [
            (DropReason::Old, format!("{} ms", bounds.age_max_ns / 1_000_000)),
            (DropReason::OutOfRange, format!("{} m", bounds.coordinate_max_m)),
            (DropReason::OutOfRange, format!("{} m", bounds.reach_max_m)),
            (DropReason::TrunkLost, format!("{}", bounds.confidence_min)),
            (DropReason::Size, format!("{low} to {high} m")),
            (DropReason::Size, format!("{arm_low} to {arm_high} of that")),
            (DropReason::Teleport, format!("a shoulder went faster than {shoulder} m/s")),
            (DropReason::Teleport, format!("an elbow faster than {elbow} m/s")),
            (DropReason::Teleport, format!("a wrist faster than {wrist} m/s")),
        ] {
            let meaning = reason.meaning();
            assert!(meaning.contains(&word), "{reason:?}: {word}: {meaning}");
        }
        let says_how = |reason: &DropReason| reason.meaning().ends_with(')') || reason.meaning().contains("; ");
        DropReason::ALL.iter().for_each(|reason| assert!(says_how(reason), "{reason:?} names no way out"));
    }
}
