//! Contacts: does the robot's hand come as near to head, chest and other hand as the person's does?
//!
//! Distances d are those of surfaces. One of the person counts while it is below 0.2 m. With the lengths L of the stretched
//! arms, shoulder to the middle of the hand, the error of a frame is
//!
//! ```text
//! e = | d_robot - d_person L_robot / L_person |          m
//! ```
//!
//! Five robots are compared. Two are postures: the best one for the person's limbs alone, and the best one for limbs that are
//! corrected so that hands touch (`retarget::contact`). They do not move. The *optimum* is the best motion within the robot's
//! limits for the corrected limbs, and for the places of the hands where these touch. It looks ahead (`following::optimum`),
//! and is judged at the person's own instants. These three know no collisions. Two are commands, after all stages: all of
//! them, and those while the person's hands rest. Commands are compared with the person at the delay of the settings.

use crate::cli::Cli;
use crate::clips::Human;
use crate::following::optimum::optimum_touching;
use crate::following::{HandPath, NODE_S, Person, bounds_of};
use crate::run::{load, write_json};
use ::report::table::{self, column, number};
use ::report::{check_bounds, print};
use client::PlayOptions;
use config::Loaded;
use follow::solver::State;
use messages::{JOINTS_MAX, JointCommand, Mode, SMPL_JOINTS, Smpl, deadline};
use motion::{CalibrationMode, Frame, Motion};
use nalgebra::Vector3;
use poses::motions::paper_motions;
use poses::person::{hands, head};
use poses::trajectory::ground_truth_touching;
use retarget::ArmModel;
use retarget::contact::{CHEST_M, Correction, HALF_HAND_M, HEAD_M, Proportions};
use robot::{Capsule, Frames, Model, segment_distance};
use rt::{Exit, Failure};
use serde::Serialize;
use serde_json::{Map, json};
use std::fmt;
use world::{Offline, OfflineEnd};

/// Distance of the person's surfaces below which a contact counts, m: the length of a hand. Assumption.
const NEAR_M: f64 = 0.2;

/// Time for which a hand that rests has not moved, ns: longer than a hand of the robot is behind. Assumption.
const HELD_NS: u64 = 200_000_000;
/// Allowed multiples of the recorded speed, as for `replay`.
const SPEED: [f64; 2] = [0.1, 10.0];
/// Largest change of a distance of a hand that rests, m. Assumption.
const REST_M: f64 = 0.01;

/// Distances of surfaces, m. Below zero they intersect.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distances {
    /// Left and right hand to the head. `None` for a robot without a head.
    pub head: Option<[f64; 2]>,
    /// Left and right hand to the place of the chest before the middle between the shoulders.
    pub chest: [f64; 2],
    pub hands: f64,
}

/// Errors of one motion: the sum over the frames and hands in contact, their number, and the largest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    pub sum_m: f64,
    pub count: u32,
    pub max_m: f64,
}

impl Errors {
    fn add(&mut self, person_m: f64, error_m: f64) {
        if person_m < NEAR_M {
            let error_m = error_m.abs();
            (self.sum_m, self.count, self.max_m) = (self.sum_m + error_m, self.count + 1, self.max_m.max(error_m));
        }
    }

    pub fn mean_m(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum_m / f64::from(self.count))
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Contacts {
    pub head: Errors,
    pub chest: Errors,
    pub hands: Errors,
}

pub fn of_person(frame: &Frame) -> Distances {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    let chest = (at(Smpl::LeftShoulder) + at(Smpl::RightShoulder)) / 2.0 + Vector3::x() * CHEST_M;
    let (hands, head) = (hands(frame), head(frame));
    let apart = |a: Vector3<f64>, b: Vector3<f64>, surfaces_m: f64| ((a - b).norm() - surfaces_m).max(0.0);
    Distances {
        head: Some(hands.map(|hand| apart(hand, head, HEAD_M + HALF_HAND_M))),
        chest: hands.map(|hand| apart(hand, chest, HALF_HAND_M)),
        hands: apart(hands[0], hands[1], 2.0 * HALF_HAND_M),
    }
}

struct Robot<'a> {
    model: &'a Model,
    frames: Frames,
    reach_m: f64,
    /// The place of the chest, in the frame of the torso's body, m.
    chest: Vector3<f64>,
}

impl<'a> Robot<'a> {
    fn new(model: &'a Model) -> Self {
        let mut frames = Frames::default();
        model.forward(&model.home, &mut frames);
        let proportions = Proportions::from_model(model);
        // The middle between the shoulders: the origins of the arms' second joints, where the first two axes come nearest.
        let shoulders = [0, 1].map(|side| frames.base_from_body[model.arms[side].range().start + 1 + 1].t);
        let torso = &frames.base_from_body[model.torso_body];
        let middle = torso.r.transpose() * ((shoulders[0] + shoulders[1]) / 2.0 - torso.t);
        let chest = middle + Vector3::x() * proportions.chest_m;
        Self { model, frames, reach_m: proportions.reach_m, chest }
    }

