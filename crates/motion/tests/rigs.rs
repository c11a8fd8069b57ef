//! Tests rigs of many exporters by their joints' names and tree. Each maps without configuration. Joints have
//! either rotations or also positions.

use messages::Smpl;
use motion::{builtin, parse_bvh};
use nalgebra::Vector3;
use std::fmt::Write;

/// Names of a rig's joints. A name may contain spaces.
struct Rig {
    name: &'static str,
    trunk: &'static str,
    leg: &'static str,
    arm: &'static str,
    sides: [&'static str; 2],
}

/// Reads `data/rigs.txt`, which describes the columns.
fn rigs() -> Vec<Rig> {
    let lines = include_str!("data/rigs.txt").lines().filter(|line| !line.starts_with('#'));
    let rig = |line: &'static str| {
        let [name, sides, trunk, leg, arm] = line.split("; ").collect::<Vec<_>>().try_into().expect("five columns");
        let (left, right) = sides.split_once(' ').expect("two sides");
        Rig { name, trunk, leg, arm, sides: [left, right] }
    };
    lines.map(rig).collect()
}

/// A joint of a file: name, parent, place in the T-pose (m, x left, y up, z forward), and a flag for an elbow
/// that bends.
struct Joint {
    name: String,
    parent: Option<usize>,
    at: Vector3<f64>,
    bends: bool,
}

fn place(smpl: usize) -> Vector3<f64> {
    let [x, y, z] = builtin().frames[0].positions[smpl].map(f64::from);
    Vector3::new(y, z, x)
}

/// Appends a chain. `smpl` are the places of the joints with length. The last one is repeated at intervals of 5
/// cm.
fn chain(joints: &mut Vec<Joint>, mut parent: Option<usize>, names: &str, smpl: &[Smpl]) {
    let mut next = smpl.iter();
    let mut beyond = 0.0;
    for name in names.split(',') {
        let inline = name.starts_with('~');
        let at = match (inline, next.as_slice().first()) {
            (true, _) => parent.map_or_else(Vector3::zeros, |p: usize| joints[p].at),
            (false, Some(&joint)) => {
                next.next();
                place(joint as usize)
            }
            (false, None) => {
                beyond += 0.05;
                place(smpl[smpl.len() - 1] as usize) + Vector3::new(0.0, 0.0, beyond)
            }
        };
        let bends = !inline && smpl.len() > next.as_slice().len() && at == place(Smpl::LeftElbow as usize);
        joints.push(Joint { name: name.trim_start_matches('~').to_owned(), parent, at, bends });
        parent = Some(joints.len() - 1);
    }
}

fn joints(rig: &Rig) -> Vec<Joint> {
    let mut joints = Vec::new();
    let (spine, neck) = rig.trunk.split_once('|').expect("a neck");
    let spine_places = [Smpl::Pelvis, Smpl::Spine1, Smpl::Spine2, Smpl::Spine3];
    chain(&mut joints, None, spine, &spine_places);
    let chest = joints.len() - 1;
    let neck_places: &[Smpl] = if neck.contains(',') { &[Smpl::Neck, Smpl::Head] } else { &[Smpl::Head] };
    chain(&mut joints, Some(chest), neck, neck_places);
    use Smpl::*;
    let legs = [[LeftHip, LeftKnee, LeftAnkle, LeftFoot], [RightHip, RightKnee, RightAnkle, RightFoot]];
    let arms = [[LeftCollar, LeftShoulder, LeftElbow, LeftWrist], [RightCollar, RightShoulder, RightElbow, RightWrist]];
    let collar = usize::from(rig.arm.split(',').count() == 3);
    for (side, (leg, arm)) in rig.sides.iter().zip(legs.iter().zip(&arms)) {
        chain(&mut joints, Some(0), &rig.leg.replace('#', side), leg);
        // MakeHuman has a second piece between clavicle and upper arm.
        if rig.arm.contains("shoulder01") {
            let (clavicle, rest) = rig.arm.split_once(',').expect("two parts");
            chain(&mut joints, Some(chest), &clavicle.replace('#', side), &arm[..1]);
            let at = joints.len() - 1;
            chain(&mut joints, Some(at), &rest.replace('#', side).replacen("shoulder", "~shoulder", 1), &arm[1..]);
        } else {
            chain(&mut joints, Some(chest), &rig.arm.replace('#', side), &arm[collar..]);
        }
    }
    joints
}

