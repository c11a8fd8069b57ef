//! Runs the command on a small motion: clips, frames, keys of the JSON, errors.

use clap::Parser;
use eval::cli::Cli;
use eval::clips;
use eval::run::run;
use motion::{CalibrationMode, Motion, builtin};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns a part of the built-in motion in which both arms move.
fn short(name: &str, frames: usize) -> Motion {
    let mut motion = builtin();
    motion.name = name.to_owned();
    motion.frames = motion.frames.into_iter().skip(500).take(frames).collect();
    motion
}

pub fn folder(names: &[&str], frames: usize) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for name in names {
        motion::save_bvh(&short(name, frames), &folder.path().join(format!("{name}.bvh"))).expect("a motion file");
    }
    folder
}

fn cli(folder: &TempDir, more: &[&str]) -> Cli {
    let path = |name: &str| root().join(name).display().to_string();
    let (human, robot) = (folder.path().display().to_string(), path("config/robots/tiago_dual.toml"));
    let weights = path("weights/tiago_dual.safetensors");
    Cli::parse_from([&["eval", "--human", &human, "--robot", &robot, "--weights", &weights], more].concat())
}

fn measured(folder: &TempDir, more: &[&str]) -> Value {
    let json = folder.path().join("out.json");
    let out = json.display().to_string();
    run(&cli(folder, &[more, &["--json", &out]].concat())).expect("the command succeeds");
    serde_json::from_str(&std::fs::read_to_string(json).expect("the file is written")).expect("it is JSON")
}

const KEYS: &str = "\
    s_gr limb_deg_mean limb_deg_p95 direction_deg joint_mse_rad2 jerk_ratio flips_per_1000 us_per_pose \
    reachable_deg_mean reachable_deg_p99";

#[test]
fn eval_writes_all_figures_and_names_missing_methods() {
    let folder = folder(&["one"], 90);
    let out = measured(&folder, &["--calibration", "rig"]);
    assert_eq!(out["clips"], serde_json::json!(["one"]));
    assert_eq!(out["frames"], 90);
    for name in ["ours_k0", "ours_k2", "closed_form_3lm", "previous_frame_3lm", "oracle"] {
        for key in KEYS.split(' ') {
            assert!(out["methods"][name][key].as_f64().is_some_and(f64::is_finite), "{name} {key}: {out:#}");
        }
    }
    let mean = |name: &str| out["methods"][name]["limb_deg_mean"].as_f64().unwrap_or(f64::NAN);
    assert!(mean("oracle") <= mean("ours_k2") + 1e-6 && mean("ours_k2") < mean("ours_k0"), "{out:#}");
}

#[test]
fn missing_or_unknown_method_or_clip_is_an_error() {
    let folder = folder(&["one"], 20);
    let refused = |more: &[&str]| run(&cli(&folder, more)).expect_err("the command fails");
    let with = |weights, methods| run(&Cli { weights, ..cli(&folder, &["--methods", methods]) });
    with(Some("none".into()), "oracle,closed_form_3lm").expect("neither needs weights");
    // The weights that ship are not below this package's folder.
    let missing = with(None, "oracle,ours_k2").expect_err("the command fails");
    assert!(missing.exit == rt::Exit::NoInput && missing.text.starts_with("--methods names ours_k2"), "{missing}");
    let unknown = refused(&["--methods", "magic"]);
    assert!(unknown.to_string().contains("magic") && unknown.to_string().contains("ours_k2"), "{unknown}");
    let clip = refused(&["--clips", "two"]);
    assert!(clip.text.starts_with("--clips names two: "), "{clip}");
}

#[test]
fn robot_without_weights_is_measured_without_those_of_another() {
    let folder = folder(&["one"], 20);
    let (robots, heron) = (root().join("config/robots"), folder.path().join("heron.toml"));
    let text = std::fs::read_to_string(robots.join("unitree_h1.toml")).expect("a robot file");
    std::fs::write(&heron, text.replacen("\"unitree_h1\"", "\"heron\"", 1)).expect("a robot file");
    std::fs::copy(robots.join("unitree_h1.urdf"), folder.path().join("unitree_h1.urdf")).expect("its URDF");
    let mut eval = Command::new(env!("CARGO_BIN_EXE_eval"));
    eval.current_dir(root()).arg("--human").arg(folder.path()).arg("--robot").arg(heron);
    let eval = eval.output().expect("eval runs");
    let out = String::from_utf8_lossy(&eval.stdout);
    assert!(eval.status.success() && out.contains("missing ours_k2: "), "{eval:?}");
    assert!(out.contains(" --out weights/heron\n"), "{out}");
}

#[test]
fn default_clips_are_those_left_out_of_training() {
    let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    let folder = folder(&names, 30);
    let mode = CalibrationMode::First10s;
    let chosen = |names: Option<&str>| -> Vec<String> {
        let (clips, _) =
            clips::read(folder.path(), names, mode, &motion::LoadOptions::default()).expect("the folder is read");
        clips.into_iter().map(|clip| clip.name).collect()
    };
    let left_out = train::clips::Clips::read(&[folder.path()], mode, &motion::LoadOptions::default())
        .expect("the folder is read")
        .validation;
    let left_out: Vec<String> = left_out.into_iter().map(|clip| clip.name).collect();
    assert_eq!(chosen(None), left_out);
    assert_eq!(left_out, ["c", "h"]);
    assert_eq!(chosen(Some("all")).len(), names.len());
    assert_eq!(chosen(Some("b,h")), ["b", "h"]);
}
