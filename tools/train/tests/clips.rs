//! Checks how a folder of motion files is read.

use motion::{CalibrationMode, LoadOptions};
use train::clips::Clips;

fn folder_of(count: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for i in 0..count {
        std::fs::write(folder.path().join(format!("{i}.bvh")), "HIERARCHY\nnonsense").expect("a file can be written");
    }
    folder
}

#[test]
fn missing_clip_folder_is_refused_by_path() {
    let error =
        Clips::read(&["/nowhere/at/all"], CalibrationMode::Clip, &LoadOptions::default()).expect_err("is refused");
    assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
    assert_eq!(error.exit, rt::Exit::NoInput);
}

#[test]
fn folder_without_usable_clips_is_refused_with_every_file() {
    let folder = folder_of(4);
    let text = Clips::read(&[folder.path()], CalibrationMode::Clip, &LoadOptions::default())
        .expect_err("is refused")
        .to_string();
    assert!(text.contains("0 of 4 motion files are usable"), "{text}");
    assert!((0..4).all(|i| text.contains(&format!("{i}.bvh:"))), "{text}");
}

#[test]
fn clips_are_read_with_the_options_of_the_command() {
    let folder = folder_of(0);
    for name in ["a", "b", "c"] {
        motion::save_bvh(&motion::builtin(), &folder.path().join(format!("{name}.bvh"))).expect("written");
    }
    let load = LoadOptions { frame_rate_hz: Some(30.0), ..LoadOptions::default() };
    let clips = Clips::read(&[folder.path()], CalibrationMode::Rig, &load).expect("three clips");
    assert_eq!(clips.training.iter().map(|clip| clip.frame_rate_hz).collect::<Vec<_>>(), [30.0, 30.0]);
    let clips = Clips::read(&[folder.path(); 2], CalibrationMode::Rig, &load).expect("six clips");
    assert_eq!([clips.training.len(), clips.validation.len()], [5, 1], "a further folder trains");
    let load = LoadOptions { mirror: true, ..LoadOptions::default() };
    let text = Clips::read(&[folder.path()], CalibrationMode::Rig, &load).expect_err("no mirror image").to_string();
    assert!(text.contains("--mirror is given, but the body is not mirrored"), "{text}");
}
