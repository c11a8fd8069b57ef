//! VMC (Virtual Motion Capture): local transforms of Unity's bones as OSC messages.
//!
//! `/VMC/Ext/Root/Pos` and `/VMC/Ext/Bone/Pos` have a name, a position (m) and a quaternion x y z w.
//! `/VMC/Ext/T` ends a frame. If a sender omits it, the next hips end the frame. `/VMC/Ext/OK` has whether a person is there,
//! the state of calibration, its mode, and whether the person is tracked. (Virtual Motion Capture Protocol 3.1.)
//!
//! A bone is not seen if it does not arrive, or has NaN or a quaternion of zeros. So is an arm whose bones are all the
//! identity, which is the rest pose, after they were not. Such an arm is held, and other bones keep their rotation.

use crate::{Counts, Protocol, Refused, Taken, empty};
use messages::{RawSkeleton, SkeletonLayout, raw_flag};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use rosc::{OscMessage, OscPacket, OscType};

/// Bones of the body, by their indices in `HumanBodyBones`. Fingers, eyes and jaw have no effect here.
const BONES: &str = "Hips LeftUpperLeg RightUpperLeg LeftLowerLeg RightLowerLeg LeftFoot RightFoot Spine Chest Neck Head \
                     LeftShoulder RightShoulder LeftUpperArm RightUpperArm LeftLowerArm RightLowerArm LeftHand RightHand \
                     LeftToes RightToes";
/// One that stands apart.
const UPPER_CHEST: (&str, usize) = ("UpperChest", 54);
const HIPS: usize = 0;
/// Number of bones of `HumanBodyBones`.
const COUNT: usize = 55;
/// Upper arm, lower arm and hand of each side.
const ARMS: [[usize; 3]; 2] = [[13, 15, 17], [14, 16, 18]];
/// Bits of both upper and both lower arms. A frame without them moves no arms.
const ARM_BITS: u64 = 0b1111 << 13;
/// States of calibration in which a sender waits for a pose or measures it. Its bones then rest.
const CALIBRATES: [f32; 2] = [1.0, 2.0];
/// Least step back of the time at a restart, s. Assumption: no network holds a packet for so long.
const ANEW_S: f32 = 1.0;
/// Names of the values of a transform.
const VALUES: [&str; 7] = ["p.x", "p.y", "p.z", "q.x", "q.y", "q.z", "q.w"];

const ROOT: &str = "/VMC/Ext/Root/Pos";
const BONE: &str = "/VMC/Ext/Bone/Pos";
const TIME: &str = "/VMC/Ext/T";
const STATE: &str = "/VMC/Ext/OK";

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
    /// True for each arm that was away from the rest pose.
    moved: [bool; 2],
    time: Option<f32>,
    counts: Counts,
}

impl Default for Vmc {
    fn default() -> Self {
        let mut frame = empty(SkeletonLayout::UnityHumanoid, COUNT, raw_flag::ROTATIONS | raw_flag::LOCAL);
        frame.rotations[..COUNT].fill([0.0, 0.0, 0.0, 1.0]);
        let (root, hips) = (Transform::identity(), Transform::identity());
        Self { root, hips, seen: 0, frame, absent: false, moved: [false; 2], time: None, counts: Counts::default() }
    }
}

