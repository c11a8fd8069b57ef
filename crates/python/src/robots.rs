//! A robot with its settings: names, limits, forward kinematics, clearance.

use crate::arrays::{array, computed, refused, row};
use config::{Loaded, Overrides, RobotChoice};
use numpy::{PyArrayDyn, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use robot::{Frames, JointLimits, Model};
use std::path::PathBuf;
use std::sync::Arc;

/// One limit of a joint.
type Limit = fn(&JointLimits) -> f64;

/// A robot, its settings and its weights.
#[pyclass(frozen, module = "teleopd._native")]
pub(crate) struct Robot {
    pub(crate) loaded: Arc<Loaded>,
}

impl Robot {
    pub(crate) fn model(&self) -> &Model {
        &self.loaded.model
    }

    /// Returns the rows of `q`, and their number.
    fn rows(&self, q: &PyReadonlyArray2<'_, f64>) -> PyResult<(usize, Vec<f64>)> {
        let (rows, count) = (q.shape()[0], self.model().count);
        if q.shape()[1] != count {
            return Err(refused(format!("q: {} joints, {count} expected, rad or m", q.shape()[1])));
        }
        Ok((rows, q.as_slice()?.to_vec()))
    }
}

#[pymethods]
impl Robot {
    #[new]
    fn new(py: Python<'_>, choice: &str, settings: PathBuf) -> PyResult<Self> {
        let choice = RobotChoice::from(choice);
        let loaded = computed(py, |_| config::load(&settings, Overrides::robot(Some(&choice))))?;
        Ok(Self { loaded: Arc::new(loaded.map_err(refused)?) })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.model().name
    }

    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.model().joint_names.clone()
    }

    /// Names of the joints of the left and of the right arm.
    #[getter]
    fn arms(&self) -> [Vec<String>; 2] {
        let name = |joint: &usize| self.model().joint_names[*joint].clone();
        self.model().arms.each_ref().map(|arm| arm.range().map(|joint| name(&joint)).collect())
    }

    #[getter]
    fn prismatic(&self) -> Vec<bool> {
        self.model().prismatic[..self.model().count].to_vec()
    }

    #[getter]
    fn home<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let count = self.model().count;
        array(py, self.model().home[..count].to_vec(), &[count])
    }

    #[getter]
    fn clearance_min_m(&self) -> f64 {
        self.model().d_min_m
    }

    #[getter]
    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let count = self.model().count;
        let columns: [(&str, Limit); 6] = [
            ("position_min", |limits| limits.q_min),
            ("position_max", |limits| limits.q_max),
            ("velocity", |limits| limits.v_max),
            ("acceleration", |limits| limits.a_max),
            ("jerk", |limits| limits.j_max),
            ("effort", |limits| limits.effort_max),
        ];
        let all = PyDict::new(py);
        for (name, value) in columns {
            let values = self.model().limits[..count].iter().map(value).collect();
            all.set_item(name, array(py, values, &[count])?)?;
        }
        Ok(all)
    }

    /// Hash of everything that affects a trajectory except its motion.
    #[getter]
    fn fingerprint(&self) -> String {
        format!("{} {:016x}", env!("CARGO_PKG_VERSION"), self.loaded.hash)
    }

    /// Text of the URDF.
    #[getter]
    fn urdf(&self) -> &str {
        &self.model().texts.urdf
    }

    /// Collision geometry: name, body, both ends in the body's frame, and radius, m.
    #[getter]
    fn capsules(&self) -> Vec<(String, usize, [[f64; 3]; 2], f64)> {
        let capsules = self.model().capsules.iter();
        capsules.map(|one| (one.name.clone(), one.body, [one.a.into(), one.b.into()], one.radius_m)).collect()
    }

    /// Indices of the capsules of each checked pair.
    #[getter]
    fn pairs(&self) -> Vec<(usize, usize)> {
        self.model().pairs.iter().map(|pair| (pair.a, pair.b)).collect()
    }

    /// Returns `base_from_body` of every body, (N, joints + 1, 4, 4).
    fn forward<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'_, f64>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (rows, values) = self.rows(&q)?;
        let (model, count) = (self.model(), self.model().count);
        let poses = computed(py, |_| {
            let mut out = Vec::with_capacity(rows * (count + 1) * 16);
            let mut frames = Frames::default();
            for q in values.chunks_exact(count) {
                model.forward(&row(q, count), &mut frames);
                for pose in &frames.base_from_body[..=count] {
                    for line in 0..3 {
                        out.extend((0..3).map(|column| pose.r[(line, column)]));
                        out.push(pose.t[line]);
                    }
                    out.extend([0.0, 0.0, 0.0, 1.0]);
                }
            }
            out
        })?;
        array(py, poses, &[rows, count + 1, 4, 4])
    }

    /// Returns the smallest clearance of the checked pairs and of the obstacles, m, (N,).
    fn clearance<'py>(&self, py: Python<'py>, q: PyReadonlyArray2<'_, f64>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (rows, values) = self.rows(&q)?;
        let (model, count) = (self.model(), self.model().count);
        let clearances = computed(py, |_| {
            let mut frames = Frames::default();
            let clearance = |q: &[f64]| {
                model.forward(&row(q, count), &mut frames);
                let moving = model.capsules.iter().filter(|capsule| capsule.body > 0);
                let from_obstacles = moving.flat_map(|capsule| {
                    let [a, b] = capsule.ends(&frames);
                    let distances = model.obstacles.iter().map(move |obstacle| obstacle.solid.segment_distance(&a, &b));
                    distances.map(|distance_m| distance_m - capsule.radius_m)
                });
                from_obstacles.fold(model.clearance(&frames).0, f64::min)
            };
            values.chunks_exact(count).map(clearance).collect()
        })?;
        array(py, clearances, &[rows])
    }
}
