//! Xsens MVN's real-time stream, message 02: position and rotation of every segment, global, z up.
//!
//! A packet is a header of 24 bytes and items of 32, all big-endian. The header begins with `MXTP02`, u32 sample, u8
//! number of the packet in its sample (bit 7: the last), u8 items. Then it has u32 time code, u8 character, u8 body
//! segments, u8 props, u8 finger segments, u16 reserved, u16 length of the items. An item is u32 segment id, 3 f32
//! position (m), 4 f32 quaternion w x y z. (Xsens, MVN Real-time Network Streaming Protocol Specification.)

use crate::{Counts, Protocol, Refused, Taken, empty};
use messages::{RawSkeleton, SkeletonLayout, raw_flag};

const HEADER: usize = 24;
const ITEM: usize = 32;
/// Number of segments of the body. Their ids begin at 1. Props and fingers have higher ids.
const SEGMENTS: usize = 23;
const ALL: u32 = (1 << SEGMENTS) - 1;

/// Smallest age of a sample, relative to the last, that indicates a restarted recording instead of a late
/// packet: 2 s at 240 Hz.
const BEGAN_ANEW: u32 = 480;

#[derive(Clone, Debug)]
pub struct Mvn {
    asked: Option<u8>,
    character: Option<u8>,
    sample: Option<u32>,
    /// Bit i: segment i + 1 has arrived.
    seen: u32,
    frame: RawSkeleton,
    counts: Counts,
}

impl Mvn {
    /// Creates a receiver of this character, or of the first one with a segment of the body.
    pub fn new(asked: Option<u8>) -> Self {
        let mut frame = empty(SkeletonLayout::XsensMvn23, SEGMENTS, raw_flag::ROTATIONS);
        frame.confidence[..SEGMENTS].fill(1.0);
        Self { asked, character: asked, sample: None, seen: 0, frame, counts: Counts::default() }
    }

    /// Returns an error if the packet's sample is old. A new sample begins without any segments.
    fn begin(&mut self, sample: u32) -> Result<(), Refused> {
        let Some(last) = self.sample.filter(|&last| last != sample) else {
            self.sample = Some(sample);
            return Ok(());
        };
        // Serial numbers (RFC 1982) may wrap.
        if sample.wrapping_sub(last) > u32::MAX / 2 {
            if last.wrapping_sub(sample) >= BEGAN_ANEW {
                // Later samples belong to another session.
                (self.sample, self.seen, self.character) = (None, 0, self.asked);
                self.counts.restarts += 1;
            }
            return Err(Refused::Late);
        }
        self.counts.unfinished += u64::from(![0, ALL].contains(&self.seen));
        (self.sample, self.seen) = (Some(sample), 0);
        Ok(())
    }
}

impl Protocol for Mvn {
    fn decode(&mut self, packet: &[u8], publish: &mut dyn FnMut(&RawSkeleton)) -> Result<Taken, Refused> {
        match packet {
            [b'M', b'X', b'T', b'P', b'0', b'2', ..] => {}
            // Joint angles, scaling, metadata and other messages of the same stream.
            [b'M', b'X', b'T', b'P', b'0'..=b'9', b'0'..=b'9', ..] => return Ok(Taken::Aside),
            _ => return Err(Refused::Protocol),
        }
        let (header, items) = packet.split_at_checked(HEADER).ok_or(Refused::Length)?;
        let length = usize::from(u16::from_be_bytes([header[22], header[23]]));
        if items.len() != length || items.len() != usize::from(header[11]) * ITEM {
            return Err(Refused::Length);
        }
        let character = header[16];
        if self.character.is_some_and(|ours| ours != character) {
            return Err(Refused::Character);
        }
        // If any part of a packet is wrong, nothing of it is used.
        let mut seen = 0_u32;
        for item in items.chunks_exact(ITEM) {
            let bit = segment(item).map_or(0, |i| 1 << i);
            if seen & bit != 0 {
                return Err(Refused::Twice);
            }
            seen |= bit;
        }
        if seen == 0 {
            // Props and fingers alone do not belong to a person.
            return Ok(Taken::Aside);
        }
        self.begin(u32::from_be_bytes([header[6], header[7], header[8], header[9]]))?;
        if self.seen & seen != 0 {
            return Err(Refused::Twice);
        }
        self.character = Some(character);
        for item in items.chunks_exact(ITEM) {
            let Some(i) = segment(item) else { continue };
            let [x, y, z, q @ ..] = numbers(item);
            // NaN and a quaternion of zeros mark a segment that is not seen.
            let is_seen = [x, y, z].iter().chain(&q).all(|x| x.is_finite()) && q != [0.0; 4];
            self.frame.confidence[i] = f32::from(u8::from(is_seen));
            if is_seen {
                (self.frame.positions[i], self.frame.rotations[i]) = ([x, y, z], q);
            }
        }
        self.seen |= seen;
        if self.seen == ALL {
            publish(&self.frame);
        }
        Ok(Taken::Person)
    }

