//! Recording and sleeping do not allocate, and the counter sees code that does.

use rt::{Histogram, PeriodicLoop, Shutdown, TickGrid, count_allocations};

#[test]
fn counter_counts_allocations_of_own_thread_only() {
    let ((), count) = count_allocations(|| {
        let mut list: Vec<u8> = Vec::with_capacity(100);
        list.push(1);
        std::hint::black_box(&list);
    });
    assert_eq!((count.allocated, count.freed, count.bytes), (1, 1, 100));
    let other = std::thread::spawn(|| std::hint::black_box(vec![0u8; 1000]));
    let ((), count) = count_allocations(|| std::hint::black_box(()));
    assert_eq!(count, rt::Allocations::default());
    other.join().expect("the other thread does not panic");
}

#[test]
fn periodic_path_allocates_nothing() {
    let (shutdown, mut periodic) = (Shutdown::default(), PeriodicLoop::start());
    let mut histogram = Histogram::default();
    let mut grid = TickGrid::after(rt::now());
    let ((), count) = count_allocations(|| {
        for i in 0..10_000u64 {
            histogram.record_ns(i.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let _ = grid.wake(rt::now());
        }
        for _ in 0..20 {
            assert!(periodic.next(&shutdown).is_some());
        }
        let _ = rt::PageFaults::of_thread();
    });
    assert_eq!(count, rt::Allocations::default());
}

#[test]
fn allocations_of_libraries_are_counted_aside_except_callbacks() {
    let block = |bytes: usize| drop(std::hint::black_box(vec![0u8; bytes]));
    std::thread::spawn(move || {
        block(1);
        rt::watch_allocations();
        block(10);
        rt::allocating_aside(|| {
            block(100);
            rt::allocating_ourselves(|| block(1000));
            block(100);
        });
        block(10_000);
        let (ours, aside) = rt::allocations();
        assert_eq!((ours.allocated, ours.bytes), (3, 11_010));
        assert_eq!((aside.allocated, aside.freed, aside.bytes), (2, 2, 200));
    })
    .join()
    .expect("the thread does not panic");
}
