//! Compares every executed step with the limits. It knows only the executed setpoints and their indices.
//!
//! Two executed states are `dt = (k - k') T` apart. The motion between them is unknown, but the jerk limit J bounds it,
//! whatever its phases. The trapezoid rule errs by at most J dt^2 / 4 for an integrand with |f'| <= J. For one with
//! |f''| <= J it errs by at most J dt^3 / 12 (Davis and Rabinowitz, Methods of Numerical Integration, section 2.1). So
//!
//! ```text
//! |a - a'|                        <= J dt
//! |v - v' - (a + a') / 2 dt|      <= J dt^2 / 4
//! |q - q' - (v + v') / 2 dt|      <= J dt^3 / 12
//! ```
//!
//! hold for every motion that keeps the limit, and a step that breaks one is a violation of jerk.
//!
//! With trajectory controllers in between ([`Interface::Jtc100`](driver::Interface::Jtc100)) the robot executes their splines, whose
//! acceleration jumps from piece to piece. Their position, velocity and clearance are checked at every index. The
//! bounds of position and velocity include the amount that a spline may add to a motion within the jerk limit.
//! Acceleration and jerk are checked for the setpoints that the driver hands to the controllers.
//!
//! The speed of elbows and hands is checked for the driver's steps, by their way from index to index, whatever
//! the interface.
//!
//! The torque of every executed point comes from the dynamics of [`plant::Links`], by its position, velocity
//! and acceleration. It is the torque of the links alone, and is compared with the whole effort limit.
//!
//! A driver that begins where it finds the robot stops by itself, and no proof covers that stop. Until it has ended, no
//! torque is judged. The clearance is judged as that of the joints' true motion ([`plant::CLEARANCE_MARGIN_M`] below
//! the least one). Afterwards the robot may stand as close as it came to rest, and the clearance may only grow.
//!
//! A robot that may start outside its limits (`Options::initial_outside`) violates nothing by being there. To go
//! further out is a violation.

use crate::clearance::Workspace;
use crate::config::Config;
use crate::controllers::{spline_error, spline_speed_error};
use crate::report::{Report, Violation, ViolationKind};
use driver::Setpoint;
use messages::{JOINTS_MAX, Mode, TICK_HZ, TICK_S};
use plant::CLEARANCE_MARGIN_M;
use robot::Frames;

// The tolerances are for rounding alone. Positions reach 3 rad, velocities 3 rad/s, accelerations 10 rad/s^2, in
// doubles (2.2e-16). A plan is advanced by at most 7500 additions of a tick, each off by half a unit in the last place.
// So values are off by less than 1e-11, and the difference of two accelerations over a tick by 1500 times that.

/// Rounding of a position, rad or m.
pub const TOLERANCE_Q: f64 = 1e-9;
/// Rounding of a velocity, rad/s or m/s.
pub const TOLERANCE_V: f64 = 1e-9;
/// Rounding of an acceleration, rad/s^2 or m/s^2.
pub const TOLERANCE_A: f64 = 1e-9;
/// Rounding of a jerk, rad/s^3 or m/s^3.
pub const TOLERANCE_J: f64 = 1e-6;
/// Rounding of a clearance, m: positions of rounding 1e-15 over a chain of 2 m, squared and rooted near zero.
pub const TOLERANCE_CLEARANCE_M: f64 = 1e-9;

/// Rounding of the way of a point in a step, m: positions of rounding 1e-11 rad over a chain of 2 m.
pub const TOLERANCE_HAND_M: f64 = 1e-10;

/// Below this speed (rad/s, m/s) and acceleration a robot stands: rounding alone.
const STANDING: f64 = 1e-9;

/// State of the checker.
#[derive(Clone, Debug)]
pub struct Checker {
    /// The driver's last executed setpoint.
    last: Setpoint,
    /// The controllers' last executed setpoint.
    splined: Setpoint,
    mode: u32,
    /// Index at which Engaging last began from rest.
    engaged_k: Option<u64>,
    /// A hold interrupts Engaging after its first second. What resumes then begins nothing.
    slow_is_over: bool,
    workspace: Workspace,
    /// Least clearance that is no violation, m.
    allowed_m: f64,
    frames: Frames,
    /// Index by which the driver's own stop, from where it found the robot, has ended. No proof covers that stop.
    own_stop_until_k: u64,
    /// Elbows and hands at the driver's last executed setpoint, in the base frame, m.
    points: Points,
}

