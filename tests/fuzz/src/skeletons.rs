//! A client's frames: any bits, alone and among good ones, in any order and at any time.

use crate::bytes::Bytes;
use messages::{Layout, PersonChange, RawSkeleton, Stamp, skeleton_flag};
use skeleton::{Config, DropReason, Input, State, tick};
use std::sync::LazyLock;

/// Most frames of one input. They are enough for every rule that counts frames.
const FRAMES_MAX: usize = 64;
/// Frame period of a camera at 60 Hz, ns.
const PERIOD_NS: u64 = 16_666_667;
/// The clock of a client may drift by a thousandth. It is followed over at most `UNSEEN_MAX_NS` without a frame.
const DRIFT_SHARE: u64 = 1000;
/// Longest time without a frame in which drift counts, ns. See `DRIFT_SHARE`.
const UNSEEN_MAX_NS: u64 = 10_000_000_000;
/// Number of 4-byte words in a frame.
pub(crate) const WORDS: usize = size_of::<RawSkeleton>() / 4;

/// Good frames of a moving person, at 60 Hz.
static PERSON: LazyLock<Vec<RawSkeleton>> = LazyLock::new(|| {
    let motion = motion::builtin();
    let calibration = motion::calibrate(&motion, motion::CalibrationMode::First10s);
    (0..motion.frames.len()).map(|i| motion::raw_frame(&motion, i, &calibration)).collect()
});

/// Runs the input. Each frame has three bytes: its initial content, the number of overwritten words, and the
/// elapsed time. The data that they need follow.
pub(crate) fn run(input: &[u8]) {
    let mut bytes = Bytes::new(input);
    let config = Config::default();
    let mut state = State::default();
    let mut now = Stamp(1_000_000_000);
    let mut next = PERSON[0];
    let (mut at, mut sequence) = (0, 0);
    let (mut last, mut passed_ns) = (Stamp::NONE, 0);
    for count in 1..=FRAMES_MAX {
        if bytes.is_empty() {
            return;
        }
        let kind = bytes.u8();
        at += usize::from(kind >> 4);
        sequence += 1;
        match kind & 3 {
            // The previous frame as it was published: a repetition.
            1 => {}
            2 => fill(&mut next, &mut bytes),
            // The person's next moment, or a later one by the upper bits.
            _ => {
                next = PERSON[at % PERSON.len()];
                at += 1;
                next.session_nonce = 1;
                next.header.sequence = sequence;
                next.header.origin = now;
            }
        }
        for _ in 0..bytes.u8() % 8 {
            let index = usize::from(bytes.u16()) % WORDS;
            set(&mut next, index, bytes.u32());
        }
        let before = now;
        now = match bytes.u8() {
            0..=200 => Stamp(now.0.saturating_add(PERIOD_NS)),
            step @ 201..=250 => Stamp(now.0.saturating_add(u64::from(step - 200) * 50_000_000)),
            _ => Stamp(bytes.u64()),
        };
        passed_ns += now.since(before).min(UNSEEN_MAX_NS);
        // The frame arrives at once, so its origin may be now.
        if kind & 4 != 0 {
            next.header.origin = now;
        }
        let out = tick(&config, &mut state, now, Input { raw: &next, stored: None });
        assert_eq!(out.skeleton.is_some(), out.drop.is_none(), "accepted or dropped, never both");
        let dropped: u64 = DropReason::ALL.into_iter().map(|reason| state.dropped(reason)).sum();
        assert_eq!(state.accepted() + dropped, count as u64, "every frame is counted once");
        let Some(person) = out.skeleton else { continue };
        check(&config, now, passed_ns / DRIFT_SHARE, &next, &person);
        assert!(person.header.origin > last, "an old frame was accepted");
        last = person.header.origin;
    }
}

/// Invariants of every published person.
fn check(config: &Config, now: Stamp, drift_max_ns: u64, raw: &RawSkeleton, person: &messages::Skeleton) {
    assert_eq!(person.received, now);
    // The client's stamp, except for the possible drift of its clock since the first frame.
    let shifted_ns = person.header.origin.0.abs_diff(raw.header.origin.0);
    assert!(shifted_ns <= drift_max_ns, "shifted by {shifted_ns} ns, {drift_max_ns} ns can be drift");
    assert!(now.since(person.header.origin) <= config.age_max_ns, "too old");
    assert!(person.header.origin.since(now) <= config.future_max_ns, "from the future");
    let far = |x: &f32| f64::from(x.abs()) <= config.coordinate_max_m;
    assert!(person.positions.iter().flatten().all(far), "{:?}", person.positions);
    let turns = person.limbs.iter().chain(&person.hands).chain([&person.head]);
    for (part, turn) in turns.enumerate() {
        let norm = turn.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() <= 1e-6, "part {part} has norm {norm}");
    }
    let both = |[left, right]: [u32; 2]| left | right;
    let parts = both(skeleton_flag::HAND) | both(skeleton_flag::CLOSURE) | skeleton_flag::HEAD;
    let known =
        skeleton_flag::ALL | skeleton_flag::CALIBRATED | PersonChange::FLAGS | parts | skeleton_flag::ONE_CAMERA;
    assert!(person.closure.iter().all(|closure| (0.0..=1.0).contains(closure)), "{:?}", person.closure);
    assert_eq!(person.flags & !known, 0);
}

/// Fills a frame with any bits. Missing bytes are zero.
fn fill(raw: &mut RawSkeleton, bytes: &mut Bytes<'_>) {
    let mut memory = [0; size_of::<RawSkeleton>()];
    let head = bytes.take(memory.len());
    memory[..head.len()].copy_from_slice(head);
    *raw = RawSkeleton::get(&memory);
}

/// Overwrites word `index` of the frame's memory.
pub(crate) fn set(raw: &mut RawSkeleton, index: usize, word: u32) {
    let mut memory = [0; size_of::<RawSkeleton>()];
    raw.write_to(&mut memory);
    memory[4 * index..][..4].copy_from_slice(&word.to_le_bytes());
    *raw = RawSkeleton::get(&memory);
}
