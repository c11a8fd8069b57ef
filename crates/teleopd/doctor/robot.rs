//! One page about a robot: what a person checks before the first motion.

use super::following::Following;
use config::Loaded;
use messages::JOINTS_MAX;
use robot::{Frames, Model};
use rt::{Exit, Failure};
use std::fmt::Write;

/// Judges the robot of the settings: joints, limbs, stop times, torque and clearance at home, and how near its limbs come
/// to a person's in the built-in motion.
pub(super) fn page(loaded: &Loaded, following: &Following) -> Result<String, Failure> {
    let control = world::control_config(loaded, true).map_err(Failure::with(Exit::Config))?;
    world::driver_config(loaded, true).map_err(Failure::with(Exit::Config))?;
    world::robot_config(loaded).map_err(Failure::with(Exit::Config))?;
    let model = &loaded.model;
    let still = [0.0; JOINTS_MAX];
    let torques = wbc::torques(&control.wbc, &model.home, &still, &still);
    let share = |j: usize| torques.map_or(0.0, |torques| torques[j].abs() / model.limits[j].effort_max);
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "{}: {} joints, {} of them of the body{}\n\n{:28} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}",
        model.name,
        model.count,
        model.body_count,
        model.lift.map_or(String::new(), |j| format!(", lift {}", model.joint_names[j])),
        "joint",
        "q min",
        "q max",
        "v max",
        "home",
        "stop ms",
        "torque",
    );
    for (j, name) in model.joint_names.iter().enumerate() {
        let limits = &model.limits[j];
        let _ = writeln!(
            out,
            "{name:28} {:8.3} {:8.3} {:8.3} {:8.3} {:8.0} {:8.2}",
            limits.q_min,
            limits.q_max,
            limits.v_max,
            model.home[j],
            limits.stop_time_s() * 1e3,
            share(j)
        );
    }
    out.push_str("rad, rad/s; m for joints that slide. Torque: that of the home posture over the effort limit.\n\n");
    limbs(&mut out, model);
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    let (clearance_m, pair) = model.clearance(&frames);
    let pair = &model.pairs[pair];
    let _ = writeln!(
        out,
        "home: {:.0} mm between {} and {}; {} capsules, {} pairs checked, {} left out with a reason",
        clearance_m * 1e3,
        model.capsules[pair.a].name,
        model.capsules[pair.b].name,
        model.capsules.len(),
        model.pairs.len(),
        model.allowed.len(),
    );
    let solved = match following.solved_deg {
        Some(solved_deg) => format!("{solved_deg:.2} deg with the weights and two refinement steps"),
        None => "no weights yet: `train` makes them".to_owned(),
    };
    let best_deg = following.best_deg;
    let _ = writeln!(out, "built-in motion: limbs at best {best_deg:.2} deg from the person's, {solved}");
    Ok(out)
}

/// How straight the T-pose is, and which joints of the right arm turn against their mirror image.
fn limbs(out: &mut String, model: &Model) {
    let signs: Vec<&str> = model.arms[1].joint_signs().map(|sign| if sign < 0.0 { "-" } else { "+" }).collect();
    let mirrors = format!("right arm mirrors with signs {}", signs.join(" "));
    let right = if model.mirrored { &mirrors } else { "the arms do not mirror: each has its own geometry and weights" };
    for arm in &model.arms[..=model.measured_side(1)] {
        let off = |slot: usize, wanted: usize| match arm.slots[slot] {
            Some(_) => format!("{:.2} deg", arm.axes[slot][wanted].abs().min(1.0).acos().to_degrees()),
            None => "without roll".to_owned(),
        };
        let (upper, fore, elbow) = (off(2, 1), off(4, 1), off(3, 2));
        let _ = writeln!(
            out,
            "T-pose, off the side: upper arm {upper}, forearm {fore}; elbow axis {elbow} off vertical; {right}"
        );
    }
}