/// Channels of the joints below the root.
#[derive(Clone, Copy, Debug)]
enum Channels {
    Rotations,
    Translations,
    ZeroTranslations,
}

/// A BVH of three frames in centimetres. In the last two the left elbow is flexed by 60 degrees about the
/// vertical.
fn bvh(joints: &[Joint], channels: Channels) -> String {
    let mut text = String::from("HIERARCHY\n");
    let mut lines = [String::new(), String::new(), String::new()];
    write_joint(joints, 0, channels, &mut text, &mut lines);
    let _ = write!(text, "MOTION\nFrames: 3\nFrame Time: 0.008333\n{}", lines.map(|line| line + "\n").concat());
    text
}

fn write_joint(joints: &[Joint], i: usize, channels: Channels, text: &mut String, lines: &mut [String; 3]) {
    let joint = &joints[i];
    let offset = (joint.at - joint.parent.map_or_else(Vector3::zeros, |p| joints[p].at)) * 100.0;
    let six = joint.parent.is_none() || !matches!(channels, Channels::Rotations);
    let names = if six {
        "6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    } else {
        "3 Zrotation Xrotation Yrotation"
    };
    let kind = if joint.parent.is_none() { "ROOT" } else { "JOINT" };
    let _ =
        write!(text, "{kind} {}\n{{\nOFFSET {} {} {}\nCHANNELS {names}\n", joint.name, offset.x, offset.y, offset.z);
    for (frame, line) in lines.iter_mut().enumerate() {
        if six {
            let zero = joint.parent.is_some() && matches!(channels, Channels::ZeroTranslations);
            let t = if zero { Vector3::zeros() } else { offset };
            let _ = write!(line, "{} {} {} ", t.x, t.y, t.z);
        }
        let _ = write!(line, "0 0 {} ", if joint.bends && frame > 0 { -60.0 } else { 0.0 });
    }
    let children: Vec<usize> = (0..joints.len()).filter(|&c| joints[c].parent == Some(i)).collect();
    for &child in &children {
        write_joint(joints, child, channels, text, lines);
    }
    if children.is_empty() {
        text.push_str("End Site\n{\nOFFSET 0 0 8\n}\n");
    }
    text.push_str("}\n");
}

/// Expected place of a joint. The left arm's joints are those of a bent frame, all others those of every frame.
fn expected(smpl: usize) -> Vector3<f64> {
    let at = place(smpl);
    if smpl != Smpl::LeftWrist as usize {
        return at;
    }
    let elbow = place(Smpl::LeftElbow as usize);
    let turn = nalgebra::Rotation3::from_axis_angle(&Vector3::y_axis(), -60f64.to_radians());
    elbow + turn * (at - elbow)
}

#[test]
fn rigs_map_to_joints_without_configuration() {
    let mut failures = Vec::new();
    for rig in &rigs() {
        for channels in [Channels::Rotations, Channels::Translations, Channels::ZeroTranslations] {
            let read = match parse_bvh(rig.name, bvh(&joints(rig), channels).as_bytes()) {
                Ok(read) => read,
                Err(error) => {
                    failures.push(format!("{} with {channels:?}: {error}", rig.name));
                    continue;
                }
            };
            let frame = &read.frames[1];
            for smpl in [0, 1, 2, 4, 5, 7, 8, 15, 16, 17, 18, 19, 20, 21] {
                // Rigs with two neck joints end in the second one. Some have more joints beyond the head.
                let [x, y, z] = frame.positions[smpl].map(f64::from);
                let off = (Vector3::new(y, z, x) - expected(smpl)).norm();
                let allowed = if smpl == 15 { 0.12 } else { 1e-3 };
                if off > allowed {
                    failures.push(format!("{} with {channels:?}: joint {smpl} is off by {off:.3} m", rig.name));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
