//! The eleven named motions: joint error and control frequency, with the figures of the paper beside them, and
//! the paper's third figure.

use crate::clips::{Clip, clip_of};
use crate::error::EvalError;
use crate::figures::{FigureKind, limbs_of, with_limbs};
use crate::methods::Method;
use crate::metrics::{Figures, Task, measure};
use crate::plots::{FigureRow, figure_rows};
use crate::timing::us_per_pose;
use motion::{CalibrationMode, Frame};
use poses::motions::{named_pose, paper_motions};
use poses::person::{hands, head};
use poses::trajectory::ground_truth;
use robot::Model;
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;

/// Joint MSE that the paper reports, rad^2, on its own data and its own hand-made ground truth.
const REPORTED_MSE: [(&str, f64); 4] =
    [("s3le", 0.44), ("paper", 0.21), ("paper_no_ltc", 0.24), ("paper_no_triplet", 0.57)];
/// Control frequencies that the paper reports, kHz.
const REPORTED_KHZ: [(&str, f64); 2] = [("s3le", 0.4), ("paper", 1.5)];
/// The motion whose hands touch the head.
const TOUCH: &str = "hands-on-head";
/// A hand counts as nearest while it is this close to its least distance, m.
const NEAREST_M: f64 = 0.005;
/// Poses of the figure.
const POSES: [&str; 7] =
    ["hands-up", "hands-to-chest", "hands-on-head", "wave-right", "point-forward", "cross-arms", "stretch-sideways"];
/// Rows of the figure, if measured.
const ROWS: [&str; 3] = ["paper", "s3le", "ours_k2"];

/// One method on the named motions.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperRow {
    /// Name.
    pub name: String,
    /// Figures, with the joints compared with the ground truth.
    pub figures: Figures,
    /// Poses per second, kHz.
    pub control_khz: Option<f64>,
    /// Distance from the middle of the hand to the middle of the head while the human touches it, m.
    pub hand_to_head_m: Option<f64>,
}

/// The table of the named motions.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperTable {
    /// Methods.
    pub rows: Vec<PaperRow>,
    /// Names of the methods without weights.
    pub missing: Vec<String>,
    /// Frames of all motions.
    pub frames: usize,
    /// The human's own distance from hand to head, m.
    pub human_hand_to_head_m: Option<f64>,
}

/// Returns the named motions. Their ground truth replaces the oracle's postures.
#[must_use]
pub fn named_tasks(model: &Model) -> Vec<Task> {
    let tasks = paper_motions().into_iter().filter_map(|motion| {
        let clip: Clip = clip_of(&motion, CalibrationMode::Rig, 1).ok()?;
        let oracle = ground_truth(model, &motion).q;
        (oracle.len() == clip.human.len()).then(|| Task {
            target: clip.human.clone(),
            second_oracle: Vec::new(),
            oracle,
            clip,
            contiguous: true,
        })
    });
    tasks.collect()
}

/// Measures the methods on the named motions.
#[must_use]
pub fn table(model: &Model, methods: &[Method], tasks: &[Task]) -> PaperTable {
    let arm = retarget::ArmModel::of(model);
    let moments = crate::run::moments(tasks);
    let (mut rows, mut missing) = (Vec::new(), Vec::new());
    for method in methods {
        let Ok(solver) = &method.solver else {
            missing.push(method.name.clone());
            continue;
        };
        let postures = crate::run::postures(solver, &arm, tasks);
        let runs: Vec<_> = tasks.iter().zip(&postures).map(|(task, postures)| task.run(postures)).collect();
        rows.push(PaperRow {
            name: method.name.clone(),
            figures: measure(&arm, &runs),
            control_khz: us_per_pose(solver, &arm, &moments).map(|us| 1e3 / us),
            hand_to_head_m: touch(tasks, |index, task| {
                let posture = postures.get(index).and_then(|clip| clip.get(task.0))?;
                Some(with_limbs(&task.1, &limbs_of(&arm, posture)))
            }),
        });
    }
    PaperTable {
        rows,
        missing,
        frames: tasks.iter().map(|task| task.clip.human.len()).sum(),
        human_hand_to_head_m: touch(tasks, |_, (_, positions)| Some(positions)),
    }
}

type Positions = [[f32; 3]; messages::SMPL_JOINTS];

/// Returns the mean distance from hand to head over both hands and the frames in which the human's hands are
/// nearest.
fn touch(tasks: &[Task], shown: impl Fn(usize, (usize, Positions)) -> Option<Positions>) -> Option<f64> {
    let (index, task) = tasks.iter().enumerate().find(|(_, task)| task.clip.name == TOUCH)?;
    let human: Vec<f64> = task.clip.positions.iter().map(hand_to_head).collect();
    let least = human.iter().copied().fold(f64::INFINITY, f64::min);
    let near = human.iter().enumerate().filter(|(_, distance)| **distance < least + NEAREST_M);
    let distances: Vec<f64> = near
        .filter_map(|(frame, _)| shown(index, (frame, *task.clip.positions.get(frame)?)))
        .map(|positions| hand_to_head(&positions))
        .collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}

