//! Interleaved measurement of several implementations of the same computation.

use std::hint::black_box;
use std::time::Instant;

use pulp::{Arch, Simd, WithSimd};

/// Number of rounds. Each round measures every entry once.
pub(crate) const ROUNDS: usize = 400;
/// Passes before a measurement. They bring the weights back into the cache.
const WARM: usize = 5;
/// Passes in a measurement.
const PASSES: usize = 10;

/// One implementation.
pub(crate) struct Entry {
    name: String,
    run: Box<dyn FnMut()>,
    outputs: Vec<f32>,
}

impl Entry {
    /// Creates an entry whose outputs can be compared.
    pub(crate) fn computing(name: String, mut run: impl FnMut() -> Vec<f32> + 'static) -> Self {
        let outputs = run();
        Self { name, outputs, run: Box::new(move || drop(black_box(run()))) }
    }

    /// Creates an entry without outputs to compare.
    pub(crate) fn reading(name: String, mut run: impl FnMut() -> f32 + 'static) -> Self {
        Self { name, outputs: Vec::new(), run: Box::new(move || _ = black_box(run())) }
    }

    fn measure_us(&mut self) -> f64 {
        for _ in 0..WARM {
            (self.run)();
        }
        let start = Instant::now();
        for _ in 0..PASSES {
            (self.run)();
        }
        start.elapsed().as_secs_f64() * 1e6 / PASSES as f64
    }
}

/// Entries that do the same. The outputs are compared with those of the second entry, the times with that of the
/// first.
pub(crate) struct Contest {
    title: String,
    entries: Vec<Entry>,
}

impl Contest {
    pub(crate) fn new(title: &str) -> Self {
        Self { title: title.into(), entries: Vec::new() }
    }

    pub(crate) fn add(&mut self, entry: Entry) {
        self.entries.push(entry);
    }

    /// Measures and prints.
    pub(crate) fn run(mut self, note: &str) {
        let mut us: Vec<Vec<f64>> = vec![Vec::new(); self.entries.len()];
        for _ in 0..ROUNDS {
            for (entry, us) in self.entries.iter_mut().zip(&mut us) {
                us.push(entry.measure_us());
            }
        }
        println!("{} ({note})", self.title);
        println!("{:>8} {:>8}   {:>9} {:>8}   {:32} error", "/ first", "/ second", "median us", "p90 us", "");
        for (entry, own) in self.entries.iter().zip(&us) {
            let ratio = |to: &[f64]| percentile(own.iter().zip(to).map(|(own, to)| own / to).collect(), 0.5);
            let error = match &self.entries[1].outputs {
                want if entry.outputs.is_empty() || want.is_empty() => String::new(),
                want => format!("{:.1e}", error(&entry.outputs, want)),
            };
            let [median, p90] = [0.5, 0.9].map(|p| percentile(own.clone(), p));
            let [first, second] = [0, 1].map(|i| ratio(&us[i.min(us.len() - 1)]));
            println!("{first:8.2} {second:8.2}   {median:9.2} {p90:8.2}   {:32} {error}", entry.name);
        }
        println!();
    }
}

/// Root of the mean squared difference, relative to the range of `want`.
fn error(got: &[f32], want: &[f32]) -> f32 {
    let square: f32 = got.iter().zip(want).map(|(got, want)| (got - want) * (got - want)).sum();
    let (low, high) = want.iter().fold((f32::MAX, f32::MIN), |(low, high), x| (low.min(*x), high.max(*x)));
    (square / want.len() as f32).sqrt() / (high - low)
}

fn percentile(mut values: Vec<f64>, p: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * p) as usize]
}

/// Reads `bytes` once, in order, with the widest loads, into eight sums.
pub(crate) fn stream(bytes: &[u8]) -> f32 {
    struct Stream<'a>(&'a [u8]);
    impl WithSimd for Stream<'_> {
        type Output = f32;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> f32 {
            let (eights, _) = S::as_simd_f32s(bytemuck::cast_slice(self.0)).0.as_chunks::<8>();
            let mut sum = [simd.splat_f32s(0.0); 8];
            for eight in eights {
                for i in 0..8 {
                    sum[i] = simd.add_f32s(sum[i], eight[i]);
                }
            }
            for i in 1..8 {
                sum[0] = simd.add_f32s(sum[0], sum[i]);
            }
            simd.reduce_sum_f32s(sum[0])
        }
    }
    Arch::new().dispatch(Stream(black_box(bytes)))
}
