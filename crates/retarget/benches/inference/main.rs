//! Cost of a pass through the networks on this machine, beside other engines and beside reading the same weights
//! once. Each round measures everything in turn, so a busy machine slows all alike. The ratios are medians over
//! rounds. Criterion measures one thing after the other, so it cannot give them. It measures the tick (`tick`).
//!
//! onnxruntime takes part if `ORT_DYLIB_PATH` names its shared library (1.17 or later), for example from the Python
//! package of that name: `onnxruntime/capi/libonnxruntime.so.*`.

mod contest;
mod onnx;
mod peers;
mod protobuf;

use std::process::Command;

use contest::{Contest, Entry};
use ort::environment::Environment;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{Dense, LATENT, Level, Perceptron, Precision};

/// Environment variable from which some libraries read the number of threads, once.
const THREADS: &str = "RAYON_NUM_THREADS";

fn main() {
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    if std::env::var_os(THREADS).is_none() {
        let this = std::env::current_exe().expect("the benchmark knows its path");
        let status = Command::new(this).args(std::env::args_os().skip(1)).env(THREADS, "1").status();
        std::process::exit(status.ok().and_then(|status| status.code()).unwrap_or(1));
    }
    println!("widest vectors: {}; one thread; medians over {} rounds\n", Level::best().name(), contest::ROUNDS);
    let library = onnx::library();
    inference::<88, 14, 1>(library.as_ref(), "88 -> 6x128 -> 8 -> 6x128 -> 14, one pose");
    inference::<12, 5, 1>(library.as_ref(), "12 -> 6x128 -> 8 -> 6x128 -> 5, one arm");
    inference::<12, 5, 2>(library.as_ref(), "12 -> 6x128 -> 8 -> 6x128 -> 5, both arms");
}

/// Measures encoder and decoder in every engine.
fn inference<const I: usize, const O: usize, const N: usize>(library: Option<&Environment>, title: &str) {
    let mut rng = Pcg64::seed_from_u64(1);
    let networks = [network(&mut rng, I, LATENT), network(&mut rng, LATENT, O)];
    let input: [[f32; I]; N] = std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)));
    let mut contest = Contest::new(title);
    for precision in [Precision::F32, Precision::Bf16] {
        let name = if precision == Precision::F32 { "f32" } else { "bf16" };
        for level in Level::available() {
            let packed = networks.each_ref().map(|layers| Perceptron::at_level(layers, precision, level));
            if level.name() == Level::best().name() {
                let packed = packed.clone();
                let bytes: usize = packed.iter().map(|network| network.packed().len()).sum();
                let read = move || packed.iter().map(|network| contest::stream(network.packed())).sum();
                contest.add(Entry::reading(format!("reading {} kB once", bytes / 1000), read));
            }
            let label = format!("retarget {name}, {}", level.name());
            contest.add(Entry::computing(label, move || {
                let latent = packed[0].forward::<I, LATENT, N>(&input);
                packed[1].forward::<LATENT, O, N>(&latent).concat()
            }));
        }
    }
    let layers = networks.concat();
    let input = input.concat();
    if let Some(library) = library {
        contest.add(Entry::computing("onnxruntime".into(), onnx::runtime(library, &networks, &input, N)));
    }
    contest.add(Entry::computing("candle".into(), peers::candle(&networks, &input, N)));
    contest.add(Entry::computing("nalgebra".into(), peers::nalgebra(&networks, &input, N)));
    let weights: usize = layers.iter().map(|layer| layer.weight.len()).sum();
    contest.run(&format!("{weights} weights"));
}

/// A network of 6 x 128 between `inputs` and `outputs`, of unit gain.
fn network(rng: &mut Pcg64, inputs: usize, outputs: usize) -> Vec<Dense> {
    let widths = [inputs, 128, 128, 128, 128, 128, 128, outputs];
    widths.windows(2).map(|width| dense(rng, width[0], width[1])).collect()
}

fn dense(rng: &mut Pcg64, inputs: usize, outputs: usize) -> Dense {
    let scale = (6.0 / inputs as f32).sqrt();
    Dense {
        inputs,
        outputs,
        weight: (0..inputs * outputs).map(|_| rng.random_range(-scale..scale)).collect(),
        bias: (0..outputs).map(|_| rng.random_range(-0.1..0.1)).collect(),
    }
}
