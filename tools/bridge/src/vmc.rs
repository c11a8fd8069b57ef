//! VMC (Virtual Motion Capture): local transforms of Unity's bones as OSC messages.
//!
//! `/VMC/Ext/Root/Pos` and `/VMC/Ext/Bone/Pos` have a name, a position (m) and a quaternion x y z w.
//! `/VMC/Ext/T` ends a frame. If a sender omits it, the next hips end the frame. `/VMC/Ext/OK 0` means that no
//! person is tracked. (Virtual Motion Capture Protocol 2.7.)

use crate::{Protocol, Refused, Taken, empty};
use messages::{RawSkeleton, SkeletonLayout, raw_flag};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use rosc::{OscMessage, OscPacket, OscType};

/// Bones of the body and their indices in `HumanBodyBones`. Fingers, eyes and jaw have no effect here.
const BONES: [(&str, usize); 22] = [
    ("Hips", HIPS),
    ("LeftUpperLeg", 1),
    ("RightUpperLeg", 2),
    ("LeftLowerLeg", 3),
    ("RightLowerLeg", 4),
    ("LeftFoot", 5),
    ("RightFoot", 6),
    ("Spine", 7),
    ("Chest", 8),
    ("Neck", 9),
    ("Head", 10),
    ("LeftShoulder", 11),
    ("RightShoulder", 12),
    ("LeftUpperArm", 13),
    ("RightUpperArm", 14),
    ("LeftLowerArm", 15),
    ("RightLowerArm", 16),
    ("LeftHand", 17),
    ("RightHand", 18),
    ("LeftToes", 19),
    ("RightToes", 20),
    ("UpperChest", 54),
];
const HIPS: usize = 0;
/// Number of bones of `HumanBodyBones`.
const COUNT: usize = 55;
/// Bits of both upper and both lower arms. A frame without them moves no arms.
const ARMS: u64 = 0b1111 << 13;

/// A position (m) and a rotation. The algebra is the same for left-handed and right-handed axes.
type Transform = Isometry3<f32>;

#[derive(Clone, Debug)]
pub struct Vmc {
    root: Transform,
    hips: Transform,
    /// Bit i: bone i arrived since the last frame.
    seen: u64,
    frame: RawSkeleton,
    absent: bool,
    time: Option<f32>,
    restarts: u64,
}

impl Vmc {
    pub fn new() -> Self {
        let mut frame = empty(SkeletonLayout::UnityHumanoid, COUNT, raw_flag::ROTATIONS | raw_flag::LOCAL);
        frame.rotations[..COUNT].fill([0.0, 0.0, 0.0, 1.0]);
        let (root, hips) = (Transform::identity(), Transform::identity());
        Self { root, hips, seen: 0, frame, absent: false, time: None, restarts: 0 }
    }

    fn message(&mut self, message: &OscMessage, publish: &mut dyn FnMut(&RawSkeleton)) -> Result<(), Refused> {
        match message.addr.as_str() {
            "/VMC/Ext/Root/Pos" => {
                self.root = named(&message.args)?.1.unwrap_or(self.root);
            }
            "/VMC/Ext/Bone/Pos" => {
                let (name, transform) = named(&message.args)?;
                let Some(&(_, bone)) = BONES.iter().find(|(known, _)| *known == name) else { return Ok(()) };
                let Some(transform) = transform else { return Ok(()) };
                if self.seen & 1 << bone != 0 {
                    // A new round has begun.
                    self.complete(publish);
                }
                if bone == HIPS {
                    self.hips = transform;
                } else {
                    self.frame.rotations[bone] = transform.rotation.coords.into();
                }
                self.seen |= 1 << bone;
            }
            "/VMC/Ext/T" => {
                let Some(time) = message.args.first().and_then(number) else { return Err(Refused::Protocol) };
                // Time since the sender's start. A smaller value indicates a restart.
                if self.time.replace(time).is_some_and(|before| time < before) {
                    // Later frames belong to another session.
                    self.restarts += 1;
                    self.seen = 0;
                    return Err(Refused::Late);
                }
                self.complete(publish);
            }
            "/VMC/Ext/OK" => {
                let Some(loaded) = message.args.first().and_then(number) else { return Err(Refused::Protocol) };
                self.absent = loaded == 0.0;
            }
            // Blend shapes, cameras, controllers and other messages.
            _ => {}
        }
        Ok(())
    }

