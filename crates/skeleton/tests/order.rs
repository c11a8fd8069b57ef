//! Order of frames: stamps and sequences that run backwards, ahead, twice, or wrap around.

use crate::person::{feed, raw, running, seen, standing};
use messages::Stamp;
use proptest::prelude::*;
use skeleton::{Config, DropReason, Input, State, tick};

const MS: u64 = 1_000_000;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn f014_replayed_frame_of_same_session_is_dropped(old in prop::collection::vec(0u64..60, 1..60), other: bool, nonce: bool) {
        let mut state = running(60);
        for (n, i) in (0..).zip(old) {
            let mut replayed = raw(&standing(i as f64 / 60.0), i);
            if other {
                // Frames of another operator or writer, or renumbered: only the capture time counts.
                (replayed.operator_id, replayed.header.incarnation, replayed.header.sequence) = (2, 5, 100 + n);
            }
            replayed.session_nonce = if nonce && i % 2 == 0 { 8 } else { 7 };
            let now = Stamp(1_000_000_000 + 60 * 16_666_667 + n * MS);
            let person = seen(&mut state, now, &replayed);
            // A frame of a new session is not old. `Authority` in `ingest` refuses strangers.
            prop_assert!(person.is_none() || nonce, "frame {} came through again", i);
        }
    }

    #[test]
    fn f026_f027_f028_accepted_time_always_moves_forward(
        steps in prop::collection::vec((-60i64..120, -3i64..6, -5i64..140), 1..200),
    ) {
        let mut state = running(30);
        let (mut origin, mut sequence) = (1_000_000_000 + 29 * 16_666_667_i64, 30_i64);
        let (mut now, mut last) = (Stamp(origin as u64 + MS), Stamp(origin as u64));
        let mut accepted_sequence = sequence;
        for (by_ms, by, late_ms) in steps {
            let (at, count) = (origin + by_ms * MS as i64, sequence + by);
            let mut frame = raw(&standing(at as f64 * 1e-9 - 1.0), 0);
            (frame.header.origin, frame.header.sequence) = (Stamp(at as u64), count.max(0) as u64);
            now = now.max(Stamp((at + late_ms * MS as i64) as u64));
            let out = tick(&Config::default(), &mut state, now, Input { raw: &frame, stored: None });
            if let Some(person) = out.skeleton {
                prop_assert!(person.header.origin > last, "{} after {}", person.header.origin.0, last.0);
                prop_assert!(count > accepted_sequence);
                prop_assert!(person.header.origin <= now.plus_ns(2 * MS) && now.since(person.header.origin) <= 100 * MS);
                (last, accepted_sequence) = (person.header.origin, count);
            }
            if out.drop.is_none_or(|reason| reason as usize > DropReason::Backwards as usize) {
                (origin, sequence) = (at, count);
            }
        }
    }

    #[test]
    fn f032_wrapping_sequence_drops_no_frame(before in 0u64..1024, lost in 1u64..4) {
        let mut state = State::default();
        let mut sequence = u64::MAX - before;
        for i in 0..2048 / lost {
            let mut frame = raw(&standing(i as f64 / 60.0), i);
            frame.header.sequence = sequence;
            prop_assert_eq!(feed(&mut state, &frame), None, "sequence {}", sequence);
            let mut again = raw(&standing(i as f64 / 60.0), i);
            again.header.sequence = sequence.wrapping_sub(1);
            again.header.origin.0 += 1;
            prop_assert_eq!(feed(&mut state, &again), Some(DropReason::Backwards), "sequence {}", sequence);
            sequence = sequence.wrapping_add(lost);
        }
    }

    #[test]
    fn f032_extreme_stamps_never_panic(now: u64, origin: u64, near in 0u64..1024) {
        let mut state = running(3);
        let ends = [0, 1, near, now, origin, u64::MAX / 2 + near, u64::MAX - near, u64::MAX];
        for (now, origin) in ends.into_iter().flat_map(|now| ends.map(|origin| (now, origin))) {
            let mut frame = raw(&standing(0.05), 3);
            (frame.header.origin, frame.header.sequence) = (Stamp(origin), now);
            let out = tick(&Config::default(), &mut state, Stamp(now), Input { raw: &frame, stored: None });
            let of_now = origin <= now.saturating_add(2 * MS) && now <= origin.saturating_add(100 * MS);
            prop_assert!(out.drop.is_some() || of_now, "{} at {}", origin, now);
        }
    }
}

#[test]
fn f026_frames_back_in_time_are_dropped_and_next_is_accepted() {
    let mut state = running(30);
    for back in 1..4 {
        let mut frame = raw(&standing(0.5), 30);
        frame.header.origin.0 -= (back + 1) * 16_666_667;
        assert_eq!(feed(&mut state, &frame), Some(DropReason::Backwards));
    }
    assert_eq!(feed(&mut state, &raw(&standing(0.5), 30)), None);
}
