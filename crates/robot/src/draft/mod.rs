//! A first robot file from a URDF alone: what can be found, what is guessed, and what a person must decide.

mod arm;
mod limits;
mod notes;
mod tree;
mod write;

use crate::arm::ArmShape;
use crate::effective::stated;
use crate::error::RobotError;
use crate::model::{Model, Source};
use crate::urdf::Tree;
use arm::{ArmChain, Positions, Posture};
use limits::Supplied;
use messages::{ARM_JOINTS, JOINTS_MAX};
use nalgebra::{Matrix3, Vector3};
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
    /// Why the file does not load as it is, apart from its capsules. Empty if it does.
    pub refusals: Vec<String>,
}

/// The parts of a robot that a robot file names, as indices of the URDF's joints.
#[derive(Clone)]
struct Found {
    torso_link: usize,
    /// The torso frame (x forward, y left, z up) in the torso link's frame.
    link_from_torso: Matrix3<f64>,
    body: Vec<usize>,
    arms: [Vec<usize>; 2],
    shape: ArmShape,
    /// Why the arms do not mirror each other. `None` if they do.
    unmirrored: Option<String>,
    held: BTreeMap<usize, f64>,
    reference: [Posture; 2],
    home: [Positions; 2],
    supplied: Vec<Supplied>,
    base_height_m: f64,
    /// Where the hands grasp, in the frames of the arms' last links, m. Known for arms whose elbow is the last joint.
    grasp: [[f64; 3]; 2],
}

/// Drafts the robot file of a URDF: it finds the two arms, the torso and the body's joints, solves the T-pose and a
/// home posture, and proposes limits. At the end it loads what it wrote.
pub fn draft(urdf_name: &str, urdf_text: &str) -> Result<Draft, RobotError> {
    let mut tree = Tree::parse(urdf_name, urdf_text)?;
    let refuse = |key: &str, value: String, bound: &str| RobotError::value(urdf_name, key, value, bound);
    let found = tree::find_arms(&tree).map_err(|value| {
        let bound =
            "two chains of four to eight joints that turn, as many left as right, must hang on one link: a robot with other arms \
             is not supported";
        refuse("arms", value, bound)
    })?;
    let ends = Vec::from_iter(found.chains.iter().filter_map(|chain| chain.ends.clone()));
    let (torso_link, chains) = (found.torso, found.chains.each_ref().map(|chain| chain.joints.as_slice()));
    let supplied = limits::supply(&mut tree, &chains.concat());
    check_limits(urdf_name, &tree, chains.concat().iter())?;
    let (start, shape) = window(&tree, torso_link, chains);
    let arms = chains.map(|chain| chain[start..start + shape.joints()].to_vec());
    let (link_from_torso, arms) = sides(&tree, torso_link, arms, shape);
    let (body, placeholders) = commandable(&tree, tree::body_joints(&tree, torso_link, &arms));
    if body.len() + 2 * shape.joints() > JOINTS_MAX {
        let bound = format!("at most {} body joints", JOINTS_MAX - 2 * shape.joints());
        return Err(refuse("body joints", body.len().to_string(), &bound));
    }
    let held = held(&tree, &body, &arms);
    let [left, right] =
        arms.each_ref().map(|joints| ArmChain::new(&tree, (torso_link, &link_from_torso), joints, shape));
    let chains_of_arms = [left, right];
    let (reference, home) = mirrored_postures(&chains_of_arms);
    let supplied = supplied.into_iter().filter(|one| arms.iter().flatten().any(|arm| *arm == one.joint)).collect();
    let mut found = Found {
        torso_link,
        link_from_torso,
        body,
        arms,
        shape,
        unmirrored: None,
        held,
        reference,
        home,
        supplied,
        base_height_m: base_height_m(&tree),
        grasp: chains_of_arms.each_ref().map(ArmChain::grasp),
    };
    let toml_name = format!("{}.toml", urdf_name.trim_end_matches(".urdf"));
    let load = |toml: &str| Model::from_draft(&toml_name, toml, urdf_name, urdf_text);
    let mut toml = write::toml(urdf_name, &tree, &found);
    let mut loaded = load(&toml);
    if let Err(why) = &loaded {
        // Arms that do not mirror each other may load by themselves.
        let mut both = [chains_of_arms[0].clone(), chains_of_arms[1].as_left()];
        let reference = both.each_mut().map(ArmChain::reference);
        let unmirrored = why.to_string().lines().next().map(str::to_owned);
        let own = Found { reference, home: both.each_ref().map(ArmChain::home), unmirrored, ..found.clone() };
        let text = write::toml(urdf_name, &tree, &own);
        if let Ok(model) = load(&text) {
            (found, toml, loaded) = (own, text, Ok(model));
        }
    }
    let (mut guesses, mut decisions) = notes::notes(&tree, &found);
    guesses.extend(ends.into_iter().map(|why| format!("The arm ends there: {why}.")));
    decisions.extend(notes::of_placeholders(&tree, &placeholders));
    decisions.extend(notes::of_window(&tree, chains, start..start + shape.joints()));
    let mut refusals = Vec::from_iter(notes::of_t_pose(&tree, &found));
    if let Err(error) = loaded {
        refusals.extend(error.to_string().lines().map(str::to_owned));
    }
    Ok(Draft { toml, guesses, decisions, refusals })
}

