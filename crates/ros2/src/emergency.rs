//! The state of the robot's emergency stop, as the robot says it.
//!
//! Some robots say it once a second, others when it changes only. So the age of a message says nothing. The end of its
//! publisher does: nobody would then say that the stop was pressed. DDS notices that a process ended by the lease of its
//! participant: 10 s for Cyclone DDS, 20 s for Fast DDS. dust_dds 0.16 does not notice a publisher that leaves alone.

use crate::dds::{Member, any, each, kept, readers, take};
use crate::ros::{Bool, topic};
use dust_dds::subscription::data_reader::DataReader;

/// The topic of an emergency stop.
pub(crate) struct EmergencyStop {
    /// Its name in DDS.
    pub(crate) topic: String,
    /// The first gets what was said before it came, if the publisher keeps that. The second gets each message, if the
    /// publisher is reliable. The last takes any publisher, and may miss messages.
    readers: [DataReader<Bool>; 3],
    said: Said,
}

/// The last message that counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Said {
    pressed: Option<bool>,
    /// The best reader that heard it.
    by: Option<usize>,
}

impl Said {
    /// Takes what a reader heard. Each of them counts if it says pressed, and only the best one if it says released: another
    /// may be late.
    fn hear(&mut self, reader: usize, pressed: bool) {
        let is_best = self.by.is_none_or(|by| reader <= by);
        if pressed || is_best {
            self.pressed = Some(pressed);
        }
        if is_best {
            self.by = Some(reader);
        }
    }
}

impl EmergencyStop {
    /// Opens the topic, by its name in ROS.
    pub(crate) fn open(member: &Member, ros: &str) -> Result<Self, String> {
        let readers = readers(member, ros, [kept(), each(), any()])?;
        Ok(Self { topic: topic(ros), readers, said: Said::default() })
    }

    /// True while it is pressed. None before the first message, and once its publisher left.
    pub(crate) fn pressed(&self) -> Option<bool> {
        self.said.pressed
    }

    /// Takes what arrived.
    pub(crate) fn hear(&mut self) {
        for (reader, messages) in self.readers.each_ref().map(take).into_iter().enumerate() {
            messages.iter().for_each(|message| self.said.hear(reader, message.data));
        }
    }

    /// Notes how many publishers the topic has.
    pub(crate) fn note_publishers(&mut self, count: usize) {
        if count == 0 {
            self.said = Said::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressed_counts_from_anyone_and_released_from_the_best_reader() {
        let mut said = Said::default();
        said.hear(2, false);
        assert_eq!(said.pressed, Some(false));
        said.hear(1, true);
        said.hear(2, false);
        assert_eq!(said.pressed, Some(true), "a worse reader may be late");
        said.hear(1, false);
        assert_eq!(said.pressed, Some(false));
        said.hear(2, true);
        assert_eq!(said.pressed, Some(true), "a better reader may be late, too");
    }
}
