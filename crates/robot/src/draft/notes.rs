//! Sentences of a draft for the person who completes it.

use super::Found;
use super::arm::Posture;
use crate::arm::ArmShape;
use crate::urdf::Tree;
use nalgebra::Matrix3;
use urdf_rs::JointType;

/// Sentences on what was found or guessed, and on what a person must decide.
pub(super) fn notes(tree: &Tree, found: &Found) -> (Vec<String>, Vec<String>) {
    let (mut guesses, mut decisions) = (Vec::new(), Vec::new());
    let torso = &tree.links[found.torso_link];
    for (side, arm) in ["left", "right"].into_iter().zip(&found.arms) {
        guesses.push(format!(
            "The {side} arm is {}: its hand is on this side of `{torso}`, or its name says so.",
            list(tree, arm)
        ));
    }
    let (shape, can) = (found.shape, |part: &str| {
        format!("The {part} cannot turn about its own length. It is matched by its direction.")
    });
    guesses.push(format!(
        "Of an arm's joints {} turn the upper arm, {} the forearm and {} the hand.",
        shape.upper, shape.fore, shape.hand
    ));
    guesses.extend((shape.upper < ArmShape::MOST.upper).then(|| can("upper arm")));
    guesses.extend((shape.fore < ArmShape::MOST.fore).then(|| can("forearm")));
    guesses.push(match found.body.as_slice() {
        [] => "No joint moves the torso or a head.".to_owned(),
        body => format!("Body joints that keep a posture: {}.", list(tree, body)),
    });
    if !found.held.is_empty() {
        let held: Vec<usize> = found.held.keys().copied().collect();
        guesses.push(format!("Held where they stand, never commanded: {}.", list(tree, &held)));
    }
    guesses.push("The T-pose (reference_rad) and the home posture were solved from the axes.".to_owned());
    let endless: Vec<usize> =
        found.held.keys().copied().filter(|j| tree.joints[*j].kind == JointType::Continuous).collect();
    if !endless.is_empty() {
        decisions.push(format!(
            "These joints turn without end (continuous): {}. They are taken to stand at 0 and are never commanded. To command \
             one, give it a range under [supply].",
            list(tree, &endless)
        ));
    }
    let mut supplied: Vec<usize> = found.supplied.iter().map(|one| one.joint).collect();
    supplied.dedup();
    if !supplied.is_empty() {
        decisions.push(format!(
            "The URDF leaves out range, speed or effort of {}, or has a placeholder. What [supply] says of them is a guess.",
            list(tree, &supplied)
        ));
    }
    decisions.push(if found.link_from_torso == Matrix3::identity() {
        format!("`{torso}` must have x forward, y left and z up: limb rotations are in its frame.")
    } else {
        format!("torso_rpy_rad turns `{torso}` so that x is forward, y left and z up. Check it.")
    });
    decisions.extend(of_postures(found));
    decisions.extend(massless(tree, found));
    let head: Vec<usize> = found.body.iter().copied().filter(|joint| super::tree::is_head(tree, *joint)).collect();
    if head.len() >= 2 {
        decisions.push(format!(
            "To let two of {} turn the head as the person's, name them as head_joints.",
            list(tree, &head)
        ));
    }
    decisions.extend(always(tree, found));
    (guesses, decisions)
}

/// Decisions about arms that do not mirror, and about a T-pose outside of the ranges.
fn of_postures(found: &Found) -> impl Iterator<Item = String> {
    let unmirrored = found.unmirrored.as_ref().map(|why| {
        format!(
            "The arms do not mirror each other ({why}). So `mirrored = false`: each arm is solved and trained by itself. If \
             they should mirror, correct the URDF."
        )
    });
    let outside = found.reference.iter().map(|posture| posture.outside).fold(0.0, f64::max);
    let outside = (outside > 0.0).then(|| {
        format!(
            "The arms cannot be held straight out to the sides: that is {outside:.2} rad outside of their ranges. \
             reference_rad is the T-pose all the same. Check it."
        )
    });
    unmirrored.into_iter().chain(outside)
}

/// Decisions about every robot.
fn always(tree: &Tree, found: &Found) -> [String; 5] {
    [
        format!(
            "base_height_m = {} is the height of `{}` above the lowest link's origin, with all joints at zero: enter \
             its height above the floor.",
            found.base_height_m, tree.links[tree.root]
        ),
        format!(
            "The last joint of an arm, such as `{}`, must turn the whole hand: if it moves fingers, take it out of the arms.",
            tree.joints[found.arms[0][found.shape.joints() - 1]].name
        ),
        "Accelerations come from effort and inertia. Jerks and reduced speeds are assumptions: ask the manufacturer, then see \
         `collision limits`."
            .to_owned(),
        "Payload centres are where the hands grasp: they are zero until you enter them.".to_owned(),
        "One controller has all joints: name the robot's own under [[controllers]].".to_owned(),
    ]
}

/// Body joints for which the URDF has a placeholder.
pub(super) fn of_placeholders(tree: &Tree, joints: &[usize]) -> Option<String> {
    (!joints.is_empty()).then(|| {
        format!(
            "The URDF has a placeholder for range, speed or effort of {}: they are held. To command one, give its limits under [supply].",
            list(tree, joints)
        )
    })
}

/// Joints of longer chains that belong to no arm.
pub(super) fn of_window(tree: &Tree, chains: [&[usize]; 2], taken: std::ops::Range<usize>) -> Option<String> {
    let outside = |(i, joint): (usize, &usize)| (!taken.contains(&i)).then_some(*joint);
    let others: Vec<usize> = chains.iter().flat_map(|chain| chain.iter().enumerate().filter_map(outside)).collect();
    (!others.is_empty()).then(|| {
        let others = list(tree, &others);
        format!(
            "The arms have more joints than are taken. {others} are held: check that the others are the right ones."
        )
    })
}

/// A T-pose that does not exist.
pub(super) fn of_t_pose(tree: &Tree, found: &Found) -> Option<String> {
    let mut sides = ["left", "right"].into_iter().zip(found.reference.iter().zip(&found.arms));
    let missed = sides.find(|(_, (posture, _))| posture.off > super::arm::REACHED);
    missed.map(|(side, (Posture { off, .. }, arm))| {
        let name = &tree.joints[arm[0]].name;
        format!(
            "arms.{side}.reference_rad: the T-pose of the arm from `{name}` was not found (directions are {:.2} off), must be \
             entered by hand",
            off.sqrt()
        )
    })
}

/// Links of the arms without mass.
fn massless(tree: &Tree, found: &Found) -> Option<String> {
    let links = found.arms.iter().flatten().map(|joint| tree.joints[*joint].child);
    let light: Vec<&str> =
        links.filter(|link| tree.inertias[*link].mass_kg <= 0.0).map(|link| tree.links[link].as_str()).collect();
    (!light.is_empty()).then(|| {
        format!(
            "These links of the arms have no <inertial>: {}. Torques leave them out until the URDF has their masses.",
            light.join(", ")
        )
    })
}

fn list(tree: &Tree, joints: &[usize]) -> String {
    joints.iter().map(|joint| tree.joints[*joint].name.as_str()).collect::<Vec<_>>().join(", ")
}
