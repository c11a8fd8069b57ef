//! A number that is different for each run of a process.

use crate::clock::now;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Returns a number for `Header::incarnation`, never zero. It is mixed from both clocks, the process id and a
/// counter. Two calls differ with probability 1 - 2^-32, even in processes that start in the same instant.
pub fn incarnation() -> u32 {
    static CALLS: AtomicU64 = AtomicU64::new(0);
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
    let call = CALLS.fetch_add(1, Ordering::Relaxed);
    let mut bits = 0;
    for part in [wall, now().0, u64::from(std::process::id()), call] {
        bits = mix(bits ^ part);
    }
    ((bits >> 32) as u32).max(1)
}

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): every input bit reaches every output bit.
fn mix(bits: u64) -> u64 {
    let bits = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}
