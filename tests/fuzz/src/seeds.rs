//! Initial good inputs. A fuzzer would take long to find them. The stored inputs grew from these.

use crate::{frames, robots, settings, udp, weights};
use messages::{Layout, Message, Skeleton, Stamp};
use motion::{Frame, Motion, npy};

/// Returns good inputs of this target.
pub fn for_target(target: &str) -> Vec<Vec<u8>> {
    match target {
        "skeleton" => skeletons(),
        "layouts" => frames::seeds(),
        "door" => vec![vec![0; doors::HELLO_BYTES], doors::Hello::OURS.encode().to_vec()],
        "bvh" => vec![motion::write_bvh(&short()).into()],
        "npy" => vec![positions(), features()],
        "npz" => archives(),
        "mcap" => vec![recording(&[]), b"A".to_vec(), b"A\x28\x00\x00\x00\xc0\x7f".to_vec()],
        "mvn" => udp::mvn_seeds(),
        "vmc" => udp::vmc_seeds(),
        "robot" => robots(),
        "settings" => vec![
            [&[0], settings::TEXT.as_bytes()].concat(),
            b"\x01\x03\x00\x02\x00nan".to_vec(),
            b"\x01\x02\x00\x04\x08-1\x05\x40\x04\x02 1e99".to_vec(),
        ],
        "weights" => vec![
            [&[0], weights::GOOD.manifest.as_bytes()].concat(),
            [&[1], weights::GOOD.tensors.as_slice()].concat(),
            vec![2],
            vec![2, 40, 0, 9, 1, 0, 4, 0],
        ],
        "operator" => operators(),
        "engage" => engage(),
        _ => gate(),
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

fn skeletons() -> Vec<Vec<u8>> {
    let good = [0, 0, 0].repeat(24);
    let with = |frame: &[u8]| [good.as_slice(), frame, &good[..30]].concat();
    vec![
        good.clone(),
        // A NaN word in a position. Another session. A repetition. A pause of a second.
        with(&[0, 1, 60, 0, 0, 0, 0xc0, 0x7f, 0]),
        with(&[0, 1, 10, 0, 9, 0, 0, 0, 0]),
        with(&[1, 0, 0]),
        with(&[0, 0, 220]),
        with(&[2, 0, 0]),
        // Another session and back, then an old frame of the first one.
        with(&there_and_back()),
    ]
}

/// After 24 frames that begin at 1 s: two changes of session, and the origin of the 23rd frame.
fn there_and_back() -> Vec<u8> {
    let origin = (1_000_000_000 + 22 * 16_666_667_u32).to_le_bytes();
    [[0, 1, 10, 0, 9, 0, 0, 0, 0].as_slice(), &[0, 0, 0], &[0, 1, 4, 0], &origin, &[0]].concat()
}

fn array(shape: &[usize], values: impl Iterator<Item = f32>) -> Vec<u8> {
    let mut out = Vec::new();
    npy::write_npy_header(&mut out, "<f4", shape).expect("into memory");
    out.extend(values.flat_map(f32::to_le_bytes));
    out
}

/// Returns HumanML3D's positions: x left, y up, z forward.
fn positions() -> Vec<u8> {
    let turned = |frame: Frame| frame.positions.map(|[x, y, z]| [y, z, x]);
    let frames = short().frames;
    array(&[frames.len(), 22, 3], frames.into_iter().flat_map(turned).flatten())
}

fn features() -> Vec<u8> {
    array(&[2, 263], (0..2 * 263).map(|i| (i % 9) as f32 / 9.0))
}

fn archives() -> Vec<Vec<u8>> {
    let pose = |width: usize| array(&[2, width], (0..2 * width).map(|i| (i % 5) as f32 / 50.0));
    let rate = array(&[], [60.0].into_iter());
    let parts = |parts: [&[u8]; 6]| {
        let part = |part: &[u8]| [(part.len() as u16).to_le_bytes().as_slice(), part].concat();
        [vec![b'A'], parts.into_iter().flat_map(part).collect()].concat()
    };
    let (poses, body, three) = (pose(66), pose(63), pose(3));
    vec![
        parts([&poses, &[], &[], &three, &rate, &[]]),
        parts([&[], &three, &body, &three, &[], &rate]),
        // An empty archive: the end of a central directory.
        [b"PK\x05\x06".as_slice(), &[0; 18]].concat(),
    ]
}

fn robots() -> Vec<Vec<u8>> {
    let urdf = |text: &str| [&[0], text.as_bytes()].concat();
    let head = robots::TOML.lines().take(60).collect::<Vec<_>>().join("\n");
    let limit = robots::URDF.find("<limit").expect("a limit") as u16;
    let [low, high] = limit.to_le_bytes();
    vec![
        urdf("<robot name=\"r\"><link name=\"a\"/></robot>"),
        urdf(
            "<robot name=\"r\"><link name=\"a\"/><link name=\"b\"/><joint name=\"j\" type=\"revolute\"><parent link=\"a\"/>\
             <child link=\"b\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"1\"/></joint></robot>",
        ),
        urdf("<!DOCTYPE r [<!ENTITY a \"b\">]><robot name=\"&a;\"/>"),
        [&[1], head.as_bytes()].concat(),
        vec![2],
        [&[2, 9, low, high, 6], b"nope".as_slice()].concat(),
        [&[2, 7, low.wrapping_add(14), high, 2], b"1e9".as_slice()].concat(),
    ]
}

fn operators() -> Vec<Vec<u8>> {
    // 4: press, or connect first. 2: change a field. 6: poll. 5: poll after this many nanoseconds. 0: leave. 1:
    // raw bytes.
    let stories: [&[&[u8]]; 4] = [
        // One operator connects, presses, holds, releases, and stops the robot.
        &[&[4, 0, 4, 0, 6, 0], &[2, 0, 0, 1, 6, 0], &[2, 0, 0, 0, 6, 0], &[2, 0, 4, 1, 6, 0]],
        // Two operators compete, and the first leaves.
        &[&[4, 0, 4, 1, 4, 0, 4, 1, 6, 0], &[0, 0, 6, 0], &[4, 1, 6, 0]],
        // Silence beyond the lease.
        &[&[4, 0, 4, 0, 6, 0], &[5, 0, 0, 0, 0, 16, 0, 0, 0, 0]],
        // A packet of unknown length.
        &[&[1, 0, 1, 0, 3, 1, 2, 3, 6, 0]],
    ];
    let crowd = (0..18).flat_map(|peer| [4, peer, 4, peer]).chain([6, 0]).collect();
    stories.iter().map(|story| story.concat()).chain([crowd]).collect()
}

fn engage() -> Vec<Vec<u8>> {
    let set = |field: u8, bits: u64| [&[field], bits.to_le_bytes().as_slice()].concat();
    let press = [vec![1], set(36, 1)].concat();
    let ready = vec![0xc0, 0xc0, 0xc0];
    let with = |more: &[&[u8]]| [ready.as_slice(), &press, &more.concat()].concat();
    let aligned = [vec![1], set(33, 1)].concat();
    vec![
        with(&[&aligned, &[0xc0]]),
        // An emergency stop, a reset, and an enable again.
        with(&[&[1], &set(11, 1), &[2], &set(5, 0), &set(32, 1), &[1], &set(10, 1), &press]),
        // No heartbeat. No target. A silent driver.
        with(&[&[1, 255, 7], &[0xc0, 0xc0]]),
        with(&[&[1, 255, 14], &[0xc0]]),
        with(&[&[1, 255, 11], &[0xc0]]),
        [ready.as_slice(), &[3], &set(26, 1), &set(32, 1), &set(39, 1), &[0x80]].concat(),
    ]
}

fn gate() -> Vec<Vec<u8>> {
    let moving: Vec<u8> = (0..16).flat_map(|i| [0x61, i, 0, 0, 0, 0]).collect();
    let all: Vec<u8> = (0..8).flat_map(|i| [vec![0x63], vec![i; 17]].concat()).collect();
    vec![vec![0x60; 8], moving, all, vec![0x64, 0, 0, 0, 0, 0, 0, 0xf8, 0x7f], vec![0xfe, 0, 0, 0x60]]
}
