//! Memory that is ready before it is needed: locked, kept, and touched in advance.

use super::last_error;
use crate::limits::{Limits, status_line};

/// Stack that is touched in advance: an eighth of a Rust thread's 2 MiB. A tick holds a few messages of at most
/// 3.6 KB.
const STACK_PREFAULT_BYTES: usize = 256 * 1024;
/// Heap that is touched in advance and kept. Assumption: after READY a process asks for some KB at most, for a report.
const HEAP_PREFAULT_BYTES: usize = 4 << 20;
/// Distance of two touches: the smallest page of the supported platforms.
const PAGE_BYTES: usize = 4096;

/// Locks all memory of the process, and all that it will map later.
pub(super) fn lock() -> Result<String, String> {
    let limits = Limits::of_process();
    if let Some(bytes) = limits.memlock_bytes.filter(|_| !limits.any_lock) {
        // With a limit, a lock that fits now would make later mappings fail, in the middle of the run.
        return Err(format!(
            "RLIMIT_MEMLOCK is {bytes} bytes, so later mappings would fail; raise it with LimitMEMLOCK=infinity in the \
             unit, or memlock in limits.conf"
        ));
    }
    // SAFETY: the call takes flags only.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0 {
        return Err(format!("mlockall: {}", last_error()));
    }
    match status_line("VmLck:").as_deref() {
        None | Some("0 kB") => Err(String::from("mlockall was accepted, but /proc/self/status shows no locked memory")),
        Some(amount) => Ok(format!("{amount} locked; later mappings are locked too")),
    }
}

/// Keeps freed memory in the process and touches the heap and the stack of the calling thread. Returns the sizes
/// in words.
pub(super) fn prefault() -> Result<String, String> {
    let kept = keep_heap();
    prefault_heap();
    prefault_stack();
    let (heap, stack) = (HEAP_PREFAULT_BYTES >> 10, STACK_PREFAULT_BYTES >> 10);
    if kept {
        Ok(format!("{heap} KiB of heap, {stack} KiB of stack"))
    } else {
        Err(format!("{stack} KiB of stack only: this allocator cannot keep freed memory"))
    }
}

/// Makes the allocator keep freed memory. Returned pages would fault again when they are next needed, and so
/// would blocks with mappings of their own.
fn keep_heap() -> bool {
    #[cfg(target_env = "gnu")]
    // SAFETY: mallopt takes two integers and changes only tuning values of the allocator. It returns 1 for success.
    unsafe {
        libc::mallopt(libc::M_TRIM_THRESHOLD, -1) == 1 && libc::mallopt(libc::M_MMAP_MAX, 0) == 1
    }
    #[cfg(not(target_env = "gnu"))]
    false
}

fn prefault_heap() {
    let mut heap: Vec<u8> = Vec::with_capacity(HEAP_PREFAULT_BYTES);
    for page in heap.spare_capacity_mut().iter_mut().step_by(PAGE_BYTES) {
        page.write(1);
    }
    std::hint::black_box(&mut heap);
}

#[inline(never)]
fn prefault_stack() {
    let mut stack = [0u8; STACK_PREFAULT_BYTES];
    for byte in stack.iter_mut().step_by(PAGE_BYTES) {
        *byte = 1;
    }
    std::hint::black_box(&mut stack);
}
