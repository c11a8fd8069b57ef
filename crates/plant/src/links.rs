//! The robot's links with all that they carry, and the torques of a motion.

use crate::description::Body;
use crate::dynamics::{Dynamics, Posture};
use crate::error::PlantError;
use crate::kinematics::Frames;
use crate::motor::Motor;
use messages::JOINTS_MAX;

/// Name of the options in errors.
pub(crate) const OPTIONS: &str = "plant options";
/// Largest mass of a load, kg.
const LOAD_MAX_KG: f64 = 20.0;

/// The links of a robot, by this crate's own reader of its files.
#[derive(Clone, Debug)]
pub struct Links {
    pub(crate) body: Body,
    pub(crate) dynamics: Dynamics,
    pub(crate) motors: [Motor; JOINTS_MAX],
    /// The dynamics without the payload of the hands, if they carry one. The drives' gravity model is this.
    unloaded: Option<Dynamics>,
}

impl Links {
    /// Reads a robot file and its URDF. `hands_kg` is the true payload of the left and the right hand, kg. Without a value
    /// it is the robot file's.
    pub fn from_text(
        (toml_name, toml): (&str, &str),
        (urdf_name, urdf): (&str, &str),
        hands_kg: [Option<f64>; 2],
    ) -> Result<Self, PlantError> {
        Self::new(Body::from_text(toml_name, toml, urdf_name, urdf)?, hands_kg)
    }

    pub(crate) fn new(mut body: Body, hands_kg: [Option<f64>; 2]) -> Result<Self, PlantError> {
        let motors: [Motor; JOINTS_MAX] = std::array::from_fn(|j| body.joints.get(j).map_or(Motor::NONE, Motor::new));
        let armature = motors.map(|motor| motor.armature);
        let mut unloaded = None;
        for (side, last) in body.hands.into_iter().enumerate() {
            let in_file_kg = body.payloads[side].map_or(0.0, |(mass_kg, _)| mass_kg);
            let mass_kg = mass(["hands_kg left", "hands_kg right"][side], hands_kg[side].unwrap_or(in_file_kg))?;
            if mass_kg > 0.0 {
                let file =
                    ["payload.left.centre_m of the robot file", "payload.right.centre_m of the robot file"][side];
                let (_, place) = body.payloads[side].ok_or_else(|| PlantError::missing(OPTIONS, file))?;
                unloaded.get_or_insert_with(|| Dynamics::new(&body, armature));
                body.add_mass(last, place, mass_kg);
            }
        }
        Ok(Self { dynamics: Dynamics::new(&body, armature), unloaded, body, motors })
    }

    /// Returns the robot's description.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Returns the torques of the links in a motion, N m or N. See [`Dynamics::torques`].
    pub fn torques(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut frames = Frames::default();
        self.body.forward(q, &mut frames);
        self.dynamics.torques(&self.dynamics.at(&frames), v, a)
    }

    /// Returns what the drives' model knows of each joint: gravity without the loads (N m, N) and inertia (kg m^2, kg).
    pub(crate) fn drive_model(&self, frames: &Frames, posture: &Posture) -> ([f64; JOINTS_MAX], [f64; JOINTS_MAX]) {
        let (gravity, diagonal) = self.dynamics.gravity_and_diagonal(posture);
        let unloaded = self.unloaded.as_ref().map(|known| known.gravity_and_diagonal(&known.at(frames)).0);
        (unloaded.unwrap_or(gravity), diagonal)
    }

    /// Returns the largest torque or force on each joint that its drive does not know, over the inertia that it knows, at
    /// this posture and these speeds, rad/s^2 or m/s^2. [`crate::Config::lags`] has the derivation.
    pub(crate) fn disturbances(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let (mut frames, joints) = (Frames::default(), &self.body.joints);
        self.body.forward(q, &mut frames);
        let posture = self.dynamics.at(&frames);
        let (gravity, inertia) = self.drive_model(&frames, &posture);
        let matrix = self.dynamics.mass_matrix(&posture);
        let coasting = self.dynamics.torques(&posture, v, &[0.0; JOINTS_MAX]);
        std::array::from_fn(|j| {
            let pushes = joints.iter().zip(&matrix[j]).map(|(joint, coupled)| coupled.abs() * joint.limits.a_max);
            let neighbours = pushes.enumerate().filter(|(k, _)| *k != j).map(|(_, push)| push).sum::<f64>();
            (neighbours + (coasting[j] - gravity[j]).abs() + self.motors[j].friction_max(v[j])) / inertia[j]
        })
    }
}

/// Returns `mass_kg` if a load may have that mass.
fn mass(key: &str, mass_kg: f64) -> Result<f64, PlantError> {
    let allowed = (0.0..=LOAD_MAX_KG).contains(&mass_kg);
    let bound = || format!("must be between 0 and {LOAD_MAX_KG}");
    if allowed { Ok(mass_kg) } else { Err(PlantError::value(OPTIONS, key, mass_kg, bound())) }
}
