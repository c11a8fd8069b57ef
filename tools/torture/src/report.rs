//! Formats the figures as text and as JSON.

use crate::bench::Bench;
use crate::cli::AttackArgs;
use crate::figures::{AttackFigures, Durations, Goals, KINDS, Place, Reasons, RunFigures, TRUE_KINDS};
use crate::motions::Played;
use crate::stop_times::{JointWorst, StopTimes, joint_bound_s};
use checker::ViolationKind;
use judge::Attack;
use messages::TICK_HZ;
use report::Machine;
use report::table::{self, column, number};
use robot::Model;
use serde_json::{Map, Value, json};
use wbc::interval::Bounds;

/// Counts with their names.
type Named<const N: usize> = [(&'static str, u64); N];

fn commanded(counts: &[u64; KINDS]) -> Named<KINDS> {
    ViolationKind::ALL.map(|kind| (kind.name(), counts[kind as usize]))
}

fn true_motion(counts: &[u64; TRUE_KINDS]) -> Named<TRUE_KINDS> {
    plant::ViolationKind::ALL.map(|kind| (kind.name(), counts[kind as usize]))
}

fn named_json<const N: usize>(named: Named<N>) -> Value {
    Value::Object(named.into_iter().map(|(name, count)| (name.to_owned(), json!(count))).collect())
}

fn named_text<const N: usize>(named: Named<N>) -> String {
    named.map(|(name, count)| format!("{name} {count}")).join(", ")
}

fn by_reason(Reasons(counts): &Reasons) -> Value {
    let row = |(reason, (count, first)): (&String, &(u64, String))| {
        (reason.clone(), json!({ "count": count, "first": first }))
    };
    Value::Object(counts.iter().map(row).collect())
}

/// Joins lines to a text.
fn joined(lines: &[String]) -> String {
    lines.join("\n") + "\n"
}

fn reason_lines<'a>(word: &'a str, Reasons(counts): &'a Reasons) -> impl Iterator<Item = String> + 'a {
    counts.iter().map(move |(reason, (count, first))| format!("  {word} for {reason}: {count}, first {first}"))
}

fn durations_json<const DIGITS: u8>(durations: &Durations<DIGITS>) -> Value {
    let q = |share| durations.quantile_us(share);
    json!({ "p50": q(0.5), "p99": q(0.99), "p99_99": q(0.9999), "max": durations.max_us() })
}

fn duration_text(durations: &Durations) -> String {
    let [p50, p99, p99_99] = [0.5, 0.99, 0.9999].map(|share| durations.quantile_us(share));
    format!("p50 {p50:.1}, p99 {p99:.1}, p99.99 {p99_99:.1}, max {:.1} us", durations.max_us())
}

/// Formats an attack as JSON.
pub fn attack_json(args: &AttackArgs, figures: &RunFigures, model: &Model, machine: &Machine) -> Value {
    let goals = &figures.goals;
    let attacks: Map<String, Value> = Attack::ALL
        .iter()
        .map(|&attack| {
            let of = &figures.attacks[attack as usize];
            let value = json!({
                "ticks": of.ticks,
                "violations": of.violations,
                "denials": of.denials,
                "fallbacks": of.fallbacks,
                "share_within_1_mm": of.near_share(),
                "tick_us": durations_json(&of.tick),
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
        "certificate": !args.changes.no_certificate,
        "torque": !args.changes.no_torque,
        "gate": !args.changes.no_certificate || args.changes.keep_gate,
        "ticks": figures.ticks,
        "violations": named_json(commanded(&figures.violations)),
        "first_violation": first,
        "true_violations": named_json(true_motion(&figures.true_violations)),
        "first_true_violation": figures.first_true.map(|(v, part)| json!({ "kind": v.kind.name(), "which": v.which,
            "value": v.value, "bound": v.bound, "part": part })),
        "true_speed_ratio_max": figures.true_speed_ratio_max.0,
        "true_clearance_min_mm": figures.true_clearance_min_m.0 * 1e3,
        "min_clearance_mm": figures.min_clearance_m.0 * 1e3,
        "clearance_required_mm": model.d_min_m * 1e3,
        "min_unproved_clearance_mm": figures.min_unproved_clearance_m.0 * 1e3,
        "tick_us": durations_json(&figures.tick),
        "fallbacks": figures.fallbacks,
        "fallbacks_for_torque": figures.overloads, "torque_share_max": figures.torque_share_max.0,
        "torque_share_max_of_plans": figures.rollout_torque_share.0,
        "denials": figures.denials,
        "denied_for": by_reason(&figures.denied_for),
        "goals": goals.goals,
        "goals_reached": goals.share(goals.reached),
        "returned_home": goals.share(goals.returned),
        "worst_stop_ms": figures.worst_stop_s.0 * 1e3,
        "stops_watched": figures.stops,
        "worst_watched_stop_ms": figures.worst_watched_stop_s.0 * 1e3,
        "stops_beyond_bound": figures.late_stops,
        "stops_beyond_b_of_v": figures.gentle_stops,
        "rollouts": figures.rollouts,
        "rollout_violations": named_json(commanded(&figures.rollout_violations)),
        "commands_refused": figures.refusals,
        "refused_for": by_reason(&figures.refused_for),
        "missed_ticks": figures.missed, "lost_commands": figures.lost,
        "overslept_ticks": figures.overslept,
        "driver_latched": figures.latches, "reseeds": figures.reseeds, "recoveries": figures.recoveries,
        "travelled_rad": figures.travelled_rad,
        "attacks": attacks,
        "threads": args.threads,
        "machine": machine,
    })
}

/// Formats an attack as text.
pub fn attack_text(args: &AttackArgs, f: &RunFigures, model: &Model, machine: &Machine) -> String {
    let (name, pairs, obstacles) = (&model.name, model.pairs.len(), model.obstacles.len());
    let without = match (args.changes.no_certificate, args.changes.keep_gate, args.changes.no_torque) {
        (false, _, false) => "",
        (false, _, true) => ", WITHOUT the proof of torques",
        (true, false, _) => ", WITHOUT certificate and gate",
        (true, true, _) => ", WITHOUT certificate, with the gate",
    };
    let attack = format!("{name}: {} ticks at {TICK_HZ} Hz, seed {}", f.ticks, args.seed);
    let mut lines = vec![
        format!("{attack}, {pairs} checked pairs, {obstacles} obstacles{without}"),
        format!("violations        {}", named_text(commanded(&f.violations))),
    ];
    lines.extend(f.first.map(|Place { violation: v, part, .. }| {
        let (kind, k, which) = (v.kind.name(), v.k, v.which);
        format!("  first: {kind}, tick {k} of part {part}, joint or pair {which}: {} against {}", v.value, v.limit)
    }));
    let (ratio, true_mm) = (f.true_speed_ratio_max.0, f.true_clearance_min_m.0 * 1e3);
    lines.extend([
        format!("true motion       {}", named_text(true_motion(&f.true_violations))),
        format!("  speed at most {ratio:.3} of its limit, clearance at least {true_mm:.2} mm"),
    ]);
    lines.extend(f.first_true.map(|(v, part)| {
        let (kind, which) = (v.kind.name(), v.which);
        format!("  first: {kind}, part {part}, joint or pair {which}: {} against {}", v.value, v.bound)
    }));
    let [least, required, unproved] =
        [f.min_clearance_m.0, model.d_min_m, f.min_unproved_clearance_m.0].map(|m| m * 1e3);
    let (executed, planned) = (f.torque_share_max.0, f.rollout_torque_share.0);
    let RunFigures { fallbacks, overloads, denials, .. } = f;
    lines.extend([
        format!(
            "least clearance   {least:.4} mm (at least {required:.1} mm is required); {unproved:.4} mm with stops of the \
             driver's own, which are not proved"
        ),
        format!("control tick      {}", duration_text(&f.tick)),
        format!("largest torque    {executed:.3} of the effort limit executed, {planned:.3} in plans"),
        format!("fallbacks         {fallbacks}, of them for torque {overloads}, denied by the gate {denials}"),
    ]);
    lines.extend(reason_lines("denied", &f.denied_for));
    let [plan_ms, watched_ms] = [f.worst_stop_s.0, f.worst_watched_stop_s.0].map(|s| s * 1e3);
    let RunFigures { stops, gentle_stops, late_stops, rollouts, .. } = f;
    let broken: u64 = f.rollout_violations.iter().sum();
    let RunFigures { missed, lost, overslept, latches, reseeds, recoveries, refusals, .. } = f;
    lines.extend([
        format!(
            "stops             longest plan {plan_ms:.1} ms; {stops} watched to rest, longest {watched_ms:.1} ms, \
             {gentle_stops} gentler than B(v), {late_stops} beyond their bound"
        ),
        format!("plans rolled out  {rollouts}, violations in them {broken}"),
        format!(
            "disturbed         {missed} ticks missed, {lost} commands lost, {overslept} ticks overslept by the driver, \
             {latches} latches, {reseeds} reseeds, {recoveries} recoveries, {refusals} refused"
        ),
    ]);
    lines.extend(reason_lines("refused", &f.refused_for));
    lines.push(format!("travelled         {:.0} rad", f.travelled_rad));
    lines.extend(Attack::ALL.map(|attack| attack_line(attack, &f.attacks[attack as usize])));
    let Goals { goals, reached, returned } = f.goals;
    if goals > 0 {
        lines.push(format!("goals             {reached} of {goals} reached within 8 s, {returned} times back home"));
    }
    lines.push(format!("machine           {machine}, {} threads", args.threads));
    joined(&lines)
}

fn attack_line(attack: Attack, of: &AttackFigures) -> String {
    let (name, near) = (attack.name(), 100.0 * of.near_share());
    let AttackFigures { ticks, violations, denials, fallbacks, .. } = of;
    let [p50, p99] = [0.5, 0.99].map(|share| of.tick.quantile_us(share));
    format!(
        "  {name:9} {ticks:>9} ticks, {violations} violations, {denials} denials, {fallbacks:>7} fallbacks, {near:4.1} % \
         within 1 mm, p50 {p50:.1} p99 {p99:.1} us"
    )
}

/// Formats stop times as JSON.
pub fn stop_times_json(times: &StopTimes, bounds: &[Bounds], model: &Model, seed: u64) -> Value {
    let row = |((name, of), bounds): ((&String, &JointWorst), &Bounds)| {
        let value = json!({
            "worst_ms": of.stop_s * 1e3,
            "bound_ms": joint_bound_s(bounds) * 1e3,
            "at_v": of.v,
            "at_a": of.a,
            "share_of_bound_at_v": of.share_of_bound_at,
            "exceeded": of.exceeded,
        });
        (name.clone(), value)
    };
    let joints: Map<String, Value> = model.joint_names.iter().zip(&times.joints).zip(bounds).map(row).collect();
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
pub fn stop_times_text(times: &StopTimes, bounds: &[Bounds], model: &Model) -> String {
    let mut lines = vec![format!("{:22} {:>9} {:>9}   at v, a", "joint", "worst ms", "bound ms")];
    for ((name, of), bounds) in model.joint_names.iter().zip(&times.joints).zip(bounds) {
        let (worst, bound) = (of.stop_s * 1e3, joint_bound_s(bounds) * 1e3);
        lines.push(format!("{name:22} {worst:9.3} {bound:9.3}   {:+.4}, {:+.3}", of.v, of.a));
    }
    let (states, worst, beyond) = (times.states, times.worst_s() * 1e3, times.exceeded());
    let bound = bounds.iter().map(joint_bound_s).fold(0.0, f64::max) * 1e3;
    let share = 100.0 * times.share_of_bound;
    lines.push(format!(
        "{states} states and the corners: longest stop {worst:.3} ms, bound {bound:.3} ms; of the bound at its own \
         velocities at most {share:.1} %; {beyond} beyond"
    ));
    joined(&lines)
}

/// Formats motions as JSON.
pub fn motions_json(played: &[Played], machine: &Machine) -> Value {
    let files: Vec<Value> = played
        .iter()
        .map(|one| {
            json!({
                "file": one.file.display().to_string(),
                "duration_s": one.duration_s(),
                "violations": one.report.violations,
                "min_clearance_mm": one.report.min_clearance_mm,
                "limb_error_deg": one.report.limb_error_deg_mean,
                "limb_error_robot_deg": one.report.limb_error_measured_deg_mean,
                "torque_share_max": one.report.torque_share_max,
                "fallbacks_per_tick": one.fallbacks_per_tick(),
                "holds": one.holds(),
                "failed": one.failed,
            })
        })
        .collect();
    json!({
        "files": files.len(),
        "violations": played.iter().map(Played::violations_total).sum::<u64>(),
        "failed": played.iter().filter(|one| one.failed.is_some()).count(),
        "runs": files,
        "machine": machine,
    })
}

/// Formats motions as a table.
pub fn motions_text(played: &[Played]) -> String {
    let figure = |head, width, digits, figure: fn(&Played) -> f64| {
        column(["", head], width, move |one: &Played| number(figure(one), digits))
    };
    let columns = [
        figure("time s", 8, 1, Played::duration_s),
        column(["", "violations"], 11, |one: &Played| one.violations_total().to_string()),
        figure("clearance mm", 13, 2, |one| one.report.min_clearance_mm),
        figure("limbs deg", 9, 2, |one| one.report.limb_error_deg_mean),
        figure("robot deg", 9, 2, |one| one.report.limb_error_measured_deg_mean),
        figure("torque", 7, 3, |one| one.report.torque_share_max),
        figure("refusals %", 10, 3, |one| one.fallbacks_per_tick() * 100.0),
        column(["", "holds"], 5, |one: &Played| one.holds().to_string()),
        column(["", ""], 0, |one: &Played| format!(" {}", one.failed.as_deref().unwrap_or(""))),
    ];
    let names = played.iter().map(|one| one.file.file_name().unwrap_or_default().to_string_lossy());
    let names: Vec<_> = names.collect();
    let mut out = String::new();
    let rows = names.iter().map(|name| &**name).zip(played);
    // Writing to a String cannot fail.
    let _ = table::write(&mut out, ("file", 24), &columns, rows);
    let violations: u64 = played.iter().map(Played::violations_total).sum();
    let failed = played.iter().filter(|one| one.failed.is_some()).count();
    let least = played.iter().map(|one| one.report.min_clearance_mm).fold(f64::INFINITY, f64::min);
    let (files, time_s) = (played.len(), played.iter().map(Played::duration_s).sum::<f64>());
    let least = format!("least clearance {least:.2} mm");
    out + &format!("{files} files, {time_s:.0} s: {violations} violations, {least}, {failed} failed\n")
}

/// Formats a bench as JSON.
pub fn bench_json(bench: &Bench, ticks: u64, model: &Model, machine: &Machine) -> Value {
    json!({
        "robot": model.name,
        "ticks": ticks,
        "pairs": model.pairs.len(),
        "smooth_us": durations_json(&bench.smooth),
        "jumps_us": durations_json(&bench.jumps),
        "machine": machine,
    })
}

/// Formats a bench as text.
pub fn bench_text(bench: &Bench, ticks: u64, model: &Model, machine: &Machine) -> String {
    format!(
        "control tick (whole-body control and gate), {} checked pairs, {ticks} ticks each\nsmooth, in the open   {}\njumping targets       {}\n{machine}\n",
        model.pairs.len(),
        duration_text(&bench.smooth),
        duration_text(&bench.jumps)
    )
}
