//! Formats the figures as text and as JSON.

use crate::bench::Bench;
use crate::cli::AttackArgs;
use crate::error::TortureError;
use crate::figures::{Figures, KINDS, TRUE_KINDS};
use crate::goals::Goals;
use crate::machine::Machine;
use crate::motions::Played;
use crate::stop_times::{StopTimes, joint_bound_s};
use judge::Attack;
use messages::{JOINTS, TICK_HZ};
use robot::Model;
use rt::Histogram;
use serde_json::{Map, Value, json};
use sim::ViolationKind;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use wbc::interval::Bounds;

fn by_kind(counts: &[u64; KINDS]) -> Value {
    Value::Object(ViolationKind::ALL.iter().map(|&k| (k.name().to_owned(), json!(counts[k as usize]))).collect())
}

fn by_reason(counts: &BTreeMap<String, (u64, String)>) -> Value {
    let row = |(reason, (count, first)): (&String, &(u64, String))| {
        (reason.clone(), json!({ "count": count, "first": first }))
    };
    Value::Object(counts.iter().map(row).collect())
}

fn true_by_kind(counts: &[u64; TRUE_KINDS]) -> Value {
    let row = |kind: plant::ViolationKind| (kind.name().to_owned(), json!(counts[kind as usize]));
    Value::Object(plant::ViolationKind::ALL.into_iter().map(row).collect())
}

fn true_in_words(f: &Figures) -> String {
    let kinds = plant::ViolationKind::ALL.map(|kind| format!("{} {}", kind.name(), f.true_violations[kind as usize]));
    let first = f.first_true.map_or_else(String::new, |(v, part)| {
        format!("\n  first: {}, part {part}, joint or pair {}: {} against {}", v.kind.name(), v.which, v.value, v.bound)
    });
    let (ratio, clearance_mm) = (f.true_speed_ratio_max, f.true_clearance_min_m * 1e3);
    format!(
        "true motion       {}\n  speed at most {ratio:.3} of its limit, clearance at least {clearance_mm:.2} mm{first}",
        kinds.join(", ")
    )
}

fn durations(of: &Histogram) -> Value {
    let q = |share| of.quantile_us(share);
    json!({ "p50": q(0.5), "p99": q(0.99), "p99_99": q(0.9999), "max": of.max_us() })
}

fn in_words(of: &Histogram) -> String {
    let [p50, p99, p99_99] = [0.5, 0.99, 0.9999].map(|share| of.quantile_us(share));
    format!("p50 {p50:.1}, p99 {p99:.1}, p99.99 {p99_99:.1}, max {:.1} us", of.max_us())
}