fn hand_to_head(positions: &Positions) -> f64 {
    let frame = Frame { positions: *positions, rotations: [[0.0, 0.0, 0.0, 1.0]; messages::SMPL_JOINTS] };
    let [left, right] = hands(&frame).map(|hand| (hand - head(&frame)).norm());
    0.5 * (left + right)
}

/// Draws human, paper, S3LE and ours under one another in named poses, as an SVG file.
///
/// # Errors
/// Returns an error if it cannot be written.
pub fn figure(path: &Path, model: &Model, methods: &[Method], tasks: &[Task]) -> Result<(), EvalError> {
    let arm = retarget::ArmModel::of(model);
    let instants: Vec<(usize, usize)> = POSES
        .iter()
        .filter_map(|name| {
            let index = tasks.iter().position(|task| task.clip.name == *name)?;
            let pose = named_pose(name)?;
            let away = |positions: &Positions| -> f32 {
                positions.iter().flatten().zip(pose.positions.iter().flatten()).map(|(a, b)| (a - b) * (a - b)).sum()
            };
            let frames = tasks.get(index)?.clip.positions.iter().enumerate();
            frames.min_by(|(_, a), (_, b)| away(a).total_cmp(&away(b))).map(|(frame, _)| (index, frame))
        })
        .collect();
    let figures = |shown: &dyn Fn(usize, usize, &Positions) -> Option<Positions>| -> Vec<Positions> {
        let at = |(index, frame): &(usize, usize)| {
            let positions = tasks.get(*index)?.clip.positions.get(*frame)?;
            shown(*index, *frame, positions)
        };
        instants.iter().filter_map(at).collect()
    };
    let mut rows: Vec<FigureRow> =
        vec![("human".to_owned(), FigureKind::Human, figures(&|_, _, positions| Some(*positions)))];
    for method in ROWS.iter().filter_map(|name| methods.iter().find(|method| method.name == *name)) {
        let Ok(solver) = &method.solver else { continue };
        let postures = crate::run::postures(solver, &arm, tasks);
        let shown = |index: usize, frame: usize, positions: &Positions| {
            let posture = postures.get(index)?.get(frame)?;
            Some(with_limbs(positions, &limbs_of(&arm, posture)))
        };
        rows.push((method.name.clone(), FigureKind::Robot, figures(&shown)));
    }
    let columns: Vec<String> =
        instants.iter().filter_map(|(index, _)| tasks.get(*index).map(|task| task.clip.name.clone())).collect();
    figure_rows(path, &columns, &rows)
}

fn reported(table: &[(&str, f64)], name: &str) -> Option<f64> {
    table.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
}

impl fmt::Display for PaperTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cell = crate::report::cell;
        writeln!(
            f,
            "\neleven named motions, {} frames; ground truth: the best that the arm can do, continued",
            self.frames
        )?;
        writeln!(
            f,
            "{:<18} {:>8} {:>8} {:>8} {:>9} {:>9} | {:>8} {:>8}",
            "", "joints", "joints*", "limb", "control", "hand-head", "paper's", "paper's"
        )?;
        writeln!(
            f,
            "{:<18} {:>8} {:>8} {:>8} {:>9} {:>9} | {:>8} {:>8}",
            "method", "rad^2", "rad^2", "deg", "kHz", "cm", "rad^2", "kHz"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<18} {} {} {} {} {} | {} {}",
                row.name,
                cell(row.figures.joint_mse_all_rad2, 8, 4),
                cell(row.figures.joint_mse_rad2, 8, 4),
                cell(Some(row.figures.limb_deg_mean), 8, 2),
                cell(row.control_khz, 9, 2),
                cell(row.hand_to_head_m.map(|m| 100.0 * m), 9, 1),
                cell(reported(&REPORTED_MSE, &row.name), 8, 2),
                cell(reported(&REPORTED_KHZ, &row.name), 8, 1),
            )?;
        }
        if !self.missing.is_empty() {
            writeln!(f, "missing: {}", self.missing.join(" "))?;
        }
        let human = cell(self.human_hand_to_head_m.map(|m| 100.0 * m), 0, 1);
        writeln!(
            f,
            "* without frames near the gimbal. The human's own hand-head distance: {human} cm, to the head's middle."
        )?;
        writeln!(f, "The paper's figures are for other data, another robot and another, hand-made ground truth.")
    }
}

impl PaperTable {
    /// Returns the table as JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        let row = |row: &PaperRow| {
            let figures = json!({
                "joint_mse_rad2": row.figures.joint_mse_all_rad2,
                "joint_mse_masked_rad2": row.figures.joint_mse_rad2,
                "limb_deg_mean": row.figures.limb_deg_mean,
                "control_khz": row.control_khz,
                "hand_to_head_m": row.hand_to_head_m,
                "reported_mse_rad2": reported(&REPORTED_MSE, &row.name),
                "reported_khz": reported(&REPORTED_KHZ, &row.name),
            });
            (row.name.clone(), figures)
        };
        json!({
            "frames": self.frames,
            "human_hand_to_head_m": self.human_hand_to_head_m,
            "methods": self.rows.iter().map(row).collect::<serde_json::Map<_, _>>(),
            "missing": self.missing,
        })
    }
}
