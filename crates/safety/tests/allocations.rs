//! A tick allocates nothing.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use messages::Stamp;
use rand::{Rng, SeedableRng};
use robot::{Frames, Pose};
use safety::gate::{Config, State, tick};
use safety::monitor;
use support::motion::resting;
use support::{Bench, model};

struct Counting;

thread_local! {
    /// Of this thread only: the harness has threads of its own.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

#[allow(unsafe_code)]
// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's contract is the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[test]
fn the_counter_counts() {
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(Box::new(1)));
    assert_eq!(ALLOCATIONS.get(), before + 1);
}

#[test]
fn ten_thousand_ticks_allocate_nothing() {
    let model = model();
    let config = Config::new(&model).unwrap();
    let mut gate = State::at_rest(model.home);
    let mut bench = Bench::engaged();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut near = monitor::Near::new();
    let mut frames = Frames { base_from_body: [Pose::identity(); messages::JOINTS + 1] };
    let before = ALLOCATIONS.get();
    for k in 1..=10_000 {
        bench.input.motion.gate_denied = k % 7 == 0;
        bench.input.operator.estop_edge = k % 1000 == 0;
        bench.step();
        let mut proposed = resting(k, model.home);
        // Both clearance checks run: the command is new, and of no use to anybody.
        proposed.a[1] = if k % 2 == 0 { 1e-7 } else { f64::from_bits(rng.next_u64()) };
        tick(&config, &mut gate, Stamp(k), proposed);
        let clearance = monitor::measured_clearance(&model, &mut frames, &proposed.q);
        near.update(&model, clearance.distance_m);
        monitor::outside_limits(&model, &proposed.q);
        monitor::tracking_error(&model, &proposed.q, &proposed.v, &proposed.q, 0.0);
    }
    assert_eq!(ALLOCATIONS.get(), before);
}
