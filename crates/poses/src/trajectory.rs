//! Joint trajectories of both arms: the oracle's for a motion, from and to CSV, and as the motion of a person.

use crate::error::PosesError;
use crate::motions::sway_all;
use crate::person::{standing, with_limbs};
use motion::{CalibrationMode, FRAMES_MAX, Frame, Motion};
use retarget::contact::{Correction, Memory, PersonGeometry};
use retarget::{ARM_Q, ARMS, ArmModel, ArmQ, Limbs, oracle, refine};
use robot::Model;
use std::path::Path;

/// Positions of the joints that turn both arms' limbs, at a constant rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// Names of the joints by slot, left arm and right arm. Empty for an empty slot.
    pub joint_names: [[String; ARM_Q]; ARMS],
    /// Rows per second.
    pub rate_hz: f64,
    /// True if the file has other rows, and these were interpolated.
    pub is_resampled: bool,
    /// Rows: joint positions of the left and of the right arm, rad. They are the robot's own, not those of a right arm
    /// that is taken as the left one.
    pub q: Vec<[ArmQ; ARMS]>,
}

/// Names of the joints that turn both arms' limbs, by slot.
pub fn joint_names(model: &Model) -> [[String; ARM_Q]; ARMS] {
    let name = |slot: Option<usize>| slot.map_or_else(String::new, |joint| model.joint_names[joint].clone());
    std::array::from_fn(|arm| std::array::from_fn(|j| name(model.arms[arm].slots[j])))
}

/// Weight of |q - previous|^2 in the continuation, 1/rad^2, and the S_GR that it may cost: 1e-6 is 0.1 degrees.
const CONTINUE_WEIGHT: f64 = 1e-5;
const CONTINUE_COST: f64 = 1e-6;
const CONTINUE_STEPS: u32 = 40;

/// Returns the reachable optimum of every frame, from the multi-start oracle. If joints are degenerate (arm hanging) or
/// two optima are equally good, it takes the one that continues the previous frame. This may cost at most 1e-6 of S_GR.
pub fn ground_truth(model: &Model, motion: &Motion) -> Trajectory {
    ground_truth_touching(model, motion, 0.0)
}

/// As [`ground_truth`], for limbs that bring the hands to where the person's touch, with this weight from 0 to 1. See
/// [`retarget::contact`].
pub fn ground_truth_touching(model: &Model, motion: &Motion, weight: f64) -> Trajectory {
    let (models, correction) = (ArmModel::both(model), Correction::from_model(model, weight));
    let mut memory = Memory::default();
    let calibration = motion::calibrate(motion, CalibrationMode::Rig);
    let home = |side: usize| model.arms[side].mirrored(&model.arms[side].limb_values(&model.home));
    let mut previous: [ArmQ; ARMS] = std::array::from_fn(home);
    let limbs = motion::limbs(motion, &calibration);
    let people =
        motion.frames.iter().zip(&limbs).filter_map(|(frame, limbs)| Some((frame, Limbs::from_message(limbs)?)));
    let rows = people.map(|(frame, mut arms)| {
        let seen = arms.map(Some);
        if let Some(geometry) = PersonGeometry::measure(&frame.positions, &seen).filter(|_| weight > 0.0) {
            let (limbs, frame_s) = ((&seen, &[None; ARMS]), 1.0 / motion.frame_rate_hz);
            let touching = correction.apply(models.each_ref(), &geometry, limbs, frame_s, &mut memory);
            arms = std::array::from_fn(|side| touching[side].unwrap_or(arms[side]));
        }
        previous = std::array::from_fn(|side| best(&models[side], &arms[side], &previous[side]));
        own_positions(model, &previous)
    });
    let q = rows.collect();
    Trajectory { joint_names: joint_names(model), rate_hz: motion.frame_rate_hz, is_resampled: false, q }
}

/// Converts joint positions between those of both arms taken as left arms and the robot's own. It is its own inverse.
pub fn own_positions(model: &Model, q: &[ArmQ; ARMS]) -> [ArmQ; ARMS] {
    std::array::from_fn(|side| model.arms[side].mirrored(&q[side]))
}

fn best(arm: &ArmModel, human: &Limbs, previous: &ArmQ) -> ArmQ {
    let optimum = oracle(arm, human, previous);
    let near = refine(arm, human, previous, previous, CONTINUE_WEIGHT, CONTINUE_STEPS);
    if near.s_gr <= optimum.s_gr + CONTINUE_COST { near.q } else { optimum.q }
}

