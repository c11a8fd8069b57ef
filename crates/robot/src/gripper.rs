//! A gripper: its joints, and how fast it may close. Its motion is one number, the closure: 0 is open, 1 is closed.

use crate::error::RobotError;
use crate::file::{HandEntry, Sides};
use crate::model::Source;
use std::ops::RangeInclusive;

/// Bounds of the keys of a hand. A small gripper closes in 50 ms at least, and a palm is no wider than 0.5 m. 500 N break
/// fingers.
const CLOSING_TIME_MS: RangeInclusive<f64> = 50.0..=10_000.0;
const OPENING_M: RangeInclusive<f64> = 0.001..=0.5;
const FORCE_N: RangeInclusive<f64> = 0.1..=500.0;
/// Positions of a finger, rad or m.
const FINGER: RangeInclusive<f64> = -10.0..=10.0;

/// A joint of a finger.
#[derive(Clone, Debug, PartialEq)]
pub struct Finger {
    /// URDF name of the joint.
    pub joint: String,
    /// Position of an open hand, rad or m.
    pub open: f64,
    /// Position of a closed hand, rad or m.
    pub closed: f64,
}

/// The gripper of one hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Gripper {
    /// The robot's controller of the fingers. Empty if it has no name.
    pub controller: String,
    /// The joints of the fingers. They move together.
    pub fingers: Vec<Finger>,
    /// Distance between the fingers of an open hand, m.
    pub opening_m: f64,
    /// Largest force between the fingers, N.
    pub force_max_n: f64,
    /// Largest rate of the closure, 1/s.
    pub speed: f64,
}

impl Gripper {
    /// Returns the closure at which the fingers meet an object of this width, m. 1 if it slips through.
    pub fn closure_at(&self, width_m: f64) -> f64 {
        (1.0 - width_m / self.opening_m).clamp(0.0, 1.0)
    }
}

impl Source<'_> {
    /// Reads the grippers of the left and the right hand. `names` are the commanded joints: none of them is a finger's.
    pub(crate) fn grippers(
        &self,
        hands: Sides<Option<HandEntry>>,
        names: &[String],
    ) -> Result<[Option<Gripper>; 2], RobotError> {
        let read = |side: &str, hand: Option<HandEntry>| hand.map(|hand| self.gripper(side, hand, names)).transpose();
        let grippers = [read("left", hands.left)?, read("right", hands.right)?];
        if let [Some(left), Some(right)] = &grippers
            && let Some(twice) = left.fingers.iter().find(|one| right.fingers.iter().any(|two| one.joint == two.joint))
        {
            return Err(self.value("hands.right", format!("`{}`", twice.joint), "must be no finger of the left hand"));
        }
        Ok(grippers)
    }

    fn gripper(&self, side: &str, hand: HandEntry, names: &[String]) -> Result<Gripper, RobotError> {
        let key = |key: &str| format!("hands.{side}.{key}");
        let within = |name: &str, value: f64, bound: &RangeInclusive<f64>| {
            let refused = || self.value(&key(name), schema::short(value), range(bound));
            bound.contains(&value).then_some(value).ok_or_else(refused)
        };
        let closing_time_ms = within("closing_time_ms", hand.closing_time_ms, &CLOSING_TIME_MS)?;
        let mut fingers = Vec::new();
        let tables = [("rad", hand.open_rad, hand.closed_rad), ("m", hand.open_m, hand.closed_m)];
        for (unit, open, mut closed) in tables {
            for (joint, open) in open {
                let table = format!("closed_{unit}");
                let missing =
                    || self.value(&key(&table), "missing".into(), format!("must have `{joint}`, as open_{unit} has"));
                let closed = closed.remove(&joint).ok_or_else(missing)?;
                let (open, closed) = (within(&joint, open, &FINGER)?, within(&joint, closed, &FINGER)?);
                if names.contains(&joint) {
                    return Err(self.value(
                        &key(&format!("open_{unit}")),
                        format!("`{joint}`"),
                        "must be no commanded joint",
                    ));
                }
                if open == closed || fingers.iter().any(|finger: &Finger| finger.joint == joint) {
                    let bound = "must be there once, and at another position when closed";
                    return Err(self.value(&key(&format!("open_{unit}")), format!("`{joint}`"), bound));
                }
                fingers.push(Finger { joint, open, closed });
            }
            if let Some(joint) = closed.keys().next() {
                let bound = "must have the joints of the open hand alone";
                return Err(self.value(&key(&format!("closed_{unit}")), format!("`{joint}`"), bound));
            }
        }
        if fingers.is_empty() {
            return Err(self.value(&key("open_rad"), "missing".into(), "at least one finger's joint must be given"));
        }
        Ok(Gripper {
            controller: hand.controller,
            fingers,
            opening_m: within("opening_m", hand.opening_m, &OPENING_M)?,
            force_max_n: within("force_max_n", hand.force_max_n, &FORCE_N)?,
            speed: 1e3 / closing_time_ms,
        })
    }
}

fn range(bound: &RangeInclusive<f64>) -> String {
    format!("must be {} to {}", bound.start(), bound.end())
}
