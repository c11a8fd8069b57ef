//! Interpolates from pose to pose through the latent space, or through joint space for comparison.

use poses::keys::Keys;
use poses::motions::minimum_jerk;
use poses::trajectory::{Trajectory, joint_names, own_positions};
use retarget::{ARMS, Limbs, Network, REFINEMENT_STEPS_MAX};
use robot::Model;
use rt::{Exit, Failure};

/// Space in which the line between two poses is straight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Space {
    /// Between the points of the shared latent space that the human encoder returns.
    Latent,
    /// Between the joint positions of the poses.
    Joint,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Time from each pose to the next, s: 0.05 to 60.
    pub seconds: f64,
    /// Rows per second: 1 to 1500.
    pub rate_hz: f64,
    /// Space in which the line is straight.
    pub space: Space,
    /// Levenberg-Marquardt steps that move the poses toward the human's limbs.
    pub refine_steps: u32,
}

/// Returns `value` if it is within the bounds. NaN is not.
fn within(option: &str, value: f64, low: f64, high: f64) -> Result<f64, Failure> {
    let outside = || Failure::new(Exit::Usage, format!("{option} {value:?} is outside [{low}, {high}]"));
    if (low..=high).contains(&value) { Ok(value) } else { Err(outside()) }
}

/// Interpolates from the first pose to the last and stops at each. The timing s(t) on straight lines has
/// minimum jerk, and is monotone in between. Between a and b the shares are 1 - s and s, of
/// [`Keys::mix_latent`] or of [`Keys::mix_joints`].
pub fn interpolate(
    model: &Model,
    network: &Network,
    poses: &[[Limbs; ARMS]],
    options: &Options,
) -> Result<Trajectory, Failure> {
    within("number of poses", poses.len() as f64, 2.0, 1000.0)?;
    let seconds = within("--seconds", options.seconds, 0.05, 60.0)?;
    let rate_hz = within("--rate", options.rate_hz, 1.0, 1500.0)?;
    within("--refine-steps", f64::from(options.refine_steps), 0.0, f64::from(REFINEMENT_STEPS_MAX))?;
    let keys = Keys::new(model, network, poses, options.refine_steps);
    let per_piece = (seconds * rate_hz).round().max(1.0);
    let rows = per_piece as usize * (poses.len() - 1);
    let row = |i: usize| {
        let (piece, t) = ((i / per_piece as usize).min(poses.len() - 2), i as f64 / per_piece);
        let s = minimum_jerk(t - piece as f64);
        let mut shares = vec![0.0; poses.len()];
        (shares[piece], shares[piece + 1]) = (1.0 - s, s);
        let as_left = match options.space {
            Space::Joint => keys.mix_joints(&shares),
            Space::Latent => keys.mix_latent(&shares),
        };
        own_positions(model, &as_left)
    };
    let q = (0..=rows).map(row).collect();
    Ok(Trajectory { joint_names: joint_names(model), rate_hz, is_resampled: false, q })
}
