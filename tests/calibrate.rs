//! Tests `teleopctl calibrate` on a real instance. It measures an operator, and the next session uses the result.

use client::{Port, Transport};
use harness::{Pace, Rig};
use messages::{CalibrationSource, HingeCalibration, Layout, Mode, RawSkeleton, raw_flag};
use nalgebra::{UnitQuaternion, Vector3};
use rt::Background;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Lengths of the test person's upper arm and forearm, m: left, right.
const LENGTHS_M: [[f32; 2]; 2] = [[0.29, 0.24], [0.3, 0.25]];
/// Time of the T-pose, and then of the bending elbows, in turns, s.
const TURN_S: f64 = 4.0;

/// Returns a person who alternates between two poses: a T-pose, then lowered arms with bending elbows. Replaces
/// the arms of the built-in motion's first frame.
fn person(at_s: f64) -> RawSkeleton {
    let motion = motion::builtin();
    let mut raw = motion::raw_frame(&motion, 0, &HingeCalibration::ZERO);
    let mut trunk = [[0.0; 3]; messages::SMPL_JOINTS];
    trunk.copy_from_slice(&raw.positions[..messages::SMPL_JOINTS]);
    let torso = UnitQuaternion::from_matrix(&skeleton::torso_rotation(&trunk).expect("a trunk"));
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let phase = at_s % (2.0 * TURN_S);
    let bends = if phase < TURN_S { 0.0 } else { 1.0 - (std::f64::consts::TAU * (phase - TURN_S) / 2.0).cos() };
    let sway = 0.01 * (3.0 * at_s).sin();
    for (side, [upper_m, fore_m]) in LENGTHS_M.into_iter().enumerate() {
        let sign = if side == 0 { 1.0 } else { -1.0 };
        let upper = torso * about(Vector3::x_axis(), (sway - 0.3 * bends) * sign);
        let fore = upper * about(Vector3::z_axis(), -0.6 * sign * bends) * about(Vector3::y_axis(), 0.4 * bends);
        let mut at = Vector3::from(raw.positions[16 + side]).cast::<f64>();
        for (joint, rotation, length) in [(18, upper, upper_m), (20, fore, fore_m)] {
            at += rotation * Vector3::y() * (sign * f64::from(length));
            raw.positions[joint + side] = at.cast::<f32>().into();
        }
        // Rest orientations of the joint frames, as no robot has them.
        let rest = about(Vector3::x_axis(), 0.7) * about(Vector3::z_axis(), 0.4 * sign);
        for (joint, rotation) in [(16, upper), (18, upper), (20, fore)] {
            let q = rotation * rest;
            raw.rotations[joint + side] = [q.i, q.j, q.k, q.w].map(|c| c as f32);
        }
    }
    raw.flags = raw_flag::ROTATIONS;
    raw.operator_id = 5;
    raw
}

/// A client that publishes the person at 60 Hz until it is dropped.
fn client(rig: &Rig, session: u64) -> Background {
    let domain = Transport::Domain(rig.instance.input_domain());
    let open = || Port::open(domain, "calibrated");
    let client = Background::opened("client", open, move |mut port, ends| {
        let (begun, incarnation) = (Instant::now(), rt::incarnation());
        let mut pace = Pace::new(Duration::from_millis(16));
        let mut sequence = 0;
        while !ends.load(Ordering::Relaxed) {
            let mut raw = person(begun.elapsed().as_secs_f64());
            sequence += 1;
            raw.session_nonce = session;
            (raw.header.sequence, raw.header.incarnation) = (sequence, incarnation);
            (raw.header.origin, raw.header.stamp) = (rt::now(), rt::now());
            port.publish(&raw).expect("taken");
            pace.wait();
        }
    });
    client.expect("the input domain")
}

fn calibrate(rig: &Rig, name: &str, folder: &std::path::Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_teleopctl"));
    command.arg("--run-dir").arg(rig.folder()).args(["calibrate", name, "--folder"]).arg(folder);
    command.stdin(Stdio::null());
    command
}

#[test]
fn calibrated_operator_is_recognised_in_the_next_session() {
    harness::in_real_time(|| {
        // Also where the robot is the person's mirror image: the file names the person's own sides.
        let mut rig = Rig::with_settings("ingest.mirror = true");
        rig.start_all();
        let operator = rig.operator_session();
        let place = rig.folder().join("operators");
        // It waits for somebody, and says so.
        let mut measured = calibrate(&rig, "anna", &place).stdout(Stdio::piped()).spawn().expect("teleopctl runs");
        let (mut output, mut printed) = (BufReader::new(measured.stdout.take().expect("a pipe")), String::new());
        while !printed.contains("no skeletons arrive") {
            assert!(output.read_line(&mut printed).expect("its words") > 0, "it ended: {printed}");
        }
        assert!(printed.contains("replay builtin:calibration"), "{printed}");
        let first = client(&rig, 1);
        output.read_to_string(&mut printed).expect("its words");
        assert!(measured.wait().expect("it ends").success(), "{printed}");
        assert!(printed.contains("upper arms        0.290 m left, 0.300 m right"), "{printed}");
        assert!(printed.contains("forearms          0.240 m left, 0.250 m right"), "{printed}");
        assert!(printed.contains("move both arms up and down") && printed.contains("axes from"), "{printed}");
        assert!(
            printed.contains("anna is measured. Now end the client, wait a second, and start it again"),
            "{printed}"
        );
        let text = std::fs::read_to_string(place.join("anna.toml")).expect("the file");
        assert!(text.contains("operator_id = 5") && text.contains("layout = 1") && text.contains("[hinges]"), "{text}");
        // The current session continues unchanged. The next one begins with the stored measurement.
        operator.wait("estimated online", |status| status.calibration == CalibrationSource::Online as u32);
        drop(first);
        // The lease ends a second after its client.
        operator.wait_control(Duration::from_millis(1500));
        let _second = client(&rig, 2);
        operator.wait("calibrated from the file", |status| status.calibration == CalibrationSource::Stored as u32);
        let refused = |name: &str| {
            let refused = calibrate(&rig, name, &place).output().expect("teleopctl runs");
            assert!(!refused.status.success(), "{refused:?}");
            harness::stderr(&refused)
        };
        // The next start would reject the same person under another name.
        let why = refused("bert");
        assert!(why.contains("operator_id 5 with layout 1 belongs to anna.toml already"), "{why}");
        operator.engage_until(Mode::Engaging);
        let why = refused("anna");
        assert!(why.contains("only a disengaged robot can be calibrated to"), "{why}");
        assert!(!place.join("bert.toml").exists() && place.join("anna.toml").exists());
    });
}