    fn distances(&mut self, q: &[f64; JOINTS_MAX]) -> Distances {
        self.model.forward(q, &mut self.frames);
        let chest = self.frames.base_from_body[self.model.torso_body].transform_point(&self.chest);
        let hands = [0, 1].map(|side| self.model.arms[side].hand_body());
        let head = self.model.head.as_ref().map(|head| head.joints[1].unwrap_or(0) + 1);
        let of = |body: usize| self.model.capsules.iter().filter(move |capsule| capsule.body == body);
        let apart = |hand: usize, other: [Vector3<f64>; 2], radius_m: f64| {
            let distance = |capsule: &Capsule| {
                let [a, b] = capsule.ends(&self.frames);
                segment_distance(&a, &b, &other[0], &other[1]).distance_m - capsule.radius_m - radius_m
            };
            of(hand).map(distance).fold(f64::INFINITY, f64::min)
        };
        let bodies = |hand: usize, other: usize| {
            of(other).map(|other| apart(hand, other.ends(&self.frames), other.radius_m)).fold(f64::INFINITY, f64::min)
        };
        Distances {
            head: head.map(|head| hands.map(|hand| bodies(hand, head))),
            chest: hands.map(|hand| apart(hand, [chest; 2], 0.0)),
            hands: bodies(hands[0], hands[1]),
        }
    }
}

fn person_reach_m(frame: &Frame) -> f64 {
    let at = |joint: Smpl| Vector3::from(frame.positions[joint as usize]).cast::<f64>();
    let elbow = at(Smpl::LeftElbow);
    (elbow - at(Smpl::LeftShoulder)).norm() + (hands(frame)[0] - elbow).norm()
}

/// Returns true if no distance of the hands has changed since `recent`.
fn rest(recent: impl Iterator<Item = Frame>, now: &Frame) -> bool {
    let now = of_person(now);
    recent.map(|then| of_person(&then)).all(|then| {
        let moved = |a: f64, b: f64| (a - b).abs() > REST_M;
        !moved(then.hands, now.hands) && then.chest.into_iter().zip(now.chest).all(|(a, b)| !moved(a, b))
    })
}

impl Contacts {
    fn add(&mut self, frame: &Frame, robot: &mut Robot<'_>, q: &[f64; JOINTS_MAX]) {
        let scale = robot.reach_m / person_reach_m(frame);
        let (person, robot) = (of_person(frame), robot.distances(q));
        for side in 0..2 {
            if let (Some(person), Some(robot)) = (person.head, robot.head) {
                self.head.add(person[side], robot[side] - person[side] * scale);
            }
            self.chest.add(person.chest[side], robot.chest[side] - person.chest[side] * scale);
        }
        self.hands.add(person.hands, robot.hands - person.hands * scale);
    }
}

/// Measures the best postures for a motion, with limbs that are corrected by this weight from 0 to 1.
pub fn postures(model: &Model, motion: &Motion, weight: f64) -> Contacts {
    let (mut robot, mut out) = (Robot::new(model), Contacts::default());
    for (frame, posture) in motion.frames.iter().zip(ground_truth_touching(model, motion, weight).q) {
        let mut q = model.home;
        for (arm, posture) in model.arms.iter().zip(posture) {
            arm.set_limbs(&posture, &mut q);
        }
        out.add(frame, &mut robot, &q);
    }
    out
}

#[derive(Clone, Debug, Default)]
pub struct Played {
    person: Person,
    /// Commands while the robot follows, one list for each uninterrupted time.
    spans: Vec<Vec<JointCommand>>,
    delay_ns: u64,
}

impl Played {
    pub fn new(loaded: &Loaded, motion: &Motion, speed: f64) -> Result<Self, String> {
        let options = PlayOptions { speed, looped: false, calibration: CalibrationMode::Rig };
        let mut offline = Offline::new(loaded, motion, options).map_err(|error| error.to_string())?;
        let delay_ns = (loaded.settings.retarget.following_delay_ms * 1e6) as u64;
        let (mut played, mut follows) = (Self { delay_ns, ..Self::default() }, false);
        let end = offline.play(|tick| {
            tick.moment.skeleton.iter().for_each(|skeleton| played.person.add(skeleton));
            let control = tick.moment.control.as_ref();
            let engaged = control.filter(|control| control.status.mode == Mode::Engaged as u32);
            let command = engaged.and_then(|control| control.command);
            if command.is_some() && !follows {
                played.spans.push(Vec::new());
            }
            follows = command.is_some();
            if let Some(span) = played.spans.last_mut() {
                span.extend(command);
            }
        });
        match end {
            OfflineEnd::Stopped(why) => Err(why),
            _ => Ok(played),
        }
    }

