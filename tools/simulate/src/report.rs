//! Formats the figures as text.

use crate::campaign::{Failure, Plan, Summary};
use crate::cli::CONFIG;
use crate::kinds::KINDS;
use crate::run::Outcome;
use crate::schedule::to_text;
use messages::{Mode, TICK_HZ};
use std::fmt::Write as _;
use std::path::Path;

fn share(ticks_in: &[u64; Mode::ALL.len()], modes: &[Mode]) -> f64 {
    let ticks = modes.iter().map(|&mode| ticks_in[mode as usize]).sum::<u64>();
    ticks as f64 / ticks_in.iter().sum::<u64>().max(1) as f64
}

/// Formats a campaign as text. `config` is the settings file, as the user gave it.
pub fn text(plan: &Plan, sum: &Summary, config: &Path, wall_s: f64) -> String {
    let mut out = String::new();
    for failure in &sum.failures {
        let _ = writeln!(out, "{}", failure_text(failure, plan, config));
    }
    let us = wall_s * 1e6 * plan.jobs as f64 / sum.ticks.max(1) as f64;
    let _ = writeln!(
        out,
        "{} runs, {} ticks, {} episodes, {:.1} s, {us:.1} us a tick and thread",
        sum.seeds, sum.ticks, sum.episodes, wall_s
    );
    let moving = share(&sum.ticks_in, &[Mode::Engaging, Mode::Engaged, Mode::Recovering]);
    let engaged = share(&sum.ticks_in, &[Mode::Engaged]);
    let _ = writeln!(
        out,
        "control permitted motion in {:.1} % of its ticks, {:.1} % engaged; {} transitions; back within {:.2} s",
        100.0 * moving,
        100.0 * engaged,
        sum.transitions,
        sum.back_after_max as f64 / TICK_HZ as f64
    );
    if engaged == 0.0 {
        out += "the robot was never engaged, so this shows little: every other seed begins engaged, so give --seeds 2 or more\n";
    }
    let least = (0..KINDS.len()).filter(|kind| plan.kinds.contains(kind)).min_by_key(|&kind| sum.fired[kind]);
    if let Some(least) = least {
        let _ = writeln!(
            out,
            "the rarest fault, {1}, fired {0} times; a run of this length requires {2} of each",
            sum.fired[least], KINDS[least].name, sum.demanded
        );
    }
    for &kind in &sum.missing {
        let _ = writeln!(out, "{} fired only {} times, required {}", KINDS[kind].name, sum.fired[kind], sum.demanded);
    }
    let _ = writeln!(out, "{} violations, hash {:016x}", sum.failures.len(), sum.hash);
    out
}

fn failure_text(failure: &Failure, plan: &Plan, config: &Path) -> String {
    let v = &failure.violation;
    let schedule = if failure.shrunk { "smallest schedule" } else { "schedule" };
    // A seed reproduces a run only with the same settings.
    let settings = match config {
        config if config == Path::new(CONFIG) => String::new(),
        config => format!(" --config {}", quoted(&config.display().to_string())),
    };
    let link = if plan.is_remote { " --link" } else { "" };
    let camera = if plan.is_camera { " --camera" } else { "" };
    let policy = if plan.is_policy { " --policy" } else { "" };
    format!(
        "seed {}, tick {}, invariant {}: {}\n  {schedule} ({} of {} episodes), tick {}, {}: {}\n  simulate{settings}{link}{camera}{policy} \
         --ticks {} --replay {} --faults {}",
        failure.seed,
        v.tick,
        v.invariant,
        v.detail,
        failure.schedule.len(),
        failure.episodes,
        failure.smallest.tick,
        failure.smallest.invariant,
        failure.smallest.detail,
        plan.ticks,
        failure.seed,
        to_text(&failure.schedule)
    )
}

/// Quotes text so that a shell reads it back.
fn quoted(text: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+@:".contains(c);
    if text.chars().all(plain) { text.to_owned() } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

pub fn replay_text(seed: u64, outcome: &Outcome) -> String {
    let mut out = String::new();
    for (tick, made) in &outcome.transitions {
        let mode = |number| Mode::from_u32(number).map_or("no mode", Mode::name);
        let _ = writeln!(out, "tick {tick}: {} to {}, {}", mode(made.from), mode(made.to), made.why_name());
    }
    if let Some(v) = &outcome.violation {
        let _ = writeln!(out, "seed {seed}, tick {}, invariant {}: {}", v.tick, v.invariant, v.detail);
    }
    for (kind, count) in KINDS.iter().zip(outcome.fired).filter(|(_, count)| *count > 0) {
        let _ = writeln!(out, "{} fired {count} times", kind.name);
    }
    let _ =
        writeln!(out, "{} ticks, {} transitions, hash {:016x}", outcome.ticks, outcome.transitions.len(), outcome.hash);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle::Violation;

    #[test]
    fn failure_report_gives_replay_command_and_says_if_shrunk() {
        let violation = Violation { tick: 7, invariant: "joint limits", detail: "of joint 3".to_owned() };
        let smallest = violation.clone();
        let mut failure = Failure { seed: 4, violation, schedule: vec![], shrunk: true, smallest, episodes: 9 };
        let plan = Plan { ticks: 9000, ..Plan::default() };
        let text = |failure: &Failure, config: &str| failure_text(failure, &plan, Path::new(config));
        let shipped = text(&failure, CONFIG);
        assert!(shipped.contains("  smallest schedule (0 of 9 episodes)"), "{shipped}");
        assert!(shipped.ends_with("\n  simulate --ticks 9000 --replay 4 --faults none"), "{shipped}");
        failure.shrunk = false;
        let own = text(&failure, "/tmp/it's mine.toml");
        assert!(own.contains("\n  schedule (") && !own.contains("smallest"), "{own}");
        assert!(own.contains("simulate --config '/tmp/it'\\''s mine.toml' --ticks"), "{own}");
        assert!(text(&failure, "own.toml").contains("simulate --config own.toml --ticks"));
    }
}
