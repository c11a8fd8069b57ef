//! A first robot file from a URDF alone: what can be found, what is guessed, and what a person must decide.

mod arm;
mod tree;
mod write;

use crate::error::RobotError;
use crate::model::Source;
use crate::urdf::Tree;
use arm::{ArmChain, Posture};
use messages::{ARM_JOINTS, JOINTS_MAX};
use std::collections::BTreeMap;
use urdf_rs::JointType;

/// A joint's range is above this, rad or m: twice the draft's margin at the home posture, and some room.
const ROOM: f64 = 0.01;

/// A first robot file without collision capsules, and the notes for the person who completes it.
#[derive(Clone, Debug)]
pub struct Draft {
    /// The robot file. It needs capsules before it loads: `collision fit` writes them.
    pub toml: String,
    /// Sentences on what was found or guessed.
    pub guesses: Vec<String>,
    /// Sentences on what a person must decide or check before the robot moves.
    pub decisions: Vec<String>,
}

/// The parts of a robot that a robot file names, as indices of the URDF's joints.
struct Found {
    torso_link: usize,
    body: Vec<usize>,
    arms: [[usize; ARM_JOINTS]; 2],
    held: BTreeMap<usize, f64>,
    reference: [Posture; 2],
    home: [[f64; ARM_JOINTS]; 2],
}

/// Drafts the robot file of a URDF: it finds the two arms, the torso and the body's joints, solves the T-pose and a
/// home posture, and proposes limits.
pub fn draft(urdf_name: &str, urdf_text: &str) -> Result<Draft, RobotError> {
    let tree = Tree::parse(urdf_name, urdf_text)?;
    let refuse = |key: &str, value: String, bound: &str| RobotError::value(urdf_name, key, value, bound);
    let Some((torso_link, arms)) = tree::find_arms(&tree, false) else {
        if let Some(joint) = endless_arm_joint(&tree) {
            let (file, joint, value) = (urdf_name.into(), joint.into(), "continuous".into());
            let bound = "an arm's joint must be revolute: give it that type and a range that its cables bear".into();
            return Err(RobotError::JointKind { file, joint, value, bound });
        }
        let bound =
            "two chains of seven revolute joints must hang on one link: a robot with other arms is not supported";
        return Err(refuse("arms", "none".into(), bound));
    };
    let body = tree::body_joints(&tree, torso_link, &arms);
    if body.len() + 2 * ARM_JOINTS > JOINTS_MAX {
        let bound = format!("at most {} body joints", JOINTS_MAX - 2 * ARM_JOINTS);
        return Err(refuse("body joints", body.len().to_string(), &bound));
    }
    check_limits(urdf_name, &tree, body.iter().chain(arms.iter().flatten()))?;
    let (mut guesses, mut decisions) = (Vec::new(), Vec::new());
    let held = held(&tree, &body, &arms);
    let chains = arms.each_ref().map(|joints| ArmChain::new(&tree, torso_link, joints));
    let [left, right] = [0, 1].map(|side| chains[side].reference(side));
    let right = right.mirrored_onto(&left);
    if left.off > arm::REACHED || right.off > arm::REACHED {
        decisions.push(format!(
            "The T-pose was not found (directions are {:.2} and {:.2} off): enter reference_rad by hand.",
            left.off, right.off
        ));
    }
    let home = chains[0].home(0);
    let signs = arm::signs(&left, &right, &chains);
    let home = [home, std::array::from_fn(|i| signs[i] * home[i])];
    let found = Found { torso_link, body, arms, held, reference: [left, right], home };
    notes(&tree, &found, &mut guesses, &mut decisions);
    Ok(Draft { toml: write::toml(urdf_name, &tree, &found), guesses, decisions })
}

/// Returns the first joint that turns without end, if two arms would be found with such joints.
fn endless_arm_joint(tree: &Tree) -> Option<&str> {
    let (_, arms) = tree::find_arms(tree, true)?;
    let mut joints = arms.into_iter().flatten().map(|joint| &tree.joints[joint]);
    joints.find(|joint| joint.kind == JointType::Continuous).map(|joint| joint.name.as_str())
}

/// Refuses limits that a model would refuse, and a range that is no wider than the draft's margins. Postures are solved
/// inside the ranges.
fn check_limits<'j>(file: &str, tree: &Tree, joints: impl Iterator<Item = &'j usize>) -> Result<(), RobotError> {
    let source = Source { toml: file, urdf: file };
    for joint in joints.map(|joint| &tree.joints[*joint]) {
        let limits = source.limits_of(joint)?;
        let range = limits.q_max - limits.q_min;
        if range <= ROOM {
            return Err(source.joint(file, &joint.name, "range", range, format!("must be above {ROOM}")));
        }
    }
    Ok(())
}

/// Positions of the movable joints that no list names: zero, or the nearest end of the range.
fn held(tree: &Tree, body: &[usize], arms: &[[usize; ARM_JOINTS]; 2]) -> BTreeMap<usize, f64> {
    let commanded = |joint: &usize| body.contains(joint) || arms.iter().flatten().any(|arm| arm == joint);
    let others = (0..tree.joints.len()).filter(|joint| !commanded(joint));
    let movable = others.filter(|joint| tree.joints[*joint].kind != JointType::Fixed);
    movable
        .map(|joint| {
            let (kind, limit) = (&tree.joints[joint].kind, &tree.joints[joint].limit);
            let limited = matches!(kind, JointType::Revolute | JointType::Prismatic) && limit.lower <= limit.upper;
            (joint, if limited { 0.0_f64.clamp(limit.lower, limit.upper) } else { 0.0 })
        })
        .collect()
}

fn notes(tree: &Tree, found: &Found, guesses: &mut Vec<String>, decisions: &mut Vec<String>) {
    let name = |joint: &usize| tree.joints[*joint].name.as_str();
    let list = |joints: &[usize]| joints.iter().map(name).collect::<Vec<_>>().join(", ");
    let torso = &tree.links[found.torso_link];
    for (side, arm) in ["left", "right"].into_iter().zip(&found.arms) {
        guesses.push(format!("The {side} arm is {}: it begins on this side of `{torso}`.", list(arm)));
    }
    guesses.push(match found.body.as_slice() {
        [] => "No joint moves the torso or a head.".to_owned(),
        body => format!("Body joints that keep a posture: {}.", list(body)),
    });
    if !found.held.is_empty() {
        let held: Vec<usize> = found.held.keys().copied().collect();
        guesses.push(format!("Held where they stand, never commanded: {}.", list(&held)));
    }
    let endless: Vec<usize> =
        found.held.keys().copied().filter(|j| tree.joints[*j].kind == JointType::Continuous).collect();
    if !endless.is_empty() {
        decisions.push(format!(
            "These joints turn without end (continuous): {}. They are taken to stand at 0 and are never commanded. To command \
             one, make it revolute with a range.",
            list(&endless)
        ));
    }
    guesses.push("The T-pose (reference_rad) and the home posture were solved from the axes.".to_owned());
    decisions.extend([
        format!("`{torso}` must have x forward, y left and z up: limb rotations are in its frame."),
        "Accelerations, jerks and reduced speeds are assumptions: ask the manufacturer, then see `collision limits`."
            .to_owned(),
        "Payload centres are where the hands grasp: they are zero until you enter them.".to_owned(),
        "One controller has all joints: name the robot's own under [[controllers]].".to_owned(),
    ]);
}
