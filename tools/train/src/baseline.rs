//! Networks for comparison, which the product does not run. Each is one flat f16 tensor, and a manifest that
//! describes it.

use crate::files::{read_text, unreadable, with_suffix, write_both};
use crate::kinematics::{ARM, Arm, FEATURES, HumanInput, Limbs};
use crate::networks::{LATENT, Networks, Pose, REACH, Size};
use crate::pairs::random_postures;
use crate::session::{Session, encode_robot};
use half::f16;
use perceptron::{Perceptron, WIDTH_MAX};
use retarget::{ArmIdentity, ArmQ, Layers, sha256_hex, xyzw_from_rotation};
use rt::{Exit, Failure};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::fmt::Display;
use std::path::Path;

const FORMAT: u32 = 1;
const TENSOR: &str = "parameters";
/// The baseline that looks postures up.
const S3LE: &str = "s3le";
/// Number of postures on which S3LE is trained and in which it looks up, and number of pairs (Choi et al.
/// 2021).
pub const S3LE_POSTURES: usize = 200_000;
/// Seed of these postures. Training and lookup must use the same postures.
pub const S3LE_SEED: u64 = 1;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineManifest {
    pub format: u32,
    pub name: String,
    /// SHA-256 of the safetensors file, lower-case hex.
    pub sha256: String,
    /// Hash of the arm, as in the product's weights.
    pub robot_hash: String,
    pub size: Size,
    pub pose: Pose,
    /// True if the posture is the nearest known one in the latent space (S3LE). Otherwise it is the decoder's output.
    pub lookup: bool,
    pub seed: u64,
    pub steps: u64,
    pub trained_on: String,
}

#[derive(Clone, Debug)]
pub struct Baseline {
    pub manifest: BaselineManifest,
    human: Perceptron,
    decoder: Perceptron,
    arm: Arm,
    known: Option<Known>,
}

#[derive(Clone, Debug)]
struct Known {
    postures: Vec<[[f32; ARM]; 2]>,
    latents: Vec<[f32; LATENT]>,
}

impl Baseline {
    /// Writes `<base>.safetensors` and `<base>.toml`. The manifest comes last, because it holds the hash of the
    /// other file.
    pub fn write(
        base: &Path,
        name: String,
        session: &Session,
        identity: &ArmIdentity,
        trained_on: String,
    ) -> Result<(), Failure> {
        let parameters = &session.adam.average;
        let data: Vec<u8> = parameters.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect();
        let view = TensorView::new(Dtype::F16, vec![parameters.len()], &data).map_err(|error| damaged(base, error))?;
        let bytes = safetensors::serialize([(TENSOR, view)], None).map_err(|error| damaged(base, error))?;
        let manifest = BaselineManifest {
            format: FORMAT,
            lookup: name == S3LE,
            name,
            sha256: sha256_hex(&bytes),
            robot_hash: format!("{:016x}", identity.robot_hash),
            size: session.options.size,
            pose: session.options.pose,
            seed: session.options.seed,
            steps: session.step,
            trained_on,
        };
        let text = toml::to_string(&manifest).map_err(|error| damaged(base, error))?;
        write_both(base, &bytes, &text)
    }

    /// Reads `<base>.safetensors` and `<base>.toml`. `None` if they are for another arm than `identity`.
    pub fn read(base: &Path, identity: &ArmIdentity) -> Result<Option<Self>, Failure> {
        let text = read_text(&with_suffix(base, ".toml"))?;
        let manifest: BaselineManifest = toml::from_str(&text).map_err(|error| damaged(base, error))?;
        if manifest.format != FORMAT {
            return Err(damaged(base, format!("format is {}, expected {FORMAT}", manifest.format)));
        }
        if manifest.robot_hash != format!("{:016x}", identity.robot_hash) {
            return Ok(None);
        }
        let fits = (1..=2).contains(&manifest.pose.arms)
            && (1..=retarget::HIDDEN_MAX).contains(&manifest.size.hidden_layers)
            && (1..=WIDTH_MAX).contains(&manifest.size.hidden_width);
        if !fits {
            return Err(damaged(base, format!("has networks of {:?} for {:?}", manifest.size, manifest.pose)));
        }
        let networks = Networks::new(manifest.size, manifest.pose);
        let path = with_suffix(base, ".safetensors");
        let bytes = std::fs::read(&path).map_err(|error| unreadable(&path, &error))?;
        let parameters = read_parameters(base, &bytes, &manifest, networks.parameters())?;
        let arm = Arm::from(&identity.arm);
        let known = manifest.lookup.then(|| {
            let postures = random_postures(S3LE_POSTURES, S3LE_SEED);
            let latents = encode_robot(&networks, &parameters, postures.as_flattened().as_flattened());
            Known { postures, latents }
        });
        let Layers { human, decoder, .. } = networks.layers(&parameters);
        let [human, decoder] = [human, decoder].map(|layers| Perceptron::new(&layers));
        Ok(Some(Self { manifest, human, decoder, arm, known }))
    }

