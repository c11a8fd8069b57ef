//! The memory lock belongs to a process, so it has a test program of its own.

use rt::{Outcome, PageFaults, Policy, Realtime, RealtimeConfig};

/// Far larger than the memory that the allocator keeps.
const BLOCK_BYTES: usize = 4 << 20;
/// Less than the memory that is touched in advance. Far more than an allocator returns to the system at once (128 KiB).
const HEAP_BYTES: usize = 2 << 20;

#[test]
fn memory_is_resident_when_lock_is_reported_applied() {
    let config = RealtimeConfig { policy: Policy::Other, cores: None, lock_memory: true, cpu_dma_latency: false };
    let report = Realtime::apply(&config);
    if report.outcome("prefault").is_applied() {
        let before = PageFaults::of_thread();
        for _ in 0..3 {
            let blocks = [HEAP_BYTES, HEAP_BYTES / 2, 100].map(|bytes| vec![1_u8; bytes]);
            std::hint::black_box(&blocks);
            touch_stack(0);
        }
        let faults = PageFaults::of_thread().since(before);
        assert_eq!(
            faults,
            PageFaults::default(),
            "of what was touched before, lock or not: {}",
            report.outcome("memory lock").is_applied()
        );
    }
    match report.outcome("memory lock") {
        Outcome::Applied(_) => {
            let locked = locked_kb();
            let thread = std::thread::Builder::new().stack_size(BLOCK_BYTES).spawn(locked_kb);
            let grown = thread.expect("a thread").join().expect("it does not panic") - locked;
            assert!(grown >= BLOCK_BYTES as u64 / 1024, "a new stack is locked too: {grown} kB more");
            let mut block: Vec<u8> = Vec::with_capacity(BLOCK_BYTES);
            let before = PageFaults::of_thread();
            block.resize(BLOCK_BYTES, 1);
            std::hint::black_box(&block);
            touch_stack(0);
            let faults = PageFaults::of_thread().since(before);
            // 1,024 pages of heap and 32 of stack. All were mapped when they were requested, not when they were
            // touched.
            assert!(faults.minor < 64, "{faults:?}");
            assert_eq!(faults.major, 0);
        }
        Outcome::Refused(why) => {
            println!("memory cannot be locked here: {why}");
            assert!(why.contains("RLIMIT_MEMLOCK") || why.contains("mlockall"), "{why}");
            assert!(!report.is_realtime());
            assert_eq!(report.refusals().len(), 1);
        }
        Outcome::NotRequested => panic!("it was requested"),
    }
}

fn locked_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells it");
    let line = status.lines().find_map(|line| line.strip_prefix("VmLck:")).expect("Linux counts it");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

#[inline(never)]
fn touch_stack(depth: u32) {
    let frame = [depth as u8; 16 * 1024];
    std::hint::black_box(&frame);
    if depth < 8 {
        touch_stack(depth + 1);
    }
    std::hint::black_box(&frame);
}
