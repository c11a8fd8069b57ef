//! A counting allocator, for the tests and benches that prove that a tick does not allocate.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// Allocations of a thread while it was counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Allocations {
    /// New blocks, `realloc` included.
    pub allocated: u64,
    /// Freed blocks, `realloc` included.
    pub freed: u64,
    /// Bytes of the new blocks.
    pub bytes: u64,
}

/// The system allocator with a count per thread:
/// `#[global_allocator] static ALLOCATOR: rt::CountingAllocator = rt::CountingAllocator;`.
#[derive(Debug)]
pub struct CountingAllocator;

thread_local! {
    // They are constant and without a destructor, so touching them never allocates, not even during thread exit.
    static ARMED: Cell<bool> = const { Cell::new(false) };
    static COUNT: Cell<Allocations> = const { Cell::new(NONE) };
    static ASIDE: Cell<Allocations> = const { Cell::new(NONE) };
    static IS_ASIDE: Cell<bool> = const { Cell::new(false) };
}

const NONE: Allocations = Allocations { allocated: 0, freed: 0, bytes: 0 };

fn count(allocated: u64, freed: u64, bytes: usize) {
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

// SAFETY: every call goes unchanged to `System`, which fulfils the contract. The counting touches only thread-local
// cells, and neither allocates nor unwinds.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(1, 0, layout.size());
        // SAFETY: the caller's promises about `layout` are exactly those that `System` asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(1, 0, layout.size());
        // SAFETY: as for `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count(1, 1, new_size);
        // SAFETY: `block` came from this allocator, thus from `System`, with this `layout`.
        unsafe { System.realloc(block, layout, new_size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        count(0, 1, 0);
        // SAFETY: `block` came from this allocator, thus from `System`, with this `layout`.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Begins to count the allocations of the calling thread, for as long as it lives.
pub fn watch_allocations() {
    COUNT.set(NONE);
    ASIDE.set(NONE);
    ARMED.set(true);
}

/// Returns the allocations of the calling thread since `watch_allocations`: its own, and those counted aside.
/// Both are zero before.
pub fn allocations() -> (Allocations, Allocations) {
    (COUNT.get(), ASIDE.get())
}

/// Runs `work` and counts its allocations aside. Foreign code that is known to allocate must not hide allocations
/// of ours.
pub fn allocating_aside<T>(work: impl FnOnce() -> T) -> T {
    counted_on(true, work)
}

/// Runs `work`, which foreign code calls back while it is counted aside, and counts its allocations as ours.
pub fn allocating_ourselves<T>(work: impl FnOnce() -> T) -> T {
    counted_on(false, work)
}

fn counted_on<T>(aside: bool, work: impl FnOnce() -> T) -> T {
    let before = IS_ASIDE.replace(aside);
    let result = work();
    IS_ASIDE.set(before);
    result
}

/// Runs `work` and counts the allocations of the calling thread in it. It counts nothing unless `CountingAllocator` is
/// the global allocator, so a test proves first that it sees a deliberate allocation. It does not nest.
pub fn count_allocations<T>(work: impl FnOnce() -> T) -> (T, Allocations) {
    assert!(!ARMED.get(), "count_allocations does not nest");
    COUNT.set(Allocations::default());
    ARMED.set(true);
    let result = work();
    ARMED.set(false);
    (result, COUNT.get())
}
