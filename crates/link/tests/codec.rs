//! Datagrams as bytes: what is written is read, and what is not written by an end is refused.

use link::{
    Answer, Echo, FRAME_BYTES_MAX, Frame, HEAD_BYTES, Head, Kind, PROTOCOL, Payload, Refusal, Unsendable, Verdict,
};
use messages::{
    Feedback, Header, HingeCalibration, Layout, OPERATOR_VERSION, OperatorRequest, RAW_JOINTS_MAX, RawSkeleton, Stamp,
    Status, raw_flag,
};
use proptest::prelude::*;

fn head(kind: Kind) -> Head {
    let echo = Echo { sequence: 3, sent: Stamp(30), received: Stamp(31) };
    Head { kind, session: 7, client: 8, stops_heard: 0, sequence: 9, sent: Stamp(40), echo }
}

fn person(joints: u32, flags: u32, hinge: f32) -> RawSkeleton {
    let header = Header { sequence: 5, stamp: Stamp(39), origin: Stamp(35), incarnation: 6, ..Header::ZERO };
    let calibration = HingeCalibration { hinge: [[hinge; 3]; 4], ..HingeCalibration::ZERO };
    let mut person = RawSkeleton {
        header,
        session_nonce: 11,
        layout: 1,
        operator_id: 2,
        flags,
        joint_count: joints,
        calibration,
        ..RawSkeleton::ZERO
    };
    for joint in 0..(joints as usize).min(RAW_JOINTS_MAX) {
        person.positions[joint] = [joint as f32, 0.5, -2.0];
        person.confidence[joint] = 0.25;
        if flags & raw_flag::ROTATIONS != 0 {
            person.rotations[joint] = [0.0, 0.5, 0.5, joint as f32];
        }
    }
    person
}

fn bytes_of(payload: Payload) -> Vec<u8> {
    let mut out = [0; FRAME_BYTES_MAX];
    let length = Frame { head: head(payload.kind()), payload }.encode(&mut out).expect("it is sent");
    out[..length].to_vec()
}

fn request() -> OperatorRequest {
    OperatorRequest { version: OPERATOR_VERSION, enable_level: 1, estop_count: 4, ..OperatorRequest::ZERO }
}

fn payloads() -> Vec<Payload> {
    let answer =
        Answer { verdict: Verdict::Ready, led_by_other: true, uncertainty_ns: 1, received: 2, lost: 3, refused: 4 };
    vec![
        Payload::Operator(request()),
        Payload::Person(person(24, raw_flag::ROTATIONS, 0.0)),
        Payload::Person(person(33, 0, 1.0)),
        Payload::Answer(answer),
        Payload::Status(Status { mode: 3, ..Status::ZERO }),
        Payload::Feedback(Feedback { mode: 3, ..Feedback::ZERO }),
    ]
}

#[test]
fn every_kind_survives_the_round_trip() {
    for payload in payloads() {
        let frame = Frame { head: head(payload.kind()), payload };
        assert_eq!(Frame::get(&bytes_of(payload)), Ok(frame));
    }
}

/// One datagram holds them on any network: QUIC guarantees 1,200 bytes, of which zenoh leaves 1,150 to its messages.
#[test]
fn layouts_of_most_trackers_fit_into_one_datagram() {
    for (joints, flags) in [(24, raw_flag::ROTATIONS), (28, raw_flag::ROTATIONS), (33, 0), (55, 0)] {
        let length = bytes_of(Payload::Person(person(joints, flags, 1.0))).len();
        assert!(length <= 1080, "{joints} joints: {length}");
    }
    assert_eq!(bytes_of(Payload::Person(person(96, raw_flag::ROTATIONS, 1.0))).len(), FRAME_BYTES_MAX);
    assert!(bytes_of(Payload::Status(Status::ZERO)).len() <= 1080);
}

#[test]
fn person_with_too_many_joints_or_unknown_flags_is_not_sent() {
    let put =
        |person| Frame { head: head(Kind::Person), payload: Payload::Person(person) }.encode(&mut [0; FRAME_BYTES_MAX]);
    assert_eq!(put(person(97, 0, 0.0)), Err(Unsendable::Joints(97)));
    assert_eq!(put(person(24, 1 << 8, 0.0)), Err(Unsendable::Flags(1 << 8)));
    assert!(put(person(96, raw_flag::CLOSURE | raw_flag::CLUTCH, 0.0)).is_ok());
}

