//! Time that a person takes from the operator's skeleton socket to the robot's, over the loopback, beside one socket alone,
//! shared memory, and an echo of zenoh in Python. `cargo test --release -p bridge --test all link_latency -- --ignored --nocapture`
//!
//! On a virtual machine, `taskset -c 1` before it leaves out the time in which the host wakes a sleeping core.

use super::link::{End, keys, text};
use bus::Domain;
use doors::LeaseState;
use harness::{Pace, wait_until};
use instance::Instance;
use messages::{Header, Layout, RawSkeleton, Service, Stamp, raw_flag};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Frames of a measurement, and the time between two: 100 Hz.
const FRAMES: u64 = 1000;
const PERIOD: Duration = Duration::from_millis(10);
/// Bars for what the link adds, one way, ms: half, and 99 of 100.
const BARS_MS: [f64; 2] = [0.5, 2.0];

fn person(sequence: u64) -> RawSkeleton {
    let now = rt::now();
    let header = Header { sequence, stamp: now, origin: now, ..Header::ZERO };
    RawSkeleton { header, flags: raw_flag::ROTATIONS, joint_count: 24, ..RawSkeleton::ZERO }
}

/// Median and 99th percentile, ms.
fn quantiles(mut times: Vec<f64>) -> [f64; 2] {
    times.sort_by(f64::total_cmp);
    [50, 99].map(|share| times.get(times.len() * share / 100).copied().unwrap_or(f64::NAN))
}

fn print_times(what: &str, times: Vec<f64>) -> [f64; 2] {
    let count = times.len();
    let [half, most] = quantiles(times);
    println!("{what}: p50 {half:.3} ms, p99 {most:.3} ms, {count} of {FRAMES}");
    [half, most]
}

/// Sends the frames to the socket at `to`, and notes when.
fn send(to: &Path, sent: &[AtomicU64]) {
    let (mut next, mut client) = (Instant::now(), None);
    for (sequence, at) in sent.iter().enumerate() {
        let client = client.get_or_insert_with(|| doors::Client::attach(to).expect("the socket answers"));
        next += PERIOD;
        // The rate is the test's input. A late frame is not made up for.
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
        next = next.max(Instant::now());
        at.store(rt::now().0, Ordering::Release);
        let _ = client.publish(&person(sequence as u64));
    }
}

/// Sends to the socket `from` in a thread of its own, and waits at `server`. Returns the times between.
fn over_sockets(from: &Path, server: &mut doors::Server) -> Vec<f64> {
    let sent: Vec<_> = (0..FRAMES).map(|_| AtomicU64::new(0)).collect();
    let mut times = Vec::new();
    std::thread::scope(|scope| {
        let sender = scope.spawn(|| send(from, &sent));
        while !sender.is_finished() {
            let (sockets, count) = server.descriptors(rt::now());
            let mut all: Vec<_> =
                sockets[..count].iter().map(|socket| PollFd::from_borrowed_fd(*socket, PollFlags::IN)).collect();
            let _ = poll(&mut all, Some(&Timespec { tv_sec: 0, tv_nsec: 5_000_000 }));
            server.poll(rt::now(), false, |_, frame| {
                let at = sent.get(frame.header.sequence as usize).map_or(0, |at| at.load(Ordering::Acquire));
                if at != 0 {
                    times.push(rt::now().since(Stamp(at)) as f64 * 1e-6);
                }
                LeaseState::Holder
            });
        }
    });
    times
}

/// Time that the host of a virtual machine took from its cores since it started, and all time, in the units of /proc/stat.
fn stolen() -> [f64; 2] {
    let text = std::fs::read_to_string("/proc/stat").unwrap_or_default();
    let line = text.lines().next().unwrap_or_default();
    let times: Vec<f64> = line.split_whitespace().skip(1).take(8).filter_map(|time| time.parse().ok()).collect();
    [times.get(7).copied().unwrap_or_default(), times.iter().sum()]
}

fn over_shared_memory() -> Vec<f64> {
    let folder = tempfile::tempdir().expect("a folder");
    let instance = Instance::new(folder.path()).expect("an instance");
    let domain = Domain::open(instance.input_domain(), "test").expect("a domain");
    let mut writer = domain.writer::<RawSkeleton>(Service::RawSkeleton).expect("a writer");
    let mut reader = domain.reader::<RawSkeleton>(Service::RawSkeleton).expect("a reader");
    let mut times = Vec::new();
    for sequence in 1..=FRAMES {
        let sent = Instant::now();
        let _ = writer.publish(&person(sequence));
        while reader.latest().is_none() && sent.elapsed() < PERIOD {}
        times.push(sent.elapsed().as_secs_f64() * 1e3);
        // The pause between two frames is the test's input.
        std::thread::sleep(Duration::from_millis(1));
    }
    instance.retire();
    times
}

