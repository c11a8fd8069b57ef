//! The operator's end behind a cable of the kernel: a network namespace whose packets nftables drops and whose rate tbf
//! limits. It needs root, ip(8), tc(8) and nft(8).

use super::relay::{engage, oldest_ms};
use super::*;

const NAMESPACE: &str = "teleopd-link";
/// The ends of the cable: the robot's, and the operator's in the namespace.
const ENDS: [&str; 2] = ["teleopd-robot", "teleopd-hand"];
const ROBOT_HOST: &str = "10.231.8.1";

/// A cable between this machine and a network namespace.
struct Cable;

impl Cable {
    /// Lays it. The error says why it cannot.
    fn lay() -> Result<Self, String> {
        let [robot, hand] = ENDS;
        shell("nft --version && tc -V")?;
        // Left behind by a test that was killed.
        drop(Self);
        shell(&format!("ip netns add {NAMESPACE}"))?;
        let cable = Self;
        shell(&format!("ip link add {robot} type veth peer name {hand} netns {NAMESPACE}"))?;
        shell(&format!("ip address add {ROBOT_HOST}/24 dev {robot} && ip link set {robot} up"))?;
        there(&format!("ip address add 10.231.8.2/24 dev {hand}"))?;
        there(&format!("ip link set {hand} up"))?;
        // Not every kernel has them.
        cable.lose(0)?;
        cable.narrow("10mbit", "50ms")?;
        cable.widen()?;
        Ok(cable)
    }

    /// Drops this share of the packets in each way, %.
    fn lose(&self, percent: u32) -> Result<(), String> {
        let which = if percent < 100 { format!("numgen random mod 100 < {percent}") } else { String::new() };
        for (end, run) in ENDS.into_iter().zip([shell as fn(&str) -> _, there]) {
            let drop = format!("chain in {{ type filter hook ingress device {end} priority 0; {which} drop\n}}");
            let table = format!("table netdev {end} {{}}\ndelete table netdev {end}\ntable netdev {end} {{ {drop}\n}}");
            run(&format!("nft '{table}'"))?;
        }
        Ok(())
    }

    /// Lets the operator's end send at this rate, with a queue of so long.
    fn narrow(&self, rate: &str, queue: &str) -> Result<(), String> {
        there(&format!("tc qdisc replace dev {} root tbf rate {rate} burst 3000 latency {queue}", ENDS[1]))
    }

    fn widen(&self) -> Result<(), String> {
        there(&format!("tc qdisc del dev {} root", ENDS[1]))
    }

    /// Lets packets of this length through, bytes.
    fn limit_length(&self, mtu: u32) {
        shell(&format!("ip link set {} mtu {mtu}", ENDS[0])).expect("a length");
        there(&format!("ip link set {} mtu {mtu}", ENDS[1])).expect("a length");
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        // What was never laid cannot be taken away.
        let _ = shell(&format!("nft delete table netdev {}", ENDS[0]));
        let _ = shell(&format!("ip link del {}", ENDS[0]));
        let _ = shell(&format!("ip netns del {NAMESPACE}"));
    }
}

fn there(command: &str) -> Result<(), String> {
    shell(&format!("ip netns exec {NAMESPACE} {command}"))
}

fn shell(command: &str) -> Result<(), String> {
    let done = Command::new("sh").args(["-c", command]).output().map_err(|error| error.to_string())?;
    let said = String::from_utf8_lossy(&done.stderr);
    if done.status.success() { Ok(()) } else { Err(format!("{command}: {}", said.trim())) }
}

/// Waits until this many more persons have arrived.
fn follows(world: &World, what: &str, count: u64) {
    let before = world.daemon.persons();
    wait(what, || world.daemon.persons() > before + count);
}

#[test]
fn f126_cable_that_is_narrow_lossy_short_or_cut_lets_no_old_person_through() {
    let cable = match Cable::lay() {
        Ok(cable) => cable,
        Err(why) => return println!("skipped: no cable of the kernel: {why}"),
    };
    let world = World::at(ROBOT_HOST, &["anna"]);
    let folder = tempfile::tempdir().expect("a folder");
    let mut by = Command::new("ip");
    by.args(["netns", "exec", NAMESPACE, env!("CARGO_BIN_EXE_bridge")]);
    // IPv6's shortest packet. QUIC begins with 1,200 bytes.
    cable.limit_length(1280);
    let _end = world.operator_by(by, &world.bundle("anna"), folder.path());
    world.robot.wait_line("anna: ready");
    let (ends, thread) = publisher(folder.path());
    follows(&world, "short packets", 100);
    cable.limit_length(1500);

    cable.lose(5).expect("rules");
    let hand = engage(&world, folder.path());
    follows(&world, "5 % lost", 100);
    cable.lose(20).expect("rules");
    std::thread::sleep(Duration::from_secs(5));
    cable.lose(0).expect("rules");
    drop(hand);
    let _hand = engage(&world, folder.path());

    // Persons and heartbeats are 0.5 Mbit/s. They wait in the queue until they are too old.
    cable.narrow("64kbit", "2s").expect("a rate");
    wait("released by a narrow cable", || !world.daemon.view().enable_level);
    let edges = world.daemon.view().enable_edges;
    std::thread::sleep(Duration::from_secs(5));
    cable.widen().expect("no rate");
    follows(&world, "wide again", 100);
    assert_eq!((world.daemon.view().enable_level, world.daemon.view().enable_edges), (false, edges), "by itself");

    let _hand = engage(&world, folder.path());
    cable.lose(100).expect("rules");
    wait("released by a cut", || !world.daemon.view().enable_level);
    cable.lose(0).expect("rules");
    follows(&world, "whole again", 100);
    assert!(!world.daemon.view().enable_level, "by itself");
    ends.store(true, Ordering::Relaxed);
    thread.join().expect("it ends");
    assert!(oldest_ms(&world) <= 100, "{} ms", oldest_ms(&world));
}
