//! Formats the report as text: ratios first, then the machine of the measurement, then every figure.

use crate::distribution::{Distribution, QUANTILES};
use crate::figures::{LOOPS, Process, VariantFigures};
use crate::measured::Measured;
use report::table::{self, column};
use std::fmt::Write;

pub fn text(all: &Measured) -> String {
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
    let ratio_text = |figure: Option<f64>| figure.map_or("unknown".into(), |figure| format!("{figure:.2}"));
    writeln!(out, "ratios")?;
    let mut references = vec![(name, reference)];
    if name == "cyclictest" {
        references.push(("own probe", &all.probe));
    }
    for (name, reference) in references {
        let [p50, p99] = [0.5, 0.99].map(|quantile| ratio_text(all.wake_up_ratio(reference, quantile)));
        writeln!(out, "  {:<44} p50 {p50}, p99 {p99}", format!("wake-up of retarget / {name}"))?;
    }
    for hop in ["skeleton_to_command", "target_to_command"] {
        let label = format!("{}, median: polled / events", spaced(hop));
        writeln!(out, "  {label:<44} {}", ratio_text(all.times_below_polled(hop)))?;
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
    for (name, process) in &all.events.processes {
        let lines: Vec<_> = process.realtime.iter().filter(own).cloned().collect();
        writeln!(out, "  {name:<20} {}", lines.join("; "))?;
    }
    let lines: Vec<_> = all.probe_realtime.iter().filter(own).cloned().collect();
    writeln!(out, "  {:<20} {}", "own probe", lines.join("; "))?;
    let retarget = all.events.processes.iter().find(|(name, _)| *name == "retarget");
    for line in retarget.iter().flat_map(|(_, process)| &process.realtime).filter(|line| !own(line)) {
        let (name, value) = line.split_once(": ").unwrap_or((line, ""));
        writeln!(out, "  {name:<20} {value}")?;
    }
    Ok(())
}

fn hops(out: &mut String, all: &Measured) -> std::fmt::Result {
    for (title, figures) in [("woken by events", &all.events), ("polled", &all.polled)] {
        let rows: Vec<_> = figures.hops().map(|(name, distribution)| (spaced(name), distribution)).collect();
        distributions(out, &format!("hops, {title}, us"), &rows)?;
        writeln!(out, "  {} of {} skeletons published were accepted", figures.accepted, figures.published)?;
    }
    Ok(())
}

fn wake_ups(out: &mut String, all: &Measured) -> std::fmt::Result {
    let mut rows: Vec<(String, &Distribution)> = Vec::new();
    for (title, figures) in [("events", &all.events), ("polled", &all.polled)] {
        rows.extend(figures.wake_ups().map(|(name, distribution)| (format!("{name}, {title}"), distribution)));
    }
    rows.extend(all.cyclictest.as_ref().map(|distribution| ("cyclictest".to_owned(), distribution)));
    rows.push(("own probe".to_owned(), &all.probe));
    distributions(out, "wake-up after the deadline, us", &rows)
}

fn distributions(out: &mut String, title: &str, rows: &[(String, &Distribution)]) -> std::fmt::Result {
    let quantile_us = |quantile| {
        move |distribution: &&Distribution| {
            distribution.quantile_us(quantile).map_or("none".into(), |us| format!("{us:.1}"))
        }
    };
    let mut columns: Vec<_> = ["p50", "p99", "p99.9", "p99.99"]
        .into_iter()
        .zip(QUANTILES)
        .map(|(head, quantile)| column(["", head], 9, quantile_us(quantile)))
        .collect();
    columns.push(column(["", "max"], 9, |distribution: &&Distribution| format!("{:.1}", distribution.max_us())));
    columns.push(column(["", "count"], 9, |distribution: &&Distribution| distribution.count().to_string()));
    let names: Vec<String> = rows.iter().map(|(name, _)| format!("  {name}")).collect();
    out.push('\n');
    table::write(out, (title, 32), &columns, names.iter().map(String::as_str).zip(rows.iter().map(|(_, row)| row)))
}

fn processes(out: &mut String, all: &Measured) -> std::fmt::Result {
    for (title, figures) in [("woken by events", &all.events), ("polled", &all.polled)] {
        writeln!(out, "\nprocesses, {title}, {} blocks, {:.0} s", figures.blocks, figures.wall_s)?;
        for (i, (name, _)) in LOOPS.iter().enumerate() {
            let missed = figures.missed[i];
            writeln!(out, "  {name:<10} missed {missed} of {} deadlines", missed + figures.ticks[i])?;
        }
        process_table(out, figures)?;
    }
    Ok(())
}

fn process_table(out: &mut String, figures: &VariantFigures) -> std::fmt::Result {
    let count = |head, width, count: fn(&Process) -> u64| {
        column(["", head], width, move |process: &Process| count(process).to_string())
    };
    let wall_s = figures.wall_s;
    let columns = [
        column(["", "CPU, %"], 7, move |process: &Process| format!("{:.1}", 100.0 * process.cpu_s / wall_s)),
        column(["", "ready, ms"], 10, |process: &Process| format!("{:.0}", process.ready_after_ms)),
        count("allocations", 12, |process| process.allocations.r#loop),
        count("(transport)", 12, |process| process.allocations.transport),
        count("major", 7, |process| process.major_faults),
        count("minor faults", 13, |process| process.loop_minor_faults),
    ];
    let names: Vec<String> = figures.processes.iter().map(|(name, _)| format!("  {name}")).collect();
    let rows = names.iter().map(String::as_str).zip(figures.processes.iter().map(|(_, process)| process));
    table::write(out, ("", 12), &columns, rows)?;
    let dropped = figures.total(|process| process.ring_dropped);
    if dropped > 0 { writeln!(out, "  {dropped} samples found no room on their way out of the loops") } else { Ok(()) }
}

fn spaced(name: &str) -> String {
    name.replace('_', " ")
}
