//! Whole runs over folders of generated files.

use clap::Parser;
use indicatif::ProgressBar;
use messages::{JOINTS_MAX, LIMBS, Layout, Skeleton, Stamp, skeleton_flag};
use motion::{CalibrationMode, Motion, builtin, npy::Npz};
use nalgebra::{UnitQuaternion, Vector3};
use replay::batch::{Cli, Postures, Summary, run};
use retarget::{ARMS, Limbs, Settings, mirror, xyzw_from_rotation};
use rt::Shutdown;
use std::path::{Path, PathBuf};

/// TIAGo++: the number of its joints. No more columns are written.
const JOINTS: usize = 17;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn robot() -> PathBuf {
    root().join("config/robots/tiago_dual.toml")
}

fn weights() -> PathBuf {
    root().join("weights/tiago_dual")
}

/// Some frames of the built-in motion.
fn clip(from: usize, count: usize) -> Motion {
    let mut motion = builtin();
    motion.frames = motion.frames[from..from + count].to_vec();
    motion.first = motion.frames.first().copied();
    motion
}

/// Creates a folder with two motions and an output folder.
/// Writes an array of positions, (N, 22, 3).
pub fn write_positions(path: &Path, positions: &[[[f32; 3]; 22]]) {
    let mut file = Vec::new();
    motion::npy::write_npy_header(&mut file, "<f4", &[positions.len(), 22, 3]).expect("a header");
    file.extend(positions.as_flattened().as_flattened().iter().flat_map(|x| x.to_le_bytes()));
    std::fs::write(path, file).expect("written");
}

fn folders() -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let (input, out) = (folder.path().join("in"), folder.path().join("out"));
    std::fs::create_dir_all(input.join("more")).expect("a folder");
    motion::save_bvh(&clip(100, 80), &input.join("a.bvh")).expect("saved");
    motion::save_bvh(&clip(400, 120), &input.join("more/b.bvh")).expect("saved");
    (folder, input, out)
}

fn cli(input: &Path, out: &Path, more: &[&str]) -> Cli {
    let (robot, weights) = (robot(), weights());
    let paths = ["--input", &input.to_string_lossy(), "--out", &out.to_string_lossy()].map(str::to_owned);
    let mut config = vec!["--robot".to_owned(), robot.to_string_lossy().into_owned()];
    if !more.contains(&"--certified") {
        config.extend(["--weights".to_owned(), weights.to_string_lossy().into_owned()]);
    }
    let more = more.iter().map(|&word| word.to_owned());
    Cli::parse_from(["batch".to_owned()].into_iter().chain(paths).chain(config).chain(more))
}

fn attempt(input: &Path, out: &Path, more: &[&str]) -> Result<Summary, rt::Failure> {
    run(&cli(input, out, more), &Shutdown::default(), &ProgressBar::hidden())
}

fn go(input: &Path, out: &Path, more: &[&str]) -> Summary {
    attempt(input, out, more).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns the rows of a CSV: time and joints.
fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let row = |line: &str| line.split(',').map(|x| x.parse().expect("a number")).collect();
    text.lines().skip(1).map(row).collect()
}

/// Returns the live stage's result for a motion, skeleton by skeleton.
fn by_the_stage(motion: &Motion, settings: &Settings) -> Vec<[f64; JOINTS_MAX]> {
    stage_joints(motion::limbs(motion, &motion::calibrate(motion, CalibrationMode::Clip)), settings)
}

/// Returns the daemon's joints for these limbs, one tick for each.
fn stage_joints(limbs: Vec<[[f32; 4]; LIMBS]>, settings: &Settings) -> Vec<[f64; JOINTS_MAX]> {
    let (model, _) = config::load_model(&robot()).expect("the robot");
    let weights = config::load_weights(&weights(), &model).expect("the weights");
    let config = retarget::Config::new(&model, Some(weights), settings).expect("a configuration");
    let mut state = retarget::State::default();
    let posture = |(i, limbs): (usize, [[f32; 4]; 4])| {
        let k = 1 + 25 * i as u64;
        let now = Stamp(k * 666_667);
        let mut skeleton = Skeleton::ZERO;
        skeleton.header.sequence = i as u64 + 1;
        skeleton.received = now;
        skeleton.limbs = limbs;
        skeleton.flags = skeleton_flag::LIMB.iter().fold(0, |all, bit| all | bit);
        retarget::tick(&config, &mut state, now, retarget::Input { k, skeleton: Some(&skeleton) }).target.q
    };
    limbs.into_iter().enumerate().map(posture).collect()
}

