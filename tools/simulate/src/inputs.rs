//! Judges the frames that `ingest` passes on by the frames that clients sent.

use crate::modes::{Broken, follows};
use crate::oracle::Seen;
use messages::{LIMBS, Mode, RawSkeleton, SMPL_JOINTS, Skeleton, Smpl, Stamp, TICK_HZ, raw_flag, skeleton_flag};

/// Number of frames kept: 0.1 s of a flood of 6 frames per tick. No link delays a frame for longer.
const KEPT: usize = 1024;
/// Bounds on how far a frame's stamp may lie ahead of its arrival and behind it, ns. They are the bounds that
/// `ingest` promises, plus the clock drift that `ingest` follows in the longest run of a test.
const AHEAD_NS: u64 = 2_000_000 + DRIFT_NS;
const BEHIND_NS: u64 = 100_000_000 + DRIFT_NS;
const DRIFT_NS: u64 = 40_000_000;
/// A joint below this confidence is not used.
const CONFIDENCE: f32 = 0.5;
/// Two frames at most `NEXT_NS` apart: no joint of an arm moves farther than `STEP_M` metres between them. That
/// is faster than the fastest hand (10 m/s), with a margin.
const NEXT_NS: u64 = 40_000_000;
const STEP_M: f32 = 0.5;
/// After a payload has repeated bit for bit for this long (ticks), a robot that followed it must have stopped.
/// It is 200 ms, the 100 ms after which inputs are stale, and the time that the links take.
const FROZEN: u64 = TICK_HZ / 5 + TICK_HZ / 10 + 100;

/// Start and end joint of the four limbs: upper arm and forearm of both sides.
const ENDS: [[usize; 2]; LIMBS] = [
    [Smpl::LeftShoulder as usize, Smpl::LeftElbow as usize],
    [Smpl::LeftElbow as usize, Smpl::LeftWrist as usize],
    [Smpl::RightShoulder as usize, Smpl::RightElbow as usize],
    [Smpl::RightElbow as usize, Smpl::RightWrist as usize],
];

#[derive(Clone, Copy)]
struct Sent {
    session: u64,
    origin: Stamp,
    /// Bits of the positions of elbows and wrists. They identify a frame.
    pose: [[u32; 3]; LIMBS],
    /// The reason why no process may use the frame.
    unusable: Option<&'static str>,
    /// One bit per limb. A set bit says that one end of the limb is only guessed.
    guessed: u32,
}

impl Sent {
    fn new(raw: &RawSkeleton) -> Self {
        let vouched =
            |joint: usize| raw.confidence[joint] >= CONFIDENCE && raw.positions[joint].iter().all(|x| x.is_finite());
        let unusable = (raw.flags & raw_flag::MIRRORED != 0).then_some("a mirrored frame");
        let mut guessed = 0;
        for (limb, ends) in ENDS.iter().enumerate() {
            guessed |= u32::from(ends.iter().any(|&joint| !vouched(joint))) << limb;
        }
        let pose = pose(&raw.positions);
        Self { session: raw.session_nonce, origin: raw.header.origin, pose, unusable, guessed }
    }
}

fn pose(positions: &[[f32; 3]]) -> [[u32; 3]; LIMBS] {
    ENDS.map(|[_, joint]| positions[joint].map(f32::to_bits))
}

#[derive(Clone, Default)]
pub struct Inputs {
    sent: Vec<Sent>,
    next: usize,
    last: Option<Skeleton>,
    /// Position at which each joint of the person was last seen.
    shown: [[f32; 3]; SMPL_JOINTS],
    /// Ticks in which control ran. A suspended control follows nobody.
    awake: u64,
    /// The awake tick since which the payload repeats, and the one since which the robot has followed without a break.
    same_since: u64,
    following_since: Option<u64>,
}

