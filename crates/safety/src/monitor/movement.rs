//! Checks whether the measured joints move as commanded, and whether they stand still.

use messages::{JOINTS_MAX, TICK_HZ, TICK_S};
use robot::Model;

use super::feedback::{PRISMATIC_SHARE, Sample};

/// Ticks between the two positions whose difference gives a measured speed: W = 20 ms. One step of an encoder of 14
/// bits, 3.8e-4 rad, is 0.02 rad/s over it. A swing of frequency f shows sin(pi f W) / (pi f W) of its speed. This is
/// 0.94 at 10 Hz and 0.76 at 20 Hz. It is zero at 50 Hz, where no drive of such a robot swings.
const WINDOW_TICKS: u64 = TICK_HZ / 50;

/// Entries of the window. There is at most one for each tick, with both ends, and one more that is just too old.
const WINDOW: usize = WINDOW_TICKS as usize + 2;

/// Time constant of the leaky mean square that stops the robot, s. A quarter of a second holds a whole swing
/// of 4 Hz, and half a swing of 2 Hz.
const MEAN_S: f64 = 0.25;

/// Speeds are judged as shares of a joint's largest speed, or of this speed if the joint may turn faster,
/// rad/s. The error of a servo depends on its drive, and not on the joint's speed limit. Assumption: an
/// elbow's swing of 46 mrad at 1 Hz is too much at any limit.
const JUDGED_RAD_PER_S: f64 = 0.82;

/// Root mean square of measured minus sent speed that stops the robot, as a share of the speed above.
///
/// A sound servo stays below. An unknown lag of 10 ms at full acceleration (10 rad/s^2) is 0.1 rad/s, for at
/// most half a second in a reversal. Friction that gives way by 3 mrad in 50 ms is 0.06 rad/s for that time.
/// Together they are half of what stops, which is 0.2 rad/s over a mean.
const ERROR_SHARE: f64 = 0.25;

/// Root mean square of measured minus sent speed below which a joint is at rest. It is half of the bound
/// above, so that the error that has just stopped the robot does not count as rest. The noise of the
/// simulated encoders, 4.8e-5 m, is 0.0034 m/s over the window. The torso's bound is 0.0088 m/s.
const REST_SHARE: f64 = ERROR_SHARE / 2.0;

/// Time constant of the mean squares that decide about rest, s. A joint whose error was its whole speed is
/// below the bound after 50 ms ln(64) = 0.2 s.
const REST_MEAN_S: f64 = 0.05;

/// A joint that is measured faster than this share of its largest speed is too fast. Commands reach at
/// most a share of 1. A servo overshoots by some percent, and the noise of the torso's speed is 0.05.
const FAST_SHARE: f64 = 1.25;

/// Time for which a joint must be too fast, s. The first holds for its positions alone, the second if the
/// reported velocity agrees. Some samples in a row are required too. One wrong position is at each end of the
/// window once, and never three times in a row.
const FAST_S: f64 = 0.010;
const FAST_REPORTED_S: f64 = 0.002;
const FAST_SAMPLES: u32 = 3;

/// Longest time that one sample counts for, s. So one wrong sample adds at most the square of the speed above times 10
/// ms / 250 ms. This is 0.04, and 0.0625 stops the robot. It holds however long the measurement was missing.
const COUNTED_MAX_S: f64 = 0.010;

/// Time for which each joint must have stayed in its band before the robot is at rest, s.
const REST_S: f64 = 0.1;
/// Half width of the band, rad. Over 100 ms it is a mean speed of 0.05 rad/s.
const REST_RAD: f64 = 0.005;

/// Largest measured distance of a joint from where it came to rest, rad. Friction and a servo's integral part
/// still move it by some mrad. The tolerated tracking error is 0.05.
const PLACE_RAD: f64 = 0.02;

/// Time for which a joint must be that far away, s, and the number of samples in a row. One of these samples
/// may be wrong.
const FAR_S: f64 = 0.010;
const FAR_SAMPLES: u32 = 3;

/// Longest time for which the command may rest without the robot, s. A servo of 5 Hz with a damping ratio of
/// 0.2 settles to 2 % in 4 / (0.2 2 pi 5 Hz) = 0.64 s. The mean square takes 0.2 s to show it, and rest takes
/// 0.1 s. The bound is twice the sum.
const SETTLE_S: f64 = 2.0;

