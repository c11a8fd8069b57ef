//! Plays a motion as a client would: at its own frame rate, the first frame held until the robot is engaged.

use messages::{HingeCalibration, RawSkeleton, Stamp};
use motion::{CalibrationMode, Motion};

/// How a motion is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayOptions {
    /// 1 is the recorded speed.
    pub speed: f64,
    /// Begin again at the end, with the seam blended.
    pub looped: bool,
    /// Where the elbow hinges come from.
    pub calibration: CalibrationMode,
}

/// Length of the blend over the seam of a loop, s.
const SEAM_S: f64 = 0.5;

/// A motion being played, against any clock.
#[derive(Clone, Debug)]
pub struct Player {
    motion: Motion,
    calibration: HingeCalibration,
    session_nonce: u64,
    incarnation: u32,
    period_ns: f64,
    looped: bool,
    // The frame that is due next, counted from the start of playing; 0 is held until the robot is engaged.
    next: u64,
    started: Option<Stamp>,
    next_due: Stamp,
    sequence: u64,
}

impl Player {
    /// Prepares `motion`. Sources below 30 Hz are upsampled, because live frames are expected at 30 to 240 Hz.
    pub fn new(motion: &Motion, options: PlayOptions, session_nonce: u64, incarnation: u32) -> Self {
        let calibration = motion::calibrate(motion, options.calibration);
        let mut motion =
            if motion.frame_rate_hz < motion::RATE_MIN_HZ { motion::upsample(motion) } else { motion.clone() };
        if options.looped {
            motion = motion::loop_blend(&motion, SEAM_S);
        }
        Self {
            period_ns: 1e9 / (motion.frame_rate_hz * options.speed),
            looped: options.looped,
            motion,
            calibration,
            session_nonce,
            incarnation,
            next: 0,
            started: None,
            next_due: Stamp::NONE,
            sequence: 0,
        }
    }

    /// When the next frame is due; never before the first one was published.
    pub fn next_due(&self) -> Stamp {
        self.next_due
    }

    /// The frame to publish at `now`, if one is due, and its index in the motion. `engaged`: the robot follows, so the
    /// motion may begin; once begun it goes on.
    pub fn due(&mut self, now: Stamp, engaged: bool) -> Option<(usize, RawSkeleton)> {
        if now < self.next_due {
            return None;
        }
        if self.started.is_none() && engaged {
            self.started = Some(now);
        }
        let frames = self.motion.frames.len() as u64;
        let index = match self.started {
            None => 0,
            Some(start) => {
                // Late by more than a frame: the frames between are skipped, as a camera would.
                let elapsed = (now.since(start) as f64 / self.period_ns + 1e-6) as u64;
                self.next = elapsed + 1;
                if self.looped { elapsed % frames } else { elapsed.min(frames - 1) }
            }
        };
        self.next_due = match self.started {
            None => now.plus_ns(self.period_ns as u64),
            Some(start) => start.plus_ns((self.next as f64 * self.period_ns).ceil() as u64),
        };
        Some((index as usize, self.frame(index as usize, now)))
    }

    fn frame(&mut self, index: usize, now: Stamp) -> RawSkeleton {
        self.sequence += 1;
        let mut raw = motion::raw_frame(&self.motion, index, &self.calibration);
        raw.header.sequence = self.sequence;
        raw.header.stamp = now;
        raw.header.origin = now;
        raw.header.incarnation = self.incarnation;
        raw.session_nonce = self.session_nonce;
        raw
    }

    /// Whether the last frame has been published (never, for a loop).
    pub fn finished(&self) -> bool {
        !self.looped && self.next > self.motion.frames.len() as u64
    }

    /// Whether the motion has begun.
    pub fn started(&self) -> bool {
        self.started.is_some()
    }

    /// Frames published of the motion, and their number.
    pub fn progress(&self) -> (u64, u64) {
        let frames = self.motion.frames.len() as u64;
        (if self.looped { self.next % (frames + 1) } else { self.next.min(frames) }, frames)
    }

    /// The motion as it is played.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The hinges in use.
    pub fn calibration(&self) -> &HingeCalibration {
        &self.calibration
    }
}
