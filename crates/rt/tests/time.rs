//! The grid of ticks, the loop on it, and histograms of durations.

use messages::deadline;
use proptest::prelude::*;
use rt::{Histogram, PeriodicLoop, Shutdown, TickGrid};

proptest! {
    #[test]
    fn tick_index_is_ticked_once_or_counted_as_missed(
        first in 0u64..1u64 << 40,
        steps in prop::collection::vec(0u64..5_000_000, 1..200),
    ) {
        let mut grid = TickGrid::starting_at(first);
        let (mut time, mut seen, mut missed) = (deadline(first), Vec::new(), 0);
        for step in steps {
            time = time.plus_ns(step);
            if let Some(tick) = grid.wake(time) {
                prop_assert!(deadline(tick.k) <= time && time < deadline(tick.k + 1));
                prop_assert_eq!(tick.missed, tick.k - seen.last().map_or(first, |last| last + 1));
                missed += tick.missed;
                seen.push(tick.k);
            }
            prop_assert_eq!(grid.ticks() + grid.missed(), grid.elapsed());
        }
        prop_assert!(seen.windows(2).all(|pair| pair[0] < pair[1]));
        prop_assert_eq!((grid.ticks(), grid.missed()), (seen.len() as u64, missed));
        if let Some(last) = seen.last() {
            prop_assert_eq!(grid.elapsed(), last - first + 1);
        }
    }
}

#[test]
fn tick_index_is_taken_only_once() {
    let mut grid = TickGrid::starting_at(10);
    assert_eq!(grid.begin(9), None);
    assert_eq!(grid.begin(10), Some(0));
    assert_eq!(grid.begin(10), None);
    assert_eq!(grid.wake(deadline(10).plus_ns(5)), None);
    assert_eq!(grid.begin(14), Some(3));
    assert_eq!((grid.ticks(), grid.missed(), grid.elapsed(), grid.next_k()), (2, 3, 5, 15));
}

#[test]
fn lateness_is_measured_from_awaited_deadline() {
    let mut grid = TickGrid::starting_at(3);
    let tick = grid.wake(deadline(7).plus_ns(11)).expect("index 7 is due");
    assert_eq!((tick.k, tick.missed), (7, 4));
    assert_eq!(tick.late_ns, deadline(7).plus_ns(11).since(deadline(3)));
}

#[test]
fn loop_follows_clock_until_shutdown_with_and_without_spin() {
    for spin_us in [0.0, 100.0, f64::MAX] {
        let (shutdown, mut periodic) = (Shutdown::default(), PeriodicLoop::start().spinning_us(spin_us));
        for _ in 0..20 {
            let tick = periodic.next(&shutdown).expect("no shutdown yet");
            assert!(tick.woke >= deadline(tick.k));
        }
        assert_eq!(periodic.grid().ticks(), 20);
        shutdown.request();
        assert_eq!(periodic.next(&shutdown), None);
    }
}

#[test]
fn quantiles_match_sorted_values_within_0_1_percent() {
    let mut histogram = Histogram::default();
    let values: Vec<u64> = (1..=10_000).map(|i| i * 137).collect();
    values.iter().for_each(|&ns| histogram.record_ns(ns));
    for quantile in [0.5, 0.9, 0.99, 0.999, 1.0] {
        let exact = values[(quantile * values.len() as f64).ceil() as usize - 1] as f64 * 1e-3;
        let reported = histogram.quantile_us(quantile);
        assert!((reported - exact).abs() <= 1e-3 * exact, "quantile {quantile}: {reported} us, exact {exact} us");
    }
    assert_eq!(histogram.max_us(), 1_370.0);
    let json = histogram.to_json();
    assert_eq!(json["count"], 10_000);
    assert!((json["p99_us"].as_f64().unwrap() - 1_356.3).abs() < 1.4);
}

#[test]
fn value_beyond_range_is_counted_with_exact_maximum() {
    let mut histogram = Histogram::default();
    histogram.record_ns(0);
    histogram.record_ns(u64::MAX);
    assert_eq!(histogram.count(), 2);
    assert_eq!(histogram.max_us(), u64::MAX as f64 * 1e-3);
    histogram.reset();
    assert_eq!((histogram.count(), histogram.max_us(), histogram.quantile_us(0.5)), (0, 0.0, 0.0));
}
