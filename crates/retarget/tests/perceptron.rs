//! One perceptron of many shapes, at every vector level and in both precisions, compared with sums in f64.

use crate::support;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use retarget::{Dense, Level, Network, Perceptron, Precision, WIDTH_MAX};
use support::{arm, layers, random_q};

/// Random layers of unit gain.
fn random_layers(seed: u64, widths: &[usize]) -> Vec<Dense> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let dense = |width: &[usize]| {
        let scale = (6.0 / width[0] as f32).sqrt();
        Dense {
            inputs: width[0],
            outputs: width[1],
            weight: (0..width[0] * width[1]).map(|_| rng.random_range(-scale..scale)).collect(),
            bias: (0..width[1]).map(|_| rng.random_range(-0.1..0.1)).collect(),
        }
    };
    widths.windows(2).map(dense).collect()
}

fn reference(layers: &[Dense], input: &[f32]) -> Vec<f64> {
    let mut x: Vec<f64> = input.iter().map(|x| f64::from(*x)).collect();
    for (i, layer) in layers.iter().enumerate() {
        let sum = |o: usize| {
            let row = &layer.weight[o * layer.inputs..(o + 1) * layer.inputs];
            f64::from(layer.bias[o]) + row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>()
        };
        let y: Vec<f64> = (0..layer.outputs).map(sum).collect();
        x = if i + 1 < layers.len() { y.into_iter().map(|y| y / (1.0 + (-y).exp())).collect() } else { y };
    }
    x
}

