//! Certified trajectories: a motion through all stages in virtual time, as `replay --offline` plays it.

use crate::arrays::{array, computed, push_joints, refused};
use crate::motions::{Motion, calibration};
use crate::robots::Robot;
use messages::TICK_HZ;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::Ordering;
use world::{CertifiedRow, OfflineReport, Uncertified};

/// Largest number of rows: 2.7 hours at 100 Hz, 11 minutes at 1500 Hz. With 17 joints they take 430 MB.
const ROWS_MAX: usize = 1_000_000;

#[derive(Default)]
struct Columns {
    k: Vec<u64>,
    q: Vec<f64>,
    v: Vec<f64>,
    target: Vec<f64>,
    mode: Vec<u8>,
    clearance_m: Vec<f64>,
    torque_share: Vec<f64>,
    frame: Vec<i64>,
}

impl Columns {
    fn push(&mut self, row: &CertifiedRow, joints: usize) {
        self.k.push(row.k);
        push_joints(&mut self.q, &row.q, joints);
        push_joints(&mut self.v, &row.v, joints);
        push_joints(&mut self.target, &row.target, joints);
        self.mode.push(row.mode as u8);
        self.clearance_m.push(row.clearance_m);
        self.torque_share.push(row.torque_share);
        self.frame.push(row.frame.map_or(-1, |frame| frame as i64));
    }

    fn into_dict<'py>(self, py: Python<'py>, joints: usize) -> PyResult<Bound<'py, PyDict>> {
        let (rows, all) = (self.k.len(), PyDict::new(py));
        for (name, values) in [("positions", self.q), ("velocities", self.v), ("targets", self.target)] {
            all.set_item(name, array(py, values, &[rows, joints])?)?;
        }
        all.set_item("k", array(py, self.k, &[rows])?)?;
        all.set_item("modes", array(py, self.mode, &[rows])?)?;
        all.set_item("clearance_m", array(py, self.clearance_m, &[rows])?)?;
        all.set_item("torque_share", array(py, self.torque_share, &[rows])?)?;
        all.set_item("frames", array(py, self.frame, &[rows])?)?;
        Ok(all)
    }
}

fn report<'py>(py: Python<'py>, report: &OfflineReport) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    all.set_item("ticks", report.rows)?;
    all.set_item("min_clearance_mm", report.min_clearance_mm)?;
    all.set_item("torque_share_max", report.torque_share_max)?;
    all.set_item("limb_error_deg_mean", report.limb_error_measured_deg_mean)?;
    all.set_item("violations", report.violations.clone())?;
    Ok(all)
}

/// Returns the columns of the trajectory, and the report of the whole run.
#[pyfunction]
pub(crate) fn certify<'py>(
    py: Python<'py>,
    motion: &Motion,
    robot: &Robot,
    hinges: &str,
    rate_hz: u64,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    if rate_hz == 0 || !TICK_HZ.is_multiple_of(rate_hz) {
        return Err(refused(format!("rate_hz = {rate_hz}: must divide {TICK_HZ} Hz")));
    }
    let (motion, loaded, calibration) = (&motion.motion, &robot.loaded, calibration(hinges)?);
    let joints = loaded.model.count;
    let (columns, end) = computed(py, |interrupted| {
        let mut columns = Columns::default();
        let end = world::certify(loaded, motion, calibration, TICK_HZ / rate_hz, |row| {
            columns.push(row, joints);
            if columns.k.len() > ROWS_MAX || interrupted.load(Ordering::Relaxed) { Err(()) } else { Ok(()) }
        });
        (columns, end)
    })?;
    let done = end.map_err(|error| match error {
        Uncertified::Settings(error) => refused(error),
        Uncertified::Refused(why) => refused(format!("{}: {why}", motion.name)),
        Uncertified::Ended(()) => {
            let bound = format!("at most {ROWS_MAX}: give a lower rate_hz, or parts of the motion");
            refused(format!("{}: more than {ROWS_MAX} rows at {rate_hz} Hz, {bound}", motion.name))
        }
    })?;
    Ok((columns.into_dict(py, joints)?, report(py, &done)?))
}
