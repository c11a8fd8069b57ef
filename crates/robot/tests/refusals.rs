//! Tests that every defect of a URDF or a robot file is refused, and that the error names file, key, value
//! and bound.

use crate::support::{TOML, URDF, assert_words, edit, load, remove_capsules, with_proved_clear};
use std::collections::HashMap;

fn refused(toml: &str, urdf: &str, words: &[&str]) {
    assert_words(load(toml, urdf), words);
}

/// A row of `refusals.toml`.
type Row = (String, String, String, Vec<String>);

/// Refuses every row of a table of `refusals.toml`, in errors that name `file`.
fn refuse_rows(table: &str, toml: &str, urdf: &str, file: &str) {
    let mut tables: HashMap<String, Vec<Row>> = toml::from_str(include_str!("refusals.toml")).expect("the tables");
    for (after, old, new, words) in tables.remove(table).expect("a table of this name") {
        let [mut toml, mut urdf] = [toml, urdf].map(str::to_owned);
        let changed = if after.starts_with('<') { &mut urdf } else { &mut toml };
        *changed = edit(changed, &after, &old, &new);
        let words: Vec<_> = words.iter().map(String::as_str).chain([file]).collect();
        refused(&toml, &urdf, &words);
    }
}

#[test]
fn f100_invalid_limits_are_refused_with_joint_value_and_bound() {
    refuse_rows("limits", TOML, URDF, "tiago_dual.urdf");
}

#[test]
fn f100_joints_of_wrong_kind_are_refused() {
    refuse_rows("kinds", TOML, URDF, "tiago_dual.urdf");
}

#[test]
fn f099_urdf_that_is_not_a_tree_is_refused() {
    refuse_rows("tree", TOML, URDF, "tiago_dual.urdf");
}

#[test]
fn f099_hostile_urdf_is_refused_with_reason() {
    let bomb = "<?xml version=\"1.0\"?><!DOCTYPE r [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><robot name=\"&b;\"/>";
    refused(TOML, bomb, &["tiago_dual.urdf", "DTD"]);
    refused(TOML, "<robot name=\"r\">&a;</robot>", &["entity"]);
    let deep = format!("<robot name=\"r\">{}{}</robot>", "<a>".repeat(100_000), "</a>".repeat(100_000));
    refused(TOML, &deep, &["depth", "at most 24"]);
    let long = format!("{URDF}<!--{}-->", " ".repeat(5 << 20));
    refused(TOML, &long, &["length", "5242880"]);
    let links: String = (0..600).map(|i| format!("<link name=\"l{i}\"/>")).collect();
    refused(TOML, &format!("<robot name=\"r\">{links}</robot>"), &["links: 600", "at most 512"]);
    for cut in [0, 1, 100, URDF.len() / 2, URDF.len() - 3] {
        assert!(load(TOML, &URDF[..cut]).is_err(), "cut at {cut}");
    }
}

#[test]
fn arms_that_do_not_mirror_each_other_are_refused() {
    refuse_rows("mirror", TOML, URDF, "tiago_dual.toml");
}

#[test]
fn waist_that_carries_the_arms_is_no_head() {
    let toml = include_str!("../../../config/robots/rby1a.toml");
    let urdf = include_str!("../../../config/robots/rby1a.urdf");
    for waist in ["torso_5", "torso_3"] {
        let toml = edit(toml, "head_joints", "\"head_0\", \"head_1\"", &format!("\"{waist}\", \"head_1\""));
        refused(&toml, urdf, &["head_joints", waist, "neither torso nor arm"]);
    }
}

#[test]
fn f097_error_in_robot_file_is_refused_with_its_key() {
    refuse_rows("keys", TOML, URDF, "tiago_dual.toml");
}

/// A robot file with motors.
const G1: &str = include_str!("../../../config/robots/unitree_g1.toml");
const G1_URDF: &str = include_str!("../../../config/robots/unitree_g1.urdf");

#[test]
fn f097_error_in_driver_table_is_refused_with_its_key() {
    refuse_rows("driver", G1, G1_URDF, "tiago_dual.toml");
}

#[test]
fn controller_keeps_the_order_of_the_robot_file() {
    let model = load(TOML, URDF).expect("shipped");
    let turned =
        edit(TOML, "[[controllers]]", "\"head_1_joint\", \"head_2_joint\"", "\"head_2_joint\", \"head_1_joint\"");
    let head =
        |model: &robot::Model| model.controllers.iter().find(|one| one.name == "head_controller").cloned().unwrap();
    let (now, then) = (head(&model), head(&load(&turned, URDF).expect("the same joints")));
    assert_eq!(now.joints, then.joints);
    assert!(now.order[0] < now.order[1] && then.order == [now.order[1], now.order[0]], "{then:?}");
}

#[test]
fn f098_override_that_loosens_limit_is_refused() {
    refuse_rows("tightened", TOML, URDF, "tiago_dual.toml");
    let line = "[tighten.torso_lift_joint]\nvelocity_max_m_per_s = 0.05\nposition_max_m = 0.345\n\n[home_m]";
    let model = load(&edit(TOML, "[home_m]", "[home_m]", line), URDF).unwrap();
    assert_eq!((model.limits[0].v_max, model.limits[0].q_max), (0.05, 0.345));
    assert_eq!(model.urdf_limits[0].v_max, 0.07);
}

