//! The user's embeddings: a tiny text encoder, written here byte by byte, which a real onnxruntime runs.
#![cfg(feature = "embeddings")]

mod protobuf;

use protobuf::Message;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

/// onnxruntime's shared library, or the reason why it is missing.
static RUNTIME: LazyLock<Result<PathBuf, String>> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("onnxruntime");
    let python = folder.join("bin/python");
    let run = |command: &mut Command| match command.output() {
        Ok(done) if done.status.success() => Ok(String::from_utf8_lossy(&done.stdout).trim().to_owned()),
        Ok(done) => Err(format!("{command:?}: {}", String::from_utf8_lossy(&done.stderr).trim())),
        Err(error) => Err(format!("{command:?}: {error}")),
    };
    if !python.exists() {
        run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    }
    let pip =
        ["-m", "pip", "install", "--quiet", "--retries", "1", "--timeout", "10", "--no-deps", "onnxruntime>=1.17"];
    run(Command::new(&python).args(pip))?;
    let site = run(Command::new(&python).args(["-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]))?;
    let capi = Path::new(&site).join("onnxruntime/capi");
    let entries = std::fs::read_dir(&capi).map_err(|error| format!("{}: {error}", capi.display()))?;
    let mut names = entries.flatten().map(|entry| entry.path());
    let library =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("libonnxruntime.so"));
    names.find(library).ok_or_else(|| format!("{}: no libonnxruntime.so", capi.display()))
});

/// Returns [`RUNTIME`]. Prints the reason if it is missing.
fn runtime_or_skip() -> Option<&'static Path> {
    RUNTIME.as_ref().map_err(|why| println!("skipped: no onnxruntime: {why}")).map(PathBuf::as_path).ok()
}

fn run_say(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_replay")).arg("say").args(arguments).output().expect("it runs")
}

/// ONNX's numbers of the types float and int64.
const FLOAT: u64 = 1;
const INT64: u64 = 7;

/// A ValueInfoProto. A dimension of 0 has any length.
fn value(name: &str, kind: u64, shape: &[u64]) -> Message {
    let dimension = |&size: &u64| match size {
        0 => Message::default().text(2, "n"),
        size => Message::default().number(1, size),
    };
    let shape = shape.iter().map(dimension).fold(Message::default(), |shape, size| shape.message(1, size));
    let tensor = Message::default().number(1, kind).message(2, shape);
    Message::default().text(1, name).message(2, Message::default().message(1, tensor))
}

/// A TensorProto.
fn tensor(name: &str, kind: u64, shape: &[u64], bytes: &[u8]) -> Message {
    let tensor = shape.iter().fold(Message::default(), |tensor, &size| tensor.number(1, size));
    tensor.number(2, kind).text(8, name).bytes(9, bytes)
}

/// A NodeProto.
fn node(operator: &str, inputs: &[&str], output: &str) -> Message {
    let node = inputs.iter().fold(Message::default(), |node, input| node.text(1, input));
    node.text(2, output).text(4, operator)
}

/// Last layer of an encoder in these tests.
#[derive(Clone, Copy, PartialEq)]
enum Ends {
    /// A row for each token, [1, n, 2].
    Rows,
    /// Their sum, [1, 2], named sentence_embedding, after an output that does not depend on the words.
    Sentence,
    /// A row for each token, and no batch: [n, 2].
    Flat,
    /// One row for all tokens, whose name does not mark it as a sentence: [1, 1, 2].
    One,
    /// Requires an unknown input.
    Pixels,
}

/// A ModelProto: the row of `words` for each of the input_ids. Field numbers of onnx.proto3, opset 17.
fn encoder(words: &[[f32; 2]], ends: Ends) -> Vec<u8> {
    let bytes: Vec<u8> = words.as_flattened().iter().flat_map(|value| value.to_le_bytes()).collect();
    let ids = if ends == Ends::Pixels { "pixel_values" } else { "input_ids" };
    let graph = Message::default()
        .text(2, "encoder")
        .message(5, tensor("words", FLOAT, &[words.len() as u64, 2], &bytes))
        .message(5, tensor("tokens_axis", INT64, &[1], &1_i64.to_le_bytes()))
        .message(5, tensor("batch_axis", INT64, &[1], &0_i64.to_le_bytes()))
        .message(11, value(ids, INT64, &[0, 0]))
        .message(11, value("attention_mask", INT64, &[0, 0]))
        .message(1, node("Gather", &["words", ids], "rows"));
    let graph = match ends {
        Ends::Rows | Ends::Pixels => graph.message(12, value("rows", FLOAT, &[0, 0, 2])),
        Ends::Sentence => {
            let keep = Message::default().text(1, "keepdims").number(3, 0).number(20, 2);
            graph
                .message(1, node("ReduceSum", &["rows", "tokens_axis"], "sentence_embedding").message(5, keep))
                .message(1, node("Gather", &["words", "attention_mask"], "mask_rows"))
                .message(12, value("mask_rows", FLOAT, &[0, 0, 2]))
                .message(12, value("sentence_embedding", FLOAT, &[0, 2]))
        }
        Ends::One => graph
            .message(1, node("ReduceSum", &["rows", "tokens_axis"], "one"))
            .message(12, value("one", FLOAT, &[0, 1, 2])),
        Ends::Flat => graph
            .message(1, node("Squeeze", &["rows", "batch_axis"], "flat"))
            .message(12, value("flat", FLOAT, &[0, 2])),
    };
    Message::default().number(1, 8).message(7, graph).message(8, Message::default().number(2, 17)).0
}

