//! Checks whether the measurements are plausible.

use messages::{JOINTS_MAX, TICK_HZ, TICK_S};
use robot::Model;

use super::OUTSIDE_MARGIN;

/// Largest apparent speed of a joint between two samples, as a multiple of its speed limit. A faster joint
/// means that the encoder jumped.
const JUMP_FACTOR: f64 = 3.0;

/// Number of ticks for which a measurement may stay exactly the same while its joint is commanded to move: 50 ms.
const FROZEN_TICKS: u64 = TICK_HZ / 20;

/// Commanded motion after which a measurement that stays exactly the same counts as frozen, rad. It is less
/// than the tolerated tracking error, and more than the friction of a gear holds back. Assumption.
const FROZEN_RAD: f64 = 0.02;

/// Commanded motion at the beginning of a movement after which the measurement must have followed, rad.
const SENSE_RAD: f64 = 0.015;

/// Share of that motion that the measurement must show, unless it comes closer to the commanded position. A measurement
/// with the wrong sign shows less than nothing. A measurement of another joint shows that joint's motion.
const SENSE_SHARE: f64 = 0.2;

/// Bound of a prismatic joint in m for each rad above. Its limits of tracking error are a fifth as large.
pub(super) const PRISMATIC_SHARE: f64 = 0.2;

/// A new sample of a robot's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<'a> {
    /// Its index.
    pub k: u64,
    /// Executed positions, rad or m.
    pub q: &'a [f64; JOINTS_MAX],
    /// Executed velocities, rad/s or m/s.
    pub v: &'a [f64; JOINTS_MAX],
    /// Executed accelerations, rad/s^2 or m/s^2.
    pub a: &'a [f64; JOINTS_MAX],
    /// Measured positions, rad or m.
    pub q_measured: &'a [f64; JOINTS_MAX],
    /// Measured velocities as the driver reports them, rad/s or m/s.
    pub dq_measured: &'a [f64; JOINTS_MAX],
    /// Engaging begins, so the joints must show that they move in the commanded direction.
    pub begins: bool,
}

/// The result for a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Positions to use: the measured ones, or those of the last good sample if only this sample is an outlier.
    pub q_measured: [f64; JOINTS_MAX],
    /// The measurements are implausible.
    pub invalid: bool,
}

/// State of one joint.
#[derive(Clone, Copy, Debug, Default)]
struct Before {
    /// The last change of the measurement: its value, the position commanded then, and the index.
    held: f64,
    held_sent: f64,
    held_k: u64,
    /// The commanded and the measured position where the motion to be shown begins.
    sense: Option<(f64, f64)>,
}

/// State of the monitor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Feedback {
    /// The last good sample and its index.
    last: Option<([f64; JOINTS_MAX], u64)>,
    /// The last sample was an outlier.
    suspect: bool,
    joints: [Before; JOINTS_MAX],
}

impl Feedback {
    /// Judges a new sample. Call it once for each sample. `servo_lag_s` is the known lag of a sound servo, s.
    ///
    /// - A sample is an outlier if a joint moved by more than 3 v_max dt plus the noise margin since the last
    ///   good sample. One outlier is skipped. A second one in a row is invalid.
    /// - A measurement is invalid if it stays exactly the same for 50 ms while its joint is commanded to move
    ///   by 0.02 rad.
    /// - When a motion begins, a measurement is invalid if it moves away from the commanded position and
    ///   shows less than a fifth of the first 0.015 rad.
    /// - A value that is not finite is invalid at once.
    pub fn judge(&mut self, model: &Model, sample: &Sample<'_>, servo_lag_s: f64) -> Judged {
        if !sample.q_measured.iter().all(|q| q.is_finite()) {
            self.last = None;
            return Judged { q_measured: *sample.q_measured, invalid: true };
        }
        let off = self.is_off(model, sample);
        if let (true, false, Some((last, _))) = (off, self.suspect, self.last) {
            self.suspect = true;
            return Judged { q_measured: last, invalid: false };
        }
        self.suspect = false;
        self.last = Some((*sample.q_measured, sample.k));
        let mut invalid = off;
        for j in 0..model.count {
            let sent = sample.q[j] - servo_lag_s * sample.v[j];
            let scale = if model.prismatic[j] { PRISMATIC_SHARE } else { 1.0 };
            let joint = &mut self.joints[j];
            invalid |= joint.is_frozen(sample.k, sent, sample.q_measured[j], scale * FROZEN_RAD);
            invalid |= joint.is_senseless(sample.begins, sent, sample.q_measured[j], scale * SENSE_RAD);
        }
        Judged { q_measured: *sample.q_measured, invalid }
    }

    fn is_off(&self, model: &Model, sample: &Sample<'_>) -> bool {
        let Some((last, k)) = self.last else { return false };
        let dt_s = sample.k.saturating_sub(k).max(1) as f64 * TICK_S;
        let moved = |j: usize| (sample.q_measured[j] - last[j]).abs();
        (0..model.count).any(|j| moved(j) > JUMP_FACTOR * model.limits[j].v_max * dt_s + OUTSIDE_MARGIN)
    }
}

impl Before {
    fn is_frozen(&mut self, k: u64, sent: f64, measured: f64, travel: f64) -> bool {
        if measured != self.held || k < self.held_k {
            (self.held, self.held_sent, self.held_k) = (measured, sent, k);
        }
        k - self.held_k >= FROZEN_TICKS && (sent - self.held_sent).abs() > travel
    }

    fn is_senseless(&mut self, begins: bool, sent: f64, measured: f64, travel: f64) -> bool {
        if !begins {
            self.sense = None;
            return false;
        }
        let (sent_from, measured_from) = *self.sense.get_or_insert((sent, measured));
        let way = sent - sent_from;
        if way.abs() < travel {
            return false;
        }
        self.sense = Some((sent, measured));
        // A joint that was away and comes back does follow, from any side. It is a joint that still swings.
        let comes_back = (measured - sent).abs() <= (measured_from - sent_from).abs();
        !comes_back && (measured - measured_from) * way < SENSE_SHARE * way * way
    }
}