impl Inputs {
    pub fn check(&mut self, seen: &Seen<'_>, mode: Mode) -> Result<(), Broken> {
        for raw in seen.sent {
            let sent = Sent::new(raw);
            if self.sent.len() < KEPT {
                self.sent.push(sent);
            } else {
                self.sent[self.next] = sent;
            }
            self.next = (self.next + 1) % KEPT;
        }
        // Another `ingest` knows no earlier frame. Its person needs a new enable.
        self.last = self.last.filter(|_| !seen.ingest_restarted);
        self.awake += u64::from(seen.moment.control.is_some());
        self.following_since =
            if follows(mode) && seen.is_person_leading() { self.following_since.or(Some(self.awake)) } else { None };
        for skeleton in seen.drained.iter().chain(&seen.moment.skeleton) {
            self.used(skeleton)?;
            self.moved(skeleton)?;
            self.last = Some(*skeleton);
        }
        let frozen = self.awake - self.same_since;
        let followed_before = self.following_since.is_some_and(|since| since < self.same_since);
        if self.last.is_some() && followed_before && frozen > FROZEN && !seen.forged {
            return Err(("frozen person", format!("the same payload for {frozen} ticks, but it follows")));
        }
        Ok(())
    }

    fn used(&self, skeleton: &Skeleton) -> Result<(), Broken> {
        let (received, pose) = (skeleton.received, pose(&skeleton.positions));
        let same = |sent: &&Sent| sent.session == skeleton.session_nonce && sent.pose == pose;
        let mut all = self.sent.iter().filter(same).peekable();
        if all.peek().is_none() {
            return Ok(());
        }
        let timely = |sent: &Sent| received.since(sent.origin) <= BEHIND_NS && sent.origin.since(received) <= AHEAD_NS;
        if !all.clone().any(timely) {
            return Err((
                "frame age",
                "no frame of this pose has a stamp near its arrival, but the pose is used".into(),
            ));
        }
        let (mut why, mut guessed) = (None, u32::MAX);
        for sent in all {
            match sent.unusable {
                Some(unusable) => why = why.or(Some(unusable)),
                None => guessed &= sent.guessed,
            }
        }
        if let (Some(why), u32::MAX) = (why, guessed) {
            return Err(("unusable frame", format!("{why} is used")));
        }
        let valid = (0..LIMBS).find(|&limb| skeleton.flags & skeleton_flag::LIMB[limb] & guessed != 0);
        let Some(limb) = valid else { return Ok(()) };
        Err(("guessed limb", format!("limb {limb} is used, but the tracker only estimates it")))
    }

    fn moved(&mut self, skeleton: &Skeleton) -> Result<(), Broken> {
        let Some(last) = self.last.filter(|last| last.session_nonce == skeleton.session_nonce) else {
            self.same_since = self.awake;
            return Ok(());
        };
        // An arm that `ingest` rejects does not show whether the person moves.
        let mut shown = skeleton.positions;
        for (limb, [_, end]) in ENDS.into_iter().enumerate() {
            if skeleton.flags & skeleton_flag::LIMB[limb] == 0 {
                shown[end] = self.shown[end];
            }
        }
        if std::mem::replace(&mut self.shown, shown) != shown {
            self.same_since = self.awake;
        }
        if skeleton.header.origin.since(last.header.origin) > NEXT_NS {
            return Ok(());
        }
        for joint in ENDS.into_iter().flatten() {
            let (is, was) = (skeleton.positions[joint], last.positions[joint]);
            let at = |s: &Skeleton, i: usize| s.positions[joint][i] - s.positions[Smpl::LeftHip as usize][i];
            let step = (0..3).map(|i| (at(skeleton, i) - at(&last, i)).powi(2)).sum::<f32>().sqrt();
            if is != [0.0; 3] && was != [0.0; 3] && step > STEP_M {
                let detail = format!("joint {joint} jumps by {step} m from one frame to the next, but is used");
                return Err(("person jumps", detail));
            }
        }
        Ok(())
    }
}
