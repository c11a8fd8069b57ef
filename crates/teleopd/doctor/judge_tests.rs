//! Tests every bad machine against a good one, with one difference each.

use super::super::facts::PlaceFacts;
use super::super::places::{Folder, Segment};
use super::*;
use config::Cores as CoresSetting;
use rt::{CoreMap, Limits, Placement};

fn settings() -> Settings {
    Settings::parse("teleop.toml", include_str!("../../../config/teleop.toml")).expect("the shipped settings")
}

fn good() -> Facts {
    let ok = |text: &str| Some(Ok(String::from(text)));
    let limits =
        Limits { rtprio: Some(90), memlock_bytes: None, nofile: Some(4096), any_priority: false, any_lock: false };
    let folder = Folder::Is { uid: 990, mode: 0o750, usable: true };
    let map = CoreMap { allowed: vec![0, 1, 2], isolated: vec![3], online: vec![0, 1, 2, 3] };
    Facts {
        files: Files {
            doubts: Vec::new(),
            settings: Ok(settings()),
            config: "teleop.toml".into(),
            robot: ok("robot.toml"),
            weights: ok("weights"),
            stages: ok("accepted"),
        },
        rights: UserRights {
            uid: 990,
            limits,
            fifo: Some((80, Ok("SCHED_FIFO priority 80".into()))),
            cpu_dma_latency: Some(true),
        },
        kernel: Kernel {
            release: "6.12.0-rt".into(),
            version: "#1 SMP PREEMPT_RT".into(),
            preempt_rt: true,
            throttling_us: Some((950_000, 1_000_000)),
            clocksource: Some("tsc".into()),
            resolution_ns: 1,
            ptrace_scope: Some(1),
            virtual_machine: false,
        },
        cores: Cores {
            placement: Some(Placement::auto(&map)),
            map,
            nohz_full: vec![3],
            governors: (0..4).map(|core| (core, "performance".into())).collect(),
            processor: "x86_64".into(),
        },
        memory: Memory { shared: Ok((1 << 30, 1 << 30)), swaps: vec![] },
        place: PlaceFacts {
            run_dir: "/run/teleop".into(),
            folders: vec![("/run/teleop".into(), folder.clone()), ("/run/teleop/core".into(), folder)],
            refused: None,
            segments: vec![],
            strangers: vec![],
            holder: None,
        },
    }
}

/// Applies `spoil` to the good machine. Returns all findings that are not ok.
fn findings(spoil: impl FnOnce(&mut Facts)) -> Vec<Finding> {
    let mut facts = good();
    spoil(&mut facts);
    let all = judge(&facts);
    for finding in &all {
        assert_eq!(finding.advice.is_empty(), finding.level == Level::Ok, "advice for what is not ok: {finding:?}");
    }
    all.into_iter().filter(|finding| finding.level != Level::Ok).collect()
}

/// Checks that exactly one finding is wrong: `check`, at `level`, with each of `words` in it.
#[track_caller]
fn one(check: &str, level: Level, words: &[&str], spoil: impl FnOnce(&mut Facts)) {
    let found = findings(spoil);
    assert!(found.len() == 1 && found[0].check == check && found[0].level == level, "{check}, {level:?}: {found:#?}");
    for word in words {
        assert!(found[0].found.contains(word) || found[0].advice.contains(word), "{word}: {:#?}", found[0]);
    }
}

#[test]
fn good_machine_gives_no_finding() {
    assert_eq!(findings(|_| {}), []);
    assert_eq!(findings(|facts| facts.place.folders[0].1 = Folder::Missing { can_be_made: true }), []);
}

