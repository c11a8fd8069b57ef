//! Plays motions of files through every stage.

use crate::root;
use config::Overrides;
use report::{cores, in_parallel};
use torture::motions::play;

/// One file of this many is played here. The command plays all.
const EVERY: usize = 5;

#[test]
fn motions_of_files_cause_no_violation() {
    let folder = root().join("tools/replay/motions");
    let loaded = config::load(&root().join("config/teleop.toml"), Overrides::default()).unwrap();
    let files: Vec<_> = motion::motion_files(&folder).unwrap().into_iter().step_by(EVERY).collect();
    assert!(!files.is_empty());
    for played in in_parallel(cores(), files.len(), |i| play(&loaded, &files[i])) {
        assert_eq!(played.violations_total(), 0, "{played:?}");
        assert_eq!(played.failed, None, "{played:?}");
        let least_mm = loaded.model.d_min_m * 1e3 - 1e-6;
        assert!(played.duration_s() > 3.0 && played.report.min_clearance_mm >= least_mm, "{played:?}");
    }
}
