//! The state of the robot's emergency stop, as the robot says it.
//!
//! Some robots say it once a second, others when it changes only. So the age of a message says nothing. The end of its
//! publisher does: nobody would then say that the stop was pressed. DDS notices that a process ended by the lease of its
//! participant: 10 s for Cyclone DDS, 20 s for Fast DDS. dust_dds 0.16 does not notice a publisher that leaves alone.

use crate::dds::{Member, best_effort_qos, readers, reliable_qos, take_messages, transient_local_qos};
use crate::ros::{Bool, topic};
use dust_dds::subscription::data_reader::DataReader;

pub(crate) struct EmergencyStop {
    pub(crate) topic: String,
    /// The first gets what was sent before it came, if the publisher keeps that. The second gets each message, if the
    /// publisher is reliable. The last takes any publisher, and may miss messages.
    readers: [DataReader<Bool>; 3],
    last: LastMessage,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct LastMessage {
    pressed: Option<bool>,
    /// The best reader that heard it.
    by: Option<usize>,
}

impl LastMessage {
    /// Takes what a reader heard. Each of them counts if it says pressed, and only the best one if it says released: another
    /// may be late.
    fn receive(&mut self, reader: usize, pressed: bool) {
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
    pub(crate) fn open(member: &Member, ros: &str) -> Result<Self, String> {
        let readers = readers(member, ros, [transient_local_qos(), reliable_qos(), best_effort_qos()])?;
        Ok(Self { topic: topic(ros), readers, last: LastMessage::default() })
    }

    /// True while it is pressed. None before the first message, and once its publisher left.
    pub(crate) fn pressed(&self) -> Option<bool> {
        self.last.pressed
    }

    pub(crate) fn receive(&mut self) {
        for (reader, messages) in self.readers.each_ref().map(take_messages).into_iter().enumerate() {
            messages.iter().for_each(|message| self.last.receive(reader, message.data));
        }
    }

    /// Notes how many publishers the topic has.
    pub(crate) fn set_publisher_count(&mut self, count: usize) {
        if count == 0 {
            self.last = LastMessage::default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressed_counts_from_anyone_and_released_from_the_best_reader() {
        let mut last = LastMessage::default();
        last.receive(2, false);
        assert_eq!(last.pressed, Some(false));
        last.receive(1, true);
        last.receive(2, false);
        assert_eq!(last.pressed, Some(true), "a worse reader may be late");
        last.receive(1, false);
        assert_eq!(last.pressed, Some(false));
        last.receive(2, true);
        assert_eq!(last.pressed, Some(true), "a better reader may be late, too");
    }
}
