//! Tables, floors and walls around the robot. They are given in the base's frame, and not in the torso's,
//! which lifts. They are no longer valid when the base moves.

use crate::error::RobotError;
use crate::kinematics::Frames;
use crate::model::Model;
use crate::pose::Pose;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Largest number of planes of an environment.
pub const PLANES_MAX: usize = 8;
/// Largest number of boxes of an environment.
pub const BOXES_MAX: usize = 8;
/// Largest number of characters in the name of a plane or box.
pub const NAME_CHARACTERS_MAX: usize = 64;
/// Objects farther away than this are out of any arm's reach, m.
const FAR_M: f64 = 10.0;
/// Largest difference of a normal's length from 1. It allows for a few digits in a file.
const NORMAL_TOLERANCE: f64 = 1e-3;

/// Obstacles of the settings file. All values are in metres, in the base's frame.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Floors and walls.
    #[serde(default)]
    pub planes: Vec<PlaneEntry>,
    /// Tables and cupboards.
    #[serde(default)]
    pub boxes: Vec<BoxEntry>,
}

/// The floor alone.
impl Default for Environment {
    fn default() -> Self {
        Self { planes: vec![PlaneEntry::default()], boxes: Vec::new() }
    }
}

/// Reads exactly three numbers. An array alone would drop what follows the third.
fn three<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<[f64; 3], D::Error> {
    let numbers = Vec::<f64>::deserialize(deserializer)?;
    let count = numbers.len();
    numbers.try_into().map_err(|_| serde::de::Error::invalid_length(count, &"3 numbers"))
}

schema::table! {
    /// Floors and walls, in the frame of the robot's base (`base_footprint`), not of the torso, which lifts. They are void
    /// when the base moves. All x with normal . x <= offset is solid. At most 8. Every capsule that moves keeps the robot
    /// file's `clearance_min_mm` from them. A file without any has the header `[environment]` alone.
    pub struct PlaneEntry {
        /// Unique name of 1 to 64 characters, none of them a control character.
        name: String = "floor".to_owned();
        /// Unit vector that points out of the solid half. Its length is 1 within 0.001.
        #[serde(deserialize_with = "three")]
        normal: [f64; 3] = [0.0, 0.0, 1.0];
        /// Distance of the surface from the base's origin along the normal, m. -10 to 10.
        offset_m: f64 = 0.0;
    }
}

schema::table! {
    /// Tables and cupboards, in the same frame and kept clear in the same way. At most 8.
    pub struct BoxEntry {
        /// Unique name of 1 to 64 characters, none of them a control character.
        name: String = "table".to_owned();
        /// Centre, m. Each -10 to 10. The default is the top of a table, 0.7 m ahead.
        #[serde(deserialize_with = "three")]
        center_m: [f64; 3] = [1.1, 0.0, 0.73];
        /// Lengths of the edges, m. Each 0.001 to 20.
        #[serde(deserialize_with = "three")]
        size_m: [f64; 3] = [0.8, 1.6, 0.04];
        /// Roll, pitch and yaw, degrees, with R = Rz(yaw) Ry(pitch) Rx(roll). Each -360 to 360. Without it the edges are
        /// parallel to the base's axes.
        #[serde(default, deserialize_with = "three")]
        rpy_deg: [f64; 3] = [0.0; 3];
    }
}

/// A solid that does not move, in the base frame, m.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the equations describe the fields")]
pub enum Solid {
    /// All x with normal . x <= offset_m. The unit normal points out of the solid.
    HalfSpace { normal: Vector3<f64>, offset_m: f64 },
    /// All center + r y with |y_i| <= half_m_i.
    Box { center: Vector3<f64>, r: Matrix3<f64>, half_m: Vector3<f64> },
}

/// An object that every moving capsule must keep clear of.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Unique name.
    pub name: String,
    /// Its shape.
    pub solid: Solid,
}

