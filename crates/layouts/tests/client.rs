//! A standing person, and how clients of every layout would send that person. It uses matrices and joint names,
//! while the crate uses signs, permutations and indices.

use layouts::{Direction, Layouts, Refusal};
use messages::{
    Header, HingeCalibration, Layout, RawSkeleton, SMPL_JOINTS, SMPL_NAMES, Skeleton, SkeletonLayout, Stamp,
    calibration_flag, raw_flag,
};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use skeleton::{Config, DropReason, Input, State, tick};

/// A layout of cameras, and the time between two of their images, ns: 30 Hz.
pub(crate) const CAMERA: u32 = SkeletonLayout::MediaPipe33 as u32;
pub(crate) const PERIOD_NS: u64 = 33_333_333;

/// Image `i` of the standing person.
pub(crate) fn frame(i: u64) -> RawSkeleton {
    let mut raw = as_smpl(&bent(), false);
    raw.header.sequence = i + 1;
    raw.header.origin = Stamp(1_000_000_000 + i * PERIOD_NS);
    raw
}

pub(crate) type Place = Vector3<f64>;
pub(crate) type Turn = Matrix3<f64>;

/// Positions, m, and global rotations, in our frame.
#[derive(Clone)]
pub(crate) struct Person {
    pub(crate) places: [Place; SMPL_JOINTS],
    pub(crate) turns: [Turn; SMPL_JOINTS],
}

pub(crate) fn about(axis: [f64; 3], angle: f64) -> Turn {
    Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(Vector3::from(axis)), angle).into_inner()
}

/// Arms stretched sideways, with these turns: left upper arm, left forearm, right upper arm, right forearm.
pub(crate) fn person([left, left_fore, right, right_fore]: [Turn; 4]) -> Person {
    // The trunk has the lean that `skeleton` counts as upright.
    let lean = -0.5 * skeleton::TORSO_LEAN_RAD.tan();
    let standing: [[f64; 3]; 18] = include!("../../skeleton/tests/person/standing.in");
    let mut places = [Place::zeros(); SMPL_JOINTS];
    places.iter_mut().zip(standing).for_each(|(place, at)| *place = at.into());
    let mut turns = [Turn::identity(); SMPL_JOINTS];
    for (shoulder, outwards, upper, fore) in [(16, 1.0, left, left_fore), (17, -1.0, right, right_fore)] {
        places[shoulder + 2] = places[shoulder] + upper * Vector3::new(0.0, 0.3 * outwards, 0.0);
        places[shoulder + 4] = places[shoulder + 2] + fore * Vector3::new(0.0, 0.26 * outwards, 0.0);
        (turns[shoulder], turns[shoulder + 2], turns[shoulder + 4]) = (upper, fore, fore);
    }
    Person { places, turns }
}

pub(crate) fn t_pose() -> Person {
    person([Turn::identity(); 4])
}

/// The left arm is half raised with the elbow bent to the front. The right one hangs with the elbow bent a little.
/// So the sides cannot be confused.
pub(crate) fn bent() -> Person {
    let (left, right) = (about([1.0, 0.2, 0.0], 0.5), about([1.0, -0.1, 0.3], 1.1));
    person([left, left * about([0.0, 0.3, -1.0], 1.0), right, right * about([0.0, 0.2, 1.0], 0.4)])
}

/// Directions of a client's axes x, y, z, as rows in our frame.
pub(crate) fn axes(directions: [Direction; 3]) -> Turn {
    let row = |direction| match direction {
        Direction::Forward => [1.0, 0.0, 0.0],
        Direction::Back => [-1.0, 0.0, 0.0],
        Direction::Left => [0.0, 1.0, 0.0],
        Direction::Right => [0.0, -1.0, 0.0],
        Direction::Up => [0.0, 0.0, 1.0],
        Direction::Down => [0.0, 0.0, -1.0],
    };
    Matrix3::from_rows(&directions.map(|direction| Vector3::from(row(direction)).transpose()))
}

/// A client: its layout's number and joints in order, and its names for the joints of SMPL-22 in their order. A joint that it
/// does not have is a dash.
pub(crate) struct Client {
    pub(crate) number: u32,
    pub(crate) joints: Vec<String>,
    pub(crate) names: Vec<String>,
    pub(crate) axes: Turn,
    pub(crate) units_per_m: f64,
    pub(crate) w_first: bool,
    pub(crate) rotations: bool,
    pub(crate) confidence: f32,
}

impl Client {
    /// A client that sends metres, x y z w and full confidence.
    pub(crate) fn new(number: SkeletonLayout, joints: &str, names: &str, directions: [Direction; 3]) -> Self {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect();
        Self {
            number: number as u32,
            joints: words(joints),
            names: words(names),
            axes: axes(directions),
            units_per_m: 1.0,
            w_first: false,
            rotations: true,
            confidence: 1.0,
        }
    }

