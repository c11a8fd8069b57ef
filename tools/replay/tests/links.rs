//! Links to the program, with the names that its subcommands had as programs of their own.

use std::path::Path;
use std::process::{Command, Output};

/// The tree, whose settings are the default.
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Runs a symbolic or a hard link to the program.
fn run_link(name: &str, symbolic: bool, arguments: &[&str]) -> Output {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    let (program, link) = (Path::new(env!("CARGO_BIN_EXE_replay")), folder.path().join(name));
    let made = if symbolic { std::os::unix::fs::symlink(program, &link) } else { std::fs::hard_link(program, &link) };
    made.expect("a link");
    Command::new(&link).args(arguments).current_dir(ROOT).output().expect("it runs")
}

#[test]
fn link_with_a_former_name_is_that_program() {
    for name in ["batch", "keyposes", "say", "replay"] {
        for link in [name.to_owned(), format!("teleop-{name}")] {
            for symbolic in [true, false] {
                let version = run_link(&link, symbolic, &["--version"]).stdout;
                let expected = format!("{name} {}\n", env!("CARGO_PKG_VERSION"));
                assert_eq!(String::from_utf8_lossy(&version), expected, "{link}");
                let help = run_link(&link, symbolic, &["--help"]).stdout;
                assert!(String::from_utf8_lossy(&help).contains(&format!("Usage: {link} ")), "{link}");
            }
        }
    }
}

#[test]
fn link_refuses_like_the_subcommand() {
    for (name, arguments, code) in [
        ("batch", ["--input", "/nowhere", "--out", "/nowhere/out", "--method", "closed-form"].as_slice(), 66),
        ("keyposes", &["interpolate", "t-pose", "headstand", "--seconds", "1"], 64),
        ("say", &["wave", "--library", "/nowhere"], 66),
        ("say", &["wave", "--top", "0"], 2),
    ] {
        let linked = run_link(name, true, arguments);
        let subcommand = Command::new(env!("CARGO_BIN_EXE_replay"))
            .arg(name)
            .args(arguments)
            .current_dir(ROOT)
            .output()
            .expect("runs");
        assert_eq!(linked.status.code(), Some(code), "{name}: {linked:?}");
        assert_eq!(subcommand.status.code(), Some(code), "{name}: {subcommand:?}");
        assert_eq!(linked.stdout, subcommand.stdout, "{name}");
        assert_eq!(linked.stderr, subcommand.stderr, "{name}");
    }
}
