//! The gate of the grippers: closure, speed and acceleration. What it denies, it replaces by braking.

use crate::gate::Denial;
use messages::{GripperMotion, TICK_S};

/// Slack for the rounding of the proposal.
const SLACK: f64 = 1e-8;

/// Limits of the left and the right gripper. Zeros for a hand without one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Config {
    /// Largest rate of the closure, 1/s.
    pub speed: [f64; 2],
    /// Largest change of that rate, 1/s^2.
    pub acceleration: [f64; 2],
}

/// Judges the motion that is proposed for the tick after `last`. Returns the motion to send, and the reason if the proposal
/// is denied. Then every gripper brakes. Never allocates or panics, whatever the bits.
pub fn tick(config: &Config, last: &GripperMotion, proposed: &GripperMotion) -> (GripperMotion, Option<Denial>) {
    match (0..2).find(|&side| !passes(config, side, last, proposed)) {
        None => (*proposed, None),
        Some(side) => (brake(config, last), Some(Denial::Gripper { side })),
    }
}

/// Returns true if one gripper may move so. At an end of its range the fingers meet, and it may stop at once.
fn passes(config: &Config, side: usize, last: &GripperMotion, proposed: &GripperMotion) -> bool {
    let (closure, rate) = (proposed.closure[side], proposed.rate[side]);
    let (moved, sped) = (closure - last.closure[side], rate - last.rate[side]);
    let stops = rate == 0.0 && [0.0, 1.0].contains(&closure);
    let steady = sped.abs() <= config.acceleration[side] * TICK_S + SLACK;
    // Written so that NaN is denied.
    (0.0..=1.0).contains(&closure)
        && rate.abs() <= config.speed[side] + SLACK
        && (steady || stops)
        && moved.abs() <= config.speed[side] * TICK_S + SLACK
}

fn brake(config: &Config, last: &GripperMotion) -> GripperMotion {
    let mut next = *last;
    for side in 0..2 {
        let slower = (last.rate[side].abs() - config.acceleration[side] * TICK_S).max(0.0);
        let moved = last.closure[side] + slower.copysign(last.rate[side]) * TICK_S;
        (next.closure[side], next.rate[side]) = if (0.0..=1.0).contains(&moved) {
            (moved, slower.copysign(last.rate[side]))
        } else {
            (last.closure[side], 0.0)
        };
    }
    next
}
