//! Writes the trained networks as the weights file that retargeting reads.

use crate::checkpoint::write_at_once;
use crate::error::TrainError;
use crate::networks::Networks;
use retarget::{Dense, Layers, Manifest};
use std::path::{Path, PathBuf};

/// Extracts the layers of all three networks from the parameter vector.
#[must_use]
pub fn layers(networks: &Networks, parameters: &[f32]) -> Layers {
    let [human, robot, decoder] = networks.named().map(|(_, mlp)| {
        mlp.layers
            .iter()
            .map(|layer| Dense {
                inputs: layer.input,
                outputs: layer.output,
                weight: parameters[layer.weight.clone()].to_vec(),
                bias: parameters[layer.bias.clone()].to_vec(),
            })
            .collect()
    });
    Layers { human, robot, decoder }
}

/// Returns `base` with an extension appended. The name itself may contain a dot.
#[must_use]
pub fn with_suffix(base: &Path, suffix: &str) -> PathBuf {
    let mut name = base.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Writes `<base>.safetensors` and `<base>.toml`. The manifest comes last, because it holds the hash of the
/// other file.
///
/// # Errors
/// Returns an error if one of them cannot be written.
pub fn write_both(base: &Path, tensors: &[u8], manifest: &str) -> Result<(), TrainError> {
    write_at_once(&with_suffix(base, ".safetensors"), tensors)?;
    write_at_once(&with_suffix(base, ".toml"), manifest.as_bytes())
}

/// Writes the weights file of these layers.
///
/// # Errors
/// Returns an error if it cannot be composed or written.
pub fn write(base: &Path, layers: &Layers, manifest: &Manifest) -> Result<(), TrainError> {
    let (bytes, text) = retarget::write_weights(layers, manifest)?;
    write_both(base, &bytes, &text)
}
