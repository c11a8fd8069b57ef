//! Checks from frame to frame, for the trunk and each arm: the motion of joints and the lengths of limbs.

use crate::config::{Config, DropReason};
use crate::limbs::ARMS;
use crate::person::Person;
use messages::{LIMBS, RawSkeleton, Stamp};
use nalgebra::Vector3;

/// Step that noise alone may cause, m: three times the 10 mm at each end of a bone and of the hips. Frames may
/// arrive bunched.
pub(crate) const NOISE_M: f64 = 0.03;
/// Largest number of wrong frames in a row after which a part that returns to its place is used at once.
const FORGIVEN_FRAMES: u32 = 2;
/// Time after such a return in which there is no second one, ns. Assumption: a tracker that errs twice in half a
/// second errs too often to follow a person.
const FORGIVEN_EVERY_NS: u64 = 500_000_000;

/// Data of one frame for the comparison with the next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    pub(crate) origin: Stamp,
    /// Positions relative to the middle of the hips, m, without NaN: shoulders, elbows, wrists of both arms.
    pub(crate) arms: [[Vector3<f64>; 3]; 2],
    pub(crate) lengths: [Option<f64>; LIMBS],
}

impl Body {
    pub(crate) fn read(raw: &RawSkeleton, person: &Person) -> Self {
        let hips = person.hips();
        let arms = ARMS.map(|joints| {
            joints.map(|joint| if person.has(joint) { person.at(joint) - hips } else { Vector3::zeros() })
        });
        let mut lengths = [None; LIMBS];
        for (side, [shoulder, elbow, wrist]) in ARMS.into_iter().enumerate() {
            for (limb, [from, to]) in [[shoulder, elbow], [elbow, wrist]].into_iter().enumerate() {
                if person.has(from) && person.has(to) {
                    lengths[2 * side + limb] = Some((person.at(to) - person.at(from)).norm());
                }
            }
        }
        Self { origin: raw.header.origin, arms, lengths }
    }

    /// Vector from the right shoulder to the left one.
    pub(crate) fn across(&self) -> Vector3<f64> {
        self.arms[0][0] - self.arms[1][0]
    }
}

/// A part that is judged on its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// Both shoulders. They tell whether the person is the same.
    Trunk,
    /// Elbow and wrist of the left (0) or right (1) arm, and the lengths of its limbs.
    Arm(usize),
}

impl Which {
    /// Side and place along the arm of each joint.
    fn joints(self) -> [(usize, usize); 2] {
        match self {
            Self::Trunk => [(0, 0), (1, 0)],
            Self::Arm(side) => [(side, 1), (side, 2)],
        }
    }
}

/// State of one part.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Part {
    /// Time from which the part may be used again after a jump, if its frames are coherent.
    settled: Stamp,
    /// The newest frame in which the part was right, and the number of frames since.
    trusted: Option<Body>,
    doubted: u32,
    forgiven: Stamp,
}

impl Part {
    /// Returns the error of the part in `body`, the frame after `previous`.
    pub(crate) fn judge(
        &mut self,
        config: &Config,
        which: Which,
        person: &Person,
        previous: &Body,
        body: &Body,
    ) -> Option<DropReason> {
        let wrong = stepped(config, which, person, previous, body);
        if wrong.is_some() && self.comes_back(config, which, person, previous.origin, body) {
            (self.settled, self.forgiven) = (Stamp::NONE, body.origin);
            return None;
        }
        if wrong == Some(DropReason::Teleport) {
            self.settled = body.origin.plus_ns(config.coherent_ns);
            return wrong;
        }
        if body.origin < self.settled { Some(DropReason::Teleport) } else { wrong }
    }

    /// Returns true if a part that jumped has returned to its earlier place after a frame or two. It may be no
    /// further away than in a single frame. So two outliers in a row do not count as motion.
    fn comes_back(&self, config: &Config, which: Which, person: &Person, previous: Stamp, body: &Body) -> bool {
        let known = self.trusted.filter(|_| (1..=FORGIVEN_FRAMES).contains(&self.doubted));
        let again = self.forgiven != Stamp::NONE && body.origin.since(self.forgiven) < FORGIVEN_EVERY_NS;
        let was = known.map(|trusted| Body { origin: previous, ..trusted });
        was.is_some_and(|was| !again && stepped(config, which, person, &was, body).is_none())
    }

    /// Notes whether the part was used.
    pub(crate) fn used(&mut self, body: &Body, used: bool) {
        if used {
            (self.trusted, self.doubted) = (Some(*body), 0);
        } else {
            self.doubted = self.doubted.saturating_add(1);
        }
    }
}

/// Returns the error of the step from `was` to `is`.
fn stepped(config: &Config, which: Which, person: &Person, was: &Body, is: &Body) -> Option<DropReason> {
    if jumped(config, which, person, was, is) {
        return Some(DropReason::Teleport);
    }
    match which {
        Which::Trunk => None,
        Which::Arm(side) => lengths_stepped(config, side, was, is).then_some(DropReason::LengthStep),
    }
}

/// Returns true if a joint moved faster than its kind can, relative to the hips. The bound grows with the time
/// between two frames, so it is the same for every rate. It never falls below a tracker's noise.
pub(crate) fn jumped(config: &Config, which: Which, person: &Person, was: &Body, is: &Body) -> bool {
    let dt_s = is.origin.since(was.origin) as f64 * 1e-9;
    which.joints().into_iter().any(|(side, place)| {
        let step_max_m = (config.speed_max_m_per_s[place] * dt_s).max(NOISE_M);
        let (from, to) = (was.arms[side][place], is.arms[side][place]);
        // Zero stands for a joint that was not visible. Its first appearance is no jump.
        person.has(ARMS[side][place]) && from != Vector3::zeros() && (to - from).norm() > step_max_m
    })
}

/// Returns true if a limb of an arm changed its length.
pub(crate) fn lengths_stepped(config: &Config, side: usize, was: &Body, is: &Body) -> bool {
    let limbs = 2 * side..2 * side + 2;
    was.lengths[limbs.clone()]
        .iter()
        .zip(&is.lengths[limbs])
        .any(|(was, is)| matches!((was, is), (Some(was), Some(is)) if (is - was).abs() > config.length_step_max * was))
}
