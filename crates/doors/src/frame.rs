//! A `RawSkeleton` as bytes.

use crate::fields::{FieldReader, FieldWriter, Fields};
use messages::{Header, HingeCalibration, Layout, RawSkeleton, Stamp};

/// Length of a frame on the socket.
pub const FRAME_BYTES: usize = size_of::<RawSkeleton>();

fn fields(fields: &mut impl Fields, frame: &mut RawSkeleton) {
    let Header { sequence, stamp: Stamp(stamp), origin: Stamp(origin), config_hash, incarnation, reserved } =
        &mut frame.header;
    for value in [sequence, stamp, origin, config_hash] {
        fields.u64(value);
    }
    fields.u32(incarnation);
    fields.u32(reserved);
    fields.u64(&mut frame.session_nonce);
    for value in [&mut frame.layout, &mut frame.operator_id, &mut frame.flags, &mut frame.joint_count] {
        fields.u32(value);
    }
    frame.positions.iter_mut().flatten().for_each(|value| fields.f32(value));
    frame.rotations.iter_mut().flatten().for_each(|value| fields.f32(value));
    frame.confidence.iter_mut().for_each(|value| fields.f32(value));
    frame.joint_flags.iter_mut().for_each(|value| fields.u32(value));
    let HingeCalibration { hinge, flags, samples } = &mut frame.calibration;
    hinge.iter_mut().flatten().for_each(|value| fields.f32(value));
    fields.u32(flags);
    fields.u32(samples);
}

/// Returns the bytes of a frame.
pub fn encode_frame(frame: &RawSkeleton) -> [u8; FRAME_BYTES] {
    let mut bytes = [0; FRAME_BYTES];
    fields(&mut FieldWriter::new(&mut bytes), &mut { *frame });
    bytes
}

/// Returns the frame in `bytes`, whatever their values. Returns `None` if the length is not that of a frame.
pub fn decode_frame(bytes: &[u8]) -> Option<RawSkeleton> {
    let mut frame = RawSkeleton::ZERO;
    if bytes.len() != FRAME_BYTES {
        return None;
    }
    fields(&mut FieldReader::new(bytes), &mut frame);
    Some(frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_bytes_survive_decode_and_encode() {
        let bytes: Vec<u8> = (0..FRAME_BYTES).map(|i| (i * 7 + i / 251) as u8).collect();
        let frame = decode_frame(&bytes).unwrap();
        assert_eq!(encode_frame(&frame)[..], bytes[..]);
        assert_eq!(frame.header.sequence, u64::from_le_bytes(bytes[..8].try_into().unwrap()));
    }

    #[test]
    fn f018_frame_of_other_length_is_refused() {
        for length in [0, 1, FRAME_BYTES - 1, FRAME_BYTES + 1] {
            assert!(decode_frame(&vec![0; length]).is_none(), "{length}");
        }
    }
}
