//! Links to the program, with the names that its subcommands had as programs of their own.

use std::path::Path;
use std::process::Command;

/// Runs a symbolic or a hard link to the program.
fn run_link(name: &str, symbolic: bool, argument: &str) -> String {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    let (program, link) = (Path::new(env!("CARGO_BIN_EXE_replay")), folder.path().join(name));
    let made = if symbolic { std::os::unix::fs::symlink(program, &link) } else { std::fs::hard_link(program, &link) };
    made.expect("a link");
    let output = Command::new(&link).arg(argument).output().expect("it runs");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn link_with_a_former_name_is_that_program() {
    for name in ["batch", "keyposes", "say", "replay"] {
        for link in [name.to_owned(), format!("teleop-{name}")] {
            for symbolic in [true, false] {
                let version = run_link(&link, symbolic, "--version");
                assert_eq!(version, format!("{name} {}\n", env!("CARGO_PKG_VERSION")), "{link}");
                assert!(run_link(&link, symbolic, "--help").contains(&format!("Usage: {link} ")), "{link}");
            }
        }
    }
}
