//! Settings of a plant.

use crate::description::{Body, JointKind};
use crate::dynamics::Dynamics;
use crate::error::PlantError;
use crate::kinematics::Frames;
use crate::motor::Motor;
use crate::plant::{DELAY_MAX_NS, STEP_NS};
use messages::{ARM_JOINTS, JOINTS_MAX, TICK_HZ};
use nalgebra::{Matrix3, Vector3};

/// Name of the options in errors.
const OPTIONS: &str = "plant options";

/// Reaction of the drives when setpoints stay away for longer than the watchdog allows. Real robots differ.
#[derive(Clone, Copy, Debug, Default, serde::Deserialize, PartialEq, serde::Serialize, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Reaction {
    /// Each joint brakes its reference at the acceleration limit in force, then holds its place.
    #[default]
    Hold,
    /// The motors only damp, with gravity compensated. Each joint slows down at a rate of a_max / v_max.
    Damp,
    /// The drives play the stop plan that came with the last setpoint, in the plan's own time.
    Play,
}

/// A point mass in a hand. The drives' model does not contain it.
#[derive(Clone, Debug, PartialEq)]
pub struct Payload {
    /// The link whose origin is the place of the mass.
    pub link: String,
    /// Mass, kg.
    pub mass_kg: f64,
}

/// An obstacle around the robot, in the base frame, m.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the equations describe the fields")]
pub enum Obstacle {
    /// Solid where normal . x <= offset_m. The unit normal points out of the solid.
    Plane { normal: Vector3<f64>, offset_m: f64 },
    /// Solid at all center + r y with |y_i| <= half_m_i.
    Box { center: Vector3<f64>, r: Matrix3<f64>, half_m: Vector3<f64> },
}

/// Options. The manufacturer publishes none of these figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Natural frequency of every position loop, Hz. Assumption: 15, an industrial position loop.
    pub natural_frequency_hz: f64,
    /// Damping ratio of every position loop. Assumption: 1, no overshoot.
    pub damping_ratio: f64,
    /// Time from the arrival of a setpoint at the robot to its drives, ns. Assumption: two ticks of 1/1500 s, one
    /// field-bus cycle of 1 ms and its rounding up.
    pub delay_ns: u64,
    /// Time without a setpoint after which the drives react by themselves, ns. A setpoint under way does not
    /// count as silence. Assumption: 10 ms. Franka's controller stops after 20 lost packets of 1 ms, a UR's takes
    /// 20 ms.
    pub watchdog_ns: u64,
    /// The reaction of the drives. Only the way of `Play` is proved.
    pub reaction: Reaction,
    /// Standard deviation of a measured position, rad or m. Assumption: one encoder step of 17 bits.
    pub encoder_noise_rad: f64,
    /// Step of a measured position, rad or m. Assumption: 17 bits per turn.
    pub encoder_step_rad: f64,
    /// Share of the friction that the drives compensate. Assumption: 0.8.
    pub friction_compensated: f64,
    /// Loads at the origins of links, besides the payloads of the hands.
    pub payloads: Vec<Payload>,
    /// True payload of the left and the right hand, kg. Without a value it is the robot file's. Its place is the
    /// robot file's.
    pub hands_kg: [Option<f64>; 2],
    /// Obstacles around the robot.
    pub obstacles: Vec<Obstacle>,
    /// The robot may start outside its limits or too close to itself. The judge then counts only motion further out.
    pub initial_outside: bool,
}

impl Default for Options {
    fn default() -> Self {
        let step_rad = std::f64::consts::TAU / f64::from(1 << 17);
        Self {
            natural_frequency_hz: 15.0,
            damping_ratio: 1.0,
            delay_ns: 2_000_000_000_u64.div_ceil(TICK_HZ),
            watchdog_ns: 10_000_000,
            reaction: Reaction::Play,
            encoder_noise_rad: step_rad,
            encoder_step_rad: step_rad,
            friction_compensated: 0.8,
            payloads: Vec::new(),
            hands_kg: [None; 2],
            obstacles: Vec::new(),
            initial_outside: false,
        }
    }
}

/// A load that the drives' model does not contain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Load {
    pub(crate) body: usize,
    pub(crate) place: Vector3<f64>,
    pub(crate) mass_kg: f64,
}

/// Settings of a robot's body, checked.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) body: Body,
    pub(crate) dynamics: Dynamics,
    pub(crate) motors: [Motor; JOINTS_MAX],
    pub(crate) loads: Vec<Load>,
    pub(crate) obstacles: Vec<Obstacle>,
    /// Natural frequency of the position loops, rad/s.
    pub(crate) omega: f64,
    pub(crate) damping_ratio: f64,
    pub(crate) friction_compensated: f64,
    pub(crate) delay_ns: u64,
    pub(crate) watchdog_ns: u64,
    pub(crate) reaction: Reaction,
    pub(crate) noise: f64,
    pub(crate) encoder_step: f64,
    pub(crate) initial_outside: bool,
}

