//! Robots that play no stop by themselves: `forward_command_controller`s, and `rt/arm_sdk` of a Unitree G1.

use super::{Peer, outlive_stop, preflight, rig_with, took_all, wait_refusal};
use harness::{Rig, repository};
use messages::Mode;
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// Domains of these tests. Tests of one program run at the same time.
const DOMAINS: [u32; 6] = [111, 112, 113, 114, 115, 116];

/// An interface, as the peer and the settings name it, with the peer's options and the settings.
struct Interface {
    name: &'static str,
    peer: &'static [&'static str],
    settings: &'static str,
}

const TRAJECTORIES: Interface = Interface { name: "trajectories", peer: &[], settings: "\nros2.servo_lag_ms = 10.0" };
/// Controllers that update half as often as those of Reachy 2. Their joints lag by 10 ms, an assumption.
const POSITIONS: Interface = Interface {
    name: "positions",
    peer: &["--update-hz", "250", "--lag-ms", "10"],
    settings: "\nros2.servo_lag_ms = 10.0",
};
/// Its joints lag by their damping over their stiffness.
const ARM_SDK: Interface = Interface {
    name: "arm_sdk",
    peer: &["--robot", "config/robots/unitree_g1.toml", "--lag-ms", "37.5"],
    settings: "\nros2.emergency_stop_topic = \"\"\nros2.servo_lag_ms = 37.5",
};

impl Interface {
    fn peer(&self, domain: u32, more: &[&str]) -> Option<Peer> {
        Peer::start(domain, &[&["--commands", self.name], self.peer, more].concat())
    }

    /// An instance for it. A robot file that names no interface gets this one.
    fn rig(&self, domain: u32) -> Rig {
        let name = if self.name == "arm_sdk" { "unitree_g1" } else { "tiago_dual" };
        let file = |extension: &str| repository().join(format!("config/robots/{name}.{extension}"));
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("robot-{}-{domain}", self.name));
        std::fs::create_dir_all(&folder).expect("writable");
        let mut text = std::fs::read_to_string(file("toml")).expect("there");
        if !text.contains("\n[driver]\n") {
            text += &format!("\n[driver]\nsetpoints = \"{}\"\n", self.name);
        }
        // Springs that lag by 37.5 ms follow no faster motion within the tolerance of the monitors.
        for (limit, slower) in [("velocity_max_rad_per_s = 6.0", "2.0"), ("acceleration_max_rad_per_s2 = 25.0", "8.0")]
        {
            text = text.replace(limit, &format!("{} = {slower}", limit.split(' ').next().expect("a key")));
        }
        std::fs::write(folder.join(format!("{name}.toml")), text).expect("writable");
        std::fs::copy(file("urdf"), folder.join(format!("{name}.urdf"))).expect("writable");
        let (robot, weights) = (folder.join(name), repository().join("weights").join(name));
        let more = format!(
            "\nrobot.file = \"{}.toml\"\nweights.file = \"{}\"\nros2.setpoints = \"{}\"{}",
            robot.display(),
            weights.display(),
            self.name,
            self.settings
        );
        rig_with("lo", domain, &more)
    }
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn messages_have_the_bytes_of_independent_encoders() {
    for (interface, domain) in [TRAJECTORIES, POSITIONS, ARM_SDK].into_iter().zip(DOMAINS) {
        let Some(mut peer) = interface.peer(domain, &["--encoders"]) else { return };
        let mut rig = interface.rig(domain);
        rig.start("driver");
        peer.wait("20 messages agree");
    }
}

#[test]
fn f115_unitree_robot_that_is_not_ready_is_refused_with_a_sentence() {
    let Some(mut peer) = ARM_SDK.peer(DOMAINS[3], &["--fault", "second/arm_sdk", "--fault", "names"]) else {
        return;
    };
    let rig = ARM_SDK.rig(DOMAINS[3]);
    let config = rig.folder().join("teleop.toml");
    peer.fault("stale@0.5");
    wait_refusal(
        &config,
        &[
            "another program may send to /arm_sdk",
            "rt/lowstate has mode_machine 6, the robot file 5",
            "rt/lowstate fell silent, or its tick stands",
        ],
    );
    // Nobody chooses this interface by the robot file alone.
    let text = std::fs::read_to_string(&config).expect("there").replace("\"arm_sdk\"", "\"trajectories\"");
    std::fs::write(&config, text).expect("writable");
    let (code, printed) = preflight(&config);
    let printed = printed.concat();
    assert_eq!(code, Some(78), "{printed}");
    assert!(printed.contains("ros2.setpoints = \"trajectories\", must be \"arm_sdk\""), "{printed}");
}

/// Drives the built-in motion for two seconds, or until a joint is fast and the driver is killed. Returns the peer's report, and
/// the largest speed of a joint when the driver was killed, rad/s or m/s.
fn drive(interface: &Interface, domain: u32, kill: bool) -> Option<(Value, f64)> {
    let peer = interface.peer(domain, &[])?;
    let mut rig = interface.rig(domain);
    let (operator, mut observer, _client) = rig.follow_builtin(0.2);
    let mut speed = 0.0;
    if kill {
        let fast = observer.wait("fast", |robot| robot.v.iter().any(|v| v.abs() > 0.5));
        rig.kill("driver");
        speed = fast.v.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        outlive_stop();
    } else {
        operator.wait_control(Duration::from_secs(2));
        operator.release();
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        rig.end_without_violations();
    }
    Some((peer.end().0, speed))
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn robot_that_takes_positions_or_arm_sdk_follows_and_takes_every_message() {
    println!("| interface | acceleration, share of the limit | messages | largest gap, ms |");
    for (interface, domain) in [(POSITIONS, DOMAINS[1]), (ARM_SDK, DOMAINS[2])] {
        let Some((report, _)) = drive(&interface, domain, false) else { return };
        assert!(took_all(&report), "{report:#}");
        let command = &report["command"];
        assert_eq!(command["position_excess"]["exceeded_updates"], 0, "{report:#}");
        assert_eq!(command["velocity_share"]["worst"].as_f64().map(|share| share > 0.01), Some(true), "it moved");
        for (name, one) in report["controllers"].as_object().expect("controllers") {
            let share = &command["acceleration_share"]["worst"];
            println!("| {} {name} | {share} | {} | {} |", interface.name, one["accepted"], one["gap_max_ms"]);
        }
        if interface.name == "arm_sdk" {
            let weight = &report["arm_sdk"]["arm_sdk"];
            assert!(weight["weight_max"] == 1.0 && weight["weight"] == 0.0, "it was given back: {weight}");
        }
    }
}

#[test]
#[ignore = "two cores do not hold a robot, its peer and other tests in time: cargo test --release --test system ros2 -- --ignored"]
fn robot_without_a_dead_man_holds_at_once_when_its_driver_is_killed() {
    for (interface, domain) in [(POSITIONS, DOMAINS[4]), (ARM_SDK, DOMAINS[5])] {
        let Some((report, speed)) = drive(&interface, domain, true) else { return };
        let share = report["command"]["acceleration_share"]["worst"].as_f64().expect("a number");
        println!("{}: a step from {speed:.2} rad/s, {share:.1} of the acceleration limit", interface.name);
        for one in report["controllers"].as_object().expect("controllers").values() {
            let moved_ms = one["moved_after_a_message_max_ms"].as_f64().expect("a number");
            assert!(moved_ms < 40.0, "nobody goes on moving it: {report:#}");
        }
        if interface.name == "arm_sdk" {
            assert_eq!(report["arm_sdk"]["arm_sdk"]["weight"], 1.0, "the peer keeps the weight, an assumption");
        }
    }
}
