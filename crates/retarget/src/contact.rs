//! Contact correction: brings the robot's hands to the places of its own body that the person's hands touch.
//!
//! ```text
//! hand      p' = a' + (p - a) L' / L
//! gap       d' = d L' / L
//! posture   q0 = argmin S_GR(q)
//!           q' = argmin S_GR(q) + w |p(q) - p(q0) - s (p' - p(q0))|^2
//! limbs     R' = R(q') R(q0)^-1 R
//!
//! p, d, R   hand position (m), distance of hand and touched surface (m) and limb rotations of the person
//! p', d', R' those of the robot
//! a         middle of the touched part: chest or head, m
//! L         length of the stretched arm, shoulder to the middle of the hand, m
//! p(q)      hand position of the robot at the posture q, m
//! s         share of the correction, from 0 to 1
//! w         [`WEIGHT`], 1/m^2
//! ```
//!
//! All places are in the torso frame, from the middle between the shoulders. Limb rotations alone miss the touched place,
//! because no robot has a person's proportions.
//!
//! The robot's hand is thicker than a person's. So p' moves away from the touched part until the surfaces have the distance
//! d'. The surfaces are capsules, turned by forearm and wrist. Forearms have surfaces too. Where the person's forearms cross,
//! both hands move apart along the shortest line between the person's forearms. They stop when each forearm keeps [`APART_M`]
//! from the other arm's forearm and hand. If the forearms cross before the chest, both arms also keep [`APART_M`] from the
//! front of the torso.
//!
//! All persons are scaled to one adult first. The share s is zero while the hand is farther than [`FAR_M`] from every part.
//! Then the limbs are the person's own. The search for q' starts at its last value, so it does not jump between two minima.
//! q' is also the start of the target's posture. Near the gimbal of the shoulder the limbs alone leave a choice of the hand.
//!
//! Limbs of a person at rest stay at rest, with two exceptions. Arms crossed right above the head of TIAGo++, and aligned
//! forearms of TIAGo++ or FR3, may swing by up to 4 degrees a frame at 60 Hz. The correction knows no other collisions. The
//! stages after it keep the arms off the rest of the robot.

use crate::arm::{ARMS, ArmModel, ArmQ};
use crate::closed_form::closed_form;
use crate::kinematic_chain::KinematicChain;
use crate::refine::{Objective, PRIOR_WEIGHT, Pull};
use crate::smoothstep::smoothstep;
use crate::surface::{ArmSurfaces, Surface};
use messages::{SMPL_JOINTS, Smpl};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use robot::Limbs;
use robot::limbs::place_on_side;
use robot::{PointingJoints, segment_distance};

