//! Motions of a person: from files, and from arrays.

use crate::arrays::{array, computed, in_python, refused, unread};
use messages::SMPL_JOINTS;
use motion::{CalibrationMode, Frame, LoadOptions, MotionError};
use numpy::{PyArrayDyn, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// A motion of one person.
#[pyclass(frozen, module = "teleopd._native")]
pub(crate) struct Motion {
    pub(crate) motion: Arc<motion::Motion>,
}

/// Returns the source of the elbow hinges with this name.
pub(crate) fn calibration(name: &str) -> PyResult<CalibrationMode> {
    CalibrationMode::among(name, &CalibrationMode::ALL)
        .map_err(|cause| refused(format!("calibration: {name:?} {cause}")))
}

#[pymethods]
impl Motion {
    /// Makes a motion of positions (N, 22, 3), m, and rotations (N, 22, 4), x y z w. The caller has checked their values.
    #[new]
    fn new(
        name: String,
        positions: PyReadonlyArray3<'_, f32>,
        rotations: Option<PyReadonlyArray3<'_, f32>>,
        rate_hz: f64,
    ) -> PyResult<Self> {
        let [low, high] = motion::FRAME_RATE_HZ;
        if !(low..=high).contains(&rate_hz) {
            return Err(refused(format!("rate_hz = {rate_hz}: must be within [{low}, {high}] Hz")));
        }
        let mut frames = vec![Frame::ZERO; positions.shape()[0]];
        let (places, _) = positions.as_slice()?.as_chunks::<3>();
        for (i, place) in places.iter().enumerate() {
            frames[i / SMPL_JOINTS].positions[i % SMPL_JOINTS] = *place;
        }
        if let Some(rotations) = &rotations {
            let (turns, _) = rotations.as_slice()?.as_chunks::<4>();
            for (i, turn) in turns.iter().enumerate() {
                frames[i / SMPL_JOINTS].rotations[i % SMPL_JOINTS] = *turn;
            }
        }
        let mut motion = motion::Motion::generated(&name, rate_hz, frames);
        motion.has_rotations = rotations.is_some();
        Ok(Self { motion: Arc::new(motion) })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.motion.name
    }

    #[getter]
    fn rate_hz(&self) -> f64 {
        self.motion.frame_rate_hz
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.motion.guesses.warnings.iter().chain(&self.motion.guesses.lost).cloned().collect()
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let values = self.motion.frames.iter().flat_map(|frame| frame.positions).flatten().collect();
        array(py, values, &[self.motion.frames.len(), SMPL_JOINTS, 3])
    }

    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArrayDyn<f32>>>> {
        let values = || self.motion.frames.iter().flat_map(|frame| frame.rotations).flatten().collect();
        let shape = [self.motion.frames.len(), SMPL_JOINTS, 4];
        self.motion.has_rotations.then(|| array(py, values(), &shape)).transpose()
    }

    /// Closure of the left and of the right hand, (N, 2). NaN where the source has none.
    #[getter]
    fn closure<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let values = self.motion.frames.iter().flat_map(|frame| frame.closure).map(|hand| hand.unwrap_or(f32::NAN));
        array(py, values.collect(), &[self.motion.frames.len(), 2])
    }
}

/// Reads a motion file, a recording's motion, or a built-in motion.
#[pyfunction]
pub(crate) fn read_motion(
    py: Python<'_>,
    path: PathBuf,
    frame_rate_hz: Option<f64>,
    up: Option<&str>,
    mirror: bool,
    files: [Option<PathBuf>; 3],
) -> PyResult<Motion> {
    let up = up.map(|axis| axis.parse().map_err(|cause| refused(format!("up = {axis:?}: {cause}")))).transpose()?;
    let [mean, std, map] = files;
    let options = LoadOptions { mirror, frame_rate_hz, up, mean, std, map };
    let loaded = computed(py, |_| motion::load_with(&path, &options))?;
    let mut motion = loaded.map_err(|error| match error {
        MotionError::Io { file, source } => unread(rt::unreadable(file.as_ref(), &source)),
        error => refused(in_python(&error.to_string())),
    })?;
    motion.guesses.warnings.iter_mut().for_each(|warning| *warning = in_python(warning));
    Ok(Motion { motion: Arc::new(motion) })
}
