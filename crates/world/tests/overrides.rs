//! Options of the command line that replace a setting: they are checked as if the file had the value.

use crate::files::shipped;
use crate::support;
use config::{Interface, Overrides, Settings, read_settings};
use std::path::Path;

/// Reads these settings from a file beside the shipped robots. Errors name it FILE.
fn read(table: &toml::Table, overrides: &Overrides) -> Result<Settings, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let robots = support::shipped("robots").canonicalize().expect("the robots");
    std::os::unix::fs::symlink(robots, folder.path().join("robots")).expect("linked");
    let file = folder.path().join("teleop.toml");
    std::fs::write(&file, toml::to_string(table).expect("TOML")).expect("written");
    let name = file.display().to_string();
    read_settings(&file, overrides).map_err(|error| error.to_string().replace(&name, "FILE"))
}

/// The shipped settings with this kind of robot.
fn of_kind(kind: &str, interface: Option<&str>) -> toml::Table {
    let mut table = shipped();
    let driver = table["driver"].as_table_mut().expect("a table");
    driver.insert("kind".into(), kind.into());
    driver.insert("program".into(), "/bin/true".into());
    if let Some(interface) = interface {
        driver.insert("interface".into(), interface.into());
    }
    table
}

fn in_file(mut table: toml::Table, section: &str, key: &str, value: toml::Value) -> Result<Settings, String> {
    table[section].as_table_mut().expect("a table").insert(key.into(), value);
    read(&table, &Overrides::default())
}

#[test]
fn interface_of_option_is_judged_like_that_of_file() {
    for (kind, own) in [("sim", None), ("robot", None), ("robot", Some("direct"))] {
        let table = of_kind(kind, own);
        for interface in Interface::ALL {
            let overrides = Overrides { interface: Some(interface), ..Overrides::default() };
            let option = read(&table, &overrides);
            let file = in_file(table.clone(), "driver", "interface", interface.name().into());
            let hint = format!(" (--interface {} sets it)", interface.name());
            assert_eq!(option.map_err(|error| error.replace(&hint, "")), file, "{kind} {own:?} {interface:?}");
        }
    }
}

#[test]
fn real_robot_has_no_default_interface() {
    let refused = read(&of_kind("robot", None), &Overrides::default()).expect_err("refused");
    assert!(refused.contains("driver.kind = \"robot\" needs driver.interface"), "{refused}");
    let simulated = read(&of_kind("sim", None), &Overrides::default()).expect("accepted");
    assert_eq!(simulated.interface(), Interface::Direct);
}

#[test]
fn engaging_without_realtime_as_option_equals_that_of_file() {
    let overrides = Overrides { engage_without_realtime: true, ..Overrides::default() };
    for table in [of_kind("sim", None), of_kind("robot", Some("direct")), of_kind("robot", None)] {
        let file = in_file(table.clone(), "control", "engage_without_realtime", true.into());
        assert_eq!(read(&table, &overrides), file);
    }
}

#[test]
fn settings_with_chosen_robot_are_checked_too() {
    let overrides = Overrides::robot(Some(&"unitree_g1".into()));
    let chosen = read(&of_kind("robot", Some("direct")), &overrides).expect("accepted");
    assert_eq!(Path::new(&chosen.robot.file).file_name(), Some("unitree_g1.toml".as_ref()));
    let refused = read(&of_kind("robot", Some("jtc100-restart")), &overrides).expect_err("refused");
    assert!(refused.contains("driver.interface"), "{refused}");
}

/// A file of before names its interface under `[sim]`, and under `[driver]` what is now `ros2.setpoints`.
#[test]
fn moved_keys_are_refused_with_their_new_place() {
    let mut old = shipped();
    old["sim"].as_table_mut().expect("a table").insert("interface".into(), "direct".into());
    let one = "FILE: sim.interface = \"direct\" is now driver.interface; move each key, with its value";
    assert_eq!(read(&old, &Overrides::default()).expect_err("refused"), one);
    for setpoints in ["trajectories", "positions", "arm_sdk"] {
        old["driver"].as_table_mut().expect("a table").insert("interface".into(), setpoints.into());
        let both = format!("driver.interface = \"{setpoints}\" is now ros2.setpoints; move each key");
        let refused = read(&old, &Overrides::default()).expect_err("refused");
        assert!(refused.contains("now driver.interface; ") && refused.contains(&both), "{refused}");
    }
}
