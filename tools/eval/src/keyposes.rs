//! Interpolates from one key pose to another: through the latent space, and straight through joint space.
//!
//! Pairs of poses are drawn from all frames of the clips. They are two poses of one clip, as the key poses of a
//! motion are, or any two, as far apart as poses get. Along s from 0 to 1:
//!
//! - The *yardstick* is the slerp of the human's limb rotations.
//! - The *latent path* decodes z(s) = (1 - s) z(0) + s z(1). It does so alone (K = 0), or with two refinement
//!   steps toward the yardstick (K = 2), as the product does between two skeletons.
//! - The *joint path* is (1 - s) q(0) + s q(1) between the postures of the two key poses. They are decoded (K =
//!   0) or refined (K = 2).
//!
//! The limb error is the rotation angle to the yardstick. It is the mean over both arms' limbs and the steps
//! between the key poses. A path is monotone if none of its steps goes back. That means that the projection of
//! the ten joint positions on the chord q(1) - q(0) never falls by more than 1e-3 of the chord. Its length is
//! the sum of the steps' Euclidean lengths in the space of the ten joints, relative to the chord's. Pairs whose
//! chord is shorter than 0.1 rad count for neither figure.

use crate::clips::Human;
use crate::methods::Posture;
use crate::metrics::Task;
use ::report::table::{self, column, number};
use nalgebra::SVector;
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use retarget::{ARM_Q, ArmModel, Latent, Network, features, interpolate_latent, posture};
use serde::Serialize;
use std::fmt;

