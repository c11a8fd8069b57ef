//! `teleop.toml`: any text, and changes of the shipped one.

use crate::bytes::Bytes;
use crate::robots::MODEL;
use config::{Loaded, SafetySettings, Settings};

pub(crate) const TEXT: &str = include_str!("../../../config/teleop.toml");

/// Runs the input. The first byte selects the meaning of the others: the text, or changes of the shipped text.
/// Each change is (length, place, number of bytes removed, bytes inserted).
pub(crate) fn run(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    let text = if kind == 0 { String::from_utf8_lossy(rest).into_owned() } else { changed(rest) };
    let settings = match Settings::parse("teleop.toml", &text) {
        Ok(settings) => settings,
        Err(error) => {
            assert!(error.to_string().contains("teleop.toml"), "names no file: {error}");
            return;
        }
    };
    let again = toml::to_string(&settings).expect("what was read can be written");
    assert_eq!(Settings::parse("teleop.toml", &again).expect("and read again"), settings);
    bounded(&settings);
    let Ok(model) = MODEL.clone().with_environment("teleop.toml", &settings.environment) else { return };
    let loaded = Loaded {
        settings,
        model,
        weights: None,
        prediction: None,
        lifter: None,
        layouts: layouts::Layouts::default(),
        operators: config::Operators::default(),
        operators_dir: std::path::PathBuf::new(),
        hash: 1,
        files: Vec::new(),
    };
    // The parts may reject or accept the settings, but must not panic.
    let _ = world::retarget_config(&loaded);
    let _ = world::simulated_config(&loaded, false);
    if world::control_config(&loaded, true).is_ok() {
        ceilings(&loaded.settings.safety);
    }
}

/// Invariants of all settings that are read.
fn bounded(settings: &Settings) {
    let (ingest, control, driver) = (&settings.ingest, &settings.control, &settings.driver);
    assert!((100.0..=60_000.0).contains(&ingest.authority_timeout_ms), "{ingest:?}");
    assert!(0.0 <= control.grace_us && control.grace_us <= driver.grace_us && driver.grace_us <= 660.0, "{driver:?}");
    assert!((0.0..=250.0).contains(&settings.retarget.following_delay_ms), "{:?}", settings.retarget);
    assert!(driver.silence_latch_ms > 0.0 && driver.silence_latch_ms <= 10.0, "{driver:?}");
}

/// The ceilings of the monitors, repeated here. Control never starts with looser settings.
fn ceilings(safety: &SafetySettings) {
    let most = [
        (safety.target_stale_ms, 50.0),
        (safety.target_late_ms, 50.0),
        (safety.state_late_ms, 50.0),
        (safety.state_stale_ms, 100.0),
        (safety.input_late_ms, 500.0),
        (safety.input_stale_ms, 500.0),
        (safety.operator_silent_ms, 1000.0),
        (safety.hold_timeout_ms, 60_000.0),
        (safety.tracking_error_rad, 0.25),
        (safety.tracking_error_now_rad, 0.5),
        (safety.tracking_error_m, 0.05),
        (safety.tracking_error_now_m, 0.1),
        (safety.tracking_error_ms, 500.0),
        (safety.target_jump_slow_ms, 1000.0),
        (safety.target_jump_hold_ms, 5000.0),
        (f64::from(safety.deadlines_missed_slow), 50.0),
        (f64::from(safety.deadlines_missed_max), 50.0),
        (f64::from(safety.deadlines_late_per_s_max), 100.0),
        (safety.hand_speed_max_m_per_s, 3.0),
    ];
    assert!(most.iter().all(|(value, most)| *value > 0.0 && value <= most), "{safety:?}");
    assert!(safety.enable_released_ms >= 200.0, "{safety:?}");
}

fn changed(input: &[u8]) -> String {
    let mut text = TEXT.as_bytes().to_vec();
    let mut bytes = Bytes::new(input);
    for _ in 0..8 {
        if bytes.is_empty() {
            break;
        }
        let length = usize::from(bytes.u8() % 64);
        let at = usize::from(bytes.u16()) % text.len().max(1);
        let end = (at + usize::from(bytes.u8())).min(text.len());
        text.splice(at..end, bytes.take(length).to_vec());
    }
    String::from_utf8_lossy(&text).into_owned()
}