type Points = [[f64; 3]; 4];

impl Checker {
    /// Begins with the setpoint that is held at the start.
    pub fn new(config: &Config, held: Setpoint) -> Self {
        let mut workspace = config.body.workspace();
        let allowed_m = allowed(config, &held, &mut workspace);
        let mut frames = Frames::default();
        let points = points(config, &mut frames, &held.q);
        let mode = Mode::Disengaged as u32;
        let own_stop_until_k = own_stop_end(config, &held);
        Self {
            last: held,
            splined: held,
            mode,
            engaged_k: None,
            slow_is_over: false,
            workspace,
            allowed_m,
            frames,
            own_stop_until_k,
            points,
        }
    }

    /// Begins again at `held`. No command led a robot without drives to where it was found.
    pub fn hold(&mut self, config: &Config, held: &Setpoint) {
        self.allowed_m = allowed(config, held, &mut self.workspace);
        (self.last, self.splined, self.engaged_k) = (*held, *held, None);
        self.points = points(config, &mut self.frames, &held.q);
        self.own_stop_until_k = own_stop_end(config, held);
    }

    /// Takes the step to index `k` as a new motion that `control` has proved. The driver's own stop no longer
    /// excuses it.
    pub(crate) fn accept(&mut self, config: &Config, k: u64) {
        if k <= self.own_stop_until_k {
            self.own_stop_until_k = k.saturating_sub(1);
            let (clearance_m, _) = config.body.clearance(&config.model, &self.last.q, &mut self.workspace);
            self.allowed_m = self.allowed_m.max(clearance_m.min(config.body.d_min_m));
        }
    }

    /// Checks the driver's step to `to`, executed in `mode`. With a direct interface it is the setpoint of the joints.
    pub fn step(&mut self, config: &Config, report: &mut Report, to: &Setpoint, mode: u32) {
        let from = self.last;
        report.steps += 1;
        if !config.interface.has_controllers() {
            for j in 0..config.model.count {
                check_place(config, report, &from, to, j);
            }
        }
        for j in 0..config.model.count {
            check_change(config, report, &from, to, j);
        }
        if !config.interface.has_controllers() {
            self.keep_clear(config, report, to);
        }
        self.check_hands(config, report, to);
        if to.k > self.own_stop_until_k {
            check_torques(config, report, to);
        }
        self.engage(config, report, to, mode);
        (self.last, self.mode) = (*to, mode);
    }

    /// Checks the controllers' splines of the driver's steps, index by index.
    pub(crate) fn spline(&mut self, config: &Config, report: &mut Report, to: &Setpoint) {
        let from = self.splined;
        for j in 0..config.model.count {
            check_place(config, report, &from, to, j);
        }
        self.keep_clear(config, report, to);
        self.splined = *to;
    }

    fn keep_clear(&mut self, config: &Config, report: &mut Report, to: &Setpoint) {
        let (clearance_m, pair) = config.body.clearance(&config.model, &to.q, &mut self.workspace);
        report.min_clearance_m = report.min_clearance_m.min(clearance_m);
        if self.allowed_m >= config.body.d_min_m {
            report.min_proved_clearance_m = report.min_proved_clearance_m.min(clearance_m);
        }
        let clear = clearance_m >= self.allowed_m - TOLERANCE_CLEARANCE_M;
        if !clear {
            count(report, ViolationKind::Clearance, to.k, pair, clearance_m, self.allowed_m);
        }
        if to.k > self.own_stop_until_k {
            self.allowed_m = self.allowed_m.max(clearance_m.min(config.body.d_min_m));
        }
    }

