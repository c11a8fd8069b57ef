//! Whether the measured joints move as they are sent, and whether they stand.

use messages::{JOINTS, TICK_HZ, TICK_S};
use robot::Model;

use super::feedback::{PRISMATIC_SHARE, Sample};

/// Ticks between the two positions whose difference is a measured speed: 20 ms. One step of an encoder of 14 bits,
/// 3.8e-4 rad, is 0.02 rad/s over it. A swing of frequency f shows sin(pi f W) / (pi f W) of its speed: 0.94 at 10 Hz, 0.76
/// at 20 Hz, nothing at 50 Hz, where no drive of such a robot swings.
const WINDOW_TICKS: u64 = TICK_HZ / 50;

/// Entries of the window, at most one for each tick: both ends, and the one that is just too old.
const WINDOW: usize = WINDOW_TICKS as usize + 2;

/// Time constant of the leaky mean square by which the robot is stopped, s. A quarter of a second holds a whole swing of 4 Hz, and half a swing of 2 Hz.
const MEAN_S: f64 = 0.25;

/// Speeds are judged as shares of a joint's largest speed, of one that turns faster than this as shares of this, rad/s: how
/// far a servo strays has to do with how it is driven, not with how fast the joint may turn. Assumption: an elbow's swing of
/// 46 mrad at 1 Hz is too much whatever the limit.
const JUDGED_RAD_PER_S: f64 = 0.82;

/// Root mean square of measured less sent speed that stops, as a share of the speed above. A sound servo stays below: an
/// unknown lag of 10 ms at full acceleration (10 rad/s^2) is 0.1 rad/s for at most half a second in a reversal, friction that
/// gives way by 3 mrad in 50 ms is 0.06 rad/s for that time. Together they are half of what stops, 0.2 rad/s over a mean.
const ERROR_SHARE: f64 = 0.25;

/// Root mean square of measured less sent speed below which a joint is at rest: half of it, so that what has just stopped the
/// robot does not count as rest. The noise of the simulated encoders, 4.8e-5 m, is 0.0034 m/s over the window, and the torso's
/// bound is 0.0088 m/s.
const REST_SHARE: f64 = ERROR_SHARE / 2.0;

/// Time constant of the mean squares by which rest is judged, s: a joint that was off by all of its speed is below the bound
/// after 50 ms ln(64) = 0.2 s.
const REST_MEAN_S: f64 = 0.05;

/// A joint that is measured faster than this share of its largest speed is too fast: commands end at 1. A servo overshoots by
/// some percent, and the noise of the torso's speed is 0.05.
const FAST_SHARE: f64 = 1.25;

/// How long a joint must be too fast by its positions, and by its positions and the reported velocity, s. Samples in a row
/// besides: one wrong position is at both ends of the window once, and never three times in a row.
const FAST_S: f64 = 0.010;
const FAST_REPORTED_S: f64 = 0.002;
const FAST_SAMPLES: u32 = 3;

/// The longest time that one sample counts for, s. With it one wrong sample adds the square of the speed above times 10 ms / 250 ms at most,
/// which is 0.04 where 0.0625 stops, however long the measurement was missing.
const COUNTED_MAX_S: f64 = 0.010;

/// How long each joint must have kept its band before the robot is at rest, s.
const REST_S: f64 = 0.1;
/// The band, rad: over 100 ms it is a mean speed of 0.05 rad/s.
const REST_RAD: f64 = 0.005;

/// How far a joint may be measured from where it came to rest, rad: what friction and a servo's integral part still move it is
/// some mrad, and the tracking error that is borne is 0.05.
const PLACE_RAD: f64 = 0.02;

/// How long a joint must be there, s, and for how many samples in a row, of which one may be wrong.
const FAR_S: f64 = 0.010;
const FAR_SAMPLES: u32 = 3;

/// How long the command may rest without the robot, s: a servo of 5 Hz with a damping ratio of 0.2 settles to 2 % in
/// 4 / (0.2 2 pi 5 Hz) = 0.64 s, the mean square takes 0.2 s to show it, and rest 0.1 s. That twice.
const SETTLE_S: f64 = 2.0;