    /// Returns joint positions, rad, within the limits: left arm and mirrored right arm of a frame.
    pub fn retarget(&self, frame: &[retarget::Limbs; 2]) -> [ArmQ; 2] {
        let pose = self.manifest.pose;
        let mut features = [0.0; 2 * FEATURES];
        for (limbs, features) in frame.iter().zip(features.chunks_exact_mut(pose.input.width())) {
            pose.input.write(&single(limbs), features);
        }
        let latents = match (pose.arms, pose.input) {
            (1, HumanInput::Axes) => self.encode::<FEATURES, 2>(&features),
            (1, HumanInput::LocalQuaternions) => self.encode::<8, 2>(&features),
            (_, HumanInput::Axes) => self.encode::<{ 2 * FEATURES }, 1>(&features),
            (_, HumanInput::LocalQuaternions) => self.encode::<16, 1>(&features),
        };
        let normalised: [[f32; ARM]; 2] = match &self.known {
            Some(known) => known.nearest(&latents[0]),
            None if pose.arms == 1 => self.decoder.forward(&latents).map(normalised),
            None => {
                let [both] = self.decoder.forward::<LATENT, { 2 * ARM }, 1>(&[latents[0]]);
                let (arms, _) = both.as_chunks::<ARM>();
                std::array::from_fn(|arm| normalised(arms[arm]))
            }
        };
        normalised.map(|n| self.arm.denormalised(&n).map(f64::from))
    }

    /// Returns the latents of both arms, or the one of the whole pose and a zero.
    fn encode<const I: usize, const N: usize>(&self, features: &[f32]) -> [[f32; LATENT]; 2] {
        let mut rows = [[0.0; I]; N];
        rows.as_flattened_mut().copy_from_slice(&features[..I * N]);
        let mut latents = [[0.0; LATENT]; 2];
        latents[..N].copy_from_slice(&self.human.forward::<I, LATENT, N>(&rows));
        latents
    }
}

/// Maps the decoder's output to joint positions normalised to -1..1.
fn normalised(y: [f32; ARM]) -> [f32; ARM] {
    y.map(|y| (REACH * y.tanh()).clamp(-1.0, 1.0))
}

impl Known {
    fn nearest(&self, z: &[f32; LATENT]) -> [[f32; ARM]; 2] {
        let distance = |other: &[f32; LATENT]| -> f32 { z.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum() };
        let distances = self.latents.iter().map(distance).enumerate();
        self.postures[distances.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(index, _)| index)]
    }
}

/// Converts limb rotations to f32, in the order x, y, z, w.
pub fn single(limbs: &retarget::Limbs) -> Limbs {
    [limbs.upper, limbs.fore].map(|limb| xyzw_from_rotation(&limb).map(|v| v as f32))
}

fn damaged(base: &Path, reason: impl Display) -> Failure {
    Failure::new(Exit::DataErr, format!("{}: {reason}", base.display()))
}

fn read_parameters(base: &Path, bytes: &[u8], manifest: &BaselineManifest, count: usize) -> Result<Vec<f32>, Failure> {
    let actual = sha256_hex(bytes);
    if actual != manifest.sha256 {
        return Err(damaged(base, format!("sha256 of the tensors is {actual}, the manifest says {}", manifest.sha256)));
    }
    let tensors = SafeTensors::deserialize(bytes).map_err(|error| damaged(base, error))?;
    let view = tensors.tensor(TENSOR).map_err(|error| damaged(base, error))?;
    if view.dtype() != Dtype::F16 || view.shape() != [count] {
        return Err(damaged(
            base,
            format!("{TENSOR} is {:?} {:?}, expected F16 [{count}]", view.dtype(), view.shape()),
        ));
    }
    Ok(view.data().as_chunks::<2>().0.iter().map(|word| f16::from_le_bytes(*word).to_f32()).collect())
}
