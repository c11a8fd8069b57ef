//! From pose to pose through the latent space, or through joint space for comparison.

use crate::error::{KeyposesError, within};
use crate::motions::minimum_jerk;
use crate::trajectory::{Trajectory, joint_names};
use retarget::{
    ARM_Q, ARMS, ArmModel, ArmQ, Latent, Limbs, Network, PRIOR_WEIGHT, REFINE_STEPS_MAX, features, interpolate_latent,
    refine,
};
use robot::Model;

/// Where the straight line between two poses is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Space {
    /// Between the points of the shared latent space that the human encoder gives.
    Latent,
    /// Between the joint positions of the poses.
    Joint,
}

/// How to interpolate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// From each pose to the next, s: 0.05 to 60.
    pub seconds: f64,
    /// Rows per second: 1 to 1500.
    pub rate_hz: f64,
    /// Where the line is straight.
    pub space: Space,
    /// Levenberg-Marquardt steps of the poses toward the human's limbs.
    pub refine_steps: u32,
}

/// From the first pose to the last, stopping at each, with minimum-jerk timing on straight lines: monotone in between.
/// Latent: q(t) = D_r(z_a + s (z_b - z_a)) + (1 - s) (q_a - D_r(z_a)) + s (q_b - D_r(z_b)), within the limits, with s = s(t):
/// what refinement adds to the poses fades from one to the next, because refining every row by itself may leap from one end of
/// a joint to the other. Joint: q(t) = q_a + s(t) (q_b - q_a).
///
/// # Errors
/// Fewer than two poses, or an option out of its bounds.
pub fn interpolate(
    model: &Model,
    network: &Network,
    poses: &[[Limbs; ARMS]],
    options: &Options,
) -> Result<Trajectory, KeyposesError> {
    within("number of poses", poses.len() as f64, 2.0, 1000.0)?;
    let seconds = within("--seconds", options.seconds, 0.05, 60.0)?;
    let rate_hz = within("--rate", options.rate_hz, 1.0, 1500.0)?;
    within("--refine-steps", f64::from(options.refine_steps), 0.0, f64::from(REFINE_STEPS_MAX))?;
    let arm = ArmModel::of(model);
    let encode = |arms: &[Limbs; ARMS]| network.encode_human(&arms.each_ref().map(features));
    let refined = |human: &Limbs, start: &ArmQ| refine(&arm, human, start, start, PRIOR_WEIGHT, options.refine_steps).q;
    let keys: Vec<Key> = poses
        .iter()
        .map(|limbs| {
            let latents = encode(limbs);
            let decoded = network.decode(&latents);
            let q: [ArmQ; ARMS] = std::array::from_fn(|a| refined(&limbs[a], &decoded[a]));
            let added = std::array::from_fn(|a| std::array::from_fn(|j| q[a][j] - decoded[a][j]));
            Key { latents, q, added }
        })
        .collect();
    let per_piece = (seconds * rate_hz).round().max(1.0);
    let rows = per_piece as usize * (poses.len() - 1);
    let row = |i: usize| {
        let (piece, t) = ((i / per_piece as usize).min(keys.len() - 2), i as f64 / per_piece);
        let s = minimum_jerk(t - piece as f64);
        let (a, b) = (&keys[piece], &keys[piece + 1]);
        match options.space {
            Space::Joint => std::array::from_fn(|arm| lerp(&a.q[arm], &b.q[arm], s)),
            Space::Latent => {
                let latents: [Latent; ARMS] =
                    std::array::from_fn(|arm| interpolate_latent(&a.latents[arm], &b.latents[arm], s));
                let decoded = network.decode(&latents);
                std::array::from_fn(|side| {
                    let added = lerp(&a.added[side], &b.added[side], s);
                    arm.clamp(&std::array::from_fn(|j| decoded[side][j] + added[j]))
                })
            }
        }
    };
    Ok(Trajectory { joint_names: joint_names(model), rate_hz, q: (0..=rows).map(row).collect() })
}

struct Key {
    latents: [Latent; ARMS],
    q: [ArmQ; ARMS],
    /// What refinement added to the decoded posture.
    added: [ArmQ; ARMS],
}

fn lerp(a: &ArmQ, b: &ArmQ, s: f64) -> ArmQ {
    let mut out = [0.0; ARM_Q];
    for (j, out) in out.iter_mut().enumerate() {
        *out = a[j] + s * (b[j] - a[j]);
    }
    out
}
