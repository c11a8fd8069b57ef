//! Hands that touch: where a person's hand is near the head, the chest or the other hand, the robot's goes to the same
//! place of its own body.
//!
//! Limb rotations alone miss such places, because no robot has a person's proportions. With the lengths L of the
//! stretched arms, shoulder to the middle of the hand, a hand at p of a person stands for
//!
//! ```text
//! p' = a' + (p - a) L' / L           a: the chest, or the middle of the head
//! ```
//!
//! of the robot. Letters without a prime belong to the person. Those with a prime belong to the robot. The robot's hand leaves
//! p' toward the part that it touches: the chest, the head or the other hand. It stops at this distance of the surfaces:
//!
//! ```text
//! d' = d L' / L          d: the person's distance of the surfaces
//! ```
//!
//! A robot's hand is thicker than a person's. Its surface is that of its capsules, turned as its forearm and its wrist turn
//! them. So are its forearms. Where a person's cross, both hands leave each other along the shortest way between the person's
//! forearms, until each robot's forearm keeps [`APART_M`] from the other one and its hand. If they cross before the chest, both
//! arms also leave the torso's front by as much.
//!
//! The robot's limbs turn until its hand is at p'. The correction turns the person's limbs by as much:
//!
//! ```text
//! q0 = argmin S_GR(q),   q' = argmin S_GR(q) + w |p(q) - p(q0) - s (p' - p(q0))|^2,   R' = R(q') R(q0)^-1 R
//! ```
//!
//! Every person is grown to the size of one adult first. The share s is zero, and the limbs are the person's own, while the hand
//! is farther than [`FAR_M`] from all of them. Near a shoulder's gimbal the same limbs leave the hand a choice, so q' is the
//! start of the target's posture. The search for q' begins at its last value, so it does not leap between two minima. Still
//! persons have still limbs, with two exceptions. Arms that cross right above the head of TIAGo++, and forearms of TIAGo++ or FR3
//! in line, may swing by up to 4 degrees a frame at 60 Hz. The correction knows no other collisions. What follows it keeps the
//! arms off the rest of the robot.

use crate::arm::{ARMS, ArmModel, ArmQ, Limbs};
use crate::chain::Chain;
use crate::closed_form::closed_form;
use crate::refine::{Objective, PRIOR_WEIGHT, Pull};
use crate::surface::{Shape, Surface, on_side};
use messages::{SMPL_JOINTS, Smpl};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use robot::{TwoAxes, segment_distance};

