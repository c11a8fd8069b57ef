//! The names of the robot's parts in the folder of an instance. `control` writes them, for clients that receive only
//! indices.

use robot::Names;
use std::path::Path;

/// File in the instance's folder.
const FILE: &str = "names.json";

/// Longest file that is read: 128 capsules and obstacles and 24 joints have names of a few dozen bytes.
const BYTES_MAX: u64 = 1 << 16;

/// Writes the names into the folder of an instance.
pub fn write_names(run_dir: &Path, names: &Names) -> std::io::Result<()> {
    crate::write_anew(&run_dir.join(FILE), &serde_json::to_vec_pretty(names)?)
}

/// Reads the names that the instance's `control` wrote. Empty if there are none, and then clients show indices.
pub fn read_names(run_dir: &Path) -> Names {
    let path = run_dir.join(FILE);
    let small = std::fs::metadata(&path).is_ok_and(|file| file.is_file() && file.len() <= BYTES_MAX);
    let bytes = if small { std::fs::read(&path).unwrap_or_default() } else { Vec::new() };
    serde_json::from_slice(&bytes).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
    const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");

    #[test]
    fn names_file_is_read_back_and_indices_replace_a_missing_one() {
        let folder = tempfile::tempdir().unwrap();
        let nobody = read_names(folder.path());
        assert_eq!((nobody.joint(3), nobody.pair([1, 9])), ("joint 3".into(), "part 1 and part 9".into()));
        let model = robot::Model::from_text("robot.toml", TOML, "robot.urdf", URDF).expect("the shipped robot");
        let names = Names::from_model(&model);
        write_names(folder.path(), &names).unwrap();
        let read = read_names(folder.path());
        assert_eq!(read, names);
        assert_eq!((read.joint(0), read.unit(0)), ("torso_lift_joint".into(), "m"));
        assert!(read.pair([0, 1]).contains(&model.capsules[1].name));
        std::fs::write(folder.path().join(FILE), "{").unwrap();
        assert_eq!(read_names(folder.path()), nobody);
    }
}
