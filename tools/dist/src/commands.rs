//! Man pages and completions, from the definitions with which the programs parse their arguments.

use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate_to};
use std::path::Path;

#[path = "../../../crates/teleopctl/cli.rs"]
#[allow(dead_code)]
mod teleopctl;
#[path = "../../../crates/teleopd/cli.rs"]
#[allow(dead_code)]
mod teleopd;

/// Returns every program of the package under its installed name. In /usr/bin the names `replay` and `latency`
/// alone would be too general.
pub fn programs() -> [Command; 10] {
    [
        teleopd::Cli::command(),
        teleopctl::Cli::command(),
        replay::cli::Cli::command().name("teleop-replay"),
        latency::cli::Cli::command().name("teleop-latency"),
        record::cli::Cli::command().name("teleop-record"),
        replay::batch::Cli::command().name("teleop-batch"),
        replay::keyposes::Cli::command().name("teleop-keyposes"),
        replay::say::Cli::command().name("teleop-say"),
        bridge::cli::Cli::command().name("teleop-bridge"),
        ros2::cli::Cli::command(),
    ]
}

/// Writes `man/*.1` and `completions/{bash,zsh,fish}/*`.
pub fn write(out: &Path) -> Result<(), String> {
    let failed = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
    let man = out.join("man");
    std::fs::create_dir_all(&man).map_err(|error| failed(&man, error))?;
    for command in programs() {
        clap_mangen::generate_to(command, &man).map_err(|error| failed(&man, error))?;
    }
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
        let folder = out.join("completions").join(shell.to_string());
        std::fs::create_dir_all(&folder).map_err(|error| failed(&folder, error))?;
        for mut command in programs() {
            let name = command.get_name().to_owned();
            generate_to(shell, &mut command, name, &folder).map_err(|error| failed(&folder, error))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_program_has_a_man_page_that_names_all_options() {
        let out = tempfile::tempdir().expect("a folder");
        write(out.path()).expect("pages");
        for command in programs() {
            let name = command.get_name();
            let page = std::fs::read_to_string(out.path().join(format!("man/{name}.1"))).expect("a page");
            for argument in command.get_arguments().filter_map(clap::Arg::get_long) {
                let named = page.replace('\\', "").contains(&format!("--{argument}"));
                assert!(named, "{name}.1 does not name --{argument}");
            }
            for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
                let page = out.path().join(format!("man/{name}-{}.1", below.get_name()));
                assert!(page.exists(), "{} is missing", page.display());
            }
            for file in [format!("bash/{name}.bash"), format!("zsh/_{name}"), format!("fish/{name}.fish")] {
                let text = std::fs::read_to_string(out.path().join("completions").join(&file)).expect("a completion");
                assert!(text.contains(name), "{file}");
            }
        }
    }
}
