//! Eleven named motions, one for each pose or gesture. Each begins and ends with hanging arms.

use crate::person::{ArmPose, reach, standing, with_arms};
use motion::{Frame, Motion};
use serde::Deserialize;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Frames per second.
pub const RATE_HZ: f64 = 60.0;

/// Name of hanging arms, with slightly bent elbows.
const REST: &str = "rest";

/// A pose of both arms, left and right, reached after `seconds`.
#[derive(Clone, Copy)]
struct Key {
    seconds: f64,
    arms: [ArmPose; 2],
}

/// A motion of `motions.toml`.
#[derive(Deserialize)]
struct Recipe {
    name: String,
    /// Seconds, and names of the left and of the right arm, between the hanging arms.
    keys: Vec<(f64, String, String)>,
    /// Index of the key that the name denotes.
    #[serde(default)]
    named: usize,
}

/// `motions.toml`.
#[derive(Deserialize)]
struct Score {
    motions: Vec<Recipe>,
    angles: HashMap<String, ArmPose>,
    /// Arguments of [`reach`].
    hands: HashMap<String, ([f64; 3], f64, f64)>,
}

/// The motions, and the arms by their names. The arms of `hands` are among `angles`, too.
static SCORE: LazyLock<Score> = LazyLock::new(|| {
    let mut score: Score = toml::from_str(include_str!("motions.toml")).unwrap_or_else(|error| panic!("{error}"));
    let reached =
        score.hands.iter().map(|(name, &(hand_m, swivel, twist))| (name.clone(), reach(hand_m, swivel, twist)));
    score.angles.extend(reached);
    score
});

impl Recipe {
    fn key(&self, index: usize) -> Option<Key> {
        let (seconds, left, right) = self.keys.get(index)?;
        Some(Key { seconds: *seconds, arms: [left, right].map(|arm| SCORE.angles[arm]) })
    }
}

/// Pause with hanging arms at the beginning and at the end, s.
const PAUSE_S: f64 = 0.3;

/// Returns the names, in the order of [`paper_motions`].
pub fn names() -> Vec<&'static str> {
    SCORE.motions.iter().map(|recipe| recipe.name.as_str()).collect()
}

/// Returns the eleven motions at 60 Hz, 3 to 6 s each. A person of 1.75 m stands and faces x. Each motion
/// begins and ends with hanging arms, and minimum-jerk blends of the arms' angles join its poses. Calibrate
/// them with `CalibrationMode::Rig` to get the original limb rotations.
pub fn paper_motions() -> Vec<Motion> {
    let standing = standing();
    SCORE.motions.iter().map(|recipe| play(recipe, &standing)).collect()
}

/// Returns the pose that a motion's name denotes, or hanging arms for `rest`. None for any other name.
pub fn named_pose(name: &str) -> Option<Frame> {
    let standing = standing();
    if name == REST {
        return Some(with_arms(&standing, &[SCORE.angles[REST]; 2]));
    }
    let recipe = SCORE.motions.iter().find(|recipe| recipe.name == name)?;
    recipe.key(recipe.named).map(|key| with_arms(&standing, &key.arms))
}

/// Returns the minimum-jerk blend 10 t^3 - 15 t^4 + 6 t^5 of t in 0 to 1 (Flash and Hogan 1985).
pub fn minimum_jerk(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

fn play(recipe: &Recipe, standing: &Frame) -> Motion {
    let rest = Key { seconds: PAUSE_S, arms: [SCORE.angles[REST]; 2] };
    let keys = (0..recipe.keys.len()).filter_map(|index| recipe.key(index));
    let keys: Vec<Key> = [rest, rest].into_iter().chain(keys).chain([rest]).collect();
    let mut frames = Vec::new();
    for pair in keys.windows(2) {
        let [from, to] = pair else { continue };
        let count = (to.seconds * RATE_HZ).round() as usize;
        for i in 0..count {
            let s = minimum_jerk(i as f64 / count as f64);
            let arms = std::array::from_fn(|side| {
                let (a, b) = (&from.arms[side], &to.arms[side]);
                std::array::from_fn(|j| a[j] + s * (b[j] - a[j]))
            });
            frames.push(with_arms(standing, &arms));
        }
    }
    frames.push(with_arms(standing, &rest.arms));
    sway_all(&mut frames);
    Motion::generated(&recipe.name, RATE_HZ, frames)
}

/// Sways a person once a second.
pub(crate) fn sway(frame: &mut Frame, at_s: f64) {
    motion::sway(frame, at_s * TAU);
}

/// Applies [`sway`] to all frames of a motion at [`RATE_HZ`].
pub(crate) fn sway_all(frames: &mut [Frame]) {
    for (i, frame) in frames.iter_mut().enumerate() {
        sway(frame, i as f64 / RATE_HZ);
    }
}
