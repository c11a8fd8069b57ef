//! Recordings that another program copied, and damaged ones: no difference that is none, and no loss without a word.

use crate::support::{loaded, recorded_offline};
use config::Loaded;
use motion::Motion;
use record::{Compared, Recorded, Summary};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Result of all readers of a recording.
#[derive(Debug, PartialEq)]
struct Reading {
    compared: Compared,
    summary: String,
    plot: Vec<u8>,
    motion: Motion,
}

fn result(path: &Path, loaded: &Loaded) -> Reading {
    let mut motion = motion::load(path).expect("a motion");
    motion.name.clear();
    let summary = summary(path, loaded);
    let picture = path.with_extension("png");
    record::plot(&picture, &summary.trace, &loaded.model, "a recording").expect("a picture");
    let plot = std::fs::read(&picture).expect("a picture");
    Reading { compared: compared(path, loaded), summary: summary.text(), plot, motion }
}

fn compared(path: &Path, loaded: &Loaded) -> Compared {
    record::compare(path, loaded).expect("a comparison")
}

fn summary(path: &Path, loaded: &Loaded) -> Summary {
    let recorded = Recorded::open(path).expect("a recording");
    Summary::read(recorded, &robot::Names::from_model(&loaded.model)).expect("a summary")
}

fn has_difference(found: &Compared) -> bool {
    [found.targets, found.commands, found.statuses].iter().any(|counts| counts.different > 0)
}

/// Installs pymcap-cli. `None` without Python or PyPI.
fn pymcap(folder: &Path) -> Option<PathBuf> {
    let (venv, bin) = (folder.join("venv"), folder.join("venv/bin"));
    let run = |command: &mut Command| command.status().is_ok_and(|status| status.success());
    let pip = ["install", "--quiet", "--disable-pip-version-check", "--timeout", "10", "--retries", "1"];
    let there = run(Command::new("python3").args(["-m", "venv"]).arg(&venv))
        && run(Command::new(bin.join("pip")).args(pip).arg("pymcap-cli==0.34.0"));
    there.then(|| bin.join("pymcap-cli"))
}

#[test]
#[ignore = "installs pymcap-cli from PyPI; .ci/long runs it"]
fn pymcap_cli_copies_give_the_same_result() {
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = pymcap(folder.path()) else {
        return println!("skipped: no Python with a registry to install pymcap-cli 0.34.0 from");
    };
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    recorded_offline(&path, &loaded);
    let expected = result(&path, &loaded);
    assert!(expected.compared.equal(), "{:?}", expected.compared);
    let run = |arguments: &str| {
        let done = Command::new(&program).current_dir(&folder).args(arguments.split(' ')).output().expect("it runs");
        assert!(done.status.success(), "{arguments}: {}", String::from_utf8_lossy(&done.stderr));
    };
    run("split run.mcap --duration 1.4s -t part{index}.mcap");
    run("split run.mcap --duration 2s -t piece{index}.mcap");
    let parts = |name: &str| {
        let exists = |file: &String| folder.path().join(file).exists();
        (0..).map(|number| format!("{name}{number}.mcap")).take_while(exists).collect::<Vec<_>>()
    };
    let (parts, pieces) = (parts("part"), parts("piece"));
    assert!(parts.len() > 3 && pieces.len() > 1, "{parts:?} {pieces:?}");
    let (whole, most) = (parts.join(" "), parts[..parts.len() - 1].join(" "));
    for (number, arguments) in [
        "filter run.mcap --compression lz4 --no-crc",
        "filter run.mcap --no-chunks",
        "filter run.mcap --order topic",
        "sort run.mcap",
        "sort run.mcap --order topic --chunk-size 65536",
        &format!("merge {whole}"),
        &format!("merge {} {whole} {most}", pieces.join(" ")),
        "rechunk run.mcap",
        "rechunk run.mcap --strategy none --compression none",
        "compress run.mcap --compression lz4",
        "recover run.mcap",
    ]
    .into_iter()
    .enumerate()
    {
        let name = format!("copy{number}.mcap");
        run(&format!("{arguments} -o {name}"));
        let found = result(&folder.path().join(name), &loaded);
        assert_eq!(found.summary, expected.summary, "{arguments}");
        assert_eq!(found.compared, expected.compared, "{arguments}");
        assert!(found == expected, "{arguments}: the picture or the motion");
    }
    // A copy without a part is not equal, and nothing in it counts as different.
    for left_out in ["skeleton", "joint_target", "joint_command", "robot_state", "status_raw", "inputs"] {
        run(&format!("filter run.mcap -f -o less.mcap -x /teleop/{left_out}"));
        let found = compared(&folder.path().join("less.mcap"), &loaded);
        assert!(!found.equal() && !has_difference(&found), "{left_out}: {found:?}");
    }
    run(&format!("merge {most} -o most.mcap"));
    for (name, flaw) in
        [("part1.mcap", "it begins at tick "), ("most.mcap", "messages that were recorded are not in it")]
    {
        let found = compared(&folder.path().join(name), &loaded);
        assert!(!found.equal() && !has_difference(&found), "{name}: {found:?}");
        assert!(found.flaws[0].contains(flaw), "{found:?}");
    }
}