/// Time for which a robot that left its place must stand before another place counts, s. In this time it may move no
/// faster than the band allows, 5 mrad/s. So an arm that sinks slowly does not count as standing repeatedly.
const STAND_AGAIN_S: f64 = 1.0;

/// Largest speed or acceleration of a command at rest, rad/s, rad/s^2, m/s or m/s^2. The driver judges the
/// end of a plan by the same bound.
const COMMAND_REST: f64 = 1e-7;

/// The result for a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// Time by which the sample is newer than the previous one, ns.
    pub sample_ns: u64,
    /// The joint that moves too fast, or otherwise than commanded.
    pub velocity_error: Option<usize>,
    /// The joint that has left the place where it came to rest, or that does not come to rest.
    pub standstill_lost: Option<usize>,
    /// The command rests, and every joint rests by its positions and by its reported velocity.
    pub at_rest: bool,
    /// The joint that has been standing for the shortest time, or that does not stand.
    pub restless: usize,
}

/// A sample of the window: the measured positions, and the commanded travel of the joints since the window began.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    k: u64,
    q: [f64; JOINTS_MAX],
    sent: [f64; JOINTS_MAX],
}

/// State of one joint.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    /// Leaky mean square of measured minus sent speed that stops the robot.
    error_square: f64,
    /// The mean squares with the short time constant that decide about rest, by positions and as reported.
    rest_square: f64,
    reported_square: f64,
    /// Time for which the joint has been too fast.
    fast: Lasting,
    /// The middle of its band, and the time for which it has stayed there.
    band: f64,
    still_s: f64,
}

/// Duration of a condition, in time and in samples in a row.
#[derive(Clone, Copy, Debug, Default)]
struct Lasting {
    time_s: f64,
    samples: u32,
}

impl Lasting {
    fn update(&mut self, is_so: bool, counted_s: f64) {
        let more = Self { time_s: self.time_s + counted_s, samples: self.samples.saturating_add(1) };
        *self = if is_so { more } else { Self::default() };
    }

    fn is_for(&self, time_s: f64, samples: u32) -> bool {
        self.time_s >= time_s && self.samples >= samples
    }
}

/// State of the monitor.
#[derive(Clone, Debug, Default)]
pub struct Movement {
    window: [Entry; WINDOW],
    oldest: usize,
    filled: usize,
    /// Speed that was sent at the newest sample, and the commanded travel since the window began.
    v_sent: [f64; JOINTS_MAX],
    sent: [f64; JOINTS_MAX],
    joints: [Joint; JOINTS_MAX],
    /// Time for which the command has been resting without the robot, s.
    unsettled_s: f64,
    /// The position where the robot came to rest, and the time for which it has been measured far from there.
    place: Option<[f64; JOINTS_MAX]>,
    far: Lasting,
    moved: Moved,
}

/// Largest distance of a joint at rest from its place, rad or m.
pub fn rest_band(model: &Model, joint: usize) -> f64 {
    scaled(model, joint, REST_RAD)
}

/// Bound of a joint, computed from the bound of a revolute joint.
fn scaled(model: &Model, joint: usize, bound_rad: f64) -> f64 {
    if model.prismatic[joint] { PRISMATIC_SHARE * bound_rad } else { bound_rad }
}

/// The speed by which a joint's speed error is judged, rad/s or m/s.
fn judged(model: &Model, joint: usize) -> f64 {
    let v_max = model.limits[joint].v_max;
    if model.prismatic[joint] { v_max } else { v_max.min(JUDGED_RAD_PER_S) }
}

