//! Motions as a camera would see them, with noise and with single joints that are far off for one frame, and their
//! filtered versions. The tests use it.

use layouts::{Noise, NoiseState};
use messages::{Layout, RawSkeleton, SMPL_JOINTS, SkeletonLayout, Stamp, skeleton_flag};
use skeleton::{Config, Input, State, tick};

/// As in the shipped settings.
pub const ON: Noise =
    Noise { rest_cutoff_hz: 1.5, cutoff_per_m: 10.0, outliers_mad: 3.0, step_max_m: 0.15, confidence_min: 0.5 };
/// The same without rejection.
pub const OFF: Noise = Noise { outliers_mad: 0.0, ..ON };

/// Joints of a frame, m.
pub type Places = [[f32; 3]; SMPL_JOINTS];

/// Uniform numbers between 0 and 1, the same each time (Knuth's congruences).
pub struct Chance(pub u64);

impl Chance {
    /// Returns the next number.
    pub fn uniform(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 24) as f32
    }

    /// Number with standard deviation 1. The sum of twelve uniform numbers is nearly normal.
    fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.uniform() - 0.5).sum()
    }

    /// Offset of 3 to 12 cm in any direction, m.
    fn salt(&mut self) -> [f32; 3] {
        let to = [self.normal(), self.normal(), self.normal()];
        let norm = to.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-3);
        let length_m = 0.03 + 0.09 * self.uniform();
        to.map(|x| x / norm * length_m)
    }
}

/// Adds noise of this standard deviation to every coordinate, m. With probability `p` a joint is 3 to 12 cm off.
pub fn spoil(clean: &[Places], noise_m: f32, p: f32) -> Vec<Places> {
    let mut chance = Chance(1);
    let mut spoilt = clean.to_vec();
    for place in spoilt.iter_mut().flatten() {
        let salt = if chance.uniform() < p { chance.salt() } else { [0.0; 3] };
        for (x, salt) in place.iter_mut().zip(salt) {
            *x += noise_m * chance.normal() + salt;
        }
    }
    spoilt
}

/// Result of filtering a motion.
pub struct Filtered {
    /// The frames.
    pub frames: Vec<Places>,
    /// Number of outliers.
    pub rejected: u64,
    /// Number of frames that `skeleton` accepts with both arms, with the bounds for cameras.
    pub accepted: u64,
}

/// Filters a motion.
pub fn filter(noise: &Noise, frames: &[Places], rate_hz: f64) -> Filtered {
    // Bounds of lengths show how steady the filtered frames are. A camera's frames have none: they get those of their session.
    let bounds = Config { length_change_max: 0.3, length_step_max: 0.15, ..Config::default() };
    let (mut past, mut state) = (NoiseState::default(), State::default());
    let (mut out, mut accepted) = (Vec::new(), 0);
    for (i, frame) in frames.iter().enumerate() {
        let mut raw = RawSkeleton { joint_count: SMPL_JOINTS as u32, ..RawSkeleton::ZERO };
        (raw.layout, raw.session_nonce) = (SkeletonLayout::Smpl22 as u32, 1);
        raw.header.sequence = i as u64 + 1;
        raw.header.origin = Stamp(1_000_000_000 + (i as f64 * 1e9 / rate_hz) as u64);
        raw.confidence.fill(1.0);
        raw.positions[..SMPL_JOINTS].copy_from_slice(frame);
        noise.filter(&mut past, SkeletonLayout::MediaPipe33 as u32, &mut raw);
        let mut places = [[0.0; 3]; SMPL_JOINTS];
        places.copy_from_slice(&raw.positions[..SMPL_JOINTS]);
        out.push(places);
        let seen = tick(&bounds, &mut state, raw.header.origin.plus_ns(1_000_000), Input { raw: &raw, stored: None });
        accepted += u64::from(seen.skeleton.is_some_and(|seen| seen.flags & skeleton_flag::ALL == skeleton_flag::ALL));
    }
    Filtered { frames: out, rejected: past.rejected(), accepted }
}

/// Returns the built-in motion at this rate.
pub fn builtin(rate_hz: f64) -> Vec<Places> {
    let motion = motion::upsample(&motion::builtin());
    let every = (motion.frame_rate_hz / rate_hz).round().max(1.0) as usize;
    motion.frames.iter().step_by(every).map(|frame| frame.positions).collect()
}

/// Distance between two positions, m.
pub fn distance_m(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// Root mean square and largest error.
#[derive(Default)]
pub struct Errors {
    squares: f64,
    count: usize,
    /// The largest error.
    pub largest: f64,
}

impl Errors {
    /// Adds an error.
    pub fn add(&mut self, error: f64) {
        self.squares += error * error;
        self.count += 1;
        self.largest = self.largest.max(error);
    }

    /// Root mean square.
    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}