/// Length of a stretched arm to which every person is grown, m: a child's hands touch as an adult's. Stature of 1.75 m (Winter,
/// Biomechanics, 4th ed., fig. 4.1: 0.186 + 0.146 + 0.054 of it). All lengths of a person below are those of this adult.
const ADULT_REACH_M: f64 = 0.676;
/// Distance of the person's hand from what it may touch, m, up to which the correction is whole: a box that two hands
/// hold. Assumption.
pub const NEAR_M: f64 = 0.3;
/// Distance from which there is no correction, m. Assumption.
pub const FAR_M: f64 = 0.45;
/// Weight of a squared distance of the hand beside S_GR, 1/m^2. Of 40, 100 and 400, it leaves at most
/// 1.5 cm on the eleven named motions and turns the limbs least.
pub const WEIGHT: f64 = 100.0;
/// Distance to which a robot's forearm is led from the other forearm and its hand, m: twice what following keeps
/// (`control`: least clearance 10 mm and 5 mm), so that it is not in the way of an arm that is behind. Of 2 and 3 cm, 3 brought
/// crossed hands nearer, by up to 1 cm.
pub const APART_M: f64 = 0.03;
/// Distance of a person's forearms from axis to axis, m, from which they have no part in it, and up to which they have all of it
/// (assumptions). Forearms that lie on each other are 8 cm apart.
const CROSS_M: [f64; 2] = [0.25, 0.15];
/// Distance of the axes below which they do not tell which forearm is on which side, m (assumption).
const UNTOLD_M: f64 = 0.03;
/// Time in which a correction comes or goes if a hand or the head is seen all at once, s: as a quick clap (assumption).
const SHARE_S: f64 = 0.1;
/// Time constant of the way by which a hand leaves the other arm, s, and the most of it that one skeleton makes good. Its forearm
/// turns with it, and with that the way: without them still arms swung, G1's by 2 degrees, and OpenArm's by 7 at 20 Hz.
const APART_S: f64 = 0.02;
const APART_SHARE_MAX: f64 = 0.5;
/// Largest speed at which a hand leaves the other arm, m/s. An arm that is seen or lost all at once turns the other one no
/// faster. Assumption: as a hand on its way.
const APART_MAX_M_PER_S: f64 = 2.0;
/// Longest time between two skeletons that counts, s.
const STEP_MAX_S: f64 = 0.04;
/// Time constant of the length of the person's arm, s. A tracker finds one length again and again (assumption).
const REACH_S: f64 = 1.0;
/// Most by which the length of one skeleton counts, as a factor: a wild one does not shrink the person for long (assumption).
const REACH_MOST: f64 = 2.0;
/// Steps of each of the two minima. With 8, the far posture of a hand in guard was not reached, and a resting arm leapt by 10
/// degrees in one frame.
const STEPS: u32 = 12;
/// Rounds in which a hand comes to the right distance of chest, head and other hand. Each moves it half of the way.
const ROUNDS: u32 = 16;
/// Distance of a person's chest before the middle between the shoulders, m (assumption).
pub const CHEST_M: f64 = 0.1;
/// Distance of the surface of a person's hand from its middle, m (assumption).
pub const HALF_HAND_M: f64 = 0.015;
/// Distance of a person's scalp and face from the middle of the head, m: half of the mean of breadth and length (ANSUR
/// 1988, men: 15.2 cm and 19.7 cm).
pub const HEAD_M: f64 = 0.087;
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
    /// The joints of its wrist.
    pub wrist: TwoAxes,
    /// Their place at the reference posture, from the middle between the shoulders, m.
    pub wrist_at: Vector3<f64>,
    /// The head. `None` without one.
    pub head: Option<Part>,
    /// Length of a stretched arm, m.
    pub reach_m: f64,
    /// The left hand.
    pub hand: Surface,
    /// The left forearm, from the first joint of the wrist. The body between both joints of the wrist counts to nothing.
    pub forearm: Surface,
    /// Distance of the chest's surface before the middle between the shoulders, m.
    pub chest_m: f64,
    /// How far the torso reaches before that middle and to its left, m.
    pub torso_m: [f64; 2],
}

impl Proportions {
    /// Returns how the wrist turns the left hand against its forearm if it points it as the person's.
    fn bend(&self, fore: &UnitQuaternion<f64>, hand: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let bend = self.wrist.rotation(self.wrist.nearest(&(fore.inverse() * hand)));
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(bend))
    }

    /// Returns the left (0) or right (1) arm's surfaces from the middle of its hand. `turned`: of the left arm that
    /// mirrors it, the forearm and how the wrist bends. `None` for an arm that is not seen.
    fn shape(&self, side: usize, turned: Option<(UnitQuaternion<f64>, UnitQuaternion<f64>)>) -> Shape {
        let (fore, bend) = turned.unwrap_or_default();
        let hand = fore * bend;
        let wrist = on_side(side, hand * (self.wrist_at - self.chain.hand));
        Shape { hand: self.hand.turned(side, &hand), forearm: self.forearm.turned(side, &fore).moved(&wrist) }
    }

    /// Returns the chain to the middle of a hand that is turned by `bend`.
    fn bent(&self, bend: &UnitQuaternion<f64>) -> Chain {
        Chain { hand: self.wrist_at + bend * (self.chain.hand - self.wrist_at), ..self.chain }
    }
}

/// A part of the robot that a hand may touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Middle in the torso frame, from the middle between the shoulders, m.
    pub center: Vector3<f64>,
    /// Its surface, with its joints at home. Empty for a point.
    pub surface: Surface,
}

