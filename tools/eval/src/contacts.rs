//! Contacts: does the robot's hand come as near to head, chest and other hand as the person's does?
//!
//! A distance of the person counts while it is below 0.2 m. With the lengths L of the stretched arms, shoulder to the
//! middle of the hand, the error of a frame is
//!
//! ```text
//! e = | d_robot - d_person L_robot / L_person |          m
//! ```
//!
//! Three robots are compared: the best posture for the person's limbs alone, the best one for limbs that are corrected
//! so that hands touch (`retarget::contact`), and the command, after all stages. The first two do not move. The command is
//! compared with the person at the delay of the settings.

use crate::cli::Cli;
use crate::error::EvalError;
use crate::run::{show, write_json};
use crate::table::{self, column, number};
use client::PlayOptions;
use config::{Loaded, Overrides};
use messages::{JOINTS_MAX, Mode, Smpl, deadline};
use motion::{CalibrationMode, Frame, Motion};
use nalgebra::Vector3;
use poses::motions::paper_motions;
use poses::person::{hands, head};
use poses::trajectory::ground_truth_touching;
use robot::{Frames, Model};
use serde::Serialize;
use serde_json::{Map, json};
use std::fmt;
use world::{Offline, OfflineEnd};

/// Distance of the person's below which a contact counts, m: the length of a hand. Assumption.
const NEAR_M: f64 = 0.3;
/// Distance of the chest's surface before the middle between the shoulders, m, for a person (`poses::motions`).
const CHEST_M: f64 = 0.1;

/// Distances of both hands, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distances {
    /// Left and right hand to the middle of the head. `None` for a robot without a head.
    pub head: Option<[f64; 2]>,
    /// Left and right hand to the chest.
    pub chest: [f64; 2],
    /// Hand to hand.
    pub hands: f64,
}

impl Distances {
    fn between(hands: [Vector3<f64>; 2], head: Option<Vector3<f64>>, chest: Vector3<f64>) -> Self {
        Self {
            head: head.map(|head| hands.map(|hand| (hand - head).norm())),
            chest: hands.map(|hand| (hand - chest).norm()),
            hands: (hands[0] - hands[1]).norm(),
        }
    }
}

/// Errors of one motion: the sum over the frames and hands in contact, their number, and the largest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Sum, m.
    pub sum_m: f64,
    /// Number.
    pub count: u32,
    /// Largest, m.
    pub max_m: f64,
}

impl Errors {
    fn add(&mut self, person_m: f64, robot_m: f64, scale: f64) {
        if person_m < NEAR_M {
            let error_m = (robot_m - person_m * scale).abs();
            (self.sum_m, self.count, self.max_m) = (self.sum_m + error_m, self.count + 1, self.max_m.max(error_m));
        }
    }

    /// Mean, m. `None` without a contact.
    #[must_use]
    pub fn mean_m(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum_m / f64::from(self.count))
    }
}

/// Errors of one motion by what is touched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Contacts {
    /// Hand to head.
    pub head: Errors,
    /// Hand to chest.
    pub chest: Errors,
    /// Hand to hand.
    pub hands: Errors,
}

/// Returns the distances of a person who faces x.
#[must_use]
pub fn of_person(frame: &Frame) -> Distances {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    let chest = (at(Smpl::LeftShoulder) + at(Smpl::RightShoulder)) / 2.0 + Vector3::x() * CHEST_M;
    Distances::between(hands(frame), Some(head(frame)), chest)
}

/// Landmarks of a robot.
struct Robot<'a> {
    model: &'a Model,
    frames: Frames,
    /// Length of a stretched arm, m.
    reach_m: f64,
    /// The middle between the shoulders in a T-pose, in the frame of the torso's body, m.
    middle: Vector3<f64>,
}

impl<'a> Robot<'a> {
    fn new(model: &'a Model) -> Self {
        let mut robot = Self { model, frames: Frames::default(), reach_m: 0.0, middle: Vector3::zeros() };
        let mut t_pose = model.home;
        for arm in &model.arms {
            arm.joints.iter().zip(arm.reference).for_each(|(&joint, reference)| t_pose[joint] = reference);
        }
        model.forward(&t_pose, &mut robot.frames);
        let torso = &robot.frames.base_from_body[model.torso_body];
        robot.middle = torso.r.transpose() * ((robot.shoulder(0) + robot.shoulder(1)) / 2.0 - torso.t);
        let arm = &model.arms[0];
        let elbow = robot.frames.base_from_body[arm.joints[3] + 1].t;
        robot.reach_m = (elbow - robot.shoulder(0)).norm() + (robot.hand(0) - elbow).norm();
        robot
    }

    /// The shoulder: the origin of the arm's second joint, where the first two axes come nearest.
    fn shoulder(&self, side: usize) -> Vector3<f64> {
        self.frames.base_from_body[self.model.arms[side].joints[1] + 1].t
    }

    /// Where the hand grasps.
    fn hand(&self, side: usize) -> Vector3<f64> {
        let body = self.model.arms[side].joints[6] + 1;
        let center = self.model.payload[side].map_or_else(Vector3::zeros, |payload| payload.center);
        self.frames.base_from_body[body].transform_point(&center)
    }

