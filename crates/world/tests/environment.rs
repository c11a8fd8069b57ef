//! The settings that describe the obstacles. `torture` attacks a robot among them.

use crate::support::{loaded, write_settings};
use config::Overrides;

#[test]
fn obstacles_of_shipped_settings_change_hash() {
    assert_eq!(loaded().model.obstacles.iter().map(|o| &*o.name).collect::<Vec<_>>(), ["floor"]);
    let folder = tempfile::tempdir().expect("a folder");
    let with = |line: &str| {
        let path = write_settings(folder.path(), |text| text.replace("offset_m = 0.0", line));
        config::load(&path, Overrides::default())
    };
    let (same, lower) = (with("offset_m = 0.0").expect("loads"), with("offset_m = -0.01").expect("a lower floor"));
    assert_ne!(lower.hash, same.hash, "processes with different floors cannot engage");
    let higher = with("offset_m = 0.9").expect_err("a floor in the robot");
    assert!(higher.to_string().contains("environment `floor`"), "{higher}");
    let typo = with("offset_mm = 0.0").expect_err("an unknown key");
    assert!(typo.to_string().contains("offset_mm"), "{typo}");
}
