//! The compared methods by name, and their conversion of limbs to joint positions.

use crate::cli::Cli;
use crate::clips::Human;
use crate::lookup::PostureTable;
use crate::sew::sew;
use ::report::out_of_bounds;
use retarget::{ArmIdentity, ArmModel, ArmQ, Network, Weights, closed_form, oracle, refine, solve_poses};
use rt::Failure;
use std::path::Path;
use std::sync::Arc;
use train::baseline::Baseline;

/// Refinement steps of the two baselines without a network.
const BASELINE_STEPS: u32 = 3;
/// These baselines have no pull toward the start, unlike ours. The pull would increase their error on the
/// validation clips (1.83 instead of 1.75 degrees, and 1.67 instead of 1.61). It would avoid some of their
/// flips (11 instead of 17, 1 instead of 2).
const BASELINE_PRIOR_WEIGHT: f64 = 0.0;
/// The learned baselines: the paper's recipe and its ablations, ours without a term, and S3LE. Their files have the
/// same names, with dashes.
const LEARNED: [&str; 9] = [
    "paper",
    "paper_no_ltc",
    "paper_no_triplet",
    "ours_pose",
    "ours_no_triplet",
    "ours_no_ltc",
    "ours_no_rec",
    "ours_same_steps",
    "s3le",
];
const OURS_STEPS_MAX: u32 = 3;

/// Joint positions of both arms, rad.
pub type Posture = [ArmQ; 2];

#[derive(Debug)]
pub enum Solver {
    /// The shared latent space, then Levenberg-Marquardt steps, with the network's output as prior, as in the product.
    Ours {
        network: Arc<Network>,
        steps: u32,
    },
    /// The closed form of [`sew`].
    Sew,
    /// The closed form of the product, then three Levenberg-Marquardt steps.
    ClosedForm,
    /// Three steps from the previous frame's output. The first frame starts in the middle of the limits.
    PreviousFrame,
    Lookup(PostureTable),
    Learned(Box<Baseline>),
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
    let analytic = ["sew", "closed_form_3lm", "previous_frame_3lm", "lookup"];
    ours.chain(analytic.iter().chain(&LEARNED).chain(&["oracle"]).map(|name| (*name).to_owned())).collect()
}

/// Prepares the requested methods, or all. Those without weights report it, and `human` as the motion files of the
/// command that makes them.
pub fn prepare(
    cli: &Cli,
    human: &Path,
    identity: &ArmIdentity,
    weights: Option<&Weights>,
) -> Result<Vec<Method>, Failure> {
    let network = weights.map(|weights| Arc::new(weights.network.clone()));
    let lacking = |preset: &str, base: &Path, what: &str| {
        let robot = cli.robot().shipped_file().unwrap_or_default();
        let (human, robot, base) = (human.display(), robot.display(), base.display());
        let train = "cargo run --release -p train --";
        Missing {
            reason: format!("{base}.safetensors {what}"),
            command: format!("{train} --human {human} --robot {robot} --preset {preset} --out {base}"),
        }
    };
    let missing = |preset: &str, base: &Path| lacking(preset, base, "is not there");
    let solver = |name: &str| -> Result<Result<Solver, Missing>, Failure> {
        Ok(Ok(match name {
            "sew" => Solver::Sew,
            "closed_form_3lm" => Solver::ClosedForm,
            "previous_frame_3lm" => Solver::PreviousFrame,
            "oracle" => Solver::Oracle,
            "lookup" => Solver::Lookup(PostureTable::draw(&identity.arm)),
            _ => match (name.strip_prefix("ours_k").and_then(|steps| steps.parse().ok()), &network) {
                (Some(steps), Some(network)) => Solver::Ours { network: network.clone(), steps },
                (Some(_), None) => return Ok(Err(missing("full", &cli.weights().0.with_extension("")))),
                (None, _) => {
                    let preset = name.replace('_', "-");
                    let base = cli.baselines.join(&preset);
                    if !base.with_extension("toml").exists() {
                        return Ok(Err(missing(&preset, &base)));
                    }
                    let Some(baseline) = Baseline::read(&base, identity)? else {
                        return Ok(Err(lacking(&preset, &base, "is for another arm, use another --baselines")));
                    };
                    Solver::Learned(Box::new(baseline))
                }
            },
        }))
    };
    let known = names();
    let prepared = cli.methods.as_ref().unwrap_or(&known).iter().map(|name| {
        if !known.contains(name) {
            return Err(out_of_bounds("--methods", name, format!("names of {}", known.join(", "))));
        }
        Ok(Method { name: name.clone(), solver: solver(name)? })
    });
    prepared.collect()
}

impl Solver {
    /// Returns both arms of one instant. `previous` is the method's own previous output.
    pub fn pose(&self, arm: &ArmModel, human: &Human, previous: &Posture) -> Posture {
        let each = |solve: &dyn Fn(usize) -> ArmQ| [solve(0), solve(1)];
        match self {
            Self::Ours { network, steps } => solve_poses(arm, network, human, *steps).map(|pose| pose.q),
            Self::Sew => each(&|i| sew(arm, &human[i], &previous[i])),
            Self::ClosedForm => each(&|i| {
                let start = closed_form(arm, &human[i], &previous[i]);
                refine(arm, &human[i], &start, &start, BASELINE_PRIOR_WEIGHT, BASELINE_STEPS).q
            }),
            Self::PreviousFrame => {
                each(&|i| refine(arm, &human[i], &previous[i], &previous[i], BASELINE_PRIOR_WEIGHT, BASELINE_STEPS).q)
            }
            Self::Lookup(table) => table.nearest(&[*human]).first().copied().unwrap_or(*previous),
            Self::Learned(learned) => learned.retarget(human),
            Self::Oracle => each(&|i| oracle(arm, &human[i], &previous[i]).q),
        }
    }

    pub fn trained_on(&self) -> Option<String> {
        let Self::Learned(learned) = self else { return None };
        Some(format!("{} steps on {}", learned.manifest.steps, learned.manifest.trained_on))
    }

    /// Returns the postures of a whole clip. Each frame gets the previous output, and the first one the middle of the
    /// limits.
    pub fn clip(&self, arm: &ArmModel, humans: &[Human]) -> Vec<Posture> {
        match self {
            Self::Lookup(table) => table.nearest(humans),
            Self::Learned(learned) => humans.iter().map(|human| learned.retarget(human)).collect(),
            Self::Ours { .. } | Self::Sew | Self::ClosedForm | Self::PreviousFrame | Self::Oracle => {
                let mut previous = [arm.mid(); 2];
                let next = |human| {
                    previous = self.pose(arm, human, &previous);
                    previous
                };
                humans.iter().map(next).collect()
            }
        }
    }
}
