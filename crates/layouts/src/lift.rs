//! Gives a person the directions that a [`Lifter`] found in the image. Lengths stay as the frame has them, or typical ones.
//!
//! ```text
//! shoulders = hips + T u,  shoulder = shoulders +- w T a / 2,  elbow = shoulder + r T R d_0,  wrist = elbow + s T R d_2
//! ```
//!
//! R = (a, u, a x u) are the trunk's axes, T its length, w, r and s lengths over the trunk's.
//!
//! A limb turns no faster than its doubt permits, and holds in front of the trunk while the doubt is large. Doubt that lasts takes
//! the arm's confidence, so that its last direction is not believed for long.
//!
//! ```text
//! |turn of d_i| <= 12 rad/s dt clamp((50 - e_i) / 30, 0, 1),   E_i += (e_i - E_i) dt / min(t, 2 s),   confidence = 1 - E_i / 90
//! ```
//!
//! e_i is the expected angle of this image, degrees. t is the time since the person's first image.
//!
//! R turns by 12 rad/s at most, too: a landmarker that takes a back for a front moves no shoulder at once. An image that would
//! turn R by a right angle so soon after the one before may have left and right swapped, and is refused.
//!
//! A landmarker that guesses the size of people gives every body the same trunk. So it is the image that shows another person:
//! its trunk's centre or size jumps.

use crate::axes::{Axes, Direction};
use crate::lifter::{ImagePoints, LENGTHS, Lifted, Lifter, TYPICAL};
use crate::neutral::{COLLAR, UP_THE_TRUNK};
use messages::{RawSkeleton, SMPL_JOINTS, Smpl, Stamp};
use nalgebra::{Matrix3, Rotation3, Unit, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Axes of a camera before the person.
const FACING: Axes = Axes::from_directions([Direction::Left, Direction::Down, Direction::Back]);
/// A trunk of unknown length, m: that of the neutral skeleton.
const TRUNK_M: f64 = 0.5;
/// Breadths of shoulders and hips over the trunk's length, of the mesh that the training people have. No motion of a robot
/// depends on them.
const SHOULDERS: f64 = 0.75;
const HIPS: f64 = 0.46;
/// Lengths of bones over the trunk's that can be true: see `lengths`.
const BONE_PER_TRUNK: [f64; 2] = [0.2, 0.9];
/// Expected angle at which an arm has no confidence, rad: a right angle is a guess. Half of it is 45 degrees, where
/// `confidence_min` leaves the arm out. Assumption.
const GUESS_RAD: f64 = FRAC_PI_2;
/// Speed of a limb that is not in doubt, rad/s. Only a throw is faster: a straight arm of 0.7 m then has 8 m/s. Assumption.
const TURN_RAD_PER_S: f64 = 12.0;
/// Expected angles up to which a limb has this speed, and from which it holds, rad: 20 and 50 degrees. The mean is 16. Assumption.
const DOUBT_RAD: [f64; 2] = [0.349, 0.873];
/// Time over which doubt is averaged, s. An arm that is hidden for a moment holds and comes back. Assumption.
const DOUBT_S: f64 = 2.0;
/// Time without an image after which the limbs before it say nothing, ns. A person who comes back is believed at once.
const FORGOTTEN_NS: u64 = 250_000_000;
/// Age of the image before up to which one is refused that turns the trunk by more than a right angle, ns: one image of 27 to 53 Hz.
/// The next one must count: after 75 ms the validation knows no front any more, and after 100 ms the robot stops.
const SWAPPED_NS: u64 = 37_000_000;
/// Distance of the trunk's centre from that of the image before, over the trunk's size, that shows another person, and its rise
/// by the time between. Of 84 clips of one person each, at 30 Hz, the largest is 0.48. At 4 m/s a runner passes 0.3.
const OTHER_PLACE: [f64; 2] = [0.5, 3.0];
/// The same for the distance from where the trunk was of late: a landmarker may also glide from one person to another.
const OTHER_RECENT: [f64; 2] = [1.2, 3.0];
/// Time over which the place of late is taken, s.
const RECENT_S: f64 = 0.25;
/// The same for the change of the logarithm of the trunk's size. The largest was 0.57.
const OTHER_SIZE: [f64; 2] = [0.7, 2.0];
/// Time by which these bounds rise at most, s.
const OTHER_MAX_S: f64 = 0.5;
/// Limbs of the arms: the first directions.
const ARM_LIMBS: usize = 4;

/// Result of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lift {
    /// The frame has the directions of the image.
    Done,
    /// The image has no shoulders and hips.
    NoTrunk,
    /// The trunk turned by more than a right angle at once. The frame is to be refused.
    Swapped,
}

