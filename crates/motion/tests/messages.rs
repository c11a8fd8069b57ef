//! Every message of the readers names its place, value and bound, and a way out.

use motion::{ArrayError, BvhError, McapError, MirrorError, MotionError, Up};
use std::collections::BTreeSet;
use std::mem::discriminant;

/// A message, and what it must name: place, value, bound, and last the way out.
type Row = (MotionError, &'static [&'static str]);

fn array(source: ArrayError) -> MotionError {
    MotionError::Array { file: "clip.npy".into(), source }
}

fn bvh(source: BvhError) -> MotionError {
    MotionError::Bvh { file: "clip.bvh".into(), source }
}

fn mcap(source: McapError) -> MotionError {
    MotionError::Mcap { file: "clip.mcap".into(), source }
}

fn of_files() -> Vec<Row> {
    let file = || "clip.x".to_owned();
    let mirror = |source| MotionError::Mirror { file: "clip.bvh".into(), source };
    vec![
        (MotionError::UnknownFormat { file: file(), extension: "fbx".into() }, &["clip.x", "\"fbx\"", "are .bvh"]),
        (MotionError::Folder { file: file() }, &["clip.x", "folder", "name one motion file"]),
        (MotionError::TooLarge { file: file(), bytes: 901, bound: 807 }, &["clip.x", "901", "807", "split it"]),
        (
            MotionError::TooLong { file: file(), frames: 901, rate_hz: 0.2, resampled: 802, bound: 703 },
            &["clip.x", "901", "0.2", "802", "703", "--frame-rate HZ"],
        ),
        (MotionError::Map { file: file(), cause: "elbow is no joint".into() }, &["clip.x", "elbow", "names joints so"]),
        (mirror(MirrorError::Mirrored { sides: 0.71, front: -0.62 }), &["clip.bvh", "0.71", "-0.62", "give --mirror"]),
        (mirror(MirrorError::Swapped { sides: -0.71 }), &["clip.bvh", "-0.71", "--map"]),
        (mirror(MirrorError::NotMirrored { front: 0.62 }), &["clip.bvh", "0.62", "leave it out"]),
        (mcap(McapError::NotMcap { cause: "no mark".into() }), &["clip.mcap", "no mark", "`record` writes one"]),
        (mcap(McapError::Read { cause: "no disk".into() }), &["clip.mcap", "no disk", "copy it"]),
        (mcap(McapError::Channels { bound: 807, bytes: 901 }), &["clip.mcap", "807", "901", "pymcap-cli filter"]),
        (
            mcap(McapError::Unpacked { offset: 605, bytes: 901, bound: 807 }),
            &["clip.mcap", "605", "901", "807", "pymcap-cli decompress"],
        ),
        (mcap(McapError::Disorder { bytes: 901, bound: 807 }), &["clip.mcap", "901", "807", "pymcap-cli sort"]),
        (mcap(McapError::Frames { bound: 807 }), &["clip.mcap", "807", "pymcap-cli split"]),
        (
            mcap(McapError::NoSkeletons { count: 1, layout: "S", topics: "/pose (P)".into(), broken: String::new() }),
            &["clip.mcap", "1 skeleton", "at least 2", "/pose (P)", "`record` writes them"],
        ),
    ]
}

fn of_arrays() -> Vec<Row> {
    let (shape, cause) = (|| vec![901, 23, 3], || "no descr".to_owned());
    let key = ArrayError::Empty { shape: vec![0, 3] };
    vec![
        (array(ArrayError::NotNpy), &["clip.npy", "NUMPY", "numpy.save"]),
        (array(ArrayError::NotZip { cause: cause() }), &["clip.npy", "no descr", "numpy.savez"]),
        (array(ArrayError::Header { cause: cause() }), &["clip.npy", "header", "no descr", "numpy.save"]),
        (array(ArrayError::Type { found: "c8".into() }), &["clip.npy", "c8", "save f2, f4, f8"]),
        (array(ArrayError::TooLarge { shape: shape(), bound: 807 }), &["clip.npy", "901, 23, 3", "807", "split it"]),
        (
            array(ArrayError::Packed { shape: shape(), bound: 807, bytes: 605 }),
            &["clip.npy", "901, 23, 3", "807", "605", "without compression (numpy.savez)"],
        ),
        (array(ArrayError::TooManyFrames { frames: 901, bound: 807 }), &["clip.npy", "901", "807", "split"]),
        (
            array(ArrayError::Short { shape: shape(), found: 605, claimed: 807 }),
            &["clip.npy", "901, 23, 3", "605", "807", "copy or save it again"],
        ),
        (array(ArrayError::Damaged { cause: cause() }), &["clip.npy", "no descr", "copy or save it again"]),
        (
            array(ArrayError::Key { key: "trans".into(), source: key.into() }),
            &["clip.npy: trans: ", "save at least one"],
        ),
        (
            array(ArrayError::MissingKeys { missing: "poses", found: vec!["betas".into()] }),
            &["clip.npy", "no poses", "betas", "numpy.savez"],
        ),
        (
            array(ArrayError::Shape { found: shape(), expected: "(N, 22, 3)" }),
            &["clip.npy", "[901, 23", "expected (N, 22, 3)"],
        ),
        (array(ArrayError::Parameters), &["clip.npy", "322", "save columns 0 to 3"]),
        (array(ArrayError::Empty { shape: vec![0, 22, 3] }), &["clip.npy", "[0, 22, 3]", "at least one"]),
        (
            array(ArrayError::Number { frame: 605, column: 17, value: 901.0, bound: 807.0 }),
            &["clip.npy", "frame 605", "number 17", "901", "807", "cut this frame out"],
        ),
        (
            array(ArrayError::FrameRate { value: 901.0, low: 0.1, high: 807.0 }),
            &["clip.npy", "901", "0.1", "807", "--frame-rate HZ"],
        ),
        (array(ArrayError::NoSize { length: 0.07 }), &["clip.npy", "0.07 m", "the first 22 joints must be"]),
        (array(ArrayError::Statistics), &["clip.npy", "[263]", "(N, 263)", "give that file"]),
        (
            array(ArrayError::NeedsStatistics { signs: "legs 3.1".into(), levels: 2 }),
            &["clip.npy", "legs 3.1", "2 folders above", "give --mean FILE and --std FILE"],
        ),
        (array(ArrayError::HalfOfStatistics), &["clip.npy", "one of --mean and --std", "give both"]),
        (
            array(ArrayError::WrongStatistics {
                mean: "M.npy".into(),
                before: "legs 3.1".into(),
                after: "legs 2.1".into(),
            }),
            &["clip.npy", "M.npy", "legs 3.1", "legs 2.1", "--mean FILE and --std FILE"],
        ),
    ]
}

