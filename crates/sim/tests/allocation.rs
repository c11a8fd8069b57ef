//! No tick allocates.
#![allow(unsafe_code, reason = "a counting allocator has to implement GlobalAlloc")]

mod support;

use sim::{Interface, Options};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::{Bench, ELBOW};

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
    for interface in [Interface::Direct, Interface::Jtc100] {
        allocates_nothing(&Options { interface, ..Options::default() });
    }
}

fn allocates_nothing(options: &Options) {
    let mut bench = Bench::new(options, 1);
    let before = COUNT.with(Cell::get);
    for n in 0..10_000_u64 {
        // To and fro, with a silence now and then.
        let jerk = if n % 40 < 10 || n % 40 >= 30 { 100.0 } else { -100.0 };
        let command = bench.next(ELBOW, jerk);
        let command = (n % 1000 < 900).then_some(&command);
        bench.tick(bench.command.k, command);
    }
    assert_eq!(COUNT.with(Cell::get), before);
    let follower = bench.state.follower();
    assert!(follower.accepted > 800 && follower.latched, "commands, silence and refusals were among them");
}
