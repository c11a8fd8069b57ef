//! Finds arms and body in a URDF's tree.

use crate::commanded::ARM_JOINTS_MIN;
use crate::pose::Pose;
use crate::urdf::Tree;
use urdf_rs::JointType;

/// Joints of most arms: three turn the upper arm, two the forearm, two the hand.
pub(super) const SEVEN: usize = 7;
/// Words in the name of a joint of a head.
const HEAD_WORDS: [&str; 2] = ["head", "neck"];
/// Words in the name of a joint of a leg.
const LEG_WORDS: [&str; 8] = ["leg", "hip", "knee", "ankle", "foot", "thigh", "wheel", "caster"];
/// Words in the name of a joint of a finger.
const FINGER_WORDS: [&str; 5] = ["finger", "thumb", "jaw", "knuckle", "claw"];
/// The same of a gripper, except where the name says that the joint turns all of it.
const GRIPPER_WORD: &str = "grip";
const TURNS: [&str; 5] = ["yaw", "pitch", "roll", "rotat", "wrist"];

/// A chain of joints from a shoulder to a hand, and why it ends there, if it goes on.
#[derive(Debug)]
pub(super) struct Chain {
    pub(super) joints: Vec<usize>,
    pub(super) ends: Option<String>,
}

/// The link that carries two arms, and their chains.
pub(super) struct Arms {
    pub(super) torso: usize,
    pub(super) chains: [Chain; 2],
}

fn has_word(tree: &Tree, joint: usize, words: &[&str]) -> bool {
    let name = tree.joints[joint].name.to_lowercase();
    words.iter().any(|word| name.contains(word))
}

/// Returns true if the joint may be an arm's.
fn turns(tree: &Tree, joint: usize) -> bool {
    let joint = &tree.joints[joint];
    matches!(joint.kind, JointType::Revolute | JointType::Continuous) && joint.mimics.is_none()
}

fn below(tree: &Tree, link: usize) -> impl Iterator<Item = usize> {
    (0..tree.joints.len()).filter(move |joint| tree.joints[*joint].parent == link)
}

/// Turning joints on the longest chain that begins with `joint`.
fn longest(tree: &Tree, joint: usize) -> Vec<usize> {
    let mut best = Vec::new();
    for next in below(tree, tree.joints[joint].child) {
        let chain = longest(tree, next);
        if chain.len() > best.len() {
            best = chain;
        }
    }
    if turns(tree, joint) {
        best.insert(0, joint);
    }
    best
}

/// The link that moves with a link and is nearest to the root: fixed joints alone are between them.
fn carrier(tree: &Tree, link: usize) -> usize {
    let fixed = |link: &usize| {
        let above = tree.joint_above[*link].filter(|joint| tree.joints[*joint].kind == JointType::Fixed)?;
        Some(tree.joints[above].parent)
    };
    std::iter::successors(Some(link), fixed).last().unwrap_or(link)
}

/// Why a joint of a chain moves fingers and not an arm. None for a joint of an arm.
fn finger(tree: &Tree, chain: &[usize], i: usize) -> Option<String> {
    let name = |joint: usize| &tree.joints[joint].name;
    let joint = chain[i];
    let has = |words: &[&str]| has_word(tree, joint, words);
    if has(&FINGER_WORDS) || (has(&[GRIPPER_WORD]) && !has(&TURNS)) {
        return Some(format!("`{}` is a gripper's by its name", name(joint)));
    }
    let moves = |other: &usize| tree.joints[*other].kind != JointType::Fixed;
    let mut others = (0..tree.joints.len()).filter(|other| *other != joint).filter(moves);
    let follows = |other: &usize| tree.joints[*other].mimics.as_ref().is_some_and(|mimic| mimic.leader == *name(joint));
    if let Some(follower) = others.clone().find(follows) {
        return Some(format!(
            "`{}` is led by `{}`, and nothing may follow an arm's joint",
            name(follower),
            name(joint)
        ));
    }
    let hand = carrier(tree, tree.joints[joint].parent);
    let sibling = others.find(|other| i > 0 && carrier(tree, tree.joints[*other].parent) == hand);
    sibling.map(|other| format!("`{}` hangs beside `{}`, as fingers do", name(other), name(joint)))
}

/// Pose of a joint's frame in the frame of a link above it, with all joints at zero.
pub(super) fn pose_below(tree: &Tree, link: usize, joint: usize) -> Pose {
    let mut pose = tree.joints[joint].parent_from_joint;
    let mut at = tree.joints[joint].parent;
    while at != link {
        let Some(above) = tree.joint_above[at] else { break };
        pose = tree.joints[above].parent_from_joint.compose(&pose);
        at = tree.joints[above].parent;
    }
    pose
}

/// Finds the link that carries two arms. If more chains are long enough, it takes the two highest. If no link carries two, the
/// error says what the longest chains are.
pub(super) fn find_arms(tree: &Tree) -> Result<Arms, String> {
    // Long chains first: a hand may have fingers of four joints.
    let lengths = [SEVEN, 6, 5];
    lengths
        .into_iter()
        .find_map(|length| arms_of_length(tree, length).ok())
        .map_or_else(|| arms_of_length(tree, ARM_JOINTS_MIN), Ok)
}

