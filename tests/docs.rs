//! Runs every command of the documents in their order, as a reader types it. `commands` lists those that are not run.
//! Then the test checks that the program knows the options. Long commands get shorter inputs. Several readers share the
//! documents. The time of each command is printed.

use crate::commands::How::{Beside, Ends, Listed, Tested};
use crate::commands::{DEMO, OF_PROSE, OWN_FILES, blocks, how, is_ours, words};
use harness::within;
use std::collections::VecDeque;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Replacements for the reader's own paths. Demos are shorter, too.
const PLACEHOLDERS: [(&str, &str); 3] =
    [(" FOLDER", " {work}/clips"), (" OUT ", " {work}/trajectories "), (" --seconds 10", " --seconds 3")];
/// The clip of the folder.
const CLIP: &str = "clap.bvh";
/// Longest time of a command, and of waiting for its words. Only a hang comes near it.
const WITHIN: Duration = Duration::from_secs(300);

/// Runs of a demo at most. A machine that suspends the driver for long makes it latch a fault, and the robot stops.
const DEMO_RUNS: usize = 3;
const SUSPENDED: &str = "the robot was stopped; DriverFault";

/// Time that a reader takes to type a command.
const TYPED_IN: Duration = Duration::from_secs(1);

/// Programs and subcommands that only compute. They leave the cores to what moves a robot beside them.
const COMPUTING: [&str; 4] = ["collision", "eval", "batch", "keyposes"];

/// Chapters of each further reader. They need nothing that a chapter of another reader makes. The first reader has all
/// others.
const READERS: [&[&str]; 3] = [
    &["motion-files.md", "live-clients.md", "two-machines.md"],
    &["own-robot.md"],
    &["robots.md", "retargeting.md", "following.md", "real-time.md", "evidence.md"],
];

/// Commands that start a robot. Two cores hold one in time.
const MOVING: [&str; 2] = ["cargo run --release -- demo", "cargo run --release -- up"];

/// The right to run a robot. One reader has it.
static ROBOT: Mutex<()> = Mutex::new(());

struct Reader {
    /// Held while a robot runs.
    robot: Option<MutexGuard<'static, ()>>,
    work: tempfile::TempDir,
    /// Folder of further programs.
    path: PathBuf,
    repository: PathBuf,
    /// Running programs, and for how many blocks each continues.
    beside: VecDeque<(String, Child, usize)>,
    started: usize,
}

impl Reader {
    /// Creates a reader in a folder with the contents of a source tree, so that the tests write nothing to the tree.
    fn new() -> Self {
        let work = tempfile::tempdir().expect("a folder");
        let repository = harness::repository();
        for name in ["config", "docs", "tools", "weights"] {
            std::os::unix::fs::symlink(repository.join(name), work.path().join(name)).expect("a link");
        }
        // One clip of motion capture is enough for what evaluates a folder of them.
        let (clip, clips) = (repository.join("tools/replay/motions").join(CLIP), work.path().join("clips"));
        std::fs::create_dir(&clips).and_then(|()| std::fs::copy(clip, clips.join(CLIP))).expect("a copy");
        Self { robot: None, work, path: PathBuf::new(), repository, beside: VecDeque::new(), started: 0 }
    }

    fn fill(&self, text: &str) -> String {
        let text = text.replace("{repository}", self.repository.to_str().expect("UTF-8"));
        text.replace("{work}", self.work.path().to_str().expect("UTF-8"))
    }

