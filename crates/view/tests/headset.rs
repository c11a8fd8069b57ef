//! Messages of a page about a headset's poses.

use crate::{damage, message, random};
use view::{AGE_MS_MAX, BODY_BYTES, HEADSET_BYTES, HeadsetFrame, Refusal};

const NAN: f32 = f32::NAN;
const INF: f32 = f32::INFINITY;
const POSE: [f32; 8] = [0.1, 1.6, -0.2, 0.0, 0.0, 0.0, 1.0, 1.0];

/// A head, a bare left hand and a controller in the right one, and a body if `joints` is 22.
fn numbers(joints: usize) -> Vec<f32> {
    let mut all = vec![1.8];
    all.extend(POSE);
    all.push(0.0);
    all.extend(POSE);
    all.extend([0.03, -1.0, -1.0, 1.0]);
    all.extend(POSE);
    all.extend([-1.0, 0.25, 0.75]);
    (0..joints).for_each(|_| all.extend(POSE));
    all
}

#[test]
fn poses_are_read_by_their_places() {
    let (plain, body) = (message(7.5, 33.0, &numbers(0)), message(7.5, 33.0, &numbers(22)));
    assert_eq!((plain.len(), body.len()), (HEADSET_BYTES, BODY_BYTES));
    let frame = HeadsetFrame::decode(&plain).expect("valid");
    assert_eq!((frame.sent_ms, frame.age_ms, frame.stature_m), (7.5, 33.0, Some(1.8)));
    let [left, right] = &frame.hands;
    assert_eq!((left.pinch_m, left.trigger, right.squeeze), (Some(0.03), None, Some(0.75)));
    assert_eq!((right.closure(), frame.body.is_none()), (Some(0.25), true));
    assert!((left.closure().expect("a pinch") - 0.875).abs() < 1e-3);
    assert_eq!(HeadsetFrame::decode(&body).expect("valid").body.expect("a body").iter().flatten().count(), 22);
    // A guessed head or hand counts as unseen, a guessed joint of a body does not.
    let mut guessed = numbers(22);
    for at in [8, 17, 40] {
        guessed[at] = 0.5;
    }
    let frame = HeadsetFrame::decode(&message(1.0, 2.0, &guessed)).expect("valid");
    assert_eq!(frame.body.as_ref().expect("a body").iter().flatten().count(), 22);
    assert!(frame.head.is_none() && frame.hands[0].pose.is_none() && frame.hands[0].grasp().is_none());
}

#[test]
fn f134_invalid_message_of_a_headset_is_refused_with_reason() {
    let with = |at: usize, number: f32| {
        let mut bad = numbers(22);
        bad[at] = number;
        message(1.0, 2.0, &bad)
    };
    let numbers_off =
        [(0, 5.0), (1, NAN), (1, 20.1), (7, 0.5), (4, INF), (8, 0.7), (9, 2.0), (18, 0.6), (31, 1.1), (40, NAN)];
    let numbers_off = numbers_off.map(|(at, number)| (with(at, number), Refusal::Number));
    for (bytes, refusal) in numbers_off.into_iter().chain([
        (message(f64::NAN, 2.0, &numbers(0)), Refusal::Number),
        (message(1.0, f64::NAN, &numbers(0)), Refusal::Age),
        (message(1.0, -1e-3, &numbers(0)), Refusal::Age),
        (message(1.0, AGE_MS_MAX + 1e-3, &numbers(0)), Refusal::Age),
        (message(1.0, 2.0, &numbers(0)[1..]), Refusal::Length),
        (message(1.0, 2.0, &numbers(21)), Refusal::Length),
        (vec![0; 16], Refusal::Length),
    ]) {
        assert_eq!(HeadsetFrame::decode(&bytes).map(|_| ()), Err(refusal), "{} bytes", bytes.len());
    }
}

/// No bytes make it panic, and accepted poses are within their bounds.
#[test]
fn any_bytes_of_a_headset_are_refused_or_within_bounds() {
    let mut next = random();
    let mut accepted = 0;
    for round in 0..20_000 {
        let mut bytes = message(1.0, 2.0, &numbers(22 * (round % 2)));
        damage(&mut bytes, round % 4, &mut next);
        let Ok(frame) = HeadsetFrame::decode(&bytes) else { continue };
        accepted += 1;
        let body = frame.body.iter().flat_map(|body| body.iter().flatten());
        for pose in frame.head.iter().chain(body) {
            assert!(pose.position.amax() <= 20.0 && (pose.rotation.norm() - 1.0).abs() < 1e-9);
        }
    }
    assert!(accepted > 5000, "{accepted}");
}
