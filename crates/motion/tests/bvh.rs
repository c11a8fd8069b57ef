//! Tests the BVH reader: every supported rig, unit and axis, and every kind of damage.

use motion::{BvhError, MirrorError, Motion, MotionError, builtin, load, parse_bvh, save_bvh, write_bvh};
use std::collections::HashMap;

/// A short motion whose limbs all move.
fn short() -> Motion {
    let mut motion = builtin();
    motion.frames = motion.frames.iter().skip(60).step_by(40).take(12).copied().collect();
    motion.first = Some(builtin().frames[0]);
    motion
}

/// Returns the motion with the positions of every frame changed.
fn reshaped(mut motion: Motion, change: impl Fn([[f32; 3]; 22]) -> [[f32; 3]; 22]) -> Motion {
    motion.frames.iter_mut().chain(motion.first.as_mut()).for_each(|frame| frame.positions = change(frame.positions));
    motion
}

fn largest_difference(a: &Motion, b: &Motion) -> (f32, f32) {
    assert_eq!(a.frames.len(), b.frames.len());
    let (mut position, mut rotation) = (0.0f32, 0.0f32);
    for (a, b) in a.frames.iter().zip(&b.frames) {
        for j in 0..22 {
            for c in 0..3 {
                position = position.max((a.positions[j][c] - b.positions[j][c]).abs());
            }
            let dot: f32 = (0..4).map(|c| a.rotations[j][c] * b.rotations[j][c]).sum();
            rotation = rotation.max(1.0 - dot.abs());
        }
    }
    (position, rotation)
}

fn assert_same(a: &Motion, b: &Motion) {
    let (position, rotation) = largest_difference(a, b);
    assert!(position < 1e-5 && rotation < 1e-6, "positions differ by {position} m, rotations by {rotation}");
}

#[test]
fn bvh_survives_write_and_read() {
    let motion = short();
    let read = parse_bvh("short", write_bvh(&motion).as_bytes()).expect("our own file");
    assert_same(&motion, &read);
    assert_eq!((read.guesses.unit, read.guesses.up), ("cm", "+Y"));
    assert!(read.guesses.warnings.is_empty(), "{:?}", read.guesses.warnings);
    assert!((read.frame_rate_hz - 60.0).abs() < 1e-3);
    assert!(read.first.is_some(), "frame 0 is kept beside the motion");
}

#[test]
fn root_relative_to_its_offset_stands_on_floor() {
    let motion = short();
    let text = write_bvh(&motion);
    let (hierarchy, frames) = text.split_once("Frame Time: ").expect("two parts");
    let root: f64 = hierarchy.lines().nth(3).and_then(|l| l.split_whitespace().nth(2)).expect("y").parse().expect("y");
    let mut lines = frames.lines();
    let mut out = format!("{hierarchy}Frame Time: {}\n", lines.next().expect("a time"));
    for line in lines {
        let mut words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
        words[1] = format!("{:.6}", words[1].parse::<f64>().expect("y") - root);
        out += &(words.join(" ") + "\n");
    }
    let read = parse_bvh("relative", out.as_bytes()).expect("a relative root");
    for (a, b) in motion.frames.iter().zip(&read.frames) {
        assert!((a.positions[7][2] - b.positions[7][2]).abs() < 1e-5);
    }
}

#[test]
fn bvh_unit_is_guessed_and_unknown_unit_is_scaled() {
    let motion = short();
    for (factor, unit) in [(0.01, "m"), (10.0, "mm"), (1.0 / 2.54, "inch"), (1.0 / 5.6444, "CMU unit")] {
        let scaled = reshaped(motion.clone(), |joints| joints.map(|p| p.map(|c| c * factor as f32)));
        let read = parse_bvh("unit", write_bvh(&scaled).as_bytes()).expect(unit);
        assert_eq!(read.guesses.unit, unit);
        // The writer's six decimals in a file in metres are 1 um. A chain of bones sums a few of them.
        assert!(largest_difference(&motion, &read).0 < 3e-5, "{unit}");
    }
    let dwarf = reshaped(motion, |joints| joints.map(|p| p.map(|c| c * 0.1)));
    let read = parse_bvh("dwarf", write_bvh(&dwarf).as_bytes()).expect("a dwarf");
    assert_eq!((read.guesses.unit, read.guesses.stature_m), ("scaled to 1.75 m", 1.75));
    assert_eq!(read.guesses.warnings.len(), 1);
}

