//! The weights file: a safetensors file and a TOML manifest that ties it to one robot. It turns bytes into
//! networks.

use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::arm::{ARM_Q, ArmModel, ArmQ, FEATURES};
use crate::network::{Dense, HIDDEN_MAX, LATENT, Layers, Network, WIDTH_MAX, golden};

/// The only format of the manifest so far.
pub const FORMAT: u32 = 1;
/// Longest safetensors header, bytes. Ours take 4 kB. The bound keeps a header from making the loader allocate
/// without limit.
pub const HEADER_MAX_BYTES: u64 = 1 << 20;
/// Largest difference between the limits that a network was trained for and the robot's, rad: rounding of decimal text.
const LIMIT_TOLERANCE_RAD: f64 = 1e-9;

/// Reason for which a weights file was refused. The caller adds the file's name.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the texts name the fields")]
pub enum WeightsError {
    /// The manifest is not TOML of the expected keys.
    #[error("manifest: {0}")]
    Manifest(#[from] toml::de::Error),
    /// A key of the manifest has a value that cannot be used.
    #[error("manifest: {key} is {value}, expected {expected}")]
    Key { key: &'static str, value: String, expected: String },
    /// The tensors are not the ones that the manifest was written for.
    #[error("sha256 of the tensors is {actual}, the manifest says {expected}")]
    Sha256 { actual: String, expected: String },
    /// The safetensors header is too long.
    #[error("the safetensors header has {bytes} bytes, at most {HEADER_MAX_BYTES} are allowed")]
    Header { bytes: u64 },
    /// The tensors are truncated, have bytes left over, or are malformed in another way.
    #[error("tensors: {0}")]
    Tensors(#[from] safetensors::SafeTensorError),
    /// A tensor that the manifest promises is missing.
    #[error("tensor {name} is missing")]
    Missing { name: String },
    /// A tensor that no layer uses.
    #[error("tensor {name} belongs to no layer")]
    Unknown { name: String },
    /// A tensor has another type or shape than the manifest promises.
    #[error("tensor {name} is {dtype} {shape:?}, expected F32 {expected:?}")]
    Shape { name: String, dtype: String, shape: Vec<usize>, expected: Vec<usize> },
    /// The networks do not compute the expected values on this machine.
    #[error(
        "the networks' error on fixed inputs is {error}, at most 1e-3 is allowed. Either a weight is out of range, or \
         this processor is faulty"
    )]
    Golden {
        /// The largest error: of a latent, relative to its size if that is above 1, or of a joint, rad.
        error: f64,
    },
    /// A weight is NaN or infinite.
    #[error("tensor {name} has {value} at index {index}; every weight must be finite")]
    NotFinite { name: String, index: usize, value: f32 },
}

/// Identity of an arm that a weights file must match.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmIdentity {
    /// Name of the robot.
    pub robot: String,
    /// Hash of the arm's data in the robot's files.
    pub robot_hash: u64,
    /// Names of joints 1 to 5 of the left arm.
    pub joints: [String; ARM_Q],
    /// The arm.
    pub arm: ArmModel,
}

/// The manifest beside a safetensors file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// `FORMAT`.
    pub format: u32,
    /// SHA-256 of the safetensors file, lower-case hex.
    pub sha256: String,
    /// Name of the robot.
    pub robot: String,
    /// Hash as in [`ArmIdentity`], 16 lower-case hex digits. TOML has no unsigned 64-bit integers.
    pub robot_hash: String,
    /// Names of joints 1 to 5 of the left arm.
    pub joints: [String; ARM_Q],
    /// Middle of the joint limits, rad.
    pub mid_rad: ArmQ,
    /// Half of the range of the joint limits, rad.
    pub half_rad: ArmQ,
    /// `LATENT`.
    pub latent: usize,
    /// Hidden layers of each network.
    pub hidden_layers: usize,
    /// Neurons of each hidden layer.
    pub hidden_width: usize,
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

