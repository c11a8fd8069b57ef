//! An invented two-armed robot, and what `judge` needs to attack the stage and to judge it.
#![allow(dead_code, reason = "each test file uses its own part")]
#![allow(unreachable_pub, reason = "an example includes this file too")]

use judge::{Attacker, Robot, TreeJoint};
use messages::{ALL_JOINTS, JOINTS_MAX};
use nalgebra::{Matrix3, Vector3};
use robot::{JointLimits, Model};
use std::path::Path;
use wbc::chain::{ArmCounts, KinematicChain, KinematicLink, Placement};
use wbc::dynamics::Mass;
use wbc::geometry::BodyCapsule;
use wbc::interval::Bounds;
use wbc::{Config, Controllers, Input, Options, Parts, Permit, Target, Tasks};

/// The arms of an invented robot.
pub const SEVEN_JOINTS: ArmCounts = ArmCounts { joints: 7, to_elbow: 4 };

/// The robot resembles no product. It has the proportions of a person on a column, and d_min is 10 mm.
pub const D_MIN_M: f64 = 0.01;

/// Joint as (parent body, origin in the parent, axis, prismatic). All frames are parallel at zero.
pub type JointRow = (usize, [f64; 3], [f64; 3], bool);

/// Joints of the invented robot.
pub const JOINTS: usize = 17;

