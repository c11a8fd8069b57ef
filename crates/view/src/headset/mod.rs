//! A headset in the page: its message, the person that its poses show, and the press that holds the enable. The page
//! sends poses only. Axes are those of WebXR: x right, y up, z back, m.

mod arm;
mod client;
mod message;
mod person;
mod press;

pub use client::HeadsetClient;
pub use message::{BODY_BYTES, HEADSET_BYTES, HeadsetFrame};

use crate::sight::{Refusal, Sight};
use messages::Stamp;
use person::UpperBody;
use press::HeldPress;

/// The state of a page's headset.
#[derive(Clone, Debug, Default)]
pub struct Headset {
    body: UpperBody,
    press: HeldPress,
}

impl Headset {
    /// Forgets the person and the press. The gesture must be seen open before it counts again.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Forgets the press, as [`HeldPress::lose`] does. Returns true if it was held.
    pub fn lose_press(&mut self) -> bool {
        self.press.lose()
    }

    /// Returns true if the headset holds the enable.
    pub fn is_held(&self) -> bool {
        self.press.is_held()
    }

    /// Reads a message that arrived at `now`. The press is held only while the head and the left hand are tracked. A refused
    /// message ends it.
    ///
    /// # Errors
    /// Returns the reason if the message is refused.
    pub fn step(&mut self, bytes: &[u8], now: Stamp) -> Result<Sight, Refusal> {
        let read = HeadsetFrame::of(bytes);
        let grasp = read.as_ref().ok().filter(|frame| frame.head.is_some()).and_then(|frame| frame.hands[0].grasp());
        self.press.step(now, grasp);
        let frame = read?;
        let person = self.body.person(&frame, now).map(Box::new);
        Ok(Sight { sent_ms: frame.sent_ms, age_ms: frame.age_ms, person })
    }
}
