//! Recordings as arrays: our own messages, by kind.

use crate::arrays::{array, computed, refused, unread};
use messages::{JOINTS_MAX, JointCommand, JointTarget, Message, RobotId, RobotState, Skeleton, Status, command_flag};
use motion::mcap::{Reader, Source};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest number of messages of a kind: 22 minutes at 1500 Hz, 6 hours at 100 Hz. Commands of 17 joints take 850 MB.
const ROWS_MAX: usize = 2_000_000;
/// Name of a recording's table about its run, as `record` writes it.
const ABOUT: &str = "teleopd";

/// Topic of a policy's targets, as `record` names it.
const POLICY: &str = "/teleop/policy_target";

/// The messages of one kind.
#[derive(Default)]
struct Table {
    time_ns: Vec<u64>,
    integers: BTreeMap<&'static str, Vec<u64>>,
    /// Shape of a row, and the values.
    numbers: BTreeMap<&'static str, (Vec<usize>, Vec<f64>)>,
}

impl Table {
    fn integer(&mut self, name: &'static str, value: u64) {
        self.integers.entry(name).or_default().push(value);
    }

    fn number(&mut self, name: &'static str, value: f64) {
        self.numbers.entry(name).or_default().1.push(value);
    }

    fn wide<const W: usize>(&mut self, name: &'static str, rows: &[[f32; W]]) {
        let (shape, values) = self.numbers.entry(name).or_default();
        *shape = vec![rows.len(), W];
        values.extend(rows.iter().flatten().map(|value| f64::from(*value)));
    }

    fn joints(&mut self, robot: &RobotId, columns: &[(&'static str, &[f64; JOINTS_MAX])]) {
        let count = (robot.joint_count as usize).min(JOINTS_MAX);
        for (name, values) in columns {
            let (shape, all) = self.numbers.entry(name).or_default();
            *shape = vec![count];
            all.extend_from_slice(&values[..count]);
        }
    }

    fn into_dict<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (rows, all) = (self.time_ns.len(), PyDict::new(py));
        all.set_item("time_ns", array(py, self.time_ns, &[rows])?)?;
        for (name, values) in self.integers {
            all.set_item(name, array(py, values, &[rows])?)?;
        }
        for (name, (shape, values)) in self.numbers {
            all.set_item(name, array(py, values, &[&[rows], shape.as_slice()].concat())?)?;
        }
        Ok(all)
    }
}

/// Returns the kind of a source's messages. `None` for messages of other programs.
fn kind(source: &Source) -> Option<&'static str> {
    let kinds = [
        (Skeleton::TYPE_NAME, "skeletons"),
        (JointTarget::TYPE_NAME, if source.topic == POLICY { "policy_targets" } else { "targets" }),
        (JointCommand::TYPE_NAME, "commands"),
        (RobotState::TYPE_NAME, "states"),
        (Status::TYPE_NAME, "statuses"),
    ];
    kinds.into_iter().find_map(|(layout, kind)| (source.schema == layout.as_str()).then_some(kind))
}