#[test]
fn up_axis_does_not_follow_a_person_who_lies_or_bends() {
    // The rest pose stands along Y. The person lies on the floor or a bed, is turned by an exporter, has only the root on the floor,
    // begins upside down, gets up, lies down and rises.
    let rig = include_str!("data/lies.txt");
    let folder = tempfile::tempdir().expect("a folder");
    for (up, roots, never) in [
        ("+Y", ["0 20 0 90 0 0"; 3], true),
        ("+Y", ["0 80 0 -90 0 0"; 3], true),
        ("+Z", ["0 0 100 90 0 0"; 3], false),
        ("+Y", ["0 100 0 0 0 0"; 3], false),
        ("+Y", ["0 100 0 180 0 0"; 3], true),
        ("+Y", ["0 0 100 90 0 0", "0 100 100 0 0 0", "0 100 100 0 0 0"], false),
        ("+Y", ["0 100 0 0 0 0", "0 100 0 90 0 0", "0 100 0 90 0 0"], true),
        ("+Y", ["0 100 0 85 0 0", "0 100 0 0 0 0", "0 100 0 0 0 0"], false),
    ] {
        let lines = roots.map(|root| format!("{root}{}\n", " 0".repeat(24))).concat();
        let text = format!("{rig}MOTION\nFrames: 3\nFrame Time: 0.02\n{lines}");
        assert_eq!(parse_bvh(up, text.as_bytes()).expect(up).guesses.up, up, "{roots:?}");
        let path = folder.path().join("lies.bvh");
        std::fs::write(&path, &text).expect("written");
        let warnings = load(&path).expect("a motion").guesses.warnings.join("; ");
        assert_eq!(warnings.contains("in no frame: no robot follows"), never, "{roots:?}: {warnings}");
    }
}

#[test]
fn first_frame_that_is_motion_is_kept() {
    let mut motion = short();
    motion.first = None;
    let text = write_bvh(&motion);
    let read = parse_bvh("motion", text.as_bytes()).expect("a motion");
    assert_eq!((read.first, read.frames.len()), (None, motion.frames.len()));
    assert_same(&motion, &read);
    // A T-pose before it, or a posture from which the file jumps, is none.
    for first in [builtin().frames[0], short().frames[6]] {
        let mut slow = builtin();
        slow.frames = slow.frames[60..72].to_vec();
        slow.first = Some(first);
        let read = parse_bvh("rest", write_bvh(&slow).as_bytes()).expect("a motion");
        assert!(read.first.is_some());
        assert_same(&slow, &read);
    }
}

#[test]
fn mirrored_body_or_swapped_names_are_refused() {
    let mirrored = reshaped(short(), |joints| joints.map(|[x, y, z]| [x, -y, z]));
    let error = parse_bvh("mirror", write_bvh(&mirrored).as_bytes()).expect_err("a mirror image");
    assert!(matches!(error, BvhError::Mirror(MirrorError::Mirrored { .. })), "{error}");
    let swapped = write_bvh(&short()).replace("Left", "L#").replace("Right", "Left").replace("L#", "Right");
    let error = parse_bvh("swapped", swapped.as_bytes()).expect_err("swapped sides");
    assert!(matches!(error, BvhError::Mirror(MirrorError::Mirrored { .. })), "{error}");
    // Hips across whose breadth a camera looks prove nothing.
    let noisy = reshaped(short(), |mut joints| {
        let [x, y, z] = joints[0];
        [joints[1], joints[2]] = [0.1, -0.1].map(|far| [x + far, y - 0.1 * far, z - 0.05]);
        joints
    });
    parse_bvh("noisy", write_bvh(&noisy).as_bytes()).expect("a person");
}

#[test]
fn missing_joints_are_named_in_error() {
    let text = write_bvh(&short()).replace("LeftForeArm", "Tentacle").replace("RightUpLeg", "Wheel");
    let error = parse_bvh("rig", text.as_bytes()).expect_err("joints are missing");
    let BvhError::MissingJoints { missing, found } = &error else { panic!("{error}") };
    assert_eq!(missing, &["right_hip", "left_elbow"]);
    assert!(found.contains(&"Tentacle".to_owned()));
    assert!(error.to_string().contains("for --map, such as right_hip = "), "{error}");
}

#[test]
fn joints_that_the_user_names_are_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let [rig, map] = ["rig.bvh", "names.toml"].map(|name| folder.path().join(name));
    let text = write_bvh(&short()).replace("LeftForeArm", "Tentacle").replace("RightUpLeg", "Wheel");
    std::fs::write(&rig, text).expect("written");
    let options = motion::LoadOptions { map: Some(map.clone()), ..motion::LoadOptions::default() };
    for (named, expected) in [
        ("left_elbow = \"Tentacle\"\nright_hip = \"Wheel\"", ""),
        ("left_elbow = \"Tentacle\"", "no joint for right_hip"),
        (
            "left_elbow = \"Arm\"\nright_hip = \"Wheel\"",
            "the map gives left_elbow the name \"Arm\", which no joint has",
        ),
        ("elbow = \"Arm\"", "names.toml: elbow is no joint; the joints are pelvis, left_hip"),
        ("left_elbow = 3", "1 | left_elbow = 3\n"),
    ] {
        std::fs::write(&map, named).expect("written");
        match motion::load_with(&rig, &options) {
            Ok(read) => assert!(expected.is_empty() && largest_difference(&short(), &read).0 < 1e-5),
            Err(error) => assert!(!expected.is_empty() && error.to_string().contains(expected), "{named}: {error}"),
        }
    }
}

