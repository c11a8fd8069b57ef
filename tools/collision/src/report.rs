//! Formats the output of `collision limits`.

use crate::limits::{Found, Motion, PerJoint, State, Survey};
use robot::Model;
use std::fmt::Write;

/// Formats a table of all joints: limits, the worst torque that sampling and climbing found, and the number of
/// states that exceed.
pub fn table(survey: &Survey<'_>, motion: &Motion, found: &[Found], climbed: &[Option<State>]) -> String {
    let wide = survey.model.joint_names.iter().map(String::len).max().unwrap_or(0);
    let mut text = format!(
        "{:wide$} {:>8} {:>8} {:>8} {:>9} {:>9} {:>9} {:>10} {:>12}\n",
        "joint", "v max", "a max", "stop ms", "effort", "sampled", "climbed", "exceeding", "at no accel."
    );
    for (j, found) in found.iter().enumerate() {
        let effort = survey.effort(j);
        let share = |state: Option<&State>| state.map_or(f64::NAN, |state| state.torque(&motion.a) / effort);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:wide$} {:8.3} {:8.3} {:8.0} {:9.3} {:9.4} {:9.4} {:10} {:12}",
            survey.model.joint_names[j],
            motion.v[j],
            motion.a[j],
            stop_time_s(survey.model, j, motion) * 1e3,
            effort,
            share(found.worst.first()),
            share(climbed.get(j).and_then(Option::as_ref)),
            found.exceeding,
            found.exceeding_coasting,
        );
    }
    text.push_str(
        "v max in rad/s or m/s, a max in rad/s^2 or m/s^2. Effort is the limit, N m or N. Sampled and climbed are the largest\n\
         shares of it that random states and a climb from the worst of them reach. Exceeding counts the states above the\n\
         share that is allowed, the last column those that exceed it without any acceleration.\n",
    );
    text
}

fn stop_time_s(model: &Model, j: usize, motion: &Motion) -> f64 {
    robot::JointLimits { v_max: motion.v[j], a_max: motion.a[j], ..model.limits[j] }.stop_time_s()
}

pub fn worst_cases(survey: &Survey<'_>, motion: &Motion, found: &[Found]) -> String {
    let mut text = String::new();
    for (j, found) in found.iter().enumerate() {
        let Some(state) = found.worst.first() else { continue };
        let torque = state.torque(&motion.a);
        let list = |values: &PerJoint| {
            let own = &values[..survey.model.count];
            let words: Vec<String> = own.iter().map(|value| format!("{value:.3}")).collect();
            words.join(" ")
        };
        let name = &survey.model.joint_names[j];
        let share = torque / survey.effort(j);
        let _ = writeln!(
            text,
            "{name}: {torque:.3} ({share:.4} of the effort limit), {:.3} of it at no acceleration",
            state.bias
        );
        let _ = writeln!(text, "  q {}\n  v {}", list(&state.q), list(&state.v));
    }
    text
}
