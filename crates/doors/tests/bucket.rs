//! The rate limit for frames.

use doors::{BURST, Bucket, RATE_MAX_HZ};
use messages::Stamp;
use proptest::prelude::*;

/// Time that earns one frame, ns.
const PERIOD_NS: u64 = 1_000_000_000 / RATE_MAX_HZ;

#[test]
fn f023_bucket_passes_one_burst_and_then_250_frames_per_second() {
    let (mut bucket, start) = (Bucket::default(), Stamp(5_000_000_000));
    let at_once = (0..1000).filter(|_| bucket.admit(start)).count();
    assert_eq!(at_once as u64, BURST);
    let mut passed = 0;
    // 10 kHz for ten seconds.
    for i in 1..=100_000 {
        passed += u64::from(bucket.admit(start.plus_ns(i * 100_000)));
    }
    assert_eq!(passed, 10 * RATE_MAX_HZ);
}

#[test]
fn tracker_at_240_hz_loses_no_frame() {
    let mut bucket = Bucket::default();
    let period_ns = 1_000_000_000 / 240;
    assert!((0..100_000_u64).all(|i| bucket.admit(Stamp(1 + i * period_ns))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn f023_bucket_passes_at_most_burst_plus_rate_in_any_window(steps in prop::collection::vec(0_u64..20_000_000, 1..400)) {
        let (mut bucket, mut now, mut taken) = (Bucket::default(), Stamp(1), Vec::new());
        for step in steps {
            now = now.plus_ns(step);
            if bucket.admit(now) {
                taken.push(now);
            }
        }
        for (i, from) in taken.iter().enumerate() {
            for (j, to) in taken.iter().enumerate().skip(i) {
                let most = BURST + to.since(*from) / PERIOD_NS;
                prop_assert!((j - i) as u64 <= most, "{} frames in {} ns", j - i + 1, to.since(*from));
            }
        }
    }
}
