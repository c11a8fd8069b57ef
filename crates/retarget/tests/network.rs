//! Tests the limits of the networks, and the weights file with every possible error.

use crate::support::{arm, identity, layers};
use retarget::{
    Dense, Layers, Manifest, Network, Weights, WeightsError, interpolate_latent, read_layers, sha256_hex, write_weights,
};

#[test]
fn large_activations_saturate_and_nan_gives_nan() {
    let arm = arm();
    let network = Network::new(&layers(1, 2, 32), &arm);
    for scale in [1e3_f32, 1e10, 1e30] {
        let q = network.decode(&[[scale; 8]])[0];
        assert!((0..5).all(|j| (arm.q_min[j]..=arm.q_max[j]).contains(&q[j])), "{q:?}");
    }
    assert!(network.decode(&[[f32::NAN; 8]])[0].iter().all(|q| q.is_nan()));
    assert!(network.encode_human(&[[f32::NAN; 12]])[0].iter().all(|x| x.is_nan()));
}

#[test]
fn latents_interpolate_on_a_straight_line() {
    let (a, b) = ([1.0; 8], [3.0; 8]);
    assert_eq!(interpolate_latent(&a, &b, 0.0), a);
    assert_eq!(interpolate_latent(&a, &b, 1.0), b);
    assert_eq!(interpolate_latent(&a, &b, 0.25), [1.5; 8]);
}

#[test]
fn written_weights_read_back() {
    let layers = layers(2, 3, 24);
    let (bytes, text) = write_weights(&layers, &Manifest::new(&identity(), &layers)).unwrap();
    let read = Weights::read(&text, &bytes, &identity()).unwrap();
    let read_back = read_layers(&bytes, &read.manifest).unwrap();
    let all = |layers: &Layers| [&layers.human[..], &layers.robot[..], &layers.decoder[..]].concat();
    let rounded = |values: &[f32]| values.iter().copied().map(perceptron::rounded).collect::<Vec<_>>();
    for (read, written) in all(&read_back).iter().zip(all(&layers)) {
        assert_eq!((&read.weight, &read.bias), (&rounded(&written.weight), &rounded(&written.bias)));
    }
    assert_eq!((read.manifest.hidden_layers, read.manifest.hidden_width), (3, 24));
}

/// Name of the error, the words that the message must contain, and the function that causes it.
type Case = (&'static str, &'static str, fn(&mut Vec<u8>, &mut String));

/// Replaces text in the header by text of equal length, and signs the result in the manifest.
fn forge(bytes: &mut [u8], manifest: &mut String, from: &str, to: &str) {
    assert_eq!(from.len(), to.len());
    let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect("in the header");
    bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
    sign(bytes, manifest);
}

fn sign(bytes: &[u8], manifest: &mut String) {
    set(manifest, "sha256", &format!("\"{}\"", sha256_hex(bytes)));
}

/// Replaces the (possibly multi-line) value of a key.
fn set(manifest: &mut String, key: &str, value: &str) {
    let mut table: toml::Table = toml::from_str(manifest).unwrap();
    let parsed: toml::Table = toml::from_str(&format!("{key} = {value}")).unwrap();
    table.insert(key.into(), parsed[key].clone());
    *manifest = toml::to_string(&table).unwrap();
}

/// Sets the bits of the last number, which has 16.
fn set_float(bytes: &mut [u8], manifest: &mut String, bits: u16) {
    let end = bytes.len();
    bytes[end - 2..].copy_from_slice(&bits.to_le_bytes());
    sign(bytes, manifest);
}