fn of_bvh() -> Vec<Row> {
    let (line, found) = (605, || "Tail".to_owned());
    let missing = BvhError::MissingJoints { missing: vec!["left_elbow"], found: vec![found()] };
    let unknown = BvhError::UnknownName { joint: "left_elbow", name: "Arm".into(), found: vec![found()] };
    vec![
        (bvh(BvhError::Empty), &["clip.bvh: line 1", "empty", "export it again"]),
        (bvh(BvhError::Truncated { line, expected: "}" }), &["clip.bvh: line 605", "expected }", "export it again"]),
        (bvh(BvhError::Unexpected { line, found: found(), expected: "}" }), &["line 605", "\"Tail\"", "expected }"]),
        (
            bvh(BvhError::NotANumber { line, found: found(), what: "OFFSET" }),
            &["clip.bvh: line 605", "\"Tail\"", "OFFSET", "write one there"],
        ),
        (
            bvh(BvhError::OutOfRange { line, what: "OFFSET", value: 901.0, bound: 807.0 }),
            &["clip.bvh: line 605", "OFFSET 901", "807", "export again"],
        ),
        (
            bvh(BvhError::FrameTime { line, value_s: 11.5, low_s: 0.1, high_s: 10.2 }),
            &["clip.bvh: line 605", "11.5", "0.1", "10.2", "write the seconds"],
        ),
        (
            bvh(BvhError::TooMany { line, what: "joints", value: 901, bound: 807 }),
            &["clip.bvh: line 605", "joints: 901", "at most 807", "export fewer"],
        ),
        (
            bvh(BvhError::FrameCount { line, claimed: 901, channels: 7, bytes: 504 }),
            &["clip.bvh: line 605", "901 frames of 7", "at least 18", "504", "correct the count"],
        ),
        (bvh(BvhError::TooFewFrames { line, frames: 1 }), &["clip.bvh: line 605", "1 frame", "at least 2 are needed"]),
        (bvh(BvhError::Trailing { line, frames: 901 }), &["clip.bvh: line 605", "901", "correct the count"]),
        (bvh(unknown), &["clip.bvh", "left_elbow", "\"Arm\"", "give one of Tail"]),
        (bvh(missing), &["clip.bvh", "left_elbow", "Tail", "a file for --map, such as left_elbow = "]),
        (bvh(BvhError::NoSize { length: 0.07 }), &["clip.bvh", "0.07 units", "export the skeleton"]),
        (bvh(BvhError::Mirror(MirrorError::Swapped { sides: -0.71 })), &["clip.bvh", "-0.71", "--map"]),
    ]
}

#[test]
fn every_message_names_place_value_bound_and_what_to_do() {
    let (mut kinds, mut wrong) = (BTreeSet::new(), Vec::new());
    for (error, parts) in of_files().into_iter().chain(of_arrays()).chain(of_bvh()) {
        let text = error.to_string();
        let lacks: Vec<_> = parts.iter().filter(|part| !text.contains(**part)).collect();
        if !lacks.is_empty() || text.len() > 400 {
            wrong.push(format!("{text:?} lacks {lacks:?}"));
        }
        kinds.insert(match &error {
            MotionError::Bvh { source, .. } => format!("bvh {:?}", discriminant(source)),
            MotionError::Array { source, .. } => format!("array {:?}", discriminant(source)),
            MotionError::Mcap { source, .. } => format!("mcap {:?}", discriminant(source)),
            MotionError::Mirror { source, .. } => format!("mirror {:?}", discriminant(source)),
            error => format!("{:?}", discriminant(error)),
        });
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // A row for each message. Four hand on another, and the text of the system is its own.
    let source = concat!(include_str!("../src/error.rs"), include_str!("../src/mirror.rs"));
    assert_eq!(kinds.len(), source.matches("#[error(").count() - 5, "a message without a row");
    assert_eq!("x".parse::<Up>(), Err("is y or z"));
}
