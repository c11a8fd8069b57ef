//! Tests .npy and .npz: HumanML3D in both formats, AMASS, and every kind of damage. The tests make their data
//! from the built-in motion. They also read the sample beside the repository, if it is there.

use crate::writers;

use messages::{HingeCalibration, Layout};
use motion::{CalibrationMode, LoadOptions, Motion, MotionError, Up, builtin, calibrate, limbs, load, load_with, npy};
use std::path::{Path, PathBuf};
use writers::*;

/// Returns every third frame of the built-in motion, at 20 Hz. All of its poses appear.
pub fn short() -> Motion {
    let mut motion = builtin();
    motion.frames = motion.frames.into_iter().step_by(3).collect();
    motion.frame_rate_hz = 20.0;
    motion
}

pub fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder")
}

/// Largest angle between the limb rotations of two motions, degrees.
pub fn largest_angle(a: &Motion, b: &Motion) -> f64 {
    assert_eq!(a.frames.len(), b.frames.len());
    let none = HingeCalibration::ZERO;
    let both = limbs(a, &none).into_iter().zip(limbs(b, &none));
    both.flat_map(|(a, b)| (0..4).map(move |limb| angle_deg(a[limb], b[limb]))).fold(0.0, f64::max)
}

fn message(path: &Path) -> String {
    load(path).expect_err("should be refused").to_string()
}

#[test]
fn positions_are_read_in_every_layout() {
    let folder = folder();
    let motion = short();
    let values_of_frames = positions_y_up(&motion);
    let (n, values) = (motion.frames.len(), &values_of_frames);
    // The frames last, as networks return one motion.
    let last: Vec<f64> = (0..66).flat_map(|column| values.chunks_exact(66).map(move |frame| frame[column])).collect();
    // Thirty more joints, those of the hands.
    let hands: Vec<f64> = values.chunks_exact(66).flat_map(|frame| [frame, &[0.5; 90]].concat()).collect();
    let layouts: [(&str, &[usize], Kind); 10] = [
        ("f32", &[n, 22, 3], Kind::F32),
        ("f64", &[n, 22, 3], Kind::F64),
        ("big", &[n, 22, 3], Kind::BigF32),
        ("fortran", &[n, 22, 3], Kind::FortranF64),
        ("batch", &[1, n, 22, 3], Kind::F32),
        ("fortran-last", &[n, 22, 3, 1], Kind::FortranF64),
        ("half", &[n, 22, 3], Kind::F16),
        ("flat", &[n, 66], Kind::F32),
        ("frames-last", &[1, 22, 3, n], Kind::F32),
        ("with-hands", &[n, 52, 3], Kind::F32),
    ];
    for (name, shape, kind) in layouts {
        let path = folder.path().join(format!("{name}.npy"));
        let values = [("frames-last", &last), ("with-hands", &hands)].into_iter().find(|(own, _)| *own == name);
        write_npy(&path, shape, values.map_or(&values_of_frames, |(_, values)| values), kind);
        let read = load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((read.frame_rate_hz, read.has_rotations, read.first), (20.0, false, None));
        assert_eq!((read.guesses.unit, read.guesses.up), ("m", "+Y"));
        let [rate] = read.guesses.warnings.as_slice() else { panic!("{name}: {:?}", read.guesses.warnings) };
        assert!(rate.starts_with("no rate in the file: 20 Hz"), "{name}: {rate}");
        // A half has ten bits: half a millimetre of a metre.
        let allowed = if name == "half" { 1e-3 } else { 1e-5 };
        for (a, b) in motion.frames.iter().zip(&read.frames) {
            assert_eq!(b.rotations, [[0.0, 0.0, 0.0, 1.0]; 22]);
            for (a, b) in a.positions.iter().flatten().zip(b.positions.iter().flatten()) {
                assert!((a - b).abs() < allowed, "{name}: {a} is read as {b}");
            }
        }
    }
}

