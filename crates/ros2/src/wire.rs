//! A UDP transport for a network that loses packets. Each datagram is sent [`COPIES`] = 2 times:
//!
//! ```text
//! p_lost = p^2        p: share of the datagrams that the network loses
//! ```
//!
//! A late setpoint is useless, because the next one replaces it. A best-effort writer matches no reliable reader of a robot,
//! so our writers are reliable. But a reliable writer announces all messages that are not acknowledged yet, and its reader
//! waits for each of them. So this transport changes two submessages:
//!
//! - A HEARTBEAT announces the newest message only. RTPS (section 8.4.2.2.4) allows this for a writer that keeps the last
//!   message. The reader then skips lost messages, and delivers the newest at once.
//! - A reader's liveliness lease of `INFINITE` (`dds.rs`) is announced as infinite.

use dust_dds::rtps_udp_transport::udp_transport::RtpsUdpTransportParticipantFactory;
use dust_dds::transport::interface::{
    RtpsTransportParticipant, TransportDataReceiver, TransportParticipantFactory, WriteMessage,
};
use dust_dds::transport::types::Locator;

/// Copies of each datagram.
const COPIES: usize = 2;
/// Length of an RTPS header, and of a submessage's header, bytes (RTPS, sections 9.4.4 and 9.4.5.1).
const HEADER: usize = 20;
const SUBMESSAGE: usize = 4;
/// Kind of the submessage HEARTBEAT (RTPS, section 9.4.5.1.1).
const HEARTBEAT: u8 = 0x07;
/// Offsets in a HEARTBEAT, bytes: the last byte of the writer's id, the first sequence number, the last one, and the end (RTPS,
/// section 9.4.5.7).
const WRITER_KIND: usize = SUBMESSAGE + 7;
const FIRST: usize = SUBMESSAGE + 8;
const LAST: usize = SUBMESSAGE + 16;
const END: usize = SUBMESSAGE + 24;
/// Bits in the kind of a built-in entity, which DDS uses for discovery (RTPS, table 9.1).
const BUILT_IN: u8 = 0xc0;

/// The parameter PID_LIVELINESS of discovery, automatic, with the time of `INFINITE` in `dds.rs` (RTPS, sections 9.3.2 and
/// 9.6.4): its last word counts 2^-32 s.
const LIVELINESS: [u8; 16] = [0x1b, 0, 12, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0x7f, 0xfc, 0xff, 0xff, 0xff];

/// UDP with every datagram sent twice.
pub struct LossTolerantUdp(pub RtpsUdpTransportParticipantFactory);

impl TransportParticipantFactory for LossTolerantUdp {
    fn create_participant(&self, domain_id: i32, receiver: TransportDataReceiver) -> RtpsTransportParticipant {
        let udp = self.0.create_participant(domain_id, receiver);
        RtpsTransportParticipant { message_writer: Box::new(Writer(udp.message_writer)), ..udp }
    }
}

struct Writer(Box<dyn WriteMessage + Send + Sync>);

impl WriteMessage for Writer {
    fn write_buffer_mut(&mut self) -> &mut [u8] {
        self.0.write_buffer_mut()
    }

    fn write_message(&mut self, length: usize, to: &[Locator]) {
        send(self.0.as_mut(), length, to);
    }
}

fn send(udp: &mut dyn WriteMessage, length: usize, to: &[Locator]) {
    if let Some(datagram) = udp.write_buffer_mut().get_mut(..length) {
        announce_newest(datagram);
        announce_infinite(datagram);
    }
    for _ in 0..COPIES {
        udp.write_message(length, to);
    }
}

