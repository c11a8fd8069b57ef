//! Recovery: a slow, hold-to-run motion. It brings back a robot that stands outside its limits or without
//! enough clearance.

use messages::{Fault, Faults, Response, Transition};

use super::watch::charged_ns;
use super::{Input, Phase};

/// The faults that make a recovery necessary.
const REASONS: Faults = Faults::NONE.with(Fault::StartOutsideLimits).with(Fault::StartInCollision);

/// Faults that do not end a recovery: its reasons, other effects of the measured posture, and all faults of
/// the target, because a recovery follows none.
const BORNE: Faults = REASONS
    .with(Fault::CollisionNear)
    .with(Fault::NoTarget)
    .with(Fault::InputStale)
    .with(Fault::InputImplausible)
    .with(Fault::TargetStale);

/// Time for which a recovery may stand still before it reports that it finds no way, ns. Its motions begin
/// within a tick.
const BLOCKED_NS: u64 = 500_000_000;

/// The faults that end a recovery.
fn monitored(active: Faults) -> Faults {
    Faults(active.0 & !BORNE.0)
}

/// Returns true if the operator requests a recovery, the robot needs it, and no other fault prevents it.
pub(super) fn begins(input: &Input, active: Faults) -> bool {
    let operator = &input.operator;
    let asked = operator.recover_edge && operator.recover_level && !operator.enable_level && !operator.release_edge;
    asked && active.0 & REASONS.0 != 0 && monitored(active).is_empty()
}

/// Handles a tick of a recovery at which no Stop fault holds. Recovery ends if the operator lets go, or at
/// any fault outside [`BORNE`]. It never resumes.
pub(super) fn next(input: &Input, active: Faults, blocked_ns: u64) -> (Phase, u32) {
    let monitored = monitored(active);
    let withdrawn = monitored
        .with_response(Response::Release)
        .iter()
        .next()
        .or_else(|| monitored.with_response(Response::Hold).iter().next());
    if let Some(fault) = withdrawn {
        return (Phase::holding(Some(Transition::AT_REST)), fault as u32);
    }
    if input.operator.release_edge || !input.operator.recover_level {
        return (Phase::holding(Some(Transition::AT_REST)), Transition::RELEASED);
    }
    if !input.motion.at_rest {
        return (Phase::Recovering { blocked_ns: 0 }, 0);
    }
    let blocked_ns = blocked_ns.saturating_add(charged_ns(input.own_gap_ns));
    if !input.robot.at_rest {
        // The command rests already, but the robot does not yet.
        (Phase::Recovering { blocked_ns }, 0)
    } else if input.robot.clear_to_start {
        (Phase::Disengaged, Transition::RECOVERED)
    } else if blocked_ns > BLOCKED_NS {
        (Phase::Disengaged, Transition::BLOCKED)
    } else {
        (Phase::Recovering { blocked_ns }, 0)
    }
}