impl Solid {
    /// Distance of the segment `a` `b` from the solid, m. It is 0 where it touches a box, and negative below
    /// a plane. Do not call it in a tick.
    ///
    /// The squared distance of a point from a box is convex and has a continuous derivative. So along a
    /// segment its minimum is at an end, or where the derivative changes sign. Bisection finds that point.
    pub fn segment_distance(&self, a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        match self {
            Self::HalfSpace { normal, offset_m } => normal.dot(a).min(normal.dot(b)) - offset_m,
            Self::Box { center, r, half_m } => {
                let (from, along) = (r.tr_mul(&(a - center)), r.tr_mul(&(b - a)));
                let beyond = |s: f64| (from + along * s).zip_map(half_m, |x, half| x - x.clamp(-half, half));
                let (mut low, mut high) = (0.0, 1.0);
                // After 60 halvings, the bracket is shorter than the resolution of a double at 1.
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    *(if beyond(middle).dot(&along) > 0.0 { &mut high } else { &mut low }) = middle;
                }
                [0.0, low, 1.0].iter().map(|s| beyond(*s).norm()).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

impl Model {
    /// Returns the same robot among the obstacles of `environment`. Errors name `file`. It refuses values out
    /// of bounds, and obstacles that are closer to the home posture than commands may come.
    pub fn with_environment(mut self, file: &str, environment: &Environment) -> Result<Self, RobotError> {
        self.obstacles = read(file, environment)?;
        let names = self.capsules.iter().map(|capsule| &capsule.name).collect::<Vec<_>>();
        if let Some(obstacle) = self.obstacles.iter().find(|obstacle| names.contains(&&obstacle.name)) {
            return Err(RobotError::duplicate(file, "environment: name", &obstacle.name));
        }
        let mut frames = Frames::default();
        self.forward(&self.home, &mut frames);
        let (clearance_m, pair) = self.obstacle_clearance(&frames);
        if !(clearance_m >= self.d_min_m) {
            let [capsule, obstacle] = pair.map(|index| self.shape_name(index));
            let key = format!("environment `{obstacle}`: clearance of `{capsule}` at home");
            let bound =
                format!("must be at least the robot file's collision.clearance_min_mm = {} mm", self.d_min_m * 1e3);
            return Err(RobotError::value(file, key, format!("{:.1} mm", clearance_m * 1e3), bound));
        }
        Ok(self)
    }

    /// The least clearance of the moving capsules from the obstacles, m, and the pair as in
    /// [`Model::shape_name`]. It is infinite without obstacles.
    pub fn obstacle_clearance(&self, frames: &Frames) -> (f64, [u32; 2]) {
        let mut least = (f64::INFINITY, [0; 2]);
        // A capsule on the base cannot come closer to a fixed obstacle.
        for (i, capsule) in self.capsules.iter().enumerate().filter(|(_, capsule)| capsule.body != 0) {
            let [a, b] = capsule.ends(frames);
            for (k, obstacle) in self.obstacles.iter().enumerate() {
                let clearance_m = obstacle.solid.segment_distance(&a, &b) - capsule.radius_m;
                if clearance_m < least.0 {
                    least = (clearance_m, [i as u32, (self.capsules.len() + k) as u32]);
                }
            }
        }
        least
    }

    /// Name of one side of a pair in messages. Capsules come first, then the obstacles, in the order of their
    /// files.
    pub fn shape_name(&self, index: u32) -> &str {
        let index = index as usize;
        let capsule = self.capsules.get(index).map(|capsule| capsule.name.as_str());
        let obstacle = || index.checked_sub(self.capsules.len()).and_then(|k| self.obstacles.get(k));
        capsule.or_else(|| obstacle().map(|obstacle| obstacle.name.as_str())).unwrap_or("?")
    }
}

fn read(file: &str, environment: &Environment) -> Result<Vec<Obstacle>, RobotError> {
    let lengths = [
        ("environment.planes", environment.planes.len(), PLANES_MAX),
        ("environment.boxes", environment.boxes.len(), BOXES_MAX),
    ];
    for (key, count, bound) in lengths {
        if count > bound {
            return Err(RobotError::TooMany { file: file.into(), key: key.into(), count, bound });
        }
    }
    let planes = environment.planes.iter().map(|entry| ("environment.planes: name", &entry.name));
    let boxes = environment.boxes.iter().map(|entry| ("environment.boxes: name", &entry.name));
    planes.chain(boxes).try_for_each(|(key, text)| name(file, key, text))?;
    let planes =
        environment.planes.iter().map(|entry| Ok(Obstacle { name: entry.name.clone(), solid: plane(file, entry)? }));
    let boxes =
        environment.boxes.iter().map(|entry| Ok(Obstacle { name: entry.name.clone(), solid: block(file, entry)? }));
    let obstacles = planes.chain(boxes).collect::<Result<Vec<_>, RobotError>>()?;
    for (k, obstacle) in obstacles.iter().enumerate() {
        if obstacles[..k].iter().any(|other| other.name == obstacle.name) {
            return Err(RobotError::duplicate(file, "environment: name", &obstacle.name));
        }
    }
    Ok(obstacles)
}

/// Checks a name. Names are printed with every pair, on terminals too. So they may be neither long nor
/// contain control characters.
fn name(file: &str, key: &str, text: &str) -> Result<(), RobotError> {
    let characters = text.chars().count();
    if (1..=NAME_CHARACTERS_MAX).contains(&characters) && !text.chars().any(char::is_control) {
        return Ok(());
    }
    // The error shows no more characters than a valid name may have.
    let shown = text.chars().take(NAME_CHARACTERS_MAX).collect::<String>().escape_debug().to_string();
    let more = if characters > NAME_CHARACTERS_MAX { "..." } else { "" };
    let bound = format!("must have 1 to {NAME_CHARACTERS_MAX} characters, no control characters, has {characters}");
    Err(RobotError::value(file, key, format!("\"{shown}{more}\""), bound))
}

fn plane(file: &str, entry: &PlaneEntry) -> Result<Solid, RobotError> {
    let key = |name: &str| format!("environment.planes `{}`: {name}", entry.name);
    let normal = Vector3::from(entry.normal);
    let length = normal.norm();
    if !((length - 1.0).abs() <= NORMAL_TOLERANCE) {
        let bound = format!("must have length 1 within {NORMAL_TOLERANCE}, has {length}");
        return Err(RobotError::value(file, key("normal"), format!("{:?}", entry.normal), bound));
    }
    if !(entry.offset_m.abs() <= FAR_M) {
        let bound = format!("must be at most {FAR_M} in magnitude");
        return Err(RobotError::value(file, key("offset_m"), schema::short(entry.offset_m), bound));
    }
    Ok(Solid::HalfSpace { normal: normal / length, offset_m: entry.offset_m })
}

fn block(file: &str, entry: &BoxEntry) -> Result<Solid, RobotError> {
    let key = |name: &str| format!("environment.boxes `{}`: {name}", entry.name);
    // A millimetre is thinner than any board. Two walls of a large room are 2 x 10 m apart.
    let bounds = [
        ("center_m", entry.center_m, -FAR_M, FAR_M),
        ("size_m", entry.size_m, 1e-3, 2.0 * FAR_M),
        ("rpy_deg", entry.rpy_deg, -360.0, 360.0),
    ];
    for (name, values, low, high) in bounds {
        if !values.iter().all(|x| *x >= low && *x <= high) {
            let bound = format!("each must be {low} to {high}");
            return Err(RobotError::value(file, key(name), format!("{values:?}"), bound));
        }
    }
    let pose = Pose::from_xyz_rpy(entry.center_m, entry.rpy_deg.map(f64::to_radians));
    Ok(Solid::Box { center: pose.t, r: pose.r, half_m: Vector3::from(entry.size_m) / 2.0 })
}