#[test]
fn f104_damaged_bvh_error_names_cause() {
    let good = write_bvh(&short());
    let ended = [good.as_bytes(), b"\x1a\0\0"].concat();
    assert!(parse_bvh("of DOS, in blocks of a disk", &ended).is_ok());
    let lines: Vec<&str> = good.lines().collect();
    let count = lines.len();
    let whole =
        |frames: usize| format!("the file ends after {frames} of 13 frames: it was cut; copy or export it again");
    let nested = format!("HIERARCHY\nROOT a\n{{\n{}", "JOINT b\n{\n".repeat(100_000));
    let wide = format!("HIERARCHY\nROOT a\n{{\n{}", "JOINT b\n{\n}\n".repeat(100_000));
    let (last, short) =
        (good.trim_end().rsplit_once(' ').expect("a number").0, lines[count - 10].trim_end().rsplit_once(' '));
    let less = good.replace(lines[count - 10], short.expect("a number").0);
    let more = &format!("{} 1", lines[count - 10]);
    let flat = format!("{}\n{}", lines[..count - 13].join("\n"), &lines[count - 13..].join(" ")[..1000]);
    let mut cases: Vec<(Vec<u8>, String)> = vec![
        (b"".to_vec(), "empty".into()),
        (b" \n\t\r\n ".to_vec(), "empty".into()),
        (b"PK\x03\x04\xff\xfe".to_vec(), "line 1: ".into()),
        ([good.as_bytes(), b"\xff\xff".as_slice()].concat(), "more numbers than".into()),
        (nested.into(), "nested joints: 129, at most 128".into()),
        (wide.into(), "joints: 2049, at most 2048".into()),
        (good.split("JOINT LeftLeg").next().unwrap_or("").into(), "the file ends, expected".into()),
        (good.split("position").next().unwrap_or("").into(), "the file ends, expected Xposition".into()),
        (last.into(), format!("line {count}: {}", whole(12))),
        (lines[..count - 6].join("\n").into(), format!("line {}: {}", count - 6, whole(7))),
        (less.into(), format!("line {} has 131 numbers, and a frame 132; correct the line", count - 9)),
        (good.replace(lines[count - 10], more).into(), format!("line {} has 133 numbers, and a", count - 9)),
        (flat.into(), "of 13 frames: it was cut".into()),
    ];
    let mut tables: HashMap<String, Vec<[String; 3]>> =
        toml::from_str(include_str!("bvh_refusals.toml")).expect("tables");
    let changes = tables.remove("changes").expect("a table").into_iter();
    cases.extend(changes.map(|[part, other, text]| (good.replace(&part, &other).into(), text)));
    for (text, expected) in cases {
        let error = parse_bvh("damaged", &text).map(drop).expect_err(&expected).to_string();
        assert!(error.contains(&expected), "{expected}: {error}");
    }
}

#[test]
fn rig_without_size_is_refused() {
    let flat = reshaped(short(), |_| [[0.0; 3]; 22]);
    let error = parse_bvh("flat", write_bvh(&flat).as_bytes()).expect_err("no size");
    assert!(matches!(error, BvhError::NoSize { .. }), "{error}");
}

#[test]
fn f104_files_are_loaded_by_extension_and_bounded_in_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("clip.BVH");
    save_bvh(&short(), &path).expect("saved");
    assert_eq!(load(&path).expect("read").name, "clip");
    let other = folder.path().join("clip.fbx");
    std::fs::write(&other, "x").expect("saved");
    assert!(matches!(load(&other), Err(MotionError::UnknownFormat { .. })));
    assert!(matches!(load(std::env::temp_dir().as_path()), Err(MotionError::Folder { .. })));
    assert!(matches!(load(&folder.path().join("none.bvh")), Err(MotionError::Io { .. })));
    let huge = folder.path().join("huge.bvh");
    // A sparse file of 10 GB takes no disk space.
    std::fs::File::create(&huge).expect("created").set_len(10_000_000_000).expect("sparse");
    let error = load(&huge).expect_err("too large");
    assert!(error.to_string().contains("10000000000 bytes, at most 134217728"), "{error}");
}