    /// Checks the mean speed of elbows and hands over the step. It is at most the largest speed on the way.
    fn check_hands(&mut self, config: &Config, report: &mut Report, to: &Setpoint) {
        let dt = to.k.saturating_sub(self.last.k) as f64 * TICK_S;
        let now = points(config, &mut self.frames, &to.q);
        for (i, (from, to_point)) in self.points.iter().zip(&now).enumerate() {
            let moved_m = (0..3).map(|i| (to_point[i] - from[i]).powi(2)).sum::<f64>().sqrt();
            let slow = moved_m <= config.hand_speed_max_m_per_s * dt + TOLERANCE_HAND_M;
            if !slow {
                count(report, ViolationKind::HandSpeed, to.k, i, moved_m / dt, config.hand_speed_max_m_per_s);
            }
        }
        self.points = now;
    }

    /// Watches the first second of every engagement that began at rest.
    fn engage(&mut self, config: &Config, report: &mut Report, to: &Setpoint, mode: u32) {
        let from = &self.last;
        let [engaging, engaged, holding] = [Mode::Engaging, Mode::Engaged, Mode::Holding].map(|mode| mode as u32);
        let moving = mode == engaging || mode == engaged;
        if self.mode == engaging && mode == holding {
            self.slow_is_over = self.engaged_k.is_some_and(|began| to.k >= began + TICK_HZ);
        } else if mode != engaging && mode != holding {
            self.slow_is_over = false;
        }
        let resumes = self.mode == holding && self.slow_is_over;
        if mode == engaging && self.mode != mode && !resumes {
            let standing = from.v.iter().chain(&from.a).all(|x| x.abs() <= STANDING);
            self.engaged_k = standing.then_some(to.k);
            if standing {
                report.engagements += 1;
                for j in (0..config.model.count).filter(|&j| !config.model.prismatic[j]) {
                    report.engage_max_step_rad = report.engage_max_step_rad.max((to.q[j] - from.q[j]).abs());
                }
            }
        }
        if let Some(engaged_k) = self.engaged_k
            && moving
            && to.k.saturating_sub(engaged_k) < TICK_HZ
        {
            let ratio = |j: usize| to.v[j].abs() / config.limits[j].v_max;
            report.engage_first_second_velocity_ratio =
                (0..config.model.count).map(ratio).fold(report.engage_first_second_velocity_ratio, f64::max);
        }
    }
}

/// Returns the least clearance that is allowed in an unproved stop from `held`, m. It is the bound for the
/// joints' true motion, or the present clearance if that is less.
fn allowed(config: &Config, held: &Setpoint, workspace: &mut Workspace) -> f64 {
    let (clearance_m, _) = config.body.clearance(&config.model, &held.q, workspace);
    let margin_m = if held.v == [0.0; JOINTS_MAX] { 0.0 } else { CLEARANCE_MARGIN_M };
    clearance_m.min(config.body.d_min_m - margin_m)
}

/// Returns the index by which a driver that stops from `held` by itself stands. No joint takes longer than |v| /
/// A + 2 A / J.
fn own_stop_end(config: &Config, held: &Setpoint) -> u64 {
    let took_s = |j: usize| {
        let limits = &config.limits[j];
        held.v[j].abs() / limits.a_max + 2.0 * limits.a_max / limits.j_max
    };
    let longest_s = (0..config.model.count).filter(|&j| held.v[j] != 0.0).map(took_s).fold(0.0, f64::max);
    held.k.saturating_add((longest_s * TICK_HZ as f64).ceil() as u64)
}

fn points(config: &Config, frames: &mut Frames, q: &[f64; JOINTS_MAX]) -> Points {
    config.model.forward(q, frames);
    config.speed_points.map(|point| {
        let at = frames.base_from_body[point.body].transform_point(&point.at);
        [at[0], at[1], at[2]]
    })
}

fn count(report: &mut Report, kind: ViolationKind, k: u64, which: usize, value: f64, limit: f64) {
    report.counts[kind as usize] += 1;
    report.first_violation.get_or_insert(Violation { kind, k, which, value, limit });
}

