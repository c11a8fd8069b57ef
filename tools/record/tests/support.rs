//! Helpers of several tests.

use client::PlayOptions;
use config::{Loaded, Overrides};
use motion::{CalibrationMode, Motion};
use record::{Content, OfflineRecording, Recorded};
use std::path::{Path, PathBuf};
use world::Offline;

/// The shipped settings.
pub fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml")
}

pub fn loaded() -> Loaded {
    let _ = rt::flush_denormals();
    config::load(&config(), Overrides::default()).expect("the shipped settings")
}

/// One second of the built-in motion.
fn short() -> Motion {
    let mut motion = motion::builtin();
    motion.frames = motion.frames.into_iter().skip(300).take(60).collect();
    motion
}

/// Records a run in virtual time to `path`. Returns its commands.
pub fn recorded_offline(path: &Path, loaded: &Loaded) -> Vec<messages::JointCommand> {
    let mut recording = OfflineRecording::create(path, loaded).expect("a file");
    let mut commands = Vec::new();
    let options = PlayOptions { speed: 1.0, looped: false, calibration: CalibrationMode::First10s };
    Offline::new(loaded, &short(), options).expect("a run").play(|tick| {
        recording.moment(tick.moment, tick.operator);
        commands.extend(tick.moment.control.and_then(|control| control.command));
    });
    recording.finish().expect("the end of the file");
    commands
}

/// Returns everything in a recording.
pub fn contents(path: &Path) -> (Vec<(u64, Content)>, Recorded) {
    let mut recorded = Recorded::open(path).expect("a recording");
    let mut all = Vec::new();
    while let Some(message) = recorded.next_message().expect("a message") {
        all.push(message);
    }
    (all, recorded)
}