const CASES: &[Case] = &[
    ("wrong sha256", "sha256", |bytes, _| *bytes.last_mut().unwrap() ^= 1),
    ("truncated", "tensors", |bytes, m| {
        bytes.truncate(bytes.len() - 4);
        sign(bytes, m);
    }),
    ("empty", "tensors", |bytes, m| {
        bytes.clear();
        sign(bytes, m);
    }),
    ("trailing bytes", "tensors", |bytes, m| {
        bytes.extend([0; 4]);
        sign(bytes, m);
    }),
    ("oversize header", "header has 1048577 bytes", |bytes, m| {
        bytes[..8].copy_from_slice(&1_048_577_u64.to_le_bytes());
        sign(bytes, m);
    }),
    ("header beyond the file", "tensors", |bytes, m| {
        bytes[..8].copy_from_slice(&900_000_u64.to_le_bytes());
        sign(bytes, m);
    }),
    ("other width", "is F16 [36, 16], expected F16 or F32 [24, 24]", |bytes, m| {
        forge(bytes, m, "\"shape\":[24,24]", "\"shape\":[36,16]")
    }),
    ("other type", "I16", |bytes, m| forge(bytes, m, "\"F16\"", "\"I16\"")),
    ("renamed tensor", "is missing", |bytes, m| forge(bytes, m, "human.0.bias", "human.9.bias")),
    ("manifest with fewer layers", "expected F16", |_, m| set(m, "hidden_layers", "2")),
    ("manifest with more layers", "expected F16", |_, m| set(m, "hidden_layers", "4")),
    ("other width in the manifest", "expected F16", |_, m| set(m, "hidden_width", "25")),
    ("no hidden layer", "hidden_layers is 0", |_, m| set(m, "hidden_layers", "0")),
    ("too many layers", "hidden_layers is 17", |_, m| set(m, "hidden_layers", "17")),
    ("too wide", "hidden_width is 561", |_, m| set(m, "hidden_width", "561")),
    ("not a number", "NaN", |bytes, m| set_float(bytes, m, 0x7e00)),
    ("infinite", "inf", |bytes, m| set_float(bytes, m, 0x7c00)),
    ("foreign robot", "robot is \"other\"", |_, m| set(m, "robot", "\"other\"")),
    ("foreign hash", "robot_hash", |_, m| set(m, "robot_hash", "\"feed000000000002\"")),
    ("foreign joints", "joints is", |_, m| set(m, "joints", "['a', 'b', 'c', 'd', 'e']")),
    ("other limits", "mid_rad", |_, m| set(m, "mid_rad", "[0.0, 0.0, 0.0, 0.0, 0.0]")),
    ("limits that are no number", "half_rad", |_, m| set(m, "half_rad", "[nan, 0.0, 0.0, 0.0, 0.0]")),
    ("other latent", "latent is 9", |_, m| set(m, "latent", "9")),
    ("other format", "format is 2", |_, m| set(m, "format", "2")),
    ("unknown key", "unknown field", |_, m| set(m, "speed", "1")),
    ("no manifest", "missing field", |_, m| m.clear()),
    ("no TOML", "manifest", |_, m| m.push_str("= =")),
    ("two tensors in one place", "tensors", |bytes, m| {
        forge(bytes, m, "\"data_offsets\":[48,", "\"data_offsets\":[ 0,")
    }),
    ("a pickle", "tensors", |bytes, m| {
        *bytes = b"\x80\x04\x95\x10\x00\x00\x00\x00\x00\x00\x00\x8c\x05posix\x94".to_vec();
        sign(bytes, m);
    }),
];

#[test]
fn f093_f094_f096_flawed_weights_file_is_refused_with_reason() {
    for (what, words, spoil) in CASES {
        let layers = layers(2, 3, 24);
        let (mut bytes, mut text) = write_weights(&layers, &Manifest::new(&identity(), &layers)).unwrap();
        spoil(&mut bytes, &mut text);
        let error = Weights::read(&text, &bytes, &identity()).expect_err(what).to_string();
        assert!(error.contains(words), "{what}: {error}");
    }
}

#[test]
fn f093_flipped_manifest_bit_is_refused_or_changes_no_network() {
    let layers = layers(2, 1, 8);
    let (bytes, text) = write_weights(&layers, &Manifest::new(&identity(), &layers)).unwrap();
    let latent = [[0.25; 8]];
    let expected = Weights::read(&text, &bytes, &identity()).unwrap().network.decode(&latent);
    let mut refused = 0;
    for at in 0..text.len() {
        for bit in 0..8 {
            let mut flipped = text.clone().into_bytes();
            flipped[at] ^= 1 << bit;
            let read = String::from_utf8(flipped).ok().map(|text| Weights::read(&text, &bytes, &identity()));
            match read {
                Some(Ok(weights)) => assert_eq!(weights.network.decode(&latent), expected, "bit {bit} of byte {at}"),
                _ => refused += 1,
            }
        }
    }
    assert!(refused > 4 * text.len(), "{refused} of {} were refused", 8 * text.len());
}

#[test]
fn f094_network_with_infinite_sums_is_refused() {
    // Finite weights with infinite sums: the fixed inputs show it.
    let mut layers = layers(2, 16, 8);
    for dense in layers.human.iter_mut().chain(&mut layers.decoder) {
        dense.weight.fill(6e4);
    }
    let (bytes, text) = write_weights(&layers, &Manifest::new(&identity(), &layers)).unwrap();
    let error = Weights::read(&text, &bytes, &identity()).unwrap_err();
    assert!(matches!(error, WeightsError::Golden { .. }), "{error}");
}

#[test]
fn f096_tensor_without_layer_is_refused() {
    let mut layers = layers(2, 3, 24);
    let manifest = Manifest::new(&identity(), &layers);
    layers.decoder.push(Dense { inputs: 5, outputs: 1, weight: vec![0.0; 5], bias: vec![0.0] });
    let (bytes, text) = write_weights(&layers, &manifest).unwrap();
    let error = Weights::read(&text, &bytes, &identity()).unwrap_err().to_string();
    assert!(error.contains("decoder.4") && error.contains("belongs to no layer"), "{error}");
}
