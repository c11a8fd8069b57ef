//! `teleopd-ros2 states` beside a simulated robot that moves. Cyclone DDS decodes what it publishes.

use super::python;
use harness::{Killed, Rig, interrupt, repository};
use messages::Mode;
use serde_json::Value;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Domain of this test. Tests of one program run at the same time.
const DOMAIN: u32 = 117;

/// Reads for two seconds after the first joint states, as a program of ROS 2 does.
const WATCH: &str = include_str!("states.py");

#[test]
fn programs_of_ros2_see_the_joints_of_an_instance_that_moves() {
    harness::in_real_time(|| {
        let Ok(python) = python().map_err(|why| println!("skipped: no program of ROS 2: {why}")) else { return };
        let mut rig = Rig::with_settings(&format!("ros2.interface = \"lo\"\nros2.domain_id = {DOMAIN}"));
        let (operator, mut observer, _client) = rig.follow_builtin(0.2);
        let states = || {
            let mut program = Command::new(Path::new(env!("CARGO_BIN_EXE_teleopd")).with_file_name("teleopd-ros2"));
            program
                .args(["states", "--run-dir"])
                .arg(rig.folder())
                .arg("--config")
                .arg(rig.folder().join("teleop.toml"));
            program
        };
        let mut program = Killed(states().stdout(Stdio::piped()).spawn().expect("build it with cargo build -p ros2"));
        let mut line = String::new();
        BufReader::new(program.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
        assert!(line.contains("publishes /joint_states and /robot_description"), "{line}");
        let mut watch = Command::new(&python);
        watch.args(["-c", WATCH]).arg(repository().join("tools/peer")).arg(DOMAIN.to_string());
        let watched = watch.output().expect("it runs");
        let watched: Value =
            serde_json::from_slice(&watched.stdout).unwrap_or_else(|_| panic!("{}", harness::stderr(&watched)));
        let model = config::load_model(&repository().join("config/robots/tiago_dual.toml")).expect("the robot").0;
        let names: Vec<&str> = watched["names"].as_array().expect("names").iter().filter_map(Value::as_str).collect();
        assert_eq!(names, model.joint_names[..model.count]);
        assert_eq!(watched["urdf"].as_str(), Some(&*model.texts.urdf));
        // A hundred a second, on a busy machine half of them.
        assert!(watched["count"].as_u64() > Some(100) && watched["is_ordered"] == true, "{}", watched["count"]);
        assert!(watched["age_s"].as_f64().is_some_and(|age_s| (0.0..0.1).contains(&age_s)), "{}", watched["age_s"]);
        let [moved, off] = ["moved", "off"].map(|key| watched[key].as_f64().expect("a number"));
        assert!(moved > 0.1 && off < 0.03, "moved {moved} rad, and {off} rad unlike its velocities");
        let second = states().output().expect("it runs");
        let error = harness::stderr(&second);
        assert_eq!(second.status.code(), Some(69), "{error}");
        assert!(error.contains("another program publishes /joint_states"), "{error}");
        interrupt(&program);
        program.wait().expect("it ends");
        operator.release();
        operator.wait_mode(Mode::Disengaged);
        observer.wait_at_rest();
        rig.end_without_violations();
    });
}