/// Largest number of rows that are read: 11 minutes at 1500 Hz. Each one that is played is a frame of motion.
const ROWS_MAX: usize = 1_000_000;
/// Largest file that is read, bytes.
const FILE_BYTES_MAX: u64 = 1 << 30;
/// Rates that are played as they are, Hz. Others are interpolated to 60 Hz.
const RATE_HZ: (f64, f64) = (30.0, 240.0);
const RATE_RESAMPLED_HZ: f64 = 60.0;
/// A rate counts as constant if no step of time differs from the mean by more than this share. Five decimals of
/// a second at 240 Hz are 0.2 %.
const STEP_TOLERANCE: f64 = 0.01;
/// Length of the list of columns in an error, characters.
const COLUMNS_SHOWN: usize = 300;
const WRITES: &str = "`replay keyposes interpolate` writes such a file";
/// An excess over the joint limits below this is rounding, rad.
const LIMIT_TOLERANCE_RAD: f64 = 1e-3;

/// Reads a CSV file with a column `time_s` (or `t_s`) and one column per arm joint 1 to 5, by name and in any order.
/// Other columns are left out. A rate outside 30 to 240 Hz, or one that is not constant, is interpolated to 60 Hz.
pub fn read_csv(path: &Path, model: &Model) -> Result<Trajectory, PosesError> {
    let bytes = std::fs::metadata(path).map_err(PosesError::file(path))?;
    if !bytes.is_file() || bytes.len() > FILE_BYTES_MAX {
        let reason = format!("is not a regular file of at most {FILE_BYTES_MAX} bytes");
        return Err(PosesError::Trajectory { path: path.to_path_buf(), line: 1, reason });
    }
    let text = std::fs::read_to_string(path).map_err(PosesError::file(path))?;
    parse_csv(&text, model).map_err(|(line, reason)| PosesError::Trajectory { path: path.to_path_buf(), line, reason })
}

type Row = (f64, [ArmQ; ARMS]);

fn parse_csv(text: &str, model: &Model) -> Result<Trajectory, (usize, String)> {
    let names = joint_names(model);
    let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line)).filter(|(_, line)| !line.trim().is_empty());
    let (line, header) = lines.next().ok_or((1, format!("is empty; {WRITES}")))?;
    let header: Vec<&str> = header.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
    let column = |name: &str| header.iter().position(|&column| column == name);
    let lacks = |name: &str| {
        let columns: String = header.join(", ").chars().take(COLUMNS_SHOWN).collect();
        (
            line,
            format!(
                "has no column {name}, but {columns}; a trajectory has time_s and the joints of both arms, with commas; {WRITES}"
            ),
        )
    };
    let time = column("time_s").or(column("t_s")).ok_or_else(|| lacks("time_s or t_s"))?;
    let mut columns = [[None; ARM_Q]; ARMS];
    for (name, column_of) in
        names.iter().flatten().zip(columns.iter_mut().flatten()).filter(|(name, _)| !name.is_empty())
    {
        *column_of = Some(column(name).ok_or_else(|| lacks(name))?);
    }
    let mut rows: Vec<Row> = Vec::new();
    for (line, text) in lines {
        let row = parse_row(text, time, &columns, header.len()).map_err(|reason| (line, reason))?;
        check_row(&row, rows.last(), model).map_err(|reason| (line, reason))?;
        if rows.len() >= ROWS_MAX {
            return Err((line, format!("more than {ROWS_MAX} rows; split the file")));
        }
        rows.push(row);
    }
    let (Some(first), Some(last), true) = (rows.first(), rows.last(), rows.len() >= 2) else {
        return Err((line, format!("has {} rows, at least 2 are needed; {WRITES}", rows.len())));
    };
    let mean_s = (last.0 - first.0) / (rows.len() - 1) as f64;
    let constant = rows.windows(2).all(|w| ((w[1].0 - w[0].0) / mean_s - 1.0).abs() <= STEP_TOLERANCE);
    // Rounded times give a rate that is nearly, but not exactly, 60 Hz.
    let rate_hz = (1.0 / mean_s * 100.0).round() / 100.0;
    let is_resampled = !(constant && (RATE_HZ.0..=RATE_HZ.1).contains(&rate_hz));
    let rate_hz = if is_resampled { RATE_RESAMPLED_HZ } else { rate_hz };
    let lasts = last.0 - first.0;
    let count = if is_resampled { (lasts * rate_hz).floor() } else { (rows.len() - 1) as f64 };
    if !(1.0..FRAMES_MAX as f64).contains(&count) {
        let bound =
            format!("2 to {FRAMES_MAX} frames at {rate_hz} Hz are played; correct the times, or split the file");
        return Err((line, format!("lasts {lasts:?} s, but {bound}")));
    }
    let row = |i: usize| if is_resampled { at(&rows, first.0 + i as f64 / rate_hz) } else { rows[i].1 };
    Ok(Trajectory { joint_names: names, rate_hz, is_resampled, q: (0..=count as usize).map(row).collect() })
}