/// One person in the last image: place and limbs. Only images whose frames were accepted belong here.
#[derive(Clone, Copy, Debug, Default)]
pub struct LastImage {
    person: (u64, u32, u32),
    origin_ns: u64,
    /// Our time at which the last image arrived, ns.
    arrived_ns: u64,
    /// The trunk's centre and size in the image. `None` before the first one.
    trunk: Option<([f64; 2], f64)>,
    /// The trunk's centre of late.
    recent: [f64; 2],
    directions: [Vector3<f64>; ARM_LIMBS],
    /// The trunk's axes, R.
    axes: Matrix3<f64>,
    /// Time over which the doubt is known, s.
    known_s: f64,
    doubt_rad: [f64; ARM_LIMBS],
}

impl LastImage {
    /// Returns true if an image that arrives at `now` shows another person than the last one. A client's stamps do not count.
    pub fn is_other(&self, image: &ImagePoints, now: Stamp, frame: &RawSkeleton) -> bool {
        let known = self.trunk.filter(|_| self.person == person(frame));
        let Some(((before, size_before), (centre, size))) = known.zip(image.trunk()) else { return false };
        let since_s = (now.0.saturating_sub(self.arrived_ns) as f64 * 1e-9).min(OTHER_MAX_S);
        let most = |[least, per_s]: [f64; 2]| least + per_s * since_s;
        let far = |from: [f64; 2]| (centre[0] - from[0]).hypot(centre[1] - from[1]) / size_before;
        far(before) > most(OTHER_PLACE)
            || far(self.recent) > most(OTHER_RECENT)
            || (size / size_before).ln().abs() > most(OTHER_SIZE)
    }

    /// Keeps where the trunk is in an image that arrived at `now`.
    fn place(&mut self, image: &ImagePoints, now: Stamp) {
        let Some((centre, size)) = image.trunk() else { return };
        let since_s = now.0.saturating_sub(self.arrived_ns) as f64 * 1e-9;
        let share = if self.trunk.is_some() { (since_s / RECENT_S).min(1.0) } else { 1.0 };
        self.recent = [0, 1].map(|i| self.recent[i] + (centre[i] - self.recent[i]) * share);
        (self.trunk, self.arrived_ns) = (Some((centre, size)), now.0);
    }

    /// Bounds the turns of trunk and limbs since the last image, and averages the limbs' doubt. Images out of order turn nothing.
    /// Returns false if the image is refused.
    fn steady(&mut self, lifted: &mut Lifted, axes: &mut Matrix3<f64>, frame: &RawSkeleton) -> bool {
        let person = person(frame);
        let expected: [f64; ARM_LIMBS] = std::array::from_fn(|i| lifted.expected_rad(i));
        let since_ns = frame.header.origin.0.saturating_sub(self.origin_ns);
        if person != self.person || frame.header.origin.0.abs_diff(self.origin_ns) > FORGOTTEN_NS {
            let directions = std::array::from_fn(|i| lifted.directions[i]);
            let origin_ns = frame.header.origin.0;
            let trunk = self.trunk.filter(|_| person == self.person);
            *self =
                Self { person, origin_ns, trunk, directions, axes: *axes, known_s: 0.0, doubt_rad: expected, ..*self };
            return true;
        }
        self.origin_ns = self.origin_ns.max(frame.header.origin.0);
        let since_s = since_ns as f64 * 1e-9;
        self.known_s = (self.known_s + since_s).min(DOUBT_S);
        let turn = Rotation3::from_matrix_unchecked(*axes * self.axes.transpose());
        let turn = UnitQuaternion::from_rotation_matrix(&turn).scaled_axis();
        let most = TURN_RAD_PER_S * since_s;
        if turn.norm() > most {
            if turn.norm() > FRAC_PI_2 && (1..=SWAPPED_NS).contains(&since_ns) {
                return false;
            }
            *axes = Rotation3::new(turn.cap_magnitude(most)) * self.axes;
        }
        self.axes = *axes;
        for (i, expected) in expected.into_iter().enumerate() {
            let [sure, unsure] = DOUBT_RAD;
            let most = TURN_RAD_PER_S * since_s * ((unsure - expected) / (unsure - sure)).clamp(0.0, 1.0);
            lifted.directions[i] = turned(self.directions[i], lifted.directions[i], most);
            self.directions[i] = lifted.directions[i];
            self.doubt_rad[i] += (expected - self.doubt_rad[i]) * (since_s / self.known_s.max(1e-9));
        }
        true
    }
}

fn person(frame: &RawSkeleton) -> (u64, u32, u32) {
    (frame.session_nonce, frame.operator_id, frame.layout)
}

/// Turns a unit vector toward another one by at most this angle, rad. Opposite ones have no way between them, so it stays.
fn turned(from: Vector3<f64>, to: Vector3<f64>, most: f64) -> Vector3<f64> {
    let axis = from.cross(&to);
    let angle = axis.norm().atan2(from.dot(&to));
    if angle <= most {
        return to;
    }
    Unit::try_new(axis, 1e-9).map_or(from, |axis| Rotation3::from_axis_angle(&axis, most) * from)
}

