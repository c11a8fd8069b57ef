//! UDP packets from a motion capture program, or from any other sender.

use bridge::{Mvn, Protocol, Vmc};
use messages::RawSkeleton;

pub(crate) fn mvn(input: &[u8]) {
    listen(&mut Mvn::new(None), input, 23);
}

pub(crate) fn vmc(input: &[u8]) {
    listen(&mut Vmc::default(), input, 55);
}

/// Runs the input. It consists of packets, each with its length (u16) before it. The rest is the last packet.
fn listen(protocol: &mut dyn Protocol, input: &[u8], joints: usize) {
    let mut rest = input;
    let mut publish = |frame: &RawSkeleton| {
        assert_eq!(frame.joint_count as usize, joints);
        let mut numbers = frame.positions.iter().flatten().chain(frame.rotations.iter().flatten());
        assert!(numbers.all(|x| x.is_finite()), "a frame of numbers that are none");
    };
    while let Some((length, behind)) = rest.split_first_chunk::<2>() {
        let length = usize::from(u16::from_le_bytes(*length)).min(behind.len());
        let (packet, after) = behind.split_at(length);
        let _ = protocol.decode(packet, &mut publish);
        rest = after;
    }
    let _ = protocol.decode(rest, &mut publish);
}
