//! Plays a motion like a client: at its own frame rate, with the first frame held until the robot is engaged.

use messages::{HingeCalibration, RawSkeleton, SMPL_JOINTS, Stamp};
use motion::{CalibrationMode, Motion};

/// Options of playing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlayOptions {
    /// Speed. 1 is the recorded one.
    pub speed: f64,
    /// Starts again at the end, with the seam blended.
    pub looped: bool,
    /// Source of the elbow hinges.
    pub calibration: CalibrationMode,
}

/// Length of the blend over the seam of a loop, s.
const SEAM_S: f64 = 0.5;

/// A motion that is being played, on any clock.
#[derive(Clone, Debug)]
pub struct Player {
    motion: Motion,
    calibration: HingeCalibration,
    session_nonce: u64,
    incarnation: u32,
    /// Time between two published frames, ns.
    period_ns: f64,
    /// Number of published frames for each frame of the motion. Those between two of a slow motion are mixed.
    steps: u64,
    looped: bool,
    /// Number of frames of the file that are left out, because the person does not stand yet.
    begins: usize,
    // Next frame to publish, counted from the start of playing. 0 is held until the robot is engaged.
    next: u64,
    started: Option<Stamp>,
    next_due: Stamp,
    sequence: u64,
}

impl Player {
    /// Prepares `motion`. Live frames are expected at 30 to 240 Hz. So sources below 30 Hz are upsampled, and a
    /// slow motion is filled with frames between its own.
    pub fn new(motion: &Motion, options: PlayOptions, session_nonce: u64, incarnation: u32) -> Self {
        let calibration = motion::calibrate(motion, options.calibration);
        let mut motion =
            if motion.frame_rate_hz < motion::RATE_MIN_HZ { motion::upsample(motion) } else { motion.clone() };
        // `ingest` knows up by a person who stands or sits.
        let begins = motion.stands_from().unwrap_or(0);
        motion.frames.drain(..begins);
        if options.looped {
            motion = motion::loop_blend(&motion, SEAM_S);
        }
        let rate_hz = motion.frame_rate_hz * options.speed;
        let steps = (motion::RATE_MIN_HZ / rate_hz).ceil().max(1.0);
        Self {
            period_ns: 1e9 / (rate_hz * steps),
            steps: steps as u64,
            looped: options.looped,
            begins,
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

    /// Time at which the next frame is due. `Stamp::NONE` before the first one was published.
    pub fn next_due(&self) -> Stamp {
        self.next_due
    }

    /// Returns the frame to publish at `now` and its index in the motion, if a frame is due. `engaged`: the robot
    /// follows, so the motion may begin. Once begun it goes on.
    pub fn due(&mut self, now: Stamp, engaged: bool) -> Option<(usize, RawSkeleton)> {
        if now < self.next_due {
            return None;
        }
        if self.started.is_none() && engaged {
            self.started = Some(now);
        }
        let published = self.motion.frames.len() as u64 * self.steps;
        let at = match self.started {
            None => 0,
            Some(start) => {
                // If playing is late by more than a frame, the frames between are skipped, as with a camera.
                let elapsed = (now.since(start) as f64 / self.period_ns + 1e-6) as u64;
                self.next = elapsed + 1;
                if self.looped { elapsed % published } else { elapsed.min(published - self.steps) }
            }
        };
        self.next_due = match self.started {
            None => now.plus_ns(self.period_ns as u64),
            Some(start) => start.plus_ns((self.next as f64 * self.period_ns).ceil() as u64),
        };
        Some((self.begins + (at / self.steps) as usize, self.frame(at, now)))
    }

    fn frame(&mut self, at: u64, now: Stamp) -> RawSkeleton {
        self.sequence += 1;
        let (index, step) = ((at / self.steps) as usize, at % self.steps);
        let mut raw = motion::raw_frame(&self.motion, index, &self.calibration);
        if step > 0 {
            let frames = &self.motion.frames;
            let share = step as f32 / self.steps as f32;
            let between = motion::mix(&frames[index], &frames[(index + 1) % frames.len()], share);
            raw.positions[..SMPL_JOINTS].copy_from_slice(&between.positions);
            raw.rotations[..SMPL_JOINTS].copy_from_slice(&between.rotations);
        }
        raw.header.sequence = self.sequence;
        raw.header.stamp = now;
        raw.header.origin = now;
        raw.header.incarnation = self.incarnation;
        raw.session_nonce = self.session_nonce;
        raw
    }

    /// Returns true if the last frame has been published. Always false for a loop.
    pub fn finished(&self) -> bool {
        !self.looped && self.next > self.motion.frames.len() as u64 * self.steps
    }

    /// Returns true if the motion has begun.
    pub fn started(&self) -> bool {
        self.started.is_some()
    }

    /// Frames of the motion published, and their total number.
    pub fn progress(&self) -> (u64, u64) {
        let frames = self.motion.frames.len() as u64;
        let next = self.next.div_ceil(self.steps);
        (if self.looped { next % (frames + 1) } else { next.min(frames) }, frames)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Everything that is published of the built-in motion at `speed`, with its times, s.
    fn played(speed: f64) -> Vec<(f64, usize, RawSkeleton)> {
        let options = PlayOptions { speed, looped: false, calibration: CalibrationMode::None };
        let mut player = Player::new(&motion::builtin(), options, 1, 1);
        let (mut now, mut all) = (Stamp(1_000_000_000), Vec::new());
        while !player.finished() {
            let (index, raw) = player.due(now, true).expect("a frame is due");
            all.push(((now.0 - 1_000_000_000) as f64 * 1e-9, index, raw));
            now = player.next_due();
        }
        assert_eq!(player.progress(), (1314, 1314));
        all
    }

    #[test]
    fn slow_playback_keeps_30_hz_and_every_recorded_frame() {
        let recorded = motion::builtin().frames;
        for (speed, steps) in [(0.1, 5), (0.3, 2), (0.5, 1), (1.0, 1)] {
            let all = played(speed);
            let rate_hz = (all.len() - 1) as f64 / all[all.len() - 1].0;
            assert!(rate_hz > 29.9, "{speed}: {rate_hz} Hz");
            // The last frame is published a second time, when its own time is over.
            assert_eq!(all.len(), recorded.len() * steps + 1, "{speed}");
            for (i, frame) in recorded.iter().enumerate() {
                let (at_s, index, raw) = &all[i * steps];
                assert_eq!((*index, &raw.positions[..SMPL_JOINTS]), (i, &frame.positions[..]), "{speed}");
                assert!((at_s - i as f64 / 60.0 / speed).abs() < 1e-6, "{speed}: frame {i} at {at_s} s");
            }
        }
    }

    #[test]
    fn interpolated_frames_lie_between_recorded_frames() {
        let all = played(0.1);
        let wrist = |i: usize| all[i].2.positions[20];
        let distance = |a: [f32; 3], b: [f32; 3]| (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).sum::<f32>().sqrt();
        let (mut longest, mut between) = (0.0_f32, 0.0_f32);
        for i in (0..all.len() - 5).step_by(5) {
            longest = longest.max(distance(wrist(i), wrist(i + 5)));
            for step in 0..5 {
                between = between.max(distance(wrist(i + step), wrist(i + step + 1)));
            }
        }
        assert!(between < longest / 4.0 && longest > 0.005, "steps of {between} m, frames of {longest} m");
    }
}
