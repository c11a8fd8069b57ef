//! Converts one pose of both arms to joint positions, with the retargeting's own steps, without its clock.

use messages::{JOINTS, LEFT_ARM, LIMBS, RIGHT_ARM};
use retarget::{
    ARM_Q, ArmModel, ArmQ, Limbs, Network, PRIOR_WEIGHT, Sample, Weights, closed_form, features, mirror, refine,
    rotation_from_xyzw,
};
use robot::Model;

/// Left and right.
pub const BOTH_ARMS: usize = 2;

/// Data that all poses share.
#[derive(Clone, Debug)]
pub struct Postures {
    arm: ArmModel,
    network: Option<Network>,
    refine_steps: u32,
    home: [f64; JOINTS],
}

impl Postures {
    /// Creates it for `model`. Without weights it uses the closed form.
    #[must_use]
    pub fn new(model: &Model, weights: Option<Weights>, refine_steps: u32) -> Self {
        let network = weights.map(|weights| weights.network);
        Self { arm: ArmModel::of(model), network, refine_steps, home: model.home }
    }

    /// Returns both arms as left arms, from limb rotations indexed by `messages::Limb`. None if one of them is
    /// not a rotation.
    #[must_use]
    pub fn arms(limbs: &[[f32; 4]; LIMBS]) -> Option<[Limbs; BOTH_ARMS]> {
        let arm = |side: usize| {
            let rotation = |limb: usize| {
                let limb = limbs[2 * side + limb].map(f64::from);
                rotation_from_xyzw(if side == 0 { limb } else { mirror(limb) })
            };
            Some(Limbs { upper: rotation(0)?, fore: rotation(1)? })
        };
        Some([arm(0)?, arm(1)?])
    }

    /// Returns points of the latent space. They are zero without a network.
    #[must_use]
    pub fn encode(&self, arms: &[Limbs; BOTH_ARMS]) -> [Sample; BOTH_ARMS] {
        let latents = match &self.network {
            Some(network) => network.encode_human(&arms.map(|limbs| features(&limbs))),
            None => Default::default(),
        };
        std::array::from_fn(|arm| Sample { latent: latents[arm], limbs: arms[arm] })
    }

    /// Returns the joint positions of both arms, rad: decoded (or closed-form, continuing from `previous`),
    /// then refined. None if the network's positions are not finite.
    #[must_use]
    pub fn posture(
        &self,
        samples: &[Sample; BOTH_ARMS],
        previous: Option<&[ArmQ; BOTH_ARMS]>,
    ) -> Option<[ArmQ; BOTH_ARMS]> {
        let starts = match &self.network {
            Some(network) => network.decode(&samples.map(|sample| sample.latent)),
            None => std::array::from_fn(|arm| {
                let before = previous.map_or_else(|| self.arm.mid(), |q| q[arm]);
                closed_form(&self.arm, &samples[arm].limbs, &before)
            }),
        };
        if !starts.iter().flatten().all(|q| q.is_finite()) {
            return None;
        }
        Some(std::array::from_fn(|arm| {
            let start = &starts[arm];
            refine(&self.arm, &samples[arm].limbs, start, start, PRIOR_WEIGHT, self.refine_steps).q
        }))
    }

    /// Returns all joints, rad (lift in m). Joints that no limb determines are at home.
    #[must_use]
    pub fn joints(&self, arms: &[ArmQ; BOTH_ARMS]) -> [f64; JOINTS] {
        let mut q = self.home;
        for (arm, joints) in [LEFT_ARM, RIGHT_ARM].into_iter().enumerate() {
            for (j, joint) in joints.take(ARM_Q).enumerate() {
                q[joint] = arms[arm][j];
            }
        }
        q
    }
}