impl Vmc {
    fn message(&mut self, message: &OscMessage, publish: &mut dyn FnMut(&RawSkeleton)) -> Result<(), Refused> {
        match message.addr.as_str() {
            ROOT => {
                self.root = named(ROOT, &message.args)?.1.unwrap_or(self.root);
            }
            BONE => {
                let (Some(bone), Some(transform)) = named(BONE, &message.args)? else { return Ok(()) };
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
            TIME => {
                let time = value(TIME, "", "the time", message.args.first())?;
                // Time since the sender's start. A much smaller value indicates a restart, a smaller one packets out of order.
                let before = self.time.filter(|before| time < *before);
                if before.is_none_or(|before| time < before - ANEW_S) {
                    self.time = Some(time);
                }
                if before.is_some() {
                    // Frames after a restart belong to another session.
                    self.counts.restarts += u64::from(self.time == Some(time));
                    self.counts.unfinished += u64::from(self.seen != 0);
                    self.seen = 0;
                    return Err(Refused::Late);
                }
                self.complete(publish);
            }
            STATE => {
                let loaded = value(STATE, "", "loaded", message.args.first())?;
                let [calibration, tracked] = [1, 3].map(|at| message.args.get(at).and_then(number));
                self.absent = loaded == 0.0
                    || calibration.is_some_and(|state| CALIBRATES.contains(&state))
                    || tracked == Some(0.0);
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
        if self.absent || seen & 1 << HIPS == 0 || seen & ARM_BITS == 0 {
            self.counts.unfinished += u64::from(seen != 0);
            return;
        }
        let Transform { translation, rotation } = self.root * self.hips;
        self.frame.positions[HIPS] = translation.vector.into();
        self.frame.rotations[HIPS] = rotation.coords.into();
        self.frame.confidence[..COUNT].fill(1.0);
        for (arm, moved) in ARMS.iter().zip(&mut self.moved) {
            let rests = arm.iter().all(|&bone| self.frame.rotations[bone] == [0.0, 0.0, 0.0, 1.0]);
            *moved |= !rests;
            for &bone in arm.iter().filter(|&bone| rests && *moved || seen & 1 << bone == 0) {
                self.frame.confidence[bone] = 0.0;
            }
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
        Self { counts: self.counts, ..Self::default() }
    }

    fn counts(&self) -> Counts {
        self.counts
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
    match message.addr.as_str() {
        ROOT => drop(named(ROOT, &message.args)?),
        BONE => drop(named(BONE, &message.args)?),
        TIME => drop(value(TIME, "", "the time", message.args.first())?),
        STATE => drop(value(STATE, "", "loaded", message.args.first())?),
        other if other.starts_with("/VMC/Ext/") => {}
        _ => return Ok(Taken::Aside),
    }
    Ok(Taken::Person)
}

/// A number as a sender's OSC library tags it. JavaScript's and Python's tag whole numbers as integers, and truth values and
/// nothing have tags of their own. Nothing and infinity are marks of what is not seen.
fn number(value: &OscType) -> Option<f32> {
    match *value {
        OscType::Float(x) => Some(x),
        OscType::Double(x) => Some(x as f32),
        OscType::Int(x) => Some(x as f32),
        OscType::Long(x) => Some(x as f32),
        OscType::Bool(x) => Some(f32::from(u8::from(x))),
        OscType::Nil | OscType::Inf => Some(f32::NAN),
        _ => None,
    }
}

/// Returns the number of a message, or its address, bone and name with what stands there instead.
fn value(address: &'static str, bone: &'static str, name: &'static str, at: Option<&OscType>) -> Result<f32, Refused> {
    let found = match at {
        None => "nothing",
        Some(OscType::String(_) | OscType::Char(_)) => "a text",
        Some(OscType::Array(_)) => "a list",
        Some(_) => "another type",
    };
    at.and_then(number).ok_or(Refused::Value(address, bone, name, found))
}

/// Name and index of each bone of the body.
fn bones() -> impl Iterator<Item = (&'static str, usize)> {
    BONES.split(' ').zip(0..).chain([UPPER_CHEST])
}

/// Parses the bone, if it is one of the body, and a transform. It is None if a value is NaN or infinite, or the rotation is
/// zero. The remaining values (scale and offset of the root) do not concern the person. VRM writes names with a small letter.
fn named(address: &'static str, args: &[OscType]) -> Result<(Option<usize>, Option<Transform>), Refused> {
    let Some((OscType::String(name), values)) = args.split_first() else { return Err(Refused::Name(address)) };
    let bone = bones().find(|(known, _)| known.eq_ignore_ascii_case(name));
    let mut all = [0.0; 7];
    for (n, x) in all.iter_mut().enumerate() {
        *x = value(address, bone.map_or("", |(known, _)| known), VALUES[n], values.get(n))?;
    }
    let [x, y, z, i, j, k, w] = all;
    let seen = all.iter().all(|x| x.is_finite()) && [i, j, k, w] != [0.0; 4];
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Ok((bone.map(|(_, bone)| bone), seen.then(|| Transform::from_parts([x, y, z].into(), rotation))))
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
        for (name, i) in bones().skip(1) {
            let q = (i as f32 / 100.0).sin_cos();
            all.push(bone("/VMC/Ext/Bone/Pos", name, [0.0, 0.1, 0.0, q.0, 0.0, 0.0, q.1]));
        }
        all.push(message("/VMC/Ext/T", vec![OscType::Float(time)]));
        all
    }

    #[test]
    fn person_in_one_bundle_or_many_messages_makes_one_frame() {
        let (outcome, whole) = take(&mut Vmc::default(), &bytes(body(1.0)));
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
        for (_, i) in bones().skip(1) {
            let (sin, cos) = (i as f32 / 100.0).sin_cos();
            assert_eq!((frame.rotations[i], frame.confidence[i]), ([sin, 0.0, 0.0, cos], 1.0));
        }
        assert_eq!(frame.rotations[21], [0.0, 0.0, 0.0, 1.0], "an eye");
        let mut vmc = Vmc::default();
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
        let (_, expected) = take(&mut Vmc::default(), &bytes(body(2.0)));
        assert_eq!(
            take(&mut Vmc::default(), &bytes(body(2.0).into_iter().map(whole).collect())),
            (Ok(Taken::Person), expected)
        );
        // NaN, and a rotation of zeros, mark an arm that is not seen. The person stays.
        for mark in [[f32::NAN; 7], [0.0; 7]] {
            let mut marked = body(2.0);
            for name in ["LeftLowerArm", "LeftHand"] {
                // The root comes first.
                let place = 1 + bones().position(|(known, _)| known == name).expect("a bone");
                marked[place] = bone("/VMC/Ext/Bone/Pos", name, mark);
            }
            let (_, frames) = take(&mut Vmc::default(), &bytes(marked));
            assert_eq!(frames[0].confidence[13..=18], [1.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        }
    }

    #[test]
    fn arm_that_returns_to_the_rest_pose_is_not_seen_and_so_is_a_person_without_tracking() {
        let mut vmc = Vmc::default();
        let rest = |time: f32| {
            let mut all = body(time);
            for (name, _) in bones().filter(|(name, _)| name.starts_with("Left")) {
                let place = 1 + bones().position(|(known, _)| known == name).expect("a bone");
                all[place] = bone(BONE, name, STILL);
            }
            bytes(all)
        };
        assert_eq!(take(&mut vmc, &rest(1.0)).1[0].confidence[13..=18], [1.0; 6], "a T-pose at the start");
        assert_eq!(take(&mut vmc, &bytes(body(2.0))).1[0].confidence[13..=18], [1.0; 6]);
        assert_eq!(take(&mut vmc, &rest(3.0)).1[0].confidence[13..=18], [0.0, 1.0, 0.0, 1.0, 0.0, 1.0]);
        // Waiting for calibration, calibrating, not tracked; then a truth value, and calibrated and tracked.
        let whole = [[1, 1, 0, 1], [1, 2, 0, 1], [1, 3, 0, 0], [1, 3, 0, 1]];
        let mut states: Vec<_> = whole.iter().map(|state| state.map(OscType::Int).to_vec()).collect();
        states.insert(3, vec![OscType::Bool(false)]);
        for (n, (state, count)) in states.into_iter().zip([0, 0, 0, 0, 1]).enumerate() {
            let mut all = body(4.0 + n as f32);
            all.insert(0, message(STATE, state.clone()));
            assert_eq!(take(&mut vmc, &bytes(all)).1.len(), count, "{state:?}");
        }
    }

    #[test]
    fn frame_without_a_time_message_ends_at_the_next_round() {
        let mut vmc = Vmc::default();
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
        let mut vmc = Vmc::default();
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
        assert_eq!((vmc.counts().restarts, vmc.counts().unfinished), (0, 2));
        assert_eq!(take(&mut vmc, &bytes(body(3.9))), (Err(Refused::Late), vec![]), "out of order");
        assert_eq!(take(&mut vmc, &bytes(body(4.1))).1.len(), 1, "and no older frame in between");
        assert_eq!((vmc.counts().restarts, vmc.counts().unfinished), (0, 3));
        assert_eq!(take(&mut vmc, &bytes(body(0.5))), (Err(Refused::Late), vec![]));
        assert_eq!(vmc.counts().restarts, 1, "the time began again");
        assert_eq!(take(&mut vmc, &bytes(body(0.6))).1.len(), 1);
    }

    #[test]
    fn malformed_packet_is_refused_with_its_reason() {
        let mut vmc = Vmc::default();
        let inner = OscPacket::Bundle(OscBundle { timetag: OscTime { seconds: 0, fractional: 1 }, content: vec![] });
        let mut rest = encoder::encode(&message("/VMC/Ext/T", vec![OscType::Float(1.0)])).expect("a packet");
        rest.extend([0; 4]);
        for (packet, refused) in [
            (
                bytes(vec![message("/VMC/Ext/Bone/Pos", vec![OscType::String("Hips".into()); 3])]),
                Refused::Value(BONE, "Hips", "p.x", "a text"),
            ),
            (bytes(vec![message(BONE, vec![OscType::Int(1)])]), Refused::Name(BONE)),
            (bytes(vec![message(TIME, vec![])]), Refused::Value(TIME, "", "the time", "nothing")),
            (
                bytes(vec![message(STATE, vec![OscType::String("1".into())])]),
                Refused::Value(STATE, "", "loaded", "a text"),
            ),
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
        let refused = Refused::Value(STATE, "", "loaded", "nothing");
        assert_eq!(take(&mut vmc, &bytes(half)), (Err(refused), vec![]), "a person, and then what is wrong");
        let sentence = Refused::Value(BONE, "Hips", "q.x", "a text").to_string();
        assert_eq!(sentence, "with a text for q.x of /VMC/Ext/Bone/Pos Hips, where a number must be");
    }
}