/// T-pose and home of both arms, which mirror each other.
fn mirrored_postures(chains: &[ArmChain; 2]) -> ([Posture; 2], [Positions; 2]) {
    let (signs, [mut left, right]) = (arm::signs(chains), chains.clone());
    left.narrow(&right, &signs);
    let (reference, home) = (left.reference(), left.home());
    let mirrored = |q: &Positions| std::array::from_fn(|i| signs[i] * q[i] + 0.0);
    ([reference, Posture { q: mirrored(&reference.q), ..reference }], [home, mirrored(&home)])
}

/// Where the joints of an arm begin in a chain, and how many turn which part: the first shape and place that fit and whose T-pose is
/// found. Three joints of an upper arm and two of a forearm come first. If none fits, the chain's first joints are taken so.
fn window(tree: &Tree, torso: usize, chains: [&[usize]; 2]) -> (usize, ArmShape) {
    let count = chains.map(<[usize]>::len).into_iter().min().unwrap_or(0);
    let of_length = |joints: usize| {
        let parts = [(3, 2), (2, 2), (3, 1), (2, 1)].into_iter();
        parts.filter_map(move |(upper, fore)| Some(ArmShape { upper, fore, hand: joints.checked_sub(upper + fore)? }))
    };
    let usual = count.min(tree::SEVEN);
    let lengths = (count >= ARM_JOINTS).then_some(ARM_JOINTS).into_iter().chain([usual]);
    let shapes = lengths.flat_map(of_length).filter(|shape| shape.hand <= ArmShape::MOST.hand);
    let places = shapes.flat_map(|shape| (0..=count - shape.joints()).map(move |start| (start, shape)));
    let first = ArmShape { upper: 3, fore: count.saturating_sub(3).clamp(1, 2), hand: count.saturating_sub(5).min(2) };
    let fits = |(start, shape): &(usize, ArmShape)| {
        let joints = &chains[0][*start..start + shape.joints()];
        let mut chain = ArmChain::new(tree, (torso, &Matrix3::identity()), joints, *shape);
        chain.fits() && chain.reference().off < arm::REACHED
    };
    places.into_iter().find(fits).unwrap_or((0, first))
}

