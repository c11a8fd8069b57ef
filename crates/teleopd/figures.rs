//! Figures that control collects for the report: limb and tracking errors while engaged, and every transition.

use messages::{FAULTS, JOINTS_MAX, Mode, RobotState, TICK_HZ, Transition};
use robot::Model;
use rt::Histogram;
use serde_json::{Value, json};

/// Number of transitions kept. They describe a run with more transitions well enough.
const TRANSITIONS_MAX: usize = 1024;

/// Unit conversion: one microdegree counts as one nanosecond of the histogram.
const UNITS_PER_DEGREE: f64 = 1e6;

/// Sums over the time in which the robot followed.
#[derive(Default)]
pub struct Following {
    target: ErrorSums,
    measured: ErrorSums,
    /// Same as `measured`, but also while the robot held. Counts from the first engagement, while the robot
    /// should follow.
    throughout: ErrorSums,
    meant: bool,
    /// Joints whose tracking counts: bit j is joint j. Joints that slide are not measured in rad.
    turning: u32,
    tracking_squares: f64,
    tracking_max: f64,
    tracking_count: u64,
    transitions: Vec<Transition>,
    /// Fault counts when the robot first left Disengaged. `None` before that.
    before_engaging: Option<[u32; FAULTS.len()]>,
}

#[derive(Default)]
struct ErrorSums {
    sum_rad: f64,
    count: u64,
    spread: Histogram,
}

impl ErrorSums {
    fn add(&mut self, error_rad: f64) {
        self.sum_rad += error_rad;
        self.count += 1;
        self.spread.record_ns((error_rad.to_degrees() * UNITS_PER_DEGREE) as u64);
    }

    fn to_json(&self) -> Value {
        let known = self.count > 0;
        let mean = known.then(|| (self.sum_rad / self.count as f64).to_degrees());
        let p95 = known.then(|| self.spread.quantile_us(0.95) * 1e3 / UNITS_PER_DEGREE);
        json!({ "mean": mean, "p95": p95, "count": self.count })
    }
}

impl Following {
    pub fn new(model: &Model) -> Self {
        let turns = (0..model.count).filter(|&j| !model.prismatic[j]);
        Self {
            turning: turns.map(|j| 1 << j).sum(),
            transitions: Vec::with_capacity(TRANSITIONS_MAX),
            ..Self::default()
        }
    }

    /// Adds a tick, and the robot state if it was new in this tick.
    pub fn add(&mut self, out: &control::Output, robot: Option<&RobotState>) {
        if let Some(transition) = out.transition {
            if self.transitions.len() < TRANSITIONS_MAX {
                self.transitions.push(transition);
            }
            if transition.to == Mode::Engaging as u32 {
                self.before_engaging.get_or_insert(out.status.fault_counts);
            }
            self.meant = is_meant(self.meant, &transition);
        }
        if self.meant {
            self.throughout.add(out.status.limb_error_measured_rad);
        }
        if out.status.mode != Mode::Engaged as u32 {
            return;
        }
        self.target.add(out.status.limb_error_target_rad);
        self.measured.add(out.status.limb_error_measured_rad);
        if let Some(robot) = robot {
            for j in (0..JOINTS_MAX).filter(|j| self.turning >> j & 1 == 1) {
                let error = robot.q[j] - robot.q_measured[j];
                self.tracking_squares += error * error;
                self.tracking_max = self.tracking_max.max(error.abs());
                self.tracking_count += 1;
            }
        }
    }

    pub fn to_json(&self) -> Value {
        let rms = (self.tracking_squares / self.tracking_count.max(1) as f64).sqrt();
        let first = self.transitions.first().map_or(0, |transition| transition.k);
        let mut meant = false;
        let transitions: Vec<Value> = self
            .transitions
            .iter()
            .map(|transition| {
                let name = |mode: u32| Mode::from_u32(mode).map_or("?", Mode::name);
                meant = is_meant(meant, transition);
                json!({
                    "t_s": (transition.k - first) as f64 / TICK_HZ as f64,
                    "k": transition.k,
                    "from": name(transition.from),
                    "to": name(transition.to),
                    "why": transition.why_name(),
                    "meant_to_follow": meant,
                })
            })
            .collect();
        json!({
            "limb_error_deg": {
                "target": self.target.to_json(),
                "measured": self.measured.to_json(),
                "throughout": self.throughout.to_json(),
            },
            "tracking_error_rad": { "rms": rms, "max": self.tracking_max },
            "mode_transitions": transitions,
            "faults_before_engaging": self.before_engaging.map(counted),
        })
    }
}

/// Returns true if the operator wants the robot to follow after this transition. This begins with Engaged and
/// lasts through every hold. It ends with a release or with Disengaged.
fn is_meant(before: bool, transition: &Transition) -> bool {
    let let_go = transition.why == Transition::RELEASED || transition.to == Mode::Disengaged as u32;
    !let_go && (before || transition.to == Mode::Engaged as u32)
}

fn counted(counts: [u32; FAULTS.len()]) -> Value {
    let raised = FAULTS.iter().map(|row| (row.name, counts[row.fault.index()])).filter(|(_, count)| *count > 0);
    Value::Object(raised.map(|(name, count)| (name.to_owned(), json!(count))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn robot_is_meant_to_follow_through_holds_until_release() {
        let mut meant = false;
        let mut after = |to: Mode, why: u32| {
            meant = is_meant(meant, &Transition { to: to as u32, why, ..Transition::ZERO });
            meant
        };
        assert!(!after(Mode::Engaging, Transition::ENABLED), "it has yet to come to the person");
        assert!(after(Mode::Engaged, Transition::ALIGNED));
        assert!(after(Mode::Holding, 0) && after(Mode::Engaging, Transition::SETTLED) && after(Mode::Engaged, 0));
        assert!(!after(Mode::Holding, Transition::RELEASED) && !after(Mode::Disengaged, Transition::AT_REST));
        assert!(!after(Mode::Engaging, Transition::ENABLED) && after(Mode::Engaged, Transition::ALIGNED));
        assert!(!after(Mode::Disengaged, 0), "a hold that lasted too long");
    }
}