/// Formats an attack as JSON.
pub fn attack_json(args: &AttackArgs, figures: &Figures, goals: &Goals, model: &Model, machine: &Machine) -> Value {
    let attacks: Map<String, Value> = Attack::ALL
        .iter()
        .map(|&attack| {
            let of = &figures.attacks[attack as usize];
            let near = of.near as f64 / of.ticks.max(1) as f64;
            let value = json!({
                "ticks": of.ticks,
                "violations": of.violations,
                "denials": of.denials,
                "fallbacks": of.fallbacks,
                "share_within_1_mm": near,
                "tick_us": durations(&of.tick),
            });
            (attack.name().to_owned(), value)
        })
        .collect();
    let first = figures.first.map(|place| {
        let v = place.violation;
        json!({ "kind": v.kind.name(), "k": v.k, "which": v.which, "value": v.value, "limit": v.limit,
                "part": place.part, "seed_of_part": place.seed })
    });
    json!({
        "robot": model.name,
        "seed": args.seed,
        "rate_hz": TICK_HZ,
        "pairs": model.pairs.len(),
        "obstacles": model.obstacles.len(),
        "certificate": !args.no_certificate,
        "torque": !args.no_torque,
        "gate": !args.no_certificate || args.keep_gate,
        "ticks": figures.ticks,
        "violations": by_kind(&figures.violations),
        "first_violation": first,
        "true_violations": true_by_kind(&figures.true_violations),
        "first_true_violation": figures.first_true.map(|(v, part)| json!({ "kind": v.kind.name(), "which": v.which,
            "value": v.value, "bound": v.bound, "part": part })),
        "true_speed_ratio_max": figures.true_speed_ratio_max,
        "true_clearance_min_mm": figures.true_clearance_min_m * 1e3,
        "min_clearance_mm": figures.min_clearance_m * 1e3,
        "clearance_required_mm": model.d_min_m * 1e3,
        "min_unproved_clearance_mm": figures.min_unproved_clearance_m * 1e3,
        "tick_us": durations(&figures.tick),
        "fallbacks": figures.fallbacks,
        "fallbacks_for_torque": figures.overloads, "torque_share_max": figures.torque_share_max,
        "torque_share_max_of_plans": figures.rollout_torque_share,
        "denials": figures.denials,
        "denied_for": by_reason(&figures.denied_for),
        "goals": goals.goals,
        "goals_reached": goals.share(),
        "returned_home": if goals.goals == 0 { 1.0 } else { goals.returned as f64 / goals.goals as f64 },
        "worst_stop_ms": figures.worst_stop_s * 1e3,
        "stops_watched": figures.stops,
        "worst_watched_stop_ms": figures.worst_watched_stop_s * 1e3,
        "stops_beyond_bound": figures.late_stops,
        "stops_beyond_b_of_v": figures.gentle_stops,
        "rollouts": figures.rollouts,
        "rollout_violations": by_kind(&figures.rollout_violations),
        "commands_refused": figures.refusals,
        "refused_for": by_reason(&figures.refused_for),
        "missed_ticks": figures.missed, "lost_commands": figures.lost,
        "overslept_ticks": figures.overslept,
        "driver_latched": figures.latches, "reseeds": figures.reseeds, "recoveries": figures.recoveries,
        "travelled_rad": figures.travelled_rad,
        "attacks": attacks,
        "threads": args.threads,
        "machine": machine.to_json(),
    })
}

/// Formats an attack as text.
pub fn attack_words(args: &AttackArgs, figures: &Figures, goals: &Goals, model: &Model, machine: &Machine) -> String {
    let f = figures;
    let mut out = attacked(args, f, model);
    let kinds = ViolationKind::ALL.map(|kind| format!("{} {}", kind.name(), f.violations_of(kind)));
    let _ = writeln!(out, "violations        {}", kinds.join(", "));
    if let Some(place) = f.first {
        let v = place.violation;
        let (kind, part) = (v.kind.name(), place.part);
        let _ = writeln!(
            out,
            "  first: {kind}, tick {} of part {part}, joint or pair {}: {} against {}",
            v.k, v.which, v.value, v.limit
        );
    }
    let _ = writeln!(out, "{}", true_in_words(f));
    let _ = writeln!(
        out,
        "least clearance   {:.4} mm (at least {:.1} mm is required); {:.4} mm with stops of the driver's own, which are not proved",
        f.min_clearance_m * 1e3,
        model.d_min_m * 1e3,
        f.min_unproved_clearance_m * 1e3
    );
    let _ = writeln!(out, "control tick      {}", in_words(&f.tick));
    let _ = writeln!(
        out,
        "largest torque    {:.3} of the effort limit executed, {:.3} in plans",
        f.torque_share_max, f.rollout_torque_share
    );
    let (all, torque, denied) = (f.fallbacks, f.overloads, f.denials);
    let _ = writeln!(out, "fallbacks         {all}, of them for torque {torque}, denied by the gate {denied}");
    for (reason, (count, first)) in &f.denied_for {
        let _ = writeln!(out, "  denied for {reason}: {count}, first {first}");
    }
    let _ = writeln!(
        out,
        "stops             longest plan {:.1} ms; {} watched to rest, longest {:.1} ms, {} gentler than B(v), {} \
         beyond their bound",
        f.worst_stop_s * 1e3,
        f.stops,
        f.worst_watched_stop_s * 1e3,
        f.gentle_stops,
        f.late_stops
    );
    let rollouts: u64 = f.rollout_violations.iter().sum();
    let _ = writeln!(out, "plans rolled out  {}, violations in them {rollouts}", f.rollouts);
    let _ = writeln!(
        out,
        "disturbed         {} ticks missed, {} commands lost, {} ticks overslept by the driver, {} latches, {} reseeds, {} recoveries, {} refused",
        f.missed, f.lost, f.overslept, f.latches, f.reseeds, f.recoveries, f.refusals
    );
    for (reason, (count, first)) in &f.refused_for {
        let _ = writeln!(out, "  refused for {reason}: {count}, first {first}");
    }
    let _ = writeln!(out, "travelled         {:.0} rad", f.travelled_rad);
    out += &by_attack(f);
    if goals.goals > 0 {
        let Goals { goals, reached, returned } = goals;
        let _ = writeln!(out, "goals             {reached} of {goals} reached within 8 s, {returned} times back home");
    }
    let _ = writeln!(out, "machine           {machine}, {} threads", args.threads);
    out
}

