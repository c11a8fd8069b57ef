//! Files that clients in other languages include: the layout of a frame as Python ctypes and as a C header. The
//! test writes them from the field tables and compares them with the stored files.

use messages::{
    CHUNK_ROWS_MAX, ChunkDrop, Feedback, Header, HingeCalibration, JOINTS_MAX, Joints, LIMBS, Layout, Message, Mode,
    PolicyChunk, RAW_JOINTS_MAX, RawSkeleton, RobotId, SENTENCE_BYTES, Service, SkeletonLayout as Body,
    calibration_flag, chunk_flag, feedback_flag, joints_flag, raw_flag, source_flag,
};
use std::fmt::Write;

const PYTHON: &str = "/../../tools/clients/python/teleopd_client/layout.py";
const C: &str = "/../../tools/clients/c/teleopd.h";

/// Names, values and meanings of the numbers that a frame holds.
const NUMBERS: [(&str, u64, &str); 37] = [
    ("RAW_JOINTS_MAX", RAW_JOINTS_MAX as u64, "the most joints that a frame can carry"),
    ("LIMBS", LIMBS as u64, "left upper arm, left forearm, right upper arm, right forearm"),
    ("LAYOUT_SMPL22", Body::Smpl22 as u64, "SMPL-22, metres, x forward, y left, z up"),
    ("LAYOUT_SMPL24", Body::Smpl24 as u64, "SMPL-22 and both hands, in the same frame"),
    ("LAYOUT_XR_BD24", Body::XrBd24 as u64, "OpenXR XR_BD_body_tracking, metres, x right, y up, z back"),
    ("LAYOUT_MEDIAPIPE33", Body::MediaPipe33 as u64, "MediaPipe Pose world landmarks, metres, y down, z away"),
    ("LAYOUT_AZURE_KINECT32", Body::AzureKinect32 as u64, "Azure Kinect, mm, x right, y down, z away; w x y z"),
    ("LAYOUT_XSENS_MVN23", Body::XsensMvn23 as u64, "Xsens MVN segments, metres, z up; w x y z"),
    ("LAYOUT_UNITY", Body::UnityHumanoid as u64, "Unity HumanBodyBones, left-handed, local rotations"),
    (
        "LAYOUT_MEDIAPIPE66",
        Body::MediaPipe66 as u64,
        "MediaPipe33, then the image landmarks, heights of the image from its middle, y down",
    ),
    ("FLAG_MIRRORED", raw_flag::MIRRORED as u64, "the image was mirrored: left and right are swapped"),
    ("FLAG_ROTATIONS", raw_flag::ROTATIONS as u64, "rotations are filled"),
    (
        "FLAG_LOCAL",
        raw_flag::LOCAL as u64,
        "they are relative to the parent joint; of the positions the root's alone counts",
    ),
    ("FLAG_CLUTCH", raw_flag::CLUTCH as u64, "the robot stands until a frame without it"),
    ("FLAG_CLOSURE", raw_flag::CLOSURE as u64, "the two bytes of the hands' closures"),
    ("SENTENCE_BYTES", SENTENCE_BYTES as u64, "the most bytes of a sentence"),
    ("FEEDBACK_STATUS", feedback_flag::STATUS as u64, "mode, faults, speed_scale and sentence are known"),
    ("FEEDBACK_STATE", feedback_flag::STATE as u64, "clearances and limbs are known"),
    ("FEEDBACK_LIMB_LEFT_UPPER", feedback_flag::LIMB[0] as u64, "the person's left upper arm is seen"),
    ("FEEDBACK_LIMB_LEFT_FORE", feedback_flag::LIMB[1] as u64, "the person's left forearm is seen"),
    ("FEEDBACK_LIMB_RIGHT_UPPER", feedback_flag::LIMB[2] as u64, "the person's right upper arm is seen"),
    ("FEEDBACK_LIMB_RIGHT_FORE", feedback_flag::LIMB[3] as u64, "the person's right forearm is seen"),
    ("FEEDBACK_GRIPPER_LEFT", feedback_flag::GRIPPER[0] as u64, "the left gripper is measured"),
    ("FEEDBACK_GRIPPER_RIGHT", feedback_flag::GRIPPER[1] as u64, "the right gripper is measured"),
    ("CALIBRATION_ALL", calibration_flag::ALL as u64, "all four hinges of the calibration are valid"),
    ("JOINTS_MAX", JOINTS_MAX as u64, "the most joints of a robot"),
    ("CHUNK_ROWS_MAX", CHUNK_ROWS_MAX as u64, "the most rows of a policy's chunk"),
    ("CHUNK_VELOCITIES", chunk_flag::VELOCITIES as u64, "the chunk has velocities"),
    ("CHUNK_CLOSURE_LEFT", chunk_flag::CLOSURE[0] as u64, "the chunk has the left gripper"),
    ("CHUNK_CLOSURE_RIGHT", chunk_flag::CLOSURE[1] as u64, "the chunk has the right gripper"),
    ("JOINTS_STATE", joints_flag::STATE as u64, "the robot's state is known"),
    ("JOINTS_STATUS", joints_flag::STATUS as u64, "mode and sources are known"),
    ("JOINTS_POLICY", joints_flag::POLICY as u64, "a policy holds its lease"),
    ("SOURCE_PERSON_LEFT", source_flag::PERSON[0] as u64, "a person leads the left arm"),
    ("SOURCE_PERSON_RIGHT", source_flag::PERSON[1] as u64, "a person leads the right arm"),
    ("SOURCE_POLICY_LEFT", source_flag::POLICY[0] as u64, "a policy leads the left arm"),
    ("SOURCE_POLICY_RIGHT", source_flag::POLICY[1] as u64, "a policy leads the right arm"),
];

