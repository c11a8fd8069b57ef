//! The text of a draft.

use super::Found;
use super::limits::{Load, Posture};
use crate::pose::rpy_of;
use crate::urdf::Tree;
use nalgebra::Matrix3;
use std::fmt::Write;
use urdf_rs::JointType;

/// Largest proposed acceleration and jerk of an arm, rad/s^2 and rad/s^3. Assumption: those of TIAGo++'s robot file.
const ARM: [f64; 2] = [10.0, 400.0];
/// The same for a body joint that turns. Assumption: the body only keeps a posture.
const BODY: [f64; 2] = [3.0, 100.0];
/// The same for one that slides, m/s^2 and m/s^3. Assumption: those of TIAGo++'s lift.
const LIFT: [f64; 2] = [0.15, 12.0];
/// Longest proposed stop of an arm or a turning body joint, s, and that of a lift.
const STOP_S: f64 = 0.3;
const LIFT_STOP_S: f64 = 0.48;
/// Share of the URDF's speed that a draft proposes. Assumption: the rest is for the drive to catch up.
const SPEED_SHARE: f64 = 0.93;
/// Half of the range that a draft leaves to a joint that can turn farther than once round, and the room that T-pose and home
/// have in it. Assumptions.
const HALF_TURN_RAD: f64 = 3.1;
const HALF_TURN_ROOM_RAD: f64 = 0.3;
/// Margin inside the URDF's range. Assumption: those of TIAGo++'s robot file.
const MARGIN_RAD: f64 = 0.02;
const MARGIN_M: f64 = 0.002;

struct Group {
    name: String,
    joints: Vec<usize>,
    slides: bool,
    limits: [f64; 2],
    stop_s: f64,
}

/// Writes the robot file of what was found. `urdf_name` is a file in the same folder.
pub(super) fn toml(urdf_name: &str, tree: &Tree, found: &Found) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "# A first draft from the URDF alone. Read every line before the robot moves. The unit is the last word of a key.\n\n\
         format = 2\nname = {}\nurdf = {}\nbase_link = {}\n\
         base_height_m = {:?}   # decide: its height above the floor\ntorso_link = {}   # {}\n\
         # Commanded joints that belong to no arm. They keep the home posture.\nbody_joints = {}\n\n",
        quoted(&tree.name),
        quoted(urdf_name),
        quoted(&tree.links[tree.root]),
        found.base_height_m,
        quoted(&tree.links[found.torso_link]),
        turn(found),
        list(tree, &found.body),
    );
    held(&mut out, tree, found);
    out.push_str(
        "# The reference is the T-pose: both arms straight out to the sides, elbow flexion pointing forward.\n",
    );
    if found.unmirrored.is_some() {
        out.push_str("[arms]\nmirrored = false   # decide: each arm has its own geometry and weights\n\n");
    }
    let limbs = found.shape.upper + found.shape.fore;
    for (side, joints) in found.arms.iter().enumerate() {
        let link = |i: usize| &tree.links[tree.joints[joints[i]].child];
        let _ = write!(
            out,
            "[arms.{}]\njoints = {}\nupper = {}\nfore = {}\nreference_rad = {:?}\n\n",
            ["left", "right"][side],
            list(tree, joints),
            quoted(link(found.shape.upper - 1)),
            quoted(link(limbs - 1)),
            &found.reference[side].q[..limbs],
        );
    }
    out.push_str("[limits]\nstop_time_max_ms = 500.0\n\n");
    let arms = found.arms.iter().zip(&found.home);
    let at_home = arms.flat_map(|(joints, q)| joints.iter().copied().zip(*q)).collect();
    for group in groups(tree, found).iter().filter(|group| !group.joints.is_empty()) {
        write_group(&mut out, tree, group, &at_home);
    }
    for (side, grasp) in ["left", "right"].into_iter().zip(found.grasp) {
        let _ =
            write!(out, "[payload.{side}]\nmass_kg = 0.0\ncentre_m = {grasp:?}   # decide: where the hand grasps\n\n");
    }
    supply(&mut out, tree, found);
    tighten(&mut out, tree, found);
    home(&mut out, tree, found);
    out.push_str("[tasks]\nlimb_orientation_weight = 1.0\n\n# The wrist turns no limb of a person, so it gives way first.\n[tasks.joint_weight]\n");
    for joint in found.arms.iter().flat_map(|arm| &arm[limbs..]) {
        let _ = writeln!(out, "{} = 0.01", key(&tree.joints[*joint].name));
    }
    out.push_str(
        "\n[collision]\nclearance_min_mm = 10.0                     # commands are certified at this distance\n\
         clearance_measured_min_mm = 3.0             # a measured posture closer than this is a fault\n\n\
         # Below this line: written by `collision fit`.\n",
    );
    out
}