/// A person's lengths and places, in the torso frame, from the middle between the shoulders, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figure {
    /// Middle of the left and of the right hand.
    pub hands: [Option<Vector3<f64>>; ARMS],
    /// Elbow of the left and of the right arm.
    pub elbows: [Option<Vector3<f64>>; ARMS],
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
        let (mut hands, mut elbows, mut cosine, mut sine) = ([None; ARMS], [None; ARMS], 0.0, 0.0);
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
            let elbow = on_side(side, half) + torso_upper;
            elbows[side] = Some(elbow);
            hands[side] = Some(elbow + own(&limbs.fore, hand_m));
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
        let all = hands.into_iter().chain(elbows).chain([head]).flatten().all(finite);
        all.then_some(Self { hands, elbows, head, reach_m })
    }

    /// Returns the person with all lengths multiplied.
    fn grown(&self, by: f64) -> Self {
        let grown = |place: Option<Vector3<f64>>| place.map(|place| place * by);
        Self {
            hands: self.hands.map(grown),
            elbows: self.elbows.map(grown),
            head: grown(self.head),
            reach_m: self.reach_m * by,
        }
    }
}

/// State of an arm from one skeleton to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Kept {
    /// The posture without a correction, rad.
    posture: Option<ArmQ>,
    /// The posture with it, rad, and its share.
    touching: Option<(ArmQ, f64)>,
    /// Shares of the chest and of the head.
    shares: [f64; 2],
}

/// State of both arms from one skeleton to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    arms: [Kept; ARMS],
    /// Share of both hands that are near each other.
    together: f64,
    /// The way by which each hand leaves the other arm, m.
    apart: [Vector3<f64>; ARMS],
    /// The last head that was seen.
    head: Option<Vector3<f64>>,
    /// Low-passed length of the person's stretched arm, m.
    reach_m: Option<f64>,
}

