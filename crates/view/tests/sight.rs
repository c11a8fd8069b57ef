//! Messages of a page about a webcam's images, and the files that find the person in them.

use crate::{damage, message, random};
use messages::{SkeletonLayout, raw_flag};
use view::{AGE_MS_MAX, LANDMARKS, NOBODY_BYTES, POLICY, Refusal, SIGHT_BYTES, Sight, camera_policy};

/// The switch, and landmarks that all differ.
fn numbers() -> Vec<f32> {
    let mark = |n: f32| [0.01 * n, -0.02 * n, 0.03 * n, n / 40.0, 0.02 * n, 0.01 * n];
    std::iter::once(1.0).chain((0..LANDMARKS).flat_map(|n| mark(n as f32))).collect()
}

#[test]
fn image_becomes_frame_of_mediapipe_layout() {
    let sight = Sight::decode(&message(7.5, 33.0, &numbers())).expect("valid");
    assert_eq!((sight.sent_ms, sight.age_ms), (7.5, 33.0));
    let frame = *sight.person.expect("a person");
    assert_eq!((frame.layout, frame.joint_count), (SkeletonLayout::MediaPipe66 as u32, 66));
    assert_eq!(frame.flags, raw_flag::MIRRORED);
    assert_eq!((frame.positions[32], frame.confidence[32]), ([0.32, -0.64, 0.03 * 32.0], 0.8));
    assert_eq!((frame.positions[65], frame.confidence[65]), ([0.64, 0.32, 0.0], 0.8));
    assert!(frame.positions[66..].as_flattened().iter().chain(&frame.confidence[66..]).all(|&x| x == 0.0));
    let mut plain = numbers();
    plain[0] = 0.0;
    let sight = Sight::decode(&message(7.5, 33.0, &plain)).expect("valid");
    assert_eq!(sight.person.map(|person| person.flags), Some(0));
    assert_eq!(Sight::decode(&message(1.0, 2.0, &[])).map(|sight| sight.person), Ok(None));
}

#[test]
fn invalid_image_is_refused_with_reason() {
    let with = |at: usize, number: f32| {
        let mut bad = numbers();
        bad[at] = number;
        message(1.0, 2.0, &bad)
    };
    for (bytes, refusal) in [
        (with(1, f32::NAN), Refusal::Number),
        (with(198, f32::INFINITY), Refusal::Number),
        (with(4, 1.01), Refusal::Number),
        (with(4, -0.01), Refusal::Number),
        (with(6, 5.1), Refusal::Number),
        (with(0, 0.5), Refusal::Number),
        (message(f64::NAN, 2.0, &numbers()), Refusal::Number),
        (message(1.0, f64::NAN, &numbers()), Refusal::Age),
        (message(1.0, -1e-3, &numbers()), Refusal::Age),
        (message(1.0, AGE_MS_MAX + 1e-3, &[]), Refusal::Age),
        (message(1.0, 2.0, &numbers()[1..]), Refusal::Length),
        (message(1.0, 2.0, &[0.0]), Refusal::Length),
        (vec![0; 3], Refusal::Length),
    ] {
        assert_eq!(Sight::decode(&bytes), Err(refusal), "{} bytes", bytes.len());
    }
}

/// No bytes make it panic, and accepted numbers are within their bounds.
#[test]
fn any_bytes_are_refused_or_within_bounds() {
    let mut next = random();
    let mut accepted = 0;
    for round in 0..20_000 {
        let mut bytes = message(1.0, 2.0, &numbers());
        damage(&mut bytes, round % 4, &mut next);
        bytes.truncate([SIGHT_BYTES, SIGHT_BYTES, NOBODY_BYTES, next() % SIGHT_BYTES][round / 4 % 4]);
        let Ok(sight) = Sight::decode(&bytes) else { continue };
        accepted += 1;
        assert!((0.0..=AGE_MS_MAX).contains(&sight.age_ms) && sight.sent_ms.is_finite());
        for mark in sight.person.iter().flat_map(|person| person.positions) {
            assert!(mark.iter().all(|x| x.is_finite() && x.abs() <= 5.0));
        }
    }
    assert!(accepted > 5000, "{accepted}");
}

#[test]
fn camera_policy_adds_only_webassembly_and_the_camera() {
    let policy = camera_policy();
    let (loose, more) = policy.split_once("Permissions-Policy").expect("the camera");
    assert_eq!(loose.replacen(" 'wasm-unsafe-eval'", "", 1), POLICY);
    assert!(more.contains("camera=(self)") && more.ends_with("\r\n") && !POLICY.contains("wasm"));
}

/// The packages are pinned by their versions and their hashes.
#[test]
fn camera_libraries_are_locked_by_hash() {
    let text = include_str!("../../../tools/camera/package-lock.json");
    let lock: serde_json::Value = serde_json::from_str(text).expect("JSON");
    let packages = lock["packages"].as_object().expect("packages");
    let libraries = ["@mediapipe/pose", "@mediapipe/tasks-vision"];
    assert_eq!(packages.len(), 1 + libraries.len());
    for name in libraries {
        let library = &packages[&format!("node_modules/{name}")];
        assert_eq!(packages[""]["dependencies"][name], library["version"]);
        assert!(library["integrity"].as_str().is_some_and(|hash| hash.starts_with("sha512-") && hash.len() == 95));
        assert_eq!(library["license"], "Apache-2.0");
    }
}