#[test]
fn positions_with_z_up_are_read_with_that_option() {
    let folder = folder();
    let motion = positions_only(short());
    let (positions, vectors) = (folder.path().join("z.npy"), folder.path().join("vecs.npy"));
    let values: Vec<f64> = motion.frames.iter().flat_map(|frame| frame.positions).flatten().map(f64::from).collect();
    write_npy(&positions, &[motion.frames.len(), 22, 3], &values, Kind::F32);
    let lying = load(&positions).expect("a motion");
    assert!(lying.guesses.warnings.iter().any(|warning| warning.contains("--up z")), "{:?}", lying.guesses.warnings);
    let options = LoadOptions { up: Some(Up::Z), ..LoadOptions::default() };
    let read = load_with(&positions, &options).expect("a motion");
    assert_eq!((read.guesses.up, read.guesses.warnings.len()), ("+Z", 1), "the rate alone");
    for (a, b) in motion.frames.iter().zip(&read.frames) {
        let far = a.positions.iter().flatten().zip(b.positions.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(far.fold(0.0, f32::max) < 1e-5);
    }
    write_npy(&vectors, &[motion.frames.len(), 263], &features(&motion), Kind::F32);
    assert_eq!(load_with(&vectors, &options).expect("a motion").guesses.up, "+Y", "features have y up");
}

#[test]
fn positions_and_features_give_limbs_of_their_source_motion() {
    let folder = folder();
    let motion = positions_only(short());
    write_npy(&folder.path().join("joints.npy"), &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F32);
    let features = features(&motion);
    write_npy(&folder.path().join("vecs.npy"), &[motion.frames.len(), 263], &features, Kind::F32);
    for name in ["joints.npy", "vecs.npy"] {
        let read = load(&folder.path().join(name)).unwrap_or_else(|error| panic!("{error}"));
        let worst = largest_angle(&motion, &read);
        assert!(worst < 0.05, "{name}: limbs differ by {worst} degrees");
        // The pelvis takes the same path from its start. Features carry it as steps in the heading's frame.
        let way = |m: &Motion, i: usize, c: usize| m.frames[i].positions[0][c] - m.frames[0].positions[0][c];
        for i in 0..motion.frames.len() {
            let off = (0..3).map(|c| (way(&motion, i, c) - way(&read, i, c)).abs()).fold(0.0, f32::max);
            assert!(off < 1e-4, "{name}: the pelvis is off by {off} m");
        }
    }
}

#[test]
fn limbs_from_positions_have_right_bone_hinge_and_no_twist() {
    // Compare the full motion with its positions alone.
    let made = short();
    let whole = limbs(&made, &calibrate(&made, CalibrationMode::Clip));
    let alone = limbs(&positions_only(made.clone()), &HingeCalibration::ZERO);
    for (i, (whole, alone)) in whole.iter().zip(&alone).enumerate() {
        for (upper, fore) in [(0, 1), (2, 3)] {
            let side = if upper == 0 { 1.0 } else { -1.0 };
            for limb in [upper, fore] {
                let off = bone(whole[limb], side).angle(&bone(alone[limb], side)).to_degrees();
                assert!(off < 0.1, "frame {i}, limb {limb}: the bone is off by {off} degrees");
            }
            let flexion = bone(whole[upper], side).angle(&bone(whole[fore], side)).to_degrees();
            if flexion > 20.0 {
                let off = angle_deg(whole[upper], alone[upper]);
                assert!(off < 1.0, "frame {i}: the upper arm is off by {off} degrees at {flexion} degrees of flexion");
            }
            // A neutral forearm is the upper arm flexed about its hinge. The two hinges are then the same axis.
            let twist = hinge(alone[upper], side).angle(&hinge(alone[fore], side)).to_degrees();
            assert!(twist < 0.1, "frame {i}: the forearm is rolled by {twist} degrees");
        }
    }
}

#[test]
fn straight_elbow_keeps_its_hinge_without_jump() {
    let mut motion = positions_only(short());
    for frame in &mut motion.frames {
        for (shoulder, elbow, wrist) in [(16, 18, 20), (17, 19, 21)] {
            for c in 0..3 {
                let bone = frame.positions[elbow][c] - frame.positions[shoulder][c];
                frame.positions[wrist][c] = frame.positions[elbow][c] + bone * 0.8;
            }
        }
    }
    let mut last: Option<[[f32; 4]; 4]> = None;
    for (i, limbs) in limbs(&motion, &HingeCalibration::ZERO).into_iter().enumerate() {
        for limb in limbs {
            let norm: f32 = limb.iter().map(|c| c * c).sum();
            assert!((norm - 1.0).abs() < 1e-4, "frame {i}: {limb:?}");
        }
        // Limbs do not jump: an arm of 1.9 rad/s turns by 5.5 degrees between frames at 20 Hz, and its bone
        // carries the hinge.
        for (now, before) in limbs.iter().zip(last.unwrap_or(limbs)) {
            assert!(angle_deg(*now, before) < 12.0, "frame {i}: a limb jumps");
        }
        last = Some(limbs);
    }
}

#[test]
fn normalised_features_need_their_statistics_files() {
    let folder = folder();
    let motion = positions_only(short());
    let n = motion.frames.len();
    let raw = features(&motion);
    let (mean, std) = statistics(&raw);
    let normalised: Vec<f64> = raw.iter().enumerate().map(|(i, x)| (x - mean[i % 263]) / std[i % 263]).collect();
    let data = folder.path().join("data/new_joint_vecs");
    std::fs::create_dir_all(&data).expect("a folder");
    let path = data.join("clip.npy");
    write_npy(&path, &[n, 263], &normalised, Kind::F32);
    let error = message(&path);
    assert!(error.contains("look normalised") && error.contains("--mean FILE and --std FILE"), "{error}");
    assert!(error.contains("clip.npy"), "{error}");

    // Statistics named in the options.
    let named = folder.path().join("elsewhere");
    std::fs::create_dir_all(&named).expect("a folder");
    write_npy(&named.join("m.npy"), &[263], &mean, Kind::F64);
    write_npy(&named.join("s.npy"), &[1, 263], &std, Kind::F32);
    let mut options =
        LoadOptions { mean: Some(named.join("m.npy")), std: Some(named.join("s.npy")), ..LoadOptions::default() };
    let read = load_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    assert!(largest_angle(&motion, &read) < 0.5);
    assert!(read.guesses.warnings.iter().any(|w| w.contains("normalised") && w.contains("m.npy")));
    options.std = None;
    let error = load_with(&path, &options).expect_err("half").to_string();
    assert!(error.contains("give both or neither"), "{error}");

    // Statistics found one folder above, as the data set keeps them. Raw features beside them stay unchanged.
    write_npy(&folder.path().join("data/Mean.npy"), &[263], &mean, Kind::F32);
    write_npy(&folder.path().join("data/Std.npy"), &[263], &std, Kind::F32);
    let read = load(&path).unwrap_or_else(|error| panic!("{error}"));
    assert!(largest_angle(&motion, &read) < 0.5);
    write_npy(&data.join("raw.npy"), &[n, 263], &raw, Kind::F32);
    let read = load(&data.join("raw.npy")).unwrap_or_else(|error| panic!("{error}"));
    assert!(largest_angle(&motion, &read) < 0.05 && read.guesses.warnings.len() == 1, "{:?}", read.guesses.warnings);

    // Statistics of other data.
    write_npy(&named.join("m.npy"), &[263], &[5.0; 263], Kind::F64);
    options.std = Some(named.join("s.npy"));
    let error = load_with(&path, &options).expect_err("wrong statistics").to_string();
    assert!(error.contains("m.npy") && error.contains("not a plausible person"), "{error}");
}

#[test]
fn statistics_files_are_refused_as_motion() {
    let folder = folder();
    for name in ["Mean.npy", "Std.npy"] {
        write_npy(&folder.path().join(name), &[263], &[1.0; 263], Kind::F32);
        let error = message(&folder.path().join(name));
        assert!(error.contains(name) && error.contains("not motion"), "{error}");
    }
    let motion = positions_only(short());
    write_npy(&folder.path().join("b.npy"), &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F32);
    std::fs::write(folder.path().join("a.BVH"), "").expect("written");
    std::fs::write(folder.path().join("notes.txt"), "").expect("written");
    std::fs::create_dir(folder.path().join("inside.npy")).expect("a folder");
    std::fs::write(folder.path().join("inside.npy/c.npz"), "").expect("written");
    std::fs::write(folder.path().join("inside.npy/neutral_stagei.npz"), "").expect("written");
    let names = |files: Vec<PathBuf>| -> Vec<String> {
        files.iter().map(|f| f.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect()
    };
    assert_eq!(names(motion::motion_files(folder.path()).expect("listed")), ["a.BVH", "b.npy"]);
    let listing = motion::list(folder.path(), true).expect("listed");
    assert_eq!(names(listing.files), ["a.BVH", "b.npy", "c.npz"]);
    assert_eq!(listing.skipped.len(), 3);
    assert!(listing.skipped.iter().all(|(_, reason)| reason.contains("not motion")));
    let error = motion::motion_files(&folder.path().join("none")).expect_err("missing").to_string();
    assert!(error.contains("none"), "{error}");
}

#[test]
fn mirrored_motion_is_refused_without_mirror_option() {
    let folder = folder();
    let motion = positions_only(short());
    let mut values = positions_y_up(&motion);
    values.chunks_exact_mut(3).for_each(|p| p[0] = -p[0]);
    let path = folder.path().join("mirrored.npy");
    write_npy(&path, &[motion.frames.len(), 22, 3], &values, Kind::F32);
    let error = message(&path);
    assert!(["the body is mirrored", "--mirror", "mirrored.npy"].iter().all(|part| error.contains(part)), "{error}");
    let mirror = LoadOptions { mirror: true, ..LoadOptions::default() };
    let read = load_with(&path, &mirror).unwrap_or_else(|error| panic!("{error}"));
    assert!(largest_angle(&motion, &read) < 0.05);
    // The option `mirror` is rejected for a body that is no mirror image.
    let path = folder.path().join("right.npy");
    write_npy(&path, &[motion.frames.len(), 22, 3], &positions_y_up(&motion), Kind::F32);
    let error = load_with(&path, &mirror).expect_err("no mirror image").to_string();
    assert!(error.contains("leave it out"), "{error}");

    // The same for BVH, including rotations.
    let mut image = builtin();
    for frame in &mut image.frames {
        frame.positions = frame.positions.map(|[x, y, z]| [x, -y, z]);
        frame.rotations = frame.rotations.map(|[x, y, z, w]| [-x, y, -z, w]);
    }
    let path = folder.path().join("mirrored.bvh");
    motion::save_bvh(&image, &path).expect("saved");
    assert!(matches!(load(&path), Err(MotionError::Mirror { .. })));
    let read = load_with(&path, &mirror).unwrap_or_else(|error| panic!("{error}"));
    let wanted = limbs(&builtin(), &calibrate(&builtin(), CalibrationMode::Clip));
    let got = limbs(&read, &calibrate(&read, CalibrationMode::Clip));
    // The file's first frame is no motion, unless it was given separately.
    let skip = wanted.len() - got.len();
    for (wanted, got) in wanted.iter().skip(skip).zip(&got) {
        for limb in 0..4 {
            assert!(angle_deg(wanted[limb], got[limb]) < 0.5);
        }
    }
}

#[test]
fn amass_file_gives_rotations_of_its_source_motion() {
    let folder = folder();
    let made = short();
    let hinges = calibrate(&made, CalibrationMode::Clip);
    let wanted = limbs(&made, &hinges);
    for (name, layout) in [("smplh", Amass::SmplH), ("smplx", Amass::SmplX), ("deflated", Amass::Deflated)] {
        let path = folder.path().join(format!("{name}.npz"));
        write_amass(&path, &made, layout);
        let read = load(&path).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((read.frame_rate_hz, read.has_rotations, read.guesses.up), (20.0, true, "+Z"));
        let got = limbs(&read, &calibrate(&read, CalibrationMode::Clip));
        for (i, (wanted, got)) in wanted.iter().zip(&got).enumerate() {
            for limb in 0..4 {
                let off = angle_deg(wanted[limb], got[limb]);
                assert!(off < 0.5, "{name}, frame {i}, limb {limb}: off by {off} degrees");
            }
        }
        let lean = read.frames[0].positions[15][2] - read.frames[0].positions[0][2];
        assert!(lean > 0.5, "{name}: the head is {lean} m above the pelvis");
    }
}

#[test]
fn f104_damaged_array_error_names_file_and_cause() {
    let folder = folder();
    let good = npy_bytes("<f4", false, "(2, 22, 3)", &[0; 528]);
    let last: Vec<u8> = (0..264).flat_map(|n| if n == 66 { f32::NAN } else { 0.0 }.to_le_bytes()).collect();
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("empty", vec![], "not a .npy"),
        ("zip", b"PK\x03\x04 and more bytes".to_vec(), "not a .npy"),
        ("short", good[..good.len() - 1].to_vec(), "shape [2, 22, 3] needs 528 bytes, and 527 follow"),
        ("no data", npy_bytes("<f4", false, "(9999999, 22, 3)", &[]), "has more than 19800000 numbers"),
        ("claims all", npy_bytes("<f8", false, "(18446744073709551615, 22, 3)", &[]), "has more than"),
        ("overflow", npy_bytes("<f8", false, "(99999999999999999999, 3)", &[]), "not a tuple of lengths"),
        ("objects", npy_bytes("|O", false, "(2, 22, 3)", &[0; 528]), "numbers of type |O are not supported"),
        ("complex", npy_bytes("<c8", false, "(2, 22, 3)", &[0; 1056]), "numbers of type <c8"),
        ("four", npy_bytes("<f4", false, "(2, 21, 3)", &[0; 504]), "has shape [2, 21, 3], expected (N, 22, 3)"),
        ("flat", npy_bytes("<f4", false, "(132,)", &[0; 528]), "has shape [132], expected (N, 22, 3)"),
        ("scalar", npy_bytes("<f4", false, "()", &[0; 4]), "has shape []"),
        ("none", npy_bytes("<f4", false, "(0, 22, 3)", &[]), "no frame"),
        ("nothing", npy_bytes("<f4", false, "(0, 263)", &[]), "no frame"),
        ("no shape", npy_raw(b"{'descr': '<f4', 'fortran_order': False}\n"), "no shape"),
        ("nested", npy_raw(&[b'('; 9000]), "no descr"),
        ("long", npy_raw(&[b' '; 20_000]), "a header of 20000 bytes"),
        ("zeros", good.clone(), "have no length"),
        ("nan", npy_bytes("<f4", false, "(2, 22, 3)", &f32::NAN.to_le_bytes().repeat(132)), "frame 0, number 0: NaN"),
        ("frames last", npy_bytes("<f4", false, "(22, 3, 4)", &last), "frame 2, number 16: NaN"),
        ("huge", npy_bytes("<f4", false, "(2, 22, 3)", &1e9f32.to_le_bytes().repeat(132)), "is not within"),
    ];
    for (name, bytes, expected) in cases {
        let path = folder.path().join(format!("{name}.npy"));
        std::fs::write(&path, bytes).expect("written");
        let error = message(&path);
        assert!(error.contains(expected) && error.contains(name), "{name}: {error}");
    }
}

#[test]
fn f096_f104_damaged_archive_error_names_file_and_cause() {
    let folder = folder();
    let zeros = |shape: &str, bytes: usize| npy_bytes("<f8", false, shape, &vec![0; bytes]);
    let rate = npy_bytes("<f8", false, "()", &60f64.to_le_bytes());
    let slow = npy_bytes("<f8", false, "()", &0f64.to_le_bytes());
    let text = npy_bytes("<U4", false, "()", &[0; 16]);
    let poses = zeros("(2, 156)", 2496);
    let (narrow, third) = (zeros("(2, 60)", 960), zeros("(3, 3)", 72));
    let bomb = zeros("(33554433, 1)", 1 << 20);
    type Entries<'a> = Vec<(&'a str, &'a [u8])>;
    let cases: Vec<(&str, Entries, &str)> = vec![
        ("shape", vec![("betas", &rate)], "has no poses, or root_orient and pose_body; its keys are betas"),
        ("rateless", vec![("poses", &poses)], "has no mocap_framerate, mocap_frame_rate or fps (--frame-rate HZ"),
        ("slow", vec![("poses", &poses), ("mocap_framerate", &slow)], "frame rate 0.0 Hz"),
        ("text", vec![("poses", &poses), ("mocap_framerate", &text)], "mocap_framerate: numbers of type <U4"),
        ("many", vec![("poses", &poses), ("fps", &third)], "fps: has shape [3, 3], expected () one number"),
        ("narrow", vec![("poses", &narrow), ("mocap_framerate", &rate)], "poses: has shape [2, 60]"),
        ("bomb", vec![("poses", &bomb)], "poses: shape [33554433, 1] has more than"),
        ("lengths", vec![("poses", &poses), ("trans", &third), ("mocap_framerate", &rate)], "trans: has shape [3, 3]"),
    ];
    for (name, entries, expected) in cases {
        let path = folder.path().join(format!("{name}.npz"));
        write_zip(&path, &entries, true);
        let error = message(&path);
        assert!(error.contains(expected) && error.contains(name), "{name}: {error}");
    }
    let path = folder.path().join("cut.npz");
    write_amass(&path, &short(), Amass::SmplH);
    let bytes = std::fs::read(&path).expect("read");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    assert!(message(&path).contains("is not a .npz"), "{}", message(&path));
    // A flipped bit in the data fails the archive's checksum.
    let mut flipped = bytes;
    let at = flipped.len() / 2;
    flipped[at] ^= 64;
    std::fs::write(&path, &flipped).expect("written");
    assert!(load(&path).is_err());
}

#[test]
fn npy_header_survives_write_and_read() {
    let mut bytes = Vec::new();
    npy::write_npy_header(&mut bytes, "<f8", &[2, 3]).expect("written");
    assert_eq!(bytes.len() % 64, 0);
    bytes.extend([1.0f64, 2.0, 3.0, 4.0, 5.0, 6.0].iter().flat_map(|x| x.to_le_bytes()));
    let read = npy::read_npy(bytes.as_slice()).expect("read");
    assert_eq!((read.shape, read.values), (vec![2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    for shape in [&[][..], &[1]] {
        let mut bytes = Vec::new();
        npy::write_npy_header(&mut bytes, "<f8", shape).expect("written");
        bytes.extend(7.0f64.to_le_bytes());
        assert_eq!(npy::read_npy(bytes.as_slice()).expect("read").shape, shape);
    }
}
