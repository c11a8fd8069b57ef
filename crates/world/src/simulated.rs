//! The simulated robot and its driver in one thread, for virtual time. The processes `teleopd driver` and `teleopd robot`
//! run the same two.

use checker::CheckerError;
use driver::{DriveInput, DriveOutput, Driver, Measured, Setpoint};
use messages::{GripperMotion, GripperState, JOINTS_MAX, Stamp, StopPlan, deadline};
use plant::{Injection, Port, Robot};
use robot::{Model, Solid};

/// Multiple of its standard deviation that an encoder's noise may reach before a posture counts as outside its limits.
const NOISE_SIGMAS: f64 = 8.0;

/// Options of the robot and of its driver. The model gives obstacles and grippers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// The driver and its checker.
    pub driver: checker::Options,
    /// The robot.
    pub robot: plant::Options,
    /// Posture at the start, rad or m. Without a value it is the home posture. With `initial_outside` it may lie anywhere
    /// between the mechanical stops (the URDF's limits).
    pub initial: Option<[f64; JOINTS_MAX]>,
}

/// Returned when the simulated robot cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum SimulatedError {
    /// An option of the driver is refused.
    #[error(transparent)]
    Driver(#[from] CheckerError),
    /// An option of the robot is refused.
    #[error(transparent)]
    Robot(#[from] plant::PlantError),
    /// From this start the noise of the encoders alone would leave the limits.
    #[error(
        "initial posture of {joint} = {value}: must be at least {margin} (noise and step of the encoder) inside [{min}, {max}]"
    )]
    InitialOutsideLimits { joint: String, value: f64, min: f64, max: f64, margin: f64 },
}

/// Settings of the robot and of its driver, checked.
#[derive(Clone, Debug)]
pub struct Config {
    driver: checker::Config,
    robot: plant::Config,
    initial: [f64; JOINTS_MAX],
}

impl Config {
    /// Creates the settings for a simulated robot of `model`.
    ///
    /// # Errors
    /// Returns an error if an option is refused.
    pub fn new(model: &Model, options: &Options) -> Result<Self, SimulatedError> {
        let (robot, initial) = robot_config(model, &options.robot, options.initial)?;
        Ok(Self { driver: checker::Config::new(model, &options.driver)?, robot, initial })
    }

    /// Returns the settings of the driver and of its checker.
    pub const fn driver(&self) -> &checker::Config {
        &self.driver
    }

    /// Returns the posture at the start, rad or m.
    pub const fn initial(&self) -> &[f64; JOINTS_MAX] {
        &self.initial
    }
}

/// Returns the configuration of the simulated robot, with the model's obstacles and grippers, and its posture at the start,
/// rad or m.
///
/// # Errors
/// Returns an error if an option is refused.
pub(crate) fn robot_config(
    model: &Model,
    options: &plant::Options,
    initial: Option<[f64; JOINTS_MAX]>,
) -> Result<(plant::Config, [f64; JOINTS_MAX]), SimulatedError> {
    let initial = initial.unwrap_or(model.home);
    let margin = NOISE_SIGMAS * options.encoder_noise_rad + options.encoder_step_rad;
    let limits = checker::strictest(model);
    for j in 0..model.count {
        let allowed = if options.initial_outside { &model.urdf_limits[j] } else { &limits[j] };
        let (min, max) = (allowed.q_min, allowed.q_max);
        if !(initial[j] >= min + margin && initial[j] <= max - margin) {
            let joint = model.joint_names[j].clone();
            return Err(SimulatedError::InitialOutsideLimits { joint, value: initial[j], min, max, margin });
        }
    }
    let obstacles = model.obstacles.iter().map(|obstacle| match obstacle.solid {
        Solid::HalfSpace { normal, offset_m } => plant::Obstacle::Plane { normal, offset_m },
        Solid::Box { center, r, half_m } => plant::Obstacle::Box { center, r, half_m },
    });
    let gripper =
        |gripper: &robot::Gripper| plant::Gripper { opening_m: gripper.opening_m, force_max_n: gripper.force_max_n };
    let options = plant::Options {
        obstacles: obstacles.collect(),
        grippers: [0, 1].map(|side| model.grippers[side].as_ref().map(gripper)),
        ..options.clone()
    };
    let texts = &model.texts;
    let config = plant::Config::from_text(&texts.toml_name, &texts.toml, &texts.urdf_name, &texts.urdf, &options)?;
    Ok((config, initial))
}

/// The driver and the robot in one thread.
#[derive(Clone, Debug)]
pub struct State {
    driver: checker::State,
    robot: Robot,
    /// The measurement of joints that have no body.
    ideal: Option<Box<Measured>>,
}

impl State {
    /// Creates a robot at rest in the initial posture at index `k`. It holds the encoders' readings. `seed` is
    /// the seed of the noise.
    pub fn new(config: &Config, k: u64, seed: u64) -> Self {
        Self::standing(config, k, &config.initial, seed)
            .expect("the initial posture was checked, and the noise is finite")
    }

