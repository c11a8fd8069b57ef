//! One frame of a headset as a page reports it.

use super::press::Grasp;
use crate::sight::{Refusal, times};
use messages::SMPL_JOINTS;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// Numbers of a pose: position, quaternion x y z w, and how it is known.
const POSE: usize = 8;
/// Numbers of a hand: its kind, its pose, the distance of a pinch, the trigger and the squeeze.
const HAND: usize = 1 + POSE + 3;
/// Bytes of the two times at the beginning.
const TIMES: usize = 16;
/// Bytes of a message without a body: the times, the stature, the head and both hands.
pub const HEADSET_BYTES: usize = TIMES + 4 * (1 + POSE + 2 * HAND);
/// Bytes of a message with the joints of a body, in the order of SMPL-22.
pub const BODY_BYTES: usize = HEADSET_BYTES + 4 * POSE * SMPL_JOINTS;
/// Largest coordinate, m. Assumption: no room with a headset is larger than 40 m.
const ROOM_M_MAX: f32 = 20.0;
/// Statures of adults, m. Zero stands for an unknown one. Assumption.
const STATURE_M: core::ops::RangeInclusive<f32> = 1.2..=2.2;
/// Largest distance between the tips of thumb and index finger, m. Assumption: a hand spans less than twice that.
const PINCH_M_MAX: f32 = 0.5;
/// Largest error of a quaternion's norm. Browsers send single precision.
const NORM_ERROR_MAX: f64 = 1e-2;
/// How a pose is known: not at all, guessed by the headset, tracked.
const KNOWN: [f32; 3] = [0.0, 0.5, 1.0];

/// A pose that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// Position, m.
    pub position: Vector3<f64>,
    pub rotation: UnitQuaternion<f64>,
    /// 1 if the headset tracks it, 0.5 if the headset guesses it.
    pub confidence: f32,
}

/// Place of a hand that its pose describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandKind {
    /// The wrist of a bare hand: -z points along the hand, y out of its back.
    Wrist,
    /// The grip of a controller, see `person`.
    Grip,
}

/// A hand or the controller in it. Only tracked poses count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// Kind and pose. `None` if it is not tracked.
    pub pose: Option<(HandKind, Tracked)>,
    /// Distance between the tips of thumb and index finger, m.
    pub pinch_m: Option<f32>,
    /// Share by which the trigger is pressed.
    pub trigger: Option<f32>,
    /// Share by which the squeeze button is pressed.
    pub squeeze: Option<f32>,
}

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadsetFrame {
    /// Time at which the page sent the message, on the page's own clock, ms.
    pub sent_ms: f64,
    /// Age of the poses at that time, with the time that the message needs at most, ms.
    pub age_ms: f64,
    /// Stature that the user gave, m.
    pub stature_m: Option<f32>,
    /// The head: the middle between the eyes. -z points ahead.
    pub head: Option<Tracked>,
    /// Left and right.
    pub hands: [Hand; 2],
    /// The joints of SMPL-22. `None` without body tracking.
    pub body: Option<Box<[Option<Tracked>; SMPL_JOINTS]>>,
}

impl HeadsetFrame {
    /// Reads a message. All numbers have the little end first.
    pub fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        if bytes.len() != HEADSET_BYTES && bytes.len() != BODY_BYTES {
            return Err(Refusal::Length);
        }
        let (head, rest) = bytes.split_at(TIMES);
        let [sent_ms, age_ms] = times(head)?;
        let mut numbers = Numbers { rest };
        let stature = numbers.next();
        let stature_m = optional(stature, 0.0, STATURE_M)?;
        let head = numbers.pose()?.filter(is_tracked);
        let hands = [numbers.read_hand()?, numbers.read_hand()?];
        let body = if numbers.rest.is_empty() { None } else { Some(Box::new(numbers.body()?)) };
        Ok(Self { sent_ms, age_ms, stature_m, head, hands, body })
    }
}