impl Manifest {
    /// Creates a manifest for `identity` and the shape of `layers`. Its sha256, validation and training facts are
    /// still empty.
    pub fn new(identity: &ArmIdentity, layers: &Layers) -> Self {
        Self {
            format: FORMAT,
            sha256: String::new(),
            robot: identity.robot.clone(),
            robot_hash: format!("{:016x}", identity.robot_hash),
            joints: identity.joints.clone(),
            mid_rad: identity.arm.mid(),
            half_rad: identity.arm.half(),
            latent: LATENT,
            hidden_layers: layers.human.len().saturating_sub(1),
            hidden_width: layers.human.first().map_or(0, |layer| layer.outputs),
            seed: 0,
            steps: 0,
            trained_on: String::new(),
            validation: toml::Table::new(),
        }
    }

    fn check(&self, identity: &ArmIdentity) -> Result<(), WeightsError> {
        let robot_hash = format!("{:016x}", identity.robot_hash);
        must("format", self.format, FORMAT)?;
        must("robot", &self.robot, &identity.robot)?;
        must("robot_hash", &self.robot_hash, &robot_hash)?;
        must("latent", self.latent, LATENT)?;
        if self.joints != identity.joints {
            return Err(key("joints", &self.joints, format!("{:?}", identity.joints)));
        }
        for (name, value, expected) in
            [("mid_rad", self.mid_rad, identity.arm.mid()), ("half_rad", self.half_rad, identity.arm.half())]
        {
            // Written so that a NaN is refused too.
            if !(0..ARM_Q).all(|j| (value[j] - expected[j]).abs() <= LIMIT_TOLERANCE_RAD) {
                return Err(key(name, &value, format!("{expected:?} (the robot's joint limits)")));
            }
        }
        if !(1..=HIDDEN_MAX).contains(&self.hidden_layers) {
            return Err(key("hidden_layers", &self.hidden_layers, format!("1 to {HIDDEN_MAX}")));
        }
        if !(1..=WIDTH_MAX).contains(&self.hidden_width) {
            return Err(key("hidden_width", &self.hidden_width, format!("1 to {WIDTH_MAX}")));
        }
        Ok(())
    }
}

pub(crate) fn key(key: &'static str, value: &impl std::fmt::Debug, expected: String) -> WeightsError {
    WeightsError::Key { key, value: format!("{value:?}"), expected }
}

pub(crate) fn must<T: PartialEq + std::fmt::Debug>(
    name: &'static str,
    value: T,
    expected: T,
) -> Result<(), WeightsError> {
    if value == expected { Ok(()) } else { Err(key(name, &value, format!("{expected:?}"))) }
}

/// Checked weights of one robot, ready to run.
#[derive(Clone, Debug)]
pub struct Weights {
    /// The networks.
    pub network: Network,
    /// The manifest that came with them.
    pub manifest: Manifest,
}

impl Weights {
    /// Reads the manifest and the safetensors file that it describes, for the robot `identity`. It refuses
    /// everything that differs from the manifest or from what the robot needs.
    pub fn read(manifest_text: &str, bytes: &[u8], identity: &ArmIdentity) -> Result<Self, WeightsError> {
        let manifest: Manifest = toml::from_str(manifest_text)?;
        manifest.check(identity)?;
        must_match(bytes, &manifest.sha256)?;
        let layers = read_layers(bytes, &manifest)?;
        let network = Network::new(&layers, &identity.arm);
        golden::error(&network, &layers).map_err(|error| WeightsError::Golden { error })?;
        Ok(Self { network, manifest })
    }
}

/// Refuses tensors whose hash is not the manifest's.
pub(crate) fn must_match(bytes: &[u8], expected: &str) -> Result<(), WeightsError> {
    let actual = sha256_hex(bytes);
    if actual == expected { Ok(()) } else { Err(WeightsError::Sha256 { actual, expected: expected.to_owned() }) }
}

/// Reads the header of a safetensors file.
pub(crate) fn open(bytes: &[u8]) -> Result<SafeTensors<'_>, WeightsError> {
    let header = bytes.first_chunk::<8>().map_or(0, |length| u64::from_le_bytes(*length));
    if header > HEADER_MAX_BYTES {
        return Err(WeightsError::Header { bytes: header });
    }
    Ok(SafeTensors::deserialize(bytes)?)
}

