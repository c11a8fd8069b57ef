//! Key poses as points of the shared latent space, and their mixtures.

use retarget::{ARM_Q, ARMS, ArmModel, ArmQ, LATENT, Latent, Limbs, Network};
use robot::Model;

/// Key poses of both arms, encoded, decoded and refined once.
#[derive(Clone, Debug)]
pub struct Keys {
    arms: [ArmModel; ARMS],
    network: Network,
    keys: Vec<Key>,
}

#[derive(Clone, Copy, Debug)]
struct Key {
    latents: [Latent; ARMS],
    q: [ArmQ; ARMS],
    /// Change of the decoded posture by refinement.
    added: [ArmQ; ARMS],
}

impl Keys {
    /// Passes each of `poses` through the human encoder, the decoder, and `refine_steps` Levenberg-Marquardt
    /// steps toward the human's limbs.
    pub fn new(model: &Model, network: &Network, poses: &[[Limbs; ARMS]], refine_steps: u32) -> Self {
        let arms = ArmModel::both(model);
        let key = |limbs: &[Limbs; ARMS]| {
            let poses = retarget::solve_poses(arms.each_ref(), network, limbs, refine_steps);
            let added = poses.map(|pose| std::array::from_fn(|j| pose.q[j] - pose.decoded[j]));
            Key { latents: poses.map(|pose| pose.latent), q: poses.map(|pose| pose.q), added }
        };
        let keys = poses.iter().map(key).collect();
        Self { arms, network: network.clone(), keys }
    }

    /// Returns the arms to which the joint positions belong.
    pub fn arms(&self) -> &[ArmModel; ARMS] {
        &self.arms
    }

    /// Returns q = D_r(sum_i w_i z_i) + sum_i w_i (q_i - D_r(z_i)), rad, within the limits. The w_i are the shares of
    /// the keys, and their sum is 1. The refinement of a pose fades with its share. Refining every mixture by itself
    /// could jump from one end of a joint to the other. A key whose share is 1 is reached exactly.
    pub fn mix_latent(&self, shares: &[f64]) -> [ArmQ; ARMS] {
        let latents: [Latent; ARMS] = std::array::from_fn(|arm| {
            let z: [f64; LATENT] = self.sum(shares, |key| key.latents[arm].map(f64::from));
            z.map(|z| z as f32)
        });
        let decoded = self.network.decode(&latents);
        std::array::from_fn(|arm| {
            let added: ArmQ = self.sum(shares, |key| key.added[arm]);
            self.arms[arm].clamp(&std::array::from_fn(|j| decoded[arm][j] + added[j]))
        })
    }

    /// Returns q = sum_i w_i q_i, rad: the same mixture in the space of the joints, for comparison.
    pub fn mix_joints(&self, shares: &[f64]) -> [ArmQ; ARMS] {
        std::array::from_fn(|arm| -> [f64; ARM_Q] { self.sum(shares, |key| key.q[arm]) })
    }

    /// Returns sum_i w_i x_i as x_f + sum_i w_i (x_i - x_f), with the first key f whose share is not zero.
    /// Between two keys this is monotone to the last bit.
    fn sum<const N: usize>(&self, shares: &[f64], of: impl Fn(&Key) -> [f64; N]) -> [f64; N] {
        let mut with_share = shares.iter().zip(&self.keys).filter(|(share, _)| **share != 0.0);
        let first = with_share.next().map_or([0.0; N], |(_, key)| of(key));
        with_share.fold(first, |sum, (share, key)| {
            let x = of(key);
            std::array::from_fn(|n| sum[n] + share * (x[n] - first[n]))
        })
    }
}
