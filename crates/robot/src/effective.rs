//! Limits in force: those of the URDF, with the robot file's additions and tighter values.

use crate::commanded::CommandedJoints;
use crate::error::RobotError;
use crate::file::{Group, Limits, Tighten};
use crate::limits::{JointLimits, Plausible};
use crate::model::{NO_JOINT, Source};
use crate::urdf::{Tree, UrdfJoint};
use messages::JOINTS_MAX;
use std::collections::BTreeMap;
use urdf_rs::JointType;

/// Returns true for each of range, speed and effort that a URDF states for a joint: it is plausible.
pub(crate) fn stated(joint: &UrdfJoint) -> [bool; 3] {
    let (limit, plausible) = (&joint.limit, Plausible::for_joint(joint.kind == JointType::Prismatic));
    let ends = limit.lower.abs().max(limit.upper.abs()) <= plausible.position;
    [
        joint.kind != JointType::Continuous && limit.lower < limit.upper && ends,
        limit.velocity > 0.0 && limit.velocity <= plausible.speed,
        limit.effort > 0.0 && limit.effort <= plausible.effort,
    ]
}

impl Source<'_> {
    /// Returns the limits of the URDF, after a check that all are plausible.
    pub(crate) fn urdf_limits(
        &self,
        commanded: &CommandedJoints,
        tree: &Tree,
    ) -> Result<[JointLimits; JOINTS_MAX], RobotError> {
        let (mut limits, mut errors) = ([NO_JOINT; JOINTS_MAX], Vec::new());
        for (limits, at) in limits.iter_mut().zip(&commanded.at) {
            *limits = RobotError::keep(self.limits_of(&tree.joints[*at]), &mut errors).unwrap_or(NO_JOINT);
        }
        RobotError::all(errors).map(|()| limits)
    }

    /// Returns the URDF's limits of a joint, after a check that they are plausible.
    pub(crate) fn limits_of(&self, joint: &UrdfJoint) -> Result<JointLimits, RobotError> {
        let (limit, plausible) = (&joint.limit, Plausible::for_joint(joint.kind == JointType::Prismatic));
        let refuse =
            |key: &str, value: f64, bound: String| Err(self.joint(&self.line(joint), &joint.name, key, value, bound));
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
        Ok(JointLimits {
            q_min: limit.lower,
            q_max: limit.upper,
            v_max: limit.velocity,
            a_max: limit.acceleration.min(limit.deceleration),
            j_max: limit.jerk,
            effort_max: limit.effort,
        })
    }

    pub(crate) fn groups<'f>(
        &self,
        limits: &'f Limits,
        names: &[String],
    ) -> Result<Vec<(&'f str, &'f Group)>, RobotError> {
        // The project guarantees half a second. A longer time in a file would break this guarantee.
        if !(limits.stop_time_max_ms > 0.0 && limits.stop_time_max_ms <= 500.0) {
            let value = schema::short(limits.stop_time_max_ms);
            return Err(self.value("limits.stop_time_max_ms", value, "must be above 0 and at most 500"));
        }
        let lists =
            limits.groups.iter().map(|(name, group)| (format!("limits.groups.{name}"), group.joints.as_slice()));
        let owners = self.partition(lists, names, "one of limits.groups")?;
        let all: Vec<(&str, &Group)> = limits.groups.iter().map(|(name, group)| (name.as_str(), group)).collect();
        Ok(owners.into_iter().map(|owner| all[owner]).collect())
    }

    /// The limits in force of a joint. They are the URDF's, inside the soft margin, with acceleration, jerk and
    /// perhaps a lower speed of the joint's group, and with the file's tighter values.
    pub(crate) fn effective(
        &self,
        name: &str,
        prismatic: bool,
        urdf: &JointLimits,
        (group_name, group): (&str, &Group),
        tighten: Option<&Tighten>,
        stop_time_max_ms: f64,
    ) -> Result<JointLimits, RobotError> {
        let (margin, velocity, acceleration, jerk) = self.of_group(name, prismatic, group_name, group)?;
        let plausible = Plausible::for_joint(prismatic);
        let refuse = |key: &str, value: f64, bound: String| self.joint(self.toml, name, key, value, bound);
        let (reach, unit) = (0.5 * (urdf.q_max - urdf.q_min), if prismatic { "m" } else { "rad" });
        if !(margin >= 0.0 && margin < reach) {
            let key = format!("limits.groups.{group_name}.soft_margin_{unit}");
            return Err(refuse(&key, margin, format!("must be at least 0 and below half the range, {reach}")));
        }
        let bounds = [
            ("velocity_max", "s", velocity.unwrap_or(urdf.v_max), urdf.v_max),
            ("acceleration_max", "s2", acceleration, plausible.acceleration.min(urdf.a_max)),
            ("jerk_max", "s3", jerk, plausible.jerk.min(urdf.j_max)),
        ];
        for (key, time, value, most) in bounds {
            if !(value > 0.0 && value <= most) {
                let key = format!("limits.groups.{group_name}.{key}_{unit}_per_{time}");
                return Err(refuse(&key, value, format!("must be above 0 and at most {most}")));
            }
        }
        let mut limits = JointLimits {
            q_min: urdf.q_min + margin,
            q_max: urdf.q_max - margin,
            v_max: velocity.unwrap_or(urdf.v_max),
            a_max: acceleration,
            j_max: jerk,
            ..*urdf
        };
        if let Some(tighten) = tighten {
            self.tighten(name, prismatic, tighten, &mut limits)?;
        }
        if !(limits.stop_time_s() * 1e3 <= stop_time_max_ms) {
            let bound = format!("at most limits.stop_time_max_ms = {stop_time_max_ms}");
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
        let own = self.own_limits("tighten", name, prismatic, tighten)?;
        let refuse = |key: &str, value: f64, bound: String| {
            Err(self.joint(self.toml, name, &format!("tighten.{key}"), value, bound))
        };
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

    /// Least and greatest position, speed, acceleration and effort of a joint in a table, SI, with their keys. Their unit must
    /// be the joint's.
    fn own_limits(
        &self,
        table: &str,
        name: &str,
        prismatic: bool,
        given: &Tighten,
    ) -> Result<[(&'static str, Option<f64>); 5], RobotError> {
        let rad = [
            ("position_min_rad", given.position_min_rad),
            ("position_max_rad", given.position_max_rad),
            ("velocity_max_rad_per_s", given.velocity_max_rad_per_s),
            ("acceleration_max_rad_per_s2", given.acceleration_max_rad_per_s2),
            ("effort_max_n_m", given.effort_max_n_m),
        ];
        let metre = [
            ("position_min_m", given.position_min_m),
            ("position_max_m", given.position_max_m),
            ("velocity_max_m_per_s", given.velocity_max_m_per_s),
            ("acceleration_max_m_per_s2", given.acceleration_max_m_per_s2),
            ("effort_max_n", given.effort_max_n),
        ];
        self.in_unit(name, |key| format!("{table}.{key}"), prismatic, [rad, metre])
    }

    /// Returns the values that have the unit of the joint, of those in rad and those in m. The others must be missing.
    fn in_unit<const N: usize>(
        &self,
        joint: &str,
        key: impl Fn(&str) -> String,
        prismatic: bool,
        [rad, metre]: [[(&'static str, Option<f64>); N]; 2],
    ) -> Result<[(&'static str, Option<f64>); N], RobotError> {
        let (own, foreign) = if prismatic { (metre, rad) } else { (rad, metre) };
        match foreign.into_iter().find(|(_, value)| value.is_some()) {
            Some((wrong, Some(value))) => {
                Err(self.joint(self.toml, joint, &key(wrong), value, "has the wrong unit for this joint"))
            }
            _ => Ok(own),
        }
    }

    /// Writes the limits of the file's `[supply]` into the tree. Each must be one that the URDF leaves out, or for which it has a
    /// placeholder. A joint that turns without end becomes one with a range.
    pub(crate) fn supply(&self, given: &BTreeMap<String, Tighten>, tree: &mut Tree) -> Result<(), RobotError> {
        for (name, entry) in given {
            let known = tree.joint(name).filter(|at| tree.joints[*at].kind != JointType::Fixed);
            let at =
                known.ok_or_else(|| RobotError::unknown(self.toml, "supply", name, "a movable joint of the URDF"))?;
            let joint = &mut tree.joints[at];
            let prismatic = joint.kind == JointType::Prismatic;
            let [min, max, velocity, acceleration, effort] = self.own_limits("supply", name, prismatic, entry)?;
            let [ranged, driven, strong] = stated(joint);
            for ((key, value), stated) in
                [(min, ranged), (max, ranged), (velocity, driven), (effort, strong), (acceleration, true)]
            {
                if let Some(value) = value.filter(|_| stated) {
                    let bound = "is no placeholder in the URDF: [tighten] narrows a limit";
                    return Err(self.joint(self.toml, name, &format!("supply.{key}"), value, bound));
                }
            }
            if let (Some(min), Some(max)) = (min.1, max.1) {
                (joint.limit.lower, joint.limit.upper) = (min, max);
                if joint.kind == JointType::Continuous {
                    joint.kind = JointType::Revolute;
                }
            } else if let Some(value) = min.1.or(max.1) {
                return Err(self.joint(self.toml, name, "supply.position", value, "must have both ends of the range"));
            }
            joint.limit.velocity = velocity.1.unwrap_or(joint.limit.velocity);
            joint.limit.effort = effort.1.unwrap_or(joint.limit.effort);
        }
        Ok(())
    }

    /// Soft margin, lower speed, acceleration and jerk of a group, SI. Their unit must be the joint's.
    fn of_group(
        &self,
        joint: &str,
        prismatic: bool,
        name: &str,
        group: &Group,
    ) -> Result<(f64, Option<f64>, f64, f64), RobotError> {
        let rad = [
            ("soft_margin_rad", group.soft_margin_rad),
            ("velocity_max_rad_per_s", group.velocity_max_rad_per_s),
            ("acceleration_max_rad_per_s2", group.acceleration_max_rad_per_s2),
            ("jerk_max_rad_per_s3", group.jerk_max_rad_per_s3),
        ];
        let metre = [
            ("soft_margin_m", group.soft_margin_m),
            ("velocity_max_m_per_s", group.velocity_max_m_per_s),
            ("acceleration_max_m_per_s2", group.acceleration_max_m_per_s2),
            ("jerk_max_m_per_s3", group.jerk_max_m_per_s3),
        ];
        let key = |key: &str| format!("limits.groups.{name}.{key}");
        let own = self.in_unit(joint, key, prismatic, [rad, metre])?;
        let given = |(wanted, value): (&str, Option<f64>)| {
            value.ok_or_else(|| self.value(&key(wanted), "missing".into(), format!("joint `{joint}` needs it")))
        };
        Ok((given(own[0])?, own[1].1, given(own[2])?, given(own[3])?))
    }
}