const C_HEAD: &str = include_str!("head.h");
const C_CLOSURE: &str = include_str!("closure.h");

const FEEDBACK: &str = "State of the robot for the person who drives it. Directions: torso, x forward, y left, z up.";

const ROBOT: &str = "The robot that a message is about.";
const CHUNK: &str = "Joint targets of a policy: row i is due at start + i * period_ns. Positions in rad or m.";
const JOINTS: &str = "The joints of the robot, 100 times a second, in rad, m and s.";

/// Returns the innermost type of a field, and the array lengths, outermost first.
fn taken_apart(ty: &str) -> (&str, Vec<&str>) {
    match ty.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).and_then(|inner| inner.rsplit_once("; ")) {
        Some((inner, count)) => {
            let (base, mut counts) = taken_apart(inner);
            counts.insert(0, count);
            (base, counts)
        }
        None => (ty, vec![]),
    }
}

fn python_class<M: Message>(out: &mut String, what: &str) {
    writeln!(out, "\n\nclass {}(ctypes.Structure):\n    \"\"\"{what}\"\"\"\n\n    _fields_ = [", M::NAME).unwrap();
    for field in M::FIELDS {
        let (base, counts) = taken_apart(field.ty);
        let base = match base {
            "u8" => "ctypes.c_uint8",
            "u32" => "ctypes.c_uint32",
            "u64" | "Stamp" => "ctypes.c_uint64",
            "f32" => "ctypes.c_float",
            "f64" => "ctypes.c_double",
            own => own,
        };
        // The innermost count comes first in ctypes.
        let ty = counts.iter().rev().fold(base.to_owned(), |ty, count| format!("({ty} * {count})"));
        let ty = ty.strip_prefix('(').and_then(|ty| ty.strip_suffix(')')).unwrap_or(&ty);
        writeln!(out, "        (\"{}\", {ty}),", field.name).unwrap();
    }
    let name = M::TYPE_NAME;
    writeln!(out, "    ]\n\n    @staticmethod\n    def type_name():").unwrap();
    writeln!(out, "        \"\"\"The name under which the transport knows the layout.\"\"\"").unwrap();
    writeln!(out, "        return \"{}\"", name.as_str()).unwrap();
    writeln!(out, "\n\nassert ctypes.sizeof({}) == {}", M::NAME, size_of::<M>()).unwrap();
}