/// Number of pairs of key poses.
pub const PAIRS: usize = 300;
const SEED: u64 = 3;
/// Steps of a path. On a path of 3 rad, each step is 0.06 rad.
const STEPS: usize = 50;
const REFINE_STEPS: u32 = 2;
/// Share of a chord that counts as going back. Rounding of f32 networks is below it.
const BACKWARDS_SHARE: f64 = 1e-3;
/// A chord shorter than this has no useful direction.
const CHORD_MIN_RAD: f64 = 0.1;

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Path {
    /// Mean limb error against the yardstick, degrees.
    pub limb_deg_mean: f64,
    pub monotone_share: f64,
    pub length_mean: f64,
    /// Longest path of all pairs, relative to the chord.
    pub length_max: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interpolations {
    pub of_a_clip: Interpolation,
    pub of_all: Interpolation,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interpolation {
    pub pairs: usize,
    pub latent_k0: Path,
    pub latent_k2: Path,
    pub joint_k0: Path,
    pub joint_k2: Path,
}

/// Measures [`PAIRS`] pairs of each kind from the tasks' frames. Measures nothing if there is no frame.
pub fn measure(arm: &ArmModel, network: &Network, tasks: &[Task]) -> Interpolations {
    let humans: Vec<(usize, &Human)> = tasks
        .iter()
        .enumerate()
        .flat_map(|(clip, task)| task.clip.human.iter().map(move |human| (clip, human)))
        .collect();
    if humans.is_empty() {
        return Interpolations::default();
    }
    let mut rng = Pcg64::new(u128::from(SEED), 1);
    let mut kind = |one_clip: bool| {
        let mut draw = |humans: &[(usize, &Human)]| rng.random_range(0..humans.len());
        let pairs: Vec<[&Human; 2]> = (0..PAIRS)
            .map(|_| {
                let (clip, from) = humans[draw(&humans)];
                let start = if one_clip { humans.partition_point(|(other, _)| *other < clip) } else { 0 };
                let end = if one_clip { humans.partition_point(|(other, _)| *other <= clip) } else { humans.len() };
                let among = &humans[start..end];
                [from, among[draw(among)].1]
            })
            .collect();
        let paths: Vec<_> = pairs.par_iter().map(|[from, to]| pair(arm, network, from, to)).collect();
        let all = |way: usize| mean(paths.iter().map(|ways| &ways[way]));
        Interpolation { pairs: pairs.len(), latent_k0: all(0), latent_k2: all(1), joint_k0: all(2), joint_k2: all(3) }
    };
    Interpolations { of_a_clip: kind(true), of_all: kind(false) }
}

struct One {
    limb_deg: f64,
    /// True if the path never goes back, and its relative length. None if the chord is too short.
    shape: Option<(bool, f64)>,
}

fn pair(arm: &ArmModel, network: &Network, from: &Human, to: &Human) -> [One; 4] {
    let latents = |human: &Human| -> [Latent; 2] { network.encode_human(&human.each_ref().map(features)) };
    let (z0, z1) = (latents(from), latents(to));
    let decode = |s: f64| network.decode(&[0, 1].map(|i: usize| interpolate_latent(&z0[i], &z1[i], s)));
    let human = |s: f64| -> Human { [0, 1].map(|i: usize| from[i].slerp(&to[i], s)) };
    let refined = |s: f64| -> Posture {
        let (target, start) = (human(s), decode(s));
        [0, 1].map(|i: usize| posture(arm, &target[i], &start[i], None, REFINE_STEPS))
    };
    let straight = |ends: &[Posture; 2], s: f64| -> Posture {
        let [q0, q1] = ends;
        std::array::from_fn(|i| std::array::from_fn(|j| q0[i][j] + s * (q1[i][j] - q0[i][j])))
    };
    let (decoded_ends, refined_ends) = ([decode(0.0), decode(1.0)], [refined(0.0), refined(1.0)]);
    let one = |way: &dyn Fn(f64) -> Posture| {
        let path: Vec<Posture> = (0..=STEPS).map(|i| way(i as f64 / STEPS as f64)).collect();
        let between = (1..STEPS).map(|i| {
            let target = human(i as f64 / STEPS as f64);
            let errors = [0, 1].map(|side: usize| arm.limb_error_deg(&path[i][side], &target[side]));
            errors.iter().flatten().sum::<f64>() / 4.0
        });
        One { limb_deg: between.sum::<f64>() / (STEPS - 1) as f64, shape: shape(&path) }
    };
    [one(&decode), one(&refined), one(&|s| straight(&decoded_ends, s)), one(&|s| straight(&refined_ends, s))]
}

/// Returns true if a path of joint positions never goes back along its chord, and its length relative to the chord.
pub fn shape(path: &[Posture]) -> Option<(bool, f64)> {
    let joints = |posture: &Posture| SVector::<f64, { 2 * ARM_Q }>::from_column_slice(posture.as_flattened());
    let chord = joints(path.last()?) - joints(path.first()?);
    let length = chord.norm();
    if length < CHORD_MIN_RAD {
        return None;
    }
    let steps: Vec<_> = path.windows(2).map(|pair| joints(&pair[1]) - joints(&pair[0])).collect();
    let monotone = steps.iter().all(|step| step.dot(&chord) / (length * length) >= -BACKWARDS_SHARE);
    Some((monotone, steps.iter().map(|step| step.norm()).sum::<f64>() / length))
}

fn mean<'a>(ones: impl Iterator<Item = &'a One>) -> Path {
    let (mut path, mut pairs, mut shaped) = (Path::default(), 0.0, 0.0);
    for one in ones {
        pairs += 1.0;
        path.limb_deg_mean += one.limb_deg;
        if let Some((monotone, length)) = one.shape {
            shaped += 1.0;
            path.monotone_share += f64::from(u8::from(monotone));
            path.length_mean += length;
            path.length_max = path.length_max.max(length);
        }
    }
    let shaped = f64::max(shaped, 1.0);
    Path {
        limb_deg_mean: path.limb_deg_mean / f64::max(pairs, 1.0),
        monotone_share: path.monotone_share / shaped,
        length_mean: path.length_mean / shaped,
        ..path
    }
}

impl fmt::Display for Interpolations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let columns = [
            column(["", "limb deg"], 10, |path: &Path| number(path.limb_deg_mean, 2)),
            column(["", "monotone %"], 12, |path: &Path| number(100.0 * path.monotone_share, 1)),
            column(["", "length / chord"], 16, |path: &Path| number(path.length_mean, 3)),
            column(["", "longest"], 10, |path: &Path| number(path.length_max, 2)),
        ];
        for (kind, Interpolation { pairs, latent_k0, latent_k2, joint_k0, joint_k2 }) in
            [("of one clip", &self.of_a_clip), ("of all clips", &self.of_all)]
        {
            writeln!(f, "\n{pairs} pairs of key poses {kind}, against the slerp of the human's limbs")?;
            let rows =
                [("latent_k0", latent_k0), ("latent_k2", latent_k2), ("joint_k0", joint_k0), ("joint_k2", joint_k2)];
            table::write(f, ("path", 12), &columns, rows.into_iter())?;
        }
        Ok(())
    }
}