/// The comment after the torso's link, with the line that turns its frame if it must be turned.
fn turn(found: &Found) -> String {
    if found.link_from_torso == Matrix3::identity() {
        return "must be x forward, y left, z up: the frame of the limb rotations".into();
    }
    let rpy = rpy_of(&found.link_from_torso).map(|angle| angle + 0.0);
    format!("is turned:\ntorso_rpy_rad = {rpy:?}   # into x forward, y left, z up: the frame of the limb rotations")
}

fn supply(out: &mut String, tree: &Tree, found: &Found) {
    for (at, one) in found.supplied.iter().enumerate() {
        let new = at == 0 || found.supplied[at - 1].joint != one.joint;
        if new {
            let _ = writeln!(out, "[supply.{}]", key(&tree.joints[one.joint].name));
        }
        let _ = writeln!(out, "{} = {:?}   # decide: the URDF says {}", one.key, one.value, one.stated);
        if found.supplied.get(at + 1).is_none_or(|next| next.joint != one.joint) {
            out.push('\n');
        }
    }
}

/// Narrows the ranges of arms' joints that turn farther than once round. A person's limb turns no joint so far, and an arm that
/// has turned once too often cannot go on.
fn tighten(out: &mut String, tree: &Tree, found: &Found) {
    for (joints, (home, reference)) in found.arms.iter().zip(found.home.iter().zip(&found.reference)) {
        for (joint, at) in joints.iter().zip(home.iter().zip(&reference.q)) {
            let limit = &tree.joints[*joint].limit;
            let needed = at.0.abs().max(at.1.abs()) + HALF_TURN_ROOM_RAD;
            let past = HALF_TURN_RAD + HALF_TURN_ROOM_RAD;
            if limit.lower < -past && limit.upper > past && needed < HALF_TURN_RAD {
                let _ = write!(
                    out,
                    "[tighten.{}]   # decide: the URDF's range is more than a turn\nposition_min_rad = {:?}\nposition_max_rad = {:?}\n\n",
                    key(&tree.joints[*joint].name),
                    -HALF_TURN_RAD,
                    HALF_TURN_RAD,
                );
            }
        }
    }
}

