//! Maps a rig's joints to SMPL-22 with one table of aliases. If names do not decide, the tree does.

use crate::MotionError;
use crate::bvh::Joint;
use crate::error::BvhError;
use messages::{SMPL_JOINTS, SMPL_NAMES, Smpl};
use std::collections::BTreeMap;
use std::path::Path;

/// Joints with a side: left and right SMPL index and their names without the side, best first. "leg", "shoulder",
/// "foot" and "hand" are ambiguous, and the tree decides them.
const SIDED: [(Smpl, Smpl, &[&str]); 8] = [
    (Smpl::LeftHip, Smpl::RightHip, &["upleg", "upperleg", "legupper", "thigh", "thighbend", "femur", "leg", "hip"]),
    (
        Smpl::LeftKnee,
        Smpl::RightKnee,
        &["lowerleg", "lowleg", "leglower", "calf", "shin", "shank", "tibia", "knee", "leg"],
    ),
    (Smpl::LeftAnkle, Smpl::RightAnkle, &["ankle", "footankle", "foot"]),
    (Smpl::LeftFoot, Smpl::RightFoot, &["toebase", "toe", "toes", "toe0", "ball", "football", "forefoot", "foot"]),
    (Smpl::LeftCollar, Smpl::RightCollar, &["clavicle", "clav", "collar", "scapula", "shoulder"]),
    (
        Smpl::LeftShoulder,
        Smpl::RightShoulder,
        &["upperarm", "uparm", "uarm", "arm", "humerus", "armupper", "shldr", "shldrbend", "shoulder"],
    ),
    (
        Smpl::LeftElbow,
        Smpl::RightElbow,
        &["forearm", "forearmbend", "farm", "lowerarm", "lowarm", "larm", "armlower", "radius", "elbow"],
    ),
    (Smpl::LeftWrist, Smpl::RightWrist, &["wrist", "handwrist", "hand"]),
];
/// Prefixes that exporters put before every name, in lower case. Digits and separators that follow belong to the
/// prefix.
const PREFIXES: &str = "\
    valvebiped.bip cc_base_ mixamorig j_bip_c_ j_bip_ j_sec_ m_avg_ f_avg_ bip0 def- org- def_";
/// Share of a rig's names that have the same beginning. A root may lack it.
const SHARED_PERCENT: usize = 85;
const PELVIS: [&str; 3] = ["hips", "hip", "pelvis"];
const HEAD: [&str; 3] = ["head", "head1", "skull"];

/// A side of the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// A rig's joints by SMPL-22 index.
pub(crate) struct Mapping {
    pub(crate) joints: [usize; SMPL_JOINTS],
    pub(crate) warnings: Vec<String>,
}

impl Mapping {
    /// Marks the joints to compute: the mapped ones and their ancestors.
    pub(crate) fn needed(&self, joints: &[Joint]) -> Vec<bool> {
        let mut needed = vec![false; joints.len()];
        for &joint in &self.joints {
            needed[joint] = true;
        }
        for i in (0..joints.len()).rev() {
            if let (true, Some(parent)) = (needed[i], joints[i].parent) {
                needed[parent] = true;
            }
        }
        needed
    }
}

/// Names of joints that a user gives: SMPL-22's name, and the rig's.
#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(transparent)]
pub(crate) struct Named(BTreeMap<String, String>);

impl Named {
    /// Reads a TOML file with lines such as `left_elbow = "ForeArm.L"`.
    pub(crate) fn read(path: &Path) -> Result<Self, MotionError> {
        let file = || path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|source| MotionError::Io { file: file(), source })?;
        let named: Self = toml::from_str(&text)
            .map_err(|error| MotionError::Map { file: file(), cause: error.to_string().trim_end().to_owned() })?;
        match named.0.keys().find(|key| !SMPL_NAMES.contains(&key.as_str())) {
            Some(key) => {
                let cause = format!("{key} is no joint; the joints are {}", SMPL_NAMES.join(", "));
                Err(MotionError::Map { file: file(), cause })
            }
            None => Ok(named),
        }
    }

    /// The rig's joint that the user gives for a joint of SMPL-22.
    fn joint(&self, joints: &[Joint], smpl: usize) -> Result<Option<usize>, BvhError> {
        let Some(name) = self.0.get(SMPL_NAMES[smpl]) else { return Ok(None) };
        let found = joints.iter().position(|joint| !joint.is_end && joint.name == *name);
        let unknown = || BvhError::UnknownName { joint: SMPL_NAMES[smpl], name: name.clone(), found: listed(joints) };
        found.map(Some).ok_or_else(unknown)
    }
}

