//! Draws from recordings what a person did before and after an instant.

use crate::clips::Clip;
use crate::evaluation::{limbs, turned};
use crate::sampling::normal;
use nalgebra::{UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64;
use retarget::{AGES_S, HORIZONS_S, History, Limbs, PREDICTION_INPUTS, PREDICTION_OUTPUTS, prediction_inputs, turn};

/// Largest factor by which a drawn clip plays faster or slower.
const SPEED: f64 = 1.3;
/// Largest random turn of the torso about the vertical, and about each of the other axes, rad.
const YAW_RAD: f64 = 0.35;
const TILT_RAD: f64 = 0.17;
/// Range of frame rates that a source may have, Hz.
const RATES_HZ: [f64; 2] = [20.0, 240.0];
/// White noise on each limb and axis, rad (half a degree), and the share of the draws that have it.
const NOISE_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
const NOISY_SHARE: f64 = 0.4;

/// Both arms over time, as left arms.
#[derive(Clone, Debug)]
pub struct Recording {
    frames: Vec<[Limbs; 2]>,
    rate_hz: f64,
}

impl Recording {
    pub fn new(clip: &Clip) -> Self {
        Self { frames: clip.frames().map(|arms| arms.map(|arm| limbs(&arm))).collect(), rate_hz: clip.frame_rate_hz }
    }

    /// Time of the last frame, s after the first.
    pub fn end_s(&self) -> f64 {
        self.frames.len().saturating_sub(1) as f64 / self.rate_hz
    }

    /// Interpolates between the frames. Returns the first or last one before or after all of them.
    pub fn at(&self, t_s: f64) -> [Limbs; 2] {
        interpolated(&self.frames, t_s * self.rate_hz)
    }
}

/// Interpolates at an index between the frames. Returns the first or last one before or after all of them.
fn interpolated(frames: &[[Limbs; 2]], index: f64) -> [Limbs; 2] {
    let last = frames.len().saturating_sub(1);
    let index = index.clamp(0.0, last as f64);
    let (from, share) = (index.floor() as usize, index.fract());
    [0, 1].map(|arm| frames[from][arm].slerp(&frames[(from + 1).min(last)][arm], share))
}

/// View of a recording: the newest frame at `at_s`, and `rate_hz` frames a second before it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Time of the newest frame, s of the recording.
    pub at_s: f64,
    pub rate_hz: f64,
    /// Seconds of the recording per second of the view.
    pub speed: f64,
    pub turn: UnitQuaternion<f64>,
    /// Noise of each limb and axis, rad.
    pub noise_rad: f64,
}

impl Seen {
    /// Returns the frames, newest first, back to half a second or to the beginning of the recording.
    pub fn frames(&self, recording: &Recording, rng: &mut Pcg64) -> Vec<[Limbs; 2]> {
        let count = (AGES_S[AGES_S.len() - 1] * self.rate_hz).ceil() as usize + 1;
        let times = (0..count).map(|i| self.at_s - i as f64 / self.rate_hz * self.speed);
        let mut noisy = |limb: UnitQuaternion<f64>| noise(rng, self.noise_rad) * limb;
        let frame = |t_s: f64| {
            turned(&self.turn, &recording.at(t_s)).map(|arm| Limbs { upper: noisy(arm.upper), fore: noisy(arm.fore) })
        };
        times.take_while(|t_s| *t_s >= 0.0).map(frame).collect()
    }

    /// Returns the person `ahead_s` after the newest frame.
    pub fn after(&self, recording: &Recording, ahead_s: f64) -> [Limbs; 2] {
        turned(&self.turn, &recording.at(self.at_s + ahead_s * self.speed))
    }
}

/// Returns the history from which the arm `own` of `frames` is predicted. Before the oldest frame, the oldest
/// frame counts.
pub fn history(frames: &[[Limbs; 2]], rate_hz: f64, own: usize) -> History {
    let first = |arms: &[Limbs; 2]| [arms[own], arms[1 - own]];
    let before = AGES_S.map(|age_s| first(&interpolated(frames, age_s * rate_hz)));
    History { newest: first(&frames[0]), before }
}

/// An arm before an instant and after it.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    pub inputs: [f32; PREDICTION_INPUTS],
    pub outputs: [f32; PREDICTION_OUTPUTS],
}

/// Draws an instant of both arms. `None` if the recordings are shorter than what is predicted.
pub fn rows(recordings: &[Recording], rng: &mut Pcg64) -> Option<[Row; 2]> {
    let longest_s = SPEED * HORIZONS_S[HORIZONS_S.len() - 1];
    let room_s = |recording: &Recording| (recording.end_s() - longest_s).max(0.0);
    let total_s: f64 = recordings.iter().map(room_s).sum();
    let mut at_s = rng.random_range(0.0..total_s.max(f64::MIN_POSITIVE));
    let recording = recordings.iter().find(|recording| {
        let room_s = room_s(recording);
        let here = at_s < room_s;
        at_s -= if here { 0.0 } else { room_s };
        here
    })?;
    let seen = seen(rng, at_s);
    let frames = seen.frames(recording, rng);
    if frames.is_empty() {
        return None;
    }
    Some([0, 1].map(|own| {
        let newest = frames[0][own];
        let turns = HORIZONS_S.iter().flat_map(|horizon_s| {
            let then = seen.after(recording, *horizon_s)[own];
            [turn(&newest.upper, &then.upper), turn(&newest.fore, &then.fore)]
        });
        let mut outputs = [0.0; PREDICTION_OUTPUTS];
        let values = turns.flat_map(|turn| [turn.x, turn.y, turn.z]);
        outputs.iter_mut().zip(values).for_each(|(output, value)| *output = value as f32);
        Row { inputs: prediction_inputs(&history(&frames, seen.rate_hz, own)), outputs }
    }))
}

fn seen(rng: &mut Pcg64, at_s: f64) -> Seen {
    let mut even = |most: f64| rng.random_range(-most..most);
    let turn = UnitQuaternion::from_scaled_axis(Vector3::z() * even(YAW_RAD))
        * UnitQuaternion::from_scaled_axis(Vector3::new(even(TILT_RAD), even(TILT_RAD), 0.0));
    let speed = even(SPEED.ln()).exp();
    let [slowest, fastest] = RATES_HZ;
    let rate_hz = slowest * (fastest / slowest).powf(rng.random_range(0.0..1.0));
    let noise_rad = if rng.random_bool(NOISY_SHARE) { NOISE_RAD } else { 0.0 };
    Seen { at_s, rate_hz, speed, turn, noise_rad }
}

/// Returns a small random rotation, normally distributed about each axis.
fn noise(rng: &mut Pcg64, sigma_rad: f64) -> UnitQuaternion<f64> {
    if sigma_rad == 0.0 {
        return UnitQuaternion::identity();
    }
    UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| normal(rng)) * sigma_rad)
}
