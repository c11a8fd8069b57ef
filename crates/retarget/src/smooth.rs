//! A moving average of what is shown: what was interpolated straight from each skeleton to the next becomes a path without
//! corners, and so do the kinks where a joint meets its limit.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::arm::{ARM_Q, ArmQ, Limbs, align};

/// Longest average, ticks: 50 ms at 1500 Hz.
pub const AVERAGE_TICKS_MAX: usize = 75;
/// Numbers of a posture: the joints and two quaternions.
const NUMBERS: usize = ARM_Q + 8;
/// Sums are of integers, so that what is added is taken away again to the last bit, after any number of ticks: 2^-40.
const GRAIN: f64 = (1_u64 << 40) as f64;
/// Beyond any joint position, rad, and such that no sum overflows.
const NUMBER_MAX: f64 = 1e4;

/// One arm at one tick: the robot's joints and the human limbs that they stand for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posture {
    /// Joint positions, rad.
    pub q: ArmQ,
    /// Limb rotations of a left (or mirrored right) arm.
    pub limbs: Limbs,
}

/// The mean of the last postures of one arm: of joint positions, and of quaternions, made of unit length again. Over one
/// period of a source it turns straight lines from knot to knot into a quadratic B-spline: velocity is continuous, and the
/// acceleration at a knot, which was all in one tick, is the second difference of the knots. Fixed size, no heap.
#[derive(Clone, Debug)]
pub struct Average {
    ring: [[i64; NUMBERS]; AVERAGE_TICKS_MAX],
    sum: [i64; NUMBERS],
    next: usize,
    newest: Option<Limbs>,
    mean: Option<Posture>,
}

impl Default for Average {
    fn default() -> Self {
        Self { ring: [[0; NUMBERS]; AVERAGE_TICKS_MAX], sum: [0; NUMBERS], next: 0, newest: None, mean: None }
    }
}

impl Average {
    /// Takes the posture of one tick; returns the mean of the last `ticks` of them (1 to `AVERAGE_TICKS_MAX`, the same at
    /// every call; before there are so many, the first one stands for those missing).
    pub fn add(&mut self, posture: &Posture, ticks: usize) -> Posture {
        let ticks = ticks.clamp(1, AVERAGE_TICKS_MAX);
        // Signs follow the posture before: q and -q are the same rotation, but not the same number.
        let limbs = self.newest.map_or(posture.limbs, |newest| Limbs {
            upper: align(&posture.limbs.upper, &newest.upper),
            fore: align(&posture.limbs.fore, &newest.fore),
        });
        let numbers = numbers(&posture.q, &limbs);
        if self.newest.replace(limbs).is_none() {
            self.ring = [numbers; AVERAGE_TICKS_MAX];
            self.sum = numbers.map(|number| number * ticks as i64);
        }
        let oldest = (self.next + AVERAGE_TICKS_MAX - ticks) % AVERAGE_TICKS_MAX;
        for (sum, (newest, oldest)) in self.sum.iter_mut().zip(numbers.iter().zip(&self.ring[oldest])) {
            *sum += newest - oldest;
        }
        self.ring[self.next] = numbers;
        self.next = (self.next + 1) % AVERAGE_TICKS_MAX;
        let mean = self.sum.map(|sum| sum as f64 / (ticks as f64 * GRAIN));
        let rotation = |from: usize, otherwise: &UnitQuaternion<f64>| {
            let quaternion = Quaternion::new(mean[from + 3], mean[from], mean[from + 1], mean[from + 2]);
            // Rotations all around have no mean; no person turns a limb so far in 50 ms.
            UnitQuaternion::try_new(quaternion, 0.1).unwrap_or(*otherwise)
        };
        let limbs = Limbs { upper: rotation(ARM_Q, &limbs.upper), fore: rotation(ARM_Q + 4, &limbs.fore) };
        let mean = Posture { q: std::array::from_fn(|j| mean[j]), limbs };
        self.mean = Some(mean);
        mean
    }

    /// What `add` returned last.
    pub fn mean(&self) -> Option<Posture> {
        self.mean
    }
}

fn numbers(q: &ArmQ, limbs: &Limbs) -> [i64; NUMBERS] {
    let mut out = [0; NUMBERS];
    let rotations = limbs.upper.coords.iter().chain(limbs.fore.coords.iter());
    for (out, number) in out.iter_mut().zip(q.iter().chain(rotations)) {
        // A number that is none becomes zero.
        *out = (number.clamp(-NUMBER_MAX, NUMBER_MAX) * GRAIN) as i64;
    }
    out
}