/// Names of a rig's joints, the first 40, whole: they are names for a map.
fn listed(joints: &[Joint]) -> Vec<String> {
    joints.iter().filter(|joint| !joint.is_end).take(40).map(|joint| joint.name.clone()).collect()
}

/// Finds every SMPL-22 joint. What the user names is not searched.
pub(crate) fn map(joints: &[Joint], named: &Named) -> Result<Mapping, BvhError> {
    let own: Vec<&str> = joints.iter().filter(|joint| !joint.is_end).map(|joint| joint.name.as_str()).collect();
    let (before, after) = shared(&own);
    let stripped = |name: &str| {
        let name = name.strip_prefix(before).unwrap_or(name);
        name.strip_suffix(after).unwrap_or(name).to_owned()
    };
    let names: Vec<Name> =
        joints.iter().map(|j| Name::read(&if j.is_end { String::new() } else { stripped(&j.name) })).collect();
    let mut found: [Option<usize>; SMPL_JOINTS] = [None; SMPL_JOINTS];
    let mut warnings = Vec::new();
    for (left, right, cores) in SIDED {
        for (side, joint) in [(Side::Left, left), (Side::Right, right)] {
            found[joint as usize] = cores.iter().find_map(|&core| find(joints, &names, side, joint, core));
        }
    }
    found[Smpl::Pelvis as usize] = PELVIS.iter().find_map(|&core| names.iter().position(|n| n.is_central(core)));
    found[Smpl::Head as usize] = HEAD.iter().find_map(|&core| names.iter().position(|n| n.is_central(core)));
    for (joint, found) in found.iter_mut().enumerate() {
        *found = named.joint(joints, joint)?.or(*found);
    }
    fill_feet(joints, &mut found, &mut warnings);
    fill_trunk(joints, &mut found, &mut warnings);
    for (joint, found) in found.iter_mut().enumerate() {
        *found = named.joint(joints, joint)?.or(*found);
    }
    let missing: Vec<&'static str> = (0..SMPL_JOINTS).filter(|&j| found[j].is_none()).map(|j| SMPL_NAMES[j]).collect();
    if !missing.is_empty() {
        return Err(BvhError::MissingJoints { missing, found: listed(joints) });
    }
    Ok(Mapping { joints: found.map(Option::unwrap_or_default), warnings })
}

/// Returns the first joint of this name, unless the tree shows that it is another joint.
fn find(joints: &[Joint], names: &[Name], side: Side, target: Smpl, core: &str) -> Option<usize> {
    let has = |core: &str| names.iter().any(|n| n.is(side, core));
    let carries = |i: usize, cores: &[&str], but: &str| {
        let named = |c: usize| cores.iter().any(|&core| core != but && names[c].is(side, core));
        (0..joints.len()).any(|c| c != i && named(c) && is_ancestor(joints, i, c))
    };
    (0..joints.len()).find(|&i| {
        if !names[i].is(side, core) {
            return false;
        }
        match (target, core) {
            // "LeftShoulder" is the clavicle if it carries an upper arm. Otherwise it is the shoulder itself.
            (Smpl::LeftCollar | Smpl::RightCollar, "shoulder") => carries(i, SIDED[5].2, "shoulder"),
            // "Left leg" is the thigh if it carries a knee. Otherwise it is the shin.
            (Smpl::LeftHip | Smpl::RightHip, "leg") => carries(i, SIDED[1].2, "leg"),
            // "LeftFoot" is the ankle. If there is also a joint named ankle, it is the ball.
            (Smpl::LeftFoot | Smpl::RightFoot, "foot") => has("ankle"),
            _ => true,
        }
    })
}

/// Fills in missing toes with the end site of the foot.
fn fill_feet(joints: &[Joint], found: &mut [Option<usize>; SMPL_JOINTS], warnings: &mut Vec<String>) {
    for (ankle, foot) in [(Smpl::LeftAnkle, Smpl::LeftFoot), (Smpl::RightAnkle, Smpl::RightFoot)] {
        if let (Some(parent), None) = (found[ankle as usize], found[foot as usize]) {
            let child = (0..joints.len()).find(|&i| joints[i].parent == Some(parent));
            // A foot without an end has no direction. Nothing needs it.
            found[foot as usize] = child.or(Some(parent));
            let end = if child.is_some() { "the end of the foot" } else { "the ankle" };
            warnings.push(format!("no toe joint: uses {end} as {}", SMPL_NAMES[foot as usize]));
        }
    }
}

