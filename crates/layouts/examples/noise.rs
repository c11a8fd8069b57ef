//! Effect of the filter on camera data: the built-in motion at 30 Hz as MediaPipe's world landmarks, with noise.
//! `cargo run --release -p layouts --example noise`.

use layouts::{Layouts, Noise, NoiseState};
use messages::{LIMBS, Layout, RawSkeleton, SkeletonLayout, Stamp};
use skeleton::{Config, Input, State, tick};

/// BlazePose's index of each joint of SMPL-22 that it has.
const JOINTS_MAX: [(usize, usize); 14] = [
    (16, 11),
    (17, 12),
    (18, 13),
    (19, 14),
    (20, 15),
    (21, 16),
    (1, 23),
    (2, 24),
    (4, 25),
    (5, 26),
    (7, 27),
    (8, 28),
    (10, 31),
    (11, 32),
];
/// As in the shipped settings.
const NOISE: Noise =
    Noise { rest_cutoff_hz: 1.5, cutoff_per_m: 10.0, outliers_mad: 3.0, step_max_m: 0.15, confidence_min: 0.5 };

/// Noise with this standard deviation, m. The sum of twelve uniform numbers is nearly normal.
struct Tremble(u64, f32);

impl Tremble {
    fn next(&mut self) -> f32 {
        let sum: f32 = (0..12)
            .map(|_| {
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 40) as f32 / (1 << 24) as f32 - 0.5
            })
            .sum();
        sum * self.1
    }
}

type Limbs = Option<[[f32; 4]; LIMBS]>;

/// Limbs of each accepted frame.
fn play(layouts: &Layouts, bounds: &Config, filter: bool, noise_m: f32) -> Vec<Limbs> {
    let motion = motion::upsample(&motion::builtin());
    let every = (motion.frame_rate_hz / 30.0).round().max(1.0) as usize;
    let (mut tremble, mut noise, mut state) = (Tremble(1, noise_m), NoiseState::default(), State::new());
    let mut out = Vec::new();
    for (i, frame) in motion.frames.iter().step_by(every).enumerate() {
        let mut raw = RawSkeleton { joint_count: 33, layout: SkeletonLayout::MediaPipe33 as u32, ..RawSkeleton::ZERO };
        (raw.header.sequence, raw.header.origin) = (i as u64 + 1, Stamp(1_000_000_000 + i as u64 * 33_333_333));
        for (smpl, landmark) in JOINTS_MAX {
            let [x, y, z] = frame.positions[smpl].map(|x| x + if noise_m > 0.0 { tremble.next() } else { 0.0 });
            (raw.positions[landmark], raw.confidence[landmark]) = ([y, -z, -x], 1.0);
        }
        let mut frame = layouts.convert(&raw).expect("a frame");
        if filter {
            NOISE.filter(&mut noise, raw.layout, &mut frame);
        }
        let now = frame.header.origin.plus_ns(1_000_000);
        out.push(
            tick(bounds, &mut state, now, Input { raw: &frame, stored: None }).skeleton.map(|person| person.limbs),
        );
    }
    out
}

fn angle_deg(a: [f32; 4], b: [f32; 4]) -> f64 {
    let cos: f64 = a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(b)).sum();
    (2.0 * cos.abs().min(1.0).acos()).to_degrees()
}

/// RMS of the angle between the limbs of `a` and `b`, over the frames that have both, degrees.
fn rms(a: &[Limbs], b: &[Limbs]) -> f64 {
    let pairs = a.iter().zip(b).filter_map(|(a, b)| Some((((*a)?), (*b)?)));
    let squares: Vec<f64> =
        pairs.flat_map(|(a, b)| [0, 1, 2, 3].map(|limb| angle_deg(a[limb], b[limb]).powi(2))).collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn main() {
    let layouts = Layouts::default();
    let capture = Config::default();
    let camera = Config { length_change_max: 0.3, length_step_max: 0.15, ..capture };
    let clean = play(&layouts, &camera, false, 0.0);
    let still = play(&layouts, &camera, true, 0.0);
    // The filter's delay is the shift of the clean motion that comes nearest, in frames and linearly between them.
    let lag = (0..6).map(|shift| rms(&clean[..clean.len() - shift], &still[shift..]));
    println!(
        "filtered motion against the clean one shifted by 0 to 5 frames of 33 ms, deg: {:.2?}",
        lag.collect::<Vec<_>>()
    );
    println!("noise mm  bounds   filter   accepted %   step to step deg   error deg");
    for noise_m in [0.0, 0.005, 0.01, 0.02] {
        for (name, bounds) in [("capture", &capture), ("camera", &camera)] {
            for filter in [false, true] {
                let limbs = play(&layouts, bounds, filter, noise_m);
                let accepted = limbs.iter().flatten().count() as f64 / limbs.len() as f64;
                let steps = rms(&limbs[1..], &limbs[..limbs.len() - 1]);
                println!(
                    "{:>8.0}  {name:<8} {:<6} {:>12.1} {steps:>18.2} {:>11.2}",
                    noise_m * 1e3,
                    if filter { "on" } else { "off" },
                    accepted * 100.0,
                    rms(&limbs, &clean),
                );
            }
        }
    }
}