/// How long a robot that left its place must stand before another place counts, s. It may then move no faster than the band in
/// this time, 5 mrad/s, so that an arm that sinks slowly does not count as standing again and again.
const STAND_AGAIN_S: f64 = 1.0;

/// The largest speed or acceleration of a command at rest, rad/s, rad/s^2, m/s or m/s^2; as the driver judges the end of a plan.
const COMMAND_REST: f64 = 1e-7;

/// What is made of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// By how much the sample is newer than the one before, ns.
    pub sample_ns: u64,
    /// The joint that moves too fast, or otherwise than it is sent.
    pub velocity_error: Option<usize>,
    /// The joint that has left the place where it came to rest, or does not come to rest.
    pub standstill_lost: Option<usize>,
    /// The command rests, and every joint does by its positions and by its reported velocity.
    pub at_rest: bool,
    /// The joint that has been standing for the shortest time, or does not stand.
    pub restless: usize,
}

/// A sample of the window: measured positions, and the way that the joints were sent since the window began.
#[derive(Clone, Copy, Debug)]
struct Entry {
    k: u64,
    q: [f64; JOINTS],
    sent: [f64; JOINTS],
}

/// One joint.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    /// Leaky mean square of measured less sent speed that stops.
    error_square: f64,
    /// Those of a short time, by positions and as reported, by which rest is judged.
    rest_square: f64,
    reported_square: f64,
    /// For how long it has been too fast.
    fast: Lasting,
    /// The middle of its band, and for how long it has kept it.
    band: f64,
    still_s: f64,
}

/// For how long something has been so, in time and in samples in a row.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting {
    time_s: f64,
    samples: u32,
}

impl Lasting {
    fn note(&mut self, is_so: bool, counted_s: f64) {
        let more = Self { time_s: self.time_s + counted_s, samples: self.samples.saturating_add(1) };
        *self = if is_so { more } else { Self::default() };
    }

    fn is_for(&self, time_s: f64, samples: u32) -> bool {
        self.time_s >= time_s && self.samples >= samples
    }
}

/// The memory of the monitor.
#[derive(Clone, Debug)]
pub struct Movement {
    window: [Entry; WINDOW],
    oldest: usize,
    filled: usize,
    /// Speed that was sent at the newest sample, and the way since the window began.
    v_sent: [f64; JOINTS],
    sent: [f64; JOINTS],
    joints: [Joint; JOINTS],
    /// For how long the command has been resting without the robot, s.
    unsettled_s: f64,
    /// Where the robot came to rest, and for how long it has been measured far from there.
    place: Option<[f64; JOINTS]>,
    far: Lasting,
    moved: Moved,
}

impl Default for Movement {
    fn default() -> Self {
        Self {
            window: [Entry { k: 0, q: [0.0; JOINTS], sent: [0.0; JOINTS] }; WINDOW],
            oldest: 0,
            filled: 0,
            v_sent: [0.0; JOINTS],
            sent: [0.0; JOINTS],
            joints: [Joint::default(); JOINTS],
            unsettled_s: 0.0,
            place: None,
            far: Lasting::default(),
            moved: Moved::default(),
        }
    }
}

/// Bound of a joint, from that of a joint that turns.
fn scaled(model: &Model, joint: usize, bound_rad: f64) -> f64 {
    if model.prismatic[joint] { PRISMATIC_SHARE * bound_rad } else { bound_rad }
}

/// The speed of which what a joint strays is a share, rad/s or m/s.
fn judged(model: &Model, joint: usize) -> f64 {
    let v_max = model.limits[joint].v_max;
    if model.prismatic[joint] { v_max } else { v_max.min(JUDGED_RAD_PER_S) }
}

