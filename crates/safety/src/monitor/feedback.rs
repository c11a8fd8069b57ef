//! Whether what is measured can be.

use messages::{JOINTS, TICK_HZ, TICK_S};
use robot::Model;

use super::OUTSIDE_MARGIN;

/// How much faster than its limit a joint may seem to move from one sample to the next; beyond it the encoder jumped.
const JUMP_FACTOR: f64 = 3.0;

/// Ticks for which a measurement may stay the very same while its joint is sent on: 50 ms.
const FROZEN_TICKS: u64 = TICK_HZ / 20;

/// How far a joint is sent before a measurement that stays the very same counts as frozen, rad: less than the tracking
/// error that is borne, more than the friction of a gear holds back. Assumption.
const FROZEN_RAD: f64 = 0.02;

/// How far a joint is sent at the beginning of a motion before its measurement must have followed, rad.
const SENSE_RAD: f64 = 0.015;

/// Share of that way that it must show, unless it comes closer to where the joint is sent. A measurement of the wrong sign
/// shows less than nothing, one of another joint what that joint does.
const SENSE_SHARE: f64 = 0.2;

/// Of a prismatic joint, m for each rad above: its limits of tracking error are a fifth as large.
pub(super) const PRISMATIC_SHARE: f64 = 0.2;

/// A new sample of a robot's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample<'a> {
    /// Its index.
    pub k: u64,
    /// Executed positions, rad or m.
    pub q: &'a [f64; JOINTS],
    /// Executed velocities, rad/s or m/s.
    pub v: &'a [f64; JOINTS],
    /// Executed accelerations, rad/s^2 or m/s^2.
    pub a: &'a [f64; JOINTS],
    /// Measured positions, rad or m.
    pub q_measured: &'a [f64; JOINTS],
    /// Measured velocities as the driver reports them, rad/s or m/s.
    pub dq_measured: &'a [f64; JOINTS],
    /// Engaging begins: the joints must show that they move the way they are sent.
    pub begins: bool,
}

/// What is made of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// The positions to go on with: measured, or those before where this sample alone is off.
    pub q_measured: [f64; JOINTS],
    /// What is measured cannot be.
    pub invalid: bool,
}

/// One joint, as it was.
#[derive(Clone, Copy, Debug, Default)]
struct Before {
    /// Last change of the measurement: its value, where the joint had been sent, and the index.
    held: f64,
    held_sent: f64,
    held_k: u64,
    /// Where the way begins that must be shown: sent and measured.
    sense: Option<(f64, f64)>,
}

/// The memory of the monitor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Feedback {
    /// The last good sample and its index.
    last: Option<([f64; JOINTS], u64)>,
    /// The last sample was off.
    suspect: bool,
    joints: [Before; JOINTS],
}

impl Feedback {
    /// Judges a new sample; to be called once for each. `servo_lag_s` is the known lag of a sound servo, s.
    ///
    /// Off is a joint that moved by more than 3 v_max dt and the margin of noise since the last good sample. One such
    /// sample is passed over, a second in a row is invalid. Invalid is a measurement that stays the very same for 50 ms
    /// while its joint is sent on by 0.02 rad, and one that goes away from where its joint is sent and shows less than a
    /// fifth of the first 0.015 rad of a motion that begins. What is not finite is invalid at once.
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
        for j in 0..JOINTS {
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
        (0..JOINTS).any(|j| moved(j) > JUMP_FACTOR * model.limits[j].v_max * dt_s + OUTSIDE_MARGIN)
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
        // What was away and comes back follows, whichever way it comes: a joint that still swings.
        let comes_back = (measured - sent).abs() <= (measured_from - sent_from).abs();
        !comes_back && (measured - measured_from) * way < SENSE_SHARE * way * way
    }
}
