//! Formats the figures as text.

use crate::cli::{AttackArgs, Changes};
use crate::figures::{AttackFigures, Durations, Goals, Reasons, RunFigures};
use crate::stop_times::{StopTimes, joint_bound_s};
use checker::ViolationKind;
use judge::Attack;
use messages::TICK_HZ;
use report::Machine;
use robot::Model;
use wbc::interval::Bounds;

fn named<const N: usize>(names: [&str; N], counts: &[u64; N]) -> String {
    names.iter().zip(counts).map(|(name, count)| format!("{name} {count}")).collect::<Vec<_>>().join(", ")
}

fn joined(lines: &[String]) -> String {
    lines.join("\n") + "\n"
}

fn reason_lines<'a>(word: &'a str, Reasons(counts): &'a Reasons) -> impl Iterator<Item = String> + 'a {
    counts.iter().map(move |(reason, (count, first))| format!("  {word} for {reason}: {count}, first {first}"))
}

fn duration_text(durations: &Durations) -> String {
    let [p50, p99, p99_99] = [0.5, 0.99, 0.9999].map(|share| durations.0.quantile_us(share));
    format!("p50 {p50:.1}, p99 {p99:.1}, p99.99 {p99_99:.1}, max {:.1} us", durations.0.max_us())
}

pub fn attack_text(args: &AttackArgs, f: &RunFigures, model: &Model, machine: &Machine) -> String {
    let (name, pairs, obstacles) = (&model.name, model.pairs.len(), model.obstacles.len());
    let without = match args.changes {
        Changes { no_certificate: true, .. } => ", WITHOUT certificate and gate",
        Changes { no_torque: true, .. } => ", WITHOUT the proof of torques",
        _ => "",
    };
    let attack = format!("{name}: {} ticks at {TICK_HZ} Hz, seed {}", f.ticks, args.common.seed);
    let mut lines = vec![
        format!("{attack}, {pairs} checked pairs, {obstacles} obstacles{without}"),
        format!("violations        {}", named(ViolationKind::NAMES, &f.violations)),
    ];
    lines.extend(f.first.map(|(v, part)| {
        let (kind, k, which) = (v.kind.name(), v.k, v.which);
        format!("  first: {kind}, tick {k} of part {part}, joint or pair {which}: {} against {}", v.value, v.limit)
    }));
    let kinds = plant::ViolationKind::NAMES;
    let (ratio, true_mm) = (f.true_speed_ratio_max.0, f.true_clearance_min_m.0 * 1e3);
    lines.extend([
        format!("true motion       {}", named(kinds, &f.true_violations)),
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
    lines.push(format!("machine           {machine}, {} threads", args.common.threads));
    joined(&lines)
}

fn attack_line(attack: Attack, of: &AttackFigures) -> String {
    let (name, near) = (attack.name(), 100.0 * of.near_share());
    let AttackFigures { ticks, violations, denials, fallbacks, .. } = of;
    let [p50, p99] = [0.5, 0.99].map(|share| of.tick.0.quantile_us(share));
    format!(
        "  {name:9} {ticks:>9} ticks, {violations} violations, {denials} denials, {fallbacks:>7} fallbacks, {near:4.1} % \
         within 1 mm, p50 {p50:.1} p99 {p99:.1} us"
    )
}

pub fn stop_times_text(times: &StopTimes, bounds: &[Bounds], model: &Model) -> String {
    let mut lines = vec![format!("{:22} {:>9} {:>9}   at v, a", "joint", "worst ms", "bound ms")];
    for ((name, of), bounds) in model.joint_names.iter().zip(&times.joints).zip(bounds) {
        let (worst, bound) = (of.stop_s * 1e3, joint_bound_s(bounds) * 1e3);
        lines.push(format!("{name:22} {worst:9.3} {bound:9.3}   {:+.4}, {:+.3}", of.v, of.a));
    }
    let (states, beyond) = (times.states, times.exceeded());
    let worst = times.joints.iter().map(|joint| joint.stop_s).fold(0.0, f64::max) * 1e3;
    let bound = bounds.iter().map(joint_bound_s).fold(0.0, f64::max) * 1e3;
    let share = 100.0 * times.share_of_bound;
    lines.push(format!(
        "{states} states and the corners: longest stop {worst:.3} ms, bound {bound:.3} ms; of the bound at its own \
         velocities at most {share:.1} %; {beyond} beyond"
    ));
    joined(&lines)
}
