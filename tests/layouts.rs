//! Tests a real `ingest` with clients of other layouts at its socket.

use doors::Client;
use harness::{Pace, Rig, repository, wait_until};
use messages::{RAW_JOINTS_MAX, RawSkeleton, SkeletonLayout};
use std::time::Duration;

/// Number of frames of each client, and their period.
const FRAMES: usize = 30;
const PERIOD: Duration = Duration::from_millis(10);

/// Converts the frame to OpenXR: x right, y up, z back.
fn as_xr(mut raw: RawSkeleton) -> RawSkeleton {
    raw.layout = SkeletonLayout::XrBd24 as u32;
    raw.joint_count = 24;
    raw.positions = raw.positions.map(|[x, y, z]| [-y, z, -x]);
    raw.rotations = raw.rotations.map(|[x, y, z, w]| [-y, z, -x, w]);
    raw.calibration.hinge = raw.calibration.hinge.map(|[x, y, z]| [-y, z, -x]);
    raw
}

/// Converts the frame to the ZED file's layout, from a camera that the person faces: x left, y down, z back, mm.
fn as_zed(raw: RawSkeleton) -> RawSkeleton {
    let of = |smpl: usize, zed: usize| (smpl, zed);
    let mut out = RawSkeleton { layout: 1038, joint_count: 38, flags: 0, ..raw };
    out.positions = [[0.0; 3]; RAW_JOINTS_MAX];
    out.confidence = [0.0; RAW_JOINTS_MAX];
    let arms = (16..22).map(|smpl| of(smpl, smpl - 4));
    for (smpl, zed) in
        arms.chain([of(1, 18), of(2, 19), of(4, 20), of(5, 21), of(7, 22), of(8, 23), of(10, 24), of(11, 25)])
    {
        let [x, y, z] = raw.positions[smpl];
        (out.positions[zed], out.confidence[zed]) = ([1e3 * y, -1e3 * z, -1e3 * x], 90.0);
    }
    out
}

#[test]
fn ingest_accepts_known_layouts_and_counts_unknown_as_dropped() {
    let zed = repository().join("config/skeletons/zed_body_38.toml");
    let mut rig = Rig::with_settings(&format!("ingest.layouts = [{:?}]", zed.display().to_string()));
    rig.start("ingest");
    let motion = motion::builtin();
    let calibration = motion::calibrate(&motion, motion::CalibrationMode::First10s);
    let unknown = |raw| RawSkeleton { layout: 1999, ..raw };
    let layouts: [&dyn Fn(RawSkeleton) -> RawSkeleton; 4] = [&|raw| raw, &as_xr, &as_zed, &unknown];
    let mut client = Client::attach(rig.instance.skeleton_socket()).expect("a client");
    let (mut sequence, mut pace) = (0, Pace::new(PERIOD));
    for layout in layouts {
        for frame in 0..FRAMES {
            pace.wait();
            sequence += 1;
            let mut raw = layout(motion::raw_frame(&motion, frame, &calibration));
            (raw.header.sequence, raw.header.origin, raw.header.stamp) = (sequence, rt::now(), rt::now());
            client.publish(&raw).expect("taken");
        }
    }
    // `ingest` reads the last frames.
    (0..10).for_each(|_| pace.wait());
    let figures = rig.end("ingest");
    let count = |value: &serde_json::Value| value.as_u64().unwrap_or(0);
    assert_eq!(count(&figures["dropped"]["Layout"]), FRAMES as u64, "{figures}");
    // When the layout changes, joints must not jump, and time must advance. One or two frames of each layout may
    // be lost.
    assert!(count(&figures["accepted"]) >= 3 * (FRAMES as u64 - 8), "{figures}");
    for reason in ["NotUpright", "Chirality", "Size", "OutOfRange", "NotFinite", "NotUnit", "Count"] {
        assert_eq!(count(&figures["dropped"][reason]), 0, "{figures}");
    }
}

#[test]
fn status_says_why_frames_are_dropped() {
    let rig = Rig::whole();
    let operator = rig.operator_session();
    let motion = motion::builtin();
    let calibration = motion::calibrate(&motion, motion::CalibrationMode::First10s);
    let mut client = Client::attach(rig.instance.skeleton_socket()).expect("a client");
    let outsized = skeleton::DropReason::OutOfRange as u32 + 1;
    let (mut frame, mut pace) = (0, Pace::new(PERIOD));
    wait_until("a reason in the status", || {
        frame += 1;
        let mut raw = motion::raw_frame(&motion, frame, &calibration);
        // Positions in centimetres.
        raw.positions = raw.positions.map(|place| place.map(|x| 100.0 * x));
        (raw.header.sequence, raw.header.origin, raw.header.stamp) = (frame as u64, rt::now(), rt::now());
        client.publish(&raw).expect("taken");
        pace.wait();
        operator.status().is_some_and(|status| status.input_drop == outsized)
    });
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_teleopctl"))
        .arg("--run-dir")
        .arg(rig.folder())
        .args(["status", "--json"])
        .output()
        .expect("teleopctl runs");
    let printed: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
    assert_eq!(printed["input_drop"], "OutOfRange", "{printed:#}");
    // A second after the last frame, no drop is reported any more.
    operator.wait("silent", |status| status.input_drop == 0);
}