impl Config {
    /// Reads a robot file and its URDF. Errors name the files.
    pub fn from_text(
        toml_name: &str,
        toml: &str,
        urdf_name: &str,
        urdf: &str,
        options: &Options,
    ) -> Result<Self, PlantError> {
        Self::new(Body::from_text(toml_name, toml, urdf_name, urdf)?, options)
    }

    /// Creates the settings for a robot that was read before.
    pub fn new(mut body: Body, options: &Options) -> Result<Self, PlantError> {
        let within = |key: &str, value: f64, least: f64, most: f64| {
            let bound = || format!("must be between {least} and {most}");
            let inside = value >= least && value <= most;
            if inside { Ok(value) } else { Err(PlantError::value(OPTIONS, key, value, bound())) }
        };
        // Joints that move together feel as little as 0.27 of the inertia that their loops assume. That is the
        // least eigenvalue of the scaled mass matrix over 5000 postures by Pinocchio, 2026-11-23. The loops are
        // stable in steps of h while 2 zeta omega h + (omega h)^2 / 2 < 2 * 0.27.
        let natural_hz = within("natural_frequency_hz", options.natural_frequency_hz, 1.0, 50.0)?;
        within("damping_ratio", options.damping_ratio, 0.1, 1.5)?;
        within("delay_ns", options.delay_ns as f64, 0.0, DELAY_MAX_NS as f64)?;
        within("watchdog_ns", options.watchdog_ns as f64, STEP_NS as f64, 1e9)?;
        within("encoder_noise_rad", options.encoder_noise_rad, 0.0, 0.01)?;
        within("encoder_step_rad", options.encoder_step_rad, 0.0, 0.01)?;
        within("friction_compensated", options.friction_compensated, 0.0, 1.0)?;
        let mut loads = Vec::new();
        for payload in &options.payloads {
            let mass_kg = within("payload mass_kg", payload.mass_kg, 0.0, 20.0)?;
            let at = body.link(&payload.link);
            let (pose_body, pose) =
                at.ok_or_else(|| PlantError::unknown(OPTIONS, "payload link", &payload.link, "a link of the URDF"))?;
            loads.push(Load { body: pose_body, place: pose.t, mass_kg });
            body.add_payload(&payload.link, mass_kg);
        }
        let count = body.joints.len();
        // The arms come last, and body 1 + j moves with joint j.
        for (side, last) in [count - ARM_JOINTS, count].into_iter().enumerate() {
            let key = ["hands_kg left", "hands_kg right"][side];
            let said = body.payloads[side].map_or(0.0, |(mass_kg, _)| mass_kg);
            let mass_kg = within(key, options.hands_kg[side].unwrap_or(said), 0.0, 20.0)?;
            if mass_kg > 0.0 {
                let file =
                    ["payload.left.centre_m of the robot file", "payload.right.centre_m of the robot file"][side];
                let (_, place) = body.payloads[side].ok_or_else(|| PlantError::missing(OPTIONS, file))?;
                loads.push(Load { body: last, place, mass_kg });
                body.add_mass(last, place, mass_kg);
            }
        }
        let motors: [Motor; JOINTS_MAX] = std::array::from_fn(|j| body.joints.get(j).map_or(Motor::NONE, Motor::new));
        Ok(Self {
            dynamics: Dynamics::new(&body, motors.map(|motor| motor.armature)),
            body,
            motors,
            loads,
            obstacles: options.obstacles.clone(),
            omega: std::f64::consts::TAU * natural_hz,
            damping_ratio: options.damping_ratio,
            friction_compensated: options.friction_compensated,
            delay_ns: options.delay_ns,
            watchdog_ns: options.watchdog_ns,
            reaction: options.reaction,
            noise: options.encoder_noise_rad,
            encoder_step: options.encoder_step_rad,
            initial_outside: options.initial_outside,
        })
    }

    /// Returns the robot.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// Returns the dynamics with payloads and rotors.
    pub fn dynamics(&self) -> &Dynamics {
        &self.dynamics
    }

    /// Returns the torques of the links in a motion, N m or N. See [`Dynamics::torques`].
    pub fn torques(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut frames = Frames::default();
        self.body.forward(q, &mut frames);
        self.dynamics.torques(&self.dynamics.at(&frames), v, a)
    }

    /// Returns the home posture, rad or m.
    pub fn home(&self) -> &[f64; JOINTS_MAX] {
        &self.body.home
    }

    /// Returns `turning` for a joint that turns, and `sliding` for one that slides.
    pub(crate) fn by_kind(&self, j: usize, turning: f64, sliding: f64) -> f64 {
        match self.body.joints[j].kind {
            JointKind::Revolute => turning,
            JointKind::Prismatic => sliding,
        }
    }
}
