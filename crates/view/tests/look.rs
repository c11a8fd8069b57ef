//! Tests the allowed values of a look file and the errors for wrong ones.

use crate::frames::{loaded, model};
use std::collections::HashMap;
use view::{Look, MeshFolder, RobotView, Shape};

fn error(text: &str) -> String {
    let text = format!("format = 1\n{text}");
    Look::parse("robot.look.toml", &text, &model()).expect_err("it is wrong").to_string()
}

fn part(shape: &str) -> String {
    format!("[[parts]]\nlink = \"base_link\"\ncolour = \"#ffffff\"\nshape = {shape}\n")
}

#[test]
fn shipped_looks_cover_every_body_and_keep_hash() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots");
    for name in ["tiago_dual", "tiago_dual_pal_gripper"] {
        let file = folder.join(format!("{name}.toml"));
        let (model, _) = config::load_model(&file).expect("the shipped robot");
        let look = Look::read(&file, &model).expect("the shipped look");
        let bodies: std::collections::BTreeSet<usize> = look.parts.iter().map(|part| part.body).collect();
        // Every joint moves at least one shape, also the head's first joint, which turns a link of its own.
        assert_eq!(bodies.len(), model.count + 1, "{name}: {bodies:?}");
        assert!(look.capsules.iter().all(Option::is_some), "{name}: a capsule without a colour");
        assert!(look.meshes.len() > 20, "{name}: {} meshes", look.meshes.len());
    }
    let (with, without) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for (target, endings) in [(&with, vec!["toml", "urdf", "look.toml"]), (&without, vec!["toml", "urdf"])] {
        for ending in endings {
            let name = format!("tiago_dual.{ending}");
            std::fs::copy(folder.join(&name), target.path().join(&name)).unwrap();
        }
    }
    let hash = |folder: &tempfile::TempDir| {
        let file = folder.path().join("tiago_dual.toml");
        let (model, _) = config::load_model(&file).expect("a robot");
        (model.hash, Look::read(&file, &model).expect("a look or none").parts.len())
    };
    let ((with_hash, parts), (without_hash, none)) = (hash(&with), hash(&without));
    assert_eq!(with_hash, without_hash, "a look is no part of the robot");
    assert!(parts > 50 && none == 0, "{parts} parts and {none}");
}

#[test]
fn look_error_names_file_key_value_and_bound() {
    type Rows = Vec<(String, Vec<String>)>;
    let mut tables: HashMap<String, Rows> = toml::from_str(include_str!("look_refusals.toml")).expect("the tables");
    let [texts, shapes] = ["texts", "shapes"].map(|name| tables.remove(name).expect("a table"));
    let parts = shapes.into_iter().map(|(shape, words)| (part(&shape), words));
    for (text, parts) in texts.into_iter().chain(parts) {
        let error = error(&text);
        assert!(error.starts_with("robot.look.toml: "), "{text}: {error}");
        for part in parts {
            assert!(error.contains(&part), "{text}: {part} is not in: {error}");
        }
    }
    let wrong_format = Look::parse("robot.look.toml", "format = 2", &model()).expect_err("a later format").to_string();
    assert_eq!(wrong_format, "robot.look.toml: format = 2, must be 1");
}

#[test]
fn mirror_adds_part_on_other_link() {
    let text =
        "[colours]\nwhite = \"#f0f1f2\"\n[[parts]]\nlink = \"arm_left_4_link\"\nshape = \"capsule\"\ncolour = \"white\"
        a_m = [0.0, 0.0, 0.0]\nb_m = [0.1, 0.0, 0.0]\nradius_m = 0.05\nxyz_m = [0.1, 0.2, 0.3]
        mirror = { link = \"arm_right_4_link\", axes = \"xz\" }";
    let model = model();
    let look = Look::parse("robot.look.toml", &format!("format = 1\n{text}"), &model).expect("a look");
    let [left, right] = look.parts.as_slice() else { panic!("{} parts", look.parts.len()) };
    assert_eq!((left.link.as_str(), right.link.as_str()), ("arm_left_4_link", "arm_right_4_link"));
    assert_eq!((left.colour.text(), right.body), ("#f0f1f2".to_owned(), model.arms[1].elbow() + 1));
    let (a, b) = (left.body_from_shape, right.body_from_shape);
    // Both links coincide with their bodies' frames, so the mirror changes the signs of the rows x and z.
    for row in 0..3 {
        let sign = if row == 1 { 1.0 } else { -1.0 };
        for column in 0..4 {
            assert!((b[row][column] - sign * a[row][column]).abs() < 1e-12, "{a:?} {b:?}");
        }
    }
    assert!(matches!(right.shape, Shape::Capsule { radius_m: 0.05, top_radius_m: 0.05, .. }));
}

#[test]
fn meshes_of_look_are_found_or_named_as_missing() {
    let (loaded, folder) = (loaded(), tempfile::tempdir().unwrap());
    let error = RobotView::load(&loaded, Some(folder.path())).expect_err("nothing is there").to_string();
    assert!(error.contains("none of the robot's mesh files is below it"), "{error}");
    let arm = folder.path().join("description/meshes/arm");
    std::fs::create_dir_all(&arm).unwrap();
    // The maker's file for drawing is missing. Its file for collisions exists.
    std::fs::write(arm.join("arm_1_collision.dae"), "<COLLADA/>").unwrap();
    let view = RobotView::load(&loaded, Some(folder.path())).expect("one mesh");
    let drawn: Vec<_> = view.meshes.iter().map(|mesh| (mesh.link.as_str(), mesh.file.as_str())).collect();
    let file = "description/meshes/arm/arm_1_collision.dae";
    assert_eq!(drawn, [("arm_left_1_link", file), ("arm_right_1_link", file)]);
    assert!(view.missing.iter().any(|name| name.ends_with("arm_2.stl")), "{:?}", view.missing);
    assert_eq!(
        MeshFolder::open(folder.path()).unwrap().find("package://any/arm_1_collision.dae").as_deref(),
        Some(file)
    );
}

/// A robot without a look, whose URDF names no meshes.
#[test]
fn meshes_with_names_of_links_are_found() {
    let (folder, meshes) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let robots = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots");
    for name in ["tiago_dual.toml", "tiago_dual.urdf"] {
        std::fs::copy(robots.join(name), folder.path().join(name)).unwrap();
    }
    let file = folder.path().join("tiago_dual.toml").display().to_string();
    let overrides = config::Overrides::robot(Some(&file.as_str().into()));
    let loaded = config::load(&robots.join("../teleop.toml"), overrides).expect("settings");
    let error = RobotView::load(&loaded, Some(meshes.path())).expect_err("nothing is there").to_string();
    assert!(error.contains("no file below it has the name of a link"), "{error}");
    std::fs::create_dir(meshes.path().join("visual")).unwrap();
    for name in ["visual/arm_left_4_link.STL", "arm_left_4.STL", "arm_left_4_link.txt"] {
        std::fs::write(meshes.path().join(name), "solid").unwrap();
    }
    let view = RobotView::load(&loaded, Some(meshes.path())).expect("one mesh");
    let [mesh] = view.meshes.as_slice() else { panic!("{:?}", view.meshes) };
    assert_eq!((mesh.link.as_str(), mesh.file.as_str()), ("arm_left_4_link", "visual/arm_left_4_link.STL"));
    assert_eq!(mesh.body, loaded.model.arms[0].elbow() + 1);
    assert!(view.missing.is_empty(), "{:?}", view.missing);
}
