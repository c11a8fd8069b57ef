//! Runs independent jobs on several threads, with results in the order of the jobs.

use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

/// Runs `count` jobs on `threads` threads. The results do not depend on the number of threads.
///
/// # Panics
/// Panics if the system cannot create the threads.
pub fn in_parallel<T: Send>(threads: usize, count: usize, job: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("the system gives threads");
    pool.install(|| (0..count).into_par_iter().with_max_len(1).map(&job).collect())
}

/// Seed of part `index` of a run with seed `seed`. Neighbouring numbers give unrelated seeds (SplitMix64,
/// Steele, Lea and Flood 2014).
pub fn derived_seed(seed: u64, index: u64) -> u64 {
    let mut z = seed.wrapping_add(index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
