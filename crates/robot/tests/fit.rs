//! The record of a fit: a start believes a robot file only as it was proved.

use crate::support::{TOML, URDF, load, remove_capsules, shipped, with_proved_clear};

fn edited(toml: &str, urdf: &str) -> String {
    load(toml, urdf).unwrap().check_fit().expect_err("edited after the fit").to_string()
}

/// The shipped robot file after a change of its table.
fn changed(change: impl Fn(&mut toml::Table)) -> String {
    let mut table: toml::Table = TOML.parse().unwrap();
    change(&mut table);
    table.to_string()
}

#[test]
fn thinner_capsules_are_refused_with_file_key_and_command() {
    let thin = changed(|table| {
        for capsule in table["collision"]["capsules"].as_array_mut().unwrap() {
            let radius_m = capsule["radius_m"].as_float().unwrap();
            capsule.as_table_mut().unwrap()["radius_m"] = (0.3 * radius_m).into();
        }
    });
    let error = edited(&thin, URDF);
    for word in
        ["tiago_dual.toml: collision.capsules: edited after the fit", "`collision check --sign`", "`collision fit`"]
    {
        assert!(error.contains(word), "{word}: {error}");
    }
}

#[test]
fn hand_without_its_capsules_is_refused() {
    let gone = |capsule: &toml::Value| capsule["name"].as_str().unwrap().starts_with("hand_left");
    let handless = changed(|table| remove_capsules(table, gone));
    assert!(edited(&handless, URDF).contains("collision.capsules"));
}

#[test]
fn pair_left_out_since_the_fit_is_refused() {
    let more = with_proved_clear(TOML, "hand_left_0", "hand_right_0");
    assert!(edited(&more, URDF).contains("tiago_dual.toml: collision.allowed"));
}

#[test]
fn lighter_links_are_refused_with_the_urdf() {
    let light = URDF.replace("<mass value=\"14.0136\"", "<mass value=\"1.40136\"");
    assert_ne!(light, URDF);
    assert!(edited(TOML, &light).contains("tiago_dual.urdf: its text: edited after the fit"));
}

#[test]
fn range_may_only_be_narrower_than_the_proved_one() {
    let margin = "soft_margin_rad = 0.02";
    assert!(TOML.contains(margin));
    let error = edited(&TOML.replace(margin, "soft_margin_rad = 0.01"), URDF);
    let joint = "joint `arm_left_1_joint`: lowest position in force = -1.168";
    for word in ["tiago_dual.toml", joint, "pairs were proved for -1.158", "`collision fit`"] {
        assert!(error.contains(word), "{word}: {error}");
    }
    load(&TOML.replace(margin, "soft_margin_rad = 0.03"), URDF).unwrap().check_fit().expect("a subset is proved too");
}

#[test]
fn file_without_record_is_hand_made_and_loads_with_a_doubt() {
    shipped().check_fit().expect("signed by the tool");
    assert_eq!(shipped().doubts(), Vec::<String>::new());
    let unsigned = changed(|table| drop(table["collision"].as_table_mut().unwrap().remove("fit")));
    let model = load(&unsigned, URDF).unwrap();
    model.check_fit().expect("hand-made");
    assert!(model.doubts()[0].contains("hand-made"), "{:?}", model.doubts());
    let again = load(&model.signed().unwrap(), URDF).unwrap();
    again.check_fit().expect("signed");
    assert_eq!(again.signed().unwrap(), again.texts.toml, "a second record replaces the first");
}

#[test]
fn moving_link_without_capsule_is_a_doubt() {
    let gone = |capsule: &toml::Value| capsule["link"].as_str().unwrap() == "arm_left_5_link";
    let bare = changed(|table| remove_capsules(table, gone));
    let doubts = load(&bare, URDF).unwrap().doubts().join("\n");
    assert!(doubts.contains("no capsule moves with arm_left_5_link"), "{doubts}");
}

#[test]
fn pair_that_is_apart_somewhere_does_not_overlap_as_published() {
    let listed = changed(|table| {
        let collision = table["collision"].as_table_mut().unwrap();
        collision.remove("fit");
        let pairs = toml::Table::from_iter([("hand_left_0".to_owned(), toml::Value::from(vec!["hand_right_0"]))]);
        collision["allowed"].as_table_mut().unwrap().insert("overlap_as_published".into(), pairs.into());
    });
    let model = load(&listed, URDF).unwrap();
    let error = model.check_proved_clear(64).expect_err("hands are apart").to_string();
    for part in ["overlap_as_published: `hand_left_0` and `hand_right_0`", "joints between them", "collision fit"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn record_is_replaced_only_where_it_is_the_last() {
    let signed = load(&changed(|table| drop(table["collision"].as_table_mut().unwrap().remove("fit"))), URDF).unwrap();
    let signed = signed.signed().unwrap();
    let slow = "\n[tighten.arm_left_1_joint]\nvelocity_max_rad_per_s = 0.1\n\
                \n[tighten.arm_right_1_joint]\nvelocity_max_rad_per_s = 0.1\n";
    let below = load(&format!("{signed}{slow}"), URDF).unwrap().signed().expect_err("limits below the record");
    assert!(below.to_string().contains("[collision.fit] = in another place"), "{below}");
    let unmarked: String =
        signed.lines().filter(|line| !line.starts_with("# What")).map(|l| format!("{l}\n")).collect();
    assert!(load(&unmarked, URDF).unwrap().signed().is_err(), "a record without its comment");
}
