//! Finds arms and body in a URDF's tree.

use crate::pose::Pose;
use crate::urdf::Tree;
use messages::ARM_JOINTS;
use urdf_rs::JointType;

/// Words in the name of a joint of a head.
const HEAD_WORDS: [&str; 2] = ["head", "neck"];

/// Returns true if the joint may be an arm's. `endless`: joints that turn without end may be, too.
fn turns(tree: &Tree, joint: usize, endless: bool) -> bool {
    let joint = &tree.joints[joint];
    let kind = joint.kind == JointType::Revolute || (endless && joint.kind == JointType::Continuous);
    kind && joint.mimics.is_none()
}

fn below(tree: &Tree, link: usize) -> impl Iterator<Item = usize> {
    (0..tree.joints.len()).filter(move |joint| tree.joints[*joint].parent == link)
}

/// Turning joints on the longest chain that begins with `joint`.
fn longest(tree: &Tree, joint: usize, endless: bool) -> Vec<usize> {
    let mut best = Vec::new();
    for next in below(tree, tree.joints[joint].child) {
        let chain = longest(tree, next, endless);
        if chain.len() > best.len() {
            best = chain;
        }
    }
    if turns(tree, joint, endless) {
        best.insert(0, joint);
    }
    best
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

/// The link that carries two arms, and the joints of the left and the right one. If more chains are long enough, it
/// takes the two highest. `None` if no link carries two. `endless`: joints that turn without end count too.
pub(super) fn find_arms(tree: &Tree, endless: bool) -> Option<(usize, [[usize; ARM_JOINTS]; 2])> {
    let mut found = None;
    let mut open = vec![tree.root];
    while let Some(link) = open.pop() {
        let mut arms: Vec<Vec<usize>> = below(tree, link).map(|joint| longest(tree, joint, endless)).collect();
        arms.retain(|arm| arm.len() >= ARM_JOINTS);
        if arms.len() >= 2 {
            let place = |arm: &Vec<usize>| pose_below(tree, link, arm[0]).t;
            arms.sort_by(|a, b| place(b).z.total_cmp(&place(a).z));
            arms.truncate(2);
            arms.sort_by(|a, b| place(b).y.total_cmp(&place(a).y));
            // The deepest such link is the torso.
            found = Some((link, [0, 1].map(|side| std::array::from_fn(|i| arms[side][i]))));
        }
        open.extend(below(tree, link).map(|joint| tree.joints[joint].child));
    }
    found
}

/// Joints that move the torso, and those of a head. Joints that cannot be commanded are left out.
pub(super) fn body_joints(tree: &Tree, torso: usize, arms: &[[usize; ARM_JOINTS]; 2]) -> Vec<usize> {
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
    let is_head = |joint: &usize| {
        let names = format!("{} {}", tree.joints[*joint].name, tree.links[tree.joints[*joint].child]).to_lowercase();
        HEAD_WORDS.iter().any(|word| names.contains(word))
    };
    let mut open = vec![torso];
    while let Some(link) = open.pop() {
        for joint in below(tree, link).filter(|joint| !arms.iter().any(|arm| arm[0] == *joint)) {
            if is_head(&joint) {
                body.push(joint);
            }
            open.push(tree.joints[joint].child);
        }
    }
    body.retain(commandable);
    body
}
