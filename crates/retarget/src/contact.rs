//! Hands that touch: where a person's hand is near the head, the chest or the other hand, the robot's goes to the same
//! place of its own body.
//!
//! Limb rotations alone miss such places, because no robot has a person's proportions. With the lengths L of the
//! stretched arms, shoulder to the middle of the hand, a hand at p of a person stands for
//!
//! ```text
//! p' = a' + (p - a) L' / L           a: the middle between the shoulders, or the middle of the head
//! ```
//!
//! of the robot (primes). The robot's limbs turn until its hand is at p'. The correction turns the person's limbs by as much:
//!
//! ```text
//! q0 = argmin S_GR(q),   q' = argmin S_GR(q) + w |p(q) - p(q0) - s (p' - p(q0))|^2,   R' = R(q') R(q0)^-1 R
//! ```
//!
//! The share s is zero, and the limbs are the person's own, while the hand is farther than [`FAR_M`] from all of them. The
//! correction knows no collisions. What follows it keeps the hands off the body, and a thick hand ends farther away.

use crate::arm::{ARMS, ArmModel, ArmQ, Limbs};
use crate::chain::Chain;
use crate::closed_form::closed_form;
use crate::refine::{Objective, PRIOR_WEIGHT, Pull};
use messages::{SMPL_JOINTS, Smpl};
use nalgebra::{UnitQuaternion, Vector3};

/// Distance of the person's hand from what it may touch, m, up to which the correction is whole: a box that two hands
/// hold. Assumption.
pub const NEAR_M: f64 = 0.3;
/// Distance from which there is no correction, m. Assumption.
pub const FAR_M: f64 = 0.45;
/// Weight of a squared distance of the hand beside S_GR, 1/m^2. Of 40, 100 and 400, it leaves at most
/// 1.5 cm on the eleven named motions and turns the limbs least.
pub const WEIGHT: f64 = 100.0;
/// Time in which a correction comes or goes if a hand or the head is seen all at once, s: as a quick clap (assumption).
const SHARE_S: f64 = 0.1;
/// Longest time between two skeletons that counts, s.
const STEP_MAX_S: f64 = 0.04;
/// Time constant of the length of the person's arm, s. A tracker finds one length again and again (assumption).
const REACH_S: f64 = 1.0;
/// Steps of each of the two minima.
const STEPS: u32 = 8;
/// Rounds in which a hand between head and chest comes to the right distance of both, in the plane between left and right.
const ROUNDS: u32 = 16;
/// Distance of the chest's surface before the middle between the shoulders, m (assumption).
const CHEST_M: f64 = 0.1;
/// Half of a hand's length, as a share of the forearm's (Winter, Biomechanics, 4th ed., fig. 4.1: 0.108 and 0.146 of the
/// stature).
const HAND_PER_FOREARM: f64 = 0.054 / 0.146;
/// Height of the middle of the head above the skull's lowest joint, as a share of the upper arm (ibid.: 0.935 - 0.91, and
/// 0.186 of the stature).
const HEAD_PER_UPPER_ARM: f64 = 0.025 / 0.186;
/// Sum of the squared lengths of the limbs across the shoulders' line, m^2, below which they do not tell which way is up.
const ACROSS_MIN_M2: f64 = 1e-4;

/// The robot's proportions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proportions {
    /// The left arm. The right one is its mirror.
    pub chain: Chain,
    /// The middle of the head from the middle between the shoulders, in the torso frame, m. `None` without a head.
    pub head: Option<Vector3<f64>>,
    /// Length of a stretched arm, m.
    pub reach_m: f64,
}

/// A person's lengths and places, in the torso frame, from the middle between the shoulders, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Middle of the left and of the right hand.
    pub hands: [Option<Vector3<f64>>; ARMS],
    /// Middle of the head.
    pub head: Option<Vector3<f64>>,
    /// Length of the stretched arm.
    pub reach_m: f64,
}