#[test]
fn certified_batch_keeps_every_speed_limit_that_its_postures_break() {
    let (_folder, input, out) = folders();
    // Four times as fast as the person was.
    let mut fast = clip(400, 320);
    fast.frames = fast.frames.into_iter().step_by(4).collect();
    motion::save_bvh(&fast, &input.join("a.bvh")).expect("saved");
    let (model, _) = config::load_model(&robot()).expect("the robot");
    let settings = root().join("config/teleop.toml");
    let certified = ["--certified", "--config", settings.to_str().expect("text")];
    let fastest = |more: &[&str]| {
        assert_eq!(go(&input, &out, &[more, &["--overwrite", "--calibration", "none"]].concat()).made, 1);
        let rows = rows(&out.join("a.csv"));
        let share = |pair: &[Vec<f64>], j: usize| {
            (pair[1][j + 1] - pair[0][j + 1]).abs() / (pair[1][0] - pair[0][0]) / model.limits[j].v_max
        };
        let shares = rows.windows(2).flat_map(|pair| (0..JOINTS).map(|j| share(pair, j)));
        (rows.len(), shares.fold(0.0, f64::max))
    };
    let ((frames, postures), (ticks, commands)) = (fastest(&[]), fastest(&certified));
    assert!(postures > 1.0 && commands <= 1.0 + 1e-6, "{postures}, {commands}");
    assert!(frames < 100 && ticks > 3 * 1500, "{frames}, {ticks}: it also engages and comes to rest");
}

#[test]
fn batch_results_equal_the_live_stage_bit_for_bit() {
    let (_folder, input, out) = folders();
    for (word, method) in [("network", retarget::Method::Network), ("closed-form", retarget::Method::ClosedForm)] {
        let summary = go(&input, &out, &["--method", word, "--recursive", "--overwrite"]);
        assert_eq!((summary.made, summary.failed.len()), (2, 0));
        let settings = Settings { method, following_delay_ms: 0.0, ..Settings::default() };
        for name in ["a", "more/b"] {
            let motion = motion::load(&input.join(name).with_extension("bvh")).expect("read");
            let wanted = by_the_stage(&motion, &settings);
            let got = rows(&out.join(name).with_extension("csv"));
            assert_eq!(got.len(), motion.frames.len());
            for (i, (row, q)) in got.iter().zip(&wanted).enumerate() {
                assert_eq!(row[1..], q[..JOINTS], "{word}, {name}, frame {i}");
                assert_eq!(row[0], i as f64 / motion.frame_rate_hz);
            }
        }
    }
}

/// Far outside the network's training data a clearly better previous posture is kept.
/// Returns pose `i` of a synthetic motion of both arms at 60 Hz. Every angle of a human arm covers most of its
/// range. The periods have no common multiple.
fn synthetic(i: usize) -> [Limbs; ARMS] {
    let time_s = i as f64 / 60.0;
    // Middle, half range (degrees) and period (s) of five angles: swing and lowering of the upper arm, its
    // roll, flexion, pronation.
    const ANGLES: [[f64; 3]; 5] =
        [[25.0, 60.0, 3.1], [20.0, 60.0, 4.3], [-10.0, 70.0, 5.9], [70.0, 65.0, 2.3], [0.0, 60.0, 7.1]];
    std::array::from_fn(|arm| {
        let phase = arm as f64 * 0.37;
        let [swing, lower, roll, flex, twist] = ANGLES.map(|[middle, half, period]| {
            (middle + half * (std::f64::consts::TAU * (time_s / period + phase)).sin()).to_radians()
        });
        let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let upper = about(z, -swing) * about(x, -lower) * about(y, roll);
        Limbs { upper, fore: upper * about(z, -flex) * about(y, -twist) }
    })
}

