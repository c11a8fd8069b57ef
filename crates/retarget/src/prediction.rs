//! Prediction of a person's arm, learnt from recorded motion: a perceptron over the turns of the last half second.
//!
//! A *turn* is the rotation vector log(R(t - age) R(t)^-1) of a limb. The inputs are turns, and turns times the
//! directions of the arm's limbs: gravity and the ranges of the joints depend on these. No layer has a constant, so
//! a person who stands still is predicted to stand still. The outputs are the turns log(R(t + h) R(t)^-1) of the arm's
//! own limbs at a few horizons. Ages and horizons are in seconds, so any frame rate from 20 to 240 Hz works.

use nalgebra::{UnitQuaternion, Vector3};
use robot::Limbs;
use serde::{Deserialize, Serialize};

use perceptron::{
    Dense, Perceptron, WeightsError, WriteError, must, must_match, read_networks, sha256_hex, write_layers,
};

/// Format of the manifest. Files of format 1 held a linear map.
pub const PREDICTION_FORMAT: u32 = 2;
/// Ages at which both arms' past limbs are read, s.
pub const AGES_S: [f64; 11] = [0.017, 0.033, 0.05, 0.067, 0.1, 0.133, 0.167, 0.233, 0.3, 0.4, 0.5];
/// Indices of the ages whose turns are also multiplied by directions.
const DIRECTED: [usize; 5] = [1, 3, 4, 6, 8];
/// Prediction horizons, s. Linear interpolation between them.
pub const HORIZONS_S: [f64; 8] = [0.03, 0.06, 0.1, 0.15, 0.2, 0.28, 0.38, 0.48];
/// Numbers in the directions of one arm: two axes of two limbs.
const DIRECTIONS: usize = 12;
/// Inputs of the network: turns of four limbs, those of the arm's own two limbs in their own frames, and products.
pub const PREDICTION_INPUTS: usize = AGES_S.len() * (12 + 6) + DIRECTED.len() * 6 * DIRECTIONS;
/// Outputs of the network: the turns of two limbs at each horizon.
pub const PREDICTION_OUTPUTS: usize = HORIZONS_S.len() * 6;
/// Widths of the network's layers.
pub const PREDICTION_WIDTHS: [usize; 4] = [PREDICTION_INPUTS, 272, 272, PREDICTION_OUTPUTS];
/// Name of the network in its file.
const NAME: &str = "prediction";

/// Both arms at the newest skeleton and before it, each as a left arm. The predicted arm comes first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct History {
    /// At the newest skeleton.
    pub newest: [Limbs; 2],
    /// At each of `AGES_S` before it.
    pub before: [[Limbs; 2]; AGES_S.len()],
}

/// The turns of an arm's two limbs at each horizon, rad.
pub type Turns = [[Vector3<f64>; 2]; HORIZONS_S.len()];

/// Returns the rotation vector from `from` to `to`, along the shorter arc, rad.
pub fn turn(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = (to * from.inverse()).into_inner();
    let (w, v) = if q.w < 0.0 { (-q.w, -q.imag()) } else { (q.w, q.imag()) };
    let sin = v.norm();
    // The angle over its sine tends to 2 as the sine vanishes.
    v * if sin > 1e-9 { 2.0 * sin.atan2(w) / sin } else { 2.0 }
}

/// Computes the inputs of the network.
pub fn prediction_inputs(history: &History) -> [f32; PREDICTION_INPUTS] {
    let mut out = [0.0_f32; PREDICTION_INPUTS];
    let mut rest = out.iter_mut();
    let mut put = |values: &[f64]| values.iter().zip(&mut rest).for_each(|(value, out)| *out = *value as f32);
    let limbs = |arms: &[Limbs; 2]| [arms[0].upper, arms[0].fore, arms[1].upper, arms[1].fore];
    let newest = limbs(&history.newest);
    let own = [newest[0].inverse(), newest[1].inverse()];
    let axes = [Vector3::y(), -Vector3::z()];
    let directions = [newest[0] * axes[0], newest[0] * axes[1], newest[1] * axes[0], newest[1] * axes[1]];
    for (i, before) in history.before.iter().enumerate() {
        let before = limbs(before);
        let turns: [Vector3<f64>; 4] = std::array::from_fn(|limb| turn(&newest[limb], &before[limb]));
        for turn in &turns {
            put(turn.as_slice());
        }
        for limb in 0..2 {
            put((own[limb] * turns[limb]).as_slice());
        }
        if DIRECTED.contains(&i) {
            for part in turns[..2].iter().flat_map(|turn| turn.iter()) {
                for direction in &directions {
                    put((direction * *part).as_slice());
                }
            }
        }
    }
    out
}