impl Memory {
    /// Returns the postures that bring the hands to where the person's touch, rad, and their shares from 0 to 1. `None` for an
    /// arm that is far from everything.
    pub fn postures(&self) -> [Option<(ArmQ, f64)>; ARMS] {
        [0, 1].map(|arm| self.arms[arm].touching)
    }
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
        (limbs, hands): (&[Option<Limbs>; ARMS], &[Option<UnitQuaternion<f64>>; ARMS]),
        elapsed_s: f64,
        memory: &mut Memory,
    ) -> [Option<Limbs>; ARMS] {
        let elapsed_s = elapsed_s.min(STEP_MAX_S);
        // A tracker's lengths differ from arm to arm and from frame to frame.
        let before_m = memory.reach_m.unwrap_or(person.reach_m);
        let seen_m = person.reach_m.clamp(before_m / REACH_MOST, before_m * REACH_MOST);
        let reach_m = before_m + (seen_m - before_m) * (elapsed_s / REACH_S).min(1.0);
        memory.reach_m = Some(reach_m);
        let person = person.grown(ADULT_REACH_M / reach_m);
        memory.head = person.head.or(memory.head);
        for (kept, limbs) in memory.arms.iter_mut().zip(limbs) {
            if limbs.is_none() {
                *kept = Kept::default();
            }
        }
        // The forearms as they were turned for the last skeleton: they turn the wrists, and with these the hands' surfaces.
        let turned = [0, 1].map(|side| {
            let fore = memory.arms[side].touching.map(|(q, _)| arm.forward(&q)).or(limbs[side])?.fore;
            Some((fore, hands[side].map_or_else(UnitQuaternion::identity, |hand| self.robot.bend(&fore, &hand))))
        });
        let shapes = [0, 1].map(|side| self.robot.shape(side, turned[side]));
        let aims = self.aims(&person, &shapes, elapsed_s, memory);
        std::array::from_fn(|side| {
            let kept = &mut memory.arms[side];
            let limbs = limbs[side]?;
            let Some(aim) = &aims[side] else {
                (kept.posture, kept.touching) = (None, None);
                return Some(limbs);
            };
            let start = kept.posture.unwrap_or_else(|| closed_form(arm, &limbs, &arm.mid()));
            let from = minimum(arm, &limbs, (&start, &start), None);
            kept.posture = Some(from);
            let chain = self.robot.bent(&turned[side]?.1);
            let own = chain.hand(arm, &from);
            let to = own + (on_side(side, aim.to) - own) * (aim.share * self.weight);
            let pull = Pull { chain: &chain, to, weight: WEIGHT };
            let start = kept.touching.map_or(from, |(q, _)| q);
            let touching = minimum(arm, &limbs, (&from, &start), Some(pull));
            kept.touching = Some((touching, aim.share * self.weight));
            let (from, to) = (arm.forward(&from), arm.forward(&touching));
            Some(Limbs {
                upper: to.upper * from.upper.inverse() * limbs.upper,
                fore: to.fore * from.fore.inverse() * limbs.fore,
            })
        })
    }

    /// Returns where both hands belong, and moves the shares. `None` for a hand near nothing.
    fn aims(
        &self,
        person: &Figure,
        shapes: &[Shape; ARMS],
        elapsed_s: f64,
        memory: &mut Memory,
    ) -> [Option<Aim>; ARMS] {
        let (robot, scale) = (&self.robot, self.robot.reach_m / ADULT_REACH_M);
        let step = elapsed_s / SHARE_S;
        let toward = |share: &mut f64, wanted: f64| *share = wanted.clamp(*share - step, *share + step);
        let near = |a: Option<Vector3<f64>>, b: Option<Vector3<f64>>| {
            a.zip(b).map_or(0.0, |(a, b)| smooth((a - b).norm(), [FAR_M, NEAR_M]))
        };
        let gap_m = |a: Vector3<f64>, b: Vector3<f64>, surfaces_m: f64| ((a - b).norm() - surfaces_m).max(0.0) * scale;
        toward(&mut memory.together, near(person.hands[0], person.hands[1]));
        let head = memory.head.zip(robot.head);
        let chest = (Vector3::x() * CHEST_M, Part { center: Vector3::x() * robot.chest_m, surface: Surface::POINT });
        let mut touched = [[None; 2]; ARMS];
        let mut to = [None; ARMS];
        for side in 0..ARMS {
            let Some(hand) = person.hands[side] else { continue };
            let shares = &mut memory.arms[side].shares;
            toward(&mut shares[0], near(Some(hand), Some(chest.0)));
            toward(&mut shares[1], near(Some(hand), head.and(person.head)));
            let touch = |share, (from, part): (Vector3<f64>, Part), person_m: f64| {
                Some(Touch { share, part, gap_m: gap_m(from, hand, HALF_HAND_M + person_m) })
            };
            touched[side] = [touch(shares[0], chest, 0.0), head.and_then(|head| touch(shares[1], head, HEAD_M))];
            let places = [Some((shares[0].max(memory.together), chest)), head.map(|head| (shares[1], head))];
            let sum: f64 = places.iter().flatten().map(|(share, _)| share).sum();
            if sum > 0.0 {
                let scaled = |(share, (from, part)): (f64, (Vector3<f64>, Part))| {
                    (part.center + (hand - from) * scale) * (share / sum)
                };
                to[side] = Some(places.into_iter().flatten().map(scaled).sum());
            }
        }
        let together_m = person.hands[0].zip(person.hands[1]).map(|(a, b)| gap_m(a, b, 2.0 * HALF_HAND_M));
        let pair = together_m.map(|gap_m| Pair { share: memory.together, gap_m, crossing: crossing(person) });
        let mut alone = to;
        self.part(&mut alone, shapes, &touched, None);
        self.part(&mut to, shapes, &touched, pair);
        for ((to, alone), apart) in to.iter_mut().zip(alone).zip(&mut memory.apart) {
            let wanted = to.zip(alone).map_or_else(Vector3::zeros, |(to, alone)| to - alone);
            let step = (wanted - *apart) * (elapsed_s / (APART_S + elapsed_s)).min(APART_SHARE_MAX);
            *apart += step.cap_magnitude(APART_MAX_M_PER_S * elapsed_s);
            *to = alone.map(|alone| alone + *apart);
        }
        std::array::from_fn(|side| {
            let [chest, head] = memory.arms[side].shares;
            Some(Aim { to: to[side]?, share: chest.max(head).max(memory.together) })
        })
    }

    /// Moves the places of both hands until their surfaces are at the right distances.
    fn part(
        &self,
        to: &mut [Option<Vector3<f64>>; ARMS],
        shapes: &[Shape; ARMS],
        touched: &[[Option<Touch>; 2]; ARMS],
        pair: Option<Pair>,
    ) {
        let [left_arm, right_arm] = shapes;
        for _ in 0..ROUNDS {
            for (side, to) in to.iter_mut().enumerate() {
                let Some(to) = to else { continue };
                for touch in touched[side].iter().flatten() {
                    let way = *to - touch.part.center;
                    let gap_m = touch.part.surface.gap_m(&shapes[side].hand, &way);
                    *to += direction(&way) * (touch.share / 2.0 * (touch.gap_m - gap_m));
                }
            }
            let ([Some(left), Some(right)], Some(pair)) = (&mut *to, pair) else { continue };
            let way = *left - *right;
            let gap_m = right_arm.hand.gap_m(&left_arm.hand, &way);
            let apart = direction(&way) * (pair.share / 4.0 * (pair.gap_m - gap_m));
            (*left, *right) = (*left + apart, *right - apart);
            let Crossing { normal, share, before } = pair.crossing;
            let crossing_m = right_arm.crossing_m(left_arm, &(*left - *right));
            let apart = normal * (share / 2.0 * (APART_M - crossing_m).max(0.0));
            (*left, *right) = (*left + apart, *right - apart);
            for (to, arm) in [(left, left_arm), (right, right_arm)] {
                let before_m = arm.before_m(to, &self.robot.torso_m);
                to.x += before / 2.0 * (APART_M - before_m).max(0.0);
            }
        }
    }
}

