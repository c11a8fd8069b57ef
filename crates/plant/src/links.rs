//! The robot's links with all that they carry, and the torques of a motion.

use crate::description::Body;
use crate::dynamics::Dynamics;
use crate::error::PlantError;
use crate::kinematics::Frames;
use crate::motor::Motor;
use messages::JOINTS_MAX;
use nalgebra::Vector3;

/// Name of the options in errors.
pub(crate) const OPTIONS: &str = "plant options";
/// Largest mass of a load, kg.
const LOAD_MAX_KG: f64 = 20.0;

/// A load that the drives' model does not contain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Load {
    pub(crate) body: usize,
    pub(crate) place: Vector3<f64>,
    pub(crate) mass_kg: f64,
}

/// The links of a robot, by this crate's own reader of its files.
#[derive(Clone, Debug)]
pub struct Links {
    pub(crate) body: Body,
    pub(crate) dynamics: Dynamics,
    pub(crate) motors: [Motor; JOINTS_MAX],
    pub(crate) loads: Vec<Load>,
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
        let mut loads = Vec::new();
        for (side, last) in body.hands.into_iter().enumerate() {
            let in_file_kg = body.payloads[side].map_or(0.0, |(mass_kg, _)| mass_kg);
            let mass_kg = mass(["hands_kg left", "hands_kg right"][side], hands_kg[side].unwrap_or(in_file_kg))?;
            if mass_kg > 0.0 {
                let file =
                    ["payload.left.centre_m of the robot file", "payload.right.centre_m of the robot file"][side];
                let (_, place) = body.payloads[side].ok_or_else(|| PlantError::missing(OPTIONS, file))?;
                loads.push(Load { body: last, place, mass_kg });
                body.add_mass(last, place, mass_kg);
            }
        }
        let motors: [Motor; JOINTS_MAX] = std::array::from_fn(|j| body.joints.get(j).map_or(Motor::NONE, Motor::new));
        Ok(Self { dynamics: Dynamics::new(&body, motors.map(|motor| motor.armature)), body, motors, loads })
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
}

/// Returns `mass_kg` if a load may have that mass.
fn mass(key: &str, mass_kg: f64) -> Result<f64, PlantError> {
    let allowed = (0.0..=LOAD_MAX_KG).contains(&mass_kg);
    let bound = || format!("must be between 0 and {LOAD_MAX_KG}");
    if allowed { Ok(mass_kg) } else { Err(PlantError::value(OPTIONS, key, mass_kg, bound())) }
}