    /// Creates a driver that starts at index `k` on a robot that stands at `q`, wherever that is. Returns `None`
    /// if a number of `q` or of the measurement is not finite.
    pub fn standing(config: &Config, k: u64, q: &[f64; JOINTS_MAX], seed: u64) -> Option<Self> {
        if q.iter().any(|q| !q.is_finite()) {
            return None;
        }
        let mut robot = Robot::new(&config.robot, deadline(k), q, seed);
        let measured = measure(config, &mut robot, deadline(k));
        let driver = checker::State::new(&config.driver, k, &measured, &measured, seed)?;
        Some(Self { driver, robot, ideal: None })
    }

    /// Takes the joints' body away at rest. From now on they are where the last setpoint sent them.
    pub(crate) fn without_body(&mut self) {
        self.ideal = Some(Box::new(*self.driver.measured()));
    }

    /// Replaces the driver by one that starts at index `k` on the robot as it is. Returns false and changes
    /// nothing if the measurement is no valid posture.
    pub fn restart_driver(&mut self, config: &Config, k: u64, now: Stamp, seed: u64) -> bool {
        let measured = measure(config, &mut self.robot, now);
        let restarted = self.driver.restarted(&config.driver, k, &measured, seed);
        restarted.map(|restarted| self.driver = restarted).is_some()
    }

    /// Returns the driver.
    pub const fn driver(&self) -> &checker::State {
        &self.driver
    }

    /// Returns the checker's report on the commands of the run so far.
    pub fn report(&self) -> &checker::Report {
        self.driver.report()
    }

    /// Returns the judge's report on the joints' true motion so far.
    pub fn judged(&self) -> &plant::Report {
        self.robot.judged()
    }

    /// Returns the driver's follower.
    pub fn follower(&self) -> &driver::State {
        self.driver.follower()
    }

    /// Returns the true positions of the joints, rad or m.
    pub fn q(&self) -> &[f64; JOINTS_MAX] {
        &self.robot.truth().q
    }

    /// Returns the true motion of the joints.
    pub fn truth(&self) -> &plant::Truth {
        self.robot.truth()
    }

    /// Returns the last setpoint of the joints: the driver's setpoint, or the controllers' spline of it.
    pub const fn sent(&self) -> &Setpoint {
        self.driver.sent()
    }

    /// Returns true if the driver and all controllers are at rest.
    pub fn at_rest(&self) -> bool {
        self.driver.at_rest()
    }

    /// Moves the robot alone to `now`, while its driver does not run.
    pub fn advance(&mut self, config: &Config, now: Stamp) {
        self.robot.advance(&config.robot, now);
    }

    /// Returns the robot's measurement at `now`, as a driver that is about to start reads it.
    pub fn measure(&mut self, config: &Config, now: Stamp) -> Measured {
        measure(config, &mut self.robot, now)
    }

    /// Switches a fault of the robot on.
    pub fn inject(&mut self, fault: Injection) {
        self.robot.inject(fault);
    }

    /// Switches all injected faults off.
    pub fn repair(&mut self) {
        self.robot.repair();
    }
}

fn measure(config: &Config, robot: &mut Robot, now: Stamp) -> Measured {
    Driver::read(&mut Port::new(&config.robot, robot), now)
}

/// Moves the robot to `now`, executes up to the index that is due, and checks every step.
///
/// ```
/// # let read = |kind| std::fs::read_to_string(format!("../../config/robots/tiago_dual.{kind}"));
/// # let model = robot::Model::from_text("tiago_dual.toml", &read("toml")?, "tiago_dual.urdf", &read("urdf")?)?;
/// use world::simulated::{Config, Options, State, tick};
///
/// let config = Config::new(&model, &Options::default())?;
/// let mut state = State::new(&config, 1000, 1);
/// for k in 1001..1100 {
///     let input = driver::DriveInput { due_k: k, command: None };
///     tick(&config, &mut state, messages::deadline(k), input);
/// }
/// assert!(state.at_rest()); // Nobody commands it.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tick(config: &Config, state: &mut State, now: Stamp, input: DriveInput<'_>) -> DriveOutput {
    let State { driver, robot, ideal } = state;
    let Some(joints) = ideal else {
        return checker::drive(&config.driver, driver, now, input, &mut Port::new(&config.robot, robot));
    };
    let gripped = robot.gripped(&config.robot, now);
    checker::drive(&config.driver, driver, now, input, &mut Bodiless { robot, gripped, joints })
}

/// The port of joints without a body.
struct Bodiless<'a> {
    robot: &'a mut Robot,
    gripped: GripperState,
    joints: &'a mut Measured,
}

impl Driver for Bodiless<'_> {
    fn read(&mut self, now: Stamp) -> Measured {
        self.joints.stamp = now;
        *self.joints
    }

    fn write(&mut self, _: Stamp, setpoint: &Setpoint, _: &StopPlan) -> bool {
        (self.joints.q, self.joints.dq) = (setpoint.q, setpoint.v);
        true
    }

    fn grip(&mut self, grippers: &GripperMotion) {
        self.robot.grip(grippers);
    }

    fn gripped(&self) -> Option<GripperState> {
        Some(self.gripped)
    }
}