/// Returns how a person's forearms cross.
fn crossing(person: &Figure) -> Crossing {
    let [Some((a, b)), Some((c, d))] = [0, 1].map(|side| person.elbows[side].zip(person.hands[side])) else {
        return Crossing::default();
    };
    let near = segment_distance(&a, &b, &c, &d);
    let (left, right) = (a + (b - a) * near.s, c + (d - c) * near.t);
    let middle = (left + right) / 2.0;
    let share = smooth(near.distance_m, CROSS_M) * smooth(near.distance_m, [0.0, UNTOLD_M]);
    let before = share * smooth(middle.x, [0.0, CHEST_M]) * smooth(-middle.z, [0.0, CHEST_M]);
    Crossing { normal: direction(&(left - right)), share, before }
}

/// Something that a hand may touch.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Share of its distance, from 0 to 1.
    share: f64,
    part: Part,
    /// Distance of the surfaces, m.
    gap_m: f64,
}

/// Both hands.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// Share of their distance, from 0 to 1.
    share: f64,
    /// Distance of their surfaces, m.
    gap_m: f64,
    /// The person's forearms.
    crossing: Crossing,
}

/// Forearms of a person that cross. Without a share they do not.
#[derive(Clone, Copy, Debug, Default)]
struct Crossing {
    /// Direction from the right one to the left one where they are nearest.
    normal: Vector3<f64>,
    /// Share of this from 0 to 1.
    share: f64,
    /// Share of this before the chest, from 0 to 1.
    before: f64,
}

/// Returns the unit vector along `way`. Zero if that is zero.
fn direction(way: &Vector3<f64>) -> Vector3<f64> {
    way.try_normalize(1e-6).unwrap_or_default()
}

/// Where a hand belongs, m.
struct Aim {
    to: Vector3<f64>,
    /// Share of the way to there, from 0 to 1.
    share: f64,
}

fn minimum(arm: &ArmModel, human: &Limbs, (prior, start): (&ArmQ, &ArmQ), pull: Option<Pull<'_>>) -> ArmQ {
    Objective { arm, human, prior, prior_weight: PRIOR_WEIGHT, pull }.descend(start, STEPS).q
}

/// From 0 at the first of two places to 1 at the second, with a continuous slope.
fn smooth(at: f64, [zero, one]: [f64; 2]) -> f64 {
    let s = ((at - zero) / (one - zero)).clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}