/// Length of the stretched arm of the adult to whom every person is scaled, m. Stature of 1.75 m (Winter, Biomechanics, 4th ed.,
/// fig. 4.1: 0.186 + 0.146 + 0.054 of it). All lengths of a person below belong to this adult.
const ADULT_REACH_M: f64 = 0.676;
/// Distance between the person's hand and a part, m, up to which the share is 1: a box held by two hands (assumption).
pub const NEAR_M: f64 = 0.3;
/// Distance from which the share is 0, m (assumption).
pub const FAR_M: f64 = 0.45;
/// Weight w of the hand's squared distance against S_GR, 1/m^2. Of 40, 100 and 400, it leaves at most 1.5 cm on the eleven
/// named motions and turns the limbs least.
pub const WEIGHT: f64 = 100.0;
/// Distance between a robot's forearm and the other arm's forearm and hand, m. It is twice what following keeps (`control`:
/// least clearance 10 mm and 5 mm), so a lagging arm has room. Of 2 and 3 cm, 3 brought crossed hands nearer, by up to 1 cm.
pub const APART_M: f64 = 0.03;
/// Distances between the axes of a person's forearms, m, at which the share of the crossing is 0 and 1 (assumptions). Forearms
/// in contact are 8 cm apart.
const CROSS_M: [f64; 2] = [0.25, 0.15];
/// Distance between the axes below which the side of each forearm is ambiguous, m (assumption).
const AMBIGUOUS_M: f64 = 0.03;
/// Time in which a share changes between 0 and 1, s: that of a quick clap (assumption).
const SHARE_S: f64 = 0.1;
/// Time constant of the offset between the arms, s. The forearm turns with the hand, and the offset with the forearm. Without
/// this low-pass, arms at rest swung: G1's by 2 degrees, and OpenArm's by 7 at 20 Hz.
const APART_S: f64 = 0.02;
/// Largest share of the remaining offset that one skeleton corrects. It serves the same purpose.
const APART_SHARE_MAX: f64 = 0.5;
/// Largest speed of the offset between the arms, m/s: that of a moving hand (assumption). It bounds the motion of one arm when
/// the other arm appears or disappears.
const APART_MAX_M_PER_S: f64 = 2.0;
/// Largest time step of one skeleton, s.
const STEP_MAX_S: f64 = 0.04;
/// Time constant of the low-pass of the person's arm length, s (assumption). A tracker measures it again in each frame.
const REACH_S: f64 = 1.0;
/// Largest ratio of one skeleton's arm length to the low-passed one (assumption). It limits the effect of an outlier.
const REACH_MOST: f64 = 2.0;
/// Steps of each of the two minimisations. With 8, the far posture of a guarding hand was not reached, and an arm at rest
/// jumped by 10 degrees in one frame.
const STEPS: u32 = 12;
/// Rounds that move a hand to its distances from chest, head and other hand. Each covers half of the distance.
const ROUNDS: u32 = 16;
/// Distance from the middle between the shoulders forward to a person's chest, m (assumption).
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
/// Sum of the squared lengths of the limbs across the shoulders' line, m^2, below which the lean of the torso is unknown.
const ACROSS_MIN_M2: f64 = 1e-4;

/// The robot's proportions as one arm sees them. A right arm's are those of a left one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proportions {
    /// The arm.
    pub chain: KinematicChain,
    /// The joints of its wrist.
    pub wrist: PointingJoints,
    /// Origin of its first joint at the reference posture, from the middle between the shoulders, m.
    pub wrist_at: Vector3<f64>,
    /// The head. `None` without one.
    pub head: Option<Part>,
    /// Length of a stretched arm, the shorter one, m.
    pub reach_m: f64,
    /// The hand.
    pub hand: Surface,
    /// The forearm, from the first joint of the wrist. It excludes the body between both wrist joints.
    pub forearm: Surface,
    /// Distance from the middle between the shoulders forward to the chest's surface, m.
    pub chest_m: f64,
    /// Extent of the torso forward and to the arm's side of that middle, m.
    pub torso_m: [f64; 2],
}

impl Proportions {
    /// Returns the rotation of the left hand against its forearm when the wrist points it as the person's hand.
    fn bend(&self, fore: &UnitQuaternion<f64>, hand: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let bend = self.wrist.rotation(self.wrist.nearest(&(fore.inverse() * hand), self.wrist.home));
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(bend))
    }

    /// Returns the surfaces of the left (0) or right (1) arm from the middle of its hand. `turned` holds the
    /// rotations of forearm and wrist. A right arm's are mirrored into a left arm's. It is `None` for an unseen arm.
    fn surfaces(&self, side: usize, turned: Option<(UnitQuaternion<f64>, UnitQuaternion<f64>)>) -> ArmSurfaces {
        let (fore, bend) = turned.unwrap_or_default();
        let hand = fore * bend;
        let wrist = place_on_side(side, hand * (self.wrist_at - self.chain.hand));
        ArmSurfaces { hand: self.hand.turned(side, &hand), forearm: self.forearm.turned(side, &fore).moved(&wrist) }
    }

    /// Returns the chain to the middle of the hand at the wrist rotation `bend`.
    fn bent(&self, bend: &UnitQuaternion<f64>) -> KinematicChain {
        KinematicChain { hand: self.wrist_at + bend * (self.chain.hand - self.wrist_at), ..self.chain }
    }
}

/// Head or chest of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Middle in the torso frame, from the middle between the shoulders, m.
    pub center: Vector3<f64>,
    /// Its surface, with its joints at home.
    pub surface: Surface,
}

