//! Compares the joints' true motion with the limits, in wall time, no matter which process was late.

use crate::apart::Apart;
use crate::config::{Config, Obstacle};
use crate::distance::{segment_box, segment_plane, segment_segment};
use crate::kinematics::Frames;
use crate::plant::{Setpoint, Truth};
use crate::report::{Report, ViolationKind};
use messages::{JOINTS_MAX, Stamp};
use nalgebra::Vector3;

/// Steps between two looks: 2 ms.
pub const JUDGE_STEPS: u64 = 4;
/// Permitted true speed over the limit in force. Assumption: 1.05, a servo's overshoot.
pub const SPEED_OVERSHOOT: f64 = 1.05;
/// Setpoints may be this much closer together in wall time than by index, ns. The sender drops a setpoint that is
/// more than two ticks of 1/1500 s late, and a wake-up takes a tick.
pub const JITTER_ALLOWANCE_NS: u64 = 2_000_000;

/// Rounding of positions and torques.
const ROUNDING: f64 = 1e-9;

/// Largest amount by which a true clearance may be below the least one, m. No end of a capsule was more than 5.5
/// mm off at all limits at once, rounded up (1.4 mm in the motions above). It stays above the robot file's
/// clearance_measured_min_mm.
pub const CLEARANCE_MARGIN_M: f64 = 0.006;

/// State of the judge.
#[derive(Clone, Debug)]
pub struct Judge {
    report: Report,
    /// The last setpoint that was taken: time, positions, velocities.
    last: Option<(Stamp, [f64; JOINTS_MAX], [f64; JOINTS_MAX])>,
    /// Time that each joint may still spend on motion, and on change of velocity, s.
    time_left_s: [[f64; JOINTS_MAX]; 2],
    /// End of the last gap that was longer than the jitter allowance.
    gap_end: Stamp,
    /// Distance of each joint outside the URDF's limits and the limits in force that is allowed. 0 for a robot
    /// that starts inside.
    outside: [[f64; JOINTS_MAX]; 2],
    /// Least clearance that must be kept, m.
    clearance_m: f64,
    frames: Frames,
    segments: Vec<[Vector3<f64>; 2]>,
    before: Vec<[Vector3<f64>; 2]>,
    apart: Apart,
}

impl Judge {
    /// Begins with a robot that stands at `q`.
    pub fn new(config: &Config, q: &[f64; JOINTS_MAX]) -> Self {
        let body = &config.links.body;
        let segments = vec![[Vector3::zeros(); 2]; body.capsules.len()];
        let pairs = body.pairs.len() + body.capsules.len() * config.options.obstacles.len();
        let mut judge = Self {
            report: Report::default(),
            last: None,
            time_left_s: [[0.0; JOINTS_MAX]; 2],
            gap_end: Stamp::NONE,
            outside: [[0.0; JOINTS_MAX]; 2],
            clearance_m: config.links.body.d_min_m,
            frames: Frames::default(),
            apart: Apart::new(segments.len(), pairs),
            before: segments.clone(),
            segments,
        };
        if config.options.initial_outside {
            for (j, joint) in config.links.body.joints.iter().enumerate() {
                for (outside, limits) in judge.outside.iter_mut().zip([&joint.urdf, &joint.limits]) {
                    outside[j] = (limits.q_min - q[j]).max(q[j] - limits.q_max).max(0.0);
                }
            }
            judge.clearance_m = judge.clearance(config, q).0.min(config.links.body.d_min_m);
        }
        judge
    }

    /// Returns the report so far.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Compares the truth with the limits.
    pub fn look(&mut self, config: &Config, truth: &Truth) {
        self.report.looks += 1;
        for (j, joint) in config.links.body.joints.iter().enumerate() {
            let (q, v, tau) = (truth.q[j], truth.v[j], truth.tau[j]);
            let report = &mut self.report;
            let rows = [(ViolationKind::Stop, &joint.urdf), (ViolationKind::Position, &joint.limits)];
            for (outside, (kind, limits)) in self.outside.iter_mut().zip(rows) {
                let outside = &mut outside[j];
                let beyond = (limits.q_min - q).max(q - limits.q_max);
                let lags = kind == ViolationKind::Position && beyond > *outside + ROUNDING;
                let margin = if lags { config.lags(&truth.q, &truth.v)[j] } else { ROUNDING };
                // A position that is not certainly inside is outside, so NaN counts.
                let inside = beyond <= *outside + margin;
                if !inside {
                    let bound = if q < limits.q_min { limits.q_min } else { limits.q_max };
                    report.count_violation(kind, truth.stamp, j, q, bound);
                }
                *outside = outside.min(beyond.max(0.0));
            }
            let rows = [
                (ViolationKind::Velocity, v.abs(), SPEED_OVERSHOOT * joint.limits.v_max),
                (ViolationKind::Effort, tau.abs(), joint.limits.effort_max + ROUNDING),
            ];
            for (kind, value, bound) in rows {
                let within = value <= bound;
                if !within {
                    report.count_violation(kind, truth.stamp, j, value, bound);
                }
            }
            report.q_min[j] = report.q_min[j].min(q);
            report.q_max[j] = report.q_max[j].max(q);
            report.speed_ratio_max[j] = report.speed_ratio_max[j].max(v.abs() / joint.limits.v_max);
            report.effort_ratio_max[j] = report.effort_ratio_max[j].max(tau.abs() / joint.limits.effort_max);
        }
        let (clearance_m, pair) = self.clearance(config, &truth.q);
        self.report.clearance_m = clearance_m;
        self.report.clearance_min_m = self.report.clearance_min_m.min(clearance_m);
        let bound = self.clearance_m - CLEARANCE_MARGIN_M;
        let clear = clearance_m >= bound;
        if !clear {
            self.report.count_violation(ViolationKind::Clearance, truth.stamp, pair, clearance_m, bound);
        }
        self.clearance_m = self.clearance_m.max(clearance_m.min(config.links.body.d_min_m));
    }

