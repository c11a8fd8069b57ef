//! The robot and the person as the steps see them, and the facts that they compare with. Does no IO and reads no clock.

use super::path::Path;
use config::Loaded;
use messages::{JOINTS_MAX, Mode, TICK_S};
use robot::{Frames, Model};
use safety::monitor;

/// Travel of a joint that turns, rad: 50 times what an arm's encoder resolves, and 45 mm at the reach of an arm.
/// Assumption.
const TRAVEL_RAD: f64 = 0.05;
/// Travel of a joint that slides, m. Assumption.
const TRAVEL_M: f64 = 0.01;
/// Share of the speed limit at which everything moves. Control itself uses the same share in the first second of engaging.
const SPEED_SHARE: f64 = 0.05;
/// Postures of a travel whose clearance is computed. Neighbours are 6 mrad apart.
const LOOKS: u32 = 8;
/// Room to a limit that a travel leaves, rad or m.
const LIMIT_ROOM: f64 = monitor::OUTSIDE_MARGIN;

#[derive(Clone, Debug, PartialEq)]
pub enum Stop {
    /// A check failed. The sentence says which and how.
    Failed(String),
    /// The person refused, or gave no answer.
    Refused(String),
    Interrupted,
}

/// The robot's state at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s. Its origin is that of all samples.
    pub at_s: f64,
    /// Executed positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Executed velocities, rad/s or m/s.
    pub v: [f64; JOINTS_MAX],
    /// Measured positions, rad or m.
    pub q_measured: [f64; JOINTS_MAX],
    pub emergency_stop: bool,
    pub driver_fault: bool,
}

messages::named! {
    /// A process that step 4 kills, the driver last.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Victim {
        Ingest => "ingest",
        /// It stands where `retarget` stands.
        Targets => "the publisher of targets (in place of retarget)",
        Control => "control",
        Driver => "the driver",
    }
}

/// A robot with its driver and control. Every command goes through control and its gate.
pub trait Robot {
    /// Makes the checks that need no running robot. Returns what was found, in words.
    fn preflight(&mut self) -> Result<String, Stop>;
    /// Starts the driver and control. The robot stands.
    fn begin(&mut self) -> Result<(), Stop>;
    /// Returns all states of the next `time_s`. There is at least one.
    fn watch(&mut self, time_s: f64) -> Result<Vec<Sample>, Stop>;
    /// Enables the robot where it stands, and waits until it follows.
    fn engage(&mut self) -> Result<(), Stop>;
    fn play(&mut self, path: &Path) -> Result<(), Stop>;
    /// Releases the robot, and waits until it is at rest.
    fn release(&mut self) -> Result<(), Stop>;
    /// Resets a latched robot. Returns true if it is Disengaged then.
    fn reset(&mut self) -> Result<bool, Stop>;
    /// Returns the mode of control, or `None` if control does not answer.
    fn mode(&mut self) -> Option<Mode>;
    fn why(&mut self) -> String;
    /// Kills a process with SIGKILL. Returns the time before the kill, s.
    fn kill(&mut self, victim: Victim) -> Result<f64, Stop>;
    fn restart(&mut self, victim: Victim) -> Result<(), Stop>;
    fn pause(&mut self, time_s: f64) -> Result<(), Stop>;
    /// Says how to press the emergency stop of a simulated robot. Empty for a robot with a button.
    fn button(&self) -> String;
}

pub trait Person {
    fn print(&mut self, text: &str);
    /// Waits for Enter. `n` refuses.
    fn confirm(&mut self, question: &str) -> Result<(), Stop>;
    /// Waits for `y` or `n`. `n` fails with `otherwise`.
    fn saw(&mut self, question: &str, otherwise: &str) -> Result<(), Stop>;
}

#[derive(Clone, Debug)]
pub struct Facts {
    pub model: Model,
    /// Distance by which a measured travel may differ from a commanded one, rad and m: `safety.tracking_error_rad` and
    /// `safety.tracking_error_m`. A simulated robot gets no more.
    pub differs: [f64; 2],
    pub stop_s: f64,
    /// Longest time in which control notices the death of `ingest` and of the publisher of targets, s.
    pub noticed_s: [f64; 2],
    /// Known time from a setpoint to the robot's execution, s.
    pub delay_s: f64,
    /// The part of the delay that a state of the robot shows, s. The rest is hidden by the driver's estimate.
    pub shown_delay_s: f64,
    /// Largest age of a measurement, s.
    pub age_s: f64,
    /// `ros2.servo_lag_ms`, for a robot on ROS 2.
    pub servo_lag_ms: Option<f64>,
}

