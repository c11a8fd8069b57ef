//! Answers of the program to bad input: place, value, bound and a way out.

use std::path::Path;
use std::process::Command;

/// Arguments; exit code; what the message must name, last the way out. Words that begin with `@` are files of the folder.
type Row = (&'static str, i32, &'static [&'static str]);

const ROWS: [Row; 24] = [
    ("@none.bvh --offline @o.csv", 66, &["none.bvh", "there is no such file", "Check the path"]),
    ("@clip.fbx --offline @o.csv", 66, &["clip.fbx", "\"fbx\"", "motion files are .bvh"]),
    ("@empty --offline @o.csv", 66, &["empty is a folder", "name one motion file"]),
    ("builtin --speed 20 --offline @o.csv", 64, &["--speed 20", "[0.1, 10]", "1 is the recorded speed"]),
    ("@clip.bvh --up z --offline @o.csv", 64, &["clip.bvh", "--up", "leave it out"]),
    ("builtin --up z", 64, &["builtin", "--up is for .npy and .npz files", "leave it out"]),
    ("@broken.bvh", 66, &["broken.bvh: line 4", "\"zero\" is not a number", "write one there"]),
    ("@clip.bvh --offline @o.json", 64, &["o.json", "the same name", "give a name with .csv"]),
    ("@clip.bvh --offline @clip.bvh", 64, &["--offline", "clip.bvh", "give another file"]),
    ("@clip.bvh --offline @o.csv --loop", 64, &["--loop does not", "give only one of them"]),
    ("@clip.bvh --offline @o.csv --frame-rate 0", 66, &["clip.bvh", "0 Hz", "[0.01, 100000]", "--frame-rate HZ"]),
    ("@clip.bvh --offline @o.csv --mirror", 66, &["clip.bvh", "not mirrored", "leave it out"]),
    ("builtin --run-dir @none", 69, &["none", "no instance of teleopd", "start `teleopd up`"]),
    ("--compare @clip.bvh", 66, &["clip.bvh", "not an MCAP file", "`record` writes one"]),
    ("batch --input @empty --out @o", 66, &["--input", "empty", "no .bvh", "give another folder"]),
    ("batch --input @. --out @.", 73, &["--out", "lies in --input", "give another --out"]),
    ("batch --input @. --out @more --recursive", 73, &["--out", "lies in --input", "give another --out"]),
    ("batch --input @none --out @o", 66, &["none", "there is no such file", "Check the path"]),
    ("keyposes interpolate t-pose @clip.bvh:99999", 64, &["clip.bvh:99999", "\"99999\"", "not a frame of 0 to "]),
    ("keyposes interpolate t-pose headstand", 64, &["pose headstand", "must be FILE.bvh:FRAME"]),
    ("keyposes interpolate t-pose rest --seconds 0", 64, &["--seconds 0", "[0.05, 60]"]),
    ("say wave --library @empty", 66, &["captions.tsv", "there is no such file", "Check the path"]),
    ("say the", 1, &["\"the\" names no movement", "Describe what the person does, as in \"a person boxes"]),
    ("say wave --library @.", 65, &["captions.tsv, line 1", "must be FILE<tab>CAPTION"]),
];

#[test]
fn every_refusal_names_place_value_bound_and_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    motion::save_bvh(&motion::builtin(), &folder.path().join("clip.bvh")).expect("written");
    std::fs::write(folder.path().join("clip.fbx"), "Kaydara").expect("written");
    std::fs::write(folder.path().join("broken.bvh"), "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 zero\n").expect("written");
    std::fs::write(folder.path().join("captions.tsv"), "clip.bvh waves\n").expect("written");
    std::fs::create_dir(folder.path().join("empty")).expect("made");
    let mut wrong = Vec::new();
    for (arguments, code, parts) in ROWS {
        let argument = |word: &str| word.strip_prefix('@').map_or(word.into(), |name| folder.path().join(name));
        let mut program = Command::new(env!("CARGO_BIN_EXE_replay"));
        let refused = program.current_dir(&root).args(arguments.split(' ').map(argument)).output().expect("it runs");
        let text = String::from_utf8_lossy(&refused.stderr);
        let lacks: Vec<_> = parts.iter().filter(|part| !text.contains(**part)).collect();
        if refused.status.code() != Some(code) || !lacks.is_empty() {
            wrong.push(format!("{arguments}: {:?}, lacks {lacks:?}: {text}", refused.status.code()));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
