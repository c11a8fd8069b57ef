//! Tests that no file takes more than 512 MB, whatever it claims and however it is packed. Covers the largest
//! accepted files and rejected larger ones. Runs alone in its process, because it measures the memory of the
//! whole process.

use crate::writers;

use motion::{FRAMES_MAX, load, npy};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use writers::*;

/// Memory bound, kB.
const MEMORY_MAX: u64 = 512 << 10;

/// Returns the peak memory of this process, kB. `None` if there is no Linux /proc.
fn peak_kb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().trim_end_matches(" kB").parse().ok()
}

/// Loads the file. Checks the result and the peak memory.
fn attempt(path: &Path, expected: &str) {
    let result = load(path).map(|motion| format!("{} frames", motion.frames.len())).unwrap_or_else(|e| e.to_string());
    let peak = peak_kb().unwrap_or(0);
    println!("{}: {peak} kB at most, {result}", path.display());
    assert!(result.contains(expected), "{result}");
    assert!(peak <= MEMORY_MAX, "{peak} kB");
}

/// Writes an archive of byte arrays with constant values: (key, shape, numbers, the number).
fn alike(path: &Path, arrays: &[(&str, String, usize, u8)]) {
    let data = arrays.iter().map(|(_, shape, count, value)| npy_bytes("|u1", false, shape, &vec![*value; *count]));
    let data: Vec<_> = data.collect();
    let entries: Vec<_> = arrays.iter().zip(&data).map(|((key, ..), bytes)| (*key, bytes.as_slice())).collect();
    write_zip(path, &entries, true);
}

/// Writes a file of `head` and then `count` times `part`.
fn repeated(path: &Path, head: &[u8], part: &[u8], count: usize) {
    let mut file = BufWriter::new(File::create(path).expect("created"));
    file.write_all(head).expect("written");
    (0..count).for_each(|_| file.write_all(part).expect("written"));
}

#[test]
fn f096_f104_motion_file_uses_at_most_512_mb() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let n = FRAMES_MAX;
    let rate = ("mocap_framerate", "()".to_owned(), 1, 60);

    // The archive has a thousandth of the size, and each byte becomes a number of eight bytes.
    alike(&path("poses.npz"), &[("poses", format!("({n}, 165)"), n * 165, 0), rate.clone()]);
    attempt(&path("poses.npz"), &format!("{n} frames"));
    let parts = [
        ("root_orient", format!("({n}, 3)"), n * 3, 0),
        ("pose_body", format!("({n}, 63)"), n * 63, 0),
        ("trans", format!("({n}, 3)"), n * 3, 0),
        rate,
    ];
    alike(&path("parts.npz"), &parts);
    attempt(&path("parts.npz"), &format!("{n} frames"));
    let many = npy::ARRAY_VALUES_MAX / 66;
    alike(&path("many.npz"), &[("poses", format!("({many}, 66)"), many * 66, 0)]);
    attempt(&path("many.npz"), &format!("{many} frames, at most {n} are allowed"));
    alike(&path("wide.npz"), &[("poses", format!("({n}, 166)"), n * 166, 0)]);
    attempt(&path("wide.npz"), "has more than 19800000 numbers");

    let mut motion = motion::builtin();
    let frame: Vec<u8> = positions_y_up(&motion)[..66].iter().flat_map(|x| (*x as f32).to_le_bytes()).collect();
    repeated(&path("positions.npy"), &npy_bytes("<f4", false, &format!("({n}, 22, 3)"), &[]), &frame, n);
    attempt(&path("positions.npy"), &format!("{n} frames"));
    let wide = npy::ARRAY_VALUES_MAX / 263;
    repeated(&path("features.npy"), &npy_bytes("<f4", true, &format!("({wide}, 263)"), &[]), &[0; 1052], wide);
    for name in ["Mean.npy", "Std.npy"] {
        repeated(&path(name), &npy_bytes("<f4", false, "(263,)", &[]), &[0; 1052], 1);
    }
    attempt(&path("features.npy"), "Mean.npy");

    motion.frames.truncate(2);
    let text = motion::write_bvh(&motion);
    let (head, last) = text.trim_end().rsplit_once('\n').expect("lines");
    let (head, _) = head.rsplit_once("Frames:").expect("a count");
    let short = last.split_whitespace().map(|word| format!("{:.1} ", word.parse::<f64>().expect("a number")));
    let line = format!("{}\n", short.collect::<String>().trim_end());
    for (name, count) in [("most.bvh", n), ("more.bvh", n + 1)] {
        let head = format!("{head}Frames: {count}\nFrame Time: 0.01\n");
        repeated(&path(name), head.as_bytes(), line.as_bytes(), count);
        let expected = if count == n { format!("{} frames", n - 1) } else { format!("Frames: {count}, at most {n}") };
        attempt(&path(name), &expected);
    }
}