    pub(crate) fn index(&self, smpl: usize) -> Option<usize> {
        let name = Some(&self.names[smpl]).filter(|name| *name != "-")?;
        Some(self.joints.iter().position(|joint| joint == name).expect("a joint of the layout"))
    }

    pub(crate) fn turn(&self, raw: &mut RawSkeleton, index: usize, turn: Turn) {
        let q = UnitQuaternion::from_matrix(&turn);
        let numbers = if self.w_first { [q.w, q.i, q.j, q.k] } else { [q.i, q.j, q.k, q.w] };
        raw.rotations[index] = numbers.map(|x| x as f32);
    }

    /// A frame in which every number is NaN.
    pub(crate) fn frame(&self) -> RawSkeleton {
        let mut raw = RawSkeleton::ZERO;
        raw.header = Header { sequence: 1, origin: Stamp(1_000_000_000), ..Header::ZERO };
        (raw.session_nonce, raw.operator_id) = (7, 1);
        raw.layout = self.number;
        raw.joint_count = self.joints.len() as u32;
        raw.positions = [[f32::NAN; 3]; _];
        raw.rotations = [[f32::NAN; 4]; _];
        raw.confidence[..self.joints.len()].fill(self.confidence);
        raw
    }

    /// The person as this client sends them. Joints that SMPL-22 does not have are NaN. `rest` turns the frame of
    /// every joint, as if the T-pose were not the identity.
    pub(crate) fn send(&self, person: &Person, rest: Turn) -> RawSkeleton {
        let mut raw = self.frame();
        for smpl in 0..SMPL_JOINTS {
            let Some(index) = self.index(smpl) else { continue };
            let place = self.axes * person.places[smpl] * self.units_per_m;
            raw.positions[index] = [place.x as f32, place.y as f32, place.z as f32];
            if self.rotations {
                self.turn(&mut raw, index, self.axes * person.turns[smpl] * self.axes.transpose() * rest);
            }
        }
        // The ears are at the position of the head.
        for ear in (0..self.joints.len()).filter(|&joint| self.joints[joint].ends_with("_ear")) {
            let place = self.axes * person.places[15] * self.units_per_m;
            raw.positions[ear] = [place.x as f32, place.y as f32, place.z as f32];
        }
        if self.rotations {
            raw.flags = raw_flag::ROTATIONS;
            raw.calibration = hinges(&(rest.transpose() * self.axes * self.axes.determinant()));
        }
        raw
    }
}

/// Hinges of a T-pose. In our frame they are (0, 0, -1) left and (0, 0, 1) right. Here they are in another frame.
pub(crate) fn hinges(theirs_from_ours: &Turn) -> HingeCalibration {
    let mut hinges = HingeCalibration::ZERO;
    for (limb, z) in [-1.0, -1.0, 1.0, 1.0].into_iter().enumerate() {
        let axis = theirs_from_ours * Vector3::new(0.0, 0.0, z);
        hinges.hinge[limb] = [axis.x as f32, axis.y as f32, axis.z as f32];
    }
    hinges.flags = calibration_flag::ALL;
    hinges
}

/// The person as SMPL-22 in our frame, without the crate's conversion.
pub(crate) fn as_smpl(person: &Person, rotations: bool) -> RawSkeleton {
    let ours = [Direction::Forward, Direction::Left, Direction::Up];
    let smpl = SMPL_NAMES.join(" ");
    let client = Client { rotations, ..Client::new(SkeletonLayout::Smpl22, &smpl, &smpl, ours) };
    client.send(person, Turn::identity())
}

pub(crate) fn judge(raw: &RawSkeleton) -> Result<Skeleton, DropReason> {
    let now = raw.header.origin.plus_ns(1_000_000);
    let out = tick(&Config::default(), &mut State::default(), now, Input { raw, stored: None });
    out.skeleton.ok_or_else(|| out.drop.expect("accepted or dropped"))
}

/// Converts and judges a frame.
pub(crate) fn accept(layouts: &Layouts, raw: &RawSkeleton) -> Result<Skeleton, DropReason> {
    let converted = layouts.convert(raw).map_err(|refusal| match refusal {
        Refusal::Layout => DropReason::Layout,
        Refusal::Count => DropReason::Count,
    })?;
    judge(&converted)
}

/// Largest difference between two persons' limbs, over the components of their quaternions.
pub(crate) fn limbs_differ(a: &Skeleton, b: &Skeleton) -> f32 {
    assert_eq!(a.flags, b.flags);
    let pairs = a.limbs.iter().flatten().zip(b.limbs.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}
