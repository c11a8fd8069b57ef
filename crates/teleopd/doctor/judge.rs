//! Judges what the facts mean for the daemon as configured.

use super::facts::{Cores, Facts, Files, Kernel, Memory, UserRights};
use super::judge_place;
use super::{Finding, Level};
use crate::process::{NOFILE_LEAST, may_lack_realtime};
use config::{DriverKind, Settings};

/// Coarsest acceptable timer resolution, ns. A control period is 667 us. Without high-resolution timers the
/// resolution is the kernel's tick, 1 to 10 ms.
const RESOLUTION_MAX_NS: u64 = 1_000;
/// Number of open files that the systemd units grant.
const NOFILE_AMPLE: u64 = 1024;
/// Share of time below which the kernel's limit may throttle the real-time processes: 30 % of spinning and 20 %
/// of work.
const THROTTLING_SHARE_LEAST: f64 = 0.5;
/// Clocks that are read without a system call, through the vDSO.
const QUICK_CLOCKS: [&str; 4] = ["tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page"];

/// Returns every finding, in the order in which a user should look into it.
pub fn judge(facts: &Facts) -> Vec<Finding> {
    let settings = facts.files.settings.as_ref().ok();
    let mut all = files(&facts.files);
    all.extend(judge_place::place(facts));
    all.push(user(&facts.rights));
    all.extend(settings.map(|settings| priority(settings, &facts.rights)));
    all.extend(settings.map(|settings| memory_lock(settings, &facts.rights)));
    all.push(nofile(&facts.rights));
    all.extend(settings.map(|settings| idle(settings, &facts.rights)));
    all.push(Finding::ok("kernel", format!("{} {}", facts.kernel.release, facts.kernel.version)));
    all.extend(settings.map(|settings| preempt_rt(settings, &facts.kernel)));
    all.push(throttling(&facts.kernel));
    all.push(clock(&facts.kernel));
    all.push(timers(&facts.kernel));
    all.push(machine(&facts.kernel));
    all.push(debugging(&facts.kernel));
    all.extend(settings.and_then(|settings| placement(settings, &facts.cores)));
    all.push(isolation(&facts.cores));
    all.push(governor(&facts.cores));
    all.push(Finding::ok("processor", facts.cores.processor.clone()));
    all.push(swap(settings, &facts.memory));
    all
}

fn files(files: &Files) -> Vec<Finding> {
    let mut all = vec![match &files.settings {
        Ok(_) => Finding::ok("settings", files.config.clone()),
        Err(why) => Finding::problem("settings", why.clone(), "correct the file, or give another with --config"),
    }];
    let advice = [
        ("robot", &files.robot, "correct the file, or name another under [robot] in the settings"),
        ("weights", &files.weights, "copy both files again (git checkout weights), or train new ones; see [weights]"),
        ("stages", &files.stages, "correct this value; `teleopd check` prints all values in use"),
    ];
    for (check, result, advice) in advice {
        match result {
            None => {}
            Some(Ok(found)) => all.push(Finding::ok(check, found.clone())),
            Some(Err(why)) => all.push(Finding::problem(check, why.clone(), advice)),
        }
    }
    let advice = "`collision fit` makes capsules and proofs; `collision check --sign` proves those of the file";
    all.extend(files.doubts.iter().map(|doubt| Finding::note("capsules", doubt.clone(), advice)));
    all
}

/// Without real-time rights a robot does not engage. The exception is a simulated robot whose settings allow it.
fn without_realtime(settings: &Settings) -> (Level, &'static str) {
    let level = match settings.driver.kind {
        DriverKind::Sim => Level::Robot,
        DriverKind::Robot => Level::Problem,
    };
    let so = if may_lack_realtime(settings) {
        "; the simulated robot does not need it"
    } else {
        "; the simulated robot engages only with --engage-without-realtime"
    };
    (level, so)
}

fn user(rights: &UserRights) -> Finding {
    if rights.uid == 0 {
        let advice = "run this as the daemon's user, whose limits differ: sudo -u teleop teleopd doctor ...";
        return Finding::note("user", "root", advice);
    }
    Finding::ok("user", format!("uid {}; limits are those of this shell", rights.uid))
}

fn priority(settings: &Settings, rights: &UserRights) -> Finding {
    let (level, so) = without_realtime(settings);
    let finding = |found: String, advice: String| Finding { check: "priority", level, found, advice };
    match &rights.fifo {
        Some((_, Ok(granted))) => Finding::ok("priority", granted.clone()),
        Some((priority, Err(why))) => finding(
            format!("{why}{so}"),
            format!(
                "LimitRTPRIO={priority} in the unit; in a shell `@teleop - rtprio {priority}` in \
                 /etc/security/limits.d/teleop.conf and a new login"
            ),
        ),
        None => finding(
            format!("realtime.policy requests none{so}"),
            String::from("policy = \"fifo\" under [realtime] in the settings"),
        ),
    }
}

