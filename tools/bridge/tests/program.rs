//! The program: packets in, frames on the bus out, as any reader of the input domain sees them.

use bus::Domain;
use messages::{RawSkeleton, Service, Smpl};
use pipeline::Instance;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Where the segments of somebody in a T-pose are who looks along x: m, z up.
const T_POSE: [[f32; 3]; 23] = [
    [0.0, 0.0, 0.95],
    [0.0, 0.0, 1.03],
    [0.0, 0.0, 1.12],
    [0.0, 0.0, 1.21],
    [0.0, 0.0, 1.3],
    [0.0, 0.0, 1.45],
    [0.0, 0.0, 1.55],
    [0.0, -0.03, 1.42],
    [0.0, -0.18, 1.42],
    [0.0, -0.46, 1.42],
    [0.0, -0.72, 1.42],
    [0.0, 0.03, 1.42],
    [0.0, 0.18, 1.42],
    [0.0, 0.46, 1.42],
    [0.0, 0.72, 1.42],
    [0.0, -0.09, 0.93],
    [0.0, -0.09, 0.5],
    [0.0, -0.09, 0.08],
    [0.15, -0.09, 0.03],
    [0.0, 0.09, 0.93],
    [0.0, 0.09, 0.5],
    [0.0, 0.09, 0.08],
    [0.15, 0.09, 0.03],
];

fn mvn(sample: u32) -> Vec<u8> {
    let mut bytes = b"MXTP02".to_vec();
    bytes.extend(sample.to_be_bytes());
    bytes.extend([0x80, 23]);
    bytes.extend([0; 4]);
    bytes.extend([0, 23, 0, 0, 0, 0]);
    bytes.extend((23 * 32_u16).to_be_bytes());
    for (i, position) in T_POSE.iter().enumerate() {
        bytes.extend((i as u32 + 1).to_be_bytes());
        position.iter().chain(&[1.0, 0.0, 0.0, 0.0]).for_each(|x| bytes.extend(x.to_be_bytes()));
    }
    bytes
}

#[test]
fn a_person_of_mvn_reaches_the_input_domain_with_the_left_arm_on_the_left() {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let domain = Domain::open(instance.input_domain(), "test").expect("a domain");
    let mut reader = domain.reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader");
    let mut bridge = Command::new(env!("CARGO_BIN_EXE_bridge"))
        .args(["mvn", "--bind", "127.0.0.1:0", "--run-dir"])
        .arg(folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut lines = BufReader::new(bridge.stdout.take().expect("its output")).lines();
    let mut line = || lines.next().expect("a line").expect("text");
    let told = line();
    let address = told.strip_prefix("bridge: listening at ").expect("an address").to_owned();
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let give_up = Instant::now() + Duration::from_secs(20);
    let (mut sample, mut seen) = (0, None);
    while seen.is_none() && Instant::now() < give_up {
        sample += 1;
        socket.send_to(&mvn(sample), &address).expect("sent");
        std::thread::sleep(Duration::from_millis(10));
        seen = reader.latest();
    }
    let raw = seen.expect("a frame");
    assert!(raw.session_nonce != 0 && raw.header.origin == raw.header.stamp && raw.header.incarnation != 0);
    let frame = layouts::Layouts::default().convert(&raw).expect("a person");
    for (joint, segment) in [(Smpl::LeftWrist, 14), (Smpl::RightWrist, 10), (Smpl::LeftElbow, 13), (Smpl::Head, 6)] {
        assert_eq!(frame.positions[joint as usize], T_POSE[segment], "{joint:?}");
    }
    socket.send_to(b"nobody", &address).expect("sent");
    assert!(line().contains("listening to 127.0.0.1"));
    assert!(line().contains("not of this protocol"));
    rt::terminate(bridge.id());
    assert!(bridge.wait().expect("it ends").success());
    let told = line();
    assert!(told.contains(&format!("{sample} frames, 0 not taken; 1 packets not of this protocol")), "{told}");
}

#[test]
fn without_an_instance_it_says_so() {
    let output = Command::new(env!("CARGO_BIN_EXE_bridge"))
        .args(["vmc", "--bind", "127.0.0.1:0", "--run-dir", "/nowhere/at/all"])
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(69));
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/at/all: no instance"), "{output:?}");
}