#[test]
fn extreme_poses_give_the_joints_of_the_daemon() {
    const FRAMES: usize = 20_000;
    let (model, _) = config::load_model(&robot()).expect("the robot");
    let network = config::load_weights(&weights(), &model).expect("the weights");
    let postures = Postures::new(&model, Some(network), 2);
    let published = |[left, right]: [Limbs; ARMS]| {
        let beyond = |limb: UnitQuaternion<f64>| xyzw_from_rotation(&limb.powf(1.7));
        let [upper, fore] = [left.upper, left.fore].map(beyond);
        let right = [right.upper, right.fore].map(|limb| mirror(beyond(limb)));
        [upper, fore, right[0], right[1]].map(|limb| limb.map(|x| x as f32))
    };
    let limbs: Vec<_> = (0..FRAMES).map(|i| published(synthetic(i))).collect();
    let settings = Settings { following_delay_ms: 0.0, ..Settings::default() };
    let (mut previous, mut kept) = (None, 0);
    for (i, (limbs, wanted)) in limbs.iter().zip(stage_joints(limbs.clone(), &settings)).enumerate() {
        let samples = postures.encode(&Limbs::from_message(limbs).expect("rotations"));
        let q = postures.posture(&samples, previous.as_ref()).expect("finite");
        kept += usize::from(postures.posture(&samples, None) != Some(q));
        assert_eq!(postures.joints(&q), wanted, "frame {i}");
        previous = Some(q);
    }
    assert!(kept > FRAMES / 100, "only {kept} of {FRAMES} frames keep a posture");
}

#[test]
fn output_bytes_are_equal_for_one_and_three_jobs() {
    let (folder, input, out) = folders();
    let other = folder.path().join("other");
    go(&input, &out, &["--recursive", "--jobs", "1"]);
    go(&input, &other, &["--recursive", "--jobs", "3"]);
    for name in ["a.csv", "more/b.csv"] {
        assert_eq!(std::fs::read(out.join(name)).expect("read"), std::fs::read(other.join(name)).expect("read"));
    }
}

