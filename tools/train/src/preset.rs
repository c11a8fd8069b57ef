//! Named recipes: the product's networks, the paper's recipe, S3LE, and ours with one part left out.

use crate::kinematics::{ARM, HumanInput};
use crate::networks::{LATENT, Pose};
use crate::objective::Weighting;
use clap::ValueEnum;

/// A named recipe. The product runs `quick` and `full`. The others are baselines for `eval`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// The product's networks in minutes, for a first look
    Quick,
    /// The product's networks as shipped
    Full,
    /// ImitationNet: one latent for both arms, rotations relative to the parent, triplet + rec + ltc
    Paper,
    /// The paper's recipe without the latent cycle
    PaperNoLtc,
    /// The paper's recipe without the triplet term
    PaperNoTriplet,
    /// Ours with one latent for both arms
    OursPose,
    /// Ours without the triplet term
    OursNoTriplet,
    /// Ours without the latent cycle
    OursNoLtc,
    /// Ours without the reconstruction of robot postures
    OursNoRec,
    /// Ours with the number of steps of the three above, for comparison
    OursSameSteps,
    /// S3LE: latents regressed on pairs of least S_GR, with a lookup of the nearest known posture
    S3le,
}

/// Contents of a preset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// Input and output of the networks.
    pub pose: Pose,
    /// Weights of the loss terms.
    pub weighting: Weighting,
    /// Number of steps.
    pub steps: u64,
    /// Poses per step.
    pub batch: usize,
    /// Peak learning rate of Adam.
    pub rate: f64,
    /// Decay of Adam's second moment.
    pub second_decay: f32,
}

/// Steps of every baseline. The table of baselines was measured with them. Each baseline takes 2 to 3 minutes
/// on two idle cores.
const BASELINE_STEPS: u64 = 12_000;

impl Preset {
    /// Returns the recipe of the preset.
    pub fn recipe(self) -> Recipe {
        let ours = Weighting::OURS;
        // Batch, rate and decay: `weights/EXPERIMENTS.md`.
        let baseline = Recipe {
            pose: Pose::default(),
            weighting: ours,
            steps: BASELINE_STEPS,
            batch: 256,
            rate: 4e-3,
            second_decay: 0.99,
        };
        // ImitationNet, section III: L = 10 triplet + 5 |x_r - D(Q_r(x_r))|_1 + |z - Q_r(D(z))|_1 in batches of
        // 256, Adam at 1e-3. Its norms are sums. Our terms are means over 10 joints and 8 latent components.
        let both = Pose { arms: 2, input: HumanInput::LocalQuaternions };
        let paper = Weighting {
            triplet: 10.0,
            reconstruction: 5.0 * (2 * ARM) as f32,
            cycle: LATENT as f32,
            ..Weighting::default()
        };
        let of_paper = Recipe { pose: both, weighting: paper, rate: 1e-3, second_decay: 0.999, ..baseline };
        let with = |weighting| Recipe { weighting, ..baseline };
        match self {
            Self::Quick => Recipe { steps: 6_000, ..baseline },
            Self::Full => Recipe { steps: 80_000, ..baseline },
            Self::Paper => of_paper,
            Self::PaperNoLtc => Recipe { weighting: Weighting { cycle: 0.0, ..paper }, ..of_paper },
            Self::PaperNoTriplet => Recipe { weighting: Weighting { triplet: 0.0, ..paper }, ..of_paper },
            Self::OursPose => Recipe { pose: Pose { arms: 2, input: HumanInput::Axes }, ..baseline },
            Self::OursNoTriplet => with(Weighting { triplet: 0.0, ..ours }),
            Self::OursNoLtc => with(Weighting { cycle: 0.0, ..ours }),
            Self::OursNoRec => with(Weighting { reconstruction: 0.0, ..ours }),
            Self::OursSameSteps => baseline,
            // The robot's autoencoder keeps the latent from collapsing. The regression has the weight of the
            // paper's triplet.
            Self::S3le => {
                let weighting = Weighting { pairing: 10.0, reconstruction: 5.0, ..Weighting::default() };
                Recipe { weighting, ..of_paper }
            }
        }
    }

    /// Returns the name of a baseline, as on the command line. None for the product's networks.
    pub fn baseline(self) -> Option<String> {
        let is_product = matches!(self, Self::Quick | Self::Full);
        self.to_possible_value().filter(|_| !is_product).map(|value| value.get_name().to_owned())
    }
}