impl Movement {
    /// Judges a new sample; to be called once for each. `servo_lag_s` is the known lag of a sound servo, s. Time is the
    /// distance of the samples' indices, so nothing is made of how late one is.
    ///
    /// With e the measured less the sent mean speed over W = 20 ms, not above s (v_max, or 0.82 rad/s if that is less), the
    /// mean square E follows dE/dt = (e^2 - E) / 0.25 s, and E > (0.25 s)^2 is a velocity error. A swing A sin(2 pi f t) about where the joint is
    /// sent has E = (2 pi f A)^2 / 2 times the square of what the window shows. It is therefore seen if its amplitude is above
    /// 0.25 s sqrt(2) / (2 pi f) over what the window shows: 46 mrad at 1 Hz, 12 mrad at 4 Hz, 3 mrad at 20 Hz for 0.82 rad/s.
    /// Faster than 1.25 v_max for 10 ms is one too, whatever is sent; for 2 ms where the reported velocity agrees.
    ///
    /// A measured position or a sent speed that is not finite is a velocity error at once. Everything before it is forgotten.
    pub fn judge(&mut self, model: &Model, sample: &Sample<'_>, servo_lag_s: f64) -> Moved {
        let finite = |j: &usize| [sample.q_measured, sample.v, sample.a].iter().all(|x| x[*j].is_finite());
        if let Some(joint) = (0..JOINTS).find(|j| !finite(j)) {
            let lost = Moved { velocity_error: Some(joint), restless: joint, ..Moved::default() };
            *self = Self { moved: lost, ..Self::default() };
            return lost;
        }
        let newest = self.newest();
        let v_sent = core::array::from_fn(|j| sample.v[j] - servo_lag_s * sample.a[j]);
        let ticks = match newest {
            Some(k) if k <= sample.k => sample.k - k,
            // The first, or one of another driver.
            _ => {
                *self = Self { v_sent, ..Self::default() };
                0
            }
        };
        if ticks == 0 && self.filled > 0 {
            self.moved.sample_ns = 0;
            return self.moved;
        }
        let dt_s = ticks as f64 * TICK_S;
        for (way, (before, now)) in self.sent.iter_mut().zip(self.v_sent.iter().zip(&v_sent)) {
            *way += (before + now) / 2.0 * dt_s;
        }
        self.v_sent = v_sent;
        self.remember(Entry { k: sample.k, q: *sample.q_measured, sent: self.sent });
        let velocity_error = self.speeds(model, sample, dt_s.min(COUNTED_MAX_S));
        let stands = self.standstill(model, sample, dt_s.min(COUNTED_MAX_S));
        self.moved = Moved {
            sample_ns: ticks.saturating_mul(1_000_000_000) / TICK_HZ,
            velocity_error,
            at_rest: stands.at_rest && velocity_error.is_none(),
            ..stands
        };
        self.moved
    }

    /// Index of the newest sample.
    fn newest(&self) -> Option<u64> {
        let last = self.filled.checked_sub(1)?;
        Some(self.window[(self.oldest + last) % WINDOW].k)
    }

    /// Takes a sample into the window, whose oldest is then the newest of those that are a window old.
    fn remember(&mut self, entry: Entry) {
        if self.filled == WINDOW {
            self.drop_oldest();
        }
        self.window[(self.oldest + self.filled) % WINDOW] = entry;
        self.filled += 1;
        while self.filled > 1 && self.window[(self.oldest + 1) % WINDOW].k + WINDOW_TICKS <= entry.k {
            self.drop_oldest();
        }
    }

    fn drop_oldest(&mut self) {
        self.oldest = (self.oldest + 1) % WINDOW;
        self.filled -= 1;
    }

    /// Compares measured with sent speeds; answers the joint that is worst of those that are too fast or too far off.
    fn speeds(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Option<usize> {
        let from = self.window[self.oldest];
        let span = sample.k - from.k;
        if span < WINDOW_TICKS {
            return None;
        }
        let span_s = span as f64 * TICK_S;
        let mut worst: Option<(usize, f64)> = None;
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let (v_max, judged) = (model.limits[j].v_max, judged(model, j));
            let measured = (sample.q_measured[j] - from.q[j]) / span_s;
            let sent = (self.sent[j] - from.sent[j]) / span_s;
            let reported = sample.dq_measured[j] - self.v_sent[j];
            leak(&mut joint.error_square, measured - sent, judged, counted_s / MEAN_S);
            leak(&mut joint.rest_square, measured - sent, judged, counted_s / REST_MEAN_S);
            leak(&mut joint.reported_square, reported, judged, counted_s / REST_MEAN_S);
            let share = joint.error_square.sqrt() / judged;
            let off = share > ERROR_SHARE || joint.is_fast(measured, sample.dq_measured[j], v_max, counted_s);
            if off && worst.is_none_or(|(_, most)| share > most) {
                worst = Some((j, share));
            }
        }
        worst.map(|(joint, _)| joint)
    }

