//! Where an installed program finds what a source tree has in the present folder.

use std::path::{Path, PathBuf};

/// Settings of a source tree, and those that the package installs.
const CONFIG: [&str; 2] = ["config/teleop.toml", "/etc/teleop/teleop.toml"];
/// Folder of an instance that was given none, and that of the systemd units.
const RUN_DIR: [&str; 2] = [crate::DEFAULT_RUN_DIR, "/run/teleop"];
/// Motions of a source tree, and those that the package installs.
const MOTIONS: [&str; 2] = ["tools/keyposes/motions", "/usr/share/teleopd/motions"];

/// The settings of an instance that was given none.
pub fn default_config() -> PathBuf {
    place_for(CONFIG)
}

/// The folder of an instance that was given none.
pub fn default_run_dir() -> PathBuf {
    place_for(RUN_DIR)
}

/// The library of motions with captions.
pub fn default_motions() -> PathBuf {
    place_for(MOTIONS)
}

/// Whether this program was installed for every user of the machine.
pub fn is_installed() -> bool {
    std::env::current_exe().is_ok_and(|program| lies_in_usr_bin(&program))
}

fn place_for([source, installed]: [&str; 2]) -> PathBuf {
    let installed = Path::new(installed);
    if is_installed() && installed.exists() { installed.to_owned() } else { source.into() }
}

/// /usr/bin and /usr/local/bin are such folders; a source tree below /usr/src has its programs in target/release.
fn lies_in_usr_bin(program: &Path) -> bool {
    program.starts_with("/usr") && program.parent().is_some_and(|folder| folder.ends_with("bin"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_programs_in_a_bin_folder_of_usr_are_installed() {
        for program in ["/usr/bin/teleopd", "/usr/local/bin/teleop-replay"] {
            assert!(lies_in_usr_bin(Path::new(program)), "{program}");
        }
        for program in ["/usr/src/teleopd/target/release/teleopd", "/home/anna/bin/teleopd", "/opt/usr/bin/teleopd"] {
            assert!(!lies_in_usr_bin(Path::new(program)), "{program}");
        }
    }

    #[test]
    fn program_of_a_source_tree_uses_the_present_folder() {
        assert_eq!(default_config(), Path::new("config/teleop.toml"));
        assert_eq!(default_run_dir(), Path::new("/tmp/teleopd"));
        assert_eq!(default_motions(), Path::new("tools/keyposes/motions"));
    }
}
