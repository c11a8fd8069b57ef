//! Checks each number of one frame by itself.

use crate::config::{Config, DropReason};
use crate::geometry::vector;
use crate::limbs::ARMS;
use messages::{HingeCalibration, LIMBS, Layout, RawSkeleton, SMPL_JOINTS, Smpl, calibration_flag, raw_flag};
use nalgebra::Vector3;

/// Numbers of a frame, checked one by one.
pub(crate) struct Person {
    pub(crate) positions: [[f32; 3]; SMPL_JOINTS],
    pub(crate) rotations: [[f32; 4]; SMPL_JOINTS],
    pub(crate) has_rotations: bool,
    pub(crate) calibration: HingeCalibration,
    /// Bit per joint that may be used.
    pub(crate) usable: u32,
}

impl Person {
    pub(crate) fn read(config: &Config, raw: &RawSkeleton) -> Result<Self, DropReason> {
        let has_rotations = raw.flags & raw_flag::ROTATIONS != 0;
        let mut person = Self {
            positions: [[0.0; 3]; SMPL_JOINTS],
            rotations: [[0.0, 0.0, 0.0, 1.0]; SMPL_JOINTS],
            has_rotations,
            calibration: HingeCalibration::ZERO,
            usable: 0,
        };
        for joint in 0..SMPL_JOINTS {
            let confidence = raw.confidence[joint];
            if !confidence.is_finite() {
                return Err(DropReason::NotFinite);
            }
            if !(0.0..=1.0).contains(&confidence) {
                return Err(DropReason::OutOfRange);
            }
            if confidence < config.confidence_min {
                continue; // A position without confidence is not read.
            }
            person.positions[joint] = position(config, raw.positions[joint].map(plain))?;
            if has_rotations {
                person.rotations[joint] = unit_quaternion(config, raw.rotations[joint].map(plain))?;
            }
            person.usable |= 1 << joint;
        }
        person.calibration = read_calibration(config, &raw.calibration)?;
        person.check_trunk(config)?;
        Ok(person)
    }

    /// Marks elbow and wrist of these arms as not visible.
    pub(crate) fn leave_out(&mut self, arms: [bool; 2]) {
        for [_, elbow, wrist] in ARMS.into_iter().zip(arms).filter_map(|(arm, out)| out.then_some(arm)) {
            for joint in [elbow, wrist] {
                self.usable &= !(1 << joint);
                self.positions[joint] = [0.0; 3];
            }
        }
    }

    pub(crate) fn has(&self, joint: usize) -> bool {
        self.usable & (1 << joint) != 0
    }

    pub(crate) fn at(&self, joint: usize) -> Vector3<f64> {
        vector(self.positions[joint])
    }

    pub(crate) fn hips(&self) -> Vector3<f64> {
        (self.at(Smpl::LeftHip as usize) + self.at(Smpl::RightHip as usize)) / 2.0
    }

    /// Refuses limbs of the wrong length. Joints of the wrong side make limbs too long.
    fn check_arms(&self, config: &Config, trunk_m: f64) -> Result<(), DropReason> {
        let allowed = config.arm_per_trunk[0] * trunk_m..=config.arm_per_trunk[1] * trunk_m;
        for [shoulder, elbow, wrist] in ARMS {
            for [from, to] in [[shoulder, elbow], [elbow, wrist]] {
                let seen = self.has(from) && self.has(to);
                if seen && !allowed.contains(&(self.at(to) - self.at(from)).norm()) {
                    return Err(DropReason::Size);
                }
            }
        }
        Ok(())
    }

    fn check_trunk(&mut self, config: &Config) -> Result<(), DropReason> {
        let trunk = [Smpl::LeftHip, Smpl::RightHip, Smpl::LeftShoulder, Smpl::RightShoulder];
        if !trunk.iter().all(|&joint| self.has(joint as usize)) {
            return Err(DropReason::TrunkLost);
        }
        let hips = self.hips();
        for joint in 0..SMPL_JOINTS {
            if self.has(joint) && (self.at(joint) - hips).norm() > config.reach_max_m {
                return Err(DropReason::OutOfRange);
            }
        }
        let shoulders = (self.at(Smpl::LeftShoulder as usize) + self.at(Smpl::RightShoulder as usize)) / 2.0;
        let trunk = (shoulders - hips).norm();
        if !(config.trunk_m[0]..=config.trunk_m[1]).contains(&trunk) {
            return Err(DropReason::Size);
        }
        self.check_arms(config, trunk)
    }
}

/// Replaces denormal numbers and negative zero by zero, independent of the processor's mode. All others stay.
fn plain(value: f32) -> f32 {
    if value.is_subnormal() || value == 0.0 { 0.0 } else { value }
}

fn position(config: &Config, position: [f32; 3]) -> Result<[f32; 3], DropReason> {
    if !position.iter().all(|c| c.is_finite()) {
        return Err(DropReason::NotFinite);
    }
    if position.iter().any(|&c| f64::from(c).abs() > config.coordinate_max_m) {
        return Err(DropReason::OutOfRange);
    }
    Ok(position)
}

fn unit_quaternion(config: &Config, q: [f32; 4]) -> Result<[f32; 4], DropReason> {
    if !q.iter().all(|c| c.is_finite()) {
        return Err(DropReason::NotFinite);
    }
    let norm = q.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>().sqrt();
    if (norm - 1.0).abs() > config.quaternion_error_max {
        return Err(DropReason::NotUnit);
    }
    // q and -q are one rotation. The one with w >= 0 is stored, so its bits repeat if the rotation does.
    let signed = norm.copysign(f64::from(q[3]));
    Ok(q.map(|c| plain((f64::from(c) / signed) as f32)))
}

fn read_calibration(config: &Config, raw: &HingeCalibration) -> Result<HingeCalibration, DropReason> {
    let mut out = HingeCalibration::ZERO;
    if raw.flags & !calibration_flag::ALL != 0 {
        return Err(DropReason::Count);
    }
    for limb in 0..LIMBS {
        if raw.flags & calibration_flag::LIMB[limb] == 0 {
            continue;
        }
        let hinge = vector(raw.hinge[limb].map(plain));
        if !hinge.iter().all(|c| c.is_finite()) {
            return Err(DropReason::NotFinite);
        }
        let norm = hinge.norm();
        if (norm - 1.0).abs() > config.quaternion_error_max {
            return Err(DropReason::NotUnit);
        }
        out.hinge[limb] = raw.hinge[limb].map(plain);
    }
    out.flags = raw.flags;
    out.samples = raw.samples;
    Ok(out)
}
