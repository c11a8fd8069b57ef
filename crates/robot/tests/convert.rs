//! Tests the conversion of robot files of format 1.

use crate::support::{GRIPPER_TOML, GRIPPER_URDF, TOML, URDF, load};
use robot::{Model, convert};

/// The beginning of a robot file of format 1.
const HEAD: &str = include_str!("data/format_1_head.toml");

/// The shipped robot in format 1: its head, and everything that both formats share.
fn format_1(toml: &str) -> String {
    let from = |key: &str| toml.find(key).unwrap_or_else(|| panic!("{key}"));
    format!("{HEAD}{}", &toml[from("[tighten.head_2_joint]")..])
}

#[test]
fn converted_file_describes_the_same_robot() {
    for (toml, urdf) in [(TOML, URDF), (GRIPPER_TOML, GRIPPER_URDF)] {
        let converted = convert("old.toml", &format_1(toml)).unwrap();
        let model = Model::from_text("new.toml", &converted, "r.urdf", urdf).unwrap_or_else(|e| panic!("{e}"));
        let shipped = load(toml, urdf).unwrap();
        assert_eq!((model.limits, model.home, model.arms), (shipped.limits, shipped.home, shipped.arms));
        assert_eq!((&model.joint_names, &model.pairs), (&shipped.joint_names, &shipped.pairs));
    }
}

#[test]
fn other_texts_are_refused_with_the_key() {
    let refused = |text: &str, words: &str| {
        let error = convert("old.toml", text).unwrap_err().to_string();
        assert!(error.contains("old.toml") && error.contains(words), "{words}: {error}");
    };
    refused(TOML, "format = 2");
    refused("name = \"x\"", "format");
    refused("format = 1 = 2", "old.toml");
    for key in ["[joints]", "head_2 = ", "[limbs.left]", "[limits.head]", "held_joints = "] {
        let text = format_1(TOML).replacen(key, &key.replace(['h', 'l', 'j'], "x"), 1);
        assert!(convert("old.toml", &text).and_then(|text| load(&text, URDF)).is_err(), "{key}");
    }
}
