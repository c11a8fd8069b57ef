//! Where the robot is now, by its newest sample and by what it was sent since.
//!
//! A robot that reports 50 times a second is 2 to 30 ms ahead of its newest sample. Monitors that compare it with the
//! present command would see that distance as an error. Let t be now, s the time of the sample, L the known delay
//! between a setpoint and the robot, and E the delay that the monitors expect. Then
//!
//! ```text
//! q(t)  = q_sent(t - E) + q_sample - q_sent(s - L)
//! dq(t) = v_sent(t - E) + dq_sample - v_sent(s - L)
//! ```
//!
//! So the deviation of each sample is what the monitors judge, until the next one. A robot that does not follow what it is
//! sent is where its newest sample says: then the setpoints follow the robot, and not the other way round.

use crate::trajectory::Executed;
use messages::{JOINTS_MAX, Stamp, TICK_HZ, TICK_S, deadline, tick_at};

/// Indices that are remembered: 0.5 s. It is more than the largest delay and the largest age of a sample.
const REMEMBERED: usize = (TICK_HZ / 2) as usize;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time of the measurement, by this machine's clock.
    pub measured: Stamp,
    /// Positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Velocities, rad/s or m/s.
    pub dq: [f64; JOINTS_MAX],
}

/// The setpoints of the last half second.
#[derive(Clone, Debug)]
pub struct Sent {
    ring: Box<[Executed]>,
    /// The first and the newest index since the last [`clear`](Self::clear).
    span: Option<[u64; 2]>,
}

impl Default for Sent {
    fn default() -> Self {
        let nothing = Executed { k: 0, q: [0.0; JOINTS_MAX], v: [0.0; JOINTS_MAX] };
        Self { ring: vec![nothing; REMEMBERED].into(), span: None }
    }
}

impl Sent {
    /// Forgets everything. The next setpoint stands for all before it.
    pub fn clear(&mut self) {
        self.span = None;
    }

    /// Returns true if a setpoint was noted since the last [`clear`](Self::clear).
    pub fn has_any(&self) -> bool {
        self.span.is_some()
    }

    /// Notes a setpoint. Indices that were left out had a steady velocity.
    pub fn push(&mut self, sent: &Executed) {
        let [begin, newest] =
            self.span.filter(|[_, newest]| sent.k > *newest).unwrap_or([sent.k, sent.k.saturating_sub(1)]);
        for k in (newest + 1).max(sent.k.saturating_sub(REMEMBERED as u64 - 1))..=sent.k {
            let back_s = (sent.k - k) as f64 * TICK_S;
            let q = std::array::from_fn(|j| sent.q[j] - back_s * sent.v[j]);
            self.ring[k as usize % REMEMBERED] = Executed { k, q, v: sent.v };
        }
        self.span = Some([begin.max(sent.k.saturating_sub(REMEMBERED as u64 - 1)), sent.k]);
    }

    /// The setpoint in force at `at`. The oldest one if that is older, and none before the first.
    pub fn at(&self, at: Stamp) -> Option<Executed> {
        let [first, newest] = self.span?;
        let k = tick_at(at).clamp(first, newest);
        let known = self.ring[k as usize % REMEMBERED];
        let rest_s = (at.since(deadline(k)) as f64 * 1e-9).min(TICK_S);
        Some(Executed { q: std::array::from_fn(|j| known.q[j] + rest_s * known.v[j]), ..known })
    }

    /// The estimate at `now`. `delay_ns` is L, `expected_ns` is E.
    pub fn estimate(&self, sample: &Sample, now: Stamp, delay_ns: u64, expected_ns: u64) -> Sample {
        let before = |at: Stamp, ns: u64| self.at(Stamp(at.0.saturating_sub(ns)));
        match (before(now, expected_ns), before(sample.measured, delay_ns)) {
            (Some(present), Some(then)) => Sample {
                measured: sample.measured,
                q: std::array::from_fn(|j| present.q[j] + (sample.q[j] - then.q[j])),
                dq: std::array::from_fn(|j| present.v[j] + (sample.dq[j] - then.v[j])),
            },
            _ => *sample,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(k: u64) -> Executed {
        let t = k as f64 * TICK_S;
        Executed { k, q: [t.sin(); JOINTS_MAX], v: [t.cos(); JOINTS_MAX] }
    }

    fn moved(off: f64, left_out: u64) -> (Sent, Sample, Stamp) {
        let mut sent = Sent::default();
        (1_000..=4_000).filter(|k| k % left_out == 0).for_each(|k| sent.push(&state(k)));
        let now = deadline(4_000);
        // The robot is 50 ms late, its sample 25 ms old.
        let measured = Stamp(now.0 - 25_000_000);
        let t = (measured.0 - 50_000_000) as f64 * 1e-9;
        (sent, Sample { measured, q: [t.sin() + off; JOINTS_MAX], dq: [t.cos(); JOINTS_MAX] }, now)
    }

    #[test]
    fn robot_on_its_way_shows_no_error_and_one_off_its_way_shows_it() {
        for (off, left_out) in [(0.0, 1), (0.02, 1), (-0.3, 1), (0.02, 4)] {
            let (sent, sample, now) = moved(off, left_out);
            for expected_ns in [0, 20_000_000] {
                let estimate = sent.estimate(&sample, now, 50_000_000, expected_ns);
                let t = (now.0 - expected_ns) as f64 * 1e-9;
                assert!((estimate.q[3] - t.sin() - off).abs() < 1e-5, "{} {}", estimate.q[3], t.sin());
                assert!((estimate.dq[3] - t.cos()).abs() < 5e-3);
                assert_eq!(estimate.measured, sample.measured);
            }
        }
    }

    #[test]
    fn sample_stands_for_itself_before_anything_was_sent() {
        let (_, sample, now) = moved(0.1, 1);
        assert_eq!(Sent::default().estimate(&sample, now, 50_000_000, 0), sample);
    }

    #[test]
    fn robot_that_does_not_follow_is_where_it_measures() {
        let (mut sent, sample, now) = moved(0.1, 1);
        for k in 4_001..4_020 {
            sent.clear();
            sent.push(&Executed { k, q: [0.01 * k as f64; JOINTS_MAX], v: [0.0; JOINTS_MAX] });
            let estimate = sent.estimate(&sample, now, 50_000_000, 10_000_000);
            assert!((estimate.q[3] - sample.q[3]).abs() < 1e-12 && estimate.dq == sample.dq);
        }
    }

    #[test]
    fn standing_robot_is_where_it_measures_whatever_was_sent_before() {
        let mut sent = Sent::default();
        for k in 10_000..10_005 {
            sent.push(&Executed { k, q: [0.5; JOINTS_MAX], v: [0.0; JOINTS_MAX] });
        }
        let sample = Sample { measured: deadline(9_990), q: [0.51; JOINTS_MAX], dq: [0.0; JOINTS_MAX] };
        let estimate = sent.estimate(&sample, deadline(10_005), 50_000_000, 10_000_000);
        assert!((estimate.q[0] - 0.51).abs() < 1e-12);
    }
}