/// The arms as left and right, and the torso frame in the frame of the torso's link. The names say which hand is left, and where
/// the hands can be says where left is. Without names the link's x points forward.
fn sides(tree: &Tree, torso: usize, arms: [Vec<usize>; 2], shape: ArmShape) -> (Matrix3<f64>, [Vec<usize>; 2]) {
    let identity = Matrix3::identity();
    let reach = arms.each_ref().map(|joints| ArmChain::new(tree, (torso, &identity), joints, shape).reach());
    let apart = reach[0] - reach[1];
    let named = (tree::named_side(tree, &arms[0]) - tree::named_side(tree, &arms[1])).clamp(-1.0, 1.0);
    let poses = tree::link_poses(tree, |_| 0.0);
    let up = nearest_axis(&(poses[torso].r.transpose() * Vector3::z()));
    let level = apart - up * apart.dot(&up);
    let mut left = nearest_axis(&level) * if named == 0.0 { 1.0 } else { named };
    // Without names: the way in which the link's x, or else its y, is not against the torso's.
    let forward = left.cross(&up);
    if named == 0.0 && forward.x + 0.5 * forward.y < 0.0 {
        left = -left;
    }
    let turn = Matrix3::from_columns(&[left.cross(&up), left, up]);
    let [first, second] = arms;
    (turn, if apart.dot(&left) >= 0.0 { [first, second] } else { [second, first] })
}

/// The axis of a frame, with its sign, that is nearest to a direction.
fn nearest_axis(direction: &Vector3<f64>) -> Vector3<f64> {
    let at = direction.iamax();
    let mut axis = Vector3::zeros();
    axis[at] = if direction[at] < 0.0 { -1.0 } else { 1.0 };
    axis
}

/// Splits the body's joints into those that can be commanded, and those for which the URDF has a placeholder: they are held.
fn commandable(tree: &Tree, body: Vec<usize>) -> (Vec<usize>, Vec<usize>) {
    let ranged = |joint: &usize| tree.joints[*joint].limit.upper - tree.joints[*joint].limit.lower > ROOM;
    body.into_iter().partition(|joint| stated(&tree.joints[*joint]) == [true; 3] && ranged(joint))
}

/// Refuses limits that a model would refuse, and a range that is no wider than the draft's margins. Postures are solved
/// inside the ranges.
fn check_limits<'j>(file: &str, tree: &Tree, joints: impl Iterator<Item = &'j usize>) -> Result<(), RobotError> {
    let source = Source { toml: file, urdf: file };
    let mut errors = Vec::new();
    for joint in joints.map(|joint| &tree.joints[*joint]) {
        let Some(limits) = RobotError::keep(source.limits_of(joint), &mut errors) else { continue };
        let range = limits.q_max - limits.q_min;
        if range <= ROOM {
            let bound = format!("must be above {ROOM}");
            errors.push(source.joint(&source.line(joint), &joint.name, "range", range, bound));
        }
    }
    RobotError::all(errors)
}

/// Positions of the movable joints that no list names: where their leaders move them, or zero, or the nearest end of the range.
fn held(tree: &Tree, body: &[usize], arms: &[Vec<usize>; 2]) -> BTreeMap<usize, f64> {
    let commanded = |joint: &usize| body.contains(joint) || arms.iter().flatten().any(|arm| arm == joint);
    let others = (0..tree.joints.len()).filter(|joint| !commanded(joint));
    let movable = others.filter(|joint| tree.joints[*joint].kind != JointType::Fixed);
    let rest = |joint: usize| 0.0_f64.max(tree.joints[joint].stops()[0]).min(tree.joints[joint].stops()[1]);
    let mut held: BTreeMap<usize, f64> = movable.map(|joint| (joint, rest(joint))).collect();
    // A leader may follow another one. More steps than joints are a circle.
    for _ in 0..tree.joints.len() {
        let before = held.clone();
        let position = |leader: &str| before.get(&tree.joint(leader)?).copied();
        held.iter_mut().for_each(|(joint, q)| *q = tree.joints[*joint].follows(position).unwrap_or(*q));
        if held == before {
            break;
        }
    }
    held
}

/// Height of the root above the lowest link's origin with all joints at zero, m.
fn base_height_m(tree: &Tree) -> f64 {
    let lowest = tree::link_poses(tree, |_| 0.0).iter().map(|pose| pose.t.z).fold(0.0, f64::min);
    (-lowest * 1e2).round() / 1e2 + 0.0
}
