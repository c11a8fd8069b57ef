//! The status as JSON.

use crate::sentences;
use messages::{FAULTS, Faults, FollowingLimit, Mode, Stamp, Status, Subject, source_flag};
use robot::Names;
use serde_json::{Value, json};

/// Distance of the torso from its target above which [`activity`] mentions it, m: 70 ms at its highest speed.
const TORSO_FAR_M: f64 = 0.005;

/// Names a slow motion in progress, for the operator. The torso's whole stroke takes 5 s.
pub fn activity(status: &Status) -> Option<&'static str> {
    if status.torso_to_go_m > TORSO_FAR_M {
        Some("raising torso")
    } else if status.torso_to_go_m < -TORSO_FAR_M {
        Some("lowering torso")
    } else {
        None
    }
}

/// Age of the newest frame, ms. `None` before the first one. `control` counts an age from the reception of the
/// frame. Without a frame it counts from the clock's zero.
pub fn input_age_ms(status: &Status) -> Option<f64> {
    let none = status.target_stamp == Stamp::NONE || status.input_age_ns >= status.header.stamp.0;
    (!none).then_some(status.input_age_ns as f64 * 1e-6)
}

/// Converts a status to JSON with the message's keys, and joints and pairs by their names. `why` says why the robot does not follow.
pub fn status_json(status: &Status, names: &Names) -> Value {
    let mode = |value: u32| Mode::from_u32(value).map_or("unknown", Mode::name);
    let listed = |bits: u64| Faults(bits).iter().map(|fault| fault.row().name).collect::<Vec<_>>();
    let counts: serde_json::Map<_, _> = FAULTS
        .iter()
        .map(|row| (row.name.to_owned(), status.fault_counts[row.fault.index()]))
        .filter(|(_, count)| *count > 0)
        .map(|(name, count)| (name, json!(count)))
        .collect();
    let joint = |place: u32| place.checked_sub(1).map(|joint| names.joint(joint as usize));
    let transitions: Vec<_> = sentences::newest_transitions(status, u32::MAX)
        .map(|t| json!({ "k": t.k, "from": mode(t.from), "to": mode(t.to), "why": t.why_name() }))
        .collect();
    let mut all = json!({
        "k": status.k,
        "mode": mode(status.mode),
        "why": sentences::why(status, names),
        "ticks": status.ticks,
        "missed_deadlines": status.missed_deadlines,
        "faults": listed(status.faults),
        "latched": listed(status.latched),
        "fault_counts": counts,
        "input_age_ms": status.input_age_ns as f64 * 1e-6,
        "clearance_command_m": status.clearance_command_m,
        "clearance_measured_m": status.clearance_measured_m,
        "nearest_pair": names.pair(status.nearest_pair),
        "nearest_pair_measured": names.pair(status.nearest_pair_measured),
        "joint_outside": joint(status.joint_outside),
        "outside_by": status.outside_by,
        "torso_to_go_m": status.torso_to_go_m,
        "note": activity(status),
        "tracking_error": status.tracking_error,
        "tracking_joint": joint(status.tracking_joint),
        "at_rest": status.moving == 0,
        "payload_kg": status.payload_kg,
        "payload_centre_m": status.payload_centre_m,
        "payloads_taken": status.payloads_taken,
        "payloads_refused": status.payloads_refused,
        "payload_refused": sentences::payload_refused(status, names),
        "unsteady_joint": joint(status.unsteady_joint),
        "denied": sentences::denied(status, names),
        "refused": sentences::subject(Subject::from_code(status.refused_about), names),
        "input_drop": sentences::dropped(status).map(|(name, _)| name),
        "calibration": sentences::calibration_name(status),
        "limb_error_target_deg": status.limb_error_target_rad.to_degrees(),
        "limb_error_measured_deg": status.limb_error_measured_rad.to_degrees(),
        "speed_scale": status.speed_scale,
        "reduced": sentences::reduced(status).collect::<Vec<_>>(),
        "gate_denials": status.gate_denials,
        "fallbacks": status.fallbacks,
        "operators": status.operators,
        "reset_first_by_uid": status.reset_first_by.checked_sub(1),
        "resets_refused": status.resets_refused,
        "realtime": status.realtime == 1,
        "transitions": transitions,
    });
    let limited_about = sentences::subject(Subject::from_code(status.limited_about), names);
    // The limit that keeps the command from the person.
    let limit = Some(FollowingLimit::from_u32(status.limited_why)).filter(|limit| *limit != FollowingLimit::None);
    all["limited"] = json!({ "by": limit.map(FollowingLimit::name), "about": limited_about });
    all["lost_percent"] = json!(0.1 * f64::from(status.lost_permille));
    let arms = |bits: u32| [(1, "left"), (2, "right")].into_iter().filter(move |(side, _)| bits & side != 0);
    all["left_out"] = arms(status.left_out).map(|(_, name)| name).collect();
    all["unseen"] = arms(status.left_out >> 2).map(|(_, name)| name).collect();
    let leader = |side| source_flag::leader(status.sources, side);
    all["led_by"] = json!({ "left": leader(0), "right": leader(1) });
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::Layout;

    #[test]
    fn input_age_without_input_is_none() {
        let mut status = Status::ZERO;
        status.header.stamp = Stamp(5_000_000_000);
        assert_eq!(input_age_ms(&status), None, "no target");
        (status.target_stamp, status.input_age_ns) = (Stamp(4_999_000_000), 5_000_000_000);
        assert_eq!(input_age_ms(&status), None, "a target of no frame");
        status.input_age_ns = 7_500_000;
        assert_eq!(input_age_ms(&status), Some(7.5));
    }
}