#[test]
fn refused_files_are_problems_with_their_error() {
    let refused = || Some(Err(String::from("line 7: no")));
    one("robot", Level::Problem, &["line 7"], |facts| facts.files.robot = refused());
    one("weights", Level::Problem, &["line 7", "weights"], |facts| facts.files.weights = refused());
    one("stages", Level::Problem, &["line 7", "teleopd check"], |facts| facts.files.stages = refused());
    one("settings", Level::Problem, &["unknown key", "--config"], |facts| {
        facts.files.settings = Err("unknown key".into());
        (facts.files.robot, facts.files.weights, facts.files.stages) = (None, None, None);
    });
}

#[test]
fn missing_realtime_is_a_finding_for_robot_only() {
    type Spoil = fn(&mut Facts);
    let lacks: [(&str, &str, Spoil); 5] = [
        ("priority", "LimitRTPRIO=80", |facts| facts.rights.fifo = Some((80, Err("not permitted".into())))),
        ("priority", "policy = \"fifo\"", |facts| facts.rights.fifo = None),
        ("memory lock", "LimitMEMLOCK=infinity", |facts| facts.rights.limits.memlock_bytes = Some(8 << 20)),
        ("memory lock", "lock_memory = true", |facts| {
            facts.files.settings.as_mut().unwrap().realtime.lock_memory = false;
        }),
        ("PREEMPT_RT", "linux-image-rt", |facts| facts.kernel.preempt_rt = false),
    ];
    for (check, advice, spoil) in lacks {
        one(check, Level::Robot, &[advice, "only with --engage-without-realtime"], spoil);
        one(check, Level::Robot, &[advice, "does not need it"], |facts| {
            spoil(facts);
            facts.files.settings.as_mut().unwrap().control.engage_without_realtime = true;
        });
    }
    assert_eq!(
        findings(|facts| (facts.rights.limits.memlock_bytes, facts.rights.limits.any_lock) = (Some(0), true)),
        []
    );
}

#[test]
fn limits_user_and_devices_give_their_findings() {
    one("open files", Level::Problem, &["64", "ulimit -n"], |facts| facts.rights.limits.nofile = Some(64));
    one("open files", Level::Note, &["512"], |facts| facts.rights.limits.nofile = Some(512));
    assert_eq!(findings(|facts| facts.rights.limits.nofile = None), []);
    one("user", Level::Note, &["sudo -u"], |facts| {
        facts.rights.uid = 0;
        for (_, folder) in &mut facts.place.folders {
            *folder = Folder::Is { uid: 0, mode: 0o750, usable: true };
        }
    });
    one("cpu_dma_latency", Level::Note, &["udev"], |facts| facts.rights.cpu_dma_latency = Some(false));
    one("cpu_dma_latency", Level::Note, &["DeviceAllow"], |facts| facts.rights.cpu_dma_latency = None);
    assert_eq!(
        findings(|facts| {
            facts.files.settings.as_mut().unwrap().realtime.cpu_dma_latency = false;
            facts.rights.cpu_dma_latency = None;
        }),
        [],
        "what is not asked for is not missed"
    );
}

#[test]
fn kernel_settings_give_their_findings() {
    let throttled = |runtime| move |facts: &mut Facts| facts.kernel.throttling_us = Some((runtime, 1_000_000));
    one("RT throttling", Level::Problem, &["sysctl"], throttled(0));
    one("RT throttling", Level::Note, &["400000 of 1000000"], throttled(400_000));
    assert_eq!(findings(throttled(-1)), []);
    one("clock", Level::Note, &["hpet"], |facts| facts.kernel.clocksource = Some("hpet".into()));
    one("timers", Level::Problem, &["4000000 ns"], |facts| facts.kernel.resolution_ns = 4_000_000);
    one("machine", Level::Note, &["virtual"], |facts| facts.kernel.virtual_machine = true);
    one("ptrace", Level::Note, &["ptrace_scope=1"], |facts| facts.kernel.ptrace_scope = Some(0));
}

