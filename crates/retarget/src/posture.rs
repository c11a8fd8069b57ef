//! From a person's limbs to the joints of an arm: encode, decode, refine, compare with the previous posture. All users of
//! retargeting call this module.

use crate::arm::{ARMS, ArmModel, ArmQ, features};
use crate::closed_form::closed_form;
use crate::network::{Latent, Network};
use crate::refine::{PRIOR_WEIGHT, refine};
use crate::resample::Sample;
use robot::Limbs;

/// Margin in S_GR by which another posture must be better than the network's: one limb off by 11 degrees.
const CLEARLY_BETTER: f64 = 0.01;
/// Margin by which it must be better if it leaves a motion: one limb off by 37 degrees. A person who turns beyond a limit
/// by less finds the robot at this limit, and not at its other end. Assumption.
const WORTH_A_LEAP: f64 = 0.1;

/// An arm's pose on its way to a posture, without a previous posture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolvedPose {
    /// The point of the latent space.
    pub latent: Latent,
    /// The decoded posture, rad.
    pub decoded: ArmQ,
    /// The refined posture, rad.
    pub q: ArmQ,
}

/// Encodes, decodes and refines the limbs of `N` arms, each by itself: a left and a right one in turn.
pub fn solve_poses<const N: usize>(
    arms: [&ArmModel; ARMS],
    network: &Network,
    limbs: &[Limbs; N],
    refine_steps: u32,
) -> [SolvedPose; N] {
    let latents = network.encode_human(&limbs.each_ref().map(features));
    let decoded = network.decode(&latents);
    std::array::from_fn(|n| {
        let q = posture(arms[n % ARMS], &limbs[n], &decoded[n], None, refine_steps);
        SolvedPose { latent: latents[n], decoded: decoded[n], q }
    })
}

/// Returns the refined start, or a refined posture that is clearly better: the previous one, or that of the closed form. Far
/// outside its training data, the network may turn to the other end of a joint before the person does. Where limits leave
/// no exact posture, it may be in another basin than the best one.
pub fn posture(arm: &ArmModel, human: &Limbs, start: &ArmQ, previous: Option<&ArmQ>, refine_steps: u32) -> ArmQ {
    let refined = |start: &ArmQ| refine(arm, human, start, start, PRIOR_WEIGHT, refine_steps);
    let found = refined(start);
    // Nothing is clearly better than this. Without steps the network speaks alone.
    if refine_steps == 0 || found.s_gr <= CLEARLY_BETTER {
        return found.q;
    }
    let better = |start: &ArmQ, by: f64| {
        // Two steps do not repair a posture that is already worse.
        let other = (arm.s_gr(start, human) + by < found.s_gr).then(|| refined(start));
        other.filter(|other| other.s_gr + by < found.s_gr).map(|other| other.q)
    };
    let closed = || {
        let by = if previous.is_some() { WORTH_A_LEAP } else { CLEARLY_BETTER };
        // It is slow for an arm without a closed form, and what is this near leaves nothing to gain.
        (found.s_gr > by).then(|| closed_form(arm, human, previous.unwrap_or(&found.q))).and_then(|q| better(&q, by))
    };
    previous.and_then(|previous| better(previous, CLEARLY_BETTER)).or_else(closed).unwrap_or(found.q)
}

/// Turns the limbs of a sequence of poses into postures.
#[derive(Clone, Debug)]
pub struct PostureSolver {
    /// Models of both arms, as left arms.
    pub arms: [ArmModel; ARMS],
    /// `None` stands for the closed form.
    pub network: Option<Network>,
    /// Levenberg-Marquardt steps per arm.
    pub refine_steps: u32,
}

impl PostureSolver {
    /// Returns points of the latent space. They are zero without a network.
    pub fn encode(&self, limbs: &[Limbs; ARMS]) -> [Latent; ARMS] {
        match &self.network {
            // Both arms at once cost hardly more than one, because the weights are read once.
            Some(network) => network.encode_human(&limbs.each_ref().map(features)),
            None => [Latent::default(); ARMS],
        }
    }

    /// Returns the next posture of each arm, rad. The closed form continues `previous`, the last posture of each arm,
    /// and [`posture`] may keep it. `None` for an arm without a sample or with a result of the network that is not
    /// finite.
    pub fn next(&self, samples: &[Option<Sample>; ARMS], previous: &[Option<ArmQ>; ARMS]) -> [Option<ArmQ>; ARMS] {
        let decoded = match &self.network {
            Some(network) if samples.iter().any(Option::is_some) => {
                Some(network.decode(&samples.map(|sample| sample.map_or(Latent::default(), |sample| sample.latent))))
            }
            Some(_) | None => None,
        };
        std::array::from_fn(|n| {
            let (arm, limbs) = (&self.arms[n], &samples[n]?.limbs);
            let start = match &decoded {
                Some(decoded) => decoded[n],
                None => closed_form(arm, limbs, &previous[n].unwrap_or_else(|| arm.mid())),
            };
            let start = match samples[n].and_then(|sample| sample.touching) {
                Some((q, share)) => std::array::from_fn(|j| start[j] + (q[j] - start[j]) * share),
                None => start,
            };
            let finite = start.iter().all(|x| x.is_finite());
            finite.then(|| posture(arm, limbs, &start, previous[n].as_ref(), self.refine_steps))
        })
    }
}