/// Describes the attack.
fn attacked(args: &AttackArgs, f: &Figures, model: &Model) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "{}: {} ticks at {TICK_HZ} Hz, seed {}, {} checked pairs, {} obstacles{}",
        model.name,
        f.ticks,
        args.seed,
        model.pairs.len(),
        model.obstacles.len(),
        match (args.no_certificate, args.keep_gate, args.no_torque) {
            (false, _, false) => "",
            (false, _, true) => ", WITHOUT the proof of torques",
            (true, false, _) => ", WITHOUT certificate and gate",
            (true, true, _) => ", WITHOUT certificate, with the gate",
        }
    );
    out
}

fn by_attack(f: &Figures) -> String {
    let mut out = String::new();
    for attack in Attack::ALL {
        let of = &f.attacks[attack as usize];
        let near = 100.0 * of.near as f64 / of.ticks.max(1) as f64;
        let _ = writeln!(
            out,
            "  {:9} {:>9} ticks, {} violations, {} denials, {:>7} fallbacks, {near:4.1} % within 1 mm, p50 {:.1} p99 {:.1} us",
            attack.name(),
            of.ticks,
            of.violations,
            of.denials,
            of.fallbacks,
            of.tick.quantile_us(0.5),
            of.tick.quantile_us(0.99)
        );
    }
    out
}

/// Formats stop times as JSON.
pub fn stop_times_json(times: &StopTimes, bounds: &[Bounds; JOINTS], model: &Model, seed: u64) -> Value {
    let joints: Map<String, Value> = (0..JOINTS)
        .map(|j| {
            let of = &times.joints[j];
            let value = json!({
                "worst_ms": of.stop_s * 1e3,
                "bound_ms": joint_bound_s(&bounds[j]) * 1e3,
                "at_v": of.v,
                "at_a": of.a,
                "share_of_bound_at_v": of.share_of_bound_at,
                "exceeded": of.exceeded,
            });
            (model.joint_names[j].clone(), value)
        })
        .collect();
    json!({
        "robot": model.name,
        "seed": seed,
        "states": times.states,
        "worst_stop_ms": times.worst_s() * 1e3,
        "bound_ms": bounds.iter().map(joint_bound_s).fold(0.0, f64::max) * 1e3,
        "share_of_bound_at_v": times.share_of_bound,
        "exceeded": times.exceeded(),
        "joints": joints,
    })
}

/// Formats stop times as text.
pub fn stop_times_words(times: &StopTimes, bounds: &[Bounds; JOINTS], model: &Model) -> String {
    let mut out = format!("{:22} {:>9} {:>9}   at v, a\n", "joint", "worst ms", "bound ms");
    for j in 0..JOINTS {
        let of = &times.joints[j];
        let (name, worst, bound) = (&model.joint_names[j], of.stop_s * 1e3, joint_bound_s(&bounds[j]) * 1e3);
        let _ = writeln!(out, "{name:22} {worst:9.3} {bound:9.3}   {:+.4}, {:+.3}", of.v, of.a);
    }
    let worst = times.worst_s() * 1e3;
    let bound = bounds.iter().map(joint_bound_s).fold(0.0, f64::max) * 1e3;
    let _ = writeln!(
        out,
        "{} states and the corners: longest stop {worst:.3} ms, bound {bound:.3} ms; of the bound at its own velocities at most {:.1} %; {} beyond",
        times.states,
        100.0 * times.share_of_bound,
        times.exceeded()
    );
    out
}