#[test]
fn what_is_whole_is_read_past_damage_and_the_loss_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    recorded_offline(&path, &loaded);
    let (whole, other) = (std::fs::read(&path).unwrap(), folder.path().join("other.mcap"));
    let all: u64 = summary(&path, &loaded).counts.values().sum();
    let frames = motion::load(&path).unwrap().frames.len();
    let read = |bytes: &[u8]| {
        std::fs::write(&other, bytes).unwrap();
        let summary = summary(&other, &loaded);
        (summary.counts.values().sum::<u64>(), summary.broken_off().map(str::to_owned))
    };
    let indices = mcap::Summary::read(&whole).unwrap().expect("a summary").chunk_indexes;
    assert!(indices.len() > 4, "{} chunks", indices.len());
    let middle = &indices[indices.len() / 2];
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at..at + 300].iter_mut().for_each(|byte| *byte ^= 0xff);
        bytes
    };
    let (begin, length) = (middle.chunk_start_offset as usize, middle.chunk_length as usize);
    // Its records, its head, the border to the index behind it, and that index.
    for (at, lost) in [(begin + length / 2, true), (begin, true), (begin + length - 10, true), (begin + length, false)]
    {
        let (count, why) = read(&flipped(at));
        let why = why.expect("the loss is named");
        assert!(count >= all / 2 && (count < all) == lost, "{count} of {all}: {why}");
        let expected = format!("{} of {all} messages are lost", all - count);
        assert_eq!(why.contains(&expected), lost, "{why}");
        assert!(why.contains("damaged"), "{why}");
        let motion = motion::load(&other).expect("a motion");
        assert!(motion.frames.len() >= frames / 4, "{} of {frames}", motion.frames.len());
        assert_eq!(motion.guesses.lost, Some(why));
    }
    read(&flipped(begin + length / 2));
    let found = compared(&other, &loaded);
    assert!(!found.equal() && !has_difference(&found), "{found:?}");
    assert!(found.flaws.iter().any(|flaw| flaw.starts_with("the file is damaged or truncated")), "{found:?}");
    let printed = Command::new(env!("CARGO_BIN_EXE_record")).arg("--summary").arg(&other).output().unwrap();
    assert_eq!(printed.status.code(), Some(65), "{printed:?}");
    let printed = String::from_utf8_lossy(&printed.stderr);
    assert!(printed.contains("other.mcap is damaged or truncated: the chunk at byte"), "{printed}");
    let mut before = 0;
    for n in 1..20 {
        let (count, why) = read(&whole[..whole.len() * n / 20]);
        assert!(count >= before, "{count} after {before}");
        let why = why.expect("the cut is named");
        assert!(why.contains("there is no end"), "{why}");
        before = count;
    }
    assert!(before > all / 2, "{before} of {all}");
    assert_eq!(read(&whole), (all, None));
}

/// One bit of the size to which a chunk claims to unpack.
#[test]
fn flipped_bit_in_a_chunks_size_loses_that_chunk_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (path, loaded) = (folder.path().join("run.mcap"), loaded());
    recorded_offline(&path, &loaded);
    let all: u64 = summary(&path, &loaded).counts.values().sum();
    let mut bytes = std::fs::read(&path).unwrap();
    let indices = mcap::Summary::read(&bytes).unwrap().expect("a summary").chunk_indexes;
    let middle = &indices[indices.len() / 2];
    // Behind opcode, length and two times: bit 40.
    bytes[middle.chunk_start_offset as usize + 9 + 16 + 5] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let found = summary(&path, &loaded);
    let (count, why) = (found.counts.values().sum::<u64>(), found.broken_off().expect("the loss is named").to_owned());
    assert!(count < all && count >= all / 2, "{count} of {all}: {why}");
    let place = format!("the chunk at byte {} claims to unpack to 10995", middle.chunk_start_offset);
    assert!(why.contains(&place) && why.contains(&format!("{} of {all} messages are lost", all - count)), "{why}");
}
