//! The three perceptrons of an arm in one parameter vector: Q_h 12 -> 8, Q_r 5 -> 8, D_r 8 -> 5.

use crate::kinematics::{ARM, FEATURES};
use crate::mlp::{Mlp, Shape};
use rand_pcg::Pcg64;
use retarget::Layers;

/// Dimension of the shared latent space (ImitationNet, section IV).
pub const LATENT: usize = 8;
/// Reach of the decoder beyond the limits, as a factor of half the range. tanh only tends to 1, so without this
/// factor the limits themselves would be out of reach.
pub const REACH: f32 = 1.02;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Number of hidden layers. The paper has 6.
    pub hidden_layers: usize,
    /// Units of each layer. The paper has 128.
    pub hidden_width: usize,
}

/// Layout of the three perceptrons in one parameter vector.
#[derive(Clone, Debug)]
pub struct Networks {
    /// Q_h: human features to latent.
    pub human: Mlp,
    /// Q_r: normalised joint positions to latent.
    pub robot: Mlp,
    /// D_r: latent to the argument of the output's tanh.
    pub decoder: Mlp,
}

impl Networks {
    pub fn new(size: Size) -> Self {
        let Size { hidden_layers, hidden_width } = size;
        let shape = |input, output| Shape { input, hidden_layers, hidden_width, output };
        let human = Mlp::new(shape(FEATURES, LATENT), 0);
        let robot = Mlp::new(shape(ARM, LATENT), human.end());
        let decoder = Mlp::new(shape(LATENT, ARM), robot.end());
        Self { human, robot, decoder }
    }

    pub fn parameters(&self) -> usize {
        self.decoder.end()
    }

    pub fn named(&self) -> [(&'static str, &Mlp); 3] {
        [("human", &self.human), ("robot", &self.robot), ("decoder", &self.decoder)]
    }

    /// Returns random weights, and biases of zero.
    pub fn initial(&self, seed: u64) -> Vec<f32> {
        let mut rng = Pcg64::new(u128::from(seed), 0x1417);
        let mut parameters = vec![0.0; self.parameters()];
        self.named().iter().for_each(|(_, mlp)| mlp.draw(&mut parameters, &mut rng));
        parameters
    }

    pub fn layers(&self, parameters: &[f32]) -> Layers {
        let [human, robot, decoder] = self.named().map(|(_, mlp)| mlp.dense(parameters));
        Layers { human, robot, decoder }
    }
}
