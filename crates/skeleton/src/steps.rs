//! What is compared from frame to frame: how far joints go and how long limbs are, of the trunk and of each arm.

use crate::config::{Config, DropReason};
use crate::limbs::ARMS;
use crate::person::Person;
use messages::{LIMBS, RawSkeleton, Stamp};
use nalgebra::Vector3;

/// A step that noise alone may cause, m: 10 mm at each end of a bone and of the hips, three times. Frames may arrive bunched.
pub(crate) const NOISE_M: f64 = 0.03;
/// Frames in a row of which a part that comes back to where it was is forgiven.
const FORGIVEN_FRAMES: u32 = 2;
/// Time for which a part that was forgiven is not forgiven again, ns (assumption): a tracker that errs twice in half a second
/// errs more often than a person can be followed by.
const FORGIVEN_EVERY_NS: u64 = 500_000_000;

/// What is compared from frame to frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Body {
    pub(crate) origin: Stamp,
    /// Relative to the middle of the hips, m, with NaN-free values; shoulders, elbows, wrists of both arms.
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

    /// From the right shoulder to the left one.
    pub(crate) fn across(&self) -> Vector3<f64> {
        self.arms[0][0] - self.arms[1][0]
    }
}

/// The parts that are judged on their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// Both shoulders: who stands there.
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

/// What is remembered of one part.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Part {
    /// Coherent frames still missing before the part is used again.
    settling: u32,
    /// The newest frame in which nothing was wrong with the part, and the frames since.
    trusted: Option<Body>,
    doubted: u32,
    forgiven: Stamp,
}

impl Part {
    /// What is wrong with the part in `body`, the frame after `previous`.
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
            (self.settling, self.forgiven) = (0, body.origin);
            return None;
        }
        if wrong == Some(DropReason::Teleport) {
            self.settling = config.coherent_frames;
            return wrong;
        }
        self.settling = self.settling.saturating_sub(1);
        if self.settling > 0 { Some(DropReason::Teleport) } else { wrong }
    }

    /// Whether a part that jumped has come back to where it was before a frame or two of something else: no further away than
    /// it may go in a single frame, so that two wild places in a row are not taken for a way.
    fn comes_back(&self, config: &Config, which: Which, person: &Person, previous: Stamp, body: &Body) -> bool {
        let known = self.trusted.filter(|_| (1..=FORGIVEN_FRAMES).contains(&self.doubted));
        let again = self.forgiven != Stamp::NONE && body.origin.since(self.forgiven) < FORGIVEN_EVERY_NS;
        let was = known.map(|trusted| Body { origin: previous, ..trusted });
        was.is_some_and(|was| !again && stepped(config, which, person, &was, body).is_none())
    }

    /// Remembers whether the part was used.
    pub(crate) fn used(&mut self, body: &Body, used: bool) {
        if used {
            (self.trusted, self.doubted) = (Some(*body), 0);
        } else {
            self.doubted = self.doubted.saturating_add(1);
        }
    }
}

/// What is wrong with the way from `was` to `is`.
fn stepped(config: &Config, which: Which, person: &Person, was: &Body, is: &Body) -> Option<DropReason> {
    if jumped(config, which, person, was, is) {
        return Some(DropReason::Teleport);
    }
    match which {
        Which::Trunk => None,
        Which::Arm(side) => lengths_stepped(config, side, was, is).then_some(DropReason::LengthStep),
    }
}

/// Whether a joint went faster than its kind can, relative to the hips. The bound grows with the time between two frames, so
/// that it is the same for every rate, and it never falls below a tracker's noise.
pub(crate) fn jumped(config: &Config, which: Which, person: &Person, was: &Body, is: &Body) -> bool {
    let dt_s = is.origin.since(was.origin) as f64 * 1e-9;
    which.joints().into_iter().any(|(side, place)| {
        let step_max_m = (config.speed_max_m_per_s[place] * dt_s).max(NOISE_M);
        let (from, to) = (was.arms[side][place], is.arms[side][place]);
        // Zero stands for a joint that was not seen: it appears, it does not jump.
        person.has(ARMS[side][place]) && from != Vector3::zeros() && (to - from).norm() > step_max_m
    })
}

/// Whether a limb of an arm changed its length.
pub(crate) fn lengths_stepped(config: &Config, side: usize, was: &Body, is: &Body) -> bool {
    let limbs = 2 * side..2 * side + 2;
    was.lengths[limbs.clone()]
        .iter()
        .zip(&is.lengths[limbs])
        .any(|(was, is)| matches!((was, is), (Some(was), Some(is)) if (is - was).abs() > config.length_step_max * was))
}
