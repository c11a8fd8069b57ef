//! `--robot` in place of the robot that the settings name.

use config::{ConfigError, Loaded, Overrides, RobotChoice, load, load_robot};
use std::path::{Path, PathBuf};

pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Settings of a folder of its own, with the robots and weights of the repository.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().expect("a folder"));
        for place in ["config/robots", "weights"] {
            std::fs::create_dir_all(folder.path(place)).expect("made");
        }
        for (from, to) in [
            ("config/teleop.toml", "config/teleop.toml"),
            ("config/robots/tiago_dual.toml", "config/robots/tiago_dual.toml"),
            ("config/robots/tiago_dual.urdf", "config/robots/tiago_dual.urdf"),
            ("config/robots/tiago_dual.look.toml", "config/robots/tiago_dual.look.toml"),
            ("config/robots/tiago_dual_pal_gripper.toml", "config/robots/gripper.toml"),
            ("config/robots/tiago_dual_pal_gripper.urdf", "config/robots/tiago_dual_pal_gripper.urdf"),
            ("weights/tiago_dual.toml", "weights/tiago_dual.toml"),
            ("weights/tiago_dual.safetensors", "weights/tiago_dual.safetensors"),
            ("weights/prediction.toml", "weights/prediction.toml"),
            ("weights/prediction.safetensors", "weights/prediction.safetensors"),
            ("weights/lifter.toml", "weights/lifter.toml"),
            ("weights/lifter.safetensors", "weights/lifter.safetensors"),
        ] {
            std::fs::copy(repository().join(from), folder.path(to)).expect(from);
        }
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn load(&self, robot: &str) -> Result<Loaded, ConfigError> {
        load(&self.path("config/teleop.toml"), Overrides::robot(Some(&robot.into())))
    }

    fn copy(&self, from: &str, to: &str, change: impl Fn(String) -> String) {
        let text = std::fs::read_to_string(self.path(from)).expect(from);
        std::fs::write(self.path(to), change(text)).expect(to);
    }
}

#[test]
fn chosen_robot_replaces_the_robot_of_the_settings() {
    let folder = Folder::new();
    let own = load(&folder.path("config/teleop.toml"), Overrides::default()).expect("loads");
    let chosen = folder.load("gripper").expect("loads");
    assert!(chosen.model.texts.urdf_name.ends_with("pal_gripper.urdf"), "{}", chosen.model.texts.urdf_name);
    assert!(chosen.robot_file().ends_with("config/robots/gripper.toml"), "{:?}", chosen.robot_file());
    assert_ne!(own.hash, chosen.hash, "processes with different robots cannot engage");
    assert_eq!(own.model.obstacles.len(), chosen.model.obstacles.len(), "the surroundings are those of the settings");
    // The same arms, so the weights of the settings serve.
    assert!(chosen.weights.is_some() && chosen.settings.weights.file == own.settings.weights.file);
    // A file gives the same robot, wherever the settings are.
    let file = folder.path("config/robots/gripper.toml").display().to_string();
    assert_eq!(folder.load(&file).expect("loads").hash, chosen.hash);
}

#[test]
fn chosen_robot_has_the_weights_of_its_name() {
    let folder = Folder::new();
    folder.copy("weights/tiago_dual.toml", "weights/gripper.toml", |text| format!("# Its own.\n{text}"));
    std::fs::copy(folder.path("weights/tiago_dual.safetensors"), folder.path("weights/gripper.safetensors")).unwrap();
    let chosen = folder.load("gripper").expect("loads");
    assert!(chosen.files.iter().any(|file| file.ends_with("weights/gripper.safetensors")), "{:?}", chosen.files);
    assert!(chosen.settings.weights.file.ends_with("weights/gripper"), "{}", chosen.settings.weights.file);
    std::fs::write(folder.path("weights/gripper.safetensors"), b"nothing").unwrap();
    let refused = folder.load("gripper").expect_err("the weights of its name are broken").to_string();
    assert!(refused.contains("gripper.safetensors") && refused.contains("sha256"), "{refused}");
}

#[test]
fn robot_without_weights_moves_by_the_closed_form() {
    let folder = Folder::new();
    // Another reference posture is another arm for the weights.
    folder.copy("config/robots/tiago_dual.toml", "config/robots/other.toml", |text| {
        let (before, after) = text.split_once("reference_rad = [").expect("two arms");
        let changed = |text: &str| text.replacen("0.0", "0.25", 1);
        let (middle, last) = after.split_once("reference_rad = [").expect("two arms");
        format!("{before}reference_rad = [{}reference_rad = [{}", changed(middle), changed(last))
    });
    let untrained = folder.load("other").expect("no weights fit, and none are needed");
    assert!(untrained.weights.is_none() && untrained.settings.retarget.method == config::Method::ClosedForm);
    let config = folder.path("config/teleop.toml");
    let robot = RobotChoice::from("other");
    let (_, model) = load_robot(&config, &Overrides::robot(Some(&robot))).expect("needs no weights");
    assert_eq!(model.arms[0].reference, model.arms[1].reference);
    folder.copy("config/teleop.toml", "config/teleop.toml", |text| {
        text.replace("method = \"network\"", "method = \"closed-form\"")
    });
    assert!(folder.load("other").expect("needs no weights").weights.is_none());
}

#[test]
fn unknown_robot_is_refused_with_names_of_the_others() {
    let folder = Folder::new();
    let refused = folder.load("nobody").expect_err("there is none").to_string();
    let robots = folder.path("config/robots").display().to_string();
    for part in ["--robot nobody", robots.as_str(), "it has gripper, tiago_dual"] {
        assert!(refused.contains(part), "{part}: {refused}");
    }
    assert!(!refused.contains("look"), "{refused}");
    // A value with a slash is a file, which is not searched.
    let refused = folder.load("./nobody").expect_err("there is none").to_string();
    assert!(refused.contains("nobody") && refused.contains("no such file"), "{refused}");
    assert!(!refused.contains("it has"), "{refused}");
}

#[test]
fn urdf_in_place_of_a_robot_file_is_told_apart() {
    let urdf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/unitree_g1.urdf");
    let urdf = urdf.to_str().expect("UTF-8");
    let refused = Folder::new().load(urdf).expect_err("a URDF").to_string();
    assert!(refused.contains(&format!("`teleopd robot new {urdf}`")), "{refused}");
    // A URDF in the current folder is a file too, not the name of a robot.
    assert_eq!(RobotChoice::from("x.urdf").shipped_file().expect("a file"), Path::new("x.urdf"));
}

#[test]
fn program_without_settings_finds_robots_of_the_repository() {
    let refused = RobotChoice::from("nobody").shipped_file().expect_err("there is none").to_string();
    assert!(refused.contains("config/robots"), "{refused}");
    assert_eq!(RobotChoice::from("a/b.toml").shipped_file().expect("a file"), Path::new("a/b.toml"));
    assert_eq!(RobotChoice::from("a/b.toml").name(), "b");
    assert_eq!(RobotChoice::from("nobody").shipped_weights(), Path::new("weights/tiago_dual"));
}