/// Makes each HEARTBEAT of a datagram announce the newest message only. HEARTBEATs of discovery stay unchanged.
fn announce_newest(datagram: &mut [u8]) {
    let mut rest = datagram.get_mut(HEADER..).unwrap_or_default();
    while let [kind, flags, low, high, ..] = *rest {
        let number =
            |bytes: [u8; 2]| if flags & 1 == 1 { u16::from_le_bytes(bytes) } else { u16::from_be_bytes(bytes) };
        let length = SUBMESSAGE + usize::from(number([low, high]));
        if kind == HEARTBEAT && length >= END && rest.len() >= END && rest[WRITER_KIND] & BUILT_IN == 0 {
            // Before a writer's first message, its first number is above its last. Both stay unchanged.
            if is_less(&rest[FIRST..LAST], &rest[LAST..END], flags & 1 == 1) {
                rest.copy_within(LAST..END, FIRST);
            }
        }
        rest = rest.get_mut(length..).unwrap_or_default();
    }
}

/// Replaces a reader's liveliness lease of `INFINITE` by an infinite one.
fn announce_infinite(datagram: &mut [u8]) {
    let found = datagram.windows(LIVELINESS.len()).position(|bytes| bytes == LIVELINESS);
    if let Some(end) = found.and_then(|at| datagram.get_mut(at + LIVELINESS.len() - 4..at + LIVELINESS.len())) {
        end.fill(0xff);
    }
}

/// Returns true if a < b for the sequence numbers 2^32 high + low. `high` is signed, and comes first.
fn is_less(a: &[u8], b: &[u8], little: bool) -> bool {
    let words = |bytes: &[u8]| {
        let word = |i: usize| {
            let bytes: [u8; 4] = std::array::from_fn(|at| bytes[i + at]);
            if little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) }
        };
        (word(0) as i32, word(4))
    };
    words(a) < words(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A datagram with an INFO_TS and a HEARTBEAT of a writer of this kind.
    fn datagram(writer: u8, first: u8, last: u8) -> Vec<u8> {
        let mut bytes = vec![0; HEADER];
        bytes.extend([0x09, 1, 8, 0, 1, 1, 1, 1, 2, 2, 2, 2]);
        bytes.extend([HEARTBEAT, 1, 28, 0, 0, 0, 1, 4, 0, 0, 1, writer]);
        bytes.extend([0, 0, 0, 0, first, 0, 0, 0, 0, 0, 0, 0, last, 0, 0, 0, 9, 0, 0, 0]);
        bytes
    }

    #[test]
    fn heartbeat_announces_the_newest_message_only() {
        let announced = |writer, first, last| {
            let mut bytes = datagram(writer, first, last);
            announce_newest(&mut bytes);
            bytes
        };
        assert_eq!(announced(0x03, 5, 70), datagram(0x03, 70, 70));
        assert_eq!(announced(0xc2, 5, 70), datagram(0xc2, 5, 70), "discovery needs all");
        assert_eq!(announced(0x03, 6, 5), datagram(0x03, 6, 5), "nothing was sent yet");
        for length in 0..datagram(0x03, 5, 70).len() {
            let mut cut = datagram(0x03, 5, 70);
            cut.truncate(length);
            announce_newest(&mut cut);
            assert_eq!(cut.len(), length);
        }
    }

    #[test]
    fn infinite_liveliness_is_announced_as_infinite() {
        let mut bytes = [&[7; 21][..], &LIVELINESS, &[7; 3]].concat();
        announce_infinite(&mut bytes);
        assert_eq!(bytes, [&[7; 21][..], &LIVELINESS[..12], &[0xff; 4], &[7; 3]].concat());
        let before = bytes.clone();
        announce_infinite(&mut bytes);
        assert_eq!(bytes, before);
    }

    struct Count(Vec<u8>, usize);

    impl WriteMessage for Count {
        fn write_buffer_mut(&mut self) -> &mut [u8] {
            &mut self.0
        }

        fn write_message(&mut self, length: usize, _to: &[Locator]) {
            assert_eq!(self.0[..length], datagram(0x03, 70, 70));
            self.1 += 1;
            assert!(self.1 <= COPIES);
        }
    }

    #[test]
    fn every_datagram_goes_twice() {
        let mut count = Count(datagram(0x03, 5, 70), 0);
        let length = count.0.len();
        send(&mut count, length, &[]);
        assert_eq!(count.1, 2);
    }
}
