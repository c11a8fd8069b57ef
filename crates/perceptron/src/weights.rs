//! Weights in a safetensors file, which a manifest beside it describes. Networks are written in 16 bits (binary16 of IEEE 754),
//! and read in 16 or 32.

use crate::network::Dense;
use half::f16;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use sha2::{Digest, Sha256};

/// Longest safetensors header, bytes. Ours take 4 kB. The bound keeps a header from making the loader allocate
/// without limit.
pub const HEADER_MAX_BYTES: u64 = 1 << 20;

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
    #[error("tensor {name} is {dtype} {shape:?}, expected F16 or F32 {expected:?}")]
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

/// Returns the error of a key of the manifest.
pub fn key(key: &'static str, value: &impl std::fmt::Debug, expected: String) -> WeightsError {
    WeightsError::Key { key, value: format!("{value:?}"), expected }
}

/// Refuses a value of the manifest that is not the expected one.
///
/// # Errors
/// Returns the error of the key.
pub fn must<T: PartialEq + std::fmt::Debug>(name: &'static str, value: T, expected: T) -> Result<(), WeightsError> {
    if value == expected { Ok(()) } else { Err(key(name, &value, format!("{expected:?}"))) }
}

/// Refuses tensors whose hash is not the manifest's.
///
/// # Errors
/// Returns both hashes.
pub fn must_match(bytes: &[u8], expected: &str) -> Result<(), WeightsError> {
    let actual = sha256_hex(bytes);
    if actual == expected { Ok(()) } else { Err(WeightsError::Sha256 { actual, expected: expected.to_owned() }) }
}

/// Reads the header of a safetensors file.
///
/// # Errors
/// Returns an error if it is too long or malformed.
pub fn open(bytes: &[u8]) -> Result<SafeTensors<'_>, WeightsError> {
    let header = bytes.first_chunk::<8>().map_or(0, |length| u64::from_le_bytes(*length));
    if header > HEADER_MAX_BYTES {
        return Err(WeightsError::Header { bytes: header });
    }
    Ok(SafeTensors::deserialize(bytes)?)
}

/// Reads the networks of a safetensors file that holds nothing else. Each has a name, and widths from input to output.
/// Its layer i is `name.i.weight` and `name.i.bias`.
///
/// # Errors
/// Returns an error that names the tensor.
pub fn read_networks<const N: usize>(
    bytes: &[u8],
    networks: [(&str, &[usize]); N],
) -> Result<[Vec<Dense>; N], WeightsError> {
    let tensors = open(bytes)?;
    let mut unknown = tensors.names();
    let mut read = [const { Vec::new() }; N];
    for ((network, widths), layers) in networks.iter().zip(&mut read) {
        for (i, width) in widths.windows(2).enumerate() {
            let mut tensor = |part: &str, shape: &[usize]| {
                let name = format!("{network}.{i}.{part}");
                unknown.retain(|found| *found != name);
                read_tensor(&tensors, name, shape)
            };
            let (inputs, outputs) = (width[0], width[1]);
            let (weight, bias) = (tensor("weight", &[outputs, inputs])?, tensor("bias", &[outputs])?);
            layers.push(Dense { inputs, outputs, weight, bias });
        }
    }
    match unknown.first() {
        Some(name) => Err(WeightsError::Unknown { name: (*name).to_owned() }),
        None => Ok(read),
    }
}

/// Reads one tensor of this shape. Every number must be finite.
///
/// # Errors
/// Returns an error that names the tensor.
pub fn read_tensor(tensors: &SafeTensors<'_>, name: String, expected: &[usize]) -> Result<Vec<f32>, WeightsError> {
    let Ok(view) = tensors.tensor(&name) else {
        return Err(WeightsError::Missing { name });
    };
    let values: Vec<f32> = match view.dtype() {
        Dtype::F16 if view.shape() == expected => {
            view.data().as_chunks().0.iter().map(|word| f16::from_le_bytes(*word).to_f32()).collect()
        }
        Dtype::F32 if view.shape() == expected => {
            view.data().as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect()
        }
        dtype => {
            let (dtype, shape) = (format!("{dtype:?}"), view.shape().to_vec());
            return Err(WeightsError::Shape { name, dtype, shape, expected: expected.to_vec() });
        }
    };
    match values.iter().position(|value| !value.is_finite()) {
        Some(index) => Err(WeightsError::NotFinite { name, index, value: values[index] }),
        None => Ok(values),
    }
}

/// Rounds a weight to the nearest one that a file of [`write_layers`] holds.
pub fn rounded(weight: f32) -> f32 {
    f16::from_f32(weight).to_f32()
}

/// Writes named networks as safetensors, with weights of 16 bits: layer i of a network is `name.i.weight` and `name.i.bias`.
///
/// # Errors
/// Returns an error if the numbers of a layer do not fill its shape.
pub fn write_layers(networks: &[(&str, &[Dense])]) -> Result<Vec<u8>, WriteError> {
    let mut named = Vec::new();
    for (name, network) in networks {
        for (i, dense) in network.iter().enumerate() {
            let short = |value: &f32| f16::from_f32(*value).to_le_bytes();
            let bytes = |values: &[f32]| values.iter().flat_map(short).collect::<Vec<u8>>();
            named.push((format!("{name}.{i}.weight"), vec![dense.outputs, dense.inputs], bytes(&dense.weight)));
            named.push((format!("{name}.{i}.bias"), vec![dense.outputs], bytes(&dense.bias)));
        }
    }
    let views = named
        .iter()
        .map(|(name, shape, data)| Ok((name, TensorView::new(Dtype::F16, shape.clone(), data)?)))
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>()?;
    Ok(safetensors::serialize(views, None)?)
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