fn python() -> String {
    let row = Service::RawSkeleton.row();
    let mut out = String::from(
        "\"\"\"The layout of a frame. Written by cargo test -p messages --test all clients -- --ignored; not to be edited.\"\"\"\n\n\
         import ctypes\n\n",
    );
    for (name, value, what) in NUMBERS {
        writeln!(out, "#: {what}\n{name} = {value}").unwrap();
    }
    writeln!(out, "#: name of the service that clients write\nSERVICE = \"{}\"", row.name).unwrap();
    writeln!(out, "#: name of the service that wakes its reader\nEVENT_SERVICE = \"{}/event\"", row.name).unwrap();
    let modes = Mode::ALL.map(|mode| format!("\"{}\"", mode.name())).join(", ");
    writeln!(out, "#: names of `Feedback.mode`\nMODES = ({modes})").unwrap();
    let feedback = Service::Feedback.row().name;
    writeln!(out, "#: name of the service that tells clients about the robot\nFEEDBACK_SERVICE = \"{feedback}\"")
        .unwrap();
    let (chunks, joints) = (Service::PolicyChunk.row().name, Service::Joints.row().name);
    writeln!(out, "#: name of the service that policies write\nPOLICY_SERVICE = \"{chunks}\"").unwrap();
    writeln!(out, "#: name of the service that has the joints\nJOINTS_SERVICE = \"{joints}\"").unwrap();
    let drops = ChunkDrop::ALL.map(|drop| format!("    \"{}: {}\",\n", drop.name(), drop.meaning())).concat();
    writeln!(
        out,
        "#: reasons for which a chunk is dropped: `Joints.chunk_dropped_why` less one\nCHUNK_DROPS = (\n{drops})"
    )
    .unwrap();
    writeln!(out, "#: frames a second that a client may publish at most\nRATE_MAX_HZ = {}", row.rate_hz).unwrap();
    python_class::<Header>(&mut out, "What every message begins with. Times are CLOCK_MONOTONIC, ns.");
    python_class::<HingeCalibration>(
        &mut out,
        "Elbow hinge axes, unit vectors in the frames of the joints that carry them.",
    );
    python_class::<RawSkeleton>(&mut out, "A frame of a person.");
    python_class::<Feedback>(&mut out, FEEDBACK);
    python_class::<RobotId>(&mut out, ROBOT);
    python_class::<PolicyChunk>(&mut out, CHUNK);
    python_class::<Joints>(&mut out, JOINTS);
    out
}

fn c_name(rust: &str) -> String {
    let mut out = String::from("teleop");
    for letter in rust.chars() {
        if letter.is_ascii_uppercase() {
            out.push('_');
        }
        out.push(letter.to_ascii_lowercase());
    }
    out
}

fn c_struct<M: Message>(out: &mut String, what: &str) {
    let name = c_name(M::NAME);
    writeln!(out, "\n/* {what} */\ntypedef struct {name} {{").unwrap();
    for field in M::FIELDS {
        let (base, counts) = taken_apart(field.ty);
        let base = match base {
            "u8" => "uint8_t".to_owned(),
            "u32" => "uint32_t".to_owned(),
            "u64" | "Stamp" => "uint64_t".to_owned(),
            "f32" => "float".to_owned(),
            "f64" => "double".to_owned(),
            own => c_name(own),
        };
        let count = |count: &&str| {
            if count.parse::<u64>().is_ok() { format!("[{count}]") } else { format!("[TELEOP_{count}]") }
        };
        let counts: String = counts.iter().map(count).collect();
        writeln!(out, "    {base} {}{counts};", field.name).unwrap();
    }
    writeln!(out, "}} {name};").unwrap();
    let upper = name.to_uppercase();
    writeln!(out, "#define {upper}_TYPE_NAME \"{}\"", M::TYPE_NAME.as_str()).unwrap();
    writeln!(out, "TELEOP_ASSERT(sizeof({name}) == {}, \"{name}\");", size_of::<M>()).unwrap();
    for field in M::FIELDS {
        writeln!(out, "TELEOP_ASSERT(offsetof({name}, {0}) == {1}, \"{0}\");", field.name, field.offset).unwrap();
    }
}