/// Half of the way there and back between two sessions in Python, over TCP without certificates.
const PYTHON: &str = r#"
import sys, threading, time, zenoh
port, frames = sys.argv[1], int(sys.argv[2])
def session(listen, connect):
    text = '{mode:"peer",listen:{endpoints:%s},connect:{endpoints:%s},scouting:{multicast:{enabled:false}}}' % (listen, connect)
    return zenoh.open(zenoh.Config.from_json5(text))
address = '["tcp/127.0.0.1:%s"]' % port
with session(address, '[]') as far, session('[]', address) as near:
    back, got = far.declare_publisher("back"), threading.Event()
    far.declare_subscriber("there", lambda sample: back.put(bytes(sample.payload)))
    near.declare_subscriber("back", lambda sample: got.set())
    there = near.declare_publisher("there")
    time.sleep(1)
    for _ in range(frames):
        got.clear()
        begun = time.perf_counter()
        there.put(bytes(896))
        if got.wait(1):
            print((time.perf_counter() - begun) * 500)
        time.sleep(0.005)
"#;

fn over_python() -> Option<Vec<f64>> {
    let port = UdpSocket::bind("127.0.0.1:0").ok()?.local_addr().ok()?.port().to_string();
    let done = Command::new("python3").args(["-c", PYTHON, &port, &FRAMES.to_string()]).output().ok()?;
    let lines = String::from_utf8_lossy(&done.stdout).into_owned();
    let times: Vec<f64> = lines.lines().filter_map(|line| line.parse().ok()).collect();
    (!times.is_empty()).then_some(times)
}

#[test]
#[ignore = "a measurement: it needs an idle machine"]
fn link_adds_half_a_millisecond_one_way() {
    let (keys, [daemon, local]) = (keys("tiago", &["anna"]), [0; 2].map(|_| tempfile::tempdir().expect("a folder")));
    let mut control = operator::Server::bind(daemon.path().join("operator.sock")).expect("a socket");
    std::thread::spawn(move || {
        let mut pace = Pace::new(Duration::from_millis(1));
        for k in 0.. {
            let header = Header { sequence: k / 20, stamp: rt::now(), ..Header::ZERO };
            control.poll(rt::now(), &messages::Status { header, ..messages::Status::ZERO });
            pace.wait();
        }
    });
    let mut server = doors::Server::bind(&daemon.path().join("skeleton.sock"), None).expect("a socket");
    let direct = print_times("one socket", over_sockets(&daemon.path().join("skeleton.sock"), &mut server));
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|socket| socket.local_addr()).expect("a port").port();
    let address = format!("quic/127.0.0.1:{port}");
    let bundle = keys.path().join("anna.bundle");
    let _ends = [
        End::start(&["robot", "--keys", text(keys.path()), "--listen", &address, "--run-dir", text(daemon.path())]),
        End::start(&["operator", "--bundle", text(&bundle), "--connect", &address, "--run-dir", text(local.path())]),
    ];
    let socket = local.path().join("operator.sock");
    wait_until("the link is there", || operator::Client::connect(&socket).is_ok());
    let before = stolen();
    let linked =
        print_times("both sockets and the link", over_sockets(&local.path().join("skeleton.sock"), &mut server));
    let [taken, all] = [0, 1].map(|n| stolen()[n] - before[n]);
    println!("meanwhile the host took {:.1} % of the cores", 100.0 * taken / all);
    print_times("shared memory", over_shared_memory());
    match over_python() {
        Some(times) => _ = print_times("zenoh in Python over TCP, half of an echo", times),
        None => println!("zenoh in Python: skipped, this Python has no eclipse-zenoh"),
    }
    let added = [0, 1].map(|n| linked[n] - direct[n]);
    println!("the link adds: p50 {:.3} ms, p99 {:.3} ms", added[0], added[1]);
    assert!(added[0] <= BARS_MS[0] && added[1] <= BARS_MS[1], "{added:?}, bars {BARS_MS:?}");
}
