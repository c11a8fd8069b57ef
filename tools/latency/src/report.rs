//! Formats the report as text: ratios first, then the machine of the measurement, then every figure.

use crate::distribution::{Distribution, QUANTILES};
use crate::figures::{Figures, LOOPS};
use crate::measured::Measured;
use std::fmt::Write;

/// Formats the report.
pub fn words(all: &Measured) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = ratios(&mut out, all)
        .and_then(|()| machine(&mut out, all))
        .and_then(|()| hops(&mut out, all))
        .and_then(|()| wake_ups(&mut out, all))
        .and_then(|()| processes(&mut out, all));
    out
}

fn ratios(out: &mut String, all: &Measured) -> std::fmt::Result {
    let (name, reference) = all.reference();
    let told = |figure: Option<f64>| figure.map_or("unknown".into(), |figure| format!("{figure:.2}"));
    writeln!(out, "ratios")?;
    let mut references = vec![(name, reference)];
    if name == "cyclictest" {
        references.push(("own probe", &all.probe));
    }
    for (name, reference) in references {
        let [p50, p99] = [0.5, 0.99].map(|quantile| told(all.wake_up_ratio(reference, quantile)));
        writeln!(out, "  {:<44} p50 {p50}, p99 {p99}", format!("wake-up of retarget / {name}"))?;
    }
    for hop in ["skeleton_to_command", "target_to_command"] {
        let label = format!("{}, median: polled / events", spaced(hop));
        writeln!(out, "  {label:<44} {}", told(all.times_below_polled(hop)))?;
    }
    let beyond = |quantile| all.beyond_work_us(quantile).map_or("unknown".into(), |us| format!("{us:.1} us"));
    writeln!(out, "  {:<44} p50 {}, p99 {}", "target to command beyond control's work", beyond(0.5), beyond(0.99))
}

fn machine(out: &mut String, all: &Measured) -> std::fmt::Result {
    writeln!(out, "\nmachine")?;
    for (name, value) in all.host.rows() {
        writeln!(out, "  {:<20} {value}", name.replace('_', " "))?;
    }
    // First the properties that differ between processes, then those that retarget shares with all others.
    let own = |line: &&String| ["scheduling", "cores"].iter().any(|heading| line.starts_with(heading));
    for (name, process) in all.events.processes() {
        let lines: Vec<_> = process.realtime.iter().filter(own).cloned().collect();
        writeln!(out, "  {name:<20} {}", lines.join("; "))?;
    }
    let lines: Vec<_> = all.probe_realtime.iter().filter(own).cloned().collect();
    writeln!(out, "  {:<20} {}", "own probe", lines.join("; "))?;
    let retarget = all.events.processes().iter().find(|(name, _)| *name == "retarget");
    for line in retarget.iter().flat_map(|(_, process)| &process.realtime).filter(|line| !own(line)) {
        let (name, value) = line.split_once(": ").unwrap_or((line, ""));
        writeln!(out, "  {name:<20} {value}")?;
    }
    Ok(())
}

fn hops(out: &mut String, all: &Measured) -> std::fmt::Result {
    for (title, figures) in [("woken by events", &all.events), ("polled", &all.polled)] {
        heading(out, &format!("hops, {title}, us"))?;
        for (name, distribution) in figures.hops() {
            row(out, &spaced(name), distribution)?;
        }
        writeln!(out, "  {} of {} skeletons published were accepted", figures.accepted, figures.published)?;
    }
    Ok(())
}

fn wake_ups(out: &mut String, all: &Measured) -> std::fmt::Result {
    heading(out, "wake-up after the deadline, us")?;
    for (title, figures) in [("events", &all.events), ("polled", &all.polled)] {
        for (name, distribution) in figures.wake_ups() {
            row(out, &format!("{name}, {title}"), distribution)?;
        }
    }
    if let Some(cyclictest) = &all.cyclictest {
        row(out, "cyclictest", cyclictest)?;
    }
    row(out, "own probe", &all.probe)
}

fn heading(out: &mut String, title: &str) -> std::fmt::Result {
    writeln!(out, "\n{title:<32} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}", "p50", "p99", "p99.9", "p99.99", "max", "count")
}

fn row(out: &mut String, label: &str, distribution: &Distribution) -> std::fmt::Result {
    write!(out, "  {label:<30}")?;
    for quantile in QUANTILES {
        match distribution.quantile_us(quantile) {
            Some(us) => write!(out, " {us:>9.1}")?,
            None => write!(out, " {:>9}", "none")?,
        }
    }
    writeln!(out, " {:>9.1} {:>9}", distribution.max_us(), distribution.count())
}

fn processes(out: &mut String, all: &Measured) -> std::fmt::Result {
    for (title, figures) in [("woken by events", &all.events), ("polled", &all.polled)] {
        writeln!(out, "\nprocesses, {title}, {} blocks, {:.0} s", figures.blocks, figures.wall_s)?;
        for (i, (name, _)) in LOOPS.iter().enumerate() {
            writeln!(
                out,
                "  {name:<10} missed {} of {} deadlines",
                figures.missed[i],
                figures.missed[i] + figures.ticks[i]
            )?;
        }
        process_table(out, figures)?;
    }
    Ok(())
}

fn process_table(out: &mut String, figures: &Figures) -> std::fmt::Result {
    let [allocations, transport, major, minor] = ["allocations", "(transport)", "major", "minor faults"];
    writeln!(
        out,
        "  {:<10} {:>7} {:>10} {allocations:>12} {transport:>12} {major:>7} {minor:>13}",
        "", "CPU, %", "ready, ms"
    )?;
    for (name, one) in figures.processes() {
        writeln!(
            out,
            "  {name:<10} {:>7.1} {:>10.0} {:>12} {:>12} {:>7} {:>13}",
            100.0 * one.cpu_s / figures.wall_s,
            one.ready_after_ms,
            one.allocations,
            one.transport_allocations,
            one.major_faults,
            one.minor_faults,
        )?;
    }
    let dropped = figures.total(|process| process.ring_dropped);
    if dropped > 0 { writeln!(out, "  {dropped} samples found no room on their way out of the loops") } else { Ok(()) }
}

fn spaced(name: &str) -> String {
    name.replace('_', " ")
}