#[test]
fn rows_at_control_rate_pass_through_every_frame() {
    let (folder, input, out) = folders();
    let fast = folder.path().join("fast");
    go(&input, &out, &[]);
    go(&input, &fast, &["--rate", "1500"]);
    let (frames, rows) = (rows(&out.join("a.csv")), rows(&fast.join("a.csv")));
    assert_eq!(rows.len(), (frames.len() - 1) * 25 + 1);
    for (i, frame) in frames.iter().enumerate() {
        let row = &rows[25 * i];
        assert!((row[0] - frame[0]).abs() < 1e-4, "the file's own rate is rounded to a nanosecond");
        // The rate in the file is 1 / 0.016666667 Hz, so rows differ from its frames by up to 10^-6 of their step.
        let off = (1..=JOINTS).map(|j| (row[j] - frame[j]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-5, "frame {i} is off by {off} rad");
    }
    let step =
        rows.windows(2).flat_map(|pair| (1..=JOINTS).map(|j| (pair[1][j] - pair[0][j]).abs()).collect::<Vec<_>>());
    let step = step.fold(0.0, f64::max);
    assert!(step < 0.02, "a joint jumps by {step} rad in 0.67 ms");
}

#[test]
fn npz_output_holds_the_numbers_of_the_csv() {
    let (folder, input, out) = folders();
    let arrays = folder.path().join("arrays");
    go(&input, &out, &[]);
    go(&input, &arrays, &["--format", "npz"]);
    let frames = rows(&out.join("a.csv"));
    let mut npz = Npz::open(std::fs::File::open(arrays.join("a.npz")).expect("opened")).expect("an archive");
    let q = npz.read("q").expect("read").expect("q");
    assert_eq!(q.shape, [frames.len(), JOINTS]);
    let flat: Vec<f64> = frames.iter().flat_map(|row| row[1..].to_vec()).collect();
    assert_eq!(q.values, flat);
    let times = npz.read("time_s").expect("read").expect("time_s");
    assert_eq!(times.values, frames.iter().map(|row| row[0]).collect::<Vec<_>>());
    let rate = npz.read("frame_rate_hz").expect("read").expect("a rate");
    assert!(rate.shape.is_empty() && (rate.values[0] - 60.0).abs() < 1e-3);
    // The names are text, not numbers. It is enough here that they exist.
    assert!(npz.keys().contains(&"joints".to_owned()));
    assert!(npz.read("joints").expect_err("text").to_string().contains("<U"));
}

#[test]
fn second_run_skips_finished_files_and_remakes_changed_ones() {
    let (_folder, input, out) = folders();
    let counts = |summary: Summary| {
        assert!(summary.failed.is_empty(), "{:?}", summary.failed);
        (summary.made, summary.finished)
    };
    assert_eq!(counts(go(&input, &out, &["--recursive"])), (2, 0));
    let first = std::fs::metadata(out.join("a.csv")).and_then(|m| m.modified()).expect("a time");
    assert_eq!(counts(go(&input, &out, &["--recursive", "--resume"])), (0, 2));
    assert_eq!(first, std::fs::metadata(out.join("a.csv")).and_then(|m| m.modified()).expect("a time"));
    // Another input, another option, a lost output: each is made again, and nothing else.
    motion::save_bvh(&clip(200, 40), &input.join("a.bvh")).expect("saved");
    assert_eq!(counts(go(&input, &out, &["--recursive"])), (1, 1));
    assert_eq!(rows(&out.join("a.csv")).len(), 40 + usize::from(clip(200, 40).first.is_some()));
    assert_eq!(counts(go(&input, &out, &["--recursive", "--refine-steps", "0"])), (2, 0));
    std::fs::remove_file(out.join("a.csv")).expect("removed");
    assert_eq!(counts(go(&input, &out, &["--recursive", "--refine-steps", "0"])), (1, 1));
    assert_eq!(counts(go(&input, &out, &["--recursive", "--refine-steps", "0", "--overwrite"])), (2, 0));
    // A manifest whose last line was cut short still has the other entries.
    let manifest = out.join("manifest.jsonl");
    let text = std::fs::read(&manifest).expect("read");
    std::fs::write(&manifest, &text[..text.len() - 20]).expect("written");
    let summary = go(&input, &out, &["--recursive", "--refine-steps", "0"]);
    assert_eq!(summary.finished + summary.made + summary.failed.len(), 2);
    assert!(summary.finished >= 1);
}

#[test]
fn foreign_output_file_is_replaced_only_with_overwrite() {
    let (_folder, input, out) = folders();
    std::fs::create_dir_all(&out).expect("a folder");
    std::fs::write(out.join("a.csv"), "precious").expect("written");
    let summary = go(&input, &out, &[]);
    assert_eq!(summary.failed.len(), 1);
    assert!(summary.failed[0].1.text.contains("was not written by this tool"), "{:?}", summary.failed);
    assert_eq!(std::fs::read_to_string(out.join("a.csv")).expect("read"), "precious");
    assert_eq!(go(&input, &out, &["--overwrite"]).made, 1);
    assert!(rows(&out.join("a.csv")).len() > 10);
}

#[test]
fn broken_input_is_reported_and_other_files_are_converted() {
    let (_folder, input, out) = folders();
    std::fs::write(input.join("broken.bvh"), "HIERARCHY\nROOT Hips\n{\n").expect("written");
    std::fs::write(input.join("a.npz"), "no archive").expect("written");
    std::fs::write(input.join("Mean.npy"), "x").expect("written");
    std::fs::write(input.join("notes.txt"), "x").expect("written");
    let positions: Vec<_> = builtin().frames[..60].iter().map(|frame| frame.positions).collect();
    write_positions(&input.join("no_rate.npy"), &positions);
    let summary = go(&input, &out, &["--recursive"]);
    assert_eq!((summary.made, summary.no_motion.len()), (3, 1));
    let doubts = |(path, text): &(PathBuf, String)| path.ends_with("no_rate.npy") && text.contains("20 Hz");
    assert!(summary.warned.iter().any(doubts), "{:?}", summary.warned);
    let texts: Vec<String> = summary.failed.iter().map(|(_, failure)| failure.text.clone()).collect();
    assert_eq!(texts.len(), 2, "{texts:?}");
    assert!(texts[0].contains("a.npz") && texts[0].contains("already that of"), "{texts:?}");
    assert!(texts[1].contains("broken.bvh") && texts[1].contains("line "), "{texts:?}");

    let binary = |more: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_replay"));
        command.arg("batch").current_dir(root()).arg("--input").arg(&input).arg("--out").arg(&out).args(more);
        command.output().expect("it runs")
    };
    let output = binary(&["--recursive"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("broken.bvh") && text.contains("3 were finished") && text.contains("Mean.npy"), "{text}");
    std::fs::remove_file(input.join("broken.bvh")).expect("removed");
    std::fs::remove_file(input.join("a.npz")).expect("removed");
    assert_eq!(binary(&["--recursive"]).status.code(), Some(0));
    assert_eq!(binary(&["--robot", "none.toml"]).status.code(), Some(78));
}

#[test]
fn interrupted_run_leaves_no_partial_file_and_resumes() {
    let (_folder, input, out) = folders();
    let cli = cli(&input, &out, &["--recursive", "--rate", "15000", "--jobs", "1"]);
    let shutdown = Shutdown::default();
    let interrupted = std::thread::scope(|scope| {
        scope.spawn(|| {
            // The moment of the interruption is the test's input.
            std::thread::sleep(std::time::Duration::from_millis(150));
            shutdown.request();
        });
        run(&cli, &shutdown, &ProgressBar::hidden()).expect("a summary")
    });
    // At any point of interruption, every file with its final name is complete, and nothing else remains.
    for (folder, names) in [(out.clone(), ["a.csv", "manifest.jsonl", "more"]), (out.join("more"), ["b.csv", "", ""])] {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            assert!(names.contains(&name.as_str()), "{name} is left in {}", folder.display());
        }
    }
    assert_eq!(interrupted.made + usize::from(interrupted.interrupted).max(2 - interrupted.made), 2);
    let again = run(&cli, &Shutdown::default(), &ProgressBar::hidden()).expect("a summary");
    assert_eq!((again.made + again.finished, again.finished), (2, interrupted.made));
    assert_eq!(rows(&out.join("more/b.csv")).last().map(Vec::len), Some(1 + JOINTS));

    let stopped = Shutdown::default();
    stopped.request();
    let overwrite = {
        let mut cli = cli.clone();
        cli.overwrite = true;
        cli
    };
    let nothing = run(&overwrite, &stopped, &ProgressBar::hidden()).expect("a summary");
    assert!(nothing.interrupted && nothing.made == 0 && nothing.failed.is_empty());
}