    /// Measures the commands at the delay of the settings: all of them, and those for hands that rest.
    pub fn commands(&self, model: &Model) -> [Contacts; 2] {
        let (mut robot, mut out) = (Robot::new(model), [Contacts::default(); 2]);
        let people: Vec<_> = self.person.seen().map(|(at, positions)| (at, frame(positions))).collect();
        for (i, (at, person)) in people.iter().enumerate() {
            let due = |command: &&JointCommand| deadline(command.k) >= at.plus_ns(self.delay_ns);
            let span = self.spans.iter().find(|span| span.last().as_ref().is_some_and(due));
            let Some(span) = span.filter(|span| !span.first().as_ref().is_some_and(due)) else { continue };
            let Some(command) = span.iter().find(due) else { continue };
            out[0].add(person, &mut robot, &command.q);
            let recent = people[..i].iter().rev().take_while(|(then, _)| at.since(*then) <= HELD_NS);
            if rest(recent.map(|(_, then)| *then), person) {
                out[1].add(person, &mut robot, &command.q);
            }
        }
        out
    }

    /// Measures the best motions for the corrected limbs and hands, at the person's own instants: those that look ahead, within
    /// the positions, speeds and accelerations in force, from where the robot began to follow. They know no collisions.
    pub fn optimum(&self, model: &Model) -> Contacts {
        let (arm, bounds) = (ArmModel::from_model(model), bounds_of(model));
        let proportions = Proportions::from_model(model);
        let (goal, hands) = self.person.touching(&arm, &Correction { robot: proportions, weight: 1.0 });
        let (mut robot, mut out) = (Robot::new(model), Contacts::default());
        for span in &self.spans {
            let (Some(first), Some(last)) = (span.first(), span.last()) else { continue };
            let (from, to) = (deadline(first.k), deadline(last.k));
            let nodes = (0..).map(|k| from.plus_ns(k * (NODE_S * 1e9) as u64)).take_while(|at| *at <= to);
            let nodes: Vec<_> = nodes.collect();
            let path: Vec<Human> = nodes.iter().filter_map(|at| goal.at(*at)).collect();
            let motions = [0, 1].map(|side| {
                let own = |all: &[f64; messages::JOINTS_MAX]| {
                    let arm = &model.arms[side];
                    arm.mirrored(&arm.limb_values(all)).into()
                };
                let start = State { q: own(&first.q), v: own(&first.v) };
                let path: Vec<_> = path.iter().map(|limbs| limbs[side]).collect();
                let to: Vec<_> = nodes.iter().skip(1).map(|at| hands.at(*at, side)).collect();
                let hand = HandPath { chain: &proportions.chain, to: &to };
                (start, optimum_touching(&arm, &bounds[side], &path, start, hand))
            });
            for (at, positions) in self.person.seen().filter(|(at, _)| (from..to).contains(at)) {
                let mut q = model.home;
                for (arm, (start, motion)) in model.arms.iter().zip(&motions) {
                    let Some(state) = motion.at(*start, at.since(from) as f64 * 1e-9) else { continue };
                    let own = arm.mirrored(&state.q.into());
                    arm.set_limbs(&own, &mut q);
                }
                out.add(&frame(positions), &mut robot, &q);
            }
        }
        out
    }
}

fn frame(positions: &[[f32; 3]; SMPL_JOINTS]) -> Frame {
    Frame { positions: *positions, ..Frame::ZERO }
}

struct Table {
    rows: Vec<(String, Contacts)>,
    measured: String,
}

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
            mean("other hand", |row| row.hands),
            max(|row| row.hands),
        ];
        table::write(f, ("motion", 30), &columns, self.rows.iter().map(|(name, row)| (name.as_str(), row)))?;
        writeln!(f, "{}", self.measured)
    }
}

pub(crate) fn run(cli: &Cli) -> Result<(), Failure> {
    check_bounds("--speed", cli.speed, SPEED)?;
    let loaded = load(cli)?;
    let mut rows = Vec::new();
    for motion in &paper_motions() {
        let limbs = postures(&loaded.model, motion, 0.0);
        if limbs == Contacts::default() {
            continue;
        }
        let touching = postures(&loaded.model, motion, 1.0);
        let played = Played::new(&loaded, motion, cli.speed)
            .map_err(|reason| Failure::new(Exit::Config, format!("{}: {reason}", motion.name)))?;
        let [commanded, held] = played.commands(&loaded.model);
        let optimum = played.optimum(&loaded.model);
        for (what, contacts) in [
            ("limbs alone", limbs),
            ("corrected", touching),
            ("optimum", optimum),
            ("commanded", commanded),
            ("held", held),
        ] {
            rows.push((format!("{}, {what}", motion.name), contacts));
        }
    }
    let measured = format!(
        "{}, contact_weight {}, speed {}, settings {}\n\
         distance of the hands' surfaces from head, chest and each other, against the person's by the arms' lengths, while that\n\
         is below 20 cm; limbs alone and corrected: best postures; optimum: best motion, which looks ahead; held: at rest for 0.2 s",
        loaded.model.name,
        loaded.settings.retarget.contact_weight,
        cli.speed,
        cli.config.display()
    );
    let table = Table { rows, measured };
    print(&table);
    let json: Map<_, _> = table.rows.iter().map(|(name, row)| (name.clone(), json!(row))).collect();
    write_json(cli, &json.into())
}
