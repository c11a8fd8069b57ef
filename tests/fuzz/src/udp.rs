//! UDP packets from a motion capture program, or from any other sender.

use bridge::{Mvn, Protocol, Vmc};
use messages::RawSkeleton;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};

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

fn packets(all: &[Vec<u8>]) -> Vec<u8> {
    all.iter().flat_map(|packet| [&(packet.len() as u16).to_le_bytes()[..], packet].concat()).collect()
}

/// A person in one packet, in two packets, and a stream that restarts.
pub(crate) fn mvn_seeds() -> Vec<Vec<u8>> {
    let part = |sample: u32, ids: std::ops::Range<u32>| {
        let mut bytes =
            [b"MXTP02", &sample.to_be_bytes()[..], &[0x80, ids.len() as u8, 0, 0, 0, 0, 0, 23, 0, 0, 0, 0]].concat();
        bytes.extend((32 * ids.len() as u16).to_be_bytes());
        for id in ids {
            bytes.extend(id.to_be_bytes());
            [0.0, 0.1, 1.0, 1.0, 0.0, 0.0, 0.0_f32].iter().for_each(|x| bytes.extend(x.to_be_bytes()));
        }
        bytes
    };
    vec![
        packets(&[part(1, 1..24)]),
        packets(&[part(1, 1..12), part(1, 12..30), b"MXTP12".to_vec()]),
        packets(&[part(9000, 1..24), part(1, 1..24), part(2, 1..24)]),
    ]
}

/// A person in a bundle, and message by message.
pub(crate) fn vmc_seeds() -> Vec<Vec<u8>> {
    let message = |addr: &str, args: Vec<OscType>| OscPacket::Message(OscMessage { addr: addr.into(), args });
    let bone = |name: &str| {
        let numbers = [0.0, 1.0, 0.0, 0.0, 0.6, 0.0, 0.8].map(OscType::Float);
        message("/VMC/Ext/Bone/Pos", [vec![OscType::String(name.into())], numbers.to_vec()].concat())
    };
    let mut all = vec![message("/VMC/Ext/OK", vec![OscType::Int(1)])];
    all.extend(["Hips", "LeftUpperArm", "LeftLowerArm", "RightUpperArm", "RightLowerArm"].map(bone));
    all.push(message("/VMC/Ext/T", vec![OscType::Float(1.5)]));
    let encode = |packet: &OscPacket| encoder::encode(packet).expect("a packet");
    let single: Vec<_> = all.iter().map(encode).collect();
    let timetag = OscTime { seconds: 0, fractional: 1 };
    let bundle = encode(&OscPacket::Bundle(OscBundle { timetag, content: all }));
    vec![packets(&[bundle.clone(), bundle]), packets(&single)]
}
