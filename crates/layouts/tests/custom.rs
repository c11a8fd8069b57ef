//! Layouts from files.

use crate::client::{Client, Turn, accept, as_smpl, axes, bent, judge, limbs_differ};
use crate::frames::all_axes;
use crate::golden::FLOAT_ERROR;
use Direction::{Back, Down, Left, Right, Up};
use layouts::{Direction, Layouts, Map};
use messages::{SMPL_NAMES, SkeletonLayout};
use std::collections::HashMap;

/// A file of SMPL-22 joints in any axes.
fn text(directions: [Direction; 3], handedness: &str, unit: &str, order: &str) -> String {
    let [x, y, z] = directions.map(|direction| format!("{direction:?}").to_lowercase());
    let rows = SMPL_NAMES.iter().enumerate();
    let rows: String =
        rows.map(|(i, name)| format!("{{ name = \"{name}\", index = {i}, is = \"{name}\" }}, ")).collect();
    format!(
        "format = 1\nname = \"mine\"\nnumber = 1234\njoints = 22\nx = \"{x}\"\ny = \"{y}\"\nz = \"{z}\"\n\
         handedness = \"{handedness}\"\nunit = \"{unit}\"\nsends = \"global-rotations\"\nquaternions = \"{order}\"\n\
         confidence_max = 100.0\ncamera = false\njoint = [{rows}]\n"
    )
}

fn good() -> String {
    text([Left, Up, Direction::Forward], "right", "m", "xyzw")
}

fn with(file: &str, text: &str) -> Layouts {
    let mut layouts = Layouts::default();
    layouts.add(file, Map::parse(file, text).unwrap_or_else(|error| panic!("{error}"))).expect("a number of its own");
    layouts
}

#[test]
fn axes_in_every_unit_convert_right_or_are_refused() {
    let truth = judge(&as_smpl(&bent(), true)).expect("a person");
    let (smpl, mut right, mut refused) = (SMPL_NAMES.join(" "), 0, 0);
    for directions in all_axes() {
        let axes = axes(directions);
        for (unit, units_per_m) in [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)] {
            for (handedness, sign) in [("right", 1.0), ("left", -1.0)] {
                for (order, w_first) in [("xyzw", false), ("wxyz", true)] {
                    let text = text(directions, handedness, unit, order);
                    if axes.determinant() * sign < 0.0 {
                        let message = Map::parse("mine.toml", &text).expect_err("not such axes").to_string();
                        assert!(message.contains("mine.toml: handedness = "), "{message}");
                        assert!(message.contains("determinant"), "{message}");
                        refused += 1;
                        continue;
                    }
                    let client = Client::new(SkeletonLayout::Smpl22, &smpl, &smpl, directions);
                    let client = Client { number: 1234, units_per_m, w_first, confidence: 90.0, ..client };
                    let layouts = with("mine.toml", &text);
                    let accepted = accept(&layouts, &client.send(&bent(), Turn::identity()));
                    let off = limbs_differ(&accepted.unwrap_or_else(|why| panic!("{directions:?} {why:?}")), &truth);
                    assert!(off < FLOAT_ERROR, "{directions:?} {unit} {order}: {off}");
                    right += 1;
                }
            }
        }
    }
    assert_eq!((right, refused), (48 * 3 * 2, 48 * 3 * 2));
}

/// The change of the file, and the words that the error must contain.
#[test]
fn f097_wrong_value_error_names_file_key_value_and_bound() {
    Map::parse("mine.toml", &good()).expect("good");
    let tables: HashMap<String, Vec<[String; 3]>> = toml::from_str(include_str!("refusals.toml")).expect("the tables");
    for [from, to, named] in &tables["changes"] {
        assert!(good().contains(from), "{from}");
        let message = Map::parse("mine.toml", &good().replacen(from, to, 1)).expect_err(to).to_string();
        assert!(message.starts_with("mine.toml: ") && message.contains(named), "{to}: {message}");
    }
}