impl Facts {
    /// Collects them. `relaxed`: the machine is not real-time.
    pub fn from_settings(loaded: &Loaded, relaxed: bool) -> Self {
        let settings = &loaded.settings;
        let (safety, ros2) = (&settings.safety, super::is_ros2(settings));
        let shown_delay_s = f64::from(settings.servo_delay_ticks()) * TICK_S + settings.interface().delay_s();
        let behind_ms = if ros2 { settings.ros2_behind_ms() } else { 0.0 };
        let factor = if relaxed { safety.stale_factor_without_realtime } else { 1.0 };
        Self {
            model: loaded.model.clone(),
            differs: [safety.tracking_error_rad, safety.tracking_error_m],
            stop_s: loaded.model.stop_time_max_s,
            noticed_s: [safety.input_stale_ms * 1e-3, safety.target_stale_ms * factor * 1e-3],
            delay_s: shown_delay_s + behind_ms * 1e-3,
            shown_delay_s,
            age_s: settings.driver.measured_age_max_ms * 1e-3,
            servo_lag_ms: ros2.then_some(settings.ros2.servo_lag_ms),
        }
    }

    /// Speed at which a joint is moved, rad/s or m/s.
    pub fn speed(&self, joint: usize) -> f64 {
        SPEED_SHARE * self.model.limits[joint].v_max
    }

    /// Largest distance of a standing joint from its place, rad or m.
    pub fn stands(&self, joint: usize) -> f64 {
        monitor::rest_band(&self.model, joint)
    }

    /// Largest difference between a commanded and a measured travel, rad or m.
    pub fn differs(&self, joint: usize) -> f64 {
        self.differs[usize::from(self.model.prismatic[joint])]
    }

    pub fn with_unit(&self, joint: usize, length: f64) -> String {
        let unit = if self.model.prismatic[joint] { "mm" } else { "mrad" };
        format!("{:.1} {unit}", length * 1e3)
    }

    /// Returns the travel of `joint` from `q` to the side with more room. It stays inside the limits, and clear.
    pub fn travel(&self, q: &[f64; JOINTS_MAX], joint: usize) -> Result<f64, Stop> {
        let limits = &self.model.limits[joint];
        let length = if self.model.prismatic[joint] { TRAVEL_M } else { TRAVEL_RAD };
        let up = limits.q_max - q[joint] >= q[joint] - limits.q_min;
        let sides = if up { [length, -length] } else { [-length, length] };
        sides.into_iter().find(|by| self.is_free(q, joint, *by)).ok_or_else(|| {
            let name = &self.model.joint_names[joint];
            let length = self.with_unit(joint, length);
            Stop::Failed(format!(
                "{name} cannot move by {length} from here: its limit or another part is too near. Move the robot by its \
                 own means to a posture with room, and begin again"
            ))
        })
    }

    /// Returns true if the travel keeps the limits, and the clearance of a start.
    fn is_free(&self, q: &[f64; JOINTS_MAX], joint: usize, by: f64) -> bool {
        let (model, mut frames) = (&self.model, Frames::default());
        let limits = &model.limits[joint];
        (1..=LOOKS).all(|look| {
            let mut at = *q;
            at[joint] += by * f64::from(look) / f64::from(LOOKS);
            let inside = (limits.q_min + LIMIT_ROOM..=limits.q_max - LIMIT_ROOM).contains(&at[joint]);
            inside && monitor::clear_to_start(model, &mut frames, &at)
        })
    }

    /// Returns the joint among `joints` that moves farthest from `at` in `samples`, if any leaves its place.
    pub fn strayed(&self, at: &[f64; JOINTS_MAX], samples: &[Sample], but: Option<usize>) -> Option<(usize, f64)> {
        let joints = (0..self.model.count).filter(|joint| Some(*joint) != but);
        let farthest = |j: usize| {
            let off = samples.iter().map(|sample| sample.q_measured[j] - at[j]);
            off.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
        };
        let share = |(j, off): &(usize, f64)| off.abs() / self.stands(*j);
        let worst = joints.map(|j| (j, farthest(j))).max_by(|a, b| share(a).total_cmp(&share(b)))?;
        // Written so that NaN strays.
        let kept = share(&worst) <= 1.0;
        (!kept).then_some(worst)
    }
}
