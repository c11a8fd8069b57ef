//! Computes how hard an arm may brake and accelerate where its motors have little to spare. This is a
//! proposal, and the proof of [`torque`](crate::torque) judges it.
//!
//! Let h_j be the torque of joint j that carries the arm. A stop that brakes with all that the limits allow
//! needs in addition at most
//!
//! ```text
//! e_j = sum_k max(0, +-M_jk p_k),    p_k = min(A_k, sqrt(J_k |c_k|)) against the coasting velocity c_k
//! ```
//!
//! at any instant, whichever joints brake at the time. So the joints that load j can brake with the share b =
//! (limit_j - |h_j|) / e_j of it. Each joint takes the least share of the joints that it loads. h is computed
//! where the robot is, in motion and at rest, and where its plan comes to rest.
//!
//! A gentler stop takes longer. The robot file gives the longest duration. So no brake is gentler than that
//! duration allows. And no joint may be faster than it can be stopped with its share.
//!
//! Accelerations are limited in the same way. Of the step from the plan's accelerations to the wanted ones,
//! the arm takes the share that keeps h + M a within the limits.

use crate::chain::{JointSet, TurnedJoints, joints};
use crate::clearance::Anchor;
use crate::config::Config;
use crate::dynamics::PerJoint;
use crate::plan::{JointState, PlannedMotion};
use crate::torque::Load;
use messages::{JOINTS_MAX, JointMotion, TICK_S};

/// Share of the limits that is used for planning. The rest is for changes of M and h on the way, and for the
/// proof's bound between samples.
const PLANNED: f64 = 0.95;
/// The same share for a brake. While an arm stops, it reaches postures in which other joints load a motor. At
/// 0.95 the proof refused 1.9 % of the motions towards random postures, at 0.9 it refuses 0.8 %.
const PLANNED_BRAKE: f64 = 0.9;
/// Share of the longest stop that is used for planning, because a tick passes until the stop begins.
const PLANNED_TIME: f64 = 0.98;
/// The gentlest brake, as a share of the acceleration limit, even if the motors can give less. It lets a standing
/// joint start.
const GENTLEST: f64 = 0.05;

/// Load on the motors in the state before a tick.
#[derive(Clone, Debug)]
pub(crate) struct Bearing {
    matrix: [PerJoint; JOINTS_MAX],
    /// h in motion, at rest here, and at the end of the plan.
    moving: PerJoint,
    still: PerJoint,
    ended: PerJoint,
    /// The share of its brake that each joint may use.
    share: PerJoint,
    /// The deceleration that each joint's stop reaches if no motor limits it.
    peak: PerJoint,
}

impl Bearing {
    /// `now` is this state's posture, and `ended` the joints at the end of the plan, unless it is at rest.
    pub(crate) fn new(
        config: &Config,
        load: &Load,
        now: &Anchor,
        ended: Option<&TurnedJoints>,
        before: &JointMotion,
    ) -> Self {
        let (chain, all) = (&config.geometry.chain, config.geometry.chain.all());
        let matrix = load.dynamics.mass_matrix(chain, &now.placements, chain.arms()[0] | chain.arms()[1]);
        let (share, peak, mut still) = ([1.0; JOINTS_MAX], [0.0; JOINTS_MAX], [0.0; JOINTS_MAX]);
        load.dynamics.torques_at_rest(chain, &now.turned, all, &mut still);
        let mut bearing = Self { matrix, moving: still, still, ended: still, share, peak };
        if let Some(ended) = ended {
            let coasting = std::array::from_fn(|j| JointState { a: 0.0, ..before.joint(j) });
            load.dynamics.torques(chain, &now.turned, &coasting, all, &mut bearing.moving);
            load.dynamics.torques_at_rest(chain, ended, all, &mut bearing.ended);
        }
        for arm in chain.arms() {
            for k in joints(arm) {
                let (bounds, x) = (&config.bounds[k], before.joint(k));
                let coasting = x.coasting_velocity(bounds.j_max);
                // A tick later it may be faster by A h.
                let fastest = coasting.abs() + bounds.a_max * TICK_S;
                bearing.peak[k] = -bounds.a_max.min((bounds.j_max * fastest).sqrt()).copysign(coasting);
            }
            bearing.take_shares(load, arm);
        }
        bearing
    }

    /// Sets the brake shares of an arm's joints. If a motor has too little to spare, the joints that load it
    /// brake more gently. The other joints are not affected.
    fn take_shares(&mut self, load: &Load, arm: JointSet) {
        for j in joints(arm) {
            let room = |sign: f64| {
                let h =
                    [self.moving[j], self.still[j], self.ended[j]].into_iter().map(|h| sign * h).fold(0.0, f64::max);
                (PLANNED_BRAKE * load.limit[j] - h).max(0.0)
            };
            for sign in [1.0, -1.0] {
                let asks = |k: usize| (sign * self.matrix[j][k] * self.peak[k]).max(0.0);
                let asked: f64 = joints(arm).map(asks).sum();
                let share = room(sign) / asked;
                if share < 1.0 {
                    for k in joints(arm).filter(|&k| asks(k) > 0.0) {
                        self.share[k] = self.share[k].min(share);
                    }
                }
            }
        }
    }

    /// The largest brake of each joint, rad/s^2 or m/s^2.
    pub(crate) fn brakes(&self, config: &Config, before: &JointMotion) -> PerJoint {
        std::array::from_fn(|j| {
            let bounds = &config.bounds[j];
            if self.share[j] >= 1.0 {
                return bounds.brake;
            }
            let x = before.joint(j);
            let fastest = x.v.abs().max(x.coasting_velocity(bounds.j_max).abs()) + bounds.a_max * TICK_S;
            let least = (fastest / braking_time_s(config, j)).max(GENTLEST * bounds.brake);
            (self.share[j] * self.peak[j].abs()).max(least).min(bounds.brake)
        })
    }

    /// Share of its largest speed from which each joint can still be stopped.
    pub(crate) fn speeds(&self, config: &Config) -> PerJoint {
        std::array::from_fn(|j| {
            let bounds = &config.bounds[j];
            let brake = self.share[j].max(GENTLEST) * bounds.brake;
            if self.share[j] >= 1.0 { 1.0 } else { (brake * braking_time_s(config, j) / bounds.v_max).min(1.0) }
        })
    }

    /// Share of the step from the accelerations `plan` to `wanted` that an arm can take.
    pub(crate) fn step(&self, load: &Load, arm: JointSet, plan: &PerJoint, wanted: &PerJoint) -> f64 {
        let mut share = 1.0_f64;
        for j in joints(arm) {
            let (mut from, mut change) = (self.moving[j], 0.0);
            for k in joints(arm) {
                from += self.matrix[j][k] * plan[k];
                change += self.matrix[j][k] * (wanted[k] - plan[k]);
            }
            let bound = (PLANNED * load.limit[j]).max(from.abs());
            let room = if change >= 0.0 { bound - from } else { bound + from };
            if change.abs() > room {
                share = share.min(room.max(0.0) / change.abs());
            }
        }
        share
    }
}

/// Longest time from the moment when the brake is on to the moment when it is released, s. It is the longest
/// stop, minus the time to lose the acceleration and to release the brake.
fn braking_time_s(config: &Config, j: usize) -> f64 {
    let bounds = &config.bounds[j];
    let time = PLANNED_TIME * config.stop_time_max_s - 2.0 * bounds.a_max / bounds.j_max;
    time.max(bounds.v_max / bounds.brake)
}
