//! Runs `replay --offline` as a user does: the files that it writes, and their promised properties.

use crate::batch::root;
use std::process::Command;

struct Run {
    header: Vec<String>,
    rows: Vec<Vec<f64>>,
    summary: serde_json::Value,
}

/// A motion of six seconds.
const SHORT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/motions/hands-up.bvh");

fn replay(motion: &str) -> Run {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out.csv");
    let output = Command::new(env!("CARGO_BIN_EXE_replay"))
        .arg(motion)
        .arg("--offline")
        .arg(&out)
        .arg("--config")
        .arg(root().join("config/teleop.toml"))
        .output()
        .expect("replay runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(&out).expect("the CSV file");
    let mut lines = text.lines();
    let header = lines.next().expect("a header").split(',').map(str::to_owned).collect();
    let rows = lines.map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect()).collect();
    let summary = std::fs::read_to_string(out.with_extension("json")).expect("the JSON file");
    Run { header, rows, summary: serde_json::from_str(&summary).expect("JSON") }
}

fn check(run: &Run) {
    assert_eq!(run.header[0], "t_s");
    assert_eq!(run.header.len(), 1 + 17 + 17);
    assert_eq!(run.header[1], "torso_lift_joint");
    assert_eq!(run.header[18], "target.torso_lift_joint");
    assert_eq!(run.header[34], "target.arm_right_7_joint");
    for (k, row) in run.rows.iter().enumerate() {
        assert_eq!(row[0], k as f64 / 1500.0, "row {k}");
        assert_eq!(row.len(), run.header.len(), "row {k}");
        assert!(row.iter().all(|value| value.is_finite()), "row {k}");
    }
    let command = |row: &[f64]| row[1..18].to_vec();
    let (first, last) = (&run.rows[0], &run.rows[run.rows.len() - 1]);
    let before_last = &run.rows[run.rows.len() - 2];
    assert_eq!(command(before_last), command(last), "the end is at rest");
    let moved = command(first).iter().zip(command(last)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved > 0.1, "the robot went somewhere: {moved}");
    // One tick at 2.35 rad/s, the fastest joint, moves 1.6 mrad.
    for pair in run.rows.windows(2) {
        let step = command(&pair[0]).iter().zip(command(&pair[1])).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(step <= 2.35 / 1500.0 + 1e-9, "a step of {step}");
    }
    let names: Vec<_> = run.summary["modes"].as_array().unwrap().iter().map(|one| one["mode"].clone()).collect();
    assert_eq!(names, ["Disengaged", "Engaging", "Engaged", "Holding", "Disengaged"]);
    for (kind, count) in run.summary["violations"].as_object().unwrap() {
        assert_eq!(count, 0, "{kind}");
    }
    let taken: Vec<u64> =
        run.summary["frames"].as_array().unwrap().iter().map(|one| one["k"].as_u64().unwrap()).collect();
    assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "frames are taken in order");
    assert!(taken.len() > 100);
}

#[test]
fn builtin_and_a_file_are_written_from_home_to_rest() {
    check(&replay("builtin"));
    let run = replay(SHORT);
    check(&run);
    assert_eq!(run.rows, replay(SHORT).rows, "two runs are the same to the last bit");
}

#[test]
fn recording_of_a_run_compares_equal_and_half_of_it_fails() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let run = |arguments: &[&std::ffi::OsStr]| {
        let program = Command::new(env!("CARGO_BIN_EXE_replay")).current_dir(root()).args(arguments).output();
        program.expect("replay runs")
    };
    let (csv, whole, half) = (path("out.csv"), path("whole.mcap"), path("half.mcap"));
    let made = run(&[SHORT.as_ref(), "--offline".as_ref(), csv.as_ref(), "--record".as_ref(), whole.as_ref()]);
    assert!(made.status.success(), "{made:?}");
    let compared = run(&["--compare".as_ref(), whole.as_ref()]);
    let printed = String::from_utf8_lossy(&compared.stdout);
    assert!(compared.status.success() && printed.contains("equal, bit for bit"), "{printed}");
    assert_eq!(printed.matches("compared, 0 missing, 0 different").count(), 3, "{printed}");
    // A recording is a motion too, although its first frame was held until the robot was engaged.
    let again = run(&[whole.as_ref(), "--offline".as_ref(), path("again.csv").as_ref()]);
    assert!(again.status.success(), "{again:?}");
    let printed = String::from_utf8_lossy(&again.stdout);
    assert!(printed.contains("with a held (repeated) frame"), "{printed}");
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(&half, &bytes[..bytes.len() / 2]).unwrap();
    let compared = run(&["--compare".as_ref(), half.as_ref()]);
    assert_eq!(compared.status.code(), Some(1), "{compared:?}");
    let printed = String::from_utf8_lossy(&compared.stderr);
    assert!(printed.contains("half.mcap: the file is damaged or truncated") && !printed.contains("equal"), "{printed}");
    let played = run(&[half.as_ref(), "--offline".as_ref(), path("half.csv").as_ref()]);
    let printed = String::from_utf8_lossy(&played.stderr);
    assert_eq!(played.status.code(), Some(65), "{printed}");
    assert!(printed.contains("there is no end") && printed.contains("the rest was played"), "{printed}");
}