fn inputs<const I: usize, const N: usize>(seed: u64) -> [[f32; I]; N] {
    let mut rng = Pcg64::seed_from_u64(seed);
    std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Largest difference relative to the largest of `want`, over all pairs.
fn difference(got: &[f32], want: &[f64]) -> f64 {
    let largest = want.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    got.iter().zip(want).fold(0.0, |m: f64, (got, want)| m.max((f64::from(*got) - want).abs())) / largest
}

/// Checks every level and precision, with one input alone and three at once.
fn check<const I: usize, const O: usize>(hidden: &[usize]) {
    let widths = [&[I], hidden, &[O]].concat();
    let layers = random_layers(widths.iter().sum::<usize>() as u64, &widths);
    for (precision, bound) in [(Precision::F32, 1e-5), (Precision::Bf16, 3e-2)] {
        let mut fused: Option<[[f32; O]; 3]> = None;
        for level in Level::available() {
            let network = Perceptron::at_level(&layers, precision, level);
            assert_eq!((network.inputs(), network.outputs(), network.precision()), (I, O, precision));
            let input = inputs::<I, 3>(7);
            let output = network.forward::<I, O, 3>(&input);
            let name = format!("{widths:?} {precision:?} {}", level.name());
            for n in 0..3 {
                let off = difference(&output[n], &reference(&layers, &input[n]));
                assert!(off < bound, "{name}: off by {off:e}");
                assert_eq!(network.forward::<I, O, 1>(&[input[n]])[0], output[n], "{name}: one alone");
            }
            assert_eq!(network.forward::<I, O, 2>(&[input[2], input[1]]), [output[2], output[1]], "{name}: two");
            match fused {
                Some(first) if level.name() == "portable" => {
                    let want: Vec<f64> = first.as_flattened().iter().map(|x| f64::from(*x)).collect();
                    let off = difference(output.as_flattened(), &want);
                    assert!(off < 1e-5, "{name}: off from the widest level by {off:e}");
                }
                Some(first) => assert_eq!(output, first, "{name}: same bits as the widest level"),
                None => fused = Some(output),
            }
        }
    }
}

#[test]
fn networks_of_all_sizes_match_f64_sums_at_every_level() {
    check::<12, 8>(&[128; 6]);
    check::<5, 8>(&[128; 6]);
    check::<8, 5>(&[128; 6]);
    check::<88, 8>(&[128; 6]);
    check::<8, 14>(&[128; 6]);
    check::<24, 8>(&[64; 3]);
    check::<16, 8>(&[100, 36]);
    check::<8, 10>(&[256, 256]);
    check::<1, 1>(&[]);
    check::<1, 1>(&[1]);
    check::<3, 17>(&[]);
    check::<7, 33>(&[2, 47, 31]);
    check::<{ WIDTH_MAX }, { WIDTH_MAX }>(&[16]);
    check::<129, 3>(&[WIDTH_MAX, 15]);
    check::<2, 1>(&[8; 40]);
}

#[test]
fn bf16_is_within_one_percent_of_f32() {
    let (mut square, mut count, mut low, mut high) = (0.0, 0, f32::MAX, f32::MIN);
    for seed in 0..4 {
        let layers = random_layers(seed, &[88, 128, 128, 128, 128, 128, 128, 8]);
        let exact = Perceptron::new(&layers, Precision::F32);
        let rounded = Perceptron::new(&layers, Precision::Bf16);
        assert!(rounded.packed().len() * 10 < exact.packed().len() * 6, "about half the bytes");
        for i in 0..200 {
            let input = inputs::<88, 1>(i);
            let (want, got) = (exact.forward::<88, 8, 1>(&input)[0], rounded.forward::<88, 8, 1>(&input)[0]);
            for (want, got) in want.into_iter().zip(got) {
                square += f64::from(got - want).powi(2);
                count += 1;
                (low, high) = (low.min(want), high.max(want));
            }
        }
    }
    let rms = (square / f64::from(count)).sqrt() / f64::from(high - low);
    assert!(rms < 0.01 && rms > 1e-5, "{rms:e} of the range");
}

#[test]
fn arm_networks_match_at_every_level_and_precision() {
    let (arm, layers) = (arm(), layers(3, 6, 128));
    let mut rng = Pcg64::seed_from_u64(5);
    for _ in 0..20 {
        let q = [random_q(&mut rng, &arm), random_q(&mut rng, &arm)];
        let exact = Network::new(&layers, &arm);
        let want = exact.decode(&exact.encode_robot(&q));
        for level in Level::available() {
            for (precision, bound) in [(Precision::F32, 1e-4), (Precision::Bf16, 0.1)] {
                let network = Network::at_level(&layers, &arm, precision, level);
                let got = network.decode(&network.encode_robot(&q));
                let off = (0..10).map(|i| (got[i / 5][i % 5] - want[i / 5][i % 5]).abs()).fold(0.0, f64::max);
                assert!(off < bound, "{precision:?} {}: off by {off} rad", level.name());
            }
        }
    }
}

#[test]
fn silu_matches_formula_and_passes_nan_and_infinity() {
    // y = silu(x), by a layer and an output of weight one.
    let one = || Dense { inputs: 1, outputs: 1, weight: vec![1.0], bias: vec![0.0] };
    for level in Level::available() {
        let silu =
            |x: f32| Perceptron::at_level(&[one(), one()], Precision::F32, level).forward::<1, 1, 1>(&[[x]])[0][0];
        for i in -40_000..=40_000 {
            let x = i as f32 * 2e-3;
            let want = f64::from(x) / (1.0 + f64::from(-x).exp());
            let off = (f64::from(silu(x)) - want).abs();
            let bound = if level.name() == "portable" { 1e-5 } else { 2e-6 };
            assert!(off <= bound * want.abs(), "silu({x}) is off by {off:e}, {}", level.name());
        }
        assert_eq!(silu(1e30), 1e30);
        assert!((-1e-7..=0.0).contains(&silu(-1e30)));
        assert_eq!(silu(f32::INFINITY), f32::INFINITY);
        assert!(silu(f32::NAN).is_nan());
    }
}

#[test]
fn forward_with_wrong_sizes_gives_nan() {
    let network = Perceptron::new(&random_layers(1, &[4, 20, 3]), Precision::F32);
    assert!(network.forward::<4, 3, 1>(&[[0.5; 4]])[0].iter().all(|x| x.is_finite()));
    assert!(network.forward::<5, 3, 1>(&[[0.5; 5]])[0].iter().all(|x| x.is_nan()));
    assert!(network.forward::<4, 2, 2>(&[[0.5; 4]; 2]).as_flattened().iter().all(|x| x.is_nan()));
}

#[test]
fn layers_with_wrong_sizes_panic_when_packed() {
    let good = || random_layers(1, &[4, 20, 3]);
    type Spoil = fn(&mut Vec<Dense>);
    let cases: [(&str, Spoil); 7] = [
        ("no layer", |layers| layers.clear()),
        ("a gap", |layers| layers[1].inputs = 19),
        ("too few weights", |layers| layers[0].weight.truncate(79)),
        ("too many biases", |layers| layers[1].bias.push(0.0)),
        ("no output", |layers| layers[1] = Dense { inputs: 20, ..Dense::default() }),
        ("no input", |layers| layers[0] = Dense { outputs: 20, bias: vec![0.0; 20], ..Dense::default() }),
        ("too wide", |layers| *layers = random_layers(1, &[4, WIDTH_MAX + 1, 3])),
    ];
    Perceptron::new(&good(), Precision::F32);
    for (what, spoil) in cases {
        let mut layers = good();
        spoil(&mut layers);
        let packed = std::panic::catch_unwind(|| Perceptron::new(&layers, Precision::Bf16));
        assert!(packed.is_err(), "{what} was accepted");
    }
}
