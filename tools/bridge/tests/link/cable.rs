//! The operator's end behind a cable of the kernel: a network namespace whose packets nftables drops and whose rate tbf
//! limits. It needs root, ip(8), tc(8) and nft(8).

use super::relay::engage;
use super::*;
use harness::{Cable, shell};

/// Lays the cable, and tries its rules and rates. Not every kernel has them.
fn lay() -> Result<Cable, String> {
    shell("tc -V")?;
    let cable = Cable::lay("teleopd-link", ["teleopd-robot", "teleopd-hand"], 8)?;
    cable.lose(0)?;
    narrow(&cable, "10mbit", "50ms")?;
    widen(&cable)?;
    Ok(cable)
}

/// Lets the operator's end send at this rate, with a queue of so long.
fn narrow(cable: &Cable, rate: &str, queue: &str) -> Result<(), String> {
    cable.there(&format!("tc qdisc replace dev {} root tbf rate {rate} burst 3000 latency {queue}", cable.ends[1]))
}

fn widen(cable: &Cable) -> Result<(), String> {
    cable.there(&format!("tc qdisc del dev {} root", cable.ends[1]))
}

/// Lets packets of this length through, bytes.
fn limit_length(cable: &Cable, mtu: u32) {
    shell(&format!("ip link set {} mtu {mtu}", cable.ends[0])).expect("a length");
    cable.there(&format!("ip link set {} mtu {mtu}", cable.ends[1])).expect("a length");
}

#[test]
fn f126_cable_that_is_narrow_lossy_short_or_cut_lets_no_old_person_through() {
    let cable = match lay() {
        Ok(cable) => cable,
        Err(why) => return println!("skipped: no cable of the kernel: {why}"),
    };
    let world = World::at(&cable.host, &["anna"]);
    let folder = tempfile::tempdir().expect("a folder");
    let mut by = Command::new(cable.prefix()[0]);
    by.args(&cable.prefix()[1..]).arg(env!("CARGO_BIN_EXE_teleop-bridge"));
    // IPv6's shortest packet. QUIC begins with 1,200 bytes.
    limit_length(&cable, 1280);
    let _end = world.operator_by(by, &world.bundle("anna"), folder.path());
    world.robot.wait_line("anna: ready");
    let _client = publisher(folder.path());
    follows(&world, "short packets", 100);
    limit_length(&cable, 1500);

    cable.lose(5).expect("rules");
    let hand = engage(&world, folder.path());
    follows(&world, "5 % lost", 100);
    cable.lose(20).expect("rules");
    // The length of the loss is the test's input.
    std::thread::sleep(Duration::from_secs(5));
    cable.lose(0).expect("rules");
    drop(hand);
    let _hand = engage(&world, folder.path());

    // Persons and heartbeats are 0.5 Mbit/s. They wait in the queue until they are too old.
    narrow(&cable, "64kbit", "2s").expect("a rate");
    wait_until("released by a narrow cable", || !world.daemon.is_held());
    let edges = world.daemon.counts().enable_edges;
    assert!(holds_for(Duration::from_secs(5), || world.daemon.is_released(edges)), "by itself");
    widen(&cable).expect("no rate");
    follows(&world, "wide again", 100);
    assert!(world.daemon.is_released(edges), "by itself");

    let _hand = engage(&world, folder.path());
    cable.lose(100).expect("rules");
    wait_until("released by a cut", || !world.daemon.is_held());
    cable.lose(0).expect("rules");
    follows(&world, "whole again", 100);
    assert!(!world.daemon.is_held(), "by itself");
    assert_none_was_old(&world);
}
