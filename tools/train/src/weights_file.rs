//! The trained networks as the weights file that the retargeting reads.

use crate::checkpoint::write_at_once;
use crate::error::TrainError;
use crate::networks::Networks;
use retarget::{Dense, Layers, Manifest};
use std::path::{Path, PathBuf};

/// The layers of all three networks out of the parameter vector.
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

/// `base` with an extension appended: a name may have a dot of its own.
#[must_use]
pub fn with_suffix(base: &Path, suffix: &str) -> PathBuf {
    let mut name = base.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Writes `<base>.safetensors` and `<base>.toml`; the manifest last, because it holds the hash of the other.
///
/// # Errors
/// If one of them cannot be written.
pub fn write(base: &Path, layers: &Layers, manifest: &Manifest) -> Result<(), TrainError> {
    let (bytes, text) = retarget::write_weights(layers, manifest)?;
    write_at_once(&with_suffix(base, ".safetensors"), &bytes)?;
    write_at_once(&with_suffix(base, ".toml"), text.as_bytes())
}
