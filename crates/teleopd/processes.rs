//! Table of the processes of an instance. `up` and `demo` start them from this table. The units in
//! config/systemd/ use the same names.

use std::time::Duration;

/// Properties of one process.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Subcommand, also the instance name of its unit: `teleop@NAME`.
    pub name: &'static str,
    /// True if the process asks for SCHED_FIFO and locked memory.
    pub realtime: bool,
    /// True if a service manager may restart the process after a failure. Such a process moves nothing, and its
    /// restart engages nothing.
    pub restarts: bool,
}

/// The processes in starting order: each starts when the one before it is READY, and ends before that one does. The driver
/// needs a robot, and `control` needs the driver's state. `retarget` needs no other process. `ingest` starts last and lets
/// clients in.
pub const TABLE: [Row; 5] = [
    Row { name: "robot", realtime: true, restarts: false },
    Row { name: "driver", realtime: true, restarts: false },
    Row { name: "control", realtime: true, restarts: false },
    Row { name: "retarget", realtime: true, restarts: true },
    Row { name: "ingest", realtime: false, restarts: true },
];

/// Names of the processes in starting order. They stop in reverse order. First input stops, then targets, then
/// control with the robot at rest. The driver and its robot stop last.
pub const PROCESSES: [&str; 5] = [TABLE[0].name, TABLE[1].name, TABLE[2].name, TABLE[3].name, TABLE[4].name];

/// Returns the metrics port of process `name`. `first` is the first port of the instance. The ports follow the
/// data path from the person, which is the reverse of the starting order. 0 means no port.
pub fn metrics_port(first: u32, name: &str) -> u16 {
    let offset = PROCESSES.iter().rev().position(|process| *process == name).unwrap_or_default();
    if first == 0 { 0 } else { (first as usize + offset) as u16 }
}

/// Longest time from start to READY. Weights, memory lock, services and warm-up ticks take well under a second.
pub const READY_WITHIN: Duration = Duration::from_secs(20);

/// Longest time from SIGTERM to the end of a process: 5 s in which a driver takes the arms of a Unitree robot, the longest
/// stop (0.5 s), 5 s in which it gives them back, and its report.
pub const END_WITHIN: Duration = Duration::from_secs(12);

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::path::{Path, PathBuf};

    /// The unit folders of the system manager and of the user manager.
    const MANAGERS: [&str; 2] = ["system", "user"];

    fn folder(manager: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("config/systemd").join(manager)
    }

    /// Returns every value of `key` in a unit file and its drop-ins, in the order in which systemd reads them.
    fn values(manager: &str, unit: &str, key: &str) -> Vec<String> {
        let mut files = vec![folder(manager).join(unit)];
        if let Some((template, _)) = unit.split_once('@') {
            files[0] = folder(manager).join(format!("{template}@.service"));
        }
        let mut more: Vec<_> = std::fs::read_dir(folder(manager).join(format!("{unit}.d")))
            .map_or(Vec::new(), |entries| entries.flatten().map(|entry| entry.path()).collect());
        more.sort();
        files.extend(more);
        let mut found = Vec::new();
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            let lines = text.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('='));
            found.extend(lines.map(str::to_owned));
        }
        found
    }

    fn unit(name: &str) -> String {
        format!("teleop@{name}.service")
    }

    fn split(values: &[String]) -> BTreeSet<String> {
        values.iter().flat_map(|value| value.split_whitespace()).map(str::to_owned).collect()
    }

    #[test]
    fn units_name_processes_in_table_order() {
        for manager in MANAGERS {
            let all: BTreeSet<String> = PROCESSES.map(unit).into();
            assert_eq!(split(&values(manager, "teleop.target", "Wants")), all, "{manager}");
            assert_eq!(split(&values(manager, "teleop.target", "After")), all, "{manager}");
            let before = std::iter::once(None).chain(PROCESSES.map(Some));
            for (name, before) in PROCESSES.into_iter().zip(before) {
                let waited_for = before.map(unit).into_iter().collect();
                assert_eq!(split(&values(manager, &unit(name), "After")), waited_for, "{manager} {name}");
            }
            let drop_ins = std::fs::read_dir(folder(manager)).unwrap().flatten().map(|entry| entry.file_name());
            for drop_in in drop_ins.filter_map(|name| name.to_str()?.strip_suffix(".d").map(str::to_owned)) {
                assert!(all.contains(&drop_in), "{manager}: {drop_in} is no process");
            }
        }
    }

    #[test]
    fn units_have_the_timeouts_restarts_and_rights_of_the_table() {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
        let settings = config::load(&config, config::Overrides::default()).expect("settings").settings.realtime;
        let highest = settings.priority_retarget.max(settings.priority_control).max(settings.priority_driver);
        for (manager, row) in MANAGERS.into_iter().flat_map(|manager| TABLE.iter().map(move |row| (manager, row))) {
            let name = row.name;
            let last = |key: &str| values(manager, &unit(name), key).pop();
            let one = |key: &str| last(key).unwrap_or_else(|| panic!("{manager} {name}: no {key}"));
            assert!(one("ExecStart").starts_with("/usr/bin/teleopd %i --config "), "{}", one("ExecStart"));
            assert_eq!(one("Type"), "notify");
            assert_eq!(one("TimeoutStartSec"), READY_WITHIN.as_secs().to_string());
            assert_eq!(one("TimeoutStopSec"), END_WITHIN.as_secs().to_string());
            assert!(one("WatchdogSec").parse::<u32>().is_ok_and(|seconds| seconds >= 1));
            assert_eq!(one("Restart"), if row.restarts { "on-failure" } else { "no" }, "{manager} {name}");
            let limit = row.restarts.then(|| ("60".to_owned(), "3".to_owned()));
            assert_eq!(last("StartLimitIntervalSec").zip(last("StartLimitBurst")), limit, "{manager} {name}");
            let granted: u32 = one("LimitRTPRIO").parse().expect("a priority");
            if row.realtime {
                assert!(granted >= highest, "{manager} {name}: {granted} is below {highest}");
                assert_eq!(one("LimitMEMLOCK"), "infinity");
            } else {
                assert_eq!(granted, 0, "{manager} {name}");
            }
            assert_eq!(last("RestrictRealtime").is_some(), !row.realtime, "{manager} {name}");
        }
        // Requires= would restart the other processes when one restarts.
        MANAGERS.iter().for_each(|manager| assert!(values(manager, "teleop.target", "Requires").is_empty()));
    }
}
