//! Effect of outlier rejection on camera data: motions with noise, and with single joints that are 3 to 12 cm off
//! for one frame. `cargo run --release -p layouts --example outliers [-- FOLDER]`. Without a folder of .bvh files
//! it uses the built-in motion alone.

#[path = "../tests/salt.rs"]
mod salt;

use messages::{LIMBS, SMPL_JOINTS};
use salt::{Errors, OFF, ON, Places, distance_m, filter, motions, spoil};
use std::path::PathBuf;

/// End joints of the limbs: shoulders, elbows, wrists.
const BONES: [[usize; 2]; LIMBS] = [[16, 18], [18, 20], [17, 19], [19, 21]];

/// Angle between the directions of a limb in two frames, degrees.
fn angle_deg(a: &Places, b: &Places, [from, to]: [usize; 2]) -> f64 {
    let along = |places: &Places| [0, 1, 2].map(|i| f64::from(places[to][i] - places[from][i]));
    let (a, b) = (along(a), along(b));
    let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    (dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()).clamp(-1.0, 1.0).acos().to_degrees()
}

/// Prints one line: all motions with one kind of noise.
fn line(motions: &[Vec<Places>], rate_hz: f64, noise_m: f32, p: f32) {
    for (name, noise) in [("off", &OFF), ("on", &ON)] {
        let (mut places, mut limbs) = (Errors::default(), Errors::default());
        let (mut held, mut accepted, mut frames) = (0, 0, 0);
        for clean in motions {
            // Compared with the same filter without rejection, so that its delay is no error here.
            let expected = filter(&OFF, clean, rate_hz);
            let got = filter(noise, &spoil(clean, noise_m, p), rate_hz);
            for (a, b) in expected.frames.iter().zip(&got.frames) {
                (0..SMPL_JOINTS).for_each(|joint| places.add(distance_m(a[joint], b[joint])));
                BONES.iter().for_each(|&bone| limbs.add(angle_deg(a, b, bone)));
            }
            (held, accepted, frames) = (held + got.rejected, accepted + got.accepted, frames + clean.len());
        }
        println!(
            "{rate_hz:>7.0} {:>8.0} {:>7.2}  {name:<9} {:>8.1} {:>10.1} {:>9.2} {:>11.2} {:>8.3} {:>10.2}",
            noise_m * 1e3,
            p * 100.0,
            places.rms() * 1e3,
            places.largest * 1e3,
            limbs.rms(),
            limbs.largest,
            100.0 * held as f64 / (frames * SMPL_JOINTS) as f64,
            100.0 * accepted as f64 / frames as f64,
        );
    }
}

fn main() {
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: recorded motions, of which no folder is given");
    }
    println!("rate Hz noise mm  salt %  rejection  RMS mm largest mm  limb deg largest deg   held % accepted %");
    for rate_hz in [30.0, 60.0] {
        let motions = motions(folder.as_deref(), rate_hz);
        for (noise_m, p) in
            [(0.0, 0.0), (0.0, 0.01), (0.005, 0.0), (0.005, 0.01), (0.01, 0.0), (0.01, 0.01), (0.01, 0.03)]
        {
            line(&motions, rate_hz, noise_m, p);
        }
    }
}
