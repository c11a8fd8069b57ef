//! Writes a motion in foreign formats, for tests. Not every test uses every format.
#![allow(dead_code)]

use motion::Motion;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::io::Write;
use std::path::Path;

/// Storage type of numbers.
#[derive(Clone, Copy)]
pub enum Kind {
    F16,
    F32,
    F64,
    BigF32,
    FortranF64,
}

/// Returns the bytes of a .npy with this header.
pub fn npy_bytes(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
    [npy_raw(header.as_bytes()).as_slice(), data].concat()
}

/// Returns the prefix of version 1 with any header.
pub fn npy_raw(header: &[u8]) -> Vec<u8> {
    let length = u16::try_from(header.len()).expect("a short header").to_le_bytes();
    [b"\x93NUMPY\x01\x00".as_slice(), &length, header].concat()
}

/// Writes row-major values as a .npy.
pub fn write_npy(path: &Path, shape: &[usize], values: &[f64], kind: Kind) {
    assert_eq!(shape.iter().product::<usize>(), values.len());
    let text = format!("({},)", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", "));
    let (descr, fortran) = match kind {
        Kind::F16 => ("<f2", false),
        Kind::F32 => ("<f4", false),
        Kind::F64 => ("<f8", false),
        Kind::BigF32 => (">f4", false),
        Kind::FortranF64 => ("<f8", true),
    };
    let ordered = if fortran { column_major(shape, values) } else { values.to_vec() };
    let data: Vec<u8> = match kind {
        Kind::F16 => ordered.iter().flat_map(|&x| half(x).to_le_bytes()).collect(),
        Kind::F32 => ordered.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect(),
        Kind::BigF32 => ordered.iter().flat_map(|&x| (x as f32).to_be_bytes()).collect(),
        Kind::F64 | Kind::FortranF64 => ordered.iter().flat_map(|x| x.to_le_bytes()).collect(),
    };
    std::fs::write(path, npy_bytes(descr, fortran, &text, &data)).expect("written");
}

/// A normal half near a number of at most a few metres, cut off.
fn half(x: f64) -> u16 {
    let bits = (x as f32).to_bits();
    let (sign, exponent) = ((bits >> 16 & 0x8000) as u16, (bits >> 23 & 255) as i32 - 127 + 15);
    if exponent <= 0 { sign } else { sign | (exponent as u16) << 10 | (bits >> 13 & 0x3ff) as u16 }
}

fn column_major(shape: &[usize], values: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; values.len()];
    for (i, value) in values.iter().enumerate() {
        let (mut rest, mut at) = (i, 0);
        let mut index = vec![0; shape.len()];
        for d in (0..shape.len()).rev() {
            index[d] = rest % shape[d];
            rest /= shape[d];
        }
        for d in (0..shape.len()).rev() {
            at = at * shape[d] + index[d];
        }
        out[at] = *value;
    }
    out
}

/// Returns the motion without its rotations.
pub fn positions_only(mut motion: Motion) -> Motion {
    motion.has_rotations = false;
    motion
}

/// Returns (N, 22, 3) positions with x left, y up, z forward.
pub fn positions_y_up(motion: &Motion) -> Vec<f64> {
    motion.frames.iter().flat_map(|f| f.positions).flat_map(|[x, y, z]| [y, z, x]).map(f64::from).collect()
}

/// Returns (N, 263) features of a person that always faces z. Its heading turns by 0.01 rad a frame, so the
/// inverse transform matters. The first heading is zero, and the root begins where x and z are zero.
pub fn features(motion: &Motion) -> Vec<f64> {
    let frames: Vec<[Vector3<f64>; 22]> = motion
        .frames
        .iter()
        .map(|f| f.positions.map(|[x, y, z]| Vector3::new(f64::from(y), f64::from(z), f64::from(x))))
        .collect();
    let half_rate = 0.01;
    let heading = |i: usize| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 2.0 * half_rate * i as f64);
    let mut out = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let next = frames.get(i + 1).unwrap_or(frame);
        let step = heading(i + 1) * (next[0] - frame[0]);
        out.extend([half_rate, step.x, step.z, frame[0].y]);
        for joint in &frame[1..] {
            let place = Vector3::new(frame[0].x, 0.0, frame[0].z);
            out.extend((heading(i) * (joint - place)).iter());
        }
        // 6D rotations of no rotation, no velocities, both feet on the floor.
        out.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0].repeat(21));
        out.extend([0.0; 66]);
        out.extend([1.0; 4]);
    }
    out
}