impl Figure {
    /// Takes the lengths from the positions and the directions from the limbs, which are those of left arms. `None`
    /// without a limb, or with positions that are not finite or coincide.
    pub fn of(positions: &[[f32; 3]; SMPL_JOINTS], limbs: &[Option<Limbs>; ARMS]) -> Option<Self> {
        let at = |joint: Smpl| Vector3::from(positions[joint as usize]).cast::<f64>();
        let joints = [
            [Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist],
            [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist],
        ];
        let across = at(Smpl::LeftShoulder) - at(Smpl::RightShoulder);
        let left = across.try_normalize(1e-6)?;
        let mut reach_m = None;
        let (mut hands, mut cosine, mut sine) = ([None; ARMS], 0.0, 0.0);
        // Any front and up of the world across the shoulders' line. The limbs then tell by what angle they lean.
        let front = left.cross(&if left.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() }).normalize();
        let up = front.cross(&left);
        for (side, limbs) in limbs.iter().enumerate() {
            let Some(limbs) = limbs else { continue };
            let [shoulder, elbow, wrist] = joints[side].map(at);
            let (upper, fore) = (elbow - shoulder, wrist - elbow);
            let hand_m = fore.norm() * (1.0 + HAND_PER_FOREARM);
            reach_m.get_or_insert(upper.norm() + hand_m);
            let own = |rotation: &UnitQuaternion<f64>, length: f64| on_side(side, rotation * Vector3::y() * length);
            let (torso_upper, torso_fore) = (own(&limbs.upper, upper.norm()), own(&limbs.fore, fore.norm()));
            for (seen, torso) in [(upper, torso_upper), (fore, torso_fore)] {
                let (x, z) = (seen.dot(&front), seen.dot(&up));
                cosine += x * torso.x + z * torso.z;
                sine += z * torso.x - x * torso.z;
            }
            let half = Vector3::y() * (across.norm() / 2.0);
            hands[side] = Some(on_side(side, half) + torso_upper + own(&limbs.fore, hand_m));
        }
        let length = cosine.hypot(sine);
        let seen = positions[Smpl::Head as usize] != [0.0; 3];
        let head = (seen && length > ACROSS_MIN_M2).then(|| {
            let skull = at(Smpl::Head) - (at(Smpl::LeftShoulder) + at(Smpl::RightShoulder)) / 2.0;
            let (x, z) = (skull.dot(&front), skull.dot(&up));
            let (c, s) = (cosine / length, sine / length);
            let upper_m = (at(Smpl::LeftElbow) - at(Smpl::LeftShoulder)).norm();
            Vector3::new(c * x + s * z, skull.dot(&left), c * z - s * x + HEAD_PER_UPPER_ARM * upper_m)
        });
        let finite = |place: Vector3<f64>| place.iter().all(|x| x.is_finite());
        let reach_m = reach_m.filter(|reach_m: &f64| *reach_m > 0.0 && reach_m.is_finite())?;
        let all = hands.into_iter().chain([head]).flatten().all(finite);
        all.then_some(Self { hands, head, reach_m })
    }
}

/// Returns the vector of a left arm as that of the left (0) or the right (1) arm, and the other way round.
fn on_side(side: usize, v: Vector3<f64>) -> Vector3<f64> {
    if side == 0 { v } else { Vector3::new(v.x, -v.y, v.z) }
}

/// State of an arm from one skeleton to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Kept {
    /// The posture without a correction, rad.
    posture: Option<ArmQ>,
    /// Shares of the chest or the other hand, and of the head.
    shares: [f64; 2],
}

/// State of both arms from one skeleton to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    arms: [Kept; ARMS],
    /// The last head that was seen.
    head: Option<Vector3<f64>>,
    /// Low-passed length of the person's stretched arm, m.
    reach_m: Option<f64>,
}

/// The robot, and how much of the correction is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// The robot's proportions.
    pub robot: Proportions,
    /// From 0 (none) to 1.
    pub weight: f64,
}

