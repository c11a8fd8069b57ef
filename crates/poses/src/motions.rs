//! Eleven named motions, one for each pose or gesture. Each begins and ends with hanging arms.

use crate::person::{ArmPose, reach, standing, with_arms};
use motion::{Frame, Motion};
use std::f64::consts::TAU;

/// Frames per second.
pub const RATE_HZ: f64 = 60.0;

/// Hanging arms, with slightly bent elbows.
const REST: ArmPose = [0.0, 78.0, 0.0, 15.0, 0.0];
const T_POSE: ArmPose = [0.0; 5];
/// Upper arm out, forearm up, and the two ends of a wave.
const WAVE: ArmPose = [12.0, 5.0, -88.0, 80.0, 0.0];
const WAVE_OUT: ArmPose = [12.0, 5.0, -88.0, 55.0, 0.0];
const WAVE_IN: ArmPose = [12.0, 5.0, -88.0, 105.0, 0.0];

/// A pose of both arms, left and right, reached after `seconds`.
#[derive(Clone, Copy)]
struct Key {
    seconds: f64,
    arms: [ArmPose; 2],
}

fn key(seconds: f64, left: ArmPose, right: ArmPose) -> Key {
    Key { seconds, arms: [left, right] }
}

fn both(seconds: f64, arm: ArmPose) -> Key {
    key(seconds, arm, arm)
}

/// Name, key poses between the hanging arms, and the index of the key that the name denotes.
struct Recipe {
    name: &'static str,
    keys: Vec<Key>,
    named: usize,
}

fn recipe(name: &'static str, named: usize, keys: Vec<Key>) -> Recipe {
    Recipe { name, keys, named }
}

/// Moves to a pose, pauses, and moves back.
fn held(name: &'static str, seconds: f64, left: ArmPose, right: ArmPose) -> Recipe {
    recipe(name, 0, vec![key(seconds, left, right), key(0.8, left, right), key(seconds, REST, REST)])
}

/// The hands are given as positions of the middle of the hand from the middle between the shoulders, m: see
/// [`reach`]. The chest's surface is 0.1 m in front of that point. The head's middle is 0.2 m above and 0.05 m
/// in front of it.
fn recipes() -> Vec<Recipe> {
    let up = reach([0.03, 0.24, 0.62], 20.0, 0.0);
    let chest = reach([0.14, 0.07, -0.16], 40.0, 0.0);
    let head = reach([0.05, 0.07, 0.31], 145.0, 0.0);
    let point = reach([0.66, 0.15, -0.02], 20.0, 30.0);
    let (cross_left, cross_right) = (reach([0.17, -0.13, -0.16], 35.0, 0.0), reach([0.22, -0.13, -0.22], 35.0, 0.0));
    let over = reach([0.05, -0.06, 0.56], 150.0, 0.0);
    let hip = reach([0.0, 0.20, -0.42], 155.0, 20.0);
    let guard = reach([0.24, 0.10, 0.0], 20.0, 0.0);
    let punch = reach([0.62, 0.08, 0.0], 40.0, 35.0);
    let (clap, open) = (reach([0.36, 0.015, -0.08], 25.0, 0.0), reach([0.36, 0.17, -0.08], 25.0, 0.0));
    let wave = |left: bool| {
        let arms = |seconds, arm| if left { key(seconds, arm, REST) } else { key(seconds, REST, arm) };
        vec![
            arms(1.5, WAVE),
            arms(0.4, WAVE_OUT),
            arms(0.6, WAVE_IN),
            arms(0.6, WAVE_OUT),
            arms(0.4, WAVE),
            both(1.5, REST),
        ]
    };
    vec![
        held("t-pose", 1.4, T_POSE, T_POSE),
        held("hands-up", 2.2, up, up),
        held("hands-to-chest", 1.6, chest, chest),
        held("hands-on-head", 2.2, head, head),
        recipe("wave-left", 0, wave(true)),
        recipe("wave-right", 0, wave(false)),
        held("point-forward", 1.5, REST, point),
        held("cross-arms", 1.6, cross_left, cross_right),
        recipe(
            "box",
            1,
            vec![
                both(1.0, guard),
                key(0.5, punch, guard),
                key(0.5, guard, guard),
                key(0.5, guard, punch),
                key(0.5, guard, guard),
                both(1.0, REST),
            ],
        ),
        recipe(
            "stretch-sideways",
            0,
            vec![key(1.8, over, hip), key(0.4, over, hip), both(1.4, T_POSE), both(1.3, REST)],
        ),
        recipe(
            "clap",
            1,
            vec![
                both(1.2, open),
                both(0.4, clap),
                both(0.4, open),
                both(0.4, clap),
                both(0.4, open),
                both(0.4, clap),
                both(1.3, REST),
            ],
        ),
    ]
}

/// Pause with hanging arms at the beginning and at the end, s.
const PAUSE_S: f64 = 0.3;

/// Returns the names, in the order of [`paper_motions`].
pub fn names() -> Vec<&'static str> {
    recipes().iter().map(|recipe| recipe.name).collect()
}

/// Returns the eleven motions at 60 Hz, 3 to 6 s each. A person of 1.75 m stands and faces x. Each motion
/// begins and ends with hanging arms, and minimum-jerk blends of the arms' angles join its poses. Calibrate
/// them with `CalibrationMode::Rig` to get the original limb rotations.
pub fn paper_motions() -> Vec<Motion> {
    let standing = standing();
    recipes().iter().map(|recipe| play(recipe, &standing)).collect()
}

/// Returns the pose that a motion's name denotes, or hanging arms for `rest`. None for any other name.
pub fn named_pose(name: &str) -> Option<Frame> {
    let standing = standing();
    if name == "rest" {
        return Some(with_arms(&standing, &[REST; 2]));
    }
    let recipe = recipes().into_iter().find(|recipe| recipe.name == name)?;
    recipe.keys.get(recipe.named).map(|key| with_arms(&standing, &key.arms))
}

/// Returns the minimum-jerk blend 10 t^3 - 15 t^4 + 6 t^5 of t in 0 to 1 (Flash and Hogan 1985).
pub fn minimum_jerk(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

fn play(recipe: &Recipe, standing: &Frame) -> Motion {
    let rest = both(PAUSE_S, REST);
    let keys: Vec<Key> = [rest, rest].into_iter().chain(recipe.keys.iter().copied()).chain([rest]).collect();
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
    Motion::generated(recipe.name, RATE_HZ, frames)
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