#[test]
fn cores_and_memory_give_their_findings() {
    one("governor", Level::Note, &["powersave", "1 of 4", "cpupower"], |facts| {
        facts.cores.governors[2].1 = "powersave".into();
    });
    assert_eq!(findings(|facts| facts.cores.governors.clear()), [], "a virtual machine has none");
    one("isolation", Level::Note, &["isolcpus=managed_irq,domain,3"], |facts| facts.cores.map.isolated.clear());
    one("isolation", Level::Note, &["nohz_full=3"], |facts| facts.cores.nohz_full.clear());
    one("cores", Level::Problem, &["core 7", "[0, 1, 2, 3]"], |facts| {
        facts.files.settings.as_mut().unwrap().realtime.cores = CoresSetting::List(vec![3, 7]);
    });
    assert_eq!(findings(|facts| facts.memory.swaps.push("/dev/sda2".into())), [], "locked memory does not swap");
    one("/dev/shm", Level::Problem, &["3 of 64 MiB", "32 are needed"], |facts| {
        facts.memory.shared = Ok((64 << 20, 3 << 20));
    });
    one("/dev/shm", Level::Note, &["--shm-size"], |facts| facts.memory.shared = Ok((64 << 20, 60 << 20)));
    one("/dev/shm", Level::Problem, &["no such"], |facts| facts.memory.shared = Err("no such file".into()));
}

#[test]
fn folders_of_or_open_to_other_users_give_their_findings() {
    let spoiled =
        |uid, mode, usable| move |facts: &mut Facts| facts.place.folders[0].1 = Folder::Is { uid, mode, usable };
    one("run folder", Level::Problem, &["uid 1000", "990"], spoiled(1000, 0o750, true));
    one("run folder", Level::Problem, &["0777", "chmod 0751 /run/teleop"], spoiled(990, 0o777, true));
    one("run folder", Level::Problem, &["denies access to its own user"], spoiled(990, 0o050, false));
    one("run folder", Level::Note, &["0770", "group"], spoiled(990, 0o770, true));
    one("run folder", Level::Problem, &["cannot make it"], |facts| {
        facts.place.folders[0].1 = Folder::Missing { can_be_made: false };
    });
    one("run folder", Level::Problem, &["not a folder"], |facts| {
        facts.place.folders[0].1 = Folder::Other("not a folder".into());
    });
    one("bus folder", Level::Problem, &["/run/teleop/core", "uid 0"], |facts| {
        facts.place.folders[1].1 = Folder::Is { uid: 0, mode: 0o750, usable: true };
    });
    assert_eq!(findings(|facts| facts.place.folders[1].1 = Folder::Missing { can_be_made: false }), []);
    one("bus paths", Level::Problem, &["too long", "--run-dir"], |facts| facts.place.refused = Some("too long".into()));
}

#[test]
fn running_instance_and_leftover_segments_give_their_findings() {
    let segment = |name: &str, in_use| Segment { name: name.into(), bytes: 4096, in_use };
    one("instance", Level::Note, &["812", "teleopctl"], |facts| facts.place.holder = Some(812));
    assert_eq!(findings(|facts| facts.place.segments = vec![segment("teleop_core_ab_1", true)]), []);
    one(
        "shared memory",
        Level::Note,
        &["teleop_core_ab_1", "1 more", "dead instance", "rm /dev/shm/teleop_core_ab_* "],
        |facts| {
            facts.place.segments = vec![segment("teleop_core_ab_1", false), segment("teleop_input_ab_2", false)];
        },
    );
    one("other instances", Level::Note, &["1 dead instance", "8 KiB", "rm /dev/shm/teleop_core_cd_* /dev"], |facts| {
        facts.place.strangers = vec![segment("teleop_core_cd_1", false), segment("teleop_input_cd_2", false)];
    });
    one("shared memory", Level::Note, &["teleop_core_ab_2", "that died", "next one starts"], |facts| {
        facts.place.segments = vec![segment("teleop_core_ab_1", true), segment("teleop_core_ab_2", false)];
    });
}
