//! The program: packets go in, and frames come out on the bus, as any reader of the input domain sees them.

use bus::Domain;
use instance::Instance;
use messages::{RawSkeleton, Service, Smpl};
use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::process::{Child, ChildStdout, Command, Stdio};

/// Positions of the 23 segments of a person in a T-pose who faces x, m, z up: the spine and the head, then the right and the
/// left arm, then the right and the left leg.
fn t_pose() -> Vec<[f32; 3]> {
    let spine = [0.95, 1.03, 1.12, 1.21, 1.3, 1.45, 1.55].map(|z| [0.0, 0.0, z]);
    let arm = |side: f32| [0.03, 0.18, 0.46, 0.72].map(|y| [0.0, side * y, 1.42]);
    let leg = |side: f32| [(0.0, 0.93), (0.0, 0.5), (0.0, 0.08), (0.15, 0.03)].map(|(x, z)| [x, side * 0.09, z]);
    [&spine[..], &arm(-1.0), &arm(1.0), &leg(-1.0), &leg(1.0)].concat()
}

fn mvn(sample: u32) -> Vec<u8> {
    let mut bytes = b"MXTP02".to_vec();
    bytes.extend(sample.to_be_bytes());
    bytes.extend([0x80, 23]);
    bytes.extend([0; 4]);
    bytes.extend([0, 23, 0, 0, 0, 0]);
    bytes.extend((23 * 32_u16).to_be_bytes());
    for (i, position) in t_pose().iter().enumerate() {
        bytes.extend((i as u32 + 1).to_be_bytes());
        position.iter().chain(&[1.0, 0.0, 0.0, 0.0]).for_each(|x| bytes.extend(x.to_be_bytes()));
    }
    bytes
}

/// Starts a bridge. Returns it, the address on which it listens, and the rest of its output.
fn start(folder: &std::path::Path, arguments: &[&str]) -> (Child, String, std::io::Lines<BufReader<ChildStdout>>) {
    let mut bridge = Command::new(env!("CARGO_BIN_EXE_teleop-bridge"))
        .args(arguments)
        .arg("--run-dir")
        .arg(folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut lines = BufReader::new(bridge.stdout.take().expect("its output")).lines();
    let reported = lines.next().expect("a line").expect("text");
    let address = reported.strip_prefix("bridge: listening at ").expect("an address").to_owned();
    let reported = lines.next().expect("a line").expect("text");
    assert_eq!(reported.contains("--any-user"), !arguments.contains(&"--any-user"), "{reported}");
    (bridge, address, lines)
}

#[test]
fn mvn_person_reaches_the_input_domain_with_sides_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let domain = Domain::open(instance.input_domain(), "test").expect("a domain");
    let mut reader = domain.reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader");
    let (mut bridge, address, mut lines) = start(folder.path(), &["mvn", "--bind", "127.0.0.1:0"]);
    let mut line = || lines.next().expect("a line").expect("text");
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let (mut sample, mut seen) = (0, None);
    harness::wait_until("a frame", || {
        sample += 1;
        socket.send_to(&mvn(sample), &address).expect("sent");
        seen = reader.latest();
        seen.is_some()
    });
    let raw = seen.expect("a frame");
    assert!(raw.session_nonce != 0 && raw.header.origin == raw.header.stamp && raw.header.incarnation != 0);
    let frame = layouts::Layouts::default().convert(&raw).expect("a person");
    for (joint, segment) in [(Smpl::LeftWrist, 14), (Smpl::RightWrist, 10), (Smpl::LeftElbow, 13), (Smpl::Head, 6)] {
        assert_eq!(frame.positions[joint as usize], t_pose()[segment], "{joint:?}");
    }
    socket.send_to(b"nobody", &address).expect("sent");
    assert!(line().contains("listening to 127.0.0.1"));
    assert!(line().contains("from another protocol"));
    rt::terminate(bridge.id());
    assert!(bridge.wait().expect("it ends").success());
    let reported = line();
    assert!(
        reported.contains(&format!("{sample} frames, 0 not accepted; 1 packets from another protocol")),
        "{reported}"
    );
}

#[test]
fn dual_stack_socket_accepts_ipv4_sender_right_after_garbage() {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let (mut bridge, address, mut lines) =
        start(instance.run_dir(), &["mvn", "--bind", "[::]:0", "--from", "127.0.0.1"]);
    let mut line = || lines.next().expect("a line").expect("text");
    let address = address.replace("[::]", "127.0.0.1");
    let socket = || UdpSocket::bind("127.0.0.1:0").expect("a port");
    let (garbage, good) = (socket(), socket());
    garbage.send_to(b"nobody", &address).expect("sent");
    assert!(line().contains("from another protocol"));
    // At once: a sender of unreadable packets does not hold the turn.
    good.send_to(&mvn(1), &address).expect("sent");
    assert_eq!(line(), format!("bridge: listening to {}", good.local_addr().expect("an address")));
    rt::terminate(bridge.id());
    assert!(bridge.wait().expect("it ends").success());
    let reported = line();
    assert!(reported.contains("1 frames, 0 not accepted; 1 packets from another protocol"), "{reported}");
}

/// Another user of this machine sends a person. Returns the bridge's last message about it.
fn told_of_nobody(arguments: &[&str]) -> Option<String> {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let (mut bridge, address, mut lines) = start(instance.run_dir(), arguments);
    let (host, port) = address.rsplit_once(':').expect("a port");
    // The socket stays open until the packet was examined. A closed socket belongs to no user.
    let send = format!("exec 3>/dev/udp/{host}/{port} && head -c 760 >&3 && echo sent && read line");
    let nobody = Command::new("setpriv")
        .args(["--reuid=65534", "--clear-groups", "bash", "-c", &send])
        .current_dir("/")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let sent = nobody.ok().and_then(|mut nobody| {
        nobody.stdin.as_mut()?.write_all(&mvn(1)).ok()?;
        let mut reported = String::new();
        BufReader::new(nobody.stdout.take()?).read_line(&mut reported).ok()?;
        let line = if reported == "sent\n" { lines.next() } else { None };
        drop(nobody.stdin.take());
        nobody.wait().ok()?;
        line?.ok()
    });
    rt::terminate(bridge.id());
    assert!(bridge.wait().expect("it ends").success());
    sent?;
    lines.next()?.ok()
}

#[test]
fn packets_of_another_user_are_dropped_unless_any_user_is_set() {
    let strict = ["mvn", "--bind", "127.0.0.1:0"];
    let Some(reported) = told_of_nobody(&strict) else {
        return println!("skipped: needs root, setpriv and bash to send as another user");
    };
    assert!(reported.contains("0 frames, 0 not accepted; 1 packets from another user of this machine"), "{reported}");
    let reported = told_of_nobody(&[&strict[..], &["--any-user"]].concat()).expect("as before");
    assert!(reported.contains("1 frames, 0 not accepted"), "{reported}");
}

#[test]
fn bridge_without_an_instance_exits_with_an_error() {
    let output = Command::new(env!("CARGO_BIN_EXE_teleop-bridge"))
        .args(["vmc", "--bind", "127.0.0.1:0", "--run-dir", "/nowhere/at/all"])
        .output()
        .expect("it runs");
    assert_eq!(output.status.code(), Some(69));
    assert!(
        String::from_utf8_lossy(&output.stderr).contains("no instance of teleopd runs in /nowhere/at/all"),
        "{output:?}"
    );
}