/// Checks position and velocity of one joint. It tests that the limits hold and counts each failure, so NaN is a
/// violation.
fn check_place(config: &Config, report: &mut Report, from: &Setpoint, to: &Setpoint, j: usize) {
    let (limits, q) = (&config.limits[j], to.q[j]);
    let (mut slack_q, mut slack_v) = (TOLERANCE_Q, TOLERANCE_V);
    if config.interface.has_controllers() {
        slack_q += spline_error(limits.j_max);
        slack_v += spline_speed_error(limits.j_max);
    }
    let (mut q_min, mut q_max) = (limits.q_min, limits.q_max);
    if config.initial_outside {
        (q_min, q_max) = (q_min.min(from.q[j]), q_max.max(from.q[j]));
    }
    let inside = q >= q_min - slack_q && q <= q_max + slack_q;
    if !inside {
        let limit = if q < q_min { q_min } else { q_max };
        count(report, ViolationKind::Position, to.k, j, q, limit);
    }
    let peak = peak_velocity(from, to, j);
    let slow = peak <= limits.v_max + slack_v;
    if !slow {
        count(report, ViolationKind::Velocity, to.k, j, peak, limits.v_max);
    }
}

/// Checks the torques that the links' motion needs from the motors.
fn check_torques(config: &Config, report: &mut Report, to: &Setpoint) {
    let torques = config.links.torques(&to.q, &to.v, &to.a);
    report.torque_share = 0.0;
    for (j, torque) in torques.into_iter().enumerate() {
        let effort = config.limits[j].effort_max;
        let share = torque.abs() / effort;
        report.torque_share_max[j] = report.torque_share_max[j].max(share);
        report.torque_share = report.torque_share.max(share);
        let within = torque.abs() <= effort;
        if !within {
            count(report, ViolationKind::Torque, to.k, j, torque, effort);
        }
    }
}

/// Checks acceleration and jerk of one joint over one step.
fn check_change(config: &Config, report: &mut Report, from: &Setpoint, to: &Setpoint, j: usize) {
    let limits = &config.limits[j];
    let (q, v, a) = (to.q[j], to.v[j], to.a[j]);
    let gentle = a.abs() <= limits.a_max + TOLERANCE_A;
    if !gentle {
        count(report, ViolationKind::Acceleration, to.k, j, a, limits.a_max);
    }
    let dt = to.k.saturating_sub(from.k) as f64 * TICK_S;
    let jerk = (a - from.a[j]).abs() / dt;
    let off_v = (v - from.v[j] - (a + from.a[j]) / 2.0 * dt).abs();
    let off_q = (q - from.q[j] - (v + from.v[j]) / 2.0 * dt).abs();
    let within = jerk <= limits.j_max + TOLERANCE_J
        && off_v <= limits.j_max * dt * dt / 4.0 + TOLERANCE_V
        && off_q <= limits.j_max * dt * dt * dt / 12.0 + TOLERANCE_Q;
    if !within {
        let needed = jerk.max(4.0 * off_v / (dt * dt)).max(12.0 * off_q / (dt * dt * dt));
        count(report, ViolationKind::Jerk, to.k, j, needed, limits.j_max);
    }
}

/// Returns the largest speed of joint `j` on the way. It looks at the ends. If the step is one tick of constant jerk,
/// it also looks where the acceleration passes zero: there v = v' - a'^2 / 2J. A plan's tick with a change of phase
/// inside peaks where a phase ends. The acceleration is zero there only if the ends show it, so it checks the ends.
fn peak_velocity(from: &Setpoint, to: &Setpoint, j: usize) -> f64 {
    let ends = to.v[j].abs().max(from.v[j].abs());
    let (a0, a1) = (from.a[j], to.a[j]);
    let constant_jerk = (to.v[j] - from.v[j] - (a0 + a1) / 2.0 * TICK_S).abs() <= TOLERANCE_V;
    if to.k == from.k + 1 && constant_jerk && a0 * a1 < 0.0 {
        let jerk = (a1 - a0) / TICK_S;
        return ends.max((from.v[j] - a0 * a0 / (2.0 * jerk)).abs());
    }
    ends
}
