//! Checkpoints: the whole state of a run in one safetensors file. The file appears completely or not at all.
//!
//! Parameters, average and both moments are tensors. Options and step are JSON in the header. The generators
//! need no state, because they are created from seed and step. So a resumed run equals an uninterrupted one bit
//! for bit.

use crate::error::TrainError;
use crate::files::write_at_once;
use crate::session::{Options, Session};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// Layout version of the header.
const FORMAT: u32 = 1;
const KEY: &str = "teleopd.train";

/// Properties in which a run must agree with the checkpoint that it resumes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Hash of the arm's kinematics and limits, as in the weights' manifest.
    pub robot_hash: String,
    /// SHA-256 of the recorded poses.
    pub poses: String,
}

#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    step: u64,
    options: Options,
    origin: Origin,
}

/// Saves the run.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn save(path: &Path, session: &Session, origin: &Origin) -> Result<(), TrainError> {
    let damaged = |reason: String| TrainError::Checkpoint { path: path.to_path_buf(), reason };
    let header = Header { format: FORMAT, step: session.step, options: session.options, origin: origin.clone() };
    let header = serde_json::to_string(&header).map_err(|error| damaged(error.to_string()))?;
    let adam = &session.adam;
    let named = [
        ("parameters", &adam.parameters),
        ("average", &adam.average),
        ("first", &adam.first),
        ("second", &adam.second),
    ];
    let views = named
        .iter()
        .map(|(name, values)| {
            Ok((*name, TensorView::new(Dtype::F32, vec![values.len()], bytemuck::cast_slice(values))?))
        })
        .collect::<Result<Vec<_>, safetensors::SafeTensorError>>();
    let bytes = views
        .and_then(|views| safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), header)]))))
        .map_err(|error| damaged(error.to_string()))?;
    write_at_once(path, &bytes)
}

/// Continues a saved run for the same arm and poses.
///
/// # Errors
/// Returns an error if the file cannot be read, is damaged, or belongs to another arm or other poses.
pub fn resume(path: &Path, arm: crate::kinematics::Arm, origin: &Origin) -> Result<Session, TrainError> {
    let damaged = |reason: String| TrainError::Checkpoint { path: path.to_path_buf(), reason };
    let bytes =
        std::fs::read(path).map_err(|source| TrainError::File { path: path.to_path_buf(), action: "read", source })?;
    let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(|error| damaged(error.to_string()))?;
    let text = metadata.metadata().as_ref().and_then(|map| map.get(KEY));
    let text = text.ok_or_else(|| damaged("is not a checkpoint of this trainer".into()))?;
    let header: Header = serde_json::from_str(text).map_err(|error| damaged(error.to_string()))?;
    if header.format != FORMAT {
        return Err(damaged(format!("format is {}, expected {FORMAT}", header.format)));
    }
    if header.origin.robot_hash != origin.robot_hash {
        let (theirs, ours) = (&header.origin.robot_hash, &origin.robot_hash);
        return Err(damaged(format!("is for an arm of hash {theirs}, the robot file's is {ours}")));
    }
    if header.origin.poses != origin.poses {
        return Err(damaged("was trained on other recorded poses; give it the same --human and --calibration".into()));
    }
    let mut session = Session::new(header.options, arm);
    let tensors = SafeTensors::deserialize(&bytes).map_err(|error| damaged(error.to_string()))?;
    let adam = &mut session.adam;
    for (name, values) in [
        ("parameters", &mut adam.parameters),
        ("average", &mut adam.average),
        ("first", &mut adam.first),
        ("second", &mut adam.second),
    ] {
        let view = tensors.tensor(name).map_err(|error| damaged(error.to_string()))?;
        let (words, rest) = view.data().as_chunks::<4>();
        if view.dtype() != Dtype::F32 || words.len() != values.len() || !rest.is_empty() {
            return Err(damaged(format!("{name} has {} values, expected {}", words.len(), values.len())));
        }
        values.iter_mut().zip(words).for_each(|(value, word)| *value = f32::from_le_bytes(*word));
    }
    session.step = header.step;
    Ok(session)
}