    /// Compares a setpoint that the robot took with the one before, in wall time. `begins` says that it is the first
    /// after a start or a reaction. Then there is none to compare it with, but the robot has checked that it is near.
    ///
    /// Each joint has an account of time. Wall time is paid in, and |dq| / v_max and |dv| / a_max are taken out.
    /// No more than the jitter allowance is carried over, so no sender moves faster than the limits for longer. A
    /// sender that slept may send the setpoints that it missed within the jitter allowance after its sleep.
    pub fn received(&mut self, config: &Config, now: Stamp, setpoint: &Setpoint, begins: bool) {
        let allowance_s = JITTER_ALLOWANCE_NS as f64 * 1e-9;
        self.report.setpoints += 1;
        let last = self.last.filter(|_| !begins);
        self.last = Some((now, setpoint.q, setpoint.v));
        let Some((at, q, v)) = last else {
            self.time_left_s = [[allowance_s; JOINTS_MAX]; 2];
            return;
        };
        let elapsed_s = now.since(at) as f64 * 1e-9;
        let slept = now.since(at) > JITTER_ALLOWANCE_NS;
        let catching_up = !slept && now.since(self.gap_end) <= JITTER_ALLOWANCE_NS;
        if slept {
            self.gap_end = now;
        }
        for (j, joint) in config.links.body.joints.iter().enumerate() {
            let rows = [
                (ViolationKind::SetpointStep, (setpoint.q[j] - q[j]).abs(), joint.limits.v_max),
                (ViolationKind::SetpointChange, (setpoint.v[j] - v[j]).abs(), joint.limits.a_max),
            ];
            for (left_s, (kind, change, rate)) in self.time_left_s.iter_mut().zip(rows) {
                let carried_s = if catching_up { left_s[j] } else { left_s[j].min(allowance_s) };
                let available_s = carried_s + elapsed_s;
                let within = change <= rate * available_s + ROUNDING;
                if !within {
                    self.report.count_violation(kind, now, j, change, rate * available_s);
                }
                left_s[j] = (available_s - change / rate).max(0.0);
            }
        }
    }

    /// Returns the least clearance at `q`, m, and the index of that pair as in [`crate::Violation::which`].
    pub fn clearance(&mut self, config: &Config, q: &[f64; JOINTS_MAX]) -> (f64, usize) {
        let body = &config.links.body;
        body.forward(q, &mut self.frames);
        std::mem::swap(&mut self.segments, &mut self.before);
        for (segment, capsule) in self.segments.iter_mut().zip(&body.capsules) {
            *segment = capsule.ends.map(|end| self.frames.base_from_body[capsule.body].point(&end));
        }
        let moves = self.before.iter().zip(&self.segments);
        self.apart.look(moves.map(|(from, to)| [0, 1].map(|end| (to[end] - from[end]).norm_squared())));
        let (nearest, obstacles) = (self.apart.nearest, config.options.obstacles.len());
        let mut least = (f64::INFINITY, 0);
        if let Some(&[a, b]) = body.pairs.get(nearest) {
            least = (self.pair_clearance(config, a, b), nearest);
        }
        for (index, &[a, b]) in body.pairs.iter().enumerate() {
            if self.apart.is_beyond(index, [a, b], least.0) {
                continue;
            }
            let clearance_m = self.pair_clearance(config, a, b);
            self.apart.set(index, [a, b], clearance_m);
            if is_less(clearance_m, least.0) || (clearance_m == least.0 && index < least.1) {
                least = (clearance_m, index);
            }
        }
        for i in (0..body.capsules.len()).filter(|&i| body.capsules[i].body != 0) {
            for (k, obstacle) in config.options.obstacles.iter().enumerate() {
                let (index, sides) = (body.pairs.len() + i * obstacles + k, [i, body.capsules.len()]);
                if self.apart.is_beyond(index, sides, least.0) {
                    continue;
                }
                let clearance_m = distance(obstacle, &self.segments[i]) - body.capsules[i].radius_m;
                self.apart.set(index, sides, clearance_m);
                if is_less(clearance_m, least.0) {
                    least = (clearance_m, index);
                }
            }
        }
        self.apart.nearest = least.1;
        least
    }

    fn pair_clearance(&self, config: &Config, a: usize, b: usize) -> f64 {
        let capsules = &config.links.body.capsules;
        segment_segment(&self.segments[a], &self.segments[b]) - (capsules[a].radius_m + capsules[b].radius_m)
    }
}

/// Returns true if a clearance is the least so far. The first NaN is, and it stays.
fn is_less(clearance_m: f64, least_m: f64) -> bool {
    clearance_m < least_m || (clearance_m.is_nan() && !least_m.is_nan())
}

fn distance(obstacle: &Obstacle, segment: &[Vector3<f64>; 2]) -> f64 {
    match obstacle {
        Obstacle::Plane { normal, offset_m } => segment_plane(segment, normal, *offset_m),
        Obstacle::Box { center, r, half_m } => segment_box(&segment.map(|p| r.transpose() * (p - center)), half_m),
    }
}