/// Places and arm length of a person, in the torso frame, from the middle between the shoulders, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PersonGeometry {
    /// Middle of the left and of the right hand.
    pub hands: [Option<Vector3<f64>>; ARMS],
    /// Elbow of the left and of the right arm.
    pub elbows: [Option<Vector3<f64>>; ARMS],
    /// Middle of the head.
    pub head: Option<Vector3<f64>>,
    /// Length of the stretched arm.
    pub reach_m: f64,
}

impl PersonGeometry {
    /// Measures lengths from the positions, and directions from the limbs of left arms. `None` without a limb, or with
    /// positions that are not finite or coincide.
    pub fn measure(positions: &[[f32; 3]; SMPL_JOINTS], limbs: &[Option<Limbs>; ARMS]) -> Option<Self> {
        let at = |joint: Smpl| Vector3::from(positions[joint as usize]).cast::<f64>();
        let joints = [
            [Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist],
            [Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist],
        ];
        let across = at(Smpl::LeftShoulder) - at(Smpl::RightShoulder);
        let left = across.try_normalize(1e-6)?;
        let mut reach_m = None;
        let (mut hands, mut elbows, mut cosine, mut sine) = ([None; ARMS], [None; ARMS], 0.0, 0.0);
        // An arbitrary front and up across the shoulders' line. The limbs then give the lean of the torso about it.
        let front = left.cross(&if left.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() }).normalize();
        let up = front.cross(&left);
        for (side, limbs) in limbs.iter().enumerate() {
            let Some(limbs) = limbs else { continue };
            let [shoulder, elbow, wrist] = joints[side].map(at);
            let (upper, fore) = (elbow - shoulder, wrist - elbow);
            let hand_m = fore.norm() * (1.0 + HAND_PER_FOREARM);
            reach_m.get_or_insert(upper.norm() + hand_m);
            let own =
                |rotation: &UnitQuaternion<f64>, length: f64| place_on_side(side, rotation * Vector3::y() * length);
            let (torso_upper, torso_fore) = (own(&limbs.upper, upper.norm()), own(&limbs.fore, fore.norm()));
            for (seen, torso) in [(upper, torso_upper), (fore, torso_fore)] {
                let (x, z) = (seen.dot(&front), seen.dot(&up));
                cosine += x * torso.x + z * torso.z;
                sine += z * torso.x - x * torso.z;
            }
            let half = Vector3::y() * (across.norm() / 2.0);
            let elbow = place_on_side(side, half) + torso_upper;
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

    /// Returns the person with all lengths multiplied by `by`.
    fn scaled(&self, by: f64) -> Self {
        let scaled = |place: Option<Vector3<f64>>| place.map(|place| place * by);
        Self {
            hands: self.hands.map(scaled),
            elbows: self.elbows.map(scaled),
            head: scaled(self.head),
            reach_m: self.reach_m * by,
        }
    }
}

/// State of one arm between two skeletons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct ArmMemory {
    /// The posture q0 without a correction, rad.
    posture: Option<ArmQ>,
    /// The posture q' with the correction, rad, and its share.
    touching: Option<(ArmQ, f64)>,
    /// Shares of the contact with the chest and with the head.
    shares: [f64; 2],
}

/// State of both arms between two skeletons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory {
    arms: [ArmMemory; ARMS],
    /// Share of the contact between both hands.
    together: f64,
    /// Offset of each hand from the other arm, m.
    apart: [Vector3<f64>; ARMS],
    /// The last seen head, m.
    head: Option<Vector3<f64>>,
    /// Low-passed length of the person's stretched arm, m.
    reach_m: Option<f64>,
}

impl Memory {
    /// Returns the postures q' (rad) and their shares from 0 to 1. `None` for an arm without a contact.
    pub fn postures(&self) -> [Option<(ArmQ, f64)>; ARMS] {
        [0, 1].map(|arm| self.arms[arm].touching)
    }
}

