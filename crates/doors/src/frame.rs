//! A `RawSkeleton` as bytes: its fields in their order, little-endian ([`Layout::put`]).

use messages::{Layout, Message, RawSkeleton};

/// Length of a frame on the socket.
pub const FRAME_BYTES: usize = size_of::<RawSkeleton>();

/// Returns the bytes of a frame.
pub fn encode_frame(frame: &RawSkeleton) -> [u8; FRAME_BYTES] {
    let mut bytes = [0; FRAME_BYTES];
    frame.write_to(&mut bytes);
    bytes
}

/// Returns the frame in `bytes`, whatever their values. Returns `None` if the length is not that of a frame.
pub fn decode_frame(bytes: &[u8]) -> Option<RawSkeleton> {
    RawSkeleton::from_le_bytes(bytes)
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