#[test]
fn parents_in_cycle_or_unknown_are_refused() {
    let text = include_str!("../../../config/skeletons/smpl_y_up.toml");
    let child = "is = \"left_elbow\", parent = \"left_shoulder\"";
    assert!(text.contains(child));
    for (parent, named) in [("left_wrist", "cycle"), ("left_elbow", "cycle"), ("nobody", "parent = \"nobody\"")] {
        let text = text.replace(child, &format!("is = \"left_elbow\", parent = \"{parent}\""));
        let message = Map::parse("mine.toml", &text).expect_err(parent).to_string();
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn second_layout_with_same_number_is_refused() {
    let mut layouts = with("mine.toml", &good());
    let message = layouts.add("yours.toml", Map::parse("yours.toml", &good()).expect("good")).expect_err("taken");
    assert_eq!(message.to_string(), "yours.toml: number = 1234 must be unique: mine has it already");
}

/// A client of a shipped file. Joints without a name are NaN.
fn shipped(number: u32, joints: usize, places: &[(&'static str, usize)], directions: [Direction; 3]) -> Client {
    let name = |index: usize| places.iter().find(|place| place.1 == index).map_or("?", |place| place.0);
    let known = |name: &'static str| if places.iter().any(|place| place.0 == name) { name } else { "-" };
    let joints: Vec<_> = (0..joints).map(name).collect();
    let names = SMPL_NAMES.map(known).join(" ");
    let client = Client::new(SkeletonLayout::Smpl22, &joints.join(" "), &names, directions);
    Client { number, rotations: false, ..client }
}

const ARMS: [&str; 6] = ["left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"];

#[test]
fn zed_file_gives_same_limbs_as_smpl_22() {
    let layouts = with("zed_body_38.toml", include_str!("../../../config/skeletons/zed_body_38.toml"));
    let mut places: Vec<_> = ARMS.into_iter().zip(12..).collect();
    places.extend(
        ["left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"].into_iter().zip(18..),
    );
    places.extend([("left_foot", 24), ("right_foot", 25), ("pelvis", 0), ("spine1", 1), ("spine2", 2), ("spine3", 3)]);
    places.extend([("neck", 4), ("left_collar", 10), ("right_collar", 11)]);
    let client = shipped(1038, 38, &places, [Left, Down, Back]);
    let client = Client { units_per_m: 1000.0, confidence: 80.0, ..client };
    let mut raw = client.send(&bent(), Turn::identity());
    (raw.confidence[8], raw.confidence[9]) = (0.0, 0.0); // The ears are hidden.
    let accepted = accept(&layouts, &raw).expect("a person");
    let off = limbs_differ(&accepted, &judge(&as_smpl(&bent(), false)).expect("a person"));
    assert!(off < FLOAT_ERROR, "{off}");
}

/// It has no hips, so the trunk ends at the pelvis. The limbs are those of a person whose hips are beside it.
#[test]
fn quest_file_without_legs_gives_same_limbs_as_smpl_22() {
    let layouts = with("openxr_fb_70.toml", include_str!("../../../config/skeletons/openxr_fb_70.toml"));
    let mut places: Vec<_> = ARMS.into_iter().zip([10, 15, 11, 16, 19, 45]).collect();
    places.extend([("pelvis", 1), ("spine1", 2), ("spine2", 3), ("spine3", 5), ("neck", 6), ("head", 7)]);
    places.extend([("left_collar", 8), ("right_collar", 13)]);
    let client = Client { rotations: true, ..shipped(1070, 70, &places, [Right, Up, Back]) };
    let accepted = accept(&layouts, &client.send(&bent(), Turn::identity())).expect("a person");
    let mut person = bent();
    person.places[1] = person.places[0] + nalgebra::Vector3::new(0.0, 0.74 * 0.18, 0.0);
    person.places[2] = person.places[0] - nalgebra::Vector3::new(0.0, 0.74 * 0.18, 0.0);
    let off = limbs_differ(&accepted, &judge(&as_smpl(&person, true)).expect("a person"));
    assert!(off < FLOAT_ERROR, "{off}");
    assert!((accepted.positions[1][1] - 0.74 * 0.18).abs() < 1e-6);
}