fn memory_lock(settings: &Settings, rights: &UserRights) -> Finding {
    let (level, so) = without_realtime(settings);
    let finding = |found: String, advice: &str| Finding { check: "memory lock", level, found, advice: advice.into() };
    if !settings.realtime.lock_memory {
        return finding(
            format!("realtime.lock_memory = false{so}"),
            "lock_memory = true under [realtime] in the settings",
        );
    }
    match rights.limits.memlock_bytes.filter(|_| !rights.limits.any_lock) {
        None => Finding::ok("memory lock", "unlimited"),
        Some(bytes) => finding(
            format!("RLIMIT_MEMLOCK is {bytes} bytes{so}"),
            "LimitMEMLOCK=infinity in the unit; in a shell `@teleop - memlock unlimited` in \
             /etc/security/limits.d/teleop.conf and a new login",
        ),
    }
}

fn nofile(rights: &UserRights) -> Finding {
    let advice = "LimitNOFILE=4096 in the unit; in a shell: ulimit -n 4096";
    match rights.limits.nofile {
        Some(limit) if limit < NOFILE_LEAST => {
            Finding::problem("open files", format!("{limit} at most, {NOFILE_LEAST} are needed"), advice)
        }
        Some(limit) if limit < NOFILE_AMPLE => {
            Finding::note("open files", format!("{limit} at most; many clients and views need more"), advice)
        }
        Some(limit) => Finding::ok("open files", format!("{limit} at most")),
        None => Finding::ok("open files", "unlimited"),
    }
}

fn idle(settings: &Settings, rights: &UserRights) -> Finding {
    match (settings.realtime.cpu_dma_latency, rights.cpu_dma_latency) {
        (false, _) => {
            Finding::ok("cpu_dma_latency", "not requested (realtime.cpu_dma_latency = false): cores may sleep")
        }
        (true, Some(true)) => Finding::ok("cpu_dma_latency", "/dev/cpu_dma_latency may be written"),
        (true, Some(false)) => Finding::note(
            "cpu_dma_latency",
            "/dev/cpu_dma_latency may not be written: cores sleep, and wake later",
            "in /etc/udev/rules.d/60-teleop.rules: KERNEL==\"cpu_dma_latency\", OWNER=\"teleop\", MODE=\"0660\"; then \
             udevadm trigger /dev/cpu_dma_latency",
        ),
        (true, None) => Finding::note(
            "cpu_dma_latency",
            "there is no /dev/cpu_dma_latency here (a container, or a unit's DevicePolicy)",
            "DeviceAllow=/dev/cpu_dma_latency rw in the unit, --device in a container, or cpu_dma_latency = false",
        ),
    }
}

fn preempt_rt(settings: &Settings, kernel: &Kernel) -> Finding {
    if kernel.preempt_rt {
        return Finding::ok("PREEMPT_RT", "yes");
    }
    let (level, so) = without_realtime(settings);
    Finding {
        check: "PREEMPT_RT",
        level,
        found: format!("no (/proc/sys/kernel/version): other work can delay a tick by milliseconds{so}"),
        advice:
            "boot a PREEMPT_RT kernel: Debian apt install linux-image-rt-amd64, Ubuntu pro enable realtime-kernel; for \
                 a simulated robot alone: --engage-without-realtime, or control.engage_without_realtime = true"
                .into(),
    }
}

fn throttling(kernel: &Kernel) -> Finding {
    let advice = "sysctl kernel.sched_rt_runtime_us=950000";
    match kernel.throttling_us {
        None => Finding::ok("RT throttling", "not known on this kernel"),
        Some((runtime, _)) if runtime < 0 => Finding::ok("RT throttling", "off"),
        Some((0, _)) => {
            Finding::problem("RT throttling", "sched_rt_runtime_us is 0: nothing runs in real time", advice)
        }
        Some((runtime, period)) if (runtime as f64) < THROTTLING_SHARE_LEAST * period as f64 => {
            Finding::note("RT throttling", format!("real-time work stops after {runtime} of {period} us"), advice)
        }
        Some((runtime, period)) => Finding::ok(
            "RT throttling",
            format!("after {runtime} of {period} us: far more than the daemon uses, and stops a runaway loop"),
        ),
    }
}

