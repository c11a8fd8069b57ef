use super::*;
use crate::trajectory;
use driver::Grippers;
use messages::{Layout, tick_at};

const BEFORE_TICKS: u64 = 75;

fn gripper() -> Gripper {
    let finger = |joint: &str, open, closed| Finger { joint: joint.into(), open, closed };
    let fingers = vec![finger("a", 0.045, 0.0), finger("b", 0.0, 6.0)];
    Gripper { controller: "hand".into(), fingers, opening_m: 0.09, force_max_n: 16.0, speed: 1.0 / 0.9 }
}

/// A hand whose controller has held the fingers at `reference` for long enough, at this index.
fn standing(reference: &[f64]) -> (Hand, u64) {
    let mut hand = Hand::new(0, gripper());
    hand.receive(reference, deadline(1_000));
    (hand, (1_000 + tick_at(Stamp(STANDS_NS)) + 2).next_multiple_of(PERIOD_TICKS))
}

fn known(k: u64) -> Observation {
    Observation { now: deadline(k), follows: true, before_ticks: BEFORE_TICKS }
}

fn motion(closure: f64, rate: f64) -> GripperMotion {
    GripperMotion { closure: [closure, 0.0], rate: [rate, 0.0] }
}

/// The cubic of a controller at this time after the first point.
fn cubic(points: &[Point], t_ns: u64, i: usize) -> f64 {
    let Some(next) = points.iter().position(|point| point.since_first_ns > t_ns) else {
        return points.last().expect("points").positions[i];
    };
    trajectory::tests::cubic(&points[next - 1], &points[next], t_ns, i)
}

/// Closes a hand as `driver` does for so many ticks. Returns its messages, each with the index at which it was sent.
fn close(hand: &mut Hand, from: u64, closure: f64, goal: f64, ticks: u64) -> Vec<(u64, Stamp, Vec<Point>)> {
    let (law, mut now, mut messages) = (Grippers([1.0 / 0.9, 0.0]), motion(closure, 0.0), Vec::new());
    for k in from..from + ticks {
        if k % crate::trajectory::PERIOD_TICKS == 0
            && let Some((first, points)) = hand.next(k, &now, &known(k))
        {
            messages.push((k, first, points));
        }
        now = law.toward(&now, [Some(goal), None]);
    }
    messages
}

#[test]
fn each_message_ends_at_rest_and_keeps_the_speed() {
    let (mut hand, k) = standing(&[0.045, 0.0]);
    let messages = close(&mut hand, k, 0.0, 0.7, 3_000);
    assert!(messages.len() > 80, "{}", messages.len());
    let v_max = [0.045 / 0.9, 6.0 / 0.9];
    for (sent_k, first, points) in &messages {
        assert!(points.len() <= HISTORY_POINTS + 3 && deadline(*sent_k).since(*first) > 45_000_000);
        assert!(points.windows(2).all(|pair| pair[1].since_first_ns > pair[0].since_first_ns));
        assert!(points.last().is_some_and(|last| last.velocities == [0.0, 0.0]));
        let end_ns = points.last().expect("points").since_first_ns;
        for t_ns in (0..end_ns).step_by(1_000_000) {
            for i in 0..2 {
                let v = (cubic(points, t_ns + 1_000_000, i) - cubic(points, t_ns, i)) * 1e3;
                assert!(v.abs() <= v_max[i] * 1.01 + 1e-9, "{v} at {t_ns} of {points:?}");
            }
        }
    }
    let end = &messages.last().expect("messages").2;
    let reached = &end.last().expect("points").positions;
    assert!((reached[0] - 0.0135).abs() < 1e-4 && (reached[1] - 4.2).abs() < 0.01, "{reached:?}");
    assert_eq!(hand.idle(), None);
}

#[test]
fn f122_fingers_rest_after_the_last_message() {
    let (mut hand, k) = standing(&[0.045, 0.0]);
    let messages = close(&mut hand, k, 0.0, 1.0, 700);
    let (sent_k, first, points) = messages.last().expect("messages");
    let now_ns = deadline(*sent_k).since(*first);
    let moved = cubic(points, now_ns + 1_000_000_000, 1) - cubic(points, now_ns, 1);
    // v T / 2 with T = 0.1 s.
    assert!((moved - 6.0 / 0.9 * 0.05).abs() < 0.02, "{moved}");
    let rest = (now_ns + 101_000_000..now_ns + 2_000_000_000).step_by(10_000_000).map(|t_ns| cubic(points, t_ns, 1));
    assert!(rest.clone().all(|q| q == cubic(points, now_ns + 1_000_000_000, 1)));
}

