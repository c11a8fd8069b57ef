//! Tests that the rounding of a text is no asymmetry, and the tables that stand in for what a URDF leaves out.

use crate::support::{HERON, edit, with_capsule};
use robot::draft;

fn drafted(urdf: &str) -> String {
    draft("r.urdf", urdf).unwrap_or_else(|error| panic!("{error}")).toml
}

#[test]
fn axes_that_mirror_within_rounding_are_mirror_images() {
    let turned = |angle: f64| {
        let origin = format!("<origin xyz=\"0 -0.17 0.18\" rpy=\"0 0 {angle}\"/>");
        edit(HERON, "starboard_a\"", "<origin xyz=\"0 -0.17 0.18\" rpy=\"0 0 0\"/>", &origin)
    };
    for angle in [1e-8, 2e-6, 4e-3] {
        let model = with_capsule(&drafted(HERON), &turned(angle)).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(Vec::from_iter(model.arms[1].joint_signs()), [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]);
    }
    let error = with_capsule(&drafted(HERON), &turned(6e-3)).unwrap_err().to_string();
    assert!(error.contains("`starboard_a`: deviation of the axis") && error.contains("within 5e-3"), "{error}");
}

#[test]
fn narrower_of_two_rounded_ranges_serves_both_arms() {
    let urdf = edit(HERON, "starboard_b\"", "lower=\"-2.2\"", "lower=\"-2.21\"");
    let urdf = edit(&urdf, "starboard_b\"", "upper=\"0.3\"", "upper=\"0.295\"");
    let model = with_capsule(&drafted(HERON), &urdf).unwrap();
    let [left, right] = [0, 1].map(|side| &model.limits[model.arms[side].range().start + 1]);
    assert_eq!([right.q_min, right.q_max], [-2.18, 0.295 - 0.02]);
    assert_eq!([left.q_min, left.q_max], [-right.q_max, 2.18]);
    assert_eq!([model.arms[0].q_min[1], model.arms[0].q_max[1]], [left.q_min, left.q_max]);
    assert_eq!(model.urdf_limits[model.arms[1].range().start + 1].q_min, -2.21, "the stops stay where they are");
    let error = with_capsule(&drafted(HERON), &edit(&urdf, "starboard_b\"", "-2.21", "-2.3")).unwrap_err().to_string();
    assert!(error.contains("`starboard_b`: position min"), "{error}");
}

#[test]
fn reference_of_the_right_arm_is_the_mirror_image_to_the_last_digit() {
    let toml = drafted(HERON).replacen("[0.0, -1.5707963267948966, ", "[0.0, -1.5708, ", 1);
    assert_eq!(with_capsule(&toml, HERON).unwrap().arms[1].reference[1], -std::f64::consts::FRAC_PI_2);
}

const ELBOW: &str = "lower=\"-2.4\" upper=\"0.05\" velocity=\"3.0\" effort=\"40\"";

/// The robot with other limits of both elbows.
fn elbows(limit: &str) -> String {
    edit(&edit(HERON, "port_d\"", ELBOW, limit), "starboard_d\"", ELBOW, limit)
}

#[test]
fn placeholder_gets_its_limit_from_the_robot_file() {
    let urdf = elbows("lower=\"-2.4\" upper=\"0.05\" velocity=\"1e9\" effort=\"-1\"");
    let toml = drafted(&urdf);
    let toml = toml.replace("velocity_max_rad_per_s = 1.0 ", "velocity_max_rad_per_s = 2.5 ");
    let model = with_capsule(&toml, &urdf).unwrap_or_else(|error| panic!("{error}"));
    let limits = &model.urdf_limits[model.arms[0].elbow()];
    assert!(limits.v_max == 2.5 && limits.effort_max >= 1.0 && limits.effort_max < 200.0, "{limits:?}");
    let error = with_capsule(&toml, HERON).unwrap_err().to_string();
    assert!(error.contains("`port_d`: supply.velocity_max_rad_per_s = 2.5") && error.contains("[tighten]"), "{error}");
    let wrong = toml.replace("velocity_max_rad_per_s = 2.5 ", "velocity_max_rad_per_s = 51.0 ");
    let error = with_capsule(&wrong, &urdf).unwrap_err().to_string();
    assert!(error.contains("port_d") && error.contains("at most 50"), "{error}");
    let unknown = toml.replace("[supply.port_d]", "[supply.nobody]");
    assert!(with_capsule(&unknown, &urdf).unwrap_err().to_string().contains("nobody"));
}

#[test]
fn joint_without_end_takes_a_range_from_the_robot_file() {
    let endless = |text: &str, name: &str| edit(text, name, "type=\"revolute\"", "type=\"continuous\"");
    let urdf = endless(&endless(HERON, "\"port_e\""), "\"starboard_e\"");
    let toml = drafted(&urdf);
    assert!(toml.contains("[supply.port_e]\nposition_min_rad = -3.14 "), "{toml}");
    let model = with_capsule(&toml, &urdf).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(model.urdf_limits[model.arms[1].range().start + 4].q_max, "3.14".parse().unwrap());
    let half = toml.replacen("position_max_rad = 3.14 ", "# ", 1);
    assert!(with_capsule(&half, &urdf).unwrap_err().to_string().contains("both ends of the range"));
    let none = toml.replace("[supply.port_e]\n", "[supply.port_d]\n");
    assert!(with_capsule(&none, &urdf).unwrap_err().to_string().contains("port_d"));
}

/// A hand of two fingers: the second one stands at -0.5 times the first one's position + 0.01.
fn with_fingers(first: &str) -> String {
    let fingers = format!(
        "<link name=\"f1\"/><joint name=\"f1_slide\" type=\"prismatic\"><parent link=\"port_paddle\"/><child link=\"f1\"/>\
         <axis xyz=\"0 1 0\"/><limit {first} effort=\"1\" velocity=\"1\"/></joint>\
         <link name=\"f2\"/><joint name=\"f2_slide\" type=\"prismatic\"><parent link=\"port_paddle\"/><child link=\"f2\"/>\
         <axis xyz=\"0 1 0\"/><limit lower=\"-0.04\" upper=\"0.04\" effort=\"1\" velocity=\"1\"/>\
         <mimic joint=\"f1_slide\" multiplier=\"-0.5\" offset=\"0.01\"/></joint></robot>"
    );
    HERON.replacen("</robot>", &fingers, 1)
}

#[test]
fn held_follower_stands_where_its_leader_moves_it() {
    for (first, stands) in [("lower=\"0\" upper=\"0.04\"", 0.01), ("lower=\"0.02\" upper=\"0.04\"", 0.0)] {
        let urdf = with_fingers(first);
        let file: toml::Table = drafted(&urdf).parse().unwrap();
        let held = file["held_m"]["f2_slide"].as_float().unwrap();
        assert!((held - stands).abs() < 1e-12, "{first}: {held}");
        let wrong = drafted(&urdf).replace(&format!("f2_slide = {held:?}"), "f2_slide = 0.02");
        let error = with_capsule(&wrong, &urdf).unwrap_err().to_string();
        assert!(error.contains("`f2_slide`: held position = 0.02, must be") && error.contains("`f1_slide`"), "{error}");
    }
}
