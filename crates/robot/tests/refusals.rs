//! Tests that every defect of a URDF or a robot file is refused, and that the error names file, key, value
//! and bound.

use crate::support::{TOML, URDF, assert_words, edit, load, remove_capsules, with_proved_clear};

fn refused(toml: &str, urdf: &str, words: &[&str]) {
    assert_words(load(toml, urdf), words);
}

const LEFT_1: &str = "<joint name=\"arm_left_1_joint\"";
const LEFT_1_LIMIT: &str = "lower=\"-1.1780972450961724\" upper=\"1.5707963267948966\" velocity=\"1.95\" effort=\"43\"";

#[test]
fn f100_invalid_limits_are_refused_with_joint_value_and_bound() {
    let cases = [
        ("lower=\"2\" upper=\"1.5\" velocity=\"1.95\" effort=\"43\"", ["lower = 2", "below limit upper = 1.5"]),
        ("lower=\"1\" upper=\"1\" velocity=\"1.95\" effort=\"43\"", ["lower = 1", "below limit upper = 1"]),
        ("lower=\"nan\" upper=\"1\" velocity=\"1.95\" effort=\"43\"", ["lower = NaN", "at most 13"]),
        ("lower=\"-1\" upper=\"inf\" velocity=\"1.95\" effort=\"43\"", ["upper = inf", "at most 13"]),
        ("lower=\"-1\" upper=\"1e9\" velocity=\"1.95\" effort=\"43\"", ["upper = 1000000000", "at most 13"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"0\" effort=\"43\"", ["velocity = 0", "above 0"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"1e9\" effort=\"43\"", ["velocity = 1000000000", "at most 50"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"inf\" effort=\"43\"", ["velocity = inf", "at most 50"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"-2\" effort=\"43\"", ["velocity = -2", "above 0"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"1.95\" effort=\"-43\"", ["effort = -43", "above 0"]),
        ("lower=\"-1\" upper=\"1\" velocity=\"1.95\" effort=\"0\"", ["effort = 0", "above 0"]),
        ("velocity=\"1.95\" effort=\"43\"", ["lower = 0", "below limit upper = 0"]),
    ];
    for (limit, words) in cases {
        let urdf = edit(URDF, LEFT_1, LEFT_1_LIMIT, limit);
        refused(TOML, &urdf, &["tiago_dual.urdf", "arm_left_1_joint", words[0], words[1]]);
    }
    let urdf = edit(URDF, LEFT_1, &format!("<limit {LEFT_1_LIMIT}/>"), "");
    refused(TOML, &urdf, &["tiago_dual.urdf", "arm_left_1_joint", "limit lower = 0"]);
}

#[test]
fn f100_joints_of_wrong_kind_are_refused() {
    let urdf = edit(URDF, LEFT_1, "type=\"revolute\"", "type=\"continuous\"");
    refused(TOML, &urdf, &["arm_left_1_joint", "continuous", "must be revolute"]);
    let urdf = edit(URDF, "<joint name=\"torso_lift_joint\"", "type=\"prismatic\"", "type=\"fixed\"");
    refused(TOML, &urdf, &["torso_lift_joint", "fixed", "must be revolute or prismatic"]);
    let urdf = edit(URDF, "<joint name=\"arm_left_tool_joint\"", "type=\"fixed\"", "type=\"floating\"");
    refused(TOML, &urdf, &["arm_left_tool_joint"]);
    let urdf = edit(URDF, LEFT_1, "</joint>", "<mimic joint=\"arm_left_2_joint\"/></joint>");
    refused(TOML, &urdf, &["arm_left_1_joint", "mimic"]);
    let urdf = edit(URDF, LEFT_1, "</joint>", "<mimic joint=\"nobody\"/></joint>");
    refused(TOML, &urdf, &["arm_left_1_joint", "mimic", "nobody"]);
    let urdf = edit(URDF, LEFT_1, "<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>");
    refused(TOML, &urdf, &["arm_left_1_joint", "axis = 0", "must be above 0"]);
}

#[test]
fn f099_urdf_that_is_not_a_tree_is_refused() {
    let urdf = edit(
        URDF,
        "<joint name=\"base_footprint_joint\"",
        "parent link=\"base_footprint\"",
        "parent link=\"xtion_link\"",
    );
    refused(TOML, &urdf, &["loop"]);
    let urdf = edit(URDF, "</robot>", "</robot>", "<link name=\"island\"/></robot>");
    refused(TOML, &urdf, &["roots", "base_footprint", "island"]);
    let urdf = edit(URDF, "</robot>", "</robot>", "<link name=\"base_link\"/></robot>");
    refused(TOML, &urdf, &["link `base_link` occurs twice"]);
    let urdf = edit(URDF, "<joint name=\"head_2_joint\"", "head_2_joint", "head_1_joint");
    refused(TOML, &urdf, &["joint `head_1_joint` occurs twice"]);
    let urdf = edit(URDF, LEFT_1, "parent link=\"torso_lift_link\"", "parent link=\"nowhere\"");
    refused(TOML, &urdf, &["arm_left_1_joint", "parent", "nowhere"]);
    let circle = "<link name=\"a\"/><link name=\"b\"/>\
        <joint name=\"ab\" type=\"fixed\"><parent link=\"a\"/><child link=\"b\"/></joint>\
        <joint name=\"ba\" type=\"fixed\"><parent link=\"b\"/><child link=\"a\"/></joint></robot>";
    let urdf = edit(URDF, "</robot>", "</robot>", circle);
    refused(TOML, &urdf, &["link `a`", "loop"]);
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
    let limit = "lower=\"-1.1780972450961724\"";
    let urdf = edit(URDF, "<joint name=\"arm_right_1_joint\"", limit, "lower=\"-1.1\"");
    refused(TOML, &urdf, &["arm_right_1_joint", "position min", "left arm"]);
    // An axis against the mirror image is a sign. The limits must then mirror, too.
    let axis = "<axis xyz=\"0 0 1\"/>";
    let urdf = edit(URDF, "<joint name=\"arm_right_4_joint\"", axis, "<axis xyz=\"0 0 -1\"/>");
    refused(TOML, &urdf, &["arm_right_4_joint", "position min", "mirror"]);
    let urdf = edit(URDF, "<joint name=\"arm_right_5_joint\"", axis, "<axis xyz=\"0.6 0 0.8\"/>");
    refused(TOML, &urdf, &["arm_right_5_joint", "deviation of the axis", "must mirror"]);
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
    let cases = [
        ("[limits.groups.torso]", "soft_margin_m", "soft_margin", "soft_margin"),
        ("[limits.groups.torso]", "soft_margin_m", "soft_margin_rad", "limits.groups.torso.soft_margin_rad"),
        (
            "[limits.groups.torso]",
            "[\"torso_lift_joint\"]",
            "[]",
            "`torso_lift_joint`, must belong to one of limits.groups",
        ),
        ("[limits.groups.head]", "\"head_1_joint\"", "\"torso_lift_joint\"", "torso_lift_joint"),
        ("[limits.groups.head]", "jerk_max_rad_per_s3 = 400.0", "", "jerk_max_rad_per_s3"),
        ("[collision]", "clearance_min_mm", "clearance_min", "clearance_min"),
        ("[collision]", "clearance_min_mm = 10.0", "clearance_min_mm = 0.0", "clearance_min_mm"),
        ("[limits]", "stop_time_max_ms = 500.0", "stop_time_max_ms = 900.0", "stop_time_max_ms"),
        ("format = 2", "format = 2", "format = 3", "format"),
        ("format = 2", "format = 2", "format = 1", "teleopd robot new URDF"),
        ("urdf =", "tiago_dual.urdf", "../tiago_dual.urdf", "urdf"),
        ("base_link =", "base_footprint", "base_link", "base_link"),
        ("body_joints", "\"head_1_joint\"", "\"head_9_joint\"", "head_9_joint"),
        ("body_joints", "\"head_1_joint\"", "\"head_2_joint\"", "head_2_joint"),
        (
            "head_joints",
            "\"head_1_joint\", \"head_2_joint\"",
            "\"head_2_joint\", \"head_1_joint\"",
            "the lower joint first",
        ),
        ("head_joints", "\"head_2_joint\"", "\"head_1_joint\"", "two axes"),
        ("head_joints", "\"head_1_joint\"", "\"torso_lift_joint\"", "must turn about two axes"),
        ("head_joints", "\"head_1_joint\"", "\"arm_left_1_joint\"", "arm_left_1_joint"),
        ("[arms.left]", "arm_left_3_link", "arm_left_4_link", "arms.left.upper"),
        (
            "[arms.left]",
            "\"arm_left_2_joint\",\n    \"arm_left_3_joint\"",
            "\"arm_left_3_joint\",\n    \"arm_left_2_joint\"",
            "arms.left.joints",
        ),
        ("[[controllers]]", "\"torso_lift_joint\"", "\"head_1_joint\"", "head_1_joint"),
        ("[[controllers]]", "[\"torso_lift_joint\"]", "[]", "must belong to a controller"),
        ("[arms.left]", "[arms.left]", "[held_rad]\narm_left_1_joint = 0.0\n[arms.left]", "held_rad"),
        ("[home_rad]", "head_1_joint = 0.0", "", "head_1_joint"),
        ("[home_rad]", "head_1_joint = 0.0", "head_1_joint = 2.0", "head_1_joint"),
        ("[home_m]", "torso_lift_joint = ", "torso_lift = ", "torso_lift"),
        ("reference_rad", "[0.0, 0.0", "[nan, 0.0", "arms.left.reference_rad"),
        ("[arms.right]", "reference_rad = [0.0", "reference_rad = [0.1", "arm_right_1_joint"),
        ("[[collision.capsules]]", "radius_m = ", "radius_m = -", "radius_m"),
        ("[[collision.capsules]]", "link = \"base_link\"", "link = \"nowhere\"", "nowhere"),
        ("[collision.allowed.adjacent]", "base_0 = [", "base_0 = [\"hand_left_0\", ", "base_0"),
        ("[collision.allowed.proved_clear]", "base_0 = [", "base_0 = [\"nothing\", ", "nothing"),
    ];
    for (after, old, new, word) in cases {
        refused(&edit(TOML, after, old, new), URDF, &["tiago_dual.toml", word]);
    }
}

/// A robot file with motors.
const G1: &str = include_str!("../../../config/robots/unitree_g1.toml");
const G1_URDF: &str = include_str!("../../../config/robots/unitree_g1.urdf");

#[test]
fn f097_error_in_driver_table_is_refused_with_its_key() {
    let yaw = "waist_yaw_joint = { index = 12, stiffness_n_m_per_rad = 300.0, damping_n_m_s_per_rad = 3.0 }";
    let cases = [
        ("setpoints = \"arm_sdk\"", "setpoints = \"torques\"", ["torques", "arm_sdk"]),
        (
            "setpoints = \"arm_sdk\"",
            "setpoints = \"positions\"",
            ["driver.setpoints = \"positions\"", "must be \"arm_sdk\""],
        ),
        ("mode_machine = 5", "", ["driver.mode_machine", "rt/lowstate"]),
        ("mode_machine = 5", "mode_machine = 256", ["256", "u8"]),
        (yaw, "", ["`waist_yaw_joint`", "must have a motor"]),
        ("waist_yaw_joint = { index", "left_hip_yaw_joint = { index", ["driver.motors", "left_hip_yaw_joint"]),
        ("index = 12", "index = 11", ["motor index = 11", "12 to 28"]),
        ("index = 12", "index = 29", ["motor index = 29", "12 to 28"]),
        ("index = 12", "index = 13", ["motor index = 13", "another joint"]),
        ("rad = 300.0", "rad = 401.0", ["stiffness_n_m_per_rad = 401", "5 to 400"]),
        ("rad = 300.0", "rad = 0.0", ["stiffness_n_m_per_rad = 0", "5 to 400"]),
        ("damping_n_m_s_per_rad = 3.0", "damping_n_m_s_per_rad = nan", ["damping_n_m_s_per_rad = NaN", "0.1 to 10"]),
    ];
    for (old, new, [what, bound]) in cases {
        refused(&edit(G1, "[driver]", old, new), G1_URDF, &["tiago_dual.toml", what, bound]);
    }
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
    let with =
        |line: &str| edit(TOML, "[home_m]", "[home_m]", &format!("[tighten.torso_lift_joint]\n{line}\n\n[home_m]"));
    refused(&with("velocity_max_m_per_s = 0.08"), URDF, &["torso_lift_joint", "0.08", "at most 0.07"]);
    refused(&with("position_max_m = 0.36"), URDF, &["torso_lift_joint", "0.36", "tighten"]);
    refused(&with("position_min_m = -0.1"), URDF, &["torso_lift_joint", "-0.1", "tighten"]);
    refused(&with("velocity_max_rad_per_s = 0.01"), URDF, &["torso_lift_joint", "wrong unit"]);
    refused(&edit(TOML, "[home_m]", "[home_m]", "[tighten.nobody]\n[home_m]"), URDF, &["nobody"]);
    let model = load(&with("velocity_max_m_per_s = 0.05\nposition_max_m = 0.345"), URDF).unwrap();
    assert_eq!((model.limits[0].v_max, model.limits[0].q_max), (0.05, 0.345));
    assert_eq!(model.urdf_limits[0].v_max, 0.07);
    let head =
        |line: &str| edit(TOML, "[tighten.head_2_joint]", "position_min_rad", &format!("{line}\nposition_min_rad"));
    // The head needs 3 / 1 + 1 / 400 = 3.0 s.
    let slow = head("acceleration_max_rad_per_s2 = 1.0");
    refused(&slow, URDF, &["head_2_joint", "stop time", "3002", "500"]);
    let strong = head("acceleration_max_rad_per_s2 = 10.5");
    refused(&strong, URDF, &["head_2_joint", "acceleration_max_rad_per_s2", "10.5", "at most 10"]);
    refused(&head("acceleration_max_m_per_s2 = 1.0"), URDF, &["head_2_joint", "wrong unit"]);
    let one_arm =
        edit(TOML, "[home_m]", "[home_m]", "[tighten.arm_left_3_joint]\nvelocity_max_rad_per_s = 2.0\n[home_m]");
    refused(&one_arm, URDF, &["arm_right_3_joint", "velocity max", "left arm"]);
}

#[test]
fn payload_out_of_range_is_refused_with_key_value_and_bound() {
    let right = "[payload.right]";
    for (old, new, words) in [
        ("mass_kg = 0.0", "mass_kg = 5.1", ["payload.right.mass_kg = 5.1", "0 to 5"]),
        ("mass_kg = 0.0", "mass_kg = -0.1", ["payload.right.mass_kg = -0.1", "0 to 5"]),
        ("mass_kg = 0.0", "mass_kg = nan", ["payload.right.mass_kg = NaN", "0 to 5"]),
        ("centre_m = [", "centre_m = [0.4, 0.4, 0.0] #", ["payload.right.centre_m = [0.4, 0.4, 0.0]", "at most 0.5 m"]),
        ("centre_m = [", "centre_m = [nan, 0.0, 0.0] #", ["payload.right.centre_m = [NaN", "at most 0.5 m"]),
        ("centre_m = [", "centre = [", ["unknown field `centre`", "centre_m"]),
    ] {
        refused(&edit(TOML, right, old, new), URDF, &["tiago_dual.toml", words[0], words[1]]);
    }
    let laden = load(&edit(TOML, right, "mass_kg = 0.0", "mass_kg = 5.0"), URDF).unwrap();
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
    let right = "[hands.right]";
    for (from, to, expected) in [
        ("closing_time_ms = 2600.0", "closing_time_ms = 10.0", ["hands.right.closing_time_ms = 10", "50 to 10000"]),
        ("closing_time_ms = 2600.0", "closing_time_ms = nan", ["hands.right.closing_time_ms = NaN", "50 to 10000"]),
        ("opening_m = 0.1", "opening_m = 0.0", ["hands.right.opening_m = 0", "0.001 to 0.5"]),
        ("force_max_n = 20.0", "force_max_n = -1.0", ["hands.right.force_max_n = -1", "0.1 to 500"]),
        (
            "hand_right_thumb_joint = 6.28",
            "hand_right_thumb_joint = 0.0",
            ["`hand_right_thumb_joint`", "another position"],
        ),
        ("open_rad = { hand_right_thumb_joint = 0.0", "open_rad = { t = 0.0", ["closed_rad = missing", "`t`"]),
        (
            "open_rad = { hand_right_thumb_joint = 0.0, ",
            "open_rad = { ",
            ["`hand_right_thumb_joint`", "open hand alone"],
        ),
        (
            "open_rad = { hand_right_thumb",
            "open_rad = { head_1_joint = 0.0, hand_right_thumb",
            ["closed_rad", "head_1_joint"],
        ),
    ] {
        refused(&edit(TOML, right, from, to), URDF, &[&["tiago_dual.toml"], &expected[..]].concat());
    }
    let model = load(TOML, URDF).unwrap();
    let gripper = model.grippers[1].as_ref().expect("a Hey5 hand");
    assert!((gripper.speed - 1.0 / 2.6).abs() < 1e-12 && gripper.fingers.len() == 3);
    assert_eq!((gripper.closure_at(0.05), gripper.closure_at(0.2), gripper.closure_at(0.0)), (0.5, 0.0, 1.0));
}