    /// The middle of the capsules that the head's joints move.
    fn head(&self) -> Option<Vector3<f64>> {
        let body = self.model.head.as_ref()?.joints[1] + 1;
        let capsules: Vec<_> = self.model.capsules.iter().filter(|capsule| capsule.body == body).collect();
        let sum: Vector3<f64> = capsules.iter().map(|capsule| (capsule.a + capsule.b) / 2.0).sum();
        (!capsules.is_empty()).then(|| self.frames.base_from_body[body].transform_point(&(sum / capsules.len() as f64)))
    }

    fn distances(&mut self, q: &[f64; JOINTS_MAX], scale: f64) -> Distances {
        self.model.forward(q, &mut self.frames);
        let chest = self.middle + Vector3::x() * (CHEST_M * scale);
        let chest = self.frames.base_from_body[self.model.torso_body].transform_point(&chest);
        Distances::between([self.hand(0), self.hand(1)], self.head(), chest)
    }
}

/// Length of a person's stretched arm, m.
fn person_reach_m(frame: &Frame) -> f64 {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    let elbow = at(Smpl::LeftElbow);
    (elbow - at(Smpl::LeftShoulder)).norm() + (hands(frame)[0] - elbow).norm()
}

impl Contacts {
    fn add(&mut self, frame: &Frame, robot: &mut Robot<'_>, q: &[f64; JOINTS_MAX]) {
        let scale = robot.reach_m / person_reach_m(frame);
        let (person, robot) = (of_person(frame), robot.distances(q, scale));
        for side in 0..2 {
            if let (Some(person), Some(robot)) = (person.head, robot.head) {
                self.head.add(person[side], robot[side], scale);
            }
            self.chest.add(person.chest[side], robot.chest[side], scale);
        }
        self.hands.add(person.hands, robot.hands, scale);
    }
}

/// Measures the best postures for a motion, with limbs that are corrected by this weight from 0 to 1.
#[must_use]
pub fn postures(model: &Model, motion: &Motion, weight: f64) -> Contacts {
    let (mut robot, mut out) = (Robot::new(model), Contacts::default());
    for (frame, posture) in motion.frames.iter().zip(ground_truth_touching(model, motion, weight).q) {
        let mut q = model.home;
        for (arm, posture) in model.arms.iter().zip(posture) {
            arm.joints.iter().zip(posture).for_each(|(&joint, at)| q[joint] = at);
        }
        out.add(frame, &mut robot, &q);
    }
    out
}

/// Plays a motion through all stages, and measures the commands while the robot follows.
///
/// # Errors
/// Returns a sentence as error if the stages reject their settings, or stop.
pub fn commands(loaded: &Loaded, motion: &Motion) -> Result<Contacts, String> {
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::Rig };
    let mut offline = Offline::new(loaded, motion, options).map_err(|error| error.to_string())?;
    let (mut robot, mut out, mut people) = (Robot::new(&loaded.model), Contacts::default(), Vec::new());
    let delay_ns = (loaded.settings.retarget.following_delay_ms * 1e6) as u64;
    let end = offline.play(|tick| {
        people.extend(tick.moment.skeleton);
        let follows = tick.moment.control.as_ref().filter(|control| control.status.mode == Mode::Engaged as u32);
        let Some(command) = follows.and_then(|control| control.command) else { return };
        let shown = people.partition_point(|person| person.header.origin.plus_ns(delay_ns) <= deadline(command.k));
        if let Some(person) = shown.checked_sub(1).map(|i| &people[i]) {
            out.add(&Frame { positions: person.positions, ..Frame::ZERO }, &mut robot, &command.q);
        }
    });
    match end {
        OfflineEnd::Stopped(why) => Err(why),
        _ => Ok(out),
    }
}

/// Contacts of all motions, by name.
struct Table(Vec<(String, Contacts)>);

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mean = |head, errors: fn(&Contacts) -> Errors| {
            column([head, "mean cm"], 9, move |row: &Contacts| number(errors(row).mean_m().map(|m| 100.0 * m), 1))
        };
        let max = |errors: fn(&Contacts) -> Errors| {
            column(["", "max"], 6, move |row: &Contacts| {
                let errors = errors(row);
                number((errors.count > 0).then_some(100.0 * errors.max_m), 1)
            })
        };
        let columns = [
            mean("head", |row| row.head),
            max(|row| row.head),
            mean("chest", |row| row.chest),
            max(|row| row.chest),
            mean("hands", |row| row.hands),
            max(|row| row.hands),
        ];
        table::write(f, ("motion", 30), &columns, self.0.iter().map(|(name, row)| (name.as_str(), row)))
    }
}

/// Runs `eval --contacts`.
pub(crate) fn run(cli: &Cli) -> Result<(), EvalError> {
    let loaded = config::load(&cli.config, Overrides::robot(cli.robot.as_ref()))?;
    let mut rows = Vec::new();
    for motion in &paper_motions() {
        let limbs = postures(&loaded.model, motion, 0.0);
        if limbs == Contacts::default() {
            continue;
        }
        let touching = postures(&loaded.model, motion, 1.0);
        let commanded =
            commands(&loaded, motion).map_err(|reason| EvalError::Play { name: motion.name.clone(), reason })?;
        for (what, contacts) in [("limbs alone", limbs), ("corrected", touching), ("commanded", commanded)] {
            rows.push((format!("{}, {what}", motion.name), contacts));
        }
    }
    let table = Table(rows);
    show(&table);
    let json: Map<_, _> = table.0.iter().map(|(name, row)| (name.clone(), json!(row))).collect();
    write_json(cli, &json.into())
}
