//! The skeleton socket for other users: packets of a client, and replies.

use doors::{
    ANSWER_BYTES, FRAME_BYTES, HELLO_BYTES, Hello, REQUESTS_FEEDBACK, ReplyPacket, chunk_from_json, decode_frame,
    encode_frame,
};
use messages::{CHUNK_ROWS_MAX, RobotId, Stamp};

/// Decodes the bytes as a packet of each kind. Also pads or cuts them to the length of a frame.
pub(crate) fn run(input: &[u8]) {
    let ours = Hello::OURS.encode();
    let feedback = Hello { requests: REQUESTS_FEEDBACK, ..Hello::OURS }.encode();
    let is_ours = |bytes: &[u8]| bytes == ours || bytes == feedback;
    assert_eq!(Hello::refusal(input).is_none(), is_ours(input), "only our own hello is admitted");
    let mut hello = ours;
    let length = input.len().min(HELLO_BYTES);
    hello[..length].iter_mut().zip(input).for_each(|(byte, change)| *byte ^= change);
    assert_eq!(Hello::refusal(&hello).is_none(), is_ours(&hello), "only our own hello is admitted");

    if let Some(answer) = ReplyPacket::decode(input) {
        assert_eq!(ReplyPacket::decode(&answer.encode()).map(|again| again.word), Some(answer.word));
    }
    assert!(input.len() == ANSWER_BYTES || ReplyPacket::decode(input).is_none());

    let joints = ["a", "b"].map(str::to_owned);
    let robot = RobotId { hash: 1, joint_count: 2, reserved: 0 };
    match chunk_from_json(input, &joints, robot, Stamp(1)) {
        Ok(chunk) => assert!(chunk.rows > 0 && chunk.rows as usize <= CHUNK_ROWS_MAX && chunk.valid_mask < 4),
        Err((_, why)) => assert!(!why.is_empty()),
    }

    assert_eq!(decode_frame(input).is_some(), input.len() == FRAME_BYTES, "a frame of another length");
    let mut bytes = [0; FRAME_BYTES];
    let length = input.len().min(FRAME_BYTES);
    bytes[..length].copy_from_slice(&input[..length]);
    let frame = decode_frame(&bytes).expect("as long as a frame");
    assert!(same(&encode_frame(&frame), &bytes), "a byte of a frame was lost");
}

/// Compares bit for bit. A processor may make a signalling NaN quiet, so NaNs may differ.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.chunks(4).zip(b.chunks(4)).all(|(a, b)| {
        let word = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        word(a) == word(b) || f32::from_bits(word(a)).is_nan() && f32::from_bits(word(b)).is_nan()
    })
}
