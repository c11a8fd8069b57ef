//! Converts one pose of both arms to joint positions, with the retargeting's own steps, without its clock.

use messages::JOINTS_MAX;
use retarget::{ARMS, ArmModel, ArmQ, Latent, Limbs, PostureSolver, Sample, Weights};
use robot::{Arm, Model};

/// Data that all poses share.
#[derive(Clone, Debug)]
pub struct Postures {
    solver: PostureSolver,
    home: [f64; JOINTS_MAX],
    arms: [Arm; ARMS],
}

impl Postures {
    /// Creates it for `model`. Without weights it uses the closed form.
    pub fn new(model: &Model, weights: Option<Weights>, refine_steps: u32) -> Self {
        let network = weights.map(|weights| weights.network);
        let arms = ArmModel::both(model);
        let solver = PostureSolver { arms, network, refine_steps };
        Self { solver, home: model.home, arms: model.arms }
    }

    /// Returns points of the latent space. They are zero without a network.
    pub fn encode(&self, arms: &[Limbs; ARMS]) -> [Sample; ARMS] {
        let latents = self.solver.encode(arms);
        std::array::from_fn(|arm| Sample {
            latent: latents[arm],
            limbs: arms[arm],
            hand: None,
            closure: None,
            touching: None,
        })
    }

    /// Returns the joint positions of both arms, rad: see [`PostureSolver::next`]. None if the network's positions are
    /// not finite.
    pub fn posture(&self, samples: &[Sample; ARMS], previous: Option<&[ArmQ; ARMS]>) -> Option<[ArmQ; ARMS]> {
        let previous = std::array::from_fn(|arm| previous.map(|q| q[arm]));
        let [left, right] = self.solver.next(&samples.map(Some), &previous);
        Some([left?, right?])
    }

    /// Returns the decoded joint positions of both arms without refinement, rad. None without a network, or if the positions
    /// are not finite.
    pub fn decode(&self, latents: &[Latent; ARMS]) -> Option<[ArmQ; ARMS]> {
        let q = self.solver.network.as_ref()?.decode(latents);
        q.iter().flatten().all(|q| q.is_finite()).then_some(q)
    }

    /// Returns all joints, rad (lift in m). Joints that no limb determines are at home.
    pub fn joints(&self, arms: &[ArmQ; ARMS]) -> [f64; JOINTS_MAX] {
        let mut q = self.home;
        for (arm, solved) in self.arms.iter().zip(arms) {
            // Both arms were solved as left arms.
            arm.set_limbs(&arm.mirrored(solved), &mut q);
        }
        q
    }
}