    /// Runs `cargo` in the source tree. Everything is already built, so any compilation would be a repeated one.
    fn build(&self, selection: &[String]) {
        static BUILT: Mutex<Vec<Vec<String>>> = Mutex::new(Vec::new());
        // Cargo would wait for itself. What was fresh stays so.
        let mut built = BUILT.lock().expect("no reader failed");
        if built.iter().any(|known| known == selection) {
            return;
        }
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["build", "--release", "--locked", "--message-format=json"]).args(selection);
        // A reader's shell has none of these. A library's build script compiles again where they differ.
        let of_this_test = |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
        let names = std::env::vars_os().filter_map(|(name, _)| name.into_string().ok());
        names.filter(|name| of_this_test(name)).for_each(|name| _ = cargo.env_remove(name));
        let output = cargo.current_dir(&self.repository).stderr(Stdio::inherit()).output().expect("cargo runs");
        assert!(output.status.success(), "cargo build {selection:?}");
        let output_text = String::from_utf8_lossy(&output.stdout).into_owned();
        let compiled: Vec<_> = output_text.lines().filter(|line| line.contains("\"fresh\":false")).collect();
        let own = selection.iter().any(|word| word == "--workspace" || word == crate::supply::SMALL);
        assert!(own || compiled.is_empty(), "cargo build {selection:?} compiles again: {compiled:#?}");
        built.push(selection.to_vec());
    }

    /// Returns the program that a command runs, with its arguments.
    fn program(&self, command: &str) -> Option<Command> {
        if OWN_FILES.iter().any(|start| command.starts_with(start)) {
            // The folders of the tree are links here. Their copies must not be.
            let mut shell = Command::new("sh");
            shell.args(["-c", &command.replace("cp -r ", "cp -rL ")]).current_dir(self.work.path());
            return Some(shell);
        }
        let typed = words(command);
        let typed: Vec<&str> = typed.iter().map(String::as_str).collect();
        let (name, arguments) = match typed.as_slice() {
            ["cargo", "build", "--release", selection @ ..] => {
                self.build(&selection.iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
                return None;
            }
            ["cargo", "run", "--release", rest @ ..] => {
                let end = rest.iter().position(|&word| word == "--").unwrap_or(rest.len());
                let selection: Vec<String> = rest[..end].iter().map(|&word| word.to_owned()).collect();
                let name = selection.last().cloned().unwrap_or_else(|| "teleopd".into());
                let selection = if selection.is_empty() { vec!["--bin".into(), name.clone()] } else { selection };
                self.build(&selection);
                (name, rest.get(end + 1..).unwrap_or_default())
            }
            [path, rest @ ..] if is_ours(command) => (path.trim_start_matches("target/release/").to_owned(), rest),
            _ => panic!("{command}: no rule says how this is run"),
        };
        let path = self.repository.join("target/release").join(&name);
        let mut program = if [name.as_str()].iter().chain(arguments.first()).any(|name| COMPUTING.contains(name)) {
            let mut nice = Command::new("nice");
            nice.args(["-n", "10"]).arg(path);
            nice
        } else {
            Command::new(path)
        };
        let path = std::env::var("PATH").unwrap_or_default() + ":" + self.path.to_str().expect("UTF-8");
        program.args(arguments).current_dir(self.work.path()).stdin(Stdio::null()).env("PATH", path);
        Some(program)
    }

    fn run(&mut self, command: &str) {
        let filled = PLACEHOLDERS.iter().fold(command.to_owned(), |text, (from, to)| text.replace(from, to));
        let filled = self.fill(&filled);
        if self.robot.is_none() && MOVING.iter().any(|start| command.starts_with(start)) {
            self.robot = Some(ROBOT.lock().unwrap_or_else(PoisonError::into_inner));
        }
        let begun = Instant::now();
        self.run_filled(command, &filled);
        self.leave_robot();
        println!("{:6.1} s  $ {filled}", begun.elapsed().as_secs_f64());
    }

    /// Lets another reader run a robot, if none of this reader's programs may be one.
    fn leave_robot(&mut self) {
        if self.beside.is_empty() {
            self.robot = None;
        }
    }

    fn run_filled(&mut self, command: &str, filled: &str) {
        match how(command) {
            Tested(file) => println!("  not run here: {file} runs it"),
            Listed(why, day) => {
                println!("  not run, because it {why}. It last ran on {day}");
                if is_ours(command) {
                    self.look_up(command);
                }
            }
            Ends(codes, more) => {
                let (mut code, mut output) = (None, String::new());
                for _ in 0..if *codes == *DEMO { DEMO_RUNS } else { 1 } {
                    let Some(program) = self.program(filled) else { return };
                    (code, output) = self.end(command, program, &more);
                    if !output.contains(SUSPENDED) {
                        break;
                    }
                    println!("  again: this machine suspended the driver");
                }
                assert!(code.is_some_and(|code| codes.contains(&code)), "{command}: {code:?}\n{output}");
            }
            Beside(mark, blocks, more) => {
                let mut program = self.program(filled).expect("a program");
                program.args(words(&self.fill(&more)));
                let (mut child, log) = self.start(program);
                let mut ended = None;
                let printed = within(WITHIN, || {
                    ended = child.try_wait().expect("it can be waited for");
                    ended.is_some() || read(&log).contains(&mark)
                });
                assert!(printed && ended.is_none(), "{command}: {ended:?}\n{}", read(&log));
                self.beside.push_front((command.to_owned(), child, blocks));
                // No reader types the next command sooner, and nothing engages before half a second of skeletons.
                std::thread::sleep(TYPED_IN);
            }
        }
    }

    /// Runs a program to its end, with more options. Returns its exit code and what it printed.
    fn end(&mut self, command: &str, mut program: Command, more: &str) -> (Option<i32>, String) {
        program.args(words(&self.fill(more)));
        let (mut child, log) = self.start(program);
        let mut status = None;
        let ended = within(WITHIN, || {
            status = child.try_wait().expect("it can be waited for");
            status.is_some()
        });
        assert!(ended, "{command} goes on: {}", read(&log));
        (status.expect("an end").code(), read(&log))
    }

    fn start(&mut self, mut program: Command) -> (Child, PathBuf) {
        self.started += 1;
        let log = self.work.path().join(format!("{}.log", self.started));
        let file = File::create(&log).expect("a file");
        let child = program.stdout(file.try_clone().expect("a file")).stderr(file).spawn();
        (child.unwrap_or_else(|error| panic!("{program:?}: {error}")), log)
    }

    fn look_up(&self, command: &str) {
        let typed = words(command);
        let options = typed.iter().skip_while(|word| *word != "--").skip(1).filter(|word| word.starts_with("--"));
        let mut program = self.program(command).expect("a program of ours");
        let Output { stdout, .. } = program.arg("--help").output().expect("it runs");
        let help = String::from_utf8_lossy(&stdout).into_owned();
        for option in options {
            assert!(
                help.contains(&format!("{option} ")) || help.contains(&format!("{option}\n")),
                "{command}: {option}\n{help}"
            );
        }
    }

    /// Ends the programs that have run for their number of blocks, the newest first.
    fn end_block(&mut self) {
        for (_, _, blocks) in &mut self.beside {
            *blocks -= 1;
        }
        let (ending, going): (Vec<_>, Vec<_>) = self.beside.drain(..).partition(|(_, _, blocks)| *blocks == 0);
        self.beside = going.into();
        for (command, mut child, _) in ending {
            harness::interrupt(&child);
            let code = child.wait().expect("it ends").code();
            assert!(matches!(code, Some(0 | 130)), "{command}: {code:?}");
            // A client gets no lease within a second of another's end.
            std::thread::sleep(Duration::from_millis(1500));
        }
        self.leave_robot();
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        for (_, child, _) in &mut self.beside {
            let _ = Command::new("kill").args(["-s", "INT", &child.id().to_string()]).status();
            let _ = child.wait();
        }
    }
}