/// The manifest beside the tensors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictionManifest {
    /// `PREDICTION_FORMAT`.
    pub format: u32,
    /// SHA-256 of the safetensors file, lower-case hex.
    pub sha256: String,
    /// `AGES_S`.
    pub ages_s: Vec<f64>,
    /// `HORIZONS_S`.
    pub horizons_s: Vec<f64>,
    /// `PREDICTION_WIDTHS`.
    pub widths: Vec<usize>,
    /// Seed of the training.
    pub seed: u64,
    /// Steps of the training.
    pub steps: u64,
    /// Description of the training data.
    pub trained_on: String,
    /// Figures of the validation, for the reader.
    #[serde(default)]
    pub validation: toml::Table,
}

/// The checked network.
#[derive(Clone, Debug)]
pub struct Prediction {
    network: Perceptron,
}

impl Prediction {
    /// Packs the layers, whose widths are `PREDICTION_WIDTHS`.
    pub fn new(layers: &[Dense]) -> Self {
        Self { network: Perceptron::new(layers) }
    }

    /// Reads the manifest and the safetensors file that it describes. It refuses everything that differs from the
    /// manifest or from what this build computes.
    ///
    /// # Errors
    /// Returns an error that names the mismatch.
    pub fn read(manifest_text: &str, bytes: &[u8]) -> Result<Self, WeightsError> {
        let manifest: PredictionManifest = toml::from_str(manifest_text)?;
        must("format", manifest.format, PREDICTION_FORMAT)?;
        must("ages_s", &manifest.ages_s[..], &AGES_S[..])?;
        must("horizons_s", &manifest.horizons_s[..], &HORIZONS_S[..])?;
        must("widths", &manifest.widths[..], &PREDICTION_WIDTHS[..])?;
        must_match(bytes, &manifest.sha256)?;
        let [layers] = read_networks(bytes, [(NAME, &PREDICTION_WIDTHS)])?;
        Ok(Self::new(&layers))
    }

    /// Writes the two files of a weights folder: safetensors bytes and manifest text with hash and shape filled in.
    ///
    /// # Errors
    /// Returns an error if the manifest holds a value that TOML cannot.
    pub fn write(layers: &[Dense], manifest: &PredictionManifest) -> Result<(Vec<u8>, String), WriteError> {
        let bytes = write_layers(&[(NAME, layers)])?;
        let [ages_s, horizons_s] = [AGES_S.to_vec(), HORIZONS_S.to_vec()];
        let (format, widths, sha256) = (PREDICTION_FORMAT, PREDICTION_WIDTHS.to_vec(), sha256_hex(&bytes));
        let manifest = PredictionManifest { format, sha256, ages_s, horizons_s, widths, ..manifest.clone() };
        Ok((bytes, toml::to_string(&manifest)?))
    }

    /// Predicts the turns for each history. `None` if they are not finite.
    pub fn turns<const N: usize>(&self, histories: &[History; N]) -> [Option<Turns>; N] {
        let inputs = histories.each_ref().map(prediction_inputs);
        let outputs = self.network.forward::<PREDICTION_INPUTS, PREDICTION_OUTPUTS, N>(&inputs);
        outputs.map(|turns| {
            let part = |horizon: usize, limb: usize| {
                Vector3::from_fn(|axis, _| f64::from(turns[6 * horizon + 3 * limb + axis]))
            };
            let finite = turns.iter().all(|turn| turn.is_finite());
            finite.then(|| std::array::from_fn(|horizon| [part(horizon, 0), part(horizon, 1)]))
        })
    }
}

/// Returns the turns `ahead_s` after the newest skeleton: linear between the horizons, zero at 0, those of the
/// last horizon beyond it.
pub fn turns_at(turns: &Turns, ahead_s: f64) -> [Vector3<f64>; 2] {
    let next = HORIZONS_S.iter().position(|horizon| *horizon > ahead_s);
    let Some(next) = next else { return turns[HORIZONS_S.len() - 1] };
    let (from_s, from) = match next.checked_sub(1) {
        Some(before) => (HORIZONS_S[before], turns[before]),
        None => (0.0, [Vector3::zeros(); 2]),
    };
    let share = ((ahead_s - from_s) / (HORIZONS_S[next] - from_s)).max(0.0);
    std::array::from_fn(|limb| from[limb] + (turns[next][limb] - from[limb]) * share)
}
