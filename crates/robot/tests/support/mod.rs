//! Common parts of this crate's tests.
#![allow(dead_code, unreachable_pub)]

use messages::JOINTS_MAX;
use rand::RngExt;
use robot::{Model, RobotError};

/// Joints of TIAGo++, and of them those of its left and right arm.
pub const JOINTS: usize = 17;
pub const LEFT_ARM: std::ops::Range<usize> = 3..10;
pub const RIGHT_ARM: std::ops::Range<usize> = 10..17;

/// The shipped robot file.
pub const TOML: &str = include_str!("../../../../config/robots/tiago_dual.toml");
/// The shipped URDF.
pub const URDF: &str = include_str!("../../../../config/robots/tiago_dual.urdf");

/// The shipped robot file with grippers.
pub const GRIPPER_TOML: &str = include_str!("../../../../config/robots/tiago_dual_pal_gripper.toml");
/// Its URDF.
pub const GRIPPER_URDF: &str = include_str!("../../../../config/robots/tiago_dual_pal_gripper.urdf");

/// Creates a model from these texts.
pub fn load(toml: &str, urdf: &str) -> Result<Model, RobotError> {
    Model::from_text("tiago_dual.toml", toml, "tiago_dual.urdf", urdf)
}

/// An invented robot with arms named port and starboard.
pub const HERON: &str = include_str!("../../../../docs/robots/heron.urdf");

/// A text with one place changed. The place is the first one after `after`.
pub fn edit(text: &str, after: &str, old: &str, new: &str) -> String {
    let from = text.find(after).unwrap_or_else(|| panic!("{after} is not there"));
    let at = from + text[from..].find(old).unwrap_or_else(|| panic!("{old} is not after {after}"));
    format!("{}{new}{}", &text[..at], &text[at + old.len()..])
}

/// Checks that an error has all of these words.
pub fn assert_words<T>(result: Result<T, RobotError>, words: &[&str]) {
    let error = result.map(|_| ()).expect_err(&format!("must be refused for {words:?}")).to_string();
    for word in words {
        assert!(error.contains(word), "`{word}` is missing in: {error}");
    }
}

/// Removes capsules of a robot file, and the pairs that name them.
pub fn remove_capsules(table: &mut toml::Table, gone: impl Fn(&toml::Value) -> bool) {
    let collision = table["collision"].as_table_mut().unwrap();
    let capsules = collision["capsules"].as_array_mut().unwrap();
    let names: Vec<String> =
        capsules.iter().filter(|one| gone(one)).map(|one| one["name"].as_str().unwrap().to_owned()).collect();
    assert!(!names.is_empty());
    capsules.retain(|capsule| !gone(capsule));
    for (_, pairs) in collision["allowed"].as_table_mut().unwrap() {
        let pairs = pairs.as_table_mut().unwrap();
        pairs.retain(|first, _| !names.iter().any(|name| name == first));
        for (_, others) in pairs {
            others.as_array_mut().unwrap().retain(|second| !names.iter().any(|name| second.as_str() == Some(name)));
        }
    }
}

/// The text of a robot file that calls one more pair of capsules clear.
pub fn with_proved_clear(toml: &str, first: &str, second: &str) -> String {
    let mut table: toml::Table = toml.parse().unwrap();
    let clear = table["collision"]["allowed"]["proved_clear"].as_table_mut().unwrap();
    let others = clear.entry(first).or_insert_with(|| toml::Value::Array(Vec::new()));
    others.as_array_mut().unwrap().push(second.into());
    table.to_string()
}

/// Creates a model from the draft of a URDF, which nothing refuses, with one capsule in place of the fitted ones.
pub fn drafted(urdf: &str) -> Model {
    let draft = robot::draft("r.urdf", urdf).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(draft.refusals, [""; 0]);
    with_capsule(&draft.toml, urdf).unwrap_or_else(|error| panic!("{error}\n{}", draft.toml))
}

/// Creates a model from a draft, with one capsule in place of the fitted ones.
pub fn with_capsule(toml: &str, urdf: &str) -> Result<Model, RobotError> {
    let base = toml.lines().find_map(|line| line.strip_prefix("base_link = ")).unwrap();
    let capsule = format!(
        "[[collision.capsules]]\nname = \"base\"\nlink = {base}\na_m = [0.0, 0.0, 0.0]\nb_m = [0.0, 0.0, 0.1]\n\
         radius_m = 0.05\n\n[collision.allowed]\nadjacent = {{}}\nproved_clear = {{}}\n"
    );
    Model::from_text("r.toml", &format!("{toml}{capsule}"), "r.urdf", urdf)
}

/// The shipped robot.
pub fn shipped() -> Model {
    load(TOML, URDF).unwrap_or_else(|error| panic!("{error}"))
}

/// A configuration that is uniformly distributed within the URDF's limits, rad and m.
pub fn uniform(model: &Model, rng: &mut rand_pcg::Pcg64) -> [f64; JOINTS_MAX] {
    let mut q = [0.0; JOINTS_MAX];
    for (q, limits) in q.iter_mut().zip(&model.urdf_limits).take(model.count) {
        *q = rng.random_range(limits.q_min..limits.q_max);
    }
    q
}