/// Reads the layers of a safetensors file, checked against the shape in `manifest`.
pub fn read_layers(bytes: &[u8], manifest: &Manifest) -> Result<Layers, WeightsError> {
    let tensors = open(bytes)?;
    let mut used = 0;
    let mut network = |name: &str, inputs: usize, outputs: usize| {
        (0..=manifest.hidden_layers)
            .map(|i| {
                let from = if i == 0 { inputs } else { manifest.hidden_width };
                let to = if i == manifest.hidden_layers { outputs } else { manifest.hidden_width };
                used += 2;
                Ok(Dense {
                    inputs: from,
                    outputs: to,
                    weight: read_tensor(&tensors, format!("{name}.{i}.weight"), &[to, from])?,
                    bias: read_tensor(&tensors, format!("{name}.{i}.bias"), &[to])?,
                })
            })
            .collect::<Result<Vec<_>, WeightsError>>()
    };
    let layers = Layers {
        human: network("human", FEATURES, LATENT)?,
        robot: network("robot", ARM_Q, LATENT)?,
        decoder: network("decoder", LATENT, ARM_Q)?,
    };
    if tensors.len() != used {
        let name = tensors.names().into_iter().find(|name| !is_ours(name, manifest.hidden_layers));
        return Err(WeightsError::Unknown { name: name.unwrap_or_default().to_owned() });
    }
    Ok(layers)
}

fn is_ours(name: &str, hidden_layers: usize) -> bool {
    let mut parts = name.split('.');
    let network = parts.next().is_some_and(|part| ["human", "robot", "decoder"].contains(&part));
    let index = parts.next().and_then(|part| part.parse::<usize>().ok()).is_some_and(|i| i <= hidden_layers);
    let kind = parts.next().is_some_and(|part| ["weight", "bias"].contains(&part));
    network && index && kind && parts.next().is_none()
}

pub(crate) fn read_tensor(
    tensors: &SafeTensors<'_>,
    name: String,
    expected: &[usize],
) -> Result<Vec<f32>, WeightsError> {
    let Ok(view) = tensors.tensor(&name) else {
        return Err(WeightsError::Missing { name });
    };
    if view.dtype() != Dtype::F32 || view.shape() != expected {
        let (dtype, shape) = (format!("{:?}", view.dtype()), view.shape().to_vec());
        return Err(WeightsError::Shape { name, dtype, shape, expected: expected.to_vec() });
    }
    let (words, _) = view.data().as_chunks::<4>();
    let values: Vec<f32> = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(WeightsError::NotFinite { name, index, value: values[index] }),
        None => Ok(values),
    }
}

/// Writes the two files of a weights folder: safetensors bytes and manifest text with its `sha256` filled in.
pub fn write_weights(layers: &Layers, manifest: &Manifest) -> Result<(Vec<u8>, String), WriteError> {
    let mut named = Vec::new();
    for (name, network) in [("human", &layers.human), ("robot", &layers.robot), ("decoder", &layers.decoder)] {
        for (i, dense) in network.iter().enumerate() {
            let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
            named.push((format!("{name}.{i}.weight"), vec![dense.outputs, dense.inputs], bytes(&dense.weight)));
            named.push((format!("{name}.{i}.bias"), vec![dense.outputs], bytes(&dense.bias)));
        }
    }
    let views = named
        .iter()
        .map(|(name, shape, data)| Ok((name, TensorView::new(Dtype::F32, shape.clone(), data)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    let bytes = safetensors::serialize(views, None)?;
    let manifest = Manifest { sha256: sha256_hex(&bytes), ..manifest.clone() };
    Ok((bytes, toml::to_string(&manifest)?))
}

/// Reason for which weights could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A layer's numbers do not fill its shape.
    #[error("tensors: {0}")]
    Tensors(#[from] safetensors::SafeTensorError),
    /// The manifest holds a value that TOML cannot.
    #[error("manifest: {0}")]
    Manifest(#[from] toml::ser::Error),
}

/// SHA-256, lower-case hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
