//! What `collision limits` prints and writes.

use crate::dynamics::PerJoint;
use crate::limits::{Found, Motion, Solution, State, Survey};
use messages::{ARM_JOINTS, JOINTS, LEFT_ARM, RIGHT_ARM};
use robot::Model;
use std::fmt::Write;

/// First line of the part of a robot file that `collision limits --write` owns.
pub const START: &str = "# From here: written by `collision limits`.";
/// Last line of that part.
pub const END: &str = "# To here: written by `collision limits`.";
/// What the part stands before where a file has none yet.
const BEFORE: &str = "# Where everything goes that nothing determines";

/// A table of all joints: limits, the worst torque that sampling and climbing found, and how many states exceed.
pub fn table(survey: &Survey<'_>, motion: &Motion, found: &[Found], climbed: &[Option<State>]) -> String {
    let mut text = format!(
        "{:18} {:>8} {:>8} {:>8} {:>9} {:>9} {:>9} {:>10} {:>12}\n",
        "joint", "v max", "a max", "stop ms", "effort", "sampled", "climbed", "exceeding", "at no accel."
    );
    for (j, found) in found.iter().enumerate() {
        let effort = survey.effort(j);
        let share = |state: Option<&State>| state.map_or(f64::NAN, |state| state.torque(&motion.a) / effort);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:18} {:8.3} {:8.3} {:8.0} {:9.3} {:9.4} {:9.4} {:10} {:12}",
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
    text
}

fn stop_time_s(model: &Model, j: usize, motion: &Motion) -> f64 {
    robot::JointLimits { v_max: motion.v[j], a_max: motion.a[j], ..model.limits[j] }.stop_time_s()
}

/// The worst sampled state of every joint, with torque and share.
pub fn worst_cases(survey: &Survey<'_>, motion: &Motion, found: &[Found]) -> String {
    let mut text = String::new();
    for (j, found) in found.iter().enumerate() {
        let Some(state) = found.worst.first() else { continue };
        let torque = state.torque(&motion.a);
        let list = |values: &PerJoint| {
            let words: Vec<String> = values.iter().map(|value| format!("{value:.3}")).collect();
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

/// The part of a robot file that holds the arms' speeds and accelerations; `command` says how it was made.
pub fn section(survey: &Survey<'_>, solution: &Solution, command: &str) -> String {
    let mut text = format!("{START}\n# {command}\n");
    let _ = writeln!(
        text,
        "# No payload beyond what the command says. Torque stays below {} of the effort limit in all {} states and in what\n\
         # climbing from the worst of them found; the worst of both is given beside each acceleration. Lift and head: see above.",
        survey.sampling.share, survey.sampling.states
    );
    for j in LEFT_ARM.chain(RIGHT_ARM) {
        let motion = &solution.motion;
        let climbed = solution.climbed.get(j).and_then(Option::as_ref);
        let states = solution.found[j].worst.first().into_iter().chain(climbed);
        let worst = states.map(|state| state.torque(&motion.a)).fold(0.0, f64::max);
        let (name, effort) = (&survey.model.joint_names[j], survey.effort(j));
        let v = format!("velocity_max_rad_per_s = {}", decimals(motion.v[j]));
        let a = format!("acceleration_max_rad_per_s2 = {}", decimals(motion.a[j]));
        let urdf = survey.model.urdf_limits[j].v_max;
        let _ = writeln!(text, "\n[tighten.{name}]");
        let _ = writeln!(text, "{v:43} # {:.2} of the URDF's {urdf}", motion.v[j] / urdf);
        let _ = writeln!(text, "{a:43} # {worst:.2} N m, {:.3} of {effort} N m", worst / effort);
    }
    text.push_str(END);
    text.push('\n');
    text
}

/// A TOML float.
fn decimals(x: f64) -> String {
    if x.fract() == 0.0 { format!("{x:.1}") } else { format!("{x}") }
}

/// The text of a robot file with the section in it, in place of the one it had; `None` where there is no place for it.
pub fn with_section(text: &str, section: &str) -> Option<String> {
    let (start, end) = match (text.find(START), text.find(END)) {
        (Some(start), Some(end)) if start < end => (start, end + END.len() + 1),
        (None, None) => text.find(BEFORE).map(|at| (at, at))?,
        _ => return None,
    };
    let gap = if start == end { "\n" } else { "" };
    Some(format!("{}{section}{gap}{}", text.get(..start)?, text.get(end..)?))
}

/// Speeds of the arms as a share of the URDF's, rounded down to 0.01 rad/s; lift and head as they are in force.
pub fn scaled_speeds(model: &Model, share: f64) -> PerJoint {
    std::array::from_fn(|j| {
        if j >= LEFT_ARM.start {
            (share * model.urdf_limits[j].v_max * 100.0).floor() / 100.0
        } else {
            model.limits[j].v_max
        }
    })
}

/// One line of a solution, for comparing several: speeds and accelerations of the left arm.
pub fn line(share: f64, solution: &Solution) -> String {
    let list = |values: &PerJoint| {
        let words: Vec<String> = values[LEFT_ARM].iter().map(|value| format!("{value:5.2}")).collect();
        words.join(" ")
    };
    let states: u64 = solution.found.iter().map(|found| found.exceeding).max().unwrap_or(0);
    let verdict = if solution.complete { "holds".to_owned() } else { format!("NOT FEASIBLE, {states} states exceed") };
    format!("speed {share:.2}: v {} | a {} | {verdict}", list(&solution.motion.v), list(&solution.motion.a))
}

const _: () = assert!(LEFT_ARM.end - LEFT_ARM.start == ARM_JOINTS && RIGHT_ARM.end == JOINTS);