    fn for_new_sender(&self) -> Self {
        Self { counts: self.counts, ..Self::new(self.asked) }
    }

    fn counts(&self) -> Counts {
        self.counts
    }
}

/// Returns the index of an item's segment, if it belongs to the body.
fn segment(item: &[u8]) -> Option<usize> {
    let id = u32::from_be_bytes([item[0], item[1], item[2], item[3]]);
    (id as usize).checked_sub(1).filter(|&i| i < SEGMENTS)
}

fn numbers(item: &[u8]) -> [f32; 7] {
    std::array::from_fn(|n| {
        let at = 4 + 4 * n;
        f32::from_be_bytes([item[at], item[at + 1], item[at + 2], item[at + 3]])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::taken as take;

    type Item = (u32, [f32; 7]);

    fn packet(sample: u32, number: u8, character: u8, items: &[Item]) -> Vec<u8> {
        let mut bytes = b"MXTP02".to_vec();
        bytes.extend(sample.to_be_bytes());
        bytes.extend([number, items.len() as u8]);
        bytes.extend(0_u32.to_be_bytes());
        bytes.extend([character, 23, 0, 0, 0, 0]);
        bytes.extend((32 * items.len() as u16).to_be_bytes());
        for (id, numbers) in items {
            bytes.extend(id.to_be_bytes());
            numbers.iter().for_each(|x| bytes.extend(x.to_be_bytes()));
        }
        bytes
    }

    /// Segment i + 1 is at (i, 2 i, 3 i), turned about z by i degrees.
    fn items() -> Vec<Item> {
        let turned = |i: u32| (i as f32).to_radians() / 2.0;
        (0..23)
            .map(|i| (i + 1, [i as f32, 2.0 * i as f32, 3.0 * i as f32, turned(i).cos(), 0.0, 0.0, turned(i).sin()]))
            .collect()
    }

    #[test]
    fn person_in_one_or_several_packets_makes_one_frame() {
        let items = items();
        let whole = packet(7, 0x80, 0, &items);
        assert_eq!(whole.len(), 760, "as the manual has it");
        let (outcome, frames) = take(&mut Mvn::new(None), &whole);
        assert_eq!((outcome, frames.len()), (Ok(Taken::Person), 1));
        let frame = frames[0];
        assert_eq!((frame.layout, frame.joint_count, frame.flags), (6, 23, raw_flag::ROTATIONS));
        for (i, (_, expected)) in items.iter().enumerate() {
            assert_eq!(frame.positions[i], expected[..3]);
            assert_eq!(frame.rotations[i], expected[3..]);
            assert_eq!(frame.confidence[i], 1.0);
        }
        // Two packets, in either order, with fingers and props after the body.
        let mut more = items.clone();
        more.extend([(24, [0.5; 7]), (40, [0.25; 7])]);
        for order in [[0, 1], [1, 0]] {
            let parts = [packet(7, 0, 0, &more[..10]), packet(7, 0x81, 0, &more[10..])];
            let mut mvn = Mvn::new(None);
            assert!(take(&mut mvn, &parts[order[0]]).1.is_empty());
            let (outcome, frames) = take(&mut mvn, &parts[order[1]]);
            assert_eq!((outcome, frames), (Ok(Taken::Person), vec![frame]));
        }
        let mut mvn = Mvn::new(None);
        assert!(take(&mut mvn, &packet(6, 0, 0, &more[..10])).1.is_empty());
        assert_eq!((take(&mut mvn, &whole).1, mvn.counts().unfinished), (vec![frame], 1), "after a lost packet");
    }

    #[test]
    fn invalid_packet_is_refused_and_changes_no_state() {
        let items = items();
        let good = packet(7, 0x80, 0, &items);
        let mut mvn = Mvn::new(None);
        assert!(take(&mut mvn, &packet(7, 0, 0, &items[..10])).1.is_empty());
        let mut twice = items[10..].to_vec();
        twice[1].0 = twice[0].0;
        let mut longer = good.clone();
        longer.push(0);
        let mut says_more = good.clone();
        says_more[11] = 24;
        for (bytes, refused) in [
            (&packet(7, 0x81, 0, &twice)[..], Refused::Twice),
            (&packet(7, 0x81, 0, &items[9..]), Refused::Twice),
            (&packet(6, 0x80, 0, &items), Refused::Late),
            (&longer, Refused::Length),
            (&says_more, Refused::Length),
            (&good[..23], Refused::Length),
            (b"MXTP0", Refused::Protocol),
            (b"/VMC/Ext/OK", Refused::Protocol),
            (b"", Refused::Protocol),
        ] {
            assert_eq!(take(&mut mvn, bytes), (Err(refused), vec![]));
        }
        assert_eq!(take(&mut mvn, b"MXTP13").0, Ok(Taken::Aside), "another message of the same stream");
        assert_eq!(take(&mut mvn, &packet(9, 0x80, 1, &items)), (Err(Refused::Character), vec![]));
        assert_eq!(take(&mut mvn, &packet(7, 0x81, 0, &items[10..])).1.len(), 1, "the rest of sample 7");
        assert_eq!(take(&mut mvn, &packet(7, 0x82, 0, &[(30, [0.0; 7])])).1.len(), 0, "fingers alone are nobody");
    }

    #[test]
    fn restarted_stream_counts_as_restart_but_counter_wrap_does_not() {
        let items = items();
        let mut mvn = Mvn::new(None);
        for (sample, frames, restarts) in [
            (u32::MAX - 1, 1, 0),
            (u32::MAX, 1, 0),
            (u32::MAX - 1, 0, 0),
            (0, 1, 0),
            (5000, 1, 0),
            (5000, 0, 0),
            (0, 0, 1),
            (1, 1, 1),
        ] {
            let (_, made) = take(&mut mvn, &packet(sample, 0x80, 0, &items));
            assert_eq!((made.len(), mvn.counts().restarts), (frames, restarts), "{sample}");
        }
    }

    #[test]
    fn segment_that_is_marked_as_not_seen_is_held_without_confidence() {
        for mark in [[f32::NAN; 7], [0.0; 7], [1.0, 1.0, f32::INFINITY, 1.0, 0.0, 0.0, 0.0]] {
            let (mut mvn, items) = (Mvn::new(None), items());
            let (_, before) = take(&mut mvn, &packet(1, 0x80, 0, &items));
            let mut marked = items.clone();
            marked[13].1 = mark;
            let (_, frames) = take(&mut mvn, &packet(2, 0x80, 0, &marked));
            let mut held = before[0];
            held.confidence[13] = 0.0;
            assert_eq!(frames, [held], "{mark:?}");
            assert_eq!(take(&mut mvn, &packet(3, 0x80, 0, &items)).1, before, "seen again");
        }
    }

    #[test]
    fn first_character_with_a_body_is_followed_per_sender() {
        let items = items();
        let fingers: Vec<Item> = vec![(30, [0.5; 7])];
        let mut mvn = Mvn::new(None);
        for none in [packet(1, 0x80, 5, &[]), packet(1, 0x80, 6, &fingers)] {
            assert_eq!(take(&mut mvn, &none), (Ok(Taken::Aside), vec![]));
        }
        let mut twice = items.clone();
        twice[3].0 = 1;
        assert_eq!(take(&mut mvn, &packet(1, 0x80, 7, &twice)).0, Err(Refused::Twice));
        assert_eq!(take(&mut mvn, &packet(1, 0x80, 2, &items)).1.len(), 1, "the first that has a body");
        assert_eq!(take(&mut mvn, &packet(2, 0x80, 5, &items)), (Err(Refused::Character), vec![]));
        assert_eq!(take(&mut mvn.for_new_sender(), &packet(1, 0x80, 5, &items)).1.len(), 1, "another sender's");
        // The program restarted, with another character.
        assert_eq!(take(&mut mvn, &packet(9000, 0x80, 2, &items)).1.len(), 1);
        assert_eq!(take(&mut mvn, &packet(1, 0x80, 2, &items)).0, Err(Refused::Late));
        assert_eq!(take(&mut mvn, &packet(2, 0x80, 5, &items)).1.len(), 1);
        assert_eq!(mvn.for_new_sender().counts().restarts, 1);
        let mut asked = Mvn::new(Some(3)).for_new_sender();
        assert_eq!(take(&mut asked, &packet(1, 0x80, 2, &items)).0, Err(Refused::Character));
        assert_eq!(take(&mut asked, &packet(1, 0x80, 3, &items)).1.len(), 1);
    }
}