fn key(name: &str) -> String {
    let bare = !name.is_empty() && name.bytes().all(|c| c.is_ascii_alphanumeric() || c == b'_' || c == b'-');
    if bare { name.to_owned() } else { quoted(name) }
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

fn list(tree: &Tree, joints: &[usize]) -> String {
    let names: Vec<String> = joints.iter().map(|joint| quoted(&tree.joints[*joint].name)).collect();
    match names.len() {
        0..=3 => format!("[{}]", names.join(", ")),
        _ => format!("[\n    {},\n]", names.join(",\n    ")),
    }
}

fn held(out: &mut String, tree: &Tree, found: &Found) {
    for (table, slides) in [("held_rad", false), ("held_m", true)] {
        let of = |joint: &usize| (tree.joints[*joint].kind == JointType::Prismatic) == slides;
        let rows: Vec<_> = found.held.iter().filter(|(joint, _)| of(joint)).collect();
        if rows.is_empty() {
            continue;
        }
        let _ = write!(out, "# Movable joints that nothing commands, and where they stand.\n[{table}]\n");
        for (joint, position) in rows {
            let _ = writeln!(out, "{} = {position:?}", key(&tree.joints[*joint].name));
        }
        out.push('\n');
    }
}

fn groups(tree: &Tree, found: &Found) -> [Group; 4] {
    let slides = |joint: &usize| tree.joints[*joint].kind == JointType::Prismatic;
    let body = |wanted: bool| found.body.iter().copied().filter(|joint| slides(joint) == wanted).collect();
    let arms = |part: std::ops::Range<usize>| found.arms.iter().flat_map(|arm| arm[part.clone()].to_vec()).collect();
    let (count, elbow) = (found.shape.joints(), found.shape.upper);
    let turning = |name: String, joints, limits| Group { name, joints, slides: false, limits, stop_s: STOP_S };
    [
        Group { name: "lift".into(), joints: body(true), slides: true, limits: LIFT, stop_s: LIFT_STOP_S },
        turning("body".into(), body(false), BODY),
        turning(format!("arm_1_to_{}", elbow + 1), arms(0..elbow + 1), ARM),
        turning(format!("arm_{}_to_{count}", elbow + 2), arms(elbow + 1..count), ARM),
    ]
}

/// The speed is a share of the lowest of the group's in the URDF, or what stops in time if that is lower. The acceleration is
/// what the weakest joint can do at home.
fn write_group(out: &mut String, tree: &Tree, group: &Group, home: &Posture) {
    let limit = |joint: &usize| &tree.joints[*joint].limit;
    let lowest = |of: &dyn Fn(&usize) -> f64| group.joints.iter().map(of).fold(f64::INFINITY, f64::min);
    let possible = |joint: &usize| {
        let most = limit(joint).acceleration.min(limit(joint).deceleration).min(group.limits[0]);
        if group.slides { most } else { Load::new(tree, *joint, home).acceleration(limit(joint).effort, most) }
    };
    let a = lowest(&possible);
    let j = lowest(&|joint| limit(joint).jerk).min(group.limits[1]);
    let stops = (group.stop_s - a / j) * a;
    let speed_max = stops.min(SPEED_SHARE * lowest(&|joint| limit(joint).velocity));
    let speed_max = (speed_max * 1e3).floor() / 1e3;
    let (margin, speed, acceleration, jerk) = if group.slides {
        ("soft_margin_m", "velocity_max_m_per_s", "acceleration_max_m_per_s2", "jerk_max_m_per_s3")
    } else {
        ("soft_margin_rad", "velocity_max_rad_per_s", "acceleration_max_rad_per_s2", "jerk_max_rad_per_s3")
    };
    let width = margin_of(lowest(&|joint| limit(joint).upper - limit(joint).lower), group.slides);
    let source = if group.slides { "assumption" } else { "from effort and inertia, or an assumption" };
    let _ = write!(
        out,
        "[limits.groups.{}]\njoints = {}\n{margin} = {width:?}   # assumption\n\
         {speed} = {speed_max:?}   # chosen: a stop within {:.0} ms, and {SPEED_SHARE} of the URDF's\n\
         {acceleration} = {a:?}   # {source}\n{jerk} = {j:?}   # assumption\n\n",
        group.name,
        list(tree, &group.joints),
        group.stop_s * 1e3,
    );
}

/// The margin inside a range: less in a range that is narrow.
fn margin_of(range: f64, slides: bool) -> f64 {
    (if slides { MARGIN_M } else { MARGIN_RAD }).min((range * 125.0).floor() / 1e3)
}

fn home(out: &mut String, tree: &Tree, found: &Found) {
    let arms = found.arms.iter().zip(&found.home).flat_map(|(joints, q)| joints.iter().copied().zip(*q));
    let body = found.body.iter().map(|joint| {
        let limit = &tree.joints[*joint].limit;
        let slides = tree.joints[*joint].kind == JointType::Prismatic;
        // A lift stands high, so that hanging hands are far from the base.
        let q = if slides { limit.upper - 0.1 * (limit.upper - limit.lower) } else { 0.0 };
        let margin = if slides { MARGIN_M } else { MARGIN_RAD }.min((limit.upper - limit.lower) / 4.0);
        (*joint, q.clamp(limit.lower + margin, limit.upper - margin))
    });
    let rows: Vec<(usize, f64)> = body.chain(arms).collect();
    for (table, slides) in [("home_m", true), ("home_rad", false)] {
        let of = |joint: usize| (tree.joints[joint].kind == JointType::Prismatic) == slides;
        let mut rows = rows.iter().filter(|(joint, _)| of(*joint)).peekable();
        if rows.peek().is_none() {
            continue;
        }
        let _ = writeln!(out, "[{table}]");
        for (joint, q) in rows {
            let _ = writeln!(out, "{} = {:?}", key(&tree.joints[*joint].name), q + 0.0);
        }
        out.push('\n');
    }
}
