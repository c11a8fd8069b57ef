//! The client: publishes a moving person as any other client does, at its own rate, with a drifting phase.

use bus::{BusError, Domain, DomainConfig, Writer};
use messages::{HingeCalibration, RawSkeleton, Service, Stamp, TICK_HZ};
use motion::{CalibrationMode, Motion};
use rt::Background;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Length of the blend over the seam of the looped motion, s.
const SEAM_S: f64 = 0.5;
/// Fractional part of the golden ratio. Its multiples fill the tick evenly for any number of frames (Weyl).
const GOLDEN: f64 = 0.618_033_988_749_894_9;

#[derive(Debug, Default)]
struct Shared {
    moving: AtomicBool,
    published: AtomicU64,
    failures: AtomicU64,
}

#[derive(Debug)]
pub struct Client {
    shared: Arc<Shared>,
    thread: Background,
}

impl Client {
    /// Publishes the first frame of the built-in motion into `domain`, `rate_hz` times a second. Once the
    /// person may move, it publishes the frames of the looped motion in sequence.
    pub fn start(domain: DomainConfig, rate_hz: f64) -> Result<Self, BusError> {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        let open = || {
            let domain = Domain::open(domain, "latency")?;
            Ok((domain.writer::<RawSkeleton>(Service::RawSkeleton)?, domain))
        };
        let thread = Background::opened("client", open, move |(writer, _domain), ends| {
            publish(writer, &Person::new(), rate_hz, &of_thread, ends);
        })?;
        Ok(Self { shared, thread })
    }

    pub fn move_on(&self) {
        self.shared.moving.store(true, Ordering::Relaxed);
    }

    /// Ends the client. Returns the number of published frames, and of frames that the bus did not take.
    pub fn stop(self) -> (u64, u64) {
        drop(self.thread);
        (self.shared.published.load(Ordering::Relaxed), self.shared.failures.load(Ordering::Relaxed))
    }
}

struct Person {
    motion: Motion,
    calibration: HingeCalibration,
    session_nonce: u64,
    incarnation: u32,
}

impl Person {
    fn new() -> Self {
        let motion = motion::loop_blend(&motion::builtin(), SEAM_S);
        let calibration = motion::calibrate(&motion, CalibrationMode::First10s);
        let incarnation = rt::incarnation();
        let session_nonce = u64::from(incarnation) << 32 | u64::from(std::process::id());
        Self { motion, calibration, session_nonce, incarnation }
    }

    fn frame(&self, index: usize, sequence: u64) -> RawSkeleton {
        let mut raw = motion::raw_frame(&self.motion, index, &self.calibration);
        raw.header.sequence = sequence;
        raw.header.incarnation = self.incarnation;
        raw.session_nonce = self.session_nonce;
        raw
    }
}

/// Due time of frame `n` after the start, ns: by the rate, shifted by an evenly distributed share of a tick.
fn due_ns(n: u64, rate_hz: f64) -> u64 {
    let shift = (n as f64 * GOLDEN).fract() / TICK_HZ as f64;
    ((n as f64 / rate_hz + shift) * 1e9) as u64
}

fn publish(mut writer: Writer<RawSkeleton>, person: &Person, rate_hz: f64, shared: &Shared, ends: &AtomicBool) {
    let (start, mut n, mut index) = (rt::now(), 0_u64, 0_usize);
    for sequence in 1.. {
        rt::sleep_until(start.plus_ns(due_ns(n, rate_hz)));
        if ends.load(Ordering::Relaxed) {
            return;
        }
        let mut frame = person.frame(index, sequence);
        let now = rt::now();
        (frame.header.stamp, frame.header.origin) = (now, now);
        let failed = writer.publish(&frame).is_err() | writer.notify().is_err();
        shared.failures.fetch_add(u64::from(failed), Ordering::Relaxed);
        shared.published.store(sequence, Ordering::Relaxed);
        index += usize::from(shared.moving.load(Ordering::Relaxed));
        n = next(n, now, start, rate_hz);
    }
}

/// Returns the frame after `n`. If that is late by more than a frame, the frames between are skipped, as a
/// camera would do.
fn next(n: u64, now: Stamp, start: Stamp, rate_hz: f64) -> u64 {
    let passed = (now.since(start) as f64 * 1e-9 * rate_hz) as u64;
    (n + 1).max(passed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_phases_fill_the_tick_evenly_at_every_rate() {
        for rate_hz in [30.0, 75.0, 117.3, 120.0, 125.0, 240.0] {
            let mut bins = [0_u32; 10];
            for n in 0..1000 {
                let phase = (due_ns(n, rate_hz) as f64 * 1e-9 * TICK_HZ as f64).fract();
                bins[(phase * 10.0) as usize] += 1;
            }
            assert!(bins.iter().all(|&count| (60..=140).contains(&count)), "{rate_hz} Hz: {bins:?}");
        }
    }

    #[test]
    fn frames_keep_their_spacing_and_a_late_client_skips_frames() {
        let gaps: Vec<_> = (0..1000).map(|n| due_ns(n + 1, 120.0) - due_ns(n, 120.0)).collect();
        assert!(gaps.iter().all(|&gap| (7_600_000..=9_050_000).contains(&gap)));
        let start = Stamp(1_000_000_000);
        assert_eq!(next(3, start.plus_ns(due_ns(3, 100.0)), start, 100.0), 4);
        assert_eq!(next(3, start.plus_ns(95_000_000), start, 100.0), 9);
    }
}