/// Returns `None` for `missing`, and the number if it is within its bounds.
fn optional(number: f32, missing: f32, bounds: core::ops::RangeInclusive<f32>) -> Result<Option<f32>, Refusal> {
    if number == missing {
        return Ok(None);
    }
    if bounds.contains(&number) { Ok(Some(number)) } else { Err(Refusal::Number) }
}

fn is_tracked(pose: &Tracked) -> bool {
    pose.confidence >= 1.0
}

/// Reads numbers one after the other. The length was checked before.
struct Numbers<'a> {
    rest: &'a [u8],
}

impl Numbers<'_> {
    /// Returns the next number, and NaN after the last one. NaN is within no bounds.
    fn next(&mut self) -> f32 {
        let Some((number, rest)) = self.rest.split_first_chunk::<4>() else { return f32::NAN };
        self.rest = rest;
        f32::from_le_bytes(*number)
    }

    /// Reads a pose. The numbers of a pose that is not known must be within their bounds too.
    fn pose(&mut self) -> Result<Option<Tracked>, Refusal> {
        let numbers: [f32; POSE] = core::array::from_fn(|_| self.next());
        let [x, y, z, i, j, k, w, confidence] = numbers;
        let is_near = [x, y, z].iter().all(|c| c.abs() <= ROOM_M_MAX);
        if !is_near || !KNOWN.contains(&confidence) {
            return Err(Refusal::Number);
        }
        let [i, j, k, w] = [i, j, k, w].map(f64::from);
        let turn = Quaternion::new(w, i, j, k);
        let is_unit = (turn.norm() - 1.0).abs() <= NORM_ERROR_MAX;
        if !is_unit {
            return Err(Refusal::Number);
        }
        let position = Vector3::new(f64::from(x), f64::from(y), f64::from(z));
        let rotation = UnitQuaternion::new_normalize(turn);
        Ok((confidence > 0.0).then_some(Tracked { position, rotation, confidence }))
    }

    fn read_hand(&mut self) -> Result<Hand, Refusal> {
        let kind = match self.next() {
            0.0 => HandKind::Wrist,
            1.0 => HandKind::Grip,
            _ => return Err(Refusal::Number),
        };
        let pose = self.pose()?.filter(is_tracked).map(|pose| (kind, pose));
        let [pinch, trigger, squeeze] = [self.next(), self.next(), self.next()];
        Ok(Hand {
            pose,
            pinch_m: optional(pinch, -1.0, 0.0..=PINCH_M_MAX)?,
            trigger: optional(trigger, -1.0, 0.0..=1.0)?,
            squeeze: optional(squeeze, -1.0, 0.0..=1.0)?,
        })
    }

    fn body(&mut self) -> Result<[Option<Tracked>; SMPL_JOINTS], Refusal> {
        let mut body = [None; SMPL_JOINTS];
        for joint in &mut body {
            *joint = self.pose()?;
        }
        Ok(body)
    }
}

/// Distance of the tips in a pinch, and in a hand that is open as far as a gripper, m. Assumption: the joints of the
/// tips lie 8 mm below the skin.
const CLOSED_M: f32 = 0.02;
const OPEN_M: f32 = 0.10;

impl Hand {
    /// Returns how far the hand is closed, 0 to 1: by the trigger, or by the pinch of a bare hand.
    pub fn closure(&self) -> Option<f32> {
        match self.pose?.0 {
            HandKind::Grip => self.trigger,
            HandKind::Wrist => self.pinch_m.map(|m| ((OPEN_M - m) / (OPEN_M - CLOSED_M)).clamp(0.0, 1.0)),
        }
    }

    /// Returns how the hand holds the enable. `None` if it is not tracked.
    pub fn grasp(&self) -> Option<Grasp> {
        match self.pose?.0 {
            HandKind::Grip => self.squeeze.map(Grasp::of_squeeze),
            HandKind::Wrist => self.pinch_m.map(Grasp::of_pinch),
        }
    }
}
