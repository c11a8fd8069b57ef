//! One joint's motor, gear and friction, and its drive's position loop.

use crate::description::{Joint, JointKind};

/// Greatest acceleration of a joint under its full torque without load, rad/s^2. It gives the rotor's inertia.
/// Assumption: no datasheet. The last wrist joint (0.0016 kg m^2 by the URDF) then has a rotor of 0.033 kg m^2,
/// as behind a gear of 1:100. So its neighbours' coupling does not throw it. The least eigenvalue of the mass
/// matrix, scaled to a diagonal of 1, is 0.27 with rotors and 0.05 without (5000 postures by Pinocchio,
/// 2026-11-23).
const BARE_ACCELERATION_RAD_PER_S2: f64 = 200.0;
/// The same limit for a lift, m/s^2. Assumption: a spindle that carries 2 kN behaves like 100 kg.
const BARE_ACCELERATION_M_PER_S2: f64 = 20.0;
/// Coulomb friction over the greatest torque if the URDF states none. Assumption: 0.02, a strain wave gear.
const COULOMB_SHARE: f64 = 0.02;
/// Viscous friction at the URDF's speed limit over the greatest torque if the URDF states none. Assumption: 0.02.
const VISCOUS_SHARE: f64 = 0.02;
/// Share of the friction that the drives compensate. Assumption.
pub(crate) const FRICTION_COMPENSATED: f64 = 0.8;
/// Coulomb friction reaches its value at a few times this share of the URDF's speed limit. Assumption: 0.01, so that
/// the friction stays smooth for steps of 0.5 ms.
const SMOOTH_SHARE: f64 = 0.01;
/// Braking of a mechanical brake over the acceleration limit in force. Assumption: 1.5, a brake stops faster than a
/// command may.
const BRAKE_SHARE: f64 = 1.5;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Motor {
    /// Reflected inertia of the rotor, kg m^2 or kg.
    pub(crate) armature: f64,
    viscous: f64,
    coulomb: f64,
    smooth_speed: f64,
    /// The drive commands no more than this torque or force, N m or N.
    pub(crate) effort_max: f64,
    /// The drive's own speed limit, rad/s or m/s: the URDF's.
    pub(crate) v_max: f64,
    /// Deceleration with which the motor stops by itself, rad/s^2 or m/s^2.
    pub(crate) stopping: f64,
    /// Deceleration of the mechanical brake, rad/s^2 or m/s^2.
    pub(crate) braking: f64,
    /// Rate at which the motor damps, 1/s.
    pub(crate) damping_rate: f64,
}

impl Motor {
    /// The motor of a joint that is not there.
    pub(crate) const NONE: Self = Self {
        armature: 1.0,
        viscous: 0.0,
        coulomb: 0.0,
        smooth_speed: 1.0,
        effort_max: 0.0,
        v_max: 1.0,
        stopping: 1.0,
        braking: 1.0,
        damping_rate: 1.0,
    };

    pub(crate) fn new(joint: &Joint) -> Self {
        let bare = match joint.kind {
            JointKind::Revolute => BARE_ACCELERATION_RAD_PER_S2,
            JointKind::Prismatic => BARE_ACCELERATION_M_PER_S2,
        };
        let (effort, speed) = (joint.urdf.effort_max, joint.urdf.v_max);
        Self {
            armature: effort / bare,
            viscous: joint.damping.unwrap_or(VISCOUS_SHARE * effort / speed),
            coulomb: joint.friction.unwrap_or(COULOMB_SHARE * effort),
            smooth_speed: SMOOTH_SHARE * speed,
            effort_max: joint.limits.effort_max,
            v_max: speed,
            stopping: joint.limits.a_max,
            braking: BRAKE_SHARE * joint.limits.a_max,
            damping_rate: joint.limits.a_max / joint.limits.v_max,
        }
    }

    /// Returns the friction torque or force at a speed. The motor works against it.
    pub(crate) fn friction(&self, v: f64) -> f64 {
        self.viscous * v + self.coulomb * (v / self.smooth_speed).tanh()
    }

    /// Returns the largest torque or force of friction that the drive leaves. At a turn it still helps the other direction.
    pub(crate) fn friction_max(&self, v: f64) -> f64 {
        self.viscous * v.abs() + (1.0 + FRICTION_COMPENSATED) * self.coulomb
    }

    /// Returns the acceleration that the position loop asks for. `reference` has position, velocity and
    /// acceleration of the reference. `q` and `v` are the joint's position and velocity.
    ///
    /// a = a_ref + 2 zeta omega (v_target - v), v_target = v_ref + omega / (2 zeta) (q_ref - q) within the speed
    /// limit. This second-order loop approaches from afar no faster than the motor may turn.
    pub(crate) fn follow(&self, omega: f64, zeta: f64, reference: [f64; 3], q: f64, v: f64) -> f64 {
        let [q_ref, v_ref, a_ref] = reference;
        let target = (v_ref + omega / (2.0 * zeta) * (q_ref - q)).clamp(-self.v_max, self.v_max);
        a_ref + 2.0 * zeta * omega * (target - v)
    }
}
