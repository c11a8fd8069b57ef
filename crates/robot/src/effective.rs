//! Limits in force: those of the URDF, with the robot file's additions and tighter values.

use crate::error::RobotError;
use crate::file::{Limits, RevoluteGroup, Tighten};
use crate::limits::{JointLimits, Plausible};
use crate::model::Source;
use crate::urdf::Tree;
use messages::{ARM_JOINTS, HEAD, JOINTS, LEFT_ARM, TORSO};

impl Source<'_> {
    /// Returns the limits of the URDF, after a check that all are plausible.
    pub(crate) fn urdf_limits(
        &self,
        at: &[usize; JOINTS],
        prismatic: &[bool; JOINTS],
        tree: &Tree,
    ) -> Result<[JointLimits; JOINTS], RobotError> {
        let mut limits =
            [JointLimits { q_min: 0.0, q_max: 0.0, v_max: 0.0, a_max: 0.0, j_max: 0.0, effort_max: 0.0 }; JOINTS];
        for j in 0..JOINTS {
            let (joint, plausible) = (&tree.joints[at[j]], Plausible::of(prismatic[j]));
            let limit = &joint.limit;
            let refuse =
                |key: &str, value: f64, bound: String| Err(self.joint(self.urdf, &joint.name, key, value, bound));
            for (key, value) in [("limit lower", limit.lower), ("limit upper", limit.upper)] {
                if !(value.abs() <= plausible.position) {
                    return refuse(key, value, format!("must be at most {} in magnitude", plausible.position));
                }
            }
            if !(limit.lower < limit.upper) {
                return refuse("limit lower", limit.lower, format!("must be below limit upper = {}", limit.upper));
            }
            let positive = [
                ("limit velocity", limit.velocity, plausible.speed),
                ("limit effort", limit.effort, plausible.effort),
                ("limit acceleration", limit.acceleration.min(limit.deceleration), f64::INFINITY),
                ("limit jerk", limit.jerk, f64::INFINITY),
            ];
            for (key, value, most) in positive {
                if !(value > 0.0 && value <= most) {
                    return refuse(key, value, format!("must be above 0 and at most {most}"));
                }
            }
            limits[j] = JointLimits {
                q_min: limit.lower,
                q_max: limit.upper,
                v_max: limit.velocity,
                a_max: limit.acceleration.min(limit.deceleration),
                j_max: limit.jerk,
                effort_max: limit.effort,
            };
        }
        Ok(limits)
    }

    /// The limits in force of joint `j`. They are the URDF's, inside the soft margin, with acceleration and
    /// jerk of the joint's group, and with the file's tighter values.
    pub(crate) fn effective(
        &self,
        j: usize,
        name: &str,
        prismatic: bool,
        urdf: &JointLimits,
        groups: &Limits,
        tighten: Option<&Tighten>,
    ) -> Result<JointLimits, RobotError> {
        let (group, margin, acceleration, jerk) = group_of(j, groups);
        let plausible = Plausible::of(prismatic);
        let refuse = |key: &str, value: f64, bound: String| self.joint(self.toml, name, key, value, bound);
        let reach = 0.5 * (urdf.q_max - urdf.q_min);
        if !(margin >= 0.0 && margin < reach) {
            let key = format!("limits.{group}.soft_margin");
            return Err(refuse(&key, margin, format!("must be at least 0 and below half the range, {reach}")));
        }
        let bounds = [
            ("acceleration_max", acceleration, plausible.acceleration.min(urdf.a_max)),
            ("jerk_max", jerk, plausible.jerk.min(urdf.j_max)),
        ];
        for (key, value, most) in bounds {
            if !(value > 0.0 && value <= most) {
                let key = format!("limits.{group}.{key}");
                return Err(refuse(&key, value, format!("must be above 0 and at most {most}")));
            }
        }
        let mut limits = JointLimits {
            q_min: urdf.q_min + margin,
            q_max: urdf.q_max - margin,
            a_max: acceleration,
            j_max: jerk,
            ..*urdf
        };
        if let Some(tighten) = tighten {
            self.tighten(name, prismatic, tighten, &mut limits)?;
        }
        let stop_time_max_s = groups.stop_time_max_ms * 1e-3;
        // The project guarantees half a second. A longer time in a file would break this guarantee.
        if !(groups.stop_time_max_ms > 0.0 && groups.stop_time_max_ms <= 500.0) {
            let value = groups.stop_time_max_ms.to_string();
            return Err(self.value("limits.stop_time_max_ms", value, "must be above 0 and at most 500"));
        }
        if !(limits.stop_time_s() <= stop_time_max_s) {
            let bound = format!("at most limits.stop_time_max_ms = {}", groups.stop_time_max_ms);
            return Err(refuse("stop time from the highest speed in ms", limits.stop_time_s() * 1e3, bound));
        }
        Ok(limits)
    }

    fn tighten(
        &self,
        name: &str,
        prismatic: bool,
        tighten: &Tighten,
        limits: &mut JointLimits,
    ) -> Result<(), RobotError> {
        let rad = [
            ("position_min_rad", tighten.position_min_rad),
            ("position_max_rad", tighten.position_max_rad),
            ("velocity_max_rad_per_s", tighten.velocity_max_rad_per_s),
            ("acceleration_max_rad_per_s2", tighten.acceleration_max_rad_per_s2),
            ("effort_max_n_m", tighten.effort_max_n_m),
        ];
        let metre = [
            ("position_min_m", tighten.position_min_m),
            ("position_max_m", tighten.position_max_m),
            ("velocity_max_m_per_s", tighten.velocity_max_m_per_s),
            ("acceleration_max_m_per_s2", tighten.acceleration_max_m_per_s2),
            ("effort_max_n", tighten.effort_max_n),
        ];
        let (own, foreign) = if prismatic { (metre, rad) } else { (rad, metre) };
        let refuse = |key: &str, value: f64, bound: String| {
            Err(self.joint(self.toml, name, &format!("tighten.{key}"), value, bound))
        };
        if let Some((key, Some(value))) = foreign.into_iter().find(|(_, value)| value.is_some()) {
            return refuse(key, value, "has the wrong unit for this joint".into());
        }
        let [(min_key, min), (max_key, max), velocity, acceleration, effort] = own;
        let (lower, upper) = (limits.q_min, limits.q_max);
        if let Some(min) = min {
            if !(min >= lower && min < upper) {
                return refuse(min_key, min, format!("may only tighten: must be within [{lower}, {upper})"));
            }
            limits.q_min = min;
        }
        if let Some(max) = max {
            if !(max <= upper && max > limits.q_min) {
                return refuse(max_key, max, format!("may only tighten: must be within ({}, {upper}]", limits.q_min));
            }
            limits.q_max = max;
        }
        for ((key, value), limit) in
            [(velocity, &mut limits.v_max), (acceleration, &mut limits.a_max), (effort, &mut limits.effort_max)]
        {
            let Some(value) = value else { continue };
            if !(value > 0.0 && value <= *limit) {
                return refuse(key, value, format!("may only tighten: must be above 0 and at most {limit}"));
            }
            *limit = value;
        }
        Ok(())
    }
}

/// Name, soft margin, acceleration and jerk of the group of joint `j`, SI.
fn group_of(j: usize, groups: &Limits) -> (&'static str, f64, f64, f64) {
    let revolute = |name, group: &RevoluteGroup| {
        (name, group.soft_margin_rad, group.acceleration_max_rad_per_s2, group.jerk_max_rad_per_s3)
    };
    if j == TORSO {
        let group = &groups.torso;
        ("torso", group.soft_margin_m, group.acceleration_max_m_per_s2, group.jerk_max_m_per_s3)
    } else if HEAD.contains(&j) {
        revolute("head", &groups.head)
    } else if (j - LEFT_ARM.start) % ARM_JOINTS < 4 {
        revolute("arm_1_to_4", &groups.arm_1_to_4)
    } else {
        revolute("arm_5_to_7", &groups.arm_5_to_7)
    }
}