/// Splits at spaces. Every sentence is padded to four tokens with [PAD], which the mask hides.
const TOKENIZER: &str = r#"{
    "version": "1.0", "truncation": null, "added_tokens": [], "normalizer": {"type": "Lowercase"},
    "padding": {"strategy": {"Fixed": 4}, "direction": "Right", "pad_to_multiple_of": null, "pad_id": 0,
        "pad_type_id": 0, "pad_token": "[PAD]"},
    "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null, "decoder": null,
    "model": {"type": "WordLevel", "unk_token": "[UNK]",
        "vocab": {"[PAD]": 0, "[UNK]": 1, "wave": 2, "clap": 3, "nothing": 4, "broken": 5, "far": 99}}
}"#;

/// Rows of the vocabulary. If the padding counted, it would turn every sentence to one side.
const WORDS: [[f32; 2]; 6] = [[0.0, -100.0], [0.1, 0.1], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [f32::NAN, 0.0]];

/// A .npy of float32.
fn npy(shape: &[usize], values: &[f32]) -> Vec<u8> {
    let mut out = Vec::new();
    motion::npy::write_npy_header(&mut out, "<f4", shape).expect("written");
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    out
}

/// A library of three captions, with embeddings.
struct Scene {
    folder: tempfile::TempDir,
}

impl Scene {
    fn new(ends: Ends) -> Self {
        let scene = Self { folder: tempfile::tempdir().expect("a folder") };
        scene.write(
            "captions.tsv",
            b"both.bvh\tsomething of both\nwaves.bvh\tmoves a hand\nclaps.bvh\tbeats the palms\n",
        );
        scene.write("model.onnx", &encoder(&WORDS, ends));
        scene.write("tokenizer.json", TOKENIZER.as_bytes());
        // The rows have different lengths, which do not matter.
        scene.write("motions.npy", &npy(&[3, 2], &[0.1, 0.1, 7.0, 0.0, 0.0, 0.5]));
        scene
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.folder.path().join(name), bytes).expect("written");
    }

    fn say(&self, sentence: &str, runtime: &Path, more: &[&str]) -> Output {
        let (folder, runtime) = (self.folder.path().display().to_string(), runtime.display().to_string());
        let given = [sentence, "--library", &folder, "--embeddings", &folder, "--onnxruntime", &runtime];
        run_say(&[&given[..], more].concat())
    }

    /// Returns file and score of each match.
    fn found(&self, sentence: &str, runtime: &Path) -> Vec<(String, f64)> {
        let output = self.say(sentence, runtime, &["--json"]);
        assert!(output.status.success(), "{sentence}: {output:?}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let found = json["found"].as_array().expect("an array").iter();
        found.map(|one| (one["file"].as_str().unwrap().to_owned(), one["score"].as_f64().unwrap())).collect()
    }

    fn refused(&self, sentence: &str, runtime: &Path, code: i32, texts: &[&str]) {
        let output = self.say(sentence, runtime, &[]);
        let printed = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{printed}");
        assert!(
            texts.iter().all(|text| printed.contains(text)) && printed.lines().count() == 1,
            "{texts:?}: {printed}"
        );
        assert!(output.stdout.is_empty(), "{output:?}");
    }
}

fn assert_near(found: &[(String, f64)], expected: &[(&str, f64)]) {
    assert_eq!(found.len(), expected.len());
    for ((file, score), (name, cosine)) in found.iter().zip(expected) {
        assert!(file == name && (score - cosine).abs() < 1e-6, "{found:?}, not {expected:?}");
    }
}

#[test]
fn motions_are_ranked_by_nearness_of_their_embeddings() {
    let Some(runtime) = runtime_or_skip() else { return };
    let half = 0.5_f64.sqrt();
    for ends in [Ends::Rows, Ends::Sentence] {
        // The sum includes the padding. An encoder with a sentence output is responsible for that itself.
        let scene = Scene::new(ends);
        if ends == Ends::Sentence {
            scene.write("tokenizer.json", TOKENIZER.replace("\"Fixed\": 4", "\"Fixed\": 1").as_bytes());
        }
        let clap = scene.found("CLAP", runtime);
        assert_near(&clap, &[("claps.bvh", 1.0), ("both.bvh", half), ("waves.bvh", 0.0)]);
        let most = (2.0 + 1.0) / (5.0_f64.sqrt() * 2.0_f64.sqrt());
        let mixed = scene.found("wave wave clap", runtime);
        assert_near(
            &mixed,
            &[("both.bvh", most), ("waves.bvh", 2.0 / 5.0_f64.sqrt()), ("claps.bvh", 1.0 / 5.0_f64.sqrt())],
        );
    }
}

