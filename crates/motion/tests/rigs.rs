//! Tests rigs of many exporters by their joints' names and tree. Each maps without configuration. Joints have
//! either rotations or also positions.

use messages::Smpl;
use motion::{BvhError, builtin, parse_bvh};
use nalgebra::Vector3;
use std::fmt::Write;

/// Names of a rig's joints, separated by commas. A name may contain spaces. `|` precedes the neck. `#` is replaced by
/// each side's name, so the rig has that joint twice. `~` marks a joint without length, which the mapping must skip.
struct Rig {
    name: &'static str,
    trunk: &'static str,
    leg: &'static str,
    arm: &'static str,
    sides: [&'static str; 2],
}

const fn rig(
    name: &'static str,
    sides: [&'static str; 2],
    trunk: &'static str,
    leg: &'static str,
    arm: &'static str,
) -> Rig {
    Rig { name, trunk, leg, arm, sides }
}

const WORDS: [&str; 2] = ["Left", "Right"];
const LOWER: [&str; 2] = ["left", "right"];
const LETTERS: [&str; 2] = ["L", "R"];
const SMALL: [&str; 2] = ["l", "r"];

#[rustfmt::skip]
const RIGS: [Rig; 27] = [
    rig("Mixamo", WORDS, "mixamorig:Hips,mixamorig:Spine,mixamorig:Spine1,mixamorig:Spine2|mixamorig:Neck,mixamorig:Head,mixamorig:HeadTop_End",
        "mixamorig:#UpLeg,mixamorig:#Leg,mixamorig:#Foot,mixamorig:#ToeBase",
        "mixamorig:#Shoulder,mixamorig:#Arm,mixamorig:#ForeArm,mixamorig:#Hand,mixamorig:#HandThumb1"),
    rig("Mixamo, numbered", WORDS, "mixamorig7_Hips,mixamorig7_Spine,mixamorig7_Spine1|mixamorig7_Neck,mixamorig7_Head",
        "mixamorig7_#UpLeg,mixamorig7_#Leg,mixamorig7_#Foot,mixamorig7_#ToeBase",
        "mixamorig7_#Shoulder,mixamorig7_#Arm,mixamorig7_#ForeArm,mixamorig7_#Hand"),
    rig("LAFAN1", WORDS, "Hips,Spine,Spine1,Spine2|Neck,Head", "#UpLeg,#Leg,#Foot,#Toe", "#Shoulder,#Arm,#ForeArm,#Hand"),
    rig("CMU by cgspeed", WORDS, "Hips,LowerBack,Spine,Spine1|Neck,Neck1,Head",
        "~#HipJoint,#UpLeg,#Leg,#Foot,#ToeBase", "#Shoulder,#Arm,#ForeArm,#Hand,#FingerBase,#HandIndex1"),
    rig("side last", LETTERS, "Pelvis,Spine,Chest|Neck,Head", "UpperLeg_#,LowerLeg_#,Foot_#,Toe_#",
        "Clavicle_#,UpperArm_#,LowerArm_#,Hand_#"),
    rig("MVN", WORDS, "Hips,Chest,Chest2,Chest3,Chest4|Neck,Head", "#Hip,#Knee,#Ankle,#Toe", "#Collar,#Shoulder,#Elbow,#Wrist"),
    rig("MVN segments", WORDS, "Pelvis,L5,L3,T12,T8|Neck,Head", "#UpperLeg,#LowerLeg,#Foot,#Toe",
        "#Shoulder,#UpperArm,#ForeArm,#Hand"),
    rig("Unity", WORDS, "Hips,Spine,Chest,UpperChest|Neck,Head", "#UpperLeg,#LowerLeg,#Foot,#Toes",
        "#Shoulder,#UpperArm,#LowerArm,#Hand,#IndexProximal"),
    rig("VRM", LOWER, "hips,spine,chest,upperChest|neck,head", "#UpperLeg,#LowerLeg,#Foot,#Toes",
        "#Shoulder,#UpperArm,#LowerArm,#Hand"),
    rig("VRoid", LETTERS, "J_Bip_C_Hips,J_Bip_C_Spine,J_Bip_C_Chest,J_Bip_C_UpperChest|J_Bip_C_Neck,J_Bip_C_Head",
        "J_Bip_#_UpperLeg,J_Bip_#_LowerLeg,J_Bip_#_Foot,J_Bip_#_ToeBase",
        "J_Bip_#_Shoulder,J_Bip_#_UpperArm,J_Bip_#_LowerArm,J_Bip_#_Hand"),
    rig("VRChat", WORDS, "Hips,Spine,Chest|Neck,Head", "# leg,# knee,# ankle,# toe", "# shoulder,# arm,# elbow,# wrist"),
    rig("Rokoko", WORDS, "Hips,Spine1,Spine2,Spine3,Spine4|Neck,Head", "#Thigh,#Shin,#Foot,#Toe",
        "#Shoulder,#Arm,#ForeArm,#Hand"),
    rig("Rigify", LETTERS, "spine,spine.001,spine.002,spine.003|spine.004,spine.005,spine.006",
        "thigh.#,shin.#,foot.#,toe.#", "shoulder.#,upper_arm.#,forearm.#,hand.#,palm.01.#"),
    rig("Rigify, deforming", LETTERS, "DEF-spine,DEF-spine.001,DEF-spine.003|DEF-spine.004,DEF-spine.006",
        "DEF-thigh.#,~DEF-thigh.#.001,DEF-shin.#,~DEF-shin.#.001,DEF-foot.#,DEF-toe.#",
        "DEF-shoulder.#,DEF-upper_arm.#,~DEF-upper_arm.#.001,DEF-forearm.#,~DEF-forearm.#.001,DEF-hand.#"),
    rig("3ds Max", LETTERS, "Bip01 Pelvis,Bip01 Spine,Bip01 Spine1|Bip01 Neck,Bip01 Head",
        "Bip01 # Thigh,Bip01 # Calf,Bip01 # Foot,Bip01 # Toe0", "Bip01 # Clavicle,Bip01 # UpperArm,Bip01 # Forearm,Bip01 # Hand"),
    rig("3ds Max, underscores", LETTERS, "Bip001_Pelvis,Bip001_Spine,Bip001_Spine1|Bip001_Neck,Bip001_Head",
        "Bip001_#_Thigh,Bip001_#_Calf,Bip001_#_Foot,Bip001_#_Toe0",
        "Bip001_#_Clavicle,Bip001_#_UpperArm,Bip001_#_Forearm,Bip001_#_Hand"),
    rig("Source", LETTERS, "ValveBiped.Bip01_Pelvis,ValveBiped.Bip01_Spine,ValveBiped.Bip01_Spine2|ValveBiped.Bip01_Neck1,ValveBiped.Bip01_Head",
        "ValveBiped.Bip01_#_Thigh,ValveBiped.Bip01_#_Calf,ValveBiped.Bip01_#_Foot,ValveBiped.Bip01_#_Toe0",
        "ValveBiped.Bip01_#_Clavicle,ValveBiped.Bip01_#_UpperArm,ValveBiped.Bip01_#_Forearm,ValveBiped.Bip01_#_Hand"),
    rig("ASF", SMALL, "root,lowerback,upperback,thorax|lowerneck,upperneck,head", "~#hipjoint,#femur,#tibia,#foot,#toes",
        "#clavicle,#humerus,#radius,#wrist,~#hand,#fingers"),
    rig("Vicon", LETTERS, "Pelvis,Thorax|Head", "#Femur,#Tibia,#Foot,#Toes", "#Clav,#Humerus,#Radius,#Hand"),
    rig("SMPL in Maya", LETTERS, "m_avg_Pelvis,m_avg_Spine1,m_avg_Spine2,m_avg_Spine3|m_avg_Neck,m_avg_Head",
        "m_avg_#_Hip,m_avg_#_Knee,m_avg_#_Ankle,m_avg_#_Foot",
        "m_avg_#_Collar,m_avg_#_Shoulder,m_avg_#_Elbow,m_avg_#_Wrist,m_avg_#_Hand"),
    rig("AdvancedSkeleton", LETTERS, "Root_M,Spine1_M,Chest_M|Neck_M,Head_M", "Hip_#,Knee_#,Ankle_#,Toes_#",
        "Scapula_#,Shoulder_#,Elbow_#,Wrist_#"),
    rig("Poser", SMALL, "hip,abdomen,chest|neck,head", "~#Buttock,#Thigh,#Shin,#Foot", "#Collar,#Shldr,#ForeArm,#Hand"),
    rig("Daz", SMALL, "hip,abdomenLower,chestUpper|neckLower,head", "#ThighBend,~#ThighTwist,#Shin,#Foot,#Toe",
        "#Collar,#ShldrBend,~#ShldrTwist,#ForearmBend,~#ForearmTwist,#Hand"),
    rig("Motive", LETTERS, "Hip,Ab,Chest|Neck,Head", "#Thigh,#Shin,#Foot,#Toe", "#Shoulder,#UArm,#FArm,#Hand"),
    rig("MakeHuman", LETTERS, "root,spine05,spine03,spine01|neck01,head", "upperleg01.#,~upperleg02.#,lowerleg01.#,foot.#,toe1-1.#",
        "clavicle.#,shoulder01.#,upperarm01.#,~upperarm02.#,lowerarm01.#,wrist.#"),
    rig("Unreal", SMALL, "pelvis,spine_01,spine_02,spine_03|neck_01,head", "thigh_#,calf_#,foot_#,ball_#",
        "clavicle_#,upperarm_#,~upperarm_twist_01_#,lowerarm_#,hand_#"),
    rig("no clavicle, no neck", WORDS, "Hips,Chest|Head", "#Hip,#Knee,#Ankle", "#Shoulder,#Elbow,#Wrist"),
];

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
    for rig in &RIGS {
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

#[test]
fn rig_without_elbow_is_refused_by_joint_name() {
    let text = bvh(&joints(&RIGS[2]), Channels::Rotations).replace("LeftForeArm", "LeftTentacle");
    let error = parse_bvh("rig", text.as_bytes()).expect_err("no elbow");
    assert!(matches!(&error, BvhError::MissingJoints { missing, .. } if missing == &["left_elbow"]), "{error}");
    assert!(error.to_string().contains("LeftTentacle"));
}