/// Appends a message to its kind, and returns true. False for a message of another program.
fn push(
    tables: &mut BTreeMap<&'static str, Table>,
    rate: Option<u64>,
    source: &Source,
    at: u64,
    data: &[u8],
) -> Result<bool, String> {
    fn decoded<M: Message>(data: &[u8]) -> Result<M, String> {
        let size = size_of::<M>();
        M::from_le_bytes(data).ok_or_else(|| format!("{}: a message of {} bytes, not {size}", M::NAME, data.len()))
    }
    let Some(kind) = kind(source) else { return Ok(false) };
    let table = tables.entry(kind).or_default();
    // The first message of each period is kept. A stamp in whole ns may be just before its instant.
    let period = |at: u64, rate_mhz: u64| (u128::from(at) + 1) * u128::from(rate_mhz) / 1_000_000_000_000;
    if rate.zip(table.time_ns.last()).is_some_and(|(rate, last)| period(at, rate) <= period(*last, rate)) {
        return Ok(true);
    }
    if table.time_ns.len() >= ROWS_MAX {
        return Err(format!("more than {ROWS_MAX} {kind}: give rate_hz, to keep fewer"));
    }
    match kind {
        "skeletons" => {
            let Skeleton { positions, limbs, operator_id, .. } = decoded(data)?;
            table.wide("positions", &positions);
            table.wide("limbs", &limbs);
            table.integer("operator_id", u64::from(operator_id));
        }
        "targets" | "policy_targets" => {
            let JointTarget { robot, k, q, dq, valid_mask, .. } = decoded(data)?;
            table.integer("k", k);
            table.integer("valid_mask", u64::from(valid_mask));
            table.joints(&robot, &[("positions", &q), ("velocities", &dq)]);
        }
        "commands" => {
            let JointCommand { robot, k, q, v, a, mode, flags, .. } = decoded(data)?;
            table.integer("k", k);
            table.integer("modes", u64::from(mode));
            table.integer("sources", u64::from((flags >> command_flag::SOURCES_SHIFT) & 15));
            table.joints(&robot, &[("positions", &q), ("velocities", &v), ("accelerations", &a)]);
        }
        "states" => {
            let RobotState { robot, executed_k, q_measured, dq_measured, q, v, .. } = decoded(data)?;
            table.integer("k", executed_k);
            table.joints(&robot, &[("measured_positions", &q_measured), ("measured_velocities", &dq_measured)]);
            table.joints(&robot, &[("positions", &q), ("velocities", &v)]);
        }
        _ => {
            let status: Status = decoded(data)?;
            table.integer("k", status.k);
            table.integer("modes", u64::from(status.mode));
            table.integer("faults", status.faults);
            table.number("clearance_m", status.clearance_command_m);
            table.number("measured_clearance_m", status.clearance_measured_m);
            table.number("limb_error_rad", status.limb_error_measured_rad);
            table.number("speed_scale", status.speed_scale);
        }
    }
    table.time_ns.push(at);
    Ok(true)
}

/// Messages by kind, the table about the run, and what is lost.
type Read<T> = (T, BTreeMap<String, String>, Option<String>);

/// Reads a recording until its end, or until `interrupted`.
fn read(path: &Path, rate: Option<u64>, interrupted: &AtomicBool) -> PyResult<Read<BTreeMap<&'static str, Table>>> {
    let open = || {
        let is_file = std::fs::metadata(path)?.is_file();
        if is_file { File::open(path) } else { Err(std::io::Error::other("is not a regular file")) }
    };
    let failed = |cause: &dyn std::fmt::Display| refused(format!("{}: {cause}", path.display()));
    let file = open().map_err(|error| unread(rt::unreadable(path, &error)))?;
    let mut reader = Reader::new(file, |_| 0).map_err(|error| failed(&error))?;
    let mut tables = BTreeMap::new();
    let mut others = 0_u64;
    while let Some(message) = reader.next_message().map_err(|error| failed(&error))? {
        if interrupted.load(Ordering::Relaxed) {
            break;
        }
        let Some(source) = reader.source(message.channel) else { continue };
        let ours = push(&mut tables, rate, source, message.log_time, &message.data);
        others += u64::from(!ours.map_err(|cause| failed(&cause))?);
    }
    if tables.is_empty() {
        return Err(failed(&format!("none of its {others} messages has a layout of this version")));
    }
    Ok((tables, reader.table(ABOUT).cloned().unwrap_or_default(), reader.lost().map(str::to_owned)))
}

/// Returns the messages of each kind, the table about the run, and what is lost if the file is damaged.
#[pyfunction]
pub(crate) fn read_recording(py: Python<'_>, path: PathBuf, rate_hz: Option<f64>) -> PyResult<Read<Bound<'_, PyDict>>> {
    if let Some(rate_hz) = rate_hz.filter(|rate_hz| !(*rate_hz >= 1e-3)) {
        return Err(refused(format!("rate_hz = {rate_hz}: must be at least 0.001 Hz")));
    }
    let rate_mhz = rate_hz.map(|rate_hz| (1e3 * rate_hz).round() as u64);
    let (tables, about, lost) = computed(py, |interrupted| read(&path, rate_mhz, interrupted))??;
    let all = PyDict::new(py);
    for (kind, table) in tables {
        all.set_item(kind, table.into_dict(py)?)?;
    }
    Ok((all, about, lost))
}
