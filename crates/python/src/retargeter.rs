//! Postures of a motion, and the shared latent space.

use crate::arrays::{array, computed, push_joints, refused};
use crate::motions::{Motion, calibration};
use crate::robots::Robot;
use numpy::{PyArrayDyn, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use poses::postures::Postures;
use poses::retargeted::{Rate, Retargeted};
use pyo3::prelude::*;
use retarget::{ARMS, LATENT, Latent, Limbs, interpolate_latent};
use std::sync::atomic::Ordering;

/// Turns motions into postures of one robot, as `replay batch` does.
#[pyclass(frozen, module = "teleopd._native")]
pub(crate) struct Retargeter {
    postures: Postures,
    joints: usize,
}

#[pymethods]
impl Retargeter {
    #[new]
    fn new(robot: &Robot, refinement_steps: u32) -> PyResult<Self> {
        let most = retarget::REFINEMENT_STEPS_MAX;
        if refinement_steps > most {
            return Err(refused(format!("refinement_steps = {refinement_steps}: must be within [0, {most}]")));
        }
        let lacks = || refused(format!("the robot {} has no weights; `train` makes them", robot.model().name));
        let weights = robot.loaded.weights.clone().ok_or_else(lacks)?;
        let postures = Postures::new(robot.model(), Some(weights), refinement_steps);
        Ok(Self { postures, joints: robot.model().count })
    }

    /// Returns the postures of a motion, (N, joints), rad or m.
    fn retarget<'py>(
        &self,
        py: Python<'py>,
        motion: &Motion,
        hinges: &str,
        out_hz: Option<f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (motion, calibration, joints) = (&motion.motion, calibration(hinges)?, self.joints);
        let rate = out_hz.map_or(Rate::Source, Rate::Hz);
        let (rows, q) = computed(py, |interrupted| {
            let postures = Retargeted::new(&self.postures, motion, calibration, rate);
            let rows = postures.rows();
            let mut values = Vec::with_capacity(rows * joints);
            for row in postures {
                if interrupted.load(Ordering::Relaxed) {
                    break;
                }
                push_joints(&mut values, &row?.1, joints);
            }
            Ok((rows, values))
        })?
        .map_err(|(frame, cause): (usize, &str)| refused(format!("frame {frame}: {cause}")))?;
        array(py, q, &[rows, joints])
    }

    /// Returns the points of the latent space, (N, 2, 8).
    fn encode<'py>(&self, py: Python<'py>, motion: &Motion, hinges: &str) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let (motion, calibration) = (&motion.motion, calibration(hinges)?);
        let encoded = computed(py, |_| {
            let limbs = motion::limbs(motion, &motion::calibrate(motion, calibration));
            let mut values = Vec::with_capacity(limbs.len() * ARMS * LATENT);
            for (frame, limbs) in limbs.iter().enumerate() {
                let arms = Limbs::from_message(limbs).ok_or(frame)?;
                values.extend(self.postures.encode(&arms).iter().flat_map(|sample| sample.latent));
            }
            Ok(values)
        })?;
        let values = encoded.map_err(|frame: usize| refused(format!("frame {frame}: a limb is not a rotation")))?;
        array(py, values, &[motion.frames.len(), ARMS, LATENT])
    }

    /// Returns the decoded postures of latent points (N, 2, 8) without refinement, (N, joints), rad or m.
    fn decode<'py>(
        &self,
        py: Python<'py>,
        latents: PyReadonlyArray3<'_, f32>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let rows = latents.shape()[0];
        let points: Vec<Latent> = latents.as_slice()?.as_chunks::<LATENT>().0.to_vec();
        let decoded = computed(py, |_| {
            let mut values = Vec::with_capacity(rows * self.joints);
            for (i, [left, right]) in points.as_chunks::<ARMS>().0.iter().enumerate() {
                let q = self.postures.decode(&[*left, *right]).ok_or(i)?;
                push_joints(&mut values, &self.postures.joints(&q), self.joints);
            }
            Ok(values)
        })?;
        let values = decoded.map_err(|i: usize| refused(format!("latents[{i}]: the posture is not finite")))?;
        array(py, values, &[rows, self.joints])
    }
}

/// Returns the points at `share` on the straight lines from `a` to `b`, (M, 8).
#[pyfunction]
pub(crate) fn interpolate<'py>(
    py: Python<'py>,
    a: PyReadonlyArray2<'_, f32>,
    b: PyReadonlyArray2<'_, f32>,
    share: f64,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let (from, to) = (a.as_slice()?.as_chunks::<LATENT>().0, b.as_slice()?.as_chunks::<LATENT>().0);
    let points = from.iter().zip(to).flat_map(|(a, b)| interpolate_latent(a, b, share));
    array(py, points.collect(), &[a.shape()[0], LATENT])
}
