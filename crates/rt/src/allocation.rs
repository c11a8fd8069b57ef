//! An allocator that counts, for the tests and benches that prove that a tick does not allocate.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// What a thread asked of the allocator while it was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Allocations {
    /// New blocks, `realloc` included.
    pub allocated: u64,
    /// Blocks given back, `realloc` included.
    pub freed: u64,
    /// Bytes of the new blocks.
    pub bytes: u64,
}

/// The system allocator with a count per thread:
/// `#[global_allocator] static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;`.
#[derive(Debug)]
pub struct CountingAllocator;

thread_local! {
    // Constant, without a destructor: touching them never allocates, not even during thread exit.
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static COUNT: Cell<Allocations> = const { Cell::new(NONE) };
    static ASIDE: Cell<Allocations> = const { Cell::new(NONE) };
    static IS_ASIDE: Cell<bool> = const { Cell::new(false) };
}

const NONE: Allocations = Allocations { allocated: 0, freed: 0, bytes: 0 };

fn note(allocated: u64, freed: u64, bytes: usize) {
    if ARMED.get() {
        let cell = if IS_ASIDE.get() { &ASIDE } else { &COUNT };
        let count = cell.get();
        cell.set(Allocations {
            allocated: count.allocated + allocated,
            freed: count.freed + freed,
            bytes: count.bytes + bytes as u64,
        });
    }
}

// SAFETY: every call goes unchanged to `System`, which fulfils the contract; the counting touches only thread-local
// cells, neither allocates nor unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(1, 0, layout.size());
        // SAFETY: the caller's promises about `layout` are exactly those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(1, 0, layout.size());
        // SAFETY: as for `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        note(1, 1, new_size);
        // SAFETY: `block` came from this allocator, thus from `System`, with this `layout`.
        unsafe { System.realloc(block, layout, new_size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        note(0, 1, 0);
        // SAFETY: `block` came from this allocator, thus from `System`, with this `layout`.
        unsafe { System.dealloc(block, layout) }
    }
}

/// From now on counts what the calling thread allocates, for as long as it lives.
pub fn watch_allocations() {
    COUNT.set(NONE);
    ASIDE.set(NONE);
    ARMED.set(true);
}

/// What the calling thread has allocated since `watch_allocations`, and what of that aside; nothing before.
pub fn allocations() -> (Allocations, Allocations) {
    (COUNT.get(), ASIDE.get())
}

/// Runs `work` and counts what it allocates aside: code of others that is known to allocate must not hide what is ours.
pub fn allocating_aside<T>(work: impl FnOnce() -> T) -> T {
    counted_on(true, work)
}

/// Runs `work`, which others call back while they are counted aside, and counts what it allocates as ours.
pub fn allocating_ourselves<T>(work: impl FnOnce() -> T) -> T {
    counted_on(false, work)
}

fn counted_on<T>(aside: bool, work: impl FnOnce() -> T) -> T {
    let before = IS_ASIDE.replace(aside);
    let result = work();
    IS_ASIDE.set(before);
    result
}

/// Runs `work` and counts what the calling thread allocates in it. Counts nothing unless `CountingAllocator` is the
/// global allocator: a test proves first that it sees a deliberate allocation. Does not nest.
pub fn count_allocations<T>(work: impl FnOnce() -> T) -> (T, Allocations) {
    assert!(!ARMED.get(), "count_allocations does not nest");
    COUNT.set(Allocations::default());
    ARMED.set(true);
    let result = work();
    ARMED.set(false);
    (result, COUNT.get())
}