fn c() -> String {
    let row = Service::RawSkeleton.row();
    let mut out = C_HEAD.to_owned();
    for (name, value, what) in NUMBERS {
        writeln!(out, "/* {what} */\n#define TELEOP_{name} {value}").unwrap();
    }
    for mode in Mode::ALL {
        writeln!(out, "#define TELEOP_MODE_{} {}", mode.name().to_uppercase(), mode as u32).unwrap();
    }
    let (chunks, joints) = (Service::PolicyChunk.row().name, Service::Joints.row().name);
    writeln!(out, "/* the service that policies write, and the one that has the joints */").unwrap();
    writeln!(out, "#define TELEOP_POLICY_SERVICE \"{chunks}\"\n#define TELEOP_JOINTS_SERVICE \"{joints}\"").unwrap();
    let feedback = Service::Feedback.row().name;
    writeln!(
        out,
        "/* the service that tells clients about the robot */\n#define TELEOP_FEEDBACK_SERVICE \"{feedback}\""
    )
    .unwrap();
    writeln!(out, "/* the service that clients write, and the one that wakes its reader */").unwrap();
    writeln!(out, "#define TELEOP_SERVICE \"{0}\"\n#define TELEOP_EVENT_SERVICE \"{0}/event\"", row.name).unwrap();
    c_struct::<Header>(&mut out, "What every message begins with. Times are CLOCK_MONOTONIC, ns.");
    c_struct::<HingeCalibration>(
        &mut out,
        "Elbow hinge axes, unit vectors in the frames of the joints that carry them.",
    );
    c_struct::<RawSkeleton>(&mut out, "A frame of a person.");
    c_struct::<Feedback>(&mut out, FEEDBACK);
    c_struct::<RobotId>(&mut out, ROBOT);
    c_struct::<PolicyChunk>(&mut out, CHUNK);
    c_struct::<Joints>(&mut out, JOINTS);
    out.push_str(C_CLOSURE);
    out.push_str("\n#endif\n");
    out
}

fn path(relative: &str) -> String {
    format!("{}{relative}", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn python_and_c_files_match_layout() {
    for (file, text) in [(PYTHON, python()), (C, c())] {
        let stored = std::fs::read_to_string(path(file)).unwrap_or_default();
        assert!(stored == text, "{file}: write it again: cargo test -p messages --test all clients -- --ignored");
    }
    assert_eq!(taken_apart("[[f32; 3]; LIMBS]"), ("f32", vec!["LIMBS", "3"]));
}

/// A C compiler and a C++ compiler check the header.
#[test]
fn c_and_cpp_compilers_accept_header() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    for (compiler, file) in [("cc", "client.c"), ("c++", "client.cpp")] {
        let source = folder.join(file);
        let text = "#include \"teleopd.h\"\nint main(void) { teleop_raw_skeleton frame; frame.layout = TELEOP_LAYOUT_SMPL22; \
                    frame.flags = teleop_with_closure(0, 0.5f, 1.0f); \
                    return frame.layout == 0; }\n";
        std::fs::write(&source, text).unwrap();
        let header = std::path::Path::new(&path(C)).parent().unwrap().to_owned();
        let run = std::process::Command::new(compiler)
            .args(["-Wall", "-Wextra", "-Werror", "-c", "-I"])
            .arg(header)
            .arg(&source)
            .arg("-o")
            .arg(folder.join("client.o"))
            .output();
        match run {
            Ok(done) => assert!(done.status.success(), "{compiler}: {}", String::from_utf8_lossy(&done.stderr)),
            // The build itself needs a C compiler.
            Err(error) if compiler == "cc" => panic!("{compiler}: {error}"),
            Err(error) => println!("note: not tried: {compiler}: {error}"),
        }
    }
}

#[test]
#[ignore = "writes the files: cargo test -p messages --test all clients -- --ignored"]
fn write_python_and_c_files() {
    std::fs::write(path(PYTHON), python()).unwrap();
    std::fs::write(path(C), c()).unwrap();
    assert_ne!(RawSkeleton::HASH, 0);
}
