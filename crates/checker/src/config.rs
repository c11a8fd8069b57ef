//! Settings of a driver and of the checker of its steps.

use crate::clearance::Body;
use driver::Interface;
use messages::{JOINTS_MAX, TICK_HZ};
use plant::Links;
use robot::{JointLimits, Model};

/// Options of a driver and of its checker.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// How the robot interpolates between the driver's setpoints.
    pub interface: Interface,
    /// Age of a measurement beyond which the robot is unseen, ms.
    pub measured_age_max_ms: f64,
    /// Time by which a measurement may be older still before the driver counts the robot as silent, ms. Zero with real-time
    /// scheduling.
    pub pause_ms: f64,
    /// Ticks without an acceptable command after which the driver latches its fault.
    pub silence_ticks: u64,
    /// True payload of the left and the right hand, kg. Without a value it is the robot file's. The centre is the robot
    /// file's. The planner of the motion may use another payload: the robot file's, or the operator's report.
    pub payload_kg: [Option<f64>; 2],
    /// Speed limit for elbows and hands in the base frame, m/s. A faster command is a violation.
    pub hand_speed_max_m_per_s: f64,
    /// The robot may start outside its limits, and closer to itself than allowed: a robot to be recovered. Being there is
    /// then no violation. Going further out or closer is one.
    pub initial_outside: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            interface: Interface::Direct,
            measured_age_max_ms: 10.0,
            pause_ms: 0.0,
            silence_ticks: driver::SILENCE_TICKS,
            payload_kg: [None; 2],
            hand_speed_max_m_per_s: 3.0,
            initial_outside: false,
        }
    }
}

/// Returned when an option is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum CheckerError {
    /// The second reader of the robot's files failed.
    #[error(transparent)]
    Links(#[from] plant::PlantError),
    /// A value is out of its bounds.
    #[error("{key} = {value}: must be between {min} and {max}")]
    OutOfBounds { key: &'static str, value: f64, min: f64, max: f64 },
}

/// Returns the grippers of `model` in the driver's form.
pub fn grippers(model: &Model) -> driver::Grippers {
    driver::Grippers(std::array::from_fn(|side| model.grippers[side].as_ref().map_or(0.0, |gripper| gripper.speed)))
}

/// Returns the limits of a joint in the driver's form.
fn last_hop(limits: JointLimits) -> driver::JointLimits {
    let JointLimits { q_min, q_max, v_max, a_max, j_max, .. } = limits;
    driver::JointLimits { q_min, q_max, v_max, a_max, j_max }
}

/// Settings of a driver and of its checker, checked.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) model: Model,
    pub(crate) interface: Interface,
    pub(crate) follower: driver::Config,
    /// The stricter of URDF and robot file, joint by joint and limit by limit.
    pub(crate) limits: [JointLimits; JOINTS_MAX],
    pub(crate) body: Body,
    pub(crate) links: Links,
    pub(crate) hand_speed_max_m_per_s: f64,
    pub(crate) speed_points: [robot::SpeedPoint; 4],
    pub(crate) initial_outside: bool,
}

impl Config {
    /// Creates the settings for the driver of a robot of `model`.
    ///
    /// # Errors
    /// Returns an error if an option is out of its bounds, or if the second reader refuses the robot's files.
    pub fn new(model: &Model, options: &Options) -> Result<Self, CheckerError> {
        let within = |key, value: f64, min: f64, max: f64| {
            let inside = value >= min && value <= max;
            if inside { Ok(value) } else { Err(CheckerError::OutOfBounds { key, value, min, max }) }
        };
        let unseen_ms = within("measured_age_max_ms", options.measured_age_max_ms, 1.0, 100.0)?;
        let pause_ms = within("pause_ms", options.pause_ms, 0.0, 1000.0)?;
        within("silence_ticks", options.silence_ticks as f64, 1.0, 10.0 * TICK_HZ as f64)?;
        let limits = strictest(model);
        let last_hop = |j: usize| if j < model.count { last_hop(limits[j]) } else { driver::JointLimits::ABSENT };
        let texts = &model.texts;
        Ok(Self {
            model: model.clone(),
            interface: options.interface,
            follower: driver::Config {
                silence_ticks: options.silence_ticks,
                grippers: grippers(model),
                measured_age_max_ns: ((unseen_ms + pause_ms) * 1e6) as u64,
                unseen_ns: (unseen_ms * 1e6) as u64,
                interface_delay_ticks: (options.interface.delay_s() * TICK_HZ as f64) as u64,
                ..driver::Config::new(model.id(), std::array::from_fn(last_hop))
            },
            limits,
            body: Body::new(model),
            hand_speed_max_m_per_s: within("hand_speed_max_m_per_s", options.hand_speed_max_m_per_s, 0.01, 100.0)?,
            speed_points: model.speed_points(),
            initial_outside: options.initial_outside,
            links: Links::from_text(
                (&texts.toml_name, &texts.toml),
                (&texts.urdf_name, &texts.urdf),
                options.payload_kg,
            )?,
        })
    }

    /// The same robot without simulated controllers, for a robot that has its own. The certificate still covers the
    /// interface of the settings.
    #[must_use]
    pub fn without_simulated_controllers(self) -> Self {
        Self { interface: Interface::Direct, ..self }
    }

    /// Returns the torques of the links in a motion (rad, m, and seconds) by `plant`'s dynamics, N m or N.
    pub fn torques(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        self.links.torques(q, v, a)
    }
}

/// Returns the stricter of URDF and robot file, joint by joint and limit by limit.
pub fn strictest(model: &Model) -> [JointLimits; JOINTS_MAX] {
    std::array::from_fn(|j| {
        let (a, b) = (&model.urdf_limits[j], &model.limits[j]);
        JointLimits {
            q_min: a.q_min.max(b.q_min),
            q_max: a.q_max.min(b.q_max),
            v_max: a.v_max.min(b.v_max),
            a_max: a.a_max.min(b.a_max),
            j_max: a.j_max.min(b.j_max),
            effort_max: a.effort_max.min(b.effort_max),
        }
    })
}
