//! No tick allocates, whatever it is asked.
#![allow(unsafe_code, reason = "a counting allocator has to implement GlobalAlloc")]

mod support;

use follow::Weights;
use follow::arm::ArmVector;
use messages::ALL_JOINTS;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::{FREE, Robot, arm, random_q, way};

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: forwards to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
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
fn ten_thousand_ticks_allocate_nothing() {
    let mut rng = Pcg64::seed_from_u64(77);
    let mut robot = Robot::at(&FREE, Weights::default());
    let mut person = [arm().limbs(&ArmVector::from(FREE)); 2];
    let mut in_ticks = 0;
    for k in 0..10_000 {
        if k % 500 == 0 {
            person = [arm().limbs(&random_q(&mut rng)), arm().limbs(&random_q(&mut rng))];
            robot.valid_mask = if rng.random_bool(0.7) { ALL_JOINTS } else { rng.random() };
        }
        let first = robot.next_first();
        let mut way = way(first, |_| person);
        if k % 7 == 0 {
            way[rng.random_range(0..24)] = [[f32::NAN; 4]; 4];
        }
        let missed = if k % 11 == 0 { rng.random_range(1..40) } else { 1 };
        let before = COUNT.with(Cell::get);
        robot.step_after(missed, &way, first);
        in_ticks += COUNT.with(Cell::get) - before;
    }
    assert_eq!(in_ticks, 0);
    assert!(COUNT.with(Cell::get) > 0, "the counter counts");
}
