//! The bytes on the socket are the fields of the messages, in their order.

use messages::{Layout, OPERATOR_VERSION, OperatorRequest};
use operator::{STATUS_BYTES, decode_request, decode_status, encode_request, encode_status};

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

/// An invalid payload report must not hide the rest of the request.
#[test]
fn request_with_invalid_payload_keeps_its_emergency_stop() {
    let good = OperatorRequest { version: OPERATOR_VERSION, ..OperatorRequest::ZERO };
    let odd = OperatorRequest { payload_flags: 4, payload_kg: f64::NAN, estop_count: 1, ..good };
    let received = decode_request(&encode_request(&odd)).expect("the emergency stop is heard");
    assert_eq!(received.estop_count, odd.estop_count);
    assert_eq!(decode_status(&[0; STATUS_BYTES - 1]), None);
}