#[test]
fn f128_each_wrong_field_has_its_own_reason() {
    let refused = |change: &dyn Fn(&mut Vec<u8>), payload: Payload| {
        let mut bytes = bytes_of(payload);
        change(&mut bytes);
        Frame::get(&bytes).expect_err("it is refused")
    };
    let (operator, tracked) = (Payload::Operator(request()), Payload::Person(person(24, raw_flag::ROTATIONS, 0.0)));
    for payload in payloads() {
        assert_eq!(refused(&|bytes| _ = bytes.pop(), payload), Refusal::Length);
        assert_eq!(refused(&|bytes| bytes.push(0), payload), Refusal::Length);
        assert_eq!(refused(&|bytes| bytes.truncate(HEAD_BYTES - 1), payload), Refusal::Length);
        assert_eq!(refused(&|bytes| bytes[0] ^= 1, payload), Refusal::Magic);
        assert_eq!(refused(&|bytes| bytes[4] = PROTOCOL as u8 + 1, payload), Refusal::Version);
        assert_eq!(refused(&|bytes| bytes[8] = 6, payload), Refusal::Kind);
        assert_eq!(refused(&|bytes| bytes[24..32].fill(0), payload), Refusal::Value, "no client");
        assert_eq!(refused(&|bytes| bytes[32..40].fill(0), payload), Refusal::Value, "without a sequence number");
    }
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES] ^= 1, operator), Refusal::Value, "version of the request");
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES + 4] = 3, operator), Refusal::Value, "level");
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES + 41] = 1, tracked), Refusal::Value, "flags");
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES + 44] = 97, tracked), Refusal::Value, "joints");
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES + 44] = 23, tracked), Refusal::Length, "one joint too few");
    assert_eq!(refused(&|bytes| bytes[HEAD_BYTES + 52] = 2, tracked), Refusal::Value, "extras");
}

#[test]
fn f128_random_and_mutated_datagrams_are_refused_or_valid() {
    let (mut state, good) = (1_u64, payloads().into_iter().map(bytes_of).collect::<Vec<_>>());
    let mut random = move || {
        // Knuth's MMIX generator.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    };
    let mut refused = 0;
    for n in 0..20_000 {
        let mut bytes = if n % 2 == 0 {
            (0..random() % 1300).map(|_| random() as u8).collect()
        } else {
            good[random() % good.len()].clone()
        };
        for _ in 0..random() % 8 {
            if let Some(byte) = (!bytes.is_empty()).then(|| random() % bytes.len()) {
                bytes[byte] = random() as u8;
            }
        }
        match Frame::get(&bytes) {
            Err(_) => refused += 1,
            Ok(frame) => {
                let mut out = [0; FRAME_BYTES_MAX];
                let length = frame.encode(&mut out).expect("what was read can be sent");
                assert_eq!(out[..length], bytes[..], "one datagram, one meaning");
            }
        }
    }
    assert!(refused > 10_000, "{refused}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn any_person_survives_the_round_trip(
        joints in 0_u32..=96,
        flags in any::<u32>(),
        hinge in -1.0_f32..1.0,
        numbers in prop::collection::vec(-10.0_f32..10.0, 96 * 8),
    ) {
        let flags = flags & (0xffff_0000 | 15);
        let mut person = person(joints, flags, hinge);
        for (joint, of_joint) in numbers.chunks(8).take(joints as usize).enumerate() {
            person.positions[joint].copy_from_slice(&of_joint[..3]);
            person.confidence[joint] = of_joint[3];
            if flags & raw_flag::ROTATIONS != 0 {
                person.rotations[joint].copy_from_slice(&of_joint[4..]);
            }
        }
        let frame = Frame { head: head(Kind::Person), payload: Payload::Person(person) };
        prop_assert_eq!(Frame::get(&bytes_of(Payload::Person(person))), Ok(frame));
    }
}