/// The robot, and the weight of the correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correction {
    /// The robot's proportions as each arm sees them.
    pub robot: [Proportions; ARMS],
    /// From 0 (none) to 1.
    pub weight: f64,
}

impl Correction {
    /// Returns the corrected limbs R' of left arms, `elapsed_s` after the last call. Never allocates.
    pub fn apply(
        &self,
        arms: [&ArmModel; ARMS],
        person: &PersonGeometry,
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
        let person = person.scaled(ADULT_REACH_M / reach_m);
        memory.head = person.head.or(memory.head);
        for (kept, limbs) in memory.arms.iter_mut().zip(limbs) {
            if limbs.is_none() {
                *kept = ArmMemory::default();
            }
        }
        // Forearms of the last skeleton: they turn the wrists, and the wrists turn the hands' surfaces.
        let turned = [0, 1].map(|side| {
            let fore = memory.arms[side].touching.map(|(q, _)| arms[side].forward(&q)).or(limbs[side])?.fore;
            Some((fore, hands[side].map_or_else(UnitQuaternion::identity, |hand| self.robot[side].bend(&fore, &hand))))
        });
        let shapes = [0, 1].map(|side| self.robot[side].surfaces(side, turned[side]));
        let targets = self.hand_targets(&person, &shapes, elapsed_s, memory);
        std::array::from_fn(|side| {
            let (arm, kept) = (arms[side], &mut memory.arms[side]);
            let limbs = limbs[side]?;
            let Some(target) = &targets[side] else {
                (kept.posture, kept.touching) = (None, None);
                return Some(limbs);
            };
            let start = kept.posture.unwrap_or_else(|| closed_form(arm, &limbs, &arm.mid()));
            let from = minimum(arm, &limbs, (&start, &start), None);
            kept.posture = Some(from);
            let chain = self.robot[side].bent(&turned[side]?.1);
            let own = chain.hand_center(arm, &from);
            let to = own + (place_on_side(side, target.at) - own) * (target.share * self.weight);
            let pull = Pull { chain: &chain, to, weight: WEIGHT };
            let start = kept.touching.map_or(from, |(q, _)| q);
            let touching = minimum(arm, &limbs, (&from, &start), Some(pull));
            kept.touching = Some((touching, target.share * self.weight));
            let (from, to) = (arm.forward(&from), arm.forward(&touching));
            Some(Limbs {
                upper: to.upper * from.upper.inverse() * limbs.upper,
                fore: to.fore * from.fore.inverse() * limbs.fore,
            })
        })
    }

