//! Judges one command after the other with arithmetic of its own: limits, continuity, the plan, and distances.

use crate::joint::stop_of;
use crate::limits::{self, Slack};
use crate::robot::Robot;
use crate::rollout::{Rollout, joint_of};
use messages::{JOINTS_MAX, JointMotion};

/// Rounding of positions, velocities and accelerations that another formula recomputes. Limits hold exactly.
const SLACK: Slack = Slack { state: 0.0, jerk: 0.0, step: 1e-11, rest: 1e-9 };
/// Time between two postures of a plan that is judged densely, s.
const DENSE_S: f64 = 1e-3;
/// Number of violations that are described in words.
const TOLD: usize = 8;

/// Judges a sequence of commands.
pub struct Checker<'a> {
    robot: &'a Robot,
    before: JointMotion,
    /// Smallest clearance seen, m.
    pub clearance_m: f64,
    /// Number of violations.
    pub violations: u64,
    /// The first violations in words.
    pub first: Vec<String>,
}

impl<'a> Checker<'a> {
    /// Begins with a robot that moves as `start` says.
    pub fn new(robot: &'a Robot, start: JointMotion) -> Self {
        Self { robot, before: start, clearance_m: f64::INFINITY, violations: 0, first: Vec::new() }
    }

    fn violated(&mut self, words: impl FnOnce() -> String) {
        self.violations += 1;
        if self.first.len() < TOLD {
            self.first.push(words());
        }
    }

    /// Judges the command of tick `k`. The joints of the mask `on_plan` play the plan before, the others begin a new
    /// motion. `dense` also judges the postures of the command's plan every millisecond.
    pub fn command(&mut self, k: u64, now: &JointMotion, on_plan: u32, dense: bool) {
        for (j, limits) in self.robot.limits.iter().enumerate() {
            let (last, next) = (joint_of(&self.before, j), joint_of(now, j));
            let step = if on_plan & 1 << j == 0 {
                limits::by_jerk(limits, last, next, SLACK)
            } else {
                limits::along_plan(limits, last, &stop_of(&self.before.plan, j), next, SLACK)
            };
            let stop = stop_of(&now.plan, j);
            if let Some(found) = step.or_else(|| limits::plan(limits, next, &stop, SLACK)) {
                self.violated(|| format!("k {k} joint {j}: {}: {last:?} {next:?} {stop:?}", found.what));
            }
        }
        self.posture(k, &now.q, "command");
        if dense {
            for q in Rollout::new(now).postures(DENSE_S) {
                self.posture(k, &q, "plan");
            }
        }
        self.before = *now;
    }

    fn posture(&mut self, k: u64, q: &[f64; JOINTS_MAX], what: &str) {
        let clearance_m = self.robot.clearance(q);
        self.clearance_m = self.clearance_m.min(clearance_m);
        let clear = clearance_m >= self.robot.d_min_m;
        if !clear {
            self.violated(|| format!("k {k}: clearance of the {what} {clearance_m}"));
        }
    }
}