impl Correction {
    /// Returns the limbs of left arms that bring the robot's hands to where the person's touch, `elapsed_s` after the last
    /// call. Never allocates.
    pub fn apply(
        &self,
        arm: &ArmModel,
        person: &Figure,
        limbs: &[Option<Limbs>; ARMS],
        elapsed_s: f64,
        memory: &mut Memory,
    ) -> [Option<Limbs>; ARMS] {
        let elapsed_s = elapsed_s.min(STEP_MAX_S);
        memory.head = person.head.or(memory.head);
        // A tracker's lengths differ from arm to arm and from frame to frame.
        let before_m = memory.reach_m.unwrap_or(person.reach_m);
        let reach_m = before_m + (person.reach_m - before_m) * (elapsed_s / REACH_S).min(1.0);
        memory.reach_m = Some(reach_m);
        std::array::from_fn(|side| {
            let kept = &mut memory.arms[side];
            let Some(limbs) = limbs[side] else {
                *kept = Kept::default();
                return None;
            };
            let person = Figure { reach_m, ..*person };
            let Some(aim) = self.aim(&person, memory.head, side, elapsed_s, &mut kept.shares) else {
                kept.posture = None;
                return Some(limbs);
            };
            let start = kept.posture.unwrap_or_else(|| closed_form(arm, &limbs, &arm.mid()));
            let from = minimum(arm, &limbs, &start, None);
            kept.posture = Some(from);
            let own = self.robot.chain.hand(arm, &from);
            let to = own + (on_side(side, aim.to) - own) * (aim.share * self.weight);
            let pull = Pull { chain: &self.robot.chain, to, weight: WEIGHT };
            let (from, to) = (arm.forward(&from), arm.forward(&minimum(arm, &limbs, &from, Some(pull))));
            Some(Limbs {
                upper: to.upper * from.upper.inverse() * limbs.upper,
                fore: to.fore * from.fore.inverse() * limbs.fore,
            })
        })
    }

    /// Returns where the hand of this side belongs. `None` if nothing is near, or the hand is not seen.
    fn aim(
        &self,
        person: &Figure,
        head: Option<Vector3<f64>>,
        side: usize,
        elapsed_s: f64,
        shares: &mut [f64; 2],
    ) -> Option<Aim> {
        let hand = person.hands[side]?;
        let scale = self.robot.reach_m / person.reach_m;
        let chest = Vector3::x() * CHEST_M;
        let near = |place: Option<Vector3<f64>>| place.map_or(0.0, |place| nearness((hand - place).norm()));
        let wanted = [near(Some(chest)).max(near(person.hands[1 - side])), near(person.head)];
        let step = elapsed_s / SHARE_S;
        for (share, wanted) in shares.iter_mut().zip(wanted) {
            *share = wanted.clamp(*share - step, *share + step);
        }
        let mut places = [(shares[0], chest, chest * scale), (0.0, chest, chest * scale)];
        if let (Some(from), Some(to)) = (head, self.robot.head) {
            places[1] = (shares[1], from, to);
        }
        let sum: f64 = places.iter().map(|(share, ..)| share).sum();
        if sum <= 0.0 {
            return None;
        }
        let mut to: Vector3<f64> =
            places.iter().map(|(share, from, to)| (to + (hand - from) * scale) * (share / sum)).sum();
        for _ in 0..ROUNDS {
            for (share, from, place) in &places {
                let away = to - place;
                let error = away.norm() - (hand - from).norm() * scale;
                let along = away.try_normalize(1e-6).unwrap_or_default();
                to -= Vector3::new(along.x, 0.0, along.z) * (share / 2.0 * error);
            }
        }
        Some(Aim { to, share: places[0].0.max(places[1].0) })
    }
}

/// Where a hand belongs, m.
struct Aim {
    to: Vector3<f64>,
    /// Share of the way to there, from 0 to 1.
    share: f64,
}

fn minimum(arm: &ArmModel, human: &Limbs, start: &ArmQ, pull: Option<Pull<'_>>) -> ArmQ {
    Objective { arm, human, prior: start, prior_weight: PRIOR_WEIGHT, pull }.descend(start, STEPS).q
}

/// From 1 at [`NEAR_M`] to 0 at [`FAR_M`], with a continuous slope.
fn nearness(distance_m: f64) -> f64 {
    let s = ((FAR_M - distance_m) / (FAR_M - NEAR_M)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}
