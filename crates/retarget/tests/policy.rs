//! Chunks of a policy on the tick grid.

use crate::support::shipped;
use messages::{JointTarget, Layout, PolicyChunk, Stamp, TICK_HZ, deadline, target_flag, tick_at};
use retarget::policy::{Config, State, tick};

const SILENT_NS: u64 = 2_000_000_000;
const MS: u64 = 1_000_000;

struct Bench {
    config: Config,
    state: State,
    k: u64,
}

impl Bench {
    fn new() -> Self {
        Self { config: Config::new(&shipped("tiago_dual"), SILENT_NS), state: State::default(), k: 1500 }
    }

    fn chunk(&self, start_ms: i64, period_ms: u64, rows: &[f32]) -> PolicyChunk {
        let start = Stamp(self.now().0.saturating_add_signed(start_ms * MS as i64));
        let mut chunk = PolicyChunk {
            session_nonce: 5,
            received: self.now(),
            start,
            period_ns: period_ms * MS,
            rows: rows.len() as u32,
            valid_mask: 1 << 3,
            ..PolicyChunk::ZERO
        };
        for (row, &q) in chunk.q.iter_mut().zip(rows) {
            row[3] = q;
        }
        chunk
    }

    fn now(&self) -> Stamp {
        deadline(self.k)
    }

    fn next(&mut self, chunk: Option<&PolicyChunk>) -> JointTarget {
        let now = self.now();
        let target = tick(&self.config, &mut self.state, now, self.k, chunk);
        self.k += 1;
        target
    }

    /// Plays for this time. Returns the last target.
    fn play(&mut self, ms: u64) -> JointTarget {
        let last = tick_at(self.now().plus_ns(ms * MS));
        while self.k < last {
            self.next(None);
        }
        self.next(None)
    }
}

fn is_fresh(target: &JointTarget) -> bool {
    target.flags & target_flag::INPUT_FRESH != 0
}

#[test]
fn rows_of_a_sine_are_played_as_a_sine_with_its_velocity() {
    let mut bench = Bench::new();
    let rows: Vec<f32> = (0..20).map(|i| (0.5 * (f64::from(i) * 0.05 * 3.0).sin()) as f32).collect();
    let chunk = bench.chunk(0, 50, &rows);
    let mut target = bench.next(Some(&chunk));
    let (mut worst, mut worst_v) = (0.0_f64, 0.0_f64);
    // The curve's first and last pieces have one-sided velocities.
    for _ in 0..TICK_HZ * 9 / 10 {
        let at = (deadline(target.k).since(chunk.start)) as f64 * 1e-9;
        if at > 0.05 {
            worst = worst.max((target.q[3] - 0.5 * (3.0 * at).sin()).abs());
            worst_v = worst_v.max((target.dq[3] - 1.5 * (3.0 * at).cos()).abs());
        }
        target = bench.next(None);
    }
    assert!(worst < 1e-3 && worst_v < 0.05, "{worst} rad, {worst_v} rad/s");
    let after = bench.play(200);
    assert_eq!((after.q[3], after.dq[3]), (f64::from(rows[19]), 0.0));
    assert_eq!(after.input_received, chunk.start.plus_ns(20 * 50 * MS), "it ages from the end of the last row on");
}

#[test]
fn single_rows_are_a_polyline_and_a_gap_is_not_bridged_for_long() {
    let mut bench = Bench::new();
    let first = bench.chunk(0, 33, &[0.0]);
    bench.next(Some(&first));
    let second = bench.chunk(33, 33, &[0.033]);
    bench.next(Some(&second));
    let half = bench.play(15);
    assert!((half.q[3] - 0.015).abs() < 0.002 && (half.dq[3] - 1.0).abs() < 0.05, "{} {}", half.q[3], half.dq[3]);
    assert!((bench.play(40).q[3] - 0.033).abs() < 1e-6);
    let late = bench.chunk(500, 33, &[1.0]);
    bench.next(Some(&late));
    let waits = bench.play(300);
    assert!((waits.q[3] - 0.033).abs() < 1e-6 && waits.dq[3] == 0.0);
    assert!(bench.now().since(waits.input_received) > 200 * MS, "silence is no motion");
    assert!((bench.play(250).q[3] - 1.0).abs() < 1e-6);
}

#[test]
fn chunk_replaces_the_one_before_from_its_own_start_on() {
    let mut bench = Bench::new();
    let first = bench.chunk(0, 100, &[0.0; 10]);
    bench.next(Some(&first));
    let second = bench.chunk(200, 100, &[1.0; 5]);
    bench.next(Some(&second));
    assert_eq!(bench.play(150).q[3], 0.0);
    assert_eq!(bench.play(60).q[3], 1.0);
    let end = bench.play(3000);
    assert!(end.session_nonce == 0 && !is_fresh(&end), "gone once its rows and its lease are over");
}

#[test]
fn chunks_that_are_planned_ahead_play_one_after_the_other() {
    let mut bench = Bench::new();
    for i in 0..20 {
        let chunk = bench.chunk(200, 50, &[i as f32 * 0.01; 4]);
        bench.next(Some(&chunk));
        let shown = bench.play(49);
        if i >= 5 {
            assert!(is_fresh(&shown) && (shown.q[3] - f64::from(i - 4) * 0.01).abs() < 0.011, "{i}: {}", shown.q[3]);
        }
    }
}

#[test]
fn chunk_that_begins_later_is_not_followed_before() {
    let mut bench = Bench::new();
    let chunk = bench.chunk(100, 50, &[0.5, 0.5]);
    let target = bench.next(Some(&chunk));
    assert!(!is_fresh(&target) && target.session_nonce == 5);
    assert!(is_fresh(&bench.play(110)));
    let other = PolicyChunk { session_nonce: 6, ..bench.chunk(100, 50, &[0.1]) };
    let target = bench.next(Some(&other));
    assert!(!is_fresh(&target) && target.session_nonce == 6, "another session continues nothing");
}

#[test]
fn any_bits_give_a_target() {
    let mut bench = Bench::new();
    let mut seed = 1_u64;
    for _ in 0..300 {
        let bytes: Vec<u8> = (0..size_of::<PolicyChunk>())
            .map(|_| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (seed >> 56) as u8
            })
            .collect();
        let mut chunk = PolicyChunk::get(&bytes);
        chunk.rows %= 120;
        let ((), counted) = rt::count_allocations(|| {
            bench.next(Some(&chunk));
            bench.play(3);
        });
        assert_eq!(counted.allocated, 0);
    }
}
