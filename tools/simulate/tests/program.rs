//! The program: what it prints.

use std::path::Path;
use std::process::Command;

fn simulate(arguments: &[&str]) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let output =
        Command::new(env!("CARGO_BIN_EXE_simulate")).current_dir(root).args(arguments).output().expect("it runs");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn replay_of_a_seed_executes_the_same_every_time() {
    let common = ["--ticks", "8250", "--fault", "frame-nan", "estop"];
    let first = simulate(&[&["--replay", "4"], &common[..]].concat());
    assert!(first.contains(" fired ") && first.contains("8250 ticks, "), "{first}");
    // What it prints first is the schedule, as --faults takes it.
    let (schedule, _) = first.split_once('\n').expect("lines");
    let again = simulate(&["--replay", "4", "--ticks", "8250", "--faults", schedule]);
    assert_eq!(again, first);
}
