//! The faulty link: every fault occurs, and the seed decides everything.

use bus::{FaultCounts, FaultPlan, Faulty, Latest, Publish};
use messages::{Stamp, deadline};

/// Runs one message per tick, with a read before and after it. Returns the messages with their read times, and
/// the counts.
fn run(plan: FaultPlan, seed: u64, ticks: u64) -> (Vec<(u64, u64)>, FaultCounts) {
    let mut link = Faulty::new(plan, seed);
    let mut seen = Vec::new();
    for k in 1..=ticks {
        link.advance(deadline(k));
        seen.extend(link.latest().map(|message| (k, message)));
        link.publish(&k).expect("a bad link still takes everything");
        seen.extend(link.latest().map(|message| (k, message)));
    }
    (seen, link.counts())
}

const BAD: FaultPlan = FaultPlan {
    drop: 0.1,
    duplicate: 0.1,
    reorder: 0.1,
    reorder_ns: 1_500_000,
    delay_min_ns: 100_000,
    delay_max_ns: 3_000_000,
};

#[test]
fn link_without_faults_delivers_every_message_at_once() {
    let (seen, counts) = run(FaultPlan::default(), 1, 100);
    assert_eq!(seen, (1..=100).map(|k| (k, k)).collect::<Vec<_>>());
    assert_eq!(counts, FaultCounts { published: 100, arrived: 100, ..FaultCounts::default() });
}

#[test]
fn faults_repeat_with_same_seed_and_differ_with_another() {
    assert_eq!(run(BAD, 7, 5_000), run(BAD, 7, 5_000));
    assert_ne!(run(BAD, 7, 5_000).0, run(BAD, 8, 5_000).0);
    let mut link = Faulty::new(BAD, 7);
    for k in 1..=100 {
        link.advance(deadline(k));
        link.publish(&k).expect("taken");
    }
    let mut branch = link.clone();
    for k in 101..=200u64 {
        for branch in [&mut link, &mut branch] {
            branch.advance(deadline(k));
            branch.publish(&k).expect("taken");
        }
        assert_eq!(link.latest(), branch.latest());
    }
}

#[test]
fn drop_rate_leaves_gaps_at_configured_share() {
    let (seen, counts) = run(FaultPlan { drop: 0.25, ..FaultPlan::default() }, 3, 10_000);
    // 10,000 draws at 0.25 have a standard deviation of 43. The range is five of them.
    assert!((2_283..=2_717).contains(&counts.dropped), "{counts:?}");
    assert_eq!(seen.len() as u64 + counts.dropped, 10_000);
    assert!(seen.iter().all(|(k, message)| k == message));
}

#[test]
fn delayed_messages_arrive_late_and_in_order() {
    let plan = FaultPlan { delay_min_ns: 2_000_000, delay_max_ns: 9_000_000, ..FaultPlan::default() };
    let (seen, counts) = run(plan, 3, 10_000);
    assert!(seen.windows(2).all(|pair| pair[0].1 < pair[1].1), "never backwards, never twice");
    let lateness: Vec<u64> = seen.iter().map(|(k, message)| k - message).collect();
    // 2 ms are 3 ticks. Keeping the order can stretch a delay up to the longest one, 9 ms or 14 ticks.
    assert!(lateness.iter().all(|late| (3..=14).contains(late)), "{:?}", lateness.iter().max());
    assert!(lateness.iter().any(|&late| late > 5));
    assert!(counts.arrived > 9_900 && counts.dropped == 0);
}

#[test]
fn duplicated_message_is_read_twice() {
    let plan = FaultPlan { duplicate: 0.2, delay_max_ns: 2_000_000, ..FaultPlan::default() };
    let mut link = Faulty::new(plan, 5);
    let mut seen = Vec::new();
    for k in 1..=300u64 {
        link.advance(Stamp(k * 10_000_000));
        link.publish(&k).expect("taken");
        for step in 1..10 {
            link.advance(Stamp(k * 10_000_000 + step * 1_000_000));
            seen.extend(link.latest());
        }
    }
    let repeated = seen.windows(2).filter(|pair| pair[0] == pair[1]).count();
    assert!(repeated > 10, "{repeated}");
    assert_eq!(link.counts().arrived, 300 + link.counts().duplicated);
}

#[test]
fn reordered_message_arrives_after_its_successor() {
    let plan = FaultPlan { reorder: 0.1, reorder_ns: 1_000_000, ..FaultPlan::default() };
    let (seen, counts) = run(plan, 11, 10_000);
    let backwards = seen.windows(2).filter(|pair| pair[1].1 < pair[0].1).count() as u64;
    assert!(backwards > 500 && backwards <= counts.reordered, "{backwards} of {counts:?}");
}

#[test]
fn burst_beyond_64_queued_messages_is_dropped() {
    let plan = FaultPlan { delay_min_ns: 1_000_000, delay_max_ns: 1_000_000, ..FaultPlan::default() };
    let mut link = Faulty::new(plan, 1);
    for k in 0..1_000 {
        link.publish(&k).expect("taken");
    }
    assert_eq!(link.counts().dropped, 1_000 - 64);
    link.advance(Stamp(2_000_000));
    assert_eq!(link.latest(), Some(63));
}
