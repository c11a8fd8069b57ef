//! A client in some 30 lines. It publishes the frames of a motion, as your own client would publish a camera's.

use client::{ClientError, Port, Transport};
use instance::Instance;
use messages::{Header, Layout, RawSkeleton, SMPL_JOINTS, SkeletonLayout};
use std::path::PathBuf;
use std::time::Duration;

fn main() -> Result<(), ClientError> {
    let run_dir = std::env::args_os().nth(1).map_or_else(|| instance::DEFAULT_RUN_DIR.into(), PathBuf::from);
    let instance = Instance::unmade(&run_dir);
    if let Err(error) = operator::Client::connect(instance.operator_socket()) {
        eprintln!("usage: client [RUN_DIR]; no instance runs there: {error}");
        std::process::exit(69);
    }
    let mut port = Port::open(Transport::Domain(instance.input_domain()), "example")?;
    let motion = motion::builtin();
    // The number differs at each start. A client that restarts counts as a new one, and the operator must enable again.
    let incarnation = rt::incarnation();
    let session_nonce = u64::from(incarnation) << 32 | 1;
    for (sequence, person) in (1..).zip(motion.frames.iter().cycle()) {
        let seen = rt::now();
        let mut frame = RawSkeleton {
            header: Header { sequence, stamp: seen, origin: seen, incarnation, ..Header::ZERO },
            session_nonce,
            layout: SkeletonLayout::Smpl22 as u32,
            joint_count: SMPL_JOINTS as u32,
            ..RawSkeleton::ZERO
        };
        frame.positions[..SMPL_JOINTS].copy_from_slice(&person.positions);
        frame.confidence[..SMPL_JOINTS].fill(1.0);
        port.publish(&frame)?;
        std::thread::sleep(Duration::from_secs_f64(1.0 / motion.frame_rate_hz));
    }
    Ok(())
}