/// Finds spine, neck and collars by the tree. Rigs name and count them differently.
fn fill_trunk(joints: &[Joint], found: &mut [Option<usize>; SMPL_JOINTS], warnings: &mut Vec<String>) {
    let get = |found: &[Option<usize>; SMPL_JOINTS], joint: Smpl| found[joint as usize];
    let thighs = (get(found, Smpl::LeftHip), get(found, Smpl::RightHip));
    if let ((Some(left), Some(right)), None) = (thighs, get(found, Smpl::Pelvis)) {
        found[Smpl::Pelvis as usize] = common_ancestor(joints, left, right);
        warnings.push("no joint named hips or pelvis: uses the common parent of the thighs as the pelvis".to_owned());
    }
    let shoulders = (get(found, Smpl::LeftShoulder), get(found, Smpl::RightShoulder));
    let (Some(left), Some(right)) = shoulders else { return };
    let Some(chest) = common_ancestor(joints, left, right) else {
        return;
    };
    for (collar, shoulder) in [(Smpl::LeftCollar, left), (Smpl::RightCollar, right)] {
        if found[collar as usize].is_none() {
            found[collar as usize] = joints[shoulder].parent;
            warnings.push(format!("no clavicle: uses {} as the parent of the shoulder", SMPL_NAMES[collar as usize]));
        }
    }
    if get(found, Smpl::Head).is_none() {
        found[Smpl::Head as usize] = top(joints, chest, [left, right]);
        warnings.push("no joint named head: uses the end of the neck as the head".to_owned());
    }
    if let Some(head) = get(found, Smpl::Head) {
        // The child of the chest on the way to the head. If nothing lies between, it is the head itself.
        found[Smpl::Neck as usize] =
            ancestors(joints, head).take_while(|&i| i != chest).last().filter(|_| is_ancestor(joints, chest, head));
    }
    // The chain goes from the chest down to the joint that also carries the legs. That joint is the pelvis or
    // replaces it.
    let Some(pelvis) = get(found, Smpl::Pelvis) else { return };
    let legs = thighs.0.map_or(pelvis, |thigh| common_ancestor(joints, chest, thigh).unwrap_or(pelvis));
    let mut spine: Vec<usize> = ancestors(joints, chest).take_while(|&i| i != legs && i != pelvis).collect();
    spine.reverse();
    if let (Some(&low), Some(&high)) = (spine.first(), spine.last()) {
        found[Smpl::Spine1 as usize] = Some(low);
        found[Smpl::Spine2 as usize] = Some(spine[spine.len() / 2]);
        found[Smpl::Spine3 as usize] = Some(high);
        if spine.len() < 3 {
            warnings.push(format!("{} spine joint(s): some of spine1 to spine3 coincide", spine.len()));
        }
    }
}

/// Finds the end of the chain that leaves the chest and is neither arm. It takes the longest one, up to its
/// branch.
fn top(joints: &[Joint], chest: usize, shoulders: [usize; 2]) -> Option<usize> {
    let children =
        |parent: usize| (0..joints.len()).filter(move |&i| joints[i].parent == Some(parent) && !joints[i].is_end);
    let no_arm = |&i: &usize| !shoulders.iter().any(|&shoulder| is_ancestor(joints, i, shoulder));
    let chain = |first: usize| {
        let only = move |&i: &usize| {
            let mut next = children(i);
            next.next().filter(|_| next.next().is_none())
        };
        std::iter::successors(Some(first), only)
    };
    children(chest)
        .filter(no_arm)
        .map(|i| (chain(i).count(), i))
        .max_by_key(|&(count, i)| (count, joints.len() - i))
        .and_then(|(_, i)| chain(i).last())
}

/// Returns a joint and all its ancestors, upwards.
fn ancestors(joints: &[Joint], from: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(from), |&i| joints[i].parent)
}

fn is_ancestor(joints: &[Joint], upper: usize, lower: usize) -> bool {
    ancestors(joints, lower).any(|i| i == upper)
}

