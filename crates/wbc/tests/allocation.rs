//! No tick allocates, whatever it is asked.
#![allow(unsafe_code, reason = "a counting allocator has to implement GlobalAlloc")]

mod support;

use messages::Stamp;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use support::attack::Attacker;
use support::checker::Checker;
use wbc::{Input, Options, State, Target, tick};

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
    let subject = support::Subject::made_up();
    let config = subject.config(Options::default());
    let mut state = State::at_rest(&config, subject.home);
    let checker = Checker::new(&subject, state.planned());
    let mut attacker = Attacker::new(&subject, 77);
    let mut in_ticks = 0;
    for k in 0..10_000 {
        attacker.next(k, state.planned(), &checker);
        let target =
            Target { q: &attacker.q, dq: &attacker.dq, ddq: &[0.0; messages::JOINTS], valid_mask: attacker.valid_mask };
        let input = Input { k, target: Some(target), permit: attacker.permit };
        let before = COUNT.with(Cell::get);
        tick(&config, &mut state, Stamp::NONE, input);
        in_ticks += COUNT.with(Cell::get) - before;
    }
    let payload = robot::Payload { mass_kg: 0.5, center: nalgebra::Vector3::new(0.0, 0.1, 0.2) };
    let mut at_rest = State::at_rest(&config, subject.home);
    let before = COUNT.with(Cell::get);
    assert_eq!(at_rest.carry(&config, &[payload; 2]), Ok(None));
    in_ticks += COUNT.with(Cell::get) - before;
    assert_eq!(in_ticks, 0);
    assert!(COUNT.with(Cell::get) > 0, "the counter counts");
}
