//! Answers of the program to bad input: place, value, bound and a way out.

use crate::batch::{root, write_positions};
use std::process::Command;

/// Arguments; exit code; what the message must name, last the way out. Words that begin with `@` are files of the folder.
type Row = (String, i32, Vec<String>);

#[test]
fn every_refusal_names_place_value_bound_and_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    motion::save_bvh(&motion::builtin(), &folder.path().join("clip.bvh")).expect("written");
    std::fs::write(folder.path().join("clip.fbx"), "Kaydara").expect("written");
    std::fs::write(folder.path().join("broken.bvh"), "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 zero\n").expect("written");
    std::fs::write(folder.path().join("latin.csv"), b"\xe9").expect("written");
    std::fs::write(folder.path().join("captions.tsv"), "clip.bvh waves\n").expect("written");
    std::fs::write(folder.path().join("number.toml"), "left_elbow = 3\n").expect("written");
    for name in ["empty", "arrays"] {
        std::fs::create_dir(folder.path().join(name)).expect("made");
    }
    std::fs::write(folder.path().join("arrays/a.npy"), "").expect("written");
    let y_up = |frame: &motion::Frame| frame.positions.map(|[x, y, z]| [y, z, x]);
    let positions: Vec<_> = motion::builtin().frames[..60].iter().map(y_up).collect();
    write_positions(&folder.path().join("y_up.npy"), &positions);
    let mut wrong = Vec::new();
    let rows: Vec<Row> = serde_json::from_str(include_str!("refusals.json")).expect("rows");
    for (arguments, code, parts) in rows {
        let argument = |word: &str| word.strip_prefix('@').map_or(word.into(), |name| folder.path().join(name));
        let mut program = Command::new(env!("CARGO_BIN_EXE_replay"));
        let refused = program.current_dir(root()).args(arguments.split(' ').map(argument)).output().expect("it runs");
        let text = String::from_utf8_lossy(&refused.stderr);
        let lacks: Vec<_> = parts.iter().filter(|part| !text.contains(part.as_str())).collect();
        if refused.status.code() != Some(code) || !lacks.is_empty() {
            wrong.push(format!("{arguments}: {:?}, lacks {lacks:?}: {text}", refused.status.code()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
