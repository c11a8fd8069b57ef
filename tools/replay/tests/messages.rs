//! Answers of the program to bad input: place, value, bound and a way out.

use crate::batch::{root, write_positions};
use std::process::Command;

/// Arguments; exit code; what the message must name, last the way out. Words that begin with `@` are files of the folder.
type Row = (&'static str, i32, &'static [&'static str]);

const ROWS: [Row; 44] = [
    ("@none.bvh --offline @o.csv", 66, &["none.bvh", "there is no such file", "Check the path"]),
    ("@clip.fbx --offline @o.csv", 66, &["clip.fbx", "\"fbx\"", "motion files are .bvh", "`replay` plays .csv"]),
    ("@clip.bvh --map @none.toml", 66, &["none.toml: there is no such file", "Check the path"]),
    (
        "@clip.bvh --map @number.toml",
        66,
        &["number.toml", "left_elbow = 3", "line 1", "expected a string", "ForeArm.L"],
    ),
    ("@clip.bvh --robot @none.toml --offline @o.csv", 78, &["none.toml: there is no such file", "check the path"]),
    ("@clip.bvh --plot @none/o.png --offline @o.csv", 73, &["o.png: there is no folder", "mkdir -p"]),
    ("@clip.bvh --frame-rate abc", 2, &["'abc'", "--frame-rate", "within [0.01, 100000]", "such as 30"]),
    ("@clip.bvh --frame-rate -1", 2, &["'-1'", "--frame-rate", "within [0.01, 100000]", "such as 30"]),
    ("builtin --speed abc", 2, &["'abc'", "--speed", "must be a number"]),
    ("builtin --speed 1e30", 64, &["--speed 1e30", "[0.1, 10]", "1 is the recorded speed"]),
    ("builtin --frame-rate 30", 64, &["builtin", "--frame-rate is for .bvh, .mcap, .npy, .npz files", "leave it out"]),
    ("@clip.bvh --mean @m.npy --std @s.npy", 64, &["clip.bvh", "--mean is for .npy files", "leave it out"]),
    ("@latin.csv", 66, &["latin.csv is no text in UTF-8", "Save it as such"]),
    ("@empty --offline @o.csv", 66, &["empty is a folder", "name one motion file"]),
    ("builtin --speed 20 --offline @o.csv", 64, &["--speed 20", "[0.1, 10]", "1 is the recorded speed"]),
    ("@clip.bvh --up z --offline @o.csv", 64, &["clip.bvh", "--up", "leave it out"]),
    ("builtin --up z", 64, &["builtin", "--up is for .npy, .npz files", "leave it out"]),
    ("@broken.bvh", 66, &["broken.bvh: line 4", "\"zero\" is not a number", "write one there"]),
    (
        "@clip.bvh --offline @o.json",
        64,
        &["JSON file beside --offline", "o.json: this is --offline", "give another file"],
    ),
    (
        "@clip.bvh --offline @o.csv --record @o.json",
        64,
        &["--record", "o.json: this is the JSON file beside --offline"],
    ),
    ("@clip.bvh --offline @o.csv --plot @o.csv", 64, &["--plot", "o.csv: this is --offline", "give another file"]),
    ("@clip.bvh --offline @o.csv --plot @empty", 73, &["empty is a folder", "Give the name of a file"]),
    (
        "@y_up.npy --up z --offline @o.csv",
        66,
        &["y_up.npy: in every frame", "60 degrees", "stand or sit", "replay batch"],
    ),
    ("@clip.bvh --offline @clip.bvh", 64, &["--offline", "clip.bvh", "give another file"]),
    ("@clip.bvh --offline @o.csv --loop", 64, &["--loop does not", "give only one of them"]),
    ("@clip.bvh --offline @o.csv --frame-rate 0", 2, &["'0'", "within [0.01, 100000]", "such as 30"]),
    ("@clip.bvh --offline @o.csv --mirror", 66, &["clip.bvh", "not mirrored", "leave it out"]),
    ("builtin --run-dir @none", 69, &["none", "no instance of teleopd", "start one: `teleopd up --run-dir "]),
    ("--compare @clip.bvh", 66, &["clip.bvh", "not an MCAP file", "`record` writes one"]),
    ("batch --input @empty --out @o", 66, &["--input", "empty", "no .bvh", "give another folder"]),
    ("batch --input @. --out @.", 73, &["--out", "lies in --input", "give another --out"]),
    ("batch --input @. --out @more --recursive", 73, &["--out", "lies in --input", "give another --out"]),
    ("batch --input @arrays --out @o --map @number.toml", 1, &["a.npy: --map is for .bvh files", "leave it out"]),
    ("batch --input @none --out @o", 66, &["none", "there is no such file", "Check the path"]),
    ("keyposes interpolate t-pose @clip.bvh:99999", 64, &["clip.bvh:99999", "\"99999\"", "not a frame of 0 to "]),
    ("keyposes interpolate t-pose @clip.bvh@99", 64, &["\"99\" is not a time of 0 to "]),
    ("keyposes interpolate t-pose @clip.bvh", 64, &["needs a frame or a time"]),
    ("keyposes interpolate t-pose rest --robot @no.toml", 66, &["no.toml: there is no such file", "Check the path"]),
    (
        "keyposes interpolate t-pose rest --weights @no",
        66,
        &["no.safetensors: there is no such file", "Check the path"],
    ),
    ("keyposes interpolate t-pose headstand", 64, &["pose headstand", "must be FILE.bvh:FRAME"]),
    ("keyposes interpolate t-pose rest --seconds 0", 64, &["--seconds 0", "[0.05, 60]"]),
    ("say wave --library @empty", 66, &["captions.tsv", "there is no such file", "Check the path"]),
    ("say the", 1, &["\"the\" names no movement", "Describe what the person does, as in \"a person boxes"]),
    ("say wave --library @.", 65, &["captions.tsv, line 1", "must be FILE<tab>CAPTION"]),
];

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
    for (arguments, code, parts) in ROWS {
        let argument = |word: &str| word.strip_prefix('@').map_or(word.into(), |name| folder.path().join(name));
        let mut program = Command::new(env!("CARGO_BIN_EXE_replay"));
        let refused = program.current_dir(root()).args(arguments.split(' ').map(argument)).output().expect("it runs");
        let text = String::from_utf8_lossy(&refused.stderr);
        let lacks: Vec<_> = parts.iter().filter(|part| !text.contains(**part)).collect();
        if refused.status.code() != Some(code) || !lacks.is_empty() {
            wrong.push(format!("{arguments}: {:?}, lacks {lacks:?}: {text}", refused.status.code()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
