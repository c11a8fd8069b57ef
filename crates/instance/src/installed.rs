//! Default paths. An installed program has other ones than a source tree, whose paths start at the present folder.

use std::path::{Path, PathBuf};

/// Settings and motions of a source tree.
const CONFIG: &str = "config/teleop.toml";
const MOTIONS: &str = "tools/replay/motions";
/// Folder of the robots of a source tree.
const CONFIG_FOLDER: &str = "config";
/// The first robot, in that folder or in the data folder, and its weights, in the present folder or in the data folder.
const ROBOT: &str = "robots/tiago_dual.toml";
const WEIGHTS: &str = "weights/tiago_dual";
/// Settings that the package installs, and the run folder of its systemd units.
const PACKAGE_CONFIG: &str = "/etc/teleop/teleop.toml";
const PACKAGE_RUN_DIR: &str = "/run/teleop";
/// Data folder of a program in `bin`, relative to the folder above `bin`. The package and an unpacked archive both
/// have it.
const SHARE: &str = "share/teleopd";

/// Settings file of an instance without `--config`.
pub fn default_config() -> PathBuf {
    let of_package = is_installed().then(|| PACKAGE_CONFIG.into());
    let candidates = [of_package, share().map(|share| share.join("teleop.toml"))];
    first_there(candidates).unwrap_or_else(|| CONFIG.into())
}

/// Folder of an instance without `--run-dir`.
pub fn default_run_dir() -> PathBuf {
    first_there([is_installed().then(|| PACKAGE_RUN_DIR.into())]).unwrap_or_else(|| crate::DEFAULT_RUN_DIR.into())
}

/// Robot file and weights (without extension) of an instance whose program reads no settings. Other robots are beside them.
pub fn default_robot() -> [PathBuf; 2] {
    let share = first_there([share()]);
    let weights = share.clone().unwrap_or_default().join(WEIGHTS);
    [share.unwrap_or_else(|| CONFIG_FOLDER.into()).join(ROBOT), weights]
}

/// Folder of the motions with captions.
pub fn default_motions() -> PathBuf {
    first_there([share().map(|share| share.join("motions"))]).unwrap_or_else(|| MOTIONS.into())
}

/// Returns true if this program was installed for every user of the machine.
pub fn is_installed() -> bool {
    own_path().is_some_and(|program| lies_in_usr_bin(&program))
}

fn own_path() -> Option<PathBuf> {
    std::env::current_exe().ok()
}

fn share() -> Option<PathBuf> {
    share_of(&own_path()?)
}

fn share_of(program: &Path) -> Option<PathBuf> {
    let bin = program.parent().filter(|folder| folder.ends_with("bin"))?;
    Some(bin.parent()?.join(SHARE))
}

fn first_there<const N: usize>(candidates: [Option<PathBuf>; N]) -> Option<PathBuf> {
    candidates.into_iter().flatten().find(|path| path.exists())
}

/// Returns true for /usr/bin and /usr/local/bin. A source tree below /usr/src has its programs in target/release.
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
    fn program_in_bin_folder_uses_share_folder_beside_it() {
        assert_eq!(share_of(Path::new("/usr/bin/teleopd")), Some("/usr/share/teleopd".into()));
        assert_eq!(
            share_of(Path::new("/home/anna/teleopd/bin/teleop-say")),
            Some("/home/anna/teleopd/share/teleopd".into())
        );
        assert_eq!(share_of(Path::new("/home/anna/teleopd/target/release/teleopd")), None);
        let folder = tempfile::tempdir().expect("a folder");
        let (there, missing) = (folder.path().to_owned(), folder.path().join("missing"));
        assert_eq!(first_there([Some(missing.clone()), Some(there.clone())]), Some(there));
        assert_eq!(first_there([None, Some(missing)]), None);
    }

    #[test]
    fn program_of_source_tree_uses_current_folder() {
        assert_eq!(default_config(), Path::new("config/teleop.toml"));
        assert_eq!(default_run_dir(), Path::new("/tmp/teleopd"));
        assert_eq!(default_motions(), Path::new("tools/replay/motions"));
        assert_eq!(default_robot(), ["config/robots/tiago_dual.toml", "weights/tiago_dual"].map(PathBuf::from));
    }
}