fn parse_row(text: &str, time: usize, columns: &[[Option<usize>; ARM_Q]; ARMS], width: usize) -> Result<Row, String> {
    let cells: Vec<&str> = text.split(',').map(str::trim).collect();
    if cells.len() != width {
        return Err(format!(
            "has {} columns, the header {width}; correct the line, or write the file again",
            cells.len()
        ));
    }
    let number = |column: usize| {
        let value = cells[column].parse::<f64>().ok().filter(|x| x.is_finite());
        value.ok_or_else(|| format!("column {}: {:?} is not a number; write one there", column + 1, cells[column]))
    };
    let mut q = [[0.0; ARM_Q]; ARMS];
    for (q, column) in q.iter_mut().flatten().zip(columns.iter().flatten()) {
        *q = column.map_or(Ok(0.0), number)?;
    }
    Ok((number(time)?, q))
}

fn check_row((time_s, q): &Row, before: Option<&Row>, model: &Model) -> Result<(), String> {
    if let Some((earlier, _)) = before.filter(|(earlier, _)| time_s <= earlier) {
        return Err(format!("time {time_s:?} s is not after {earlier:?} s; put the rows in order"));
    }
    for (q, arm) in q.iter().zip(&model.arms) {
        for (q, joint) in q.iter().zip(arm.slots).filter_map(|(q, slot)| Some((q, slot?))) {
            let (low, high) = (model.limits[joint].q_min, model.limits[joint].q_max);
            if !(low - LIMIT_TOLERANCE_RAD..=high + LIMIT_TOLERANCE_RAD).contains(q) {
                let name = &model.joint_names[joint];
                return Err(format!(
                    "{name} = {q:?} rad is outside [{low:.4}, {high:.4}] rad; move it inside, or convert degrees"
                ));
            }
        }
    }
    Ok(())
}

/// Interpolates linearly between the rows around `time_s`.
fn at(rows: &[Row], time_s: f64) -> [ArmQ; ARMS] {
    let after = rows.partition_point(|(t, _)| *t <= time_s).clamp(1, rows.len() - 1);
    let ((t0, a), (t1, b)) = (&rows[after - 1], &rows[after]);
    let s = ((time_s - t0) / (t1 - t0)).clamp(0.0, 1.0);
    std::array::from_fn(|arm| std::array::from_fn(|j| a[arm][j] + s * (b[arm][j] - a[arm][j])))
}

/// Returns `standing` with the limb rotations U(q) and F(q) of the robot's forward kinematics, with both arms taken as
/// left arms. Hands are in line with the forearms.
pub(crate) fn person(models: &[ArmModel; ARMS], standing: &Frame, q: &[ArmQ; ARMS]) -> Frame {
    let arms = std::array::from_fn(|arm| {
        let limbs = models[arm].forward(&q[arm]);
        [limbs.upper, limbs.fore, limbs.fore]
    });
    with_limbs(standing, &arms)
}

/// Returns a standing person whose limbs turn like the robot's. The upper arms and forearms have the rotations
/// U(q) and F(q) of the robot's forward kinematics. Retargeting the person gives the trajectory back, through
/// every check of a live person. Calibrate it with `CalibrationMode::Rig`.
pub fn to_motion(trajectory: &Trajectory, model: &Model, name: &str) -> Motion {
    let arms = ArmModel::both(model);
    let standing = standing();
    let mut frames: Vec<_> = trajectory.q.iter().map(|q| person(&arms, &standing, &own_positions(model, q))).collect();
    sway_all(&mut frames);
    let warning = "a joint trajectory: the person has the limb rotations of the robot's forward kinematics";
    let mut motion = Motion::generated(name, trajectory.rate_hz, frames);
    motion.guesses.warnings.push(warning.to_owned());
    if trajectory.is_resampled {
        let (low, high) = RATE_HZ;
        let warning =
            format!("its rows have no constant rate of {low} to {high} Hz: interpolated to {RATE_RESAMPLED_HZ} Hz");
        motion.guesses.warnings.push(warning);
    }
    motion
}
