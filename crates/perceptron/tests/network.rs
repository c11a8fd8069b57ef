//! One perceptron of many shapes, at every vector level, compared with `plain`, sums in f64.

use perceptron::{Dense, Level, Perceptron, WIDTH_MAX, plain};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

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

fn inputs<const I: usize, const N: usize>(seed: u64) -> [[f32; I]; N] {
    let mut rng = Pcg64::seed_from_u64(seed);
    std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0)))
}

/// Largest difference relative to the largest of `want`, over all pairs.
fn difference(got: &[f32], want: &[f64]) -> f64 {
    let largest = want.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    got.iter().zip(want).fold(0.0, |m: f64, (got, want)| m.max((f64::from(*got) - want).abs())) / largest
}

/// Checks every level, with one input alone and three at once.
fn check<const I: usize, const O: usize>(hidden: &[usize]) {
    let widths = [&[I], hidden, &[O]].concat();
    let layers = random_layers(widths.iter().sum::<usize>() as u64, &widths);
    let mut fused: Option<[[f32; O]; 3]> = None;
    for level in Level::available() {
        let network = Perceptron::at_level(&layers, level);
        assert_eq!((network.inputs(), network.outputs()), (I, O));
        let input = inputs::<I, 3>(7);
        let output = network.forward::<I, O, 3>(&input);
        let name = format!("{widths:?} {}", level.name());
        for n in 0..3 {
            let off = difference(&output[n], &plain(&layers, &input[n].map(f64::from)));
            assert!(off < 1e-5, "{name}: off by {off:e}");
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
fn silu_matches_formula_and_passes_nan_and_infinity() {
    // y = silu(x), by a layer and an output of weight one.
    let one = || Dense { inputs: 1, outputs: 1, weight: vec![1.0], bias: vec![0.0] };
    for level in Level::available() {
        let silu = |x: f32| Perceptron::at_level(&[one(), one()], level).forward::<1, 1, 1>(&[[x]])[0][0];
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
    let network = Perceptron::new(&random_layers(1, &[4, 20, 3]));
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
    Perceptron::new(&good());
    for (what, spoil) in cases {
        let mut layers = good();
        spoil(&mut layers);
        let packed = std::panic::catch_unwind(|| Perceptron::new(&layers));
        assert!(packed.is_err(), "{what} was accepted");
    }
}
