//! Converts a motion to joint positions over time: postures, before whole-body control and before the safety gate.

use crate::postures::Postures;
use messages::{JOINTS_MAX, LIMBS};
use motion::{CalibrationMode, Motion};
use retarget::{ARMS, ArmQ, Limbs, Sample, interpolate_latent};

/// Number of postures per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// One for each frame of the motion.
    Source,
    /// This many. Between the frames of the motion they lie on straight lines of the latent space.
    Hz(f64),
}

/// Steps through a motion. It is an iterator of time (s, from the first frame) and all joints (rad, lift in m).
/// Its error is the frame that cannot be retargeted, and the reason.
pub struct Retargeted<'a> {
    postures: &'a Postures,
    limbs: Vec<[[f32; 4]; LIMBS]>,
    source_hz: f64,
    rate: Rate,
    next: usize,
    /// The encoded frames around the playhead: index and samples.
    window: [Option<(usize, [Sample; ARMS])>; 2],
    previous: Option<[ArmQ; ARMS]>,
}

impl<'a> Retargeted<'a> {
    /// Creates the trajectory of `motion`. The live stage's code computes the limb rotations, and `calibration`
    /// determines the elbow hinges.
    pub fn new(postures: &'a Postures, motion: &Motion, calibration: CalibrationMode, rate: Rate) -> Self {
        let limbs = motion::limbs(motion, &motion::calibrate(motion, calibration));
        Self { postures, limbs, source_hz: motion.frame_rate_hz, rate, next: 0, window: [None; 2], previous: None }
    }

    /// Returns the number of postures.
    pub fn rows(&self) -> usize {
        match self.rate {
            Rate::Source => self.limbs.len(),
            Rate::Hz(_) if self.limbs.is_empty() => 0,
            Rate::Hz(hz) => {
                let duration_s = (self.limbs.len() - 1) as f64 / self.source_hz;
                // The last frame belongs to the trajectory, regardless of the rounding of the product.
                (duration_s * hz + 1e-6).floor() as usize + 1
            }
        }
    }

    /// Returns the number of postures per second.
    pub fn rate_hz(&self) -> f64 {
        match self.rate {
            Rate::Source => self.source_hz,
            Rate::Hz(hz) => hz,
        }
    }

    fn encoded(&mut self, frame: usize) -> Result<[Sample; ARMS], (usize, &'static str)> {
        if let Some((_, samples)) = self.window.iter().flatten().find(|(at, _)| *at == frame) {
            return Ok(*samples);
        }
        let arms = self.limbs.get(frame).and_then(Limbs::from_message).ok_or((frame, "a limb is not a rotation"))?;
        let samples = self.postures.encode(&arms);
        if !samples.iter().flat_map(|sample| sample.latent).all(f32::is_finite) {
            return Err((frame, "the network's encoding is not finite"));
        }
        self.window = [self.window[1], Some((frame, samples))];
        Ok(samples)
    }

    /// Returns both arms at a position between frames. It is straight in the latent space, and on the shorter
    /// arc for the limbs.
    fn at(&mut self, place: f64) -> Result<(usize, [Sample; ARMS]), (usize, &'static str)> {
        let last = self.limbs.len().saturating_sub(1);
        let before = (place.floor() as usize).min(last);
        let s = place - before as f64;
        let from = self.encoded(before)?;
        // A position this near to a frame counts as that frame, because the product of rate and time has
        // rounding errors.
        if s < 2e-9 || before == last {
            return Ok((before, from));
        }
        let to = self.encoded(before + 1)?;
        let between = std::array::from_fn(|arm: usize| Sample {
            latent: interpolate_latent(&from[arm].latent, &to[arm].latent, s),
            limbs: from[arm].limbs.slerp(&to[arm].limbs, s),
            hand: None,
            closure: None,
            touching: None,
        });
        Ok((before, between))
    }
}

impl Iterator for Retargeted<'_> {
    type Item = Result<(f64, [f64; JOINTS_MAX]), (usize, &'static str)>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.rows() {
            return None;
        }
        let time_s = self.next as f64 / self.rate_hz();
        let place = match self.rate {
            Rate::Source => self.next as f64,
            Rate::Hz(_) => (time_s * self.source_hz + 1e-9).min((self.limbs.len() - 1) as f64),
        };
        self.next += 1;
        Some(self.at(place).and_then(|(frame, samples)| {
            let posture = self.postures.posture(&samples, self.previous.as_ref());
            let q = posture.ok_or((frame, "the network's posture is not finite"))?;
            self.previous = Some(q);
            Ok((time_s, self.postures.joints(&q)))
        }))
    }
}
