//! The eleven named motions: joint error and control frequency, with the figures of the paper beside them, and
//! the paper's third figure.

use crate::clips::{Clip, clip_of};
use crate::following::mean;
use crate::methods::{Method, Posture};
use crate::metrics::{Task, measure};
use crate::plots::{FigureRow, figure_rows};
use crate::stick_figures::{FigureKind, limbs_of, with_limbs};
use crate::timing::us_per_pose;
use ::report::table::{self, column, number};
use motion::{CalibrationMode, Frame};
use poses::motions::{named_pose, paper_motions};
use poses::person::{hands, head};
use poses::trajectory::ground_truth;
use retarget::ArmModel;
use robot::Model;
use rt::Failure;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::Path;

/// Joint MSE that the paper reports, rad^2, on its own data and its own hand-made ground truth.
const REPORTED_MSE: [(&str, f64); 4] =
    [("s3le", 0.44), ("paper", 0.21), ("paper_no_ltc", 0.24), ("paper_no_triplet", 0.57)];
const REPORTED_KHZ: [(&str, f64); 2] = [("s3le", 0.4), ("paper", 1.5)];
const TOUCH: &str = "hands-on-head";
/// A hand counts as nearest while it is this close to its least distance, m.
const NEAREST_M: f64 = 0.005;
const POSES: [&str; 7] =
    ["hands-up", "hands-to-chest", "hands-on-head", "wave-right", "point-forward", "cross-arms", "stretch-sideways"];
/// Rows of the figure, if measured.
const ROWS: [&str; 3] = ["paper", "s3le", "ours_k2"];

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PaperTable {
    pub frames: usize,
    /// Distance from the middle of the human's hand to the middle of the head during the touch, m.
    pub human_hand_to_head_m: Option<f64>,
    /// Figures of each method, with the joints compared with the ground truth.
    pub methods: Map<String, Value>,
    pub missing: Vec<String>,
}

pub fn named_tasks(model: &Model) -> Vec<Task> {
    let tasks = paper_motions().into_iter().filter_map(|motion| {
        let clip: Clip = clip_of(&motion, CalibrationMode::Rig).ok()?;
        let oracle = ground_truth(model, &motion).q;
        (oracle.len() == clip.human.len()).then_some(Task { oracle, clip })
    });
    tasks.collect()
}

pub fn table(model: &Model, methods: &[Method], tasks: &[Task]) -> PaperTable {
    let arm = ArmModel::from_model(model);
    let moments = crate::run::moments(tasks);
    let (mut rows, mut missing) = (Map::new(), Vec::new());
    for Method { name, solver } in methods {
        let Ok(solver) = solver else {
            missing.push(name.clone());
            continue;
        };
        let postures = crate::run::postures(solver, &arm, tasks);
        let figures = measure(&arm, tasks, &postures);
        let row = json!({
            "joint_mse_rad2": figures.joint_mse_all_rad2,
            "joint_mse_masked_rad2": figures.joint_mse_rad2,
            "limb_deg_mean": figures.limb_deg_mean,
            "control_khz": us_per_pose(solver, &arm, &moments).map(|us| 1e3 / us),
            "hand_to_head_m": touch(tasks, Some((&arm, &postures))),
            "reported_mse_rad2": reported(&REPORTED_MSE, name),
            "reported_khz": reported(&REPORTED_KHZ, name),
        });
        rows.insert(name.clone(), row);
    }
    PaperTable {
        frames: tasks.iter().map(|task| task.clip.human.len()).sum(),
        human_hand_to_head_m: touch(tasks, None),
        methods: rows,
        missing,
    }
}

type Positions = [[f32; 3]; messages::SMPL_JOINTS];

type Robot<'a> = Option<(&'a ArmModel, &'a [Vec<Posture>])>;

fn joints(tasks: &[Task], robot: Robot<'_>, (task, frame): (usize, usize)) -> Option<Positions> {
    let human = *tasks.get(task)?.clip.positions.get(frame)?;
    let Some((arm, postures)) = robot else { return Some(human) };
    Some(with_limbs(&human, &limbs_of(arm, postures.get(task)?.get(frame)?)))
}

/// Returns the mean distance from hand to head over both hands and the frames in which the human's hands are nearest.
fn touch(tasks: &[Task], robot: Robot<'_>) -> Option<f64> {
    let (index, task) = tasks.iter().enumerate().find(|(_, task)| task.clip.name == TOUCH)?;
    let human: Vec<f64> = task.clip.positions.iter().map(hand_to_head).collect();
    let least = human.iter().copied().fold(f64::INFINITY, f64::min);
    let near = human.iter().enumerate().filter(|(_, distance)| **distance < least + NEAREST_M);
    let shown = near.filter_map(|(frame, _)| joints(tasks, robot, (index, frame)));
    let distances: Vec<f64> = shown.map(|positions| hand_to_head(&positions)).collect();
    mean(&distances)
}

fn hand_to_head(positions: &Positions) -> f64 {
    let frame = Frame { positions: *positions, ..Frame::ZERO };
    let [left, right] = hands(&frame).map(|hand| (hand - head(&frame)).norm());
    0.5 * (left + right)
}

pub fn figure(path: &Path, model: &Model, methods: &[Method], tasks: &[Task]) -> Result<(), Failure> {
    let arm = ArmModel::from_model(model);
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
    let figures = |robot: Robot<'_>| instants.iter().filter_map(|at| joints(tasks, robot, *at)).collect();
    let mut rows: Vec<FigureRow> = vec![("human".to_owned(), FigureKind::Human, figures(None))];
    for Method { name, solver } in ROWS.iter().filter_map(|name| methods.iter().find(|method| method.name == *name)) {
        let Ok(solver) = solver else { continue };
        let postures = crate::run::postures(solver, &arm, tasks);
        rows.push((name.clone(), FigureKind::Robot, figures(Some((&arm, &postures)))));
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
        let frames = self.frames;
        writeln!(f, "\neleven named motions, {frames} frames; ground truth: the best that the arm can do, continued")?;
        let figure =
            |head, width, digits, key| column(head, width, move |row: &Value| number(row[key].as_f64(), digits));
        let columns = [
            figure(["joints", "rad^2"], 8, 4, "joint_mse_rad2"),
            figure(["joints*", "rad^2"], 8, 4, "joint_mse_masked_rad2"),
            figure(["limb", "deg"], 8, 2, "limb_deg_mean"),
            figure(["control", "kHz"], 9, 2, "control_khz"),
            column(["hand-head", "cm"], 9, |row: &Value| number(row["hand_to_head_m"].as_f64().map(|m| 100.0 * m), 1)),
            column(["|", "|"], 1, |_| "|".to_owned()),
            figure(["paper's", "rad^2"], 8, 2, "reported_mse_rad2"),
            figure(["paper's", "kHz"], 8, 1, "reported_khz"),
        ];
        table::write(f, ("method", 18), &columns, self.methods.iter().map(|(name, row)| (name.as_str(), row)))?;
        if !self.missing.is_empty() {
            writeln!(f, "missing: {}", self.missing.join(" "))?;
        }
        let human = number(self.human_hand_to_head_m.map(|m| 100.0 * m), 1);
        write!(
            f,
            "* without frames near the gimbal. The human's own hand-head distance: {human} cm, to the head's middle.\n\
             The paper's figures are for other data, another robot and another, hand-made ground truth.\n"
        )
    }
}