#[test]
fn invalid_encoder_or_embedding_is_refused_by_file_name() {
    let Some(runtime) = runtime_or_skip() else { return };
    let scene = Scene::new(Ends::Flat);
    scene.refused("wave", runtime, 65, &["model.onnx: output `flat` has the shape [4, 2] for 4 tokens", "[1, 4, d]"]);
    Scene::new(Ends::One).refused("wave", runtime, 65, &["output `one` has the shape [1, 1, 2] for 4 tokens"]);
    Scene::new(Ends::Pixels).refused(
        "wave",
        runtime,
        65,
        &["model.onnx: input `pixel_values` is unknown; the inputs are input_ids"],
    );
    let scene = Scene::new(Ends::Rows);
    scene.refused("broken", runtime, 65, &["model.onnx: the sentence's embedding has no direction"]);
    scene.refused("nothing", runtime, 65, &["model.onnx: the sentence's embedding has no direction"]);
    scene.refused("far", runtime, 65, &["model.onnx: onnxruntime reports: "]);
    scene.refused("", runtime, 65, &["tokenizer.json: finds no token in the sentence"]);
    scene.write("model.onnx", b"no model");
    scene.refused("wave", runtime, 65, &["model.onnx: onnxruntime reports: "]);
    scene.write("motions.npy", &npy(&[3, 1], &[1.0; 3]));
    scene.write("model.onnx", &encoder(&WORDS, Ends::Rows));
    scene.refused("wave", runtime, 65, &["motions.npy: rows of 1 numbers; the encoder's embedding has 2"]);
}

/// Needs no onnxruntime, because the folder is checked first.
#[test]
fn embeddings_unfit_for_the_library_are_refused_by_file_name() {
    let nowhere = Path::new("/nowhere/libonnxruntime.so");
    let scene = Scene::new(Ends::Rows);
    let rows = |shape: &[usize], values: &[f32], texts: &[&str]| {
        scene.write("motions.npy", &npy(shape, values));
        scene.refused("wave", nowhere, 65, texts);
    };
    rows(&[2, 2], &[1.0; 4], &["motions.npy: has the shape [2, 2]; it must be [3, d]"]);
    rows(&[6], &[1.0; 6], &["motions.npy: has the shape [6]; it must be [3, d]"]);
    rows(&[3, 0], &[], &["motions.npy: has the shape [3, 0]"]);
    rows(&[3, 2], &[1.0, 1.0, 1.0, f32::NAN, 1.0, 1.0], &["motions.npy: row 1, counted from 0, has no direction"]);
    rows(&[3, 2], &[1.0, 1.0, 1.0, 1.0, 0.0, 0.0], &["motions.npy: row 2, counted from 0, has no direction"]);
    rows(&[3, 2], &[1.0; 5], &["motions.npy: "]);
    scene.write("motions.npy", b"no array");
    scene.refused("wave", nowhere, 65, &["motions.npy: "]);
    scene.write("motions.npy", &npy(&[3, 2], &[1.0; 6]));
    scene.write("tokenizer.json", b"{}");
    scene.refused("wave", nowhere, 65, &["tokenizer.json: "]);
    for name in ["model.onnx", "tokenizer.json", "motions.npy"] {
        let scene = Scene::new(Ends::Rows);
        std::fs::remove_file(scene.folder.path().join(name)).expect("removed");
        scene.refused("wave", nowhere, 66, &[name, "No such file"]);
    }
}

#[test]
fn missing_or_invalid_onnxruntime_is_refused_by_path() {
    let scene = Scene::new(Ends::Rows);
    scene.refused("wave", Path::new("/nowhere/libonnxruntime.so"), 66, &["/nowhere/libonnxruntime.so: No such file"]);
    scene.write("libnone.so", b"no library");
    let none = scene.folder.path().join("libnone.so");
    scene.refused("wave", &none, 69, &["libnone.so: is not onnxruntime (1.17 or later): "]);
    let folder = scene.folder.path().to_str().expect("a path");
    for [one, other] in [["--embeddings", "--synonyms"], ["--onnxruntime", "--top"]] {
        assert_eq!(run_say(&["wave", one, folder, other, "5"]).status.code(), Some(2), "{one} with {other}");
    }
    assert_eq!(run_say(&["wave", "--embeddings", folder]).status.code(), Some(2), "needs onnxruntime");
}