/// Returns mean and standard deviation of each feature. Constant features get a standard deviation that hides
/// them well.
pub fn statistics(raw: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = (raw.len() / 263) as f64;
    let mean: Vec<f64> = (0..263).map(|c| raw.iter().skip(c).step_by(263).sum::<f64>() / n).collect();
    let std = (0..263).map(|c| {
        let variance = raw.iter().skip(c).step_by(263).map(|x| (x - mean[c]).powi(2)).sum::<f64>() / n;
        variance.sqrt().max(0.01)
    });
    let std = std.collect();
    // Contacts do not use the mean, because the data set's own is 0.85.
    (mean.iter().enumerate().map(|(c, m)| if c > 258 { 0.85 } else { *m }).collect(), std)
}

/// Layouts of AMASS.
#[derive(Clone, Copy, PartialEq)]
pub enum Amass {
    SmplH,
    SmplX,
    Deflated,
}

/// Writes the motion's rotations, which are differences from the T-pose, as local axis-angle vectors of SMPL.
pub fn write_amass(path: &Path, motion: &Motion, layout: Amass) {
    const PARENT: [usize; 22] = [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19];
    // From the body's axes (x left, y up, z forward) into a world with z up, facing -y.
    let world = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let (mut root, mut body, mut trans) = (Vec::new(), Vec::new(), Vec::new());
    for frame in &motion.frames {
        let global = frame.rotations.map(|[x, y, z, w]| {
            let [x, y, z, w] = [x, y, z, w].map(f64::from);
            world * UnitQuaternion::new_normalize(Quaternion::new(w, y, z, x))
        });
        root.extend(global[0].scaled_axis().iter().copied());
        for j in 1..22 {
            body.extend((global[PARENT[j]].inverse() * global[j]).scaled_axis().iter().copied());
        }
        let [x, y, z] = frame.positions[0].map(f64::from);
        trans.extend((world * Vector3::new(y, z, x)).iter().copied());
    }
    let n = motion.frames.len();
    let array = |columns: usize, values: &[f64], wide: bool| {
        let kind = |x: &f64| if wide { x.to_le_bytes().to_vec() } else { (*x as f32).to_le_bytes().to_vec() };
        let data: Vec<u8> = values.iter().flat_map(kind).collect();
        npy_bytes(if wide { "<f8" } else { "<f4" }, false, &format!("({n}, {columns})"), &data)
    };
    let gender = npy_bytes("<U7", false, "()", &[0; 28]);
    let objects = npy_bytes("|O", false, "()", b"\x80\x04N.");
    let trans = array(3, &trans, true);
    if layout == Amass::SmplX {
        let rate = npy_bytes("<i8", false, "(1,)", &20i64.to_le_bytes());
        let (root, body) = (array(3, &root, false), array(63, &body, false));
        let entries = [
            ("gender", gender.as_slice()),
            ("root_orient", &root),
            ("pose_body", &body),
            ("trans", &trans),
            ("mocap_frame_rate", &rate),
            ("surface_model_type", &objects),
        ];
        return write_zip(path, &entries, false);
    }
    let rows = root.chunks_exact(3).zip(body.chunks_exact(63));
    let poses: Vec<f64> = rows.flat_map(|(r, b)| [r, b, &[0.1; 90]].concat()).collect();
    let rate = npy_bytes("<f8", false, "()", &20f64.to_le_bytes());
    let poses = array(156, &poses, true);
    let entries = [
        ("gender", gender.as_slice()),
        ("poses", &poses),
        ("trans", &trans),
        ("mocap_framerate", &rate),
        ("dmpls", &objects),
    ];
    write_zip(path, &entries, layout == Amass::Deflated);
}

/// Writes a zip archive of .npy files.
pub fn write_zip(path: &Path, entries: &[(&str, &[u8])], deflate: bool) {
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).expect("created"));
    let method = if deflate { zip::CompressionMethod::Deflated } else { zip::CompressionMethod::Stored };
    for (key, bytes) in entries {
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{key}.npy"), options).expect("an entry");
        zip.write_all(bytes).expect("written");
    }
    zip.finish().expect("finished");
}

fn quaternion(q: [f32; 4]) -> UnitQuaternion<f64> {
    let [x, y, z, w] = q.map(f64::from);
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

/// Angle between two rotations, degrees.
pub fn angle_deg(a: [f32; 4], b: [f32; 4]) -> f64 {
    quaternion(a).angle_to(&quaternion(b)).to_degrees()
}

/// Returns the bone direction of a limb rotation. `side` is 1 on the left, -1 on the right.
pub fn bone(limb: [f32; 4], side: f64) -> Vector3<f64> {
    quaternion(limb) * Vector3::y() * side
}

/// Returns the hinge of a limb rotation.
pub fn hinge(limb: [f32; 4], side: f64) -> Vector3<f64> {
    quaternion(limb) * Vector3::z() * -side
}