/// The tree: a lift, two head joints, and two mirrored arms whose zero is a T-pose.
pub fn joint_rows() -> [JointRow; JOINTS] {
    let mut rows = [(0, [0.0; 3], [0.0, 0.0, 1.0], false); JOINTS];
    rows[0] = (0, [-0.05, 0.0, 0.8], [0.0, 0.0, 1.0], true);
    rows[1] = (1, [0.18, 0.0, 0.0], [0.0, 0.0, 1.0], false);
    rows[2] = (2, [0.0, 0.0, 0.1], [0.0, 1.0, 0.0], false);
    let arm: [([f64; 3], [f64; 3]); 7] = [
        ([0.03, 0.2, -0.16], [0.0, 0.0, -1.0]),
        ([0.0, 0.12, 0.02], [-1.0, 0.0, 0.0]),
        ([0.0, 0.09, 0.0], [0.0, 1.0, 0.0]),
        ([0.02, 0.22, 0.02], [0.0, 0.0, -1.0]),
        ([-0.02, 0.16, -0.02], [0.0, -1.0, 0.0]),
        ([0.0, 0.15, 0.0], [1.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    ];
    for (i, (origin, axis)) in arm.into_iter().enumerate() {
        let parent = |first: usize| if i == 0 { 1 } else { first + i };
        rows[3 + i] = (parent(3), origin, axis, false);
        // A mirror image turns the other way, because the axis is an axial vector.
        let (mirrored, turned) = ([origin[0], -origin[1], origin[2]], [-axis[0], axis[1], -axis[2]]);
        rows[10 + i] = (parent(10), mirrored, turned, false);
    }
    rows
}

/// Limits in joint order.
pub fn limits() -> [Bounds; JOINTS_MAX] {
    let bounds = |q_min, q_max, v_max, a_max, j_max| Bounds { q_min, q_max, v_max, a_max, brake: a_max, j_max };
    let arm = [
        bounds(-1.1, 1.5, 1.95, 8.0, 320.0),
        bounds(-1.1, 1.5, 1.95, 8.0, 320.0),
        bounds(-0.7, 3.8, 2.35, 8.0, 320.0),
        bounds(-0.3, 2.3, 2.35, 8.0, 320.0),
        bounds(-2.0, 2.0, 1.95, 10.0, 400.0),
        bounds(-1.4, 1.4, 1.76, 10.0, 400.0),
        bounds(-2.0, 2.0, 1.76, 10.0, 400.0),
    ];
    let head = bounds(-1.0, 0.8, 3.0, 10.0, 400.0);
    let mut all = [bounds(0.0, 0.35, 0.07, 0.3, 12.0); JOINTS_MAX];
    all[1..3].fill(head);
    all[3..10].copy_from_slice(&arm);
    all[10..JOINTS].copy_from_slice(&arm);
    all
}

/// A posture in which both arms hang forward, clear of everything.
pub fn home() -> [f64; JOINTS_MAX] {
    let arm = [0.2, 0.6, 1.0, 0.9, 0.0, 0.0, 0.0];
    let mut q = [0.0; JOINTS_MAX];
    q[0] = 0.15;
    q[3..10].copy_from_slice(&arm);
    q[10..JOINTS].copy_from_slice(&arm);
    q
}

/// Capsules as (body, a, b, radius).
pub fn capsules() -> Vec<BodyCapsule> {
    let capsule = |body, a: [f64; 3], b: [f64; 3], radius_m| BodyCapsule { body, a: a.into(), b: b.into(), radius_m };
    let mut all = vec![
        capsule(0, [-0.1, -0.15, 0.15], [-0.1, 0.15, 0.15], 0.16),
        capsule(0, [0.1, -0.15, 0.15], [0.1, 0.15, 0.15], 0.16),
        capsule(0, [-0.06, 0.0, 0.2], [-0.06, 0.0, 0.65], 0.17),
        capsule(1, [0.0, 0.0, -0.4], [0.0, 0.0, 0.0], 0.14),
        capsule(1, [0.06, -0.09, -0.12], [0.06, 0.09, -0.12], 0.12),
        capsule(1, [0.03, -0.15, -0.16], [0.03, 0.15, -0.16], 0.07),
        capsule(2, [0.0, 0.0, 0.0], [0.0, 0.0, 0.08], 0.07),
        capsule(3, [0.0, -0.03, 0.08], [0.0, 0.03, 0.08], 0.11),
    ];
    for (first, s) in [(4, 1.0), (11, -1.0)] {
        all.extend([
            capsule(first, [0.0, 0.0, 0.0], [0.0, 0.1 * s, 0.0], 0.06),
            capsule(first + 1, [0.0, 0.0, 0.0], [0.0, 0.08 * s, 0.0], 0.06),
            capsule(first + 2, [0.0, 0.04 * s, 0.0], [0.02, 0.21 * s, 0.02], 0.055),
            capsule(first + 3, [0.0, 0.0, 0.0], [-0.02, 0.15 * s, -0.02], 0.055),
            capsule(first + 4, [0.0, 0.03 * s, 0.0], [0.0, 0.13 * s, 0.0], 0.05),
            capsule(first + 5, [0.0, 0.0, 0.0], [0.0, 0.01 * s, 0.0], 0.05),
            capsule(first + 6, [0.0, 0.08 * s, 0.02], [0.02, 0.15 * s, 0.0], 0.055),
            capsule(first + 6, [0.0, 0.15 * s, 0.0], [-0.02, 0.2 * s, 0.0], 0.05),
        ]);
    }
    all
}

/// All pairs except those of bodies at most two joints apart, whose capsules touch by construction.
pub fn pairs(capsules: &[BodyCapsule]) -> Vec<[usize; 2]> {
    let rows = joint_rows();
    let up = |body: usize| if body == 0 { 0 } else { rows[body - 1].0 };
    let mut all = Vec::new();
    for i in 0..capsules.len() {
        for k in i + 1..capsules.len() {
            let (a, b) = (capsules[i].body, capsules[k].body);
            let near = |a: usize, b: usize| a == b || up(b) == a || up(up(b)) == a;
            let shoulder = a <= 1 && (b == 6 || b == 13);
            let torso_head = a <= 3 && b <= 3;
            if !(near(a, b) || near(b, a) || shoulder || torso_head) {
                all.push([i, k]);
            }
        }
    }
    all
}

/// The tree in the form that the crate uses.
pub fn chain() -> KinematicChain {
    let limits = limits();
    let link = |j: usize| {
        let (parent, origin, axis, prismatic) = joint_rows()[j];
        KinematicLink {
            parent,
            parent_from_body: Placement { r: Matrix3::identity(), t: Vector3::from(origin) },
            axis: Vector3::from(axis),
            prismatic,
            stroke: limits[j].q_min.abs().max(limits[j].q_max.abs()),
        }
    };
    KinematicChain::new(&(0..JOINTS).map(link).collect::<Vec<_>>(), SEVEN_JOINTS).expect("a tree in order")
}

/// The robot's parts.
pub fn parts() -> Parts {
    let capsules = capsules();
    let pairs = pairs(&capsules);
    Parts {
        chain: chain(),
        controllers: Controllers::new([1, 0b110, 0x7f << 3, 0x7f << 10]),
        limits: limits(),
        home: home(),
        capsules,
        pairs,
        obstacles: Vec::new(),
        d_min_m: D_MIN_M,
        tasks: Tasks { joint_weight: [1.0; JOINTS_MAX], limb_weight: 0.0, limb_bodies: [[0; 2]; 2] },
        masses: [Mass::default(); JOINTS_MAX + 1],
        payload: [robot::Payload::EMPTY; 2],
        effort_max: [f64::INFINITY; JOINTS_MAX],
        stop_time_max_s: 0.5,
    }
}

/// The robot's configuration.
pub fn config(options: Options) -> Config {
    Config::from_parts(parts(), options).expect("a valid robot")
}

/// The invented robot as its judge knows it.
pub fn made_up() -> Robot {
    let tree = joint_rows()
        .into_iter()
        .map(|(parent, origin, axis, prismatic)| TreeJoint { parent, origin, axis, prismatic })
        .collect();
    let limits = limits().map(|Bounds { q_min, q_max, v_max, a_max, j_max, .. }| JointLimits {
        q_min,
        q_max,
        v_max,
        a_max,
        j_max,
        effort_max: f64::INFINITY,
    });
    let all = capsules();
    let pairs = pairs(&all);
    let capsules = all.into_iter().map(|c| (c.body, [c.a, c.b], c.radius_m));
    Robot::invented(tree, limits, home(), D_MIN_M, capsules, pairs)
}

/// The configuration for the invented robot, or for one of a model.
pub fn config_of(robot: &Robot, options: Options) -> Config {
    robot.model().map_or_else(|| config(options), |model| Config::new(model, options).expect("a valid robot"))
}

/// The shipped robot.
pub fn shipped() -> Model {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots");
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).expect("the shipped robot");
    let (toml, urdf) = (text("tiago_dual.toml"), text("tiago_dual.urdf"));
    Model::from_text("tiago_dual.toml", &toml, "tiago_dual.urdf", &urdf).expect("the shipped robot")
}

/// The input of tick `k` that follows a person who stands at `q`, at full speed.
pub fn towards(k: u64, q: &[f64; JOINTS_MAX]) -> Input<'_> {
    let target = Target { q, dq: &[0.0; JOINTS_MAX], ddq: &[0.0; JOINTS_MAX], valid_mask: ALL_JOINTS };
    Input { k, target: Some(target), permit: Permit::Follow { speed_scale: 1.0 } }
}

/// The input of tick `k` that the attacker gives.
pub fn input<'a>(k: u64, attacker: &'a Attacker<'_>) -> Input<'a> {
    let Attacker { q, dq, valid_mask, speed_scale, .. } = attacker;
    let target = valid_mask.map(|valid_mask| Target { q, dq, ddq: &[0.0; JOINTS_MAX], valid_mask });
    Input { k, target, permit: speed_scale.map_or(Permit::Stop, |speed_scale| Permit::Follow { speed_scale }) }
}
