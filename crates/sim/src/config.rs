//! Settings of the simulated robot.

use crate::clearance::Body;
use crate::interface::Interface;
use messages::{JOINTS_MAX, TICK_HZ, TICK_S};
use plant::Reaction;
use robot::{JointLimits, Model, Solid};

/// The longest transport delay that is allowed, ticks: 20 ms, the cycle of the slowest interface that the robot
/// offers.
pub const DELAY_MAX_TICKS: u32 = 30;

/// Multiple of its standard deviation that an encoder's noise may reach before a posture counts as outside its
/// limits.
const NOISE_SIGMAS: f64 = 8.0;

/// Options. The manufacturer publishes none of the figures of the joint servos. The defaults are assumptions.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The way in which the robot takes the driver's setpoints.
    pub interface: Interface,
    /// Natural frequency of every joint servo, Hz. Assumption: 15, an industrial position loop.
    pub natural_frequency_hz: f64,
    /// Damping ratio of every joint servo. Assumption: 1, no overshoot.
    pub damping_ratio: f64,
    /// Ticks from the setpoint to the servo. Assumption: 2, one field-bus cycle of 1 ms and its rounding up.
    pub delay_ticks: u32,
    /// Standard deviation of a measured position, rad or m. Assumption: one encoder step of 17 bits.
    pub encoder_noise_rad: f64,
    /// Step of a measured position, rad or m. Assumption: 17 bits per turn.
    pub encoder_step_rad: f64,
    /// Silence of the driver after which the robot reacts by itself, ms. Assumption: 10.
    pub watchdog_ms: f64,
    /// The robot's reaction to that silence.
    pub reaction: Reaction,
    /// Age of a measurement beyond which the robot is unseen, ms.
    pub measured_age_max_ms: f64,
    /// Time by which a measurement may be older still before the driver counts the robot as silent, ms. Zero with real-time
    /// scheduling.
    pub pause_ms: f64,
    /// Ticks without an acceptable command after which the driver latches its fault.
    pub silence_ticks: u64,
    /// True payload of the left and the right hand, kg. Without a value it is the robot file's. The centre is the
    /// robot file's. The planner of the motion may use another payload: the robot file's, or the operator's
    /// report.
    pub payload_kg: [Option<f64>; 2],
    /// Width of what lies between the fingers of each gripper, m. Zero for nothing.
    pub object_width_m: f64,
    /// Speed limit for elbows and hands in the base frame, m/s. A faster command is a violation.
    pub hand_speed_max_m_per_s: f64,
    /// Posture at the start, rad or m. The robot's home if none is given.
    pub initial: Option<[f64; JOINTS_MAX]>,
    /// The posture at the start may lie anywhere between the mechanical stops (the URDF's limits), and closer to
    /// itself than allowed: a robot to be recovered. Being there is then no violation, but going further out or
    /// closer is.
    pub initial_outside: bool,
}

impl Default for Options {
    fn default() -> Self {
        let step_rad = std::f64::consts::TAU / f64::from(1 << 17);
        Self {
            interface: Interface::Direct,
            natural_frequency_hz: 15.0,
            damping_ratio: 1.0,
            delay_ticks: 2,
            encoder_noise_rad: step_rad,
            encoder_step_rad: step_rad,
            watchdog_ms: 10.0,
            reaction: Reaction::Play,
            measured_age_max_ms: 10.0,
            pause_ms: 0.0,
            silence_ticks: driver::SILENCE_TICKS,
            payload_kg: [None; 2],
            object_width_m: 0.0,
            hand_speed_max_m_per_s: 3.0,
            initial: None,
            initial_outside: false,
        }
    }
}

/// Returned when the simulated robot cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum SimError {
    /// The second reader of the robot's files, or an option of the body, failed.
    #[error("sim: {0}")]
    Body(#[from] plant::PlantError),
    /// A figure is out of its bounds.
    #[error("sim: {key} = {value}: must be between {min} and {max}")]
    OutOfBounds { key: &'static str, value: f64, min: f64, max: f64 },
    /// From this start the noise of the encoders alone would leave the limits.
    #[error(
        "sim: initial posture of {joint} = {value}: must be at least {margin} (noise and step of the encoder) inside [{min}, {max}]"
    )]
    InitialOutsideLimits { joint: String, value: f64, min: f64, max: f64, margin: f64 },
}

/// Largest standard deviation of the encoders' noise, rad or m. The driver takes changes up to 0.4 mrad for
/// noise, four times as much.
pub const ENCODER_NOISE_MAX_RAD: f64 = 1e-4;

/// Returns the longest allowed watchdog time, ms. Until the watchdog fires, drives carry the last acceleration
/// on. Then the played stop begins where it should be by that time. At 9.6 rad/s^2 and 20 ms their speeds differ
/// by 0.2 rad/s. At 100 ms the robot goes 70 mrad beyond the end of the stop.
pub const fn watchdog_max_ms(reaction: Reaction) -> f64 {
    match reaction {
        Reaction::Play => 20.0,
        Reaction::Hold | Reaction::Damp => 1000.0,
    }
}

/// Largest width of an object between fingers, m: that of the widest gripper.
pub const OBJECT_MAX_M: f64 = 0.5;

/// Returns the grippers of `model` in the driver's form.
pub fn grippers(model: &Model) -> driver::Grippers {
    driver::Grippers(std::array::from_fn(|side| model.grippers[side].as_ref().map_or(0.0, |gripper| gripper.speed)))
}

/// Returns the limits of a joint in the driver's form.
fn last_hop(limits: JointLimits) -> driver::JointLimits {
    let JointLimits { q_min, q_max, v_max, a_max, j_max, .. } = limits;
    driver::JointLimits { q_min, q_max, v_max, a_max, j_max }
}

