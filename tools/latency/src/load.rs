//! Busy threads beside the measurement.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Memory that each thread walks through. It is larger than a core's share of the caches.
const WALK_BYTES: usize = 16 << 20;

/// Threads that compute and touch memory until they are dropped.
pub struct Load {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<u64>>,
}

impl Load {
    /// Starts `count` threads with the default policy.
    pub fn start(count: usize) -> std::io::Result<Self> {
        let mut load = Self { stop: Arc::default(), threads: Vec::new() };
        for index in 0..count {
            let stop = Arc::clone(&load.stop);
            let thread = std::thread::Builder::new().name(format!("load-{index}")).spawn(move || walk(&stop))?;
            load.threads.push(thread);
        }
        Ok(load)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn walk(stop: &AtomicBool) -> u64 {
    let mut memory = vec![1_u64; WALK_BYTES / 8];
    let mut sum = 0_u64;
    while !stop.load(Ordering::Relaxed) {
        for word in &mut memory {
            sum = sum.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(*word);
            *word = sum;
        }
        std::hint::black_box(&mut memory);
    }
    sum
}