fn common_ancestor(joints: &[Joint], a: usize, b: usize) -> Option<usize> {
    ancestors(joints, a).find(|&i| is_ancestor(joints, i, b))
}

/// A name without prefix, case and separators, and its side in every notation of the exporters.
struct Name {
    whole: String,
    sided: Option<(Side, String)>,
}

impl Name {
    fn read(name: &str) -> Self {
        // Drops a namespace such as "mixamorig:" in "mixamorig:LeftArm", or "Character1:" in "Character1:Hips".
        let name = name.rsplit(':').next().unwrap_or(name).trim();
        let lower = name.to_ascii_lowercase();
        let rest = PREFIXES.split(' ').find_map(|prefix| lower.strip_prefix(prefix)).unwrap_or(&lower);
        let rest = if rest.len() == lower.len() { rest } else { rest.trim_start_matches(|c: char| !c.is_alphabetic()) };
        let words = words(&name[name.len() - rest.len()..]);
        // "Head_M" is in the middle.
        let whole: String =
            words.iter().filter(|word| !["m", "c", "mid"].contains(&word.as_str())).map(String::as_str).collect();
        let side = |word: &str| match word {
            "l" | "left" => Some(Side::Left),
            "r" | "right" => Some(Side::Right),
            _ => None,
        };
        let by_word = words.iter().enumerate().find_map(|(i, word)| {
            let rest: String = words.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, w)| w.as_str()).collect();
            // The first piece of a divided bone represents it: "upperarm01.L".
            let rest = rest.strip_suffix("01").map(str::to_owned).unwrap_or(rest);
            side(word).map(|side| (side, rest))
        });
        // "leftarm" and "lfemur" have no separator, so the name must begin with the side.
        let prefixes = [("left", Side::Left), ("right", Side::Right), ("l", Side::Left), ("r", Side::Right)];
        let by_prefix = || prefixes.iter().find_map(|&(p, side)| whole.strip_prefix(p).map(|r| (side, r.to_owned())));
        let sided = by_word.or_else(by_prefix);
        Self { whole, sided }
    }

    fn is(&self, side: Side, core: &str) -> bool {
        self.sided.as_ref().is_some_and(|(s, c)| *s == side && c == core)
    }

    fn is_central(&self, core: &str) -> bool {
        self.whole == core
    }
}

/// Returns what the names of a rig begin and end with, if most do: "Character1_", ".001", "_jnt". It is no
/// part of any joint's name.
fn shared<'a>(names: &[&'a str]) -> (&'a str, &'a str) {
    let most = names.len() * SHARED_PERCENT / 100;
    let cuts = |name: &'a str| name.char_indices().map(|(i, _)| i).skip(1);
    let before = |part: &str| names.iter().filter(|name| name.len() > part.len() && name.starts_with(part)).count();
    let after = |part: &str| names.iter().filter(|name| name.len() > part.len() && name.ends_with(part)).count();
    // Most names share it, so one of the first few does.
    let (mut prefix, mut suffix) = ("", "");
    for &name in names.iter().take(4).filter(|_| names.len() > 8) {
        let longest = cuts(name).map(|i| &name[..i]).take_while(|part| before(part) > most).last();
        prefix = longest.filter(|part| part.len() > prefix.len()).unwrap_or(prefix);
        let longest = cuts(name).map(|i| &name[i..]).filter(|part| after(part) > most).max_by_key(|part| part.len());
        suffix = longest.filter(|part| part.len() > suffix.len()).unwrap_or(suffix);
    }
    (prefix, suffix)
}

/// Splits a name into lower-case words at separators and capitals ("LHipJoint", "UpperArm_L", "upperarm_l").
fn words(name: &str) -> Vec<String> {
    let chars: Vec<char> = name.chars().collect();
    let mut words = vec![String::new()];
    for (i, &c) in chars.iter().enumerate() {
        let next_is_lower = chars.get(i + 1).is_some_and(|n| n.is_lowercase());
        let after_lower = i > 0 && chars[i - 1].is_lowercase();
        if !c.is_alphanumeric() || (c.is_uppercase() && (after_lower || next_is_lower)) {
            words.push(String::new());
        }
        if let (true, Some(word)) = (c.is_alphanumeric(), words.last_mut()) {
            word.extend(c.to_lowercase());
        }
    }
    words.retain(|word| !word.is_empty());
    words
}