impl Lifter {
    /// Lifts the image, and gives the frame of SMPL-22 the directions and the confidence of its arms. Leaves the frame where
    /// the image is not [`Lift::Done`]. `lengths` are those of the session. The image arrives at `now`. Never allocates or
    /// panics, whatever the bits.
    pub fn apply(
        &self,
        image: &ImagePoints,
        lengths: Option<[f64; LENGTHS]>,
        now: Stamp,
        last: &mut LastImage,
        frame: &mut RawSkeleton,
    ) -> Lift {
        let lifted = self.lift(image, lengths);
        let Some((mut lifted, mut axes)) = lifted.and_then(|lifted| Some((lifted, ours(lifted.trunk()?)))) else {
            return Lift::NoTrunk;
        };
        if !last.steady(&mut lifted, &mut axes, frame) {
            return Lift::Swapped;
        }
        last.place(image, now);
        place(&lifted, &axes, &last.doubt_rad, frame);
        Lift::Done
    }
}

/// Turns the camera's axes to ours.
fn ours(axes: Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[0, 1, 2].map(|i| Vector3::from(FACING.polar(axes.column(i).into_owned().into()))))
}

fn place(lifted: &Lifted, axes: &Matrix3<f64>, doubt_rad: &[f64; ARM_LIMBS], frame: &mut RawSkeleton) {
    let at = |joint: Smpl| {
        let place = Vector3::from(frame.positions[joint as usize]).map(f64::from);
        (frame.confidence[joint as usize] > 0.0 && place.iter().all(|x| x.is_finite())).then_some(place)
    };
    let middle = |a: Smpl, b: Smpl| Some((at(a)? + at(b)?) / 2.0);
    let [hips, shoulders] =
        [[Smpl::LeftHip, Smpl::RightHip], [Smpl::LeftShoulder, Smpl::RightShoulder]].map(|[a, b]| middle(a, b));
    let is_flat = hips.is_none() || shoulders.is_none();
    let hips = hips.unwrap_or_default();
    let trunk_m = shoulders.map_or(TRUNK_M, |shoulders| (shoulders - hips).norm()).max(1e-3);
    let share = |from: Smpl, to: Smpl, typical: f64| {
        let own = at(from).zip(at(to)).map(|(from, to)| (to - from).norm() / trunk_m);
        own.filter(|own| (BONE_PER_TRUNK[0]..=BONE_PER_TRUNK[1]).contains(own)).unwrap_or(typical)
    };
    let [across, up] = [axes.column(0).into_owned(), axes.column(1).into_owned()];
    let shoulders = hips + up * trunk_m;
    let mut set = [None; SMPL_JOINTS];
    let sides = [
        (1.0, [Smpl::LeftHip, Smpl::LeftShoulder, Smpl::LeftElbow, Smpl::LeftWrist], Smpl::LeftCollar, 0),
        (-1.0, [Smpl::RightHip, Smpl::RightShoulder, Smpl::RightElbow, Smpl::RightWrist], Smpl::RightCollar, 1),
    ];
    let mut confidence = [None; SMPL_JOINTS];
    for (side, [hip, shoulder, elbow, wrist], collar, arm) in sides {
        let shoulder_at = shoulders + across * (side * SHOULDERS * trunk_m / 2.0);
        let elbow_at = shoulder_at + axes * lifted.directions[arm] * (share(shoulder, elbow, TYPICAL[0]) * trunk_m);
        let wrist_at = elbow_at + axes * lifted.directions[2 + arm] * (share(elbow, wrist, TYPICAL[1]) * trunk_m);
        set[hip as usize] = Some(hips + across * (side * HIPS * trunk_m / 2.0));
        set[shoulder as usize] = Some(shoulder_at);
        set[collar as usize] = Some(shoulders + (shoulder_at - shoulders) * COLLAR);
        set[elbow as usize] = Some(elbow_at);
        set[wrist as usize] = Some(wrist_at);
        let sure = |limb: usize| (1.0 - doubt_rad[limb] / GUESS_RAD).clamp(0.0, 1.0) as f32;
        confidence[elbow as usize] = Some(sure(arm));
        confidence[wrist as usize] = Some(sure(arm).min(sure(2 + arm)));
        if is_flat {
            (confidence[hip as usize], confidence[shoulder as usize]) = (Some(1.0), Some(1.0));
        }
    }
    for (joint, share) in UP_THE_TRUNK {
        set[joint] = Some(hips + (shoulders - hips) * share);
    }
    if is_flat {
        set[Smpl::Head as usize] = Some(shoulders + up * (0.4 * trunk_m));
    }
    for joint in 0..SMPL_JOINTS {
        if let Some(place) = set[joint] {
            frame.positions[joint] = place.map(|x| x as f32).into();
            let known = if is_flat { 1.0 } else { frame.confidence[joint] };
            frame.confidence[joint] = confidence[joint].unwrap_or(known);
        }
    }
}