    /// Judges whether the robot stands where it came to rest. Positions decide; the reported velocity may only deny rest, so one
    /// that is wrong lets nothing begin, and stops nothing.
    fn standstill(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Moved {
        let command_rests = sample.v.iter().chain(sample.a).all(|x| x.abs() <= COMMAND_REST);
        let (mut still_s, mut restless) = (f64::INFINITY, 0);
        let (mut swings, mut reported) = (None, None);
        for (j, joint) in self.joints.iter_mut().enumerate() {
            joint.keep_band(sample.q_measured[j], scaled(model, j, REST_RAD), counted_s);
            if joint.still_s < still_s {
                (still_s, restless) = (joint.still_s, j);
            }
            let bound = |share: f64| (share * judged(model, j)).powi(2);
            swings = swings.or((joint.rest_square > bound(REST_SHARE)).then_some(j));
            reported = reported.or((joint.reported_square > bound(ERROR_SHARE)).then_some(j));
        }
        let restless = swings.or(reported.filter(|_| still_s >= REST_S)).unwrap_or(restless);
        let stands = command_rests && still_s >= REST_S && swings.is_none();
        self.unsettled_s = if command_rests && !stands { self.unsettled_s + counted_s } else { 0.0 };
        let standstill_lost = match self.moved.standstill_lost.filter(|_| command_rests) {
            Some(_) if stands && still_s >= STAND_AGAIN_S => None,
            Some(joint) => Some(joint),
            None if self.unsettled_s > SETTLE_S => Some(restless),
            None => self.left(model, sample, counted_s).filter(|_| command_rests),
        };
        self.place = match self.place {
            _ if standstill_lost.is_some() || !command_rests => None,
            None if stands => Some(*sample.q_measured),
            place => place,
        };
        let at_rest = stands && reported.is_none() && standstill_lost.is_none();
        Moved { standstill_lost, at_rest, restless, ..Moved::default() }
    }

    /// The joint that is measured far from where it came to rest, once one has been for long enough.
    fn left(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Option<usize> {
        let far = |j: &usize| {
            let place = self.place.map_or(sample.q_measured[*j], |place| place[*j]);
            (sample.q_measured[*j] - place).abs() > scaled(model, *j, PLACE_RAD)
        };
        let joint = (0..JOINTS).find(far);
        self.far.note(joint.is_some(), counted_s);
        joint.filter(|_| self.far.is_for(FAR_S, FAR_SAMPLES))
    }
}

/// Lets an error, which counts up to `most`, into a leaky mean square. What is no number counts as the most.
fn leak(square: &mut f64, error: f64, most: f64, share: f64) {
    let error = error.abs().min(most);
    *square += (error * error - *square) * share;
}

impl Joint {
    /// Whether it has been too fast for long enough.
    fn is_fast(&mut self, measured: f64, reported: f64, v_max: f64, counted_s: f64) -> bool {
        let fast = FAST_SHARE * v_max;
        self.fast.note(measured.abs() > fast, counted_s);
        let needed_s = if reported.abs() > fast { FAST_REPORTED_S } else { FAST_S };
        self.fast.is_for(needed_s, FAST_SAMPLES)
    }

    /// A joint that leaves its band begins another one.
    fn keep_band(&mut self, q: f64, band: f64, counted_s: f64) {
        if (q - self.band).abs() <= band {
            self.still_s += counted_s;
        } else {
            (self.band, self.still_s) = (q, 0.0);
        }
    }
}