    /// Ends a frame. Bones that did not arrive keep their rotation, but arms that did not arrive are not
    /// reported as valid.
    fn complete(&mut self, publish: &mut dyn FnMut(&RawSkeleton)) {
        let seen = std::mem::take(&mut self.seen);
        if self.absent || seen & 1 << HIPS == 0 || seen & ARMS == 0 {
            return;
        }
        let Transform { translation, rotation } = self.root * self.hips;
        self.frame.positions[HIPS] = translation.vector.into();
        self.frame.rotations[HIPS] = rotation.coords.into();
        self.frame.confidence[..COUNT].fill(1.0);
        for bone in (13..=18).filter(|bone| seen & 1 << bone == 0) {
            self.frame.confidence[bone] = 0.0;
        }
        publish(&self.frame);
    }

    fn packet(&mut self, packet: &OscPacket, publish: &mut dyn FnMut(&RawSkeleton)) -> Result<(), Refused> {
        match packet {
            OscPacket::Message(message) => self.message(message, publish),
            OscPacket::Bundle(bundle) => bundle.content.iter().try_for_each(|packet| self.packet(packet, publish)),
        }
    }
}

impl Default for Vmc {
    fn default() -> Self {
        Self::new()
    }
}

impl Protocol for Vmc {
    fn decode(&mut self, packet: &[u8], publish: &mut dyn FnMut(&RawSkeleton)) -> Result<Taken, Refused> {
        // Nested bundles are not part of this protocol, and the decoder would read them by recursion.
        if packet.windows(8).filter(|bytes| bytes == b"#bundle\0").count() > 1 {
            return Err(Refused::Protocol);
        }
        let (rest, packet) = rosc::decoder::decode_udp(packet).map_err(|_| Refused::Protocol)?;
        if !rest.is_empty() {
            return Err(Refused::Length);
        }
        // If any part of a packet is wrong, nothing of it is used.
        let taken = check(&packet)?;
        self.packet(&packet, publish)?;
        Ok(taken)
    }

    fn for_new_sender(&self) -> Self {
        Self { restarts: self.restarts, ..Self::new() }
    }

    fn restarts(&self) -> u64 {
        self.restarts
    }
}

/// Checks that every message of this protocol can be read. Returns `Person` if there is at least one, otherwise
/// `Aside`.
fn check(packet: &OscPacket) -> Result<Taken, Refused> {
    let message = match packet {
        OscPacket::Message(message) => message,
        OscPacket::Bundle(bundle) => {
            return bundle.content.iter().try_fold(Taken::Aside, |taken, packet| Ok(taken.max(check(packet)?)));
        }
    };
    let good = match message.addr.as_str() {
        "/VMC/Ext/Root/Pos" | "/VMC/Ext/Bone/Pos" => named(&message.args).map(|_| true)?,
        "/VMC/Ext/T" | "/VMC/Ext/OK" => message.args.first().and_then(number).is_some(),
        other if other.starts_with("/VMC/Ext/") => true,
        _ => return Ok(Taken::Aside),
    };
    if good { Ok(Taken::Person) } else { Err(Refused::Protocol) }
}

/// A number as a sender's OSC library tags it: JavaScript's and Python's tag whole numbers as integers.
fn number(value: &OscType) -> Option<f32> {
    match *value {
        OscType::Float(x) => Some(x),
        OscType::Double(x) => Some(x as f32),
        OscType::Int(x) => Some(x as f32),
        OscType::Long(x) => Some(x as f32),
        _ => None,
    }
}