fn read(log: &Path) -> String {
    std::fs::read_to_string(log).unwrap_or_default()
}

/// Returns the book's chapters, in order.
fn chapters() -> Vec<PathBuf> {
    let folder = harness::repository().join("docs/src");
    let links = links(&read(&folder.join("SUMMARY.md")));
    links.into_iter().map(|link| folder.join(link)).collect()
}

/// Returns the targets of a document's links and pictures, except web addresses.
fn links(document: &str) -> Vec<String> {
    let prose: String = document.split("\n```").step_by(2).collect();
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    targets.filter(|target| !target.contains("://")).map(str::to_owned).collect()
}

/// Returns a document, or the one that it includes as a whole.
fn whole(path: &Path) -> String {
    let text = read(path);
    let included = text.strip_prefix("{{#include ").and_then(|rest| rest.trim_end().strip_suffix("}}"));
    included.map_or(text.clone(), |name| read(&path.with_file_name("").join(name)))
}

/// Returns the anchors of a document's headings, as a browser finds them.
fn anchors(document: &str) -> Vec<String> {
    let headings = document.lines().filter_map(|line| line.strip_prefix('#'));
    let kept = |c: &char| c.is_alphanumeric() || "-_ ".contains(*c);
    headings
        .map(|text| text.trim_start_matches('#').trim().to_lowercase().chars().filter(kept).collect::<String>())
        .map(|text| text.replace(' ', "-"))
        .collect()
}