    /// Returns the target places p' of both hands, and advances the shares. `None` for a hand without a contact.
    fn hand_targets(
        &self,
        person: &PersonGeometry,
        shapes: &[ArmSurfaces; ARMS],
        elapsed_s: f64,
        memory: &mut Memory,
    ) -> [Option<HandTarget>; ARMS] {
        let (robot, scale) = (&self.robot[0], self.robot[0].reach_m / ADULT_REACH_M);
        let step = elapsed_s / SHARE_S;
        let toward = |share: &mut f64, wanted: f64| *share = wanted.clamp(*share - step, *share + step);
        let near = |a: Option<Vector3<f64>>, b: Option<Vector3<f64>>| {
            a.zip(b).map_or(0.0, |(a, b)| smoothstep((a - b).norm(), [FAR_M, NEAR_M]))
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
        self.separate(&mut alone, shapes, &touched, None);
        self.separate(&mut to, shapes, &touched, pair);
        for ((to, alone), apart) in to.iter_mut().zip(alone).zip(&mut memory.apart) {
            let wanted = to.zip(alone).map_or_else(Vector3::zeros, |(to, alone)| to - alone);
            let step = (wanted - *apart) * (elapsed_s / (APART_S + elapsed_s)).min(APART_SHARE_MAX);
            *apart += step.cap_magnitude(APART_MAX_M_PER_S * elapsed_s);
            *to = alone.map(|alone| alone + *apart);
        }
        std::array::from_fn(|side| {
            let [chest, head] = memory.arms[side].shares;
            Some(HandTarget { at: to[side]?, share: chest.max(head).max(memory.together) })
        })
    }

    /// Moves the places of both hands until the surfaces have the distances d'.
    fn separate(
        &self,
        to: &mut [Option<Vector3<f64>>; ARMS],
        shapes: &[ArmSurfaces; ARMS],
        touched: &[[Option<Touch>; 2]; ARMS],
        pair: Option<Pair>,
    ) {
        let [left_arm, right_arm] = shapes;
        for _ in 0..ROUNDS {
            for (side, to) in to.iter_mut().enumerate() {
                let Some(to) = to else { continue };
                for touch in touched[side].iter().flatten() {
                    let out = *to - touch.part.center;
                    let gap_m = touch.part.surface.gap_m(&shapes[side].hand, &out);
                    *to += direction(&out) * (touch.share / 2.0 * (touch.gap_m - gap_m));
                }
            }
            let ([Some(left), Some(right)], Some(pair)) = (&mut *to, pair) else { continue };
            let across = *left - *right;
            let gap_m = right_arm.hand.gap_m(&left_arm.hand, &across);
            let apart = direction(&across) * (pair.share / 4.0 * (pair.gap_m - gap_m));
            (*left, *right) = (*left + apart, *right - apart);
            let Crossing { normal, share, before } = pair.crossing;
            let crossing_m = right_arm.crossing_m(left_arm, &(*left - *right));
            let apart = normal * (share / 2.0 * (APART_M - crossing_m).max(0.0));
            (*left, *right) = (*left + apart, *right - apart);
            for (to, arm, robot) in [(left, left_arm, &self.robot[0]), (right, right_arm, &self.robot[1])] {
                let before_m = arm.before_m(to, &robot.torso_m);
                to.x += before / 2.0 * (APART_M - before_m).max(0.0);
            }
        }
    }
}

/// Measures the crossing of a person's forearms.
fn crossing(person: &PersonGeometry) -> Crossing {
    let [Some((a, b)), Some((c, d))] = [0, 1].map(|side| person.elbows[side].zip(person.hands[side])) else {
        return Crossing::default();
    };
    let near = segment_distance(&a, &b, &c, &d);
    let (left, right) = (a + (b - a) * near.s, c + (d - c) * near.t);
    let middle = (left + right) / 2.0;
    let share = smoothstep(near.distance_m, CROSS_M) * smoothstep(near.distance_m, [0.0, AMBIGUOUS_M]);
    let before = share * smoothstep(middle.x, [0.0, CHEST_M]) * smoothstep(-middle.z, [0.0, CHEST_M]);
    Crossing { normal: direction(&(left - right)), share, before }
}

/// Contact of one hand with chest or head.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Share of the distance d', from 0 to 1.
    share: f64,
    part: Part,
    /// Distance d' of the surfaces, m.
    gap_m: f64,
}

/// Contact of both hands with each other.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// Share of the distance d', from 0 to 1.
    share: f64,
    /// Distance d' of the surfaces, m.
    gap_m: f64,
    /// The person's forearms.
    crossing: Crossing,
}

/// Crossing of a person's forearms. The share is 0 without a crossing.
#[derive(Clone, Copy, Debug, Default)]
struct Crossing {
    /// Unit vector from the right forearm to the left one at their nearest points.
    normal: Vector3<f64>,
    /// Share of the crossing, from 0 to 1.
    share: f64,
    /// Share of the crossing before the chest, from 0 to 1.
    before: f64,
}

/// Returns the unit vector along `v`. Zero for a zero vector.
fn direction(v: &Vector3<f64>) -> Vector3<f64> {
    v.try_normalize(1e-6).unwrap_or_default()
}

/// Target of a hand.
struct HandTarget {
    /// Place p' of the middle of the hand, m.
    at: Vector3<f64>,
    /// Share s of the correction, from 0 to 1.
    share: f64,
}

fn minimum(arm: &ArmModel, human: &Limbs, (prior, start): (&ArmQ, &ArmQ), pull: Option<Pull<'_>>) -> ArmQ {
    Objective { arm, human, prior, prior_weight: PRIOR_WEIGHT, pull }.descend(start, STEPS).q
}