#[test]
fn second_run_in_a_locked_folder_is_refused_until_unlock() {
    let (_folder, input, out) = folders();
    go(&input, &out, &[]);
    let manifest = std::fs::File::open(out.join("manifest.jsonl")).expect("the manifest is there");
    manifest.lock().expect("it can be locked, as a run does");
    let again = attempt(&input, &out, &[]);
    assert!(again.as_ref().is_err_and(|busy| busy.text.contains("another batch is writing there")), "{again:?}");
    drop(manifest);
    assert_eq!(go(&input, &out, &[]).finished, 1);
}

#[test]
fn leftovers_of_a_killed_run_are_replaced_links_not_followed() {
    let (folder, input, out) = folders();
    std::fs::create_dir_all(&out).expect("a folder");
    let precious = folder.path().join("precious");
    std::fs::write(&precious, "keep").expect("written");
    std::os::unix::fs::symlink(&precious, out.join(".a.csv.part")).expect("linked");
    assert_eq!(go(&input, &out, &[]).made, 1);
    assert_eq!(std::fs::read_to_string(&precious).expect("is there"), "keep");
    // Killed after the line and before the rename: the line exists, but the file does not.
    std::fs::remove_file(out.join("a.csv")).expect("removed");
    let again = go(&input, &out, &[]);
    assert_eq!((again.made, again.failed.len()), (1, 0), "{again:?}");
    // Killed in the same way while replacing a file. The line of the new file follows the line of the file that
    // still exists.
    let manifest = out.join("manifest.jsonl");
    let text = std::fs::read_to_string(&manifest).expect("readable");
    let last = text.lines().last().expect("a line");
    let hash = last.split("\"output_sha256\":\"").nth(1).expect("a hash")[..64].to_owned();
    let other = last.replace(&hash, &"0".repeat(64));
    std::fs::write(&manifest, format!("{text}{other}\n")).expect("written");
    assert_eq!(go(&input, &out, &[]).finished, 1);
}

#[test]
fn motion_that_becomes_too_long_fails_its_own_file() {
    let (_folder, input, out) = folders();
    let summary = go(&input, &out, &["--recursive", "--frame-rate", "0.01", "--rate", "15000"]);
    let refused = |failure: &rt::Failure| failure.text.contains("at 60 Hz, at most 120000; give the true rate");
    assert_eq!(summary.failed.iter().filter(|(_, failure)| refused(failure)).count(), 2, "{summary:?}");
}

#[test]
fn motion_with_too_many_rows_fails_its_own_file() {
    let folder = tempfile::tempdir().expect("a folder");
    // A little more than an hour at 30 Hz, in which nobody moves.
    let frames = 108_100;
    write_positions(&folder.path().join("hour.npy"), &vec![builtin().frames[0].positions; frames]);
    let more = ["--up", "z", "--frame-rate", "30", "--rate", "15000"];
    let summary = go(folder.path(), &folder.path().join("out"), &more);
    let [(_, failure)] = summary.failed.as_slice() else { panic!("{summary:?}") };
    assert!(failure.text.contains("rows at 15000 Hz, at most 54000000 are written"), "{}", failure.text);
}
