//! `eval --refusals`: normal human motion is rejected at no rate.

use config::Overrides;
use eval::refusals::count;
use motion::{CalibrationMode, Motion, builtin};
use std::path::Path;

fn config() -> ingest::Config {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/teleop.toml");
    let loaded = config::load(&path, Overrides::default()).expect("the settings of the repository");
    world::input_config(&loaded.settings.ingest, loaded.layouts, &loaded.operators, loaded.lifter)
}

/// Returns the built-in motion, `times` as fast.
fn faster(times: f64) -> Motion {
    let mut motion = builtin();
    motion.frame_rate_hz *= times;
    motion
}

#[test]
fn built_in_motion_is_accepted_at_every_rate() {
    let config = config();
    for rate_hz in [20.0, 30.0, 60.0, 120.0] {
        for times in [1.0, 2.0] {
            let found = count(&config, &faster(times), CalibrationMode::First10s, rate_hz);
            let seconds = builtin().duration_s() / times;
            assert!((found.frames as f64 - seconds * rate_hz).abs() < 0.05 * rate_hz + 2.0, "{found:?}");
            assert_eq!((found.dropped, found.arm_left_out, found.strangers), (0, 0, 0), "{rate_hz} Hz: {found:?}");
        }
    }
    // Impossible motion is rejected, if the frames are close enough to show it.
    for rate_hz in [60.0, 120.0] {
        let found = count(&config, &faster(20.0), CalibrationMode::First10s, rate_hz);
        assert!(found.dropped + found.arm_left_out > 0, "{rate_hz} Hz: {found:?}");
    }
}