#[test]
fn payload_out_of_range_is_refused_with_key_value_and_bound() {
    refuse_rows("payload", TOML, URDF, "tiago_dual.toml");
    let laden = load(&edit(TOML, "[payload.right]", "mass_kg = 0.0", "mass_kg = 5.0"), URDF).unwrap();
    assert_eq!(laden.payload.map(|hand| hand.map(|hand| hand.mass_kg)), [Some(0.0), Some(5.0)]);
    let (begin, end) = (TOML.find("[payload.left]").unwrap(), TOML.find("# Where everything goes").unwrap());
    let silent = load(&format!("{}{}", &TOML[..begin], &TOML[end..]), URDF).unwrap();
    assert_eq!(silent.payload, [None; 2], "a file that says nothing has empty hands");
}

#[test]
fn torso_frame_that_looks_backwards_is_refused() {
    let turned = "<link name=\"turned\"/><joint name=\"turn\" type=\"fixed\"><parent link=\"torso_lift_link\"/>\
                  <child link=\"turned\"/><origin xyz=\"0 0 0\" rpy=\"0 0 3.14159265358979312\"/></joint></robot>";
    let urdf = URDF.replacen("</robot>", turned, 1);
    let toml = TOML.replacen("torso_link = \"torso_lift_link\"", "torso_link = \"turned\"", 1);
    refused(&toml, &urdf, &["tiago_dual.toml", "left hand to the left of the right hand", "torso_rpy_rad"]);
    let at_top = |angle| {
        let key = format!("torso_rpy_rad = [0.0, 0.0, {angle}]\ntorso_link = \"turned\"");
        toml.replacen("torso_link = \"turned\"", &key, 1)
    };
    let model = load(&at_top("-3.14159265358979312"), &urdf).expect("turned back");
    let straight = load(TOML, URDF).unwrap();
    for (own, other) in model.arms[0].axes.iter().zip(&straight.arms[0].axes) {
        assert!((own - other).amax() < 1e-12, "{own} {other}");
    }
    refused(&at_top("7.0"), &urdf, &["torso_rpy_rad = 7", "2 pi"]);
}

#[test]
fn arm_that_no_checked_pair_guards_is_refused() {
    let mut table: toml::Table = TOML.parse().unwrap();
    remove_capsules(&mut table, |one| one["link"].as_str().unwrap().starts_with("arm_right_"));
    load(TOML, URDF).unwrap().check_guarded().expect("the shipped robot");
    let error = load(&table.to_string(), URDF).unwrap().check_guarded().unwrap_err().to_string();
    assert!(error.contains("tiago_dual.toml: checked pairs of capsules on the right upper arm = 0"), "{error}");
    assert!(error.contains("right forearm = 0") && error.contains("arm_right_5_link. If the URDF has none"), "{error}");
}

#[test]
fn pair_that_meets_is_refused_as_proved_clear() {
    let model = load(TOML, URDF).unwrap();
    model.check_proved_clear(500).expect("the shipped robot");
    let names = |pair: &robot::Pair| [pair.a, pair.b].map(|at| model.capsules[at].name.clone());
    let (mut found, mut of_arms) = (0, 0);
    for [a, b] in model.pairs.iter().map(names).filter(|[a, b]| a.contains("left") && b.contains("right")) {
        of_arms += 1;
        if let Err(error) = load(&with_proved_clear(TOML, &a, &b), URDF).unwrap().check_proved_clear(500) {
            let error = error.to_string();
            assert!(error.contains("tiago_dual.toml: collision.allowed.proved_clear") && error.contains(&a), "{error}");
            assert!(error.contains("collision fit"), "{error}");
            found += 1;
        }
    }
    // Samples prove nothing, but they find most edits that let both arms meet.
    assert!(of_arms > 20 && found * 4 > of_arms * 3, "{found} of {of_arms}");
}

#[test]
fn arm_without_mass_is_refused() {
    let mut urdf = String::new();
    let mut rest = URDF;
    while let Some(at) = rest.find("<inertial>") {
        urdf.push_str(&rest[..at]);
        rest = &rest[at + rest[at..].find("</inertial>").unwrap() + "</inertial>".len()..];
    }
    urdf.push_str(rest);
    refused(TOML, &urdf, &["tiago_dual.urdf", "mass of the left arm in kg = 0", "above 0"]);
    let below = edit(URDF, "<inertial>", "ixx=\"", "ixx=\"-");
    refused(TOML, &below, &["tiago_dual.urdf", "inertia about an axis", "not be below 0"]);
}

#[test]
fn held_joint_that_follows_a_commanded_one_is_refused() {
    let follower = "<link name=\"f\"/><joint name=\"follower\" type=\"revolute\"><parent link=\"torso_lift_link\"/>\
                    <child link=\"f\"/><axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" velocity=\"1\" effort=\"1\"/>\
                    <mimic joint=\"arm_left_4_joint\"/></joint></robot>";
    let urdf = URDF.replacen("</robot>", follower, 1);
    let toml = match TOML.contains("[held_rad]") {
        true => TOML.replacen("[held_rad]", "[held_rad]\nfollower = 0.0", 1),
        false => format!("{TOML}\n[held_rad]\nfollower = 0.0\n"),
    };
    refused(&toml, &urdf, &["follower", "mimic of `arm_left_4_joint`", "must not follow a commanded one"]);
}

#[test]
fn gripper_out_of_range_is_refused_with_key_value_and_bound() {
    refuse_rows("hands", TOML, URDF, "tiago_dual.toml");
    let model = load(TOML, URDF).unwrap();
    let gripper = model.grippers[1].as_ref().expect("a Hey5 hand");
    assert!((gripper.speed - 1.0 / 2.6).abs() < 1e-12 && gripper.fingers.len() == 3);
    assert_eq!((gripper.closure_at(0.05), gripper.closure_at(0.2), gripper.closure_at(0.0)), (0.5, 0.0, 1.0));
}
