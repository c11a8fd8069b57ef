//! Feedback for the clients: what a headset or a glove can let its person feel.

use crate::layout::message;
use crate::skeleton::LIMBS;
use crate::time::Header;

/// Bytes of the sentence.
pub const SENTENCE_BYTES: usize = 256;

/// Bits of `Feedback::known`.
pub mod feedback_flag {
    /// `control` publishes its status. Without this bit mode, faults, speed and sentence are empty.
    pub const STATUS: u32 = 1;
    /// The driver publishes a state that the robot has measured: clearances and limbs mean something.
    pub const STATE: u32 = 2;
    /// The left, the right gripper is measured.
    pub const GRIPPER: [u32; 2] = [4, 8];
    /// Bits 4 to 7: the person's limb i is seen, so `limb_behind_rad` means something.
    pub const LIMB: [u32; super::LIMBS] = [16, 32, 64, 128];
}

message! {
    /// State of the robot for the person who drives it, 20 times a second. Frame of the directions: the robot's torso, x
    /// forward, y left, z up.
    pub struct Feedback v 1 size 384 {
        /// `stamp` says how old it is. `origin` is that of the executed command.
        pub header: Header,
        /// Active faults, as bits of `Faults`.
        pub faults: u64,
        /// A `Mode`.
        pub mode: u32,
        /// Bits of `feedback_flag`: what is known.
        pub known: u32,
        /// Speed scale in force, 0 to 1.
        pub speed_scale: f32,
        /// Smallest measured clearance of the left and of the right arm, m. Infinite if nothing is checked.
        pub clearance_m: [f32; 2],
        /// Unit vectors from the nearest place of each arm towards what is nearest to it. Zero if nothing is.
        pub towards_nearest: [[f32; 3]; 2],
        /// Angles by which the measured limbs are off the person's, rad, indexed by `Limb`.
        pub limb_behind_rad: [f32; LIMBS],
        /// Measured closure of the left and the right gripper, from 0 (open) to 1 (closed).
        pub closure: [f32; 2],
        /// Forces between the fingers, N.
        pub force_n: [f32; 2],
        /// Number of bytes of the sentence.
        pub sentence_bytes: u32,
        /// One sentence in UTF-8: why the robot does what it does.
        pub sentence: [u8; SENTENCE_BYTES],
    }
}

impl Feedback {
    /// The sentence. Empty if the bytes are no text.
    pub fn sentence(&self) -> &str {
        let bytes = self.sentence.get(..self.sentence_bytes as usize).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }

    /// Sets the sentence. A longer one is cut between two characters.
    pub fn set_sentence(&mut self, text: &str) {
        let mut end = text.len().min(SENTENCE_BYTES);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        self.sentence = [0; SENTENCE_BYTES];
        for (place, byte) in self.sentence.iter_mut().zip(&text.as_bytes()[..end]) {
            *place = *byte;
        }
        self.sentence_bytes = end as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Layout;

    #[test]
    fn sentence_is_cut_between_characters() {
        let mut feedback = Feedback::ZERO;
        feedback.set_sentence("The robot follows.");
        assert_eq!(feedback.sentence(), "The robot follows.");
        let long = "ä".repeat(200);
        feedback.set_sentence(&long);
        assert_eq!(feedback.sentence(), "ä".repeat(128));
        feedback.sentence_bytes = u32::MAX;
        assert_eq!(feedback.sentence(), "");
    }
}
