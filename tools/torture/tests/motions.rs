//! Plays motions of files through every stage.

use crate::root;
use client::PlayOptions;
use config::Overrides;
use motion::CalibrationMode;
use report::{cores, in_parallel};
use world::{Offline, OfflineEnd};

/// One file of this many is played here. `eval --following` plays all.
const EVERY: usize = 5;

#[test]
fn motions_of_files_cause_no_violation() {
    let folder = root().join("tools/replay/motions");
    let loaded = config::load(&root().join("config/teleop.toml"), Overrides::default()).unwrap();
    let files: Vec<_> = motion::motion_files(&folder).unwrap().into_iter().step_by(EVERY).collect();
    assert!(!files.is_empty());
    let play = |i: usize| {
        let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
        let mut offline = Offline::new(&loaded, &motion::load(&files[i]).unwrap(), options).unwrap();
        (offline.play(|_| ()), offline.report().clone())
    };
    for (end, report) in in_parallel(cores(), files.len(), play) {
        assert!(matches!(end, OfflineEnd::AtRest), "{end:?}");
        assert!(report.violations.values().all(|count| *count == 0), "{report:?}");
        let least_mm = loaded.model.d_min_m * 1e3 - 1e-6;
        assert!(report.rows > 3 * messages::TICK_HZ && report.min_clearance_mm >= least_mm, "{report:?}");
    }
}