impl Movement {
    /// Judges a new sample. Call it once for each sample. `servo_lag_s` is the known lag of a sound servo, s.
    /// Time is the difference of the samples' indices, so a late sample has no effect.
    ///
    /// Let e be the measured minus the sent mean speed over W = 20 ms. It counts up to s, which is v_max or 0.82 rad/s,
    /// whichever is less. The mean square E follows dE/dt = (e^2 - E) / 0.25 s. E > (0.25 s)^2 is a velocity error.
    ///
    /// A swing A sin(2 pi f t) about the commanded position has E = (2 pi f A)^2 / 2 times the square of the
    /// share that the window shows. So it is detected if its amplitude is above 0.25 s sqrt(2) / (2 pi f)
    /// over that share. For 0.82 rad/s this is 46 mrad at 1 Hz, 12 mrad at 4 Hz, 3 mrad at 20 Hz.
    ///
    /// A joint faster than 1.25 v_max for 10 ms is a velocity error too, whatever was commanded. If the
    /// reported velocity agrees, 2 ms are enough.
    ///
    /// A measured position or a sent speed or acceleration that is not finite is a velocity error at once.
    /// The monitor then forgets everything before it.
    pub fn judge(&mut self, model: &Model, sample: &Sample<'_>, servo_lag_s: f64) -> Moved {
        let finite = |j: &usize| [sample.q_measured, sample.v, sample.a].iter().all(|x| x[*j].is_finite());
        if let Some(joint) = (0..model.count).find(|j| !finite(j)) {
            let lost = Moved { velocity_error: Some(joint), restless: joint, ..Moved::default() };
            *self = Self { moved: lost, ..Self::default() };
            return lost;
        }
        let newest = self.newest();
        let v_sent = core::array::from_fn(|j| sample.v[j] - servo_lag_s * sample.a[j]);
        let ticks = match newest {
            Some(k) if k <= sample.k => sample.k - k,
            // This is the first sample, or one of another driver.
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

    /// Adds a sample to the window. The oldest entry is then the newest of those that are at least a window old.
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

    /// Compares measured and sent speeds. Of the joints that are too fast or have too large an error, returns
    /// the worst.
    fn speeds(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Option<usize> {
        let from = self.window[self.oldest];
        let span = sample.k - from.k;
        if span < WINDOW_TICKS {
            return None;
        }
        let span_s = span as f64 * TICK_S;
        let mut worst: Option<(usize, f64)> = None;
        for (j, joint) in self.joints.iter_mut().enumerate().take(model.count) {
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

    /// Judges whether the robot stands where it came to rest. Positions decide. The reported velocity may
    /// only deny rest. So a wrong velocity prevents every motion from beginning, but stops nothing.
    fn standstill(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Moved {
        let command_rests = sample.v.iter().chain(sample.a).all(|x| x.abs() <= COMMAND_REST);
        let (mut still_s, mut restless) = (f64::INFINITY, 0);
        let (mut swings, mut reported) = (None, None);
        for (j, joint) in self.joints.iter_mut().enumerate().take(model.count) {
            joint.keep_band(sample.q_measured[j], rest_band(model, j), counted_s);
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

    /// Returns a joint that is measured far from where it came to rest, once one has been for long enough.
    fn left(&mut self, model: &Model, sample: &Sample<'_>, counted_s: f64) -> Option<usize> {
        let far = |j: &usize| {
            let place = self.place.map_or(sample.q_measured[*j], |place| place[*j]);
            (sample.q_measured[*j] - place).abs() > scaled(model, *j, PLACE_RAD)
        };
        let joint = (0..model.count).find(far);
        self.far.update(joint.is_some(), counted_s);
        joint.filter(|_| self.far.is_for(FAR_S, FAR_SAMPLES))
    }
}

/// Adds an error, which counts up to `most`, to a leaky mean square. NaN counts as `most`.
fn leak(square: &mut f64, error: f64, most: f64, share: f64) {
    let error = error.abs().min(most);
    *square += (error * error - *square) * share;
}

impl Joint {
    /// Returns true if the joint has been too fast for long enough.
    fn is_fast(&mut self, measured: f64, reported: f64, v_max: f64, counted_s: f64) -> bool {
        let fast = FAST_SHARE * v_max;
        self.fast.update(measured.abs() > fast, counted_s);
        let needed_s = if reported.abs() > fast { FAST_REPORTED_S } else { FAST_S };
        self.fast.is_for(needed_s, FAST_SAMPLES)
    }

    /// Counts the time in the band. A joint that leaves its band begins another one.
    fn keep_band(&mut self, q: f64, band: f64, counted_s: f64) {
        if (q - self.band).abs() <= band {
            self.still_s += counted_s;
        } else {
            (self.band, self.still_s) = (q, 0.0);
        }
    }
}
