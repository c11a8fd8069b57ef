//! Figures that control publishes about the motion, and its status as JSON.

use super::ControlConfig;
use messages::{FAULTS, Faults, JOINTS, JointTarget, LEFT_ARM, LIMBS, Mode, RIGHT_ARM, Status, TRANSITIONS_KEPT};
use retarget::{Limbs, limb_error_deg, mirror, rotation_from_xyzw};
use serde_json::{Value, json};

/// Mean angle between the human's four limbs and those of the arms at `q`, rad; zero without a human.
pub(super) fn limb_error(config: &ControlConfig, target: &JointTarget, q: &[f64; JOINTS]) -> f64 {
    let mut sum_deg = 0.0;
    for (side, joints) in [LEFT_ARM, RIGHT_ARM].into_iter().enumerate() {
        // One arm model serves both arms: the right human arm is mirrored to the left.
        let limb = |index: usize| {
            let human = target.human_limbs[2 * side + index];
            rotation_from_xyzw(if side == 0 { human } else { mirror(human) })
        };
        let (Some(upper), Some(fore)) = (limb(0), limb(1)) else { return 0.0 };
        let arm = core::array::from_fn(|i| q[joints.start + i]);
        sum_deg += limb_error_deg(&config.arm.forward(&arm), &Limbs { upper, fore }).iter().sum::<f64>();
    }
    (sum_deg / LIMBS as f64).to_radians()
}

/// A status as JSON; its keys are those of the message.
pub fn status_json(status: &Status) -> Value {
    let mode = |value: u32| Mode::from_u32(value).map_or("unknown", Mode::name);
    let names = |bits: u64| Faults(bits).iter().map(|fault| fault.row().name).collect::<Vec<_>>();
    let counts: serde_json::Map<_, _> = FAULTS
        .iter()
        .map(|row| (row.name.to_owned(), status.fault_counts[row.fault.index()]))
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| (name, json!(count)))
        .collect();
    let kept = TRANSITIONS_KEPT as u32;
    let transitions: Vec<_> = (status.transition_count.saturating_sub(kept)..status.transition_count)
        .map(|n| status.transitions[(n % kept) as usize])
        .map(|t| json!({ "k": t.k, "from": mode(t.from), "to": mode(t.to), "why": t.why_name() }))
        .collect();
    json!({
        "k": status.k,
        "mode": mode(status.mode),
        "ticks": status.ticks,
        "missed_deadlines": status.missed_deadlines,
        "faults": names(status.faults),
        "latched": names(status.latched),
        "fault_counts": counts,
        "input_age_ms": status.input_age_ns as f64 * 1e-6,
        "clearance_command_m": status.clearance_command_m,
        "clearance_measured_m": status.clearance_measured_m,
        "nearest_pair": status.nearest_pair,
        "tracking_error": status.tracking_error,
        "limb_error_target_deg": status.limb_error_target_rad.to_degrees(),
        "limb_error_measured_deg": status.limb_error_measured_rad.to_degrees(),
        "speed_scale": status.speed_scale,
        "gate_denials": status.gate_denials,
        "fallbacks": status.fallbacks,
        "operators": status.operators,
        "realtime": status.realtime == 1,
        "transitions": transitions,
    })
}
