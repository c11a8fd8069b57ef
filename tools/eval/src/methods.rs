//! The compared methods by name, and their conversion of limbs to joint positions.

use crate::cli::Cli;
use crate::clips::Human;
use ::report::out_of_bounds;
use retarget::{ArmModel, ArmQ, Network, Weights, closed_form, oracle, refine, solve_poses};
use rt::Failure;
use std::path::Path;
use std::sync::Arc;

/// Refinement steps of the two baselines without a network.
const BASELINE_STEPS: u32 = 3;
/// These baselines have no pull toward the start, unlike ours. The pull would increase their error on the
/// validation clips (1.83 instead of 1.75 degrees, and 1.67 instead of 1.61). It would avoid some of their
/// flips (11 instead of 17, 1 instead of 2).
const BASELINE_PRIOR_WEIGHT: f64 = 0.0;
const OURS_STEPS_MAX: u32 = 3;

/// Joint positions of both arms, rad.
pub type Posture = [ArmQ; 2];

pub fn limbs_of(arms: [&ArmModel; 2], posture: &Posture) -> Human {
    [0, 1].map(|side| arms[side].forward(&posture[side]))
}

#[derive(Debug)]
pub enum Solver {
    /// The shared latent space, then Levenberg-Marquardt steps, with the network's output as prior, as in the product.
    Ours { network: Arc<Network>, steps: u32 },
    /// The closed form of the product, then three Levenberg-Marquardt steps.
    ClosedForm,
    /// Three steps from the previous frame's output. The first frame starts in the middle of the limits.
    PreviousFrame,
    /// S_GR minimised from many starts. This is the best that the arm can do.
    Oracle,
}

#[derive(Debug)]
pub struct Method {
    pub name: String,
    pub solver: Result<Solver, Missing>,
}

#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Missing {
    pub reason: String,
    pub command: String,
}

pub fn names() -> Vec<String> {
    let ours = (0..=OURS_STEPS_MAX).map(|steps| format!("ours_k{steps}"));
    ours.chain(["closed_form_3lm", "previous_frame_3lm", "oracle"].map(str::to_owned)).collect()
}

/// Prepares the requested methods, or all. Ours without weights report it, and `human` as the motion files of the
/// command that makes them.
pub fn prepare(cli: &Cli, human: &Path, weights: Option<&Weights>) -> Result<Vec<Method>, Failure> {
    let network = weights.map(|weights| Arc::new(weights.network.clone()));
    let missing = || {
        let base = cli.weights().0.with_file_name(cli.robot().name());
        let robot = cli.robot().shipped_file().unwrap_or_default();
        let (human, robot, base) = (human.display(), robot.display(), base.display());
        Missing {
            reason: format!("{base}.safetensors is not there"),
            command: format!("cargo run --release -p train -- --human {human} --robot {robot} --out {base}"),
        }
    };
    let known = names();
    let prepared = cli.methods.as_ref().unwrap_or(&known).iter().map(|name| {
        let solver = match name.as_str() {
            "closed_form_3lm" => Ok(Solver::ClosedForm),
            "previous_frame_3lm" => Ok(Solver::PreviousFrame),
            "oracle" => Ok(Solver::Oracle),
            _ => {
                let steps = known.iter().position(|other| other == name);
                let steps =
                    steps.ok_or_else(|| out_of_bounds("--methods", name, format!("names of {}", known.join(", "))))?;
                let ours = |network: &Arc<Network>| Solver::Ours { network: network.clone(), steps: steps as u32 };
                network.as_ref().map(ours).ok_or_else(missing)
            }
        };
        Ok(Method { name: name.clone(), solver })
    });
    prepared.collect()
}

impl Solver {
    /// Returns both arms of one instant. `previous` is the method's own previous output.
    pub fn pose(&self, arms: [&ArmModel; 2], human: &Human, previous: &Posture) -> Posture {
        let each = |solve: &dyn Fn(usize, &ArmModel) -> ArmQ| [solve(0, arms[0]), solve(1, arms[1])];
        match self {
            Self::Ours { network, steps } => solve_poses(arms, network, human, *steps).map(|pose| pose.q),
            Self::ClosedForm => each(&|i, arm| {
                let start = closed_form(arm, &human[i], &previous[i]);
                refine(arm, &human[i], &start, &start, BASELINE_PRIOR_WEIGHT, BASELINE_STEPS).q
            }),
            Self::PreviousFrame => each(&|i, arm| {
                refine(arm, &human[i], &previous[i], &previous[i], BASELINE_PRIOR_WEIGHT, BASELINE_STEPS).q
            }),
            Self::Oracle => each(&|i, arm| oracle(arm, &human[i], &previous[i]).q),
        }
    }

    /// Returns the postures of a whole clip. Each frame gets the previous output, and the first one the middle of the
    /// limits.
    pub fn clip(&self, arms: [&ArmModel; 2], humans: &[Human]) -> Vec<Posture> {
        let mut previous = arms.map(ArmModel::mid);
        let next = |human| {
            previous = self.pose(arms, human, &previous);
            previous
        };
        humans.iter().map(next).collect()
    }
}
