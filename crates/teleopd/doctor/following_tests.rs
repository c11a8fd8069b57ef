use super::*;
use crate::doctor::Level;
use config::Overrides;
use std::path::Path;

/// The shipped robots.
const SHIPPED: &str = "tiago_dual tiago_dual_pal_gripper unitree_g1 openarm_v10 franka_fr3_duo rby1a unitree_h1 \
                       ur5e_pair viperx_pair reachy_2 booster_t1 tiago_pro";

fn shipped(name: &str) -> Model {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/teleop.toml");
    let overrides = Overrides { robot: Some(name.into()), ..Overrides::default() };
    config::load(&config, overrides).unwrap_or_else(|error| panic!("{name}: {error}")).model
}

/// The robot with another text of its file, among the same obstacles.
fn changed(model: &Model, change: impl Fn(&str) -> String) -> Model {
    let texts = &model.texts;
    let toml = change(&texts.toml);
    assert_ne!(toml, texts.toml);
    let changed = Model::from_text(&texts.toml_name, &toml, &texts.urdf_name, &texts.urdf);
    let mut changed = changed.unwrap_or_else(|error| panic!("{error}"));
    changed.obstacles = model.obstacles.clone();
    changed
}

/// Returns what the finding of this name says, and asserts that it is a problem.
fn problem(model: &Model, check: &str) -> String {
    let following = Following::measure(model, None);
    let findings = following.findings();
    let finding = findings.iter().find(|finding| finding.check == check).expect("a finding");
    assert_eq!(finding.level, Level::Problem, "{}: {}", finding.check, finding.found);
    finding.found.clone()
}

#[test]
fn shipped_robots_follow() {
    for name in SHIPPED.split(' ') {
        let following = Following::measure(&shipped(name), None);
        println!("{name}: {following:?}");
        for finding in following.findings() {
            assert_eq!(finding.level, Level::Ok, "{name}: {}: {}", finding.check, finding.found);
        }
    }
}

/// Without the height of its base, the floor lies where the hands hang.
#[test]
fn hands_that_hang_in_the_floor_are_a_problem() {
    let model = changed(&shipped("unitree_g1"), |toml| toml.replace("base_height_m = 0.7919", "base_height_m = 0.1"));
    let found = problem(&model, "hanging hands");
    assert!(found.contains(" and floor: ") && found.contains("mm between "), "{found}");
}

#[test]
fn t_pose_outside_the_ranges_is_a_problem() {
    let model = changed(&shipped("openarm_v10"), |toml| {
        let narrow = ["left", "right"].map(|side| {
            let range = if side == "left" { "-1.0\nposition_max_rad = 0.1" } else { "-0.1\nposition_max_rad = 1.0" };
            format!("\n[tighten.openarm_{side}_joint2]\nposition_min_rad = {range}\n")
        });
        toml.replace("\n[[collision.capsules]]", "\n[[collision.capsule_mark]]")
            .replacen("\n[[collision.capsule_mark]]", &format!("{}\n[[collision.capsules]]", narrow.concat()), 1)
            .replace("capsule_mark", "capsules")
    });
    let found = problem(&model, "T-pose");
    assert!(found.contains(" deg from a limb of the person's T-pose, at most 10 deg"), "{found}");
}

/// The arms are exchanged, and each reaches to the other side. So the file loads, as a mirror image.
#[test]
fn exchanged_arms_are_a_problem() {
    let model = changed(&shipped("unitree_g1"), |toml| {
        let turned = toml.replace("reference_rad = [0.0, 1.57074, 0.0, 1.5708, 0.0]", "reference_rad = [L]");
        let turned = turned.replace("reference_rad = [0.0, -1.57074, 0.0, 1.5708, 0.0]", "reference_rad = [R]");
        let turned = turned.replace("[L]", "[0.0, -1.57074, 0.0, 1.5708, 0.0]");
        let turned = turned.replace("[R]", "[0.0, 1.57074, 0.0, 1.5708, 0.0]");
        turned
            .replace("[arms.left]", "[arms.X]")
            .replace("[arms.right]", "[arms.left]")
            .replace("[arms.X]", "[arms.right]")
    });
    let found = problem(&model, "sides");
    assert!(found.contains("for 80 % of the built-in motion, at most 50 %"), "{found}");
    let found = problem(&model, "limbs");
    assert!(found.starts_with("at best 27.5") && found.ends_with("at most 10 deg"), "{found}");
}
