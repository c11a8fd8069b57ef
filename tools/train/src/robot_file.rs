//! Reads the arm to train for from a robot file.

use crate::error::TrainError;
use crate::kinematics::Arm;
use retarget::ArmModel;
use robot::Model;
use std::path::Path;

/// Reads a robot file and the URDF that it names.
///
/// # Errors
/// Returns an error if one of them is missing or invalid.
pub fn read_model(path: &Path) -> Result<Model, TrainError> {
    let name = path.display().to_string();
    let text = read_text(path)?;
    let urdf = path.parent().unwrap_or(Path::new(".")).join(robot::urdf_file(&name, &text)?);
    Ok(Model::from_text(&name, &text, &urdf.display().to_string(), &read_text(&urdf)?)?)
}

/// Returns the text of a file.
pub(crate) fn read_text(path: &Path) -> Result<String, TrainError> {
    std::fs::read_to_string(path).map_err(|source| TrainError::File {
        path: path.to_path_buf(),
        action: "read",
        source,
    })
}

impl From<&ArmModel> for Arm {
    fn from(arm: &ArmModel) -> Self {
        let single = |values: [f64; crate::kinematics::ARM]| values.map(|v| v as f32);
        Self {
            axes: arm.axes.map(|axis| [axis.x as f32, axis.y as f32, axis.z as f32]),
            reference: single(arm.reference),
            mid: single(arm.mid()),
            half: single(arm.half()),
        }
    }
}
