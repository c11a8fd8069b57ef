//! The bytes on the socket are the fields of the messages, in their order.

use messages::{Layout, Message, OPERATOR_VERSION, OperatorRequest, Status};
use operator::{REQUEST_BYTES, STATUS_BYTES, decode_request, decode_status, encode_request, encode_status};

/// A sequence of bits without pattern (splitmix64, Steele, Lea and Flood 2014).
struct Bits(u64);

impl Bits {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn fill(&mut self, bytes: &mut [u8]) {
        bytes.iter_mut().for_each(|byte| *byte = self.next() as u8);
    }
}

#[test]
fn random_requests_survive_round_trip() {
    let mut bits = Bits(1);
    for _ in 0..10_000 {
        let request = OperatorRequest {
            version: OPERATOR_VERSION,
            enable_level: (bits.next() % 3) as u32,
            enable_count: bits.next() as u32,
            release_count: bits.next() as u32,
            reset_count: bits.next() as u32,
            estop_count: bits.next() as u32,
            payload_count: bits.next() as u32,
            payload_flags: (bits.next() % 4) as u32,
            sequence: bits.next(),
            payload_kg: bits.next() as f64,
            payload_centre_m: std::array::from_fn(|_| bits.next() as f64 * 1e-19),
        };
        assert_eq!(decode_request(&encode_request(&request)), Some(request));
    }
}

#[test]
fn random_bytes_survive_round_trip_through_status() {
    let mut bits = Bits(2);
    let mut bytes = [0; STATUS_BYTES];
    for _ in 0..10_000 {
        bits.fill(&mut bytes);
        // Compared as bytes, because a random double may be a NaN, whose bits must survive as well.
        let status = decode_status(&bytes).unwrap();
        assert!(encode_status(&status) == bytes, "every byte belongs to a field");
    }
}

#[test]
fn encoded_fields_lie_at_layout_offsets() {
    let at = |fields: &[messages::Field], name: &str| fields.iter().find(|f| f.name == name).unwrap().offset;
    let read = |bytes: &[u8], offset: usize| u32::from_le_bytes(bytes[offset..offset + 4].try_into().unwrap());

    let request = OperatorRequest { estop_count: 0x1234_5678, ..OperatorRequest::ZERO };
    assert_eq!(read(&encode_request(&request), at(OperatorRequest::FIELDS, "estop_count")), 0x1234_5678);

    let laden = OperatorRequest { payload_centre_m: [0.0, 0.0, 0.25], ..OperatorRequest::ZERO };
    let offset = at(OperatorRequest::FIELDS, "payload_centre_m") + 16;
    assert_eq!(encode_request(&laden)[offset..offset + 8], 0.25_f64.to_le_bytes());

    let mut status = Status::ZERO;
    status.mode = 11;
    status.fault_counts[0] = 12;
    status.realtime = 13;
    status.transition_count = 14;
    status.transitions[0].k = 15;
    status.nearest_pair[0] = 16;
    status.k = 17;
    let bytes = encode_status(&status);
    for (name, expected) in [
        ("mode", 11),
        ("fault_counts", 12),
        ("realtime", 13),
        ("transition_count", 14),
        ("transitions", 15),
        ("nearest_pair", 16),
        ("k", 17),
    ] {
        assert_eq!(read(&bytes, at(Status::FIELDS, name)), expected, "{name}");
    }
    let laden = Status { payload_kg: [0.0, 0.5], ..Status::ZERO };
    let offset = at(Status::FIELDS, "payload_kg") + 8;
    assert_eq!(encode_status(&laden)[offset..offset + 8], 0.5_f64.to_le_bytes());
    let speed = Status { speed_scale: 0.75, ..Status::ZERO };
    let offset = at(Status::FIELDS, "speed_scale");
    assert_eq!(encode_status(&speed)[offset..offset + 8], 0.75_f64.to_le_bytes());
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