#[test]
fn f122_joining_moves_no_finger_until_the_closure_changes() {
    // One finger is half closed, the other is open: no closure says so.
    let (mut hand, k) = standing(&[0.0225, 0.0]);
    for k in (k..k + 1_000).filter(|k| k % crate::trajectory::PERIOD_TICKS == 0) {
        if let Some((_, points)) = hand.next(k, &motion(0.25, 0.0), &known(k)) {
            assert!(points.iter().all(|point| point.positions == [0.0225, 0.0] && point.velocities == [0.0, 0.0]));
        }
    }
    assert_eq!(hand.idle(), None);
    let begin = k + 1_008;
    let (_, points) = hand.next(begin, &motion(0.2501, 0.01), &known(begin)).expect("it moves");
    let at = &points[points.len() - 3].positions;
    assert!(at[1] > 0.0 && at[1] <= 6.0 / 0.9 * 0.012, "not faster than the robot file allows: {at:?}");
}

#[test]
fn f122_nothing_is_sent_to_a_hand_that_does_something_else() {
    let (mut hand, k) = standing(&[0.045, 0.0]);
    assert!(hand.next(k, &motion(0.0, 0.0), &Observation { follows: false, ..known(k) }).is_none(), "the arms stand");
    assert!(hand.next(k, &motion(0.0, 0.1), &known(k)).is_none(), "it does not rest");
    assert!(hand.next(k, &motion(f64::NAN, 0.0), &known(k)).is_none());
    assert!(hand.next(k, &motion(0.0, 0.0), &known(k)).is_some());
    hand.receive(&[0.045, 0.1], deadline(k + 10));
    assert_eq!(hand.idle(), None, "within the tolerance");
    hand.receive(&[0.045, 3.0], deadline(k + 20));
    assert!(hand.idle().is_some_and(|why| why.contains("`b` is not where it was sent")));
    let later = k + 40;
    assert!(hand.next(later, &motion(0.0, 0.0), &known(later)).is_none(), "it moves");
    let stands = later + 400;
    assert!(hand.next(stands, &motion(0.0, 0.0), &known(stands)).is_none(), "the fingers are elsewhere");
    let (_, points) = hand.next(stands, &motion(0.25, 0.0), &known(stands)).expect("it stands where the hand is");
    assert!(points.iter().all(|point| point.positions == [0.045, 3.0]), "it stays there");
}

#[test]
fn f122_pause_of_the_messages_ends_the_conversation() {
    let (mut hand, k) = standing(&[0.045, 0.0]);
    let messages = close(&mut hand, k, 0.0, 1.0, 300);
    let (sent_k, ..) = messages.last().expect("messages");
    // The controller has braked by then. A longer message would move the fingers at once by what they missed.
    let late = sent_k + 300;
    assert!(hand.next(late, &motion(0.4, 1.0 / 0.9), &known(late)).is_none());
    assert!(hand.idle().is_some_and(|why| why.contains("paused")), "{:?}", hand.idle());
}

#[test]
fn closure_and_force_are_those_of_all_fingers() {
    let (mut hand, k) = standing(&[0.0, 6.0]);
    let now = deadline(k);
    assert_eq!(hand.state(now), None);
    hand.measure(&[0.0225, 3.0], &[], now);
    assert_eq!(hand.state(now), Some([0.5, 0.0, 1.0]));
    // The first finger closes downwards.
    hand.limit(vec![16.0, 2.0]);
    hand.measure(&[0.0225, 3.0], &[-8.0, 2.0], now);
    assert_eq!(hand.state(now), Some([0.5, 12.0, 1.0]));
    hand.measure(&[0.0225, 3.0], &[8.0, f64::NAN], now);
    assert_eq!(hand.state(now), Some([0.5, 0.0, 1.0]));
    hand.measure(&[f64::NAN, 3.0], &[], now);
    assert_eq!(hand.state(now.plus_ns(OLD_NS + 1)), None);
}

#[test]
fn fingers_at_rest_are_sent_where_they_are_ten_times_a_second() {
    let (mut hand, k) = standing(&[0.045, 0.0]);
    let messages = close(&mut hand, k, 0.0, 0.0, 1_600);
    assert!((8..=11).contains(&messages.len()), "{}", messages.len());
    assert_eq!(GripperMotion::ZERO, motion(0.0, 0.0));
}
