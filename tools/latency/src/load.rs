//! Busy threads beside the measurement.

use rt::Background;
use std::sync::atomic::{AtomicBool, Ordering};

/// Memory that each thread walks through. It is larger than a core's share of the caches.
const WALK_BYTES: usize = 16 << 20;

/// Threads that compute and touch memory until they are dropped.
pub struct Load {
    _threads: Vec<Background>,
}

impl Load {
    /// Starts `count` threads with the default policy.
    pub fn start(count: usize) -> std::io::Result<Self> {
        let threads = (0..count).map(|index| Background::start(&format!("load-{index}"), walk));
        Ok(Self { _threads: threads.collect::<Result<_, _>>()? })
    }
}

fn walk(ends: &AtomicBool) {
    let mut memory = vec![1_u64; WALK_BYTES / 8];
    let mut sum = 0_u64;
    while !ends.load(Ordering::Relaxed) {
        for word in &mut memory {
            sum = sum.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(*word);
            *word = sum;
        }
        std::hint::black_box(&mut memory);
    }
}