fn clock(kernel: &Kernel) -> Finding {
    match kernel.clocksource.as_deref() {
        None => Finding::ok("clock", "its source is not shown here"),
        Some(name) if QUICK_CLOCKS.contains(&name) => Finding::ok("clock", name),
        Some(name) => Finding::note(
            "clock",
            format!("{name}: each reading is a system call or slower"),
            "echo tsc > /sys/devices/system/clocksource/clocksource0/current_clocksource, if it is among \
             available_clocksource there",
        ),
    }
}

fn timers(kernel: &Kernel) -> Finding {
    let found = format!("resolution {} ns", kernel.resolution_ns);
    if kernel.resolution_ns > RESOLUTION_MAX_NS {
        let advice = "boot without highres=off, or a kernel with CONFIG_HIGH_RES_TIMERS";
        return Finding::problem("timers", format!("{found}: too coarse for a period of 667 us"), advice);
    }
    Finding::ok("timers", found)
}

fn machine(kernel: &Kernel) -> Finding {
    if kernel.virtual_machine {
        let advice =
            "for a real robot use real hardware, or a virtual machine with each core pinned to its own physical core";
        return Finding::note("machine", "virtual: its host may pause it for milliseconds without notice", advice);
    }
    Finding::ok("machine", "not virtual, according to the processor")
}

fn debugging(kernel: &Kernel) -> Finding {
    match kernel.ptrace_scope {
        Some(0) => Finding::note(
            "ptrace",
            "kernel.yama.ptrace_scope is 0: any process of the daemon's user may stop it or write into its memory",
            "sysctl kernel.yama.ptrace_scope=1",
        ),
        Some(scope) => Finding::ok("ptrace", format!("kernel.yama.ptrace_scope is {scope}")),
        None => Finding::ok("ptrace", "this kernel has no Yama"),
    }
}

fn placement(settings: &Settings, cores: &Cores) -> Option<Finding> {
    let placement = cores.placement.as_ref()?;
    let found = match (&placement.realtime, &placement.others) {
        (None, _) => format!("left to the kernel: {}", placement.reason),
        (Some(own), None) => format!("retarget, control, driver on {own:?}: {}", placement.reason),
        (Some(own), Some(rest)) => {
            format!("retarget, control, driver on {own:?}, ingest on {rest:?}: {}", placement.reason)
        }
    };
    if let config::Cores::List(list) = &settings.realtime.cores {
        let missing = list.iter().find(|core| !cores.map.online.contains(&(**core as usize)));
        if let Some(core) = missing.filter(|_| !cores.map.online.is_empty()) {
            let found = format!("realtime.cores names core {core}, but only {:?} are online", cores.map.online);
            return Some(Finding::problem("cores", found, "name cores that are online, or \"auto\", in the settings"));
        }
    }
    Some(Finding::ok("cores", found))
}

fn isolation(cores: &Cores) -> Finding {
    let (isolated, quiet) = (&cores.map.isolated, &cores.nohz_full);
    if isolated.is_empty() {
        let last = cores.map.online.last().copied().unwrap_or_default();
        if cores.map.online.len() < 2 {
            return Finding::note("isolation", "there is only one core", "use a machine with two or more");
        }
        return Finding::note(
            "isolation",
            "no core is isolated: other programs share caches and interrupts with the daemon",
            format!(
                "on the kernel's command line: isolcpus=managed_irq,domain,{last} nohz_full={last} rcu_nocbs={last}"
            ),
        );
    }
    if !isolated.iter().any(|core| quiet.contains(core)) {
        let advice = format!("nohz_full={0} rcu_nocbs={0} on the kernel's command line", isolated[0]);
        return Finding::note("isolation", format!("{isolated:?} isolated, but with the scheduler's tick"), advice);
    }
    Finding::ok("isolation", format!("{isolated:?} isolated, {quiet:?} without tick"))
}

fn governor(cores: &Cores) -> Finding {
    let slow: Vec<_> = cores.governors.iter().filter(|(_, name)| name != "performance").collect();
    match slow.first() {
        Some((core, name)) => Finding::note(
            "governor",
            format!("core {core} has {name} ({} of {} cores not performance)", slow.len(), cores.governors.len()),
            "cpupower frequency-set -g performance",
        ),
        None if cores.governors.is_empty() => {
            Finding::ok("governor", "none: this machine does not scale its frequency")
        }
        None => Finding::ok("governor", "performance"),
    }
}

fn swap(settings: Option<&Settings>, memory: &Memory) -> Finding {
    if memory.swaps.is_empty() {
        return Finding::ok("swap", "none");
    }
    let used = memory.swaps.join(", ");
    if settings.is_some_and(|settings| settings.realtime.lock_memory) {
        return Finding::ok("swap", format!("{used}; the daemon's memory is locked"));
    }
    Finding::note("swap", format!("{used}; the daemon's memory is not locked"), "swapoff -a, or lock_memory = true")
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
