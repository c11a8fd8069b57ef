//! Settings of a plant.

use crate::description::Body;
use crate::error::PlantError;
use crate::gripper::Gripper;
use crate::links::{Links, OPTIONS};
use crate::plant::{DELAY_MAX_NS, STEP_NS};
use messages::{JOINTS_MAX, TICK_HZ};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// The longest transport delay that settings allow, ticks: 20 ms, the cycle of the slowest interface that the robot
/// offers.
pub const DELAY_MAX_TICKS: u32 = 30;

/// Largest standard deviation of the encoders' noise that settings allow, rad. The driver takes changes up to 0.4 mrad
/// for noise, four times as much.
pub const ENCODER_NOISE_MAX_RAD: f64 = 1e-4;

/// Change of a lag within the loop's memory of 1 / omega, 11 ms, rad or m. It was 0.05 mrad at most, in 67 s of sines at
/// all limits of each shipped robot (2026-12-01).
const LAG_CHANGE: f64 = 1e-4;

/// Largest width of an object between fingers, m: that of the widest gripper.
pub const OBJECT_MAX_M: f64 = 0.5;

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

impl Reaction {
    /// Returns the longest watchdog time that settings allow, ms. Until the watchdog fires, drives carry the last
    /// acceleration on. Then the played stop begins where it should be by that time. At 9.6 rad/s^2 and 20 ms their speeds
    /// differ by 0.2 rad/s. At 100 ms the robot goes 70 mrad beyond the end of the stop.
    pub const fn watchdog_max_ms(self) -> f64 {
        match self {
            Self::Play => 20.0,
            Self::Hold | Self::Damp => 1000.0,
        }
    }
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
    /// Standard deviation of a measured position, rad, or a fifth of it in m. Assumption: one encoder step of 17 bits.
    pub encoder_noise_rad: f64,
    /// Step of a measured position, rad, or a fifth of it in m. Assumption: 17 bits per turn.
    pub encoder_step_rad: f64,
    /// True payload of the left and the right hand, kg. Without a value it is the robot file's. Its place is the
    /// robot file's.
    pub hands_kg: [Option<f64>; 2],
    /// Obstacles around the robot.
    pub obstacles: Vec<Obstacle>,
    /// The grippers of the left and the right hand.
    pub grippers: [Option<Gripper>; 2],
    /// Width of the object between the fingers of each gripper, m. Zero for none.
    pub object_width_m: f64,
    /// The robot may start outside its limits or too close to itself. The judge then counts only motion further out.
    pub initial_outside: bool,
}

impl Default for Options {
    fn default() -> Self {
        let step_rad = std::f64::consts::TAU / f64::from(1 << 17);
        Self {
            natural_frequency_hz: 15.0,
            damping_ratio: 1.0,
            delay_ns: 2_000_000_000 / TICK_HZ,
            watchdog_ns: 10_000_000,
            reaction: Reaction::Play,
            encoder_noise_rad: step_rad,
            encoder_step_rad: step_rad,
            hands_kg: [None; 2],
            obstacles: Vec::new(),
            grippers: [None; 2],
            object_width_m: 0.0,
            initial_outside: false,
        }
    }
}

/// Settings of a robot's body, checked.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) links: Links,
    /// Natural frequency of the position loops, rad/s.
    pub(crate) omega: f64,
    pub(crate) options: Options,
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
    pub fn new(body: Body, options: &Options) -> Result<Self, PlantError> {
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
        within("object_width_m", options.object_width_m, 0.0, OBJECT_MAX_M)?;
        let links = Links::new(body, options.hands_kg)?;
        Ok(Self { links, omega: std::f64::consts::TAU * natural_hz, options: options.clone() })
    }

    /// Returns the robot.
    pub fn body(&self) -> &Body {
        &self.links.body
    }

    /// Returns the links with all that they carry.
    pub fn links(&self) -> &Links {
        &self.links
    }

    /// Returns the home posture, rad or m.
    pub fn home(&self) -> &[f64; JOINTS_MAX] {
        &self.links.body.home
    }

    /// Returns the largest distance of each joint from its setpoint at a posture and speeds, rad or m.
    ///
    /// A drive knows gravity and its own inertia M_jj, not its neighbours. So its distance e from the setpoint obeys
    /// `M_jj (e'' + 2 zeta omega e' + omega^2 e) = sum_(k != j) M_jk a_k + C_j(q, v) + friction_j + load_j`. At a damping
    /// ratio of 1 this loop answers an impulse with t exp(-omega t), which is never negative. Its integral is 1 / omega^2,
    /// so |e| is at most the largest right side over M_jj omega^2. Below 1 the answer swings, and the integral of its
    /// magnitude is coth(pi zeta / (2 sqrt(1 - zeta^2))) times as large. Assumption: every neighbour accelerates by its
    /// limit in force, in the worse direction.
    pub fn lags(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let zeta = self.options.damping_ratio;
        let swing = (FRAC_PI_2 * zeta / (1.0 - zeta * zeta).max(0.0).sqrt()).tanh();
        self.links.disturbances(q, v).map(|most| most / (swing * self.omega * self.omega) + LAG_CHANGE)
    }
}
