//! Errors of the limbs and of the torso, for the status.

use crate::Config;
use crate::following::Reference;
use messages::{JOINTS_MAX, LIMBS};
use retarget::{ArmModel, Limbs};
use robot::Model;

/// Angles between the person's limbs and those of the arms at `q`, rad, indexed by `Limb`. `None` for an arm
/// without a person.
pub(super) fn limb_angles(
    model: &Model,
    arm_models: &[ArmModel; 2],
    limbs: &[Option<Limbs>; 2],
    q: &[f64; JOINTS_MAX],
) -> [Option<f64>; LIMBS] {
    let mut angles = [None; LIMBS];
    for (side, arm) in model.arms.iter().enumerate() {
        let Some(human) = &limbs[side] else { continue };
        let as_left = arm.mirrored(&arm.limb_values(q));
        let degrees = arm_models[side].limb_error_deg(&as_left, human);
        angles[2 * side..2 * side + 2].copy_from_slice(&degrees.map(|angle| Some(angle.to_radians())));
    }
    angles
}

/// Mean of these angles, rad. Zero without a person.
pub(super) fn limb_error(config: &Config, limbs: &[Option<Limbs>; 2], q: &[f64; JOINTS_MAX]) -> f64 {
    let angles = limb_angles(&config.model, &config.arms, limbs, q);
    let count = angles.iter().flatten().count();
    angles.iter().flatten().sum::<f64>() / count.max(1) as f64
}

/// Distance that the torso has to rise to its target, m. Without a target for it, to its home position. Zero without
/// a lift.
pub(super) fn torso_to_go(model: &Model, reference: &Reference, q: &[f64; JOINTS_MAX]) -> f64 {
    let Some(lift) = model.lift else { return 0.0 };
    let limits = &model.limits[lift];
    let aim = if reference.valid_mask & 1 << lift != 0 { reference.q[lift] } else { model.home[lift] };
    let to_go = aim.clamp(limits.q_min, limits.q_max) - q[lift];
    if to_go.is_finite() { to_go } else { 0.0 }
}

/// Ticks between two published `Status` messages: 50 Hz. A change of mode is published at once.
pub const STATUS_EVERY: u64 = 30;
