//! Good inputs that follow the product, because they are files of its own. A fuzzer would take long to find them.

use crate::{frames, robots, settings, weights};
use messages::{Layout, Message, Skeleton, Stamp};
use motion::Motion;

/// Returns the product's own files as inputs of this target. The other good inputs are stored.
pub fn for_target(target: &str) -> Vec<Vec<u8>> {
    let tagged = |tag: u8, bytes: &[u8]| [&[tag], bytes].concat();
    match target {
        "layouts" => frames::FILES.map(|text| tagged(0, text.as_bytes())).to_vec(),
        "door" => {
            let chunk = br#"{"joints":["a",1],"rate_hz":20,"positions":[[0,1]],"closure":[[0],null],"observed_ns":1}"#;
            vec![vec![0; doors::HELLO_BYTES], doors::Hello::OURS.encode().to_vec(), chunk.to_vec()]
        }
        "bvh" => vec![motion::write_bvh(&short()).into()],
        "mcap" => vec![recording(&[])],
        "robot" => vec![tagged(1, robots::TOML.lines().take(60).collect::<Vec<_>>().join("\n").as_bytes())],
        "settings" => vec![tagged(0, settings::TEXT.as_bytes())],
        "weights" => vec![tagged(0, weights::GOOD.manifest.as_bytes()), tagged(1, &weights::GOOD.tensors)],
        _ => Vec::new(),
    }
}

/// Returns four frames of the built-in motion, a second apart.
fn short() -> Motion {
    let mut motion = motion::builtin();
    motion.frames = motion.frames.into_iter().step_by(60).take(4).collect();
    motion
}

/// Returns a recording of a few skeletons. `changes` overwrite them: a place (u16) and four bytes each.
pub(crate) fn recording(changes: &[u8]) -> Vec<u8> {
    let motion = short();
    let limbs = motion::limbs(&motion, &motion::calibrate(&motion, motion::CalibrationMode::Rig));
    let mut frames = Vec::new();
    for (i, (frame, limbs)) in motion.frames.iter().zip(limbs).enumerate() {
        let mut skeleton = Skeleton { positions: frame.positions, limbs, ..Skeleton::ZERO };
        skeleton.header.origin = Stamp(1_000_000_000 + i as u64 * 16_666_667);
        skeleton.flags = messages::skeleton_flag::ALL;
        let mut bytes = vec![0; size_of::<Skeleton>()];
        skeleton.write_to(&mut bytes);
        frames.extend(bytes);
    }
    for change in changes.chunks_exact(6) {
        let at = usize::from(u16::from_le_bytes([change[0], change[1]])) % (frames.len() - 4);
        frames[at..at + 4].copy_from_slice(&change[2..]);
    }
    let mut writer = mcap::Writer::new(std::io::Cursor::new(Vec::new())).expect("in memory");
    let schema = writer.add_schema(Skeleton::TYPE_NAME.as_str(), "teleopd", b"{}").expect("in memory");
    let channel = writer.add_channel(schema, "/teleop/skeleton", "teleopd", &Default::default()).expect("in memory");
    for (i, data) in frames.chunks(size_of::<Skeleton>()).enumerate() {
        let log_time = i as u64;
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, data).expect("in memory");
    }
    writer.finish().expect("in memory");
    writer.into_inner().into_inner()
}
