//! The bytes on the socket are the fields of the messages, in their order.

use messages::{Layout, OPERATOR_VERSION, OperatorRequest};
use operator::{REQUEST_BYTES, STATUS_BYTES, decode_request, decode_status, encode_request, encode_status};

#[test]
fn random_bytes_survive_round_trip_through_status() {
    let (mut state, mut bytes) = (2_u64, [0; STATUS_BYTES]);
    for _ in 0..10_000 {
        for byte in &mut bytes {
            // Knuth's MMIX generator.
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            *byte = (state >> 56) as u8;
        }
        // Compared as bytes, because a random double may be a NaN, whose bits must survive as well.
        let status = decode_status(&bytes).unwrap();
        assert!(encode_status(&status) == bytes, "every byte belongs to a field");
    }
}

#[test]
fn request_with_wrong_length_version_or_level_is_refused() {
    let good = OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO };
    let bytes = encode_request(&good);
    assert_eq!(decode_request(&bytes), Some(good));
    for length in (0..REQUEST_BYTES).chain([REQUEST_BYTES + 1, 4096]) {
        let mut other = vec![0; length];
        let n = length.min(REQUEST_BYTES);
        other[..n].copy_from_slice(&bytes[..n]);
        assert_eq!(decode_request(&other), None, "{length} bytes");
    }
    assert_eq!(decode_request(&encode_request(&OperatorRequest { version: OPERATOR_VERSION + 1, ..good })), None);
    assert_eq!(decode_request(&encode_request(&OperatorRequest { enable_level: 3, ..good })), None);
    // An invalid payload report must not hide the rest of the request.
    let odd = OperatorRequest { payload_flags: 4, payload_kg: f64::NAN, estop_count: good.estop_count + 1, ..good };
    let received = decode_request(&encode_request(&odd)).expect("the emergency stop is heard");
    assert_eq!(received.estop_count, odd.estop_count);
    assert_eq!(decode_status(&[0; STATUS_BYTES - 1]), None);
}
