//! Files that do not describe a robot are refused, and the error names file, key and value. Valid variants are read.

use crate::support::{HANDS, body};
use plant::{Body, PlantError};
use std::collections::HashMap;

/// The joint that the robot file tightens.
const TIGHTENED: &str = "[tighten.head_2_joint]";

/// The table of that joint, with a speed of its own, rad/s.
fn faster(speed: &str) -> String {
    format!("{TIGHTENED}\nvelocity_max_rad_per_s = {speed}")
}

/// Reads the shipped robot with `from` replaced by `to` in the robot file or in the URDF, in every place.
fn changed(from: &str, to: &str) -> Result<Body, PlantError> {
    let [toml_name, toml, urdf_name, urdf] = HANDS;
    assert!(toml.contains(from) || urdf.contains(from), "{from} stands in no file");
    Body::from_text(toml_name, &toml.replace(from, to), urdf_name, &urdf.replace(from, to))
}

#[test]
fn wrong_robot_files_are_refused_with_file_and_key() {
    let tables: HashMap<String, Vec<[String; 3]>> = toml::from_str(include_str!("refusals.toml")).unwrap();
    for [from, to, expected] in &tables["changes"] {
        let error = match changed(from, to) {
            Ok(_) => panic!("{to} was read"),
            Err(error) => error.to_string(),
        };
        assert!(error.contains(expected) && error.contains("tiago_dual."), "{to}: {error}");
    }
}

#[test]
fn override_never_loosens_urdf_limit() {
    let speed = |speed| changed(TIGHTENED, &faster(speed)).unwrap().joints[2].limits.v_max;
    assert_eq!((speed("9.0"), speed("2.5")), (3.0, 2.5));
}

#[test]
fn friction_of_urdf_is_read() {
    let text = "<limit lower=\"0\" upper=\"0.35\" velocity=\"0.07\" effort=\"2000\"/>";
    let rough = changed(text, &format!("{text}<dynamics damping=\"7.5\" friction=\"3\"/>")).unwrap();
    assert_eq!((rough.joints[0].damping, rough.joints[0].friction), (Some(7.5), Some(3.0)));
    assert_eq!(body(HANDS).joints[0].damping, None);
}

/// An antenna on a hinge that is not commanded stands where the file holds it. It may not mimic a joint that moves.
#[test]
fn held_and_mimic_joints_keep_their_positions() {
    let [_, toml, _, urdf] = HANDS;
    let hinge = |extra: &str, at: &str| {
        let fixed = "<joint name=\"base_antenna_left_joint\" type=\"fixed\">";
        assert!(urdf.contains(fixed));
        let urdf = urdf.replace(
            fixed,
            &format!("<joint name=\"base_antenna_left_joint\" type=\"revolute\"><axis xyz=\"0 0 1\"/>{extra}"),
        );
        let urdf = urdf.replace(
            "<joint name=\"base_antenna_right_joint\" type=\"fixed\">",
            "<joint name=\"base_antenna_right_joint\" type=\"revolute\">",
        );
        let held = format!("[held_rad]\nbase_antenna_left_joint = {at}\nbase_antenna_right_joint = 0.0\n\n[arms.left]");
        Body::from_text("r.toml", &toml.replace("[arms.left]", &held), "r.urdf", &urdf)
    };
    let plain = body(HANDS).link("base_antenna_left_link").unwrap();
    assert_eq!(hinge("", "0.0").unwrap().link("base_antenna_left_link").unwrap(), plain);
    let turned = hinge("", "0.5").unwrap().link("base_antenna_left_link").unwrap();
    let angle = (plain.1.r.transpose() * turned.1.r)[(1, 0)].asin();
    assert!((angle - 0.5).abs() < 1e-12, "{angle}");
    assert!(hinge("", "nan").is_err());
    let error = hinge("<mimic joint=\"head_1_joint\"/>", "0.0").expect_err("it would move").to_string();
    assert!(error.contains("must not follow a commanded joint"), "{error}");
}
