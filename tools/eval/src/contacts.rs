//! Contacts: does the robot's hand come as near to head, chest and other hand as the person's does?
//!
//! A distance of the person counts while it is below 0.3 m. With the lengths L of the stretched arms, shoulder to the
//! middle of the hand, the error of a frame is
//!
//! ```text
//! e = | d_robot - d_person L_robot / L_person |          m
//! ```
//!
//! The robot takes the best posture that its arms can take for the person's limbs (`poses::trajectory`). So this is the
//! error of the proportions, before anything follows.

use crate::cli::Cli;
use crate::error::EvalError;
use crate::run::{show, write_json};
use crate::table::{self, column, number};
use messages::Smpl;
use motion::{Frame, Motion};
use nalgebra::Vector3;
use poses::motions::paper_motions;
use poses::person::{hands, head};
use poses::trajectory::ground_truth;
use robot::{Frames, Model};
use serde::Serialize;
use serde_json::{Map, json};
use std::fmt;
use train::files::read_model;

/// Distance of the person's below which a contact counts, m: a box that both hands hold. Assumption.
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
}

impl<'a> Robot<'a> {
    fn new(model: &'a Model) -> Self {
        let mut robot = Self { model, frames: Frames::default(), reach_m: 0.0 };
        model.forward(&model.home, &mut robot.frames);
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

    fn distances(&mut self, posture: &[[f64; 5]; 2], scale: f64) -> Distances {
        let mut q = self.model.home;
        for (side, arm) in self.model.arms.iter().enumerate() {
            for (i, joint) in arm.joints.iter().take(5).enumerate() {
                q[*joint] = posture[side][i];
            }
        }
        self.model.forward(&q, &mut self.frames);
        let forward = self.frames.base_from_body[self.model.torso_body].r * Vector3::x();
        let chest = (self.shoulder(0) + self.shoulder(1)) / 2.0 + forward * (CHEST_M * scale);
        Distances::between([self.hand(0), self.hand(1)], self.head(), chest)
    }
}

/// Length of a person's stretched arm, m.
fn person_reach_m(frame: &Frame) -> f64 {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    let elbow = at(Smpl::LeftElbow);
    (elbow - at(Smpl::LeftShoulder)).norm() + (hands(frame)[0] - elbow).norm()
}

/// Measures a motion.
#[must_use]
pub fn measure(model: &Model, motion: &Motion) -> Contacts {
    let (mut robot, mut out) = (Robot::new(model), Contacts::default());
    for (frame, posture) in motion.frames.iter().zip(ground_truth(model, motion).q) {
        let scale = robot.reach_m / person_reach_m(frame);
        let (person, robot) = (of_person(frame), robot.distances(&posture, scale));
        for side in 0..2 {
            if let (Some(person), Some(robot)) = (person.head, robot.head) {
                out.head.add(person[side], robot[side], scale);
            }
            out.chest.add(person.chest[side], robot.chest[side], scale);
        }
        out.hands.add(person.hands, robot.hands, scale);
    }
    out
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
        table::write(f, ("motion", 18), &columns, self.0.iter().map(|(name, row)| (name.as_str(), row)))
    }
}

/// Runs `eval --contacts`.
pub(crate) fn run(cli: &Cli) -> Result<(), EvalError> {
    let model = read_model(&cli.robot().shipped_file()?)?;
    let rows = paper_motions().iter().map(|motion| (motion.name.clone(), measure(&model, motion))).collect();
    let table = Table(rows);
    show(&table);
    let json: Map<_, _> = table.0.iter().map(|(name, row)| (name.clone(), json!(row))).collect();
    write_json(cli, &json.into())
}
