//! Tests that no file takes more than 512 MB, and none of 1 MB more than 200 MB, whatever it claims and however it is packed.
//! Covers the largest accepted files and rejected larger ones.

use crate::writers;

use motion::{FRAMES_MAX, load, npy};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use writers::*;

/// Memory bounds of any file and of one of 1 MB, kB. The second includes the test program itself.
const MEMORY_MAX: u64 = 512 << 10;
const SMALL_MEMORY_MAX: u64 = 200_000;

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
    assert!(if expected.ends_with(" frames") { result == expected } else { result.contains(expected) }, "{result}");
    assert!(peak <= MEMORY_MAX, "{peak} kB");
}

/// Writes an archive of byte arrays with constant values: (key, shape, numbers, the number).
fn alike(path: &Path, arrays: &[(&str, String, usize, u8)], deflate: bool) {
    let data = arrays.iter().map(|(_, shape, count, value)| npy_bytes("|u1", false, shape, &vec![*value; *count]));
    let data: Vec<_> = data.collect();
    let entries: Vec<_> = arrays.iter().zip(&data).map(|((key, ..), bytes)| (*key, bytes.as_slice())).collect();
    write_zip(path, &entries, deflate);
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

    // Each byte becomes a number of eight bytes.
    alike(&path("poses.npz"), &[("poses", format!("({n}, 165)"), n * 165, 0), rate.clone()], false);
    attempt(&path("poses.npz"), &format!("{n} frames"));
    let parts = [
        ("root_orient", format!("({n}, 3)"), n * 3, 0),
        ("pose_body", format!("({n}, 63)"), n * 63, 0),
        ("trans", format!("({n}, 3)"), n * 3, 0),
        rate,
    ];
    alike(&path("parts.npz"), &parts, false);
    attempt(&path("parts.npz"), &format!("{n} frames"));
    let many = npy::ARRAY_VALUES_MAX / 66;
    alike(&path("many.npz"), &[("poses", format!("({many}, 66)"), many * 66, 0)], false);
    attempt(&path("many.npz"), &format!("{many} frames, at most {n} are allowed"));
    alike(&path("wide.npz"), &[("poses", format!("({n}, 166)"), n * 166, 0)], false);
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
        let expected = if count == n { format!("{} frames", n - 1) } else { format!("from 2 to {n}") };
        attempt(&path(name), &expected);
    }
}

/// Set for the process that reads one file.
const ONE_FILE: &str = "TELEOPD_ONE_FILE";

#[test]
fn f096_file_of_1_mb_uses_at_most_200_mb() {
    if let Some(path) = std::env::var_os(ONE_FILE) {
        let motion = load(Path::new(&path)).map(|motion| motion::upsample(&motion));
        let result = motion.map_or_else(|e| e.to_string(), |motion| format!("{} frames", motion.frames.len()));
        return println!("{} kB: {result}", peak_kb().unwrap_or(0));
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    let rate = |value| ("mocap_framerate", "()".to_owned(), 1, value);
    let filler = ("filler", "(990000,)".to_owned(), 990_000, 0);
    let poses = |count: usize, width: usize| ("poses", format!("({count}, {width})"), count * width, 0);
    for (name, count, width) in [("zeros.npz", FRAMES_MAX, 165), ("narrow.npz", FRAMES_MAX, 66)] {
        alike(&path(name), &[poses(count, width), rate(60)], true);
    }
    alike(&path("wide-stored.npz"), &[poses(6000, 165), rate(10)], false);
    alike(&path("narrow-stored.npz"), &[poses(15_000, 66), rate(10)], false);
    // What an archive of 1 MB may unpack to at most, in the narrowest frames.
    let mut zip = zip::ZipWriter::new(File::create(path("most.npz")).expect("created"));
    for ((key, shape, count, value), method) in [
        (filler, zip::CompressionMethod::Stored),
        (poses(67_700, 66), zip::CompressionMethod::Deflated),
        (rate(21), zip::CompressionMethod::Stored),
    ] {
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{key}.npy"), options).expect("an entry");
        zip.write_all(&npy_bytes("|u1", false, &shape, &vec![value; count])).expect("written");
    }
    zip.finish().expect("finished");
    let mut motion = motion::builtin();
    let frame: Vec<u8> = positions_y_up(&motion)[..66].iter().map(|x| (x * 4.0) as u8).collect();
    repeated(&path("bytes.npy"), &npy_bytes("|u1", false, "(15000, 22, 3)", &[]), &frame, 15_000);
    motion.frames.truncate(2);
    let text = motion::write_bvh(&motion);
    let (head, _) = text.rsplit_once("Frames:").expect("a count");
    let head =
        head.replace("CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation", "CHANNELS 1 Xrotation");
    let channels = head.matches("CHANNELS").count();
    let count = 1_000_000 / (2 * channels);
    for (name, time) in [("fast.bvh", "0.01"), ("slow.bvh", "0.099"), ("slowest.bvh", "10")] {
        let head = format!("{head}Frames: {count}\nFrame Time: {time}\n");
        repeated(&path(name), head.as_bytes(), "0 ".repeat(channels).as_bytes(), count);
    }
    let program = std::env::current_exe().expect("this program");
    for entry in std::fs::read_dir(folder.path()).expect("the files").flatten() {
        let bytes = entry.metadata().expect("a file").len();
        assert!(bytes < 1 << 20, "{:?}: {bytes} bytes", entry.file_name());
        let test = ["--exact", "bounds::f096_file_of_1_mb_uses_at_most_200_mb", "--nocapture"];
        let ended =
            std::process::Command::new(&program).args(test).env(ONE_FILE, entry.path()).output().expect("it runs");
        let printed = String::from_utf8_lossy(&ended.stdout);
        let line = printed.lines().find(|line| line.contains(" kB: ")).unwrap_or_else(|| panic!("{printed}"));
        println!("{:?}, {bytes} bytes: {line}", entry.file_name());
        let peak: u64 = line.split(' ').next().and_then(|kb| kb.parse().ok()).expect("a number");
        assert!(ended.status.success() && peak <= SMALL_MEMORY_MAX, "{:?}: {line}", entry.file_name());
    }
}
