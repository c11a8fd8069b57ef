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
use crate::webcam::TransitDelay;
use messages::Stamp;
use person::UpperBody;
use press::{Grasp, HeldPress};

#[derive(Clone, Debug, Default)]
pub struct Headset {
    body: UpperBody,
    press: HeldPress,
    delay: TransitDelay,
    /// The last message was too late to press or to repeat a press.
    late: bool,
}

/// Age from which a message neither presses nor repeats a press, ms: `ingest` refuses its person.
const PRESS_AGE_MS_MAX: f64 = 100.0;

impl Headset {
    /// Forgets the person and the press. The gesture must be seen open before it counts again.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Forgets the press, as [`HeldPress::lose`] does. Returns true if it was held.
    pub fn lose_press(&mut self) -> bool {
        self.press.lose()
    }

    pub fn is_held(&self) -> bool {
        self.press.is_held()
    }

    pub fn repeats_press(&self) -> bool {
        self.press.is_held() && !self.late
    }

    /// Reads a message that arrived at `now`. The press is held only while the head and the left hand are tracked. A refused
    /// message ends it.
    pub fn step(&mut self, bytes: &[u8], now: Stamp) -> Result<Sight, Refusal> {
        let read = HeadsetFrame::decode(bytes);
        let grasp = read.as_ref().ok().filter(|frame| frame.head.is_some()).and_then(|frame| frame.hands[0].grasp());
        let age_ms = read.as_ref().map_or(0.0, |frame| frame.age_ms + self.delay.waited_ms(frame.sent_ms, now));
        self.late = age_ms > PRESS_AGE_MS_MAX;
        // A late message that shows a closed hand presses nothing. A press that is held goes on, but is not repeated.
        let grasp = grasp.filter(|grasp| !self.late || self.is_held() || *grasp == Grasp::Open);
        self.press.step(Stamp(now.0.saturating_sub((age_ms * 1e6) as u64)), grasp);
        let frame = read?;
        let person = self.body.person(&frame, now).map(Box::new);
        Ok(Sight { sent_ms: frame.sent_ms, age_ms: frame.age_ms, person })
    }
}