/// Formats motions as JSON.
pub fn motions_json(played: &[Played], machine: &Machine) -> Value {
    let files: Vec<Value> = played
        .iter()
        .map(|one| {
            json!({
                "file": one.file.display().to_string(),
                "duration_s": one.duration_s,
                "violations": one.violations,
                "min_clearance_mm": one.min_clearance_mm,
                "limb_error_deg": one.limb_error_deg,
                "limb_error_robot_deg": one.limb_error_robot_deg,
                "torque_share_max": one.torque_share_max,
                "fallbacks_per_tick": one.fallbacks_per_tick,
                "holds": one.holds,
                "failed": one.failed,
            })
        })
        .collect();
    json!({
        "files": files.len(),
        "violations": played.iter().map(Played::violations_total).sum::<u64>(),
        "failed": played.iter().filter(|one| one.failed.is_some()).count(),
        "runs": files,
        "machine": machine.to_json(),
    })
}

/// Formats motions as a table.
pub fn motions_words(played: &[Played]) -> String {
    let mut out = format!(
        "{:24} {:>8} {:>11} {:>13} {:>9} {:>9} {:>7} {:>10} {:>5}\n",
        "file", "time s", "violations", "clearance mm", "limbs deg", "robot deg", "torque", "refusals %", "holds"
    );
    for one in played {
        let name = one.file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        let _ = writeln!(
            out,
            "{name:24} {:8.1} {:11} {:13.2} {:9.2} {:9.2} {:7.3} {:10.3} {:5}  {}",
            one.duration_s,
            one.violations_total(),
            one.min_clearance_mm,
            one.limb_error_deg,
            one.limb_error_robot_deg,
            one.torque_share_max,
            one.fallbacks_per_tick * 100.0,
            one.holds,
            one.failed.as_deref().unwrap_or("")
        );
    }
    let violations: u64 = played.iter().map(Played::violations_total).sum();
    let failed = played.iter().filter(|one| one.failed.is_some()).count();
    let least = played.iter().map(|one| one.min_clearance_mm).fold(f64::INFINITY, f64::min);
    let time_s: f64 = played.iter().map(|one| one.duration_s).sum();
    let _ = writeln!(
        out,
        "{} files, {time_s:.0} s: {violations} violations, least clearance {least:.2} mm, {failed} failed",
        played.len()
    );
    out
}

/// Formats a bench as JSON.
pub fn bench_json(bench: &Bench, ticks: u64, model: &Model, machine: &Machine) -> Value {
    json!({
        "robot": model.name,
        "ticks": ticks,
        "pairs": model.pairs.len(),
        "smooth_us": durations(&bench.smooth),
        "jumps_us": durations(&bench.jumps),
        "machine": machine.to_json(),
    })
}

/// Formats a bench as text.
pub fn bench_words(bench: &Bench, ticks: u64, model: &Model, machine: &Machine) -> String {
    format!(
        "control tick (whole-body control and gate), {} checked pairs, {ticks} ticks each\nsmooth, in the open   {}\njumping targets       {}\n{machine}\n",
        model.pairs.len(),
        in_words(&bench.smooth),
        in_words(&bench.jumps)
    )
}

/// Prints the text, and writes the JSON if a path is given.
///
/// # Errors
/// Returns an error that names the file that cannot be written.
pub fn put(words: &str, value: &Value, json: Option<&Path>) -> Result<(), TortureError> {
    use std::io::Write;
    // The output may be closed. The exit code still reports the result.
    match json {
        Some(path) if path.as_os_str() == "-" => {
            let _ = std::io::stderr().write_all(words.as_bytes());
            let _ = writeln!(std::io::stdout(), "{value:#}");
        }
        Some(path) => {
            let _ = std::io::stdout().write_all(words.as_bytes());
            std::fs::write(path, format!("{value:#}\n"))
                .map_err(|cause| TortureError::Write { file: path.to_path_buf(), cause })?;
        }
        None => {
            let _ = std::io::stdout().write_all(words.as_bytes());
        }
    }
    Ok(())
}