/// Settings of a simulated robot, checked.
#[derive(Clone, Debug)]
pub struct Config {
    pub(crate) model: Model,
    pub(crate) interface: Interface,
    pub(crate) follower: driver::Config,
    /// The stricter of URDF and robot file, joint by joint and limit by limit.
    pub(crate) limits: [JointLimits; JOINTS_MAX],
    pub(crate) body: Body,
    pub(crate) plant: plant::Config,
    pub(crate) hand_speed_max_m_per_s: f64,
    pub(crate) object_width_m: f64,
    pub(crate) speed_points: [robot::SpeedPoint; 4],
    pub(crate) initial: [f64; JOINTS_MAX],
    pub(crate) initial_outside: bool,
}

impl Config {
    /// Creates the settings for a simulated robot of `model`.
    pub fn new(model: &Model, options: &Options) -> Result<Self, SimError> {
        let within = |key, value: f64, min: f64, max: f64| {
            let inside = value >= min && value <= max;
            if inside { Ok(value) } else { Err(SimError::OutOfBounds { key, value, min, max }) }
        };
        let delay = within("delay_ticks", f64::from(options.delay_ticks), 0.0, f64::from(DELAY_MAX_TICKS))?;
        let noise = within("encoder_noise_rad", options.encoder_noise_rad, 0.0, ENCODER_NOISE_MAX_RAD)?;
        let step = within("encoder_step_rad", options.encoder_step_rad, 0.0, 0.01)?;
        within("watchdog_ms", options.watchdog_ms, 1.0, watchdog_max_ms(options.reaction))?;
        let unseen_ms = within("measured_age_max_ms", options.measured_age_max_ms, 1.0, 100.0)?;
        let pause_ms = within("pause_ms", options.pause_ms, 0.0, 1000.0)?;
        within("silence_ticks", options.silence_ticks as f64, 1.0, 10.0 * TICK_HZ as f64)?;
        let limits: [JointLimits; JOINTS_MAX] =
            std::array::from_fn(|j| strictest(&model.urdf_limits[j], &model.limits[j]));
        let last_hop = |j: usize| if j < model.count { last_hop(limits[j]) } else { driver::JointLimits::ABSENT };
        let initial = options.initial.unwrap_or(model.home);
        let margin = NOISE_SIGMAS * noise + step;
        for j in 0..model.count {
            let allowed = if options.initial_outside { &model.urdf_limits[j] } else { &limits[j] };
            let (min, max) = (allowed.q_min, allowed.q_max);
            if !(initial[j] >= min + margin && initial[j] <= max - margin) {
                let joint = model.joint_names[j].clone();
                return Err(SimError::InitialOutsideLimits { joint, value: initial[j], min, max, margin });
            }
        }
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
            object_width_m: within("object_width_m", options.object_width_m, 0.0, OBJECT_MAX_M)?,
            hand_speed_max_m_per_s: within("hand_speed_max_m_per_s", options.hand_speed_max_m_per_s, 0.01, 100.0)?,
            speed_points: model.speed_points(),
            initial,
            initial_outside: options.initial_outside,
            plant: body_of(model, options, (delay * TICK_S * 1e9).round() as u64)?,
        })
    }

    /// The same robot behind an interface that takes every setpoint. The certificate still covers the interface of the
    /// settings.
    #[must_use]
    pub fn without_simulated_interface(self) -> Self {
        Self { interface: Interface::Direct, ..self }
    }

    /// Returns the names of the joints.
    pub fn joint_names(&self) -> &[String] {
        &self.model.joint_names
    }

    /// Returns the torques of the links in a motion (rad, m, and seconds) by the body's own dynamics, N m or N.
    pub fn torques(&self, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX], a: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        self.plant.torques(q, v, a)
    }

    /// Returns the posture at the start, rad or m.
    pub fn initial(&self) -> &[f64; JOINTS_MAX] {
        &self.initial
    }
}

/// Creates the body with the second reader of the same texts. Its obstacles are the model's.
fn body_of(model: &Model, options: &Options, delay_ns: u64) -> Result<plant::Config, plant::PlantError> {
    let obstacles = model.obstacles.iter().map(|obstacle| match obstacle.solid {
        Solid::HalfSpace { normal, offset_m } => plant::Obstacle::Plane { normal, offset_m },
        Solid::Box { center, r, half_m } => plant::Obstacle::Box { center, r, half_m },
    });
    let options = plant::Options {
        natural_frequency_hz: options.natural_frequency_hz,
        damping_ratio: options.damping_ratio,
        delay_ns,
        watchdog_ns: (options.watchdog_ms * 1e6) as u64,
        reaction: options.reaction,
        encoder_noise_rad: options.encoder_noise_rad,
        encoder_step_rad: options.encoder_step_rad,
        hands_kg: options.payload_kg,
        obstacles: obstacles.collect(),
        initial_outside: options.initial_outside,
        ..plant::Options::default()
    };
    let texts = &model.texts;
    plant::Config::from_text(&texts.toml_name, &texts.toml, &texts.urdf_name, &texts.urdf, &options)
}

fn strictest(a: &JointLimits, b: &JointLimits) -> JointLimits {
    JointLimits {
        q_min: a.q_min.max(b.q_min),
        q_max: a.q_max.min(b.q_max),
        v_max: a.v_max.min(b.v_max),
        a_max: a.a_max.min(b.a_max),
        j_max: a.j_max.min(b.j_max),
        effort_max: a.effort_max.min(b.effort_max),
    }
}