/// As [`find_arms`], for arms of this many joints, and of more if these are seven.
fn arms_of_length(tree: &Tree, joints: usize) -> Result<Arms, String> {
    let fits = |arm: &Chain| arm.joints.len() == joints || (joints == SEVEN && arm.joints.len() > joints);
    let mut found: Option<Arms> = None;
    let mut short: Vec<Chain> = Vec::new();
    let mut open = vec![tree.root];
    while let Some(link) = open.pop() {
        let mut arms = Vec::new();
        for joint in below(tree, link) {
            let mut joints = longest(tree, joint);
            if joints.iter().any(|joint| has_word(tree, *joint, &LEG_WORDS)) {
                continue;
            }
            let cut = (0..joints.len()).find_map(|i| finger(tree, &joints, i).map(|why| (i, why)));
            joints.truncate(cut.as_ref().map_or(joints.len(), |(at, _)| *at));
            arms.push(Chain { joints, ends: cut.map(|(_, why)| why) });
        }
        let place = |arm: &Chain| pose_below(tree, link, arm.joints[0]).t.z;
        let (mut long, rest): (Vec<_>, Vec<_>) = arms.into_iter().partition(fits);
        long.sort_by(|a, b| place(b).total_cmp(&place(a)));
        // The deepest such link is the torso.
        if long.len() >= 2 {
            let second = long.swap_remove(1);
            found = Some(Arms { torso: link, chains: [long.swap_remove(0), second] });
        }
        short.extend(rest.into_iter().chain(long));
        open.extend(below(tree, link).map(|joint| tree.joints[joint].child));
    }
    found.ok_or_else(|| too_short(tree, short))
}

/// The two longest chains, and why they end.
fn too_short(tree: &Tree, mut chains: Vec<Chain>) -> String {
    // A chain is there once for each link above it.
    chains.sort_by_key(|chain| std::cmp::Reverse(chain.joints.len()));
    let mut ends = Vec::new();
    chains.retain(|chain| {
        let new = chain.joints.last().is_some_and(|last| !ends.contains(last));
        ends.extend(chain.joints.last());
        new
    });
    let describe = |chain: &Chain| {
        let names: Vec<&str> = chain.joints.iter().map(|joint| tree.joints[*joint].name.as_str()).collect();
        let ends = chain.ends.as_ref().map_or(String::new(), |why| format!(": {why}"));
        format!("{} joints ({}){ends}", names.len(), names.join(", "))
    };
    let two: Vec<String> = chains.iter().take(2).map(describe).collect();
    if two.is_empty() { "none".into() } else { two.join("; ") }
}

/// The side that the names of joints say: 1 for left, -1 for right, 0 for none.
pub(super) fn named_side(tree: &Tree, joints: &[usize]) -> f64 {
    let side = |joint: &usize| {
        let name = &tree.joints[*joint].name;
        let low = name.to_lowercase();
        let says = |word: &str, letter: char| {
            let capital = letter.to_ascii_uppercase();
            let parts = || low.split(|c: char| !c.is_ascii_alphanumeric());
            let mut first = name.chars();
            low.contains(word)
                || parts().any(|part| part.len() == 1 && part.starts_with(letter))
                || (first.next() == Some(capital) && first.next().is_some_and(|c| c.is_ascii_uppercase()))
        };
        f64::from(says("left", 'l')) - f64::from(says("right", 'r'))
    };
    let sum: f64 = joints.iter().map(side).sum();
    if sum == 0.0 { 0.0 } else { sum.signum() }
}

/// Returns true if the name of a joint or of its link is a head's.
pub(super) fn is_head(tree: &Tree, joint: usize) -> bool {
    let link = tree.links[tree.joints[joint].child].to_lowercase();
    has_word(tree, joint, &HEAD_WORDS) || HEAD_WORDS.iter().any(|word| link.contains(word))
}

/// Joints that move the torso, and those of a head. Joints that cannot be commanded are left out.
pub(super) fn body_joints(tree: &Tree, torso: usize, arms: &[Vec<usize>; 2]) -> Vec<usize> {
    let commandable = |joint: &usize| {
        let joint = &tree.joints[*joint];
        matches!(joint.kind, JointType::Revolute | JointType::Prismatic) && joint.mimics.is_none()
    };
    let mut body = Vec::new();
    let mut at = torso;
    while let Some(above) = tree.joint_above[at] {
        body.insert(0, above);
        at = tree.joints[above].parent;
    }
    let mut open = vec![torso];
    while let Some(link) = open.pop() {
        for joint in below(tree, link).filter(|joint| !arms.iter().flatten().any(|arm| arm == joint)) {
            if is_head(tree, joint) {
                body.push(joint);
            }
            open.push(tree.joints[joint].child);
        }
    }
    body.retain(commandable);
    body
}

/// Poses of all links in the root's frame, at these positions and zero.
pub(super) fn link_poses(tree: &Tree, position: impl Fn(usize) -> f64) -> Vec<Pose> {
    let mut poses = vec![Pose::identity(); tree.links.len()];
    let mut open = vec![tree.root];
    while let Some(link) = open.pop() {
        for joint in below(tree, link) {
            let (place, moved) = (&tree.joints[joint], crate::commanded::moved(&tree.joints[joint], position(joint)));
            poses[place.child] = poses[link].compose(&place.parent_from_joint).compose(&moved);
            open.push(place.child);
        }
    }
    poses
}

/// The links that a joint moves.
pub(super) fn moved_links(tree: &Tree, joint: usize) -> Vec<usize> {
    let mut links = vec![tree.joints[joint].child];
    let mut next = 0;
    while let Some(&link) = links.get(next) {
        links.extend(below(tree, link).map(|joint| tree.joints[joint].child));
        next += 1;
    }
    links
}
