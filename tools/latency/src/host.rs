//! Description of the machine that measured the figures.

use serde_json::{Value, json};
use std::path::Path;

#[derive(Clone, Debug)]
pub struct Host {
    facts: Vec<(&'static str, String)>,
    load_before: String,
}

impl Host {
    pub fn now() -> Self {
        let cpuinfo = text("/proc/cpuinfo").unwrap_or_default();
        let flags = cpuinfo.lines().find(|line| line.starts_with("flags"));
        let guest = flags.is_some_and(|flags| flags.split(' ').any(|flag| flag == "hypervisor"));
        let facts = vec![
            ("host", text("/proc/sys/kernel/hostname").unwrap_or_else(unknown)),
            ("processor", report::processor()),
            ("cores", report::cores().to_string()),
            ("virtual", if guest { "yes" } else { "no, according to the processor" }.into()),
            ("kernel", text("/proc/sys/kernel/osrelease").unwrap_or_else(unknown)),
            ("version", text("/proc/sys/kernel/version").unwrap_or_else(unknown)),
            ("preemption", preemption()),
            ("governor", governor()),
            ("isolated", text("/sys/devices/system/cpu/isolated").unwrap_or_else(|| "none".into())),
            ("clock", text("/sys/devices/system/clocksource/clocksource0/current_clocksource").unwrap_or_else(unknown)),
        ];
        Self { facts, load_before: report::load_average() }
    }

    /// Returns name and value of every fact, including the load before the run and now.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let mut rows = self.facts.clone();
        rows.push(("load_average_before", self.load_before.clone()));
        rows.push(("load_average_after", report::load_average()));
        rows
    }

    pub fn to_json(&self) -> Value {
        Value::Object(self.rows().into_iter().map(|(name, value)| (name.to_owned(), json!(value))).collect())
    }
}

fn unknown() -> String {
    "unknown".into()
}

/// Reads a file of the kernel. None if it is missing, unreadable or empty.
fn text(path: impl AsRef<Path>) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

fn preemption() -> String {
    if rt::is_preempt_rt() {
        return "PREEMPT_RT".into();
    }
    let version = text("/proc/sys/kernel/version").unwrap_or_default();
    let built = version.split(' ').find(|word| word.starts_with("PREEMPT")).unwrap_or("no preemption").to_owned();
    // The mode in parentheses is in force, for example: none voluntary (full) lazy.
    let modes = text("/sys/kernel/debug/sched/preempt").unwrap_or_default();
    match modes.split(' ').find_map(|mode| mode.strip_prefix('(')?.strip_suffix(')')) {
        Some(mode) => format!("{built}, {mode}; no PREEMPT_RT"),
        None => format!("{built}; no PREEMPT_RT"),
    }
}

fn governor() -> String {
    text("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").unwrap_or_else(|| "none (no cpufreq)".into())
}