#[test]
fn links_of_the_documents_lead_to_files_and_headings() {
    let root = harness::repository();
    let own = ["README.md", "SAFETY.md", "SECURITY.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "docs/src/SUMMARY.md"];
    let mut count = 0;
    for document in own.iter().map(|name| root.join(name)).chain(chapters()) {
        for link in links(&read(&document)) {
            let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
            let to = if file.is_empty() { document.clone() } else { document.with_file_name("").join(file) };
            assert!(to.exists(), "{}: {link} leads nowhere", document.display());
            let found = anchor.is_empty() || anchors(&whole(&to)).iter().any(|name| name == anchor);
            assert!(found, "{}: {link} names no heading", document.display());
            count += 1;
        }
    }
    assert!(count > 30, "{count} links");
}

#[test]
fn book_lists_every_chapter_and_first_pages_stay_short() {
    let folder = harness::repository().join("docs/src");
    let listed = chapters();
    for entry in std::fs::read_dir(&folder).expect("docs/src") {
        let path = entry.expect("an entry").path();
        let is_chapter = path.extension().is_some_and(|ending| ending == "md") && !path.ends_with("SUMMARY.md");
        assert!(!is_chapter || listed.contains(&path), "{} stands in no table of contents", path.display());
    }
    for (name, most) in [("README.md", 700), ("SAFETY.md", 3000)] {
        let words = read(&harness::repository().join(name)).split_whitespace().count();
        assert!(words <= most, "{name} has {words} words, at most {most}");
    }
}

/// Returns the numbers of a text, without the marks that end a sentence.
fn numbers(text: &str) -> Vec<&str> {
    let words = text.split(|c: char| !(c.is_ascii_digit() || ".,".contains(c)));
    words.map(|word| word.trim_matches(['.', ','])).filter(|word| !word.is_empty()).collect()
}

#[test]
fn figures_of_readme_stand_in_their_results() {
    let root = harness::repository();
    let readme = read(&root.join("README.md"));
    let (_, rest) = readme.split_once("\n## Measured\n").expect("measured figures");
    let rows: Vec<_> = rest.split("\n## ").next().unwrap_or("").lines().filter(|line| line.starts_with('|')).collect();
    assert!(rows.len() >= 8, "{rows:#?}");
    for row in &rows[2..] {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let [_, _, figure, command, run, _] = cells[..] else { panic!("{row}") };
        let (when, result) = run.trim_matches(['[', ')']).split_once("](").expect("a linked result");
        let text = read(&root.join(result));
        let (date, commit) = when.split_once(", ").expect("date, commit");
        let command = format!("- command: `cargo run --release -p {}`", command.trim_matches('`'));
        for line in [command, format!("- date: {date}"), format!("- commit: {commit}")] {
            assert!(text.lines().any(|own| own == line), "{result} lacks {line:?}");
        }
        let (_, measured) = text.split_once("\n\n").and_then(|(_, rest)| rest.split_once("\n\n")).expect("figures");
        let wanted = numbers(figure);
        let lacks: Vec<_> = wanted.iter().filter(|&number| !numbers(measured).contains(number)).collect();
        assert!(!wanted.is_empty() && lacks.is_empty(), "{result} lacks {lacks:?} of {figure:?}");
    }
}

#[test]
fn every_result_names_its_command_date_commit_and_machine() {
    let results = std::fs::read_dir(harness::repository().join("docs/results")).expect("results").flatten();
    for path in results.map(|entry| entry.path()) {
        let text = read(&path);
        for key in ["command: `", "date: 20", "commit: ", "machine: "] {
            assert!(text.contains(&format!("\n- {key}")), "{} lacks {key}", path.display());
        }
    }
}

#[test]
fn every_command_of_the_documents_runs_in_order() {
    let reader = Reader::new();
    reader.build(&["--workspace".to_owned()]);
    let mut seen = Vec::new();
    let mut of_readers: [Vec<Vec<String>>; READERS.len() + 1] = Default::default();
    for document in std::iter::once(harness::repository().join("README.md")).chain(chapters()) {
        let reader = READERS.iter().position(|chapters| chapters.iter().any(|name| document.ends_with(name)));
        for mut commands in blocks(&read(&document)) {
            // Commands that were run before are not run again. Another test runs those on a xacro.
            commands.retain(|command| !seen.contains(command) && !command.contains("ur5e_duo"));
            seen.extend(commands.iter().cloned());
            of_readers[reader.map_or(0, |at| at + 1)].push(commands);
        }
    }
    of_readers[0].extend(OF_PROSE.map(|command| vec![command.to_owned()]));
    std::thread::scope(|scope| {
        for blocks in of_readers {
            scope.spawn(|| {
                let mut reader = Reader::new();
                for commands in blocks {
                    commands.iter().for_each(|command| reader.run(command));
                    reader.end_block();
                }
            });
        }
    });
}

/// Returns the folder of a program that expands a xacro. Prints the reason if there is none.
fn expander_or_skip() -> Option<PathBuf> {
    let python = harness::python(&Path::new(env!("CARGO_TARGET_TMPDIR")).join("xacrodoc"), &["xacrodoc"]);
    python.map_err(|why| println!("skipped: no program expands a xacro: {why}")).ok()?.parent().map(Path::to_path_buf)
}

#[test]
fn xacro_is_refused_without_an_expander_and_with_the_words_of_the_expander() {
    let folder = tempfile::tempdir().expect("a folder");
    let refuses = |path: &Path, text: &str, code, part: &str| {
        let file = folder.path().join("bad.xacro");
        std::fs::write(&file, text).expect("a file");
        let mut new = Command::new(env!("CARGO_BIN_EXE_teleopd"));
        new.args(["robot", "new", "--xacro", "name:=a; $HOME"]).arg(file).env("PATH", path);
        harness::assert_ends(&mut new, code, &[part]);
    };
    refuses(folder.path(), "", 69, "bad.xacro: no program on PATH expands a xacro: `pip install xacrodoc` gets one");
    let Some(path) = expander_or_skip() else { return };
    let link = "<robot xmlns:xacro='http://ros.org/xacro'>\n<link name='$(arg name)'/>";
    refuses(&path, link, 65, "bad.xacro: error: Error: no element found: line 2, column 26");
    // It expands, into a URDF without arms. No shell reads the argument.
    refuses(&path, &format!("{link}<link name='b'/></robot>"), 65, "bad.urdf: roots: a; $HOME, b, exactly one");
}

#[test]
fn ur5e_pair_follows_a_person_from_its_xacro_on() {
    let Some(path) = expander_or_skip() else { return };
    let blocks = blocks(&read(&harness::repository().join("docs/src/own-robot.md")));
    let mut reader = Reader::new();
    reader.path = path;
    reader.build(&["--workspace".to_owned()]);
    let block = blocks.iter().find(|block| block.concat().contains("ur5e_duo")).expect("the pair's commands");
    block.iter().for_each(|command| reader.run(command));
    let report: serde_json::Value = serde_json::from_str(&read(&reader.work.path().join("report.json"))).expect("JSON");
    // A robot whose certificate keeps it at home is 20 degrees off, and breaks no limit. The doctor allows 10.
    let off_deg = report["limb_error_deg"]["measured"]["mean"].as_f64();
    assert!(off_deg.is_some_and(|off_deg| off_deg < 10.0), "{report:#}");
}