/// Parses a name and a transform. It is None if a value is NaN or infinite, or the rotation is zero: senders mark bones so that
/// they do not see. The remaining values (scale and offset of the root) do not concern the person.
fn named(args: &[OscType]) -> Result<(&str, Option<Transform>), Refused> {
    let Some((OscType::String(name), values)) = args.split_first() else { return Err(Refused::Protocol) };
    let bone = BONES.iter().find(|(known, _)| known == name).map_or("of another name", |(known, _)| known);
    let mut all = [0.0; 7];
    for (n, x) in all.iter_mut().enumerate() {
        *x = values.get(n).and_then(number).ok_or(Refused::Bone(bone))?;
    }
    let [x, y, z, i, j, k, w] = all;
    let seen = all.iter().all(|x| x.is_finite()) && [i, j, k, w] != [0.0; 4];
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Ok((name, seen.then(|| Transform::from_parts([x, y, z].into(), rotation))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::taken as take;
    use rosc::{OscBundle, OscTime, encoder};

    fn bone(address: &str, name: &str, numbers: [f32; 7]) -> OscPacket {
        let mut args = vec![OscType::String(name.into())];
        args.extend(numbers.map(OscType::Float));
        message(address, args)
    }

    fn message(address: &str, args: Vec<OscType>) -> OscPacket {
        OscPacket::Message(OscMessage { addr: address.into(), args })
    }

    fn bytes(content: Vec<OscPacket>) -> Vec<u8> {
        let timetag = OscTime { seconds: 0, fractional: 1 };
        encoder::encode(&OscPacket::Bundle(OscBundle { timetag, content })).expect("a packet")
    }

    const STILL: [f32; 7] = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    const HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

    fn body(time: f32) -> Vec<OscPacket> {
        let mut all = vec![
            // A quarter turn about y, a metre along x.
            bone("/VMC/Ext/Root/Pos", "root", [1.0, 0.0, 0.0, 0.0, HALF, 0.0, HALF]),
            bone("/VMC/Ext/Bone/Pos", "Hips", [0.0, 0.9, 0.5, 0.0, HALF, 0.0, HALF]),
        ];
        for (name, i) in &BONES[1..] {
            let q = (*i as f32 / 100.0).sin_cos();
            all.push(bone("/VMC/Ext/Bone/Pos", name, [0.0, 0.1, 0.0, q.0, 0.0, 0.0, q.1]));
        }
        all.push(message("/VMC/Ext/T", vec![OscType::Float(time)]));
        all
    }

    #[test]
    fn person_in_one_bundle_or_many_messages_makes_one_frame() {
        let (outcome, whole) = take(&mut Vmc::new(), &bytes(body(1.0)));
        assert_eq!((outcome, whole.len()), (Ok(Taken::Person), 1));
        let frame = &whole[0];
        assert_eq!((frame.layout, frame.joint_count, frame.flags), (7, 55, raw_flag::ROTATIONS | raw_flag::LOCAL));
        // z turned by 90 degrees about y is x.
        for (is, expected) in frame.positions[0].iter().zip([1.5, 0.9, 0.0]) {
            assert!((is - expected).abs() < 1e-6, "{:?}", frame.positions[0]);
        }
        for (is, expected) in frame.rotations[0].iter().zip([0.0, 1.0, 0.0, 0.0]) {
            assert!((is - expected).abs() < 1e-6, "half a turn: {:?}", frame.rotations[0]);
        }
        for &(_, i) in &BONES[1..] {
            let (sin, cos) = (i as f32 / 100.0).sin_cos();
            assert_eq!((frame.rotations[i], frame.confidence[i]), ([sin, 0.0, 0.0, cos], 1.0));
        }
        assert_eq!(frame.rotations[21], [0.0, 0.0, 0.0, 1.0], "an eye");
        let mut vmc = Vmc::new();
        let one_by_one: Vec<_> =
            body(1.0).iter().flat_map(|packet| take(&mut vmc, &encoder::encode(packet).expect("a packet")).1).collect();
        assert_eq!(one_by_one, whole);
    }

    #[test]
    fn whole_numbers_may_be_tagged_as_integers_and_bones_may_be_unseen() {
        let whole = |packet: OscPacket| match packet {
            OscPacket::Message(OscMessage { addr, args }) => {
                let tagged = args.into_iter().map(|value| match value {
                    OscType::Float(x) if x.fract() == 0.0 => OscType::Int(x as i32),
                    OscType::Float(x) => OscType::Double(f64::from(x)),
                    other => other,
                });
                message(&addr, tagged.collect())
            }
            bundle => bundle,
        };
        let (_, expected) = take(&mut Vmc::new(), &bytes(body(2.0)));
        assert_eq!(
            take(&mut Vmc::new(), &bytes(body(2.0).into_iter().map(whole).collect())),
            (Ok(Taken::Person), expected)
        );
        // NaN, and a rotation of zeros, mark an arm that is not seen. The person stays.
        for mark in [[f32::NAN; 7], [0.0; 7]] {
            let mut marked = body(2.0);
            for name in ["LeftLowerArm", "LeftHand"] {
                // The root comes first.
                let place = 1 + BONES.iter().position(|(known, _)| *known == name).expect("a bone");
                marked[place] = bone("/VMC/Ext/Bone/Pos", name, mark);
            }
            let (_, frames) = take(&mut Vmc::new(), &bytes(marked));
            assert_eq!(frames[0].confidence[13..=18], [1.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn frame_without_a_time_message_ends_at_the_next_round() {
        let mut vmc = Vmc::new();
        let round: Vec<_> = body(1.0)
            .into_iter()
            .filter(|packet| !matches!(packet, OscPacket::Message(m) if m.addr == "/VMC/Ext/T"))
            .collect();
        assert_eq!(take(&mut vmc, &bytes(round.clone())).1.len(), 0);
        assert_eq!(take(&mut vmc, &bytes(round.clone())).1.len(), 1);
        assert_eq!(take(&mut vmc, &bytes(round)).1.len(), 1);
    }

    #[test]
    fn missing_arm_gets_confidence_zero_and_lost_person_no_frame() {
        let mut vmc = Vmc::new();
        let left = |packet: &OscPacket| !matches!(packet, OscPacket::Message(m) if matches!(&m.args[0], OscType::String(name) if name.starts_with("Right")));
        let (_, frames) = take(&mut vmc, &bytes(body(1.0).into_iter().filter(left).collect()));
        assert_eq!(frames[0].confidence[13..=18], [1.0, 0.0, 1.0, 0.0, 1.0, 0.0]);
        let mut all = body(2.0);
        all.insert(0, message("/VMC/Ext/OK", vec![OscType::Int(0)]));
        assert_eq!(take(&mut vmc, &bytes(all)), (Ok(Taken::Person), vec![]));
        let mut all = body(3.0);
        all.insert(0, message("/VMC/Ext/OK", vec![OscType::Int(1), OscType::Int(3)]));
        assert_eq!(take(&mut vmc, &bytes(all)).1.len(), 1);
        let hips = vec![bone("/VMC/Ext/Bone/Pos", "Hips", STILL), message("/VMC/Ext/T", vec![OscType::Float(4.0)])];
        assert_eq!(take(&mut vmc, &bytes(hips)).1.len(), 0, "hips alone");
        assert_eq!(vmc.restarts(), 0);
        assert_eq!(take(&mut vmc, &bytes(body(0.5))), (Err(Refused::Late), vec![]));
        assert_eq!(vmc.restarts(), 1, "the time began again");
        assert_eq!(take(&mut vmc, &bytes(body(0.6))).1.len(), 1);
    }

    #[test]
    fn malformed_packet_is_refused_with_its_reason() {
        let mut vmc = Vmc::new();
        let inner = OscPacket::Bundle(OscBundle { timetag: OscTime { seconds: 0, fractional: 1 }, content: vec![] });
        let mut rest = encoder::encode(&message("/VMC/Ext/T", vec![OscType::Float(1.0)])).expect("a packet");
        rest.extend([0; 4]);
        for (packet, refused) in [
            (bytes(vec![message("/VMC/Ext/Bone/Pos", vec![OscType::String("Hips".into()); 3])]), Refused::Bone("Hips")),
            (bytes(vec![message("/VMC/Ext/T", vec![])]), Refused::Protocol),
            (bytes(vec![message("/VMC/Ext/OK", vec![OscType::String("1".into())])]), Refused::Protocol),
            (bytes(vec![inner]), Refused::Protocol),
            (b"MXTP02".to_vec(), Refused::Protocol),
            (rest, Refused::Length),
            (vec![], Refused::Protocol),
        ] {
            assert_eq!(take(&mut vmc, &packet), (Err(refused), vec![]), "{packet:?}");
        }
        assert_eq!(take(&mut vmc, &bytes(vec![message("/VMC/Ext/Blend/Apply", vec![])])).0, Ok(Taken::Person));
        assert_eq!(take(&mut vmc, &bytes(vec![message("/avatar/parameters/x", vec![])])).0, Ok(Taken::Aside));
        let mut half = body(1.0);
        half.push(message("/VMC/Ext/OK", vec![]));
        assert_eq!(take(&mut vmc, &bytes(half)), (Err(Refused::Protocol), vec![]), "a person, and then what is wrong");
    }
}
