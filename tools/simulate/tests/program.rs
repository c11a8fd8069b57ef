//! The program: its output, and the arguments that it rejects before it runs.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Command, Output};

fn simulate(arguments: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_simulate")).current_dir(root).args(arguments).output().expect("it runs")
}

fn figures(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("the file")).expect("JSON")
}

#[test]
fn replay_writes_the_same_figures_as_a_campaign_of_its_seed() {
    let folder = tempfile::tempdir().expect("a folder");
    let (one, all) = (folder.path().join("one.json"), folder.path().join("all.json"));
    // The old content is longer.
    std::fs::write(&one, vec![b' '; 100_000]).expect("a file");
    let json = |path: &Path| path.to_str().expect("a path").to_owned();
    let common = ["--ticks", "4000", "--fault", "frame-nan", "estop"];
    let replayed = simulate(&[&["--replay", "4", "--json", &json(&one)], &common[..]].concat());
    assert!(replayed.status.success(), "{replayed:?}");
    let campaign = simulate(&[&["--first-seed", "4", "--seeds", "1", "--json", &json(&all)], &common[..]].concat());
    assert!(campaign.status.success(), "{campaign:?}");
    let (mut one, mut all) = (figures(&one), figures(&all));
    let kinds: BTreeSet<_> = one["kinds"].as_array().expect("kinds").iter().filter_map(Value::as_str).collect();
    assert_eq!(kinds, BTreeSet::from(["estop", "frame-nan"]));
    assert_eq!(one["config_hash"].as_str().map(str::len), Some(16), "{one}");
    for figures in [&mut one, &mut all] {
        let object = figures.as_object_mut().expect("an object");
        assert!(object.remove("wall_s").is_some() && object.remove("jobs").is_some());
    }
    assert_eq!(one, all);
}

#[test]
fn unwritable_json_file_is_refused_before_the_run() {
    for run in [&["--seeds", "1000000"][..], &["--replay", "4"]] {
        let output = simulate(&[run, &["--json", "/nowhere/at/all.json"]].concat());
        assert_eq!(output.status.code(), Some(73), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/at/all.json: "), "{output:?}");
        assert!(output.stdout.is_empty(), "nothing was run: {output:?}");
    }
}
