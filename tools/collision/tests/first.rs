//! The first plan: what it groups, cuts and calls close, on small robots of boxes.

use collision::check::sticks_out_m;
use collision::first::{First, first_plan};
use collision::fit::Shape;
use collision::plan::{Group, Plan};
use collision::scene::{Posture, Scene};
use collision::split::Splitter;
use collision::write::{bare_model, fit_all, robot_file, tightened};
use nalgebra::Vector3;
use robot::{AllowedReason, Model};

pub const TOML: &str = include_str!("../../../config/robots/openarm_v10.toml");
pub const URDF: &str = include_str!("../../../config/robots/openarm_v10.urdf");

/// Returns the shipped URDF with these collision elements of links.
pub fn shaped(shapes: &[(&str, &str)]) -> urdf_rs::Robot {
    let mut text = URDF.to_owned();
    for (link, shape) in shapes {
        let (open, empty) = (format!("<link name=\"{link}\">"), format!("<link name=\"{link}\"/>"));
        let with = format!("<link name=\"{link}\">{shape}");
        let before = text.clone();
        text = text.replace(&empty, &format!("{with}</link>")).replace(&open, &with);
        assert_ne!(before, text, "{link}");
    }
    urdf_rs::read_from_string(&text).unwrap()
}

pub fn cuboid(size: &str, at: &str) -> String {
    format!("<collision><origin xyz=\"{at}\"/><geometry><box size=\"{size}\"/></geometry></collision>")
}

fn plan_of(robot: &urdf_rs::Robot) -> (Model, First) {
    let model = bare_model("openarm_body_link0", ("toml", TOML), ("urdf", URDF)).unwrap();
    let first = first_plan(&model, robot, None, &Posture::new()).unwrap();
    (model, first)
}

fn group<'a>(plan: &'a Plan, name: &str) -> &'a Group {
    plan.groups.iter().find(|group| group.name == name).unwrap_or_else(|| panic!("{name}"))
}

#[test]
fn fat_link_is_cut_and_slim_one_is_not() {
    // A right angle of two bars, and one bar.
    let angle = cuboid("0.3 0.04 0.04", "0.15 0 0") + &cuboid("0.04 0.04 0.3", "0.3 0 0.15");
    let robot = shaped(&[("openarm_body_link0", &angle), ("openarm_left_link5", &cuboid("0.03 0.03 0.2", "0 0 0"))]);
    let (_, first) = plan_of(&robot);
    assert!(group(&first.plan, "openarm_body_link0").capsules > 1);
    assert_eq!(group(&first.plan, "openarm_left_link5").capsules, 1);
}

#[test]
fn links_of_one_body_merge_only_if_that_costs_little() {
    let small = cuboid("0.02 0.02 0.02", "0 0 0");
    let robot = shaped(&[
        ("world", &cuboid("0.1 0.1 1.0", "0 0 0.5")),
        ("openarm_body_link0", &cuboid("0.02 0.02 0.02", "0 0 0.3")),
        ("openarm_left_link0", &cuboid("0.1 0.1 0.1", "0 0 -0.6")),
        ("openarm_left_link7", &small),
    ]);
    let (_, first) = plan_of(&robot);
    let links: Vec<&str> = group(&first.plan, "world").parts.iter().map(|part| part.link.as_str()).collect();
    assert_eq!(links, ["world", "openarm_body_link0"]);
    // A link far away keeps its own capsule. Nothing is mirrored.
    assert_eq!(group(&first.plan, "openarm_left_link0").parts.len(), 1);
    assert!(!first.plan.text().contains("{side}"));
}

#[test]
fn hand_contains_its_fingers_over_their_range() {
    let robot = shaped(&[
        ("openarm_left_hand", &cuboid("0.05 0.05 0.05", "0 0 0")),
        ("openarm_left_left_finger", &cuboid("0.02 0.02 0.02", "0 0 0")),
    ]);
    let (model, First { plan, .. }) = plan_of(&robot);
    assert!(plan.groups.iter().all(|group| group.name != "openarm_left_left_finger"));
    assert!(group(&plan, "openarm_left_hand").parts[0].below && !plan.fingers.is_empty());
    let scene = Scene::new(&robot, None, &plan.fingers);
    let capsules = fit_all(&plan, &scene).unwrap();
    let finger = robot.joints.iter().find(|joint| joint.name == "openarm_left_finger_joint2").unwrap();
    let hand = scene.pose("openarm_left_hand", "openarm_left_left_finger", &Posture::new()).unwrap();
    let axis = nalgebra::Vector3::from(*finger.axis.xyz);
    for q in [finger.limit.lower, finger.limit.upper] {
        let tip = hand.t + axis * q;
        let out = capsules.iter().filter(|c| c.link == "openarm_left_hand").map(|c| c.shape.outside_m(&tip));
        assert!(out.fold(f64::INFINITY, f64::min) < -0.01, "{q}");
    }
    assert!(model.link_body("openarm_left_left_finger").is_some());
}

/// A cube turns about the crossing of the wrist's two axes. Its corners reach 17.3 mm. A plate of the forearm ends below
/// it, at this distance from the crossing.
fn wrist(plate_m: f64) -> (urdf_rs::Robot, First) {
    let plate = cuboid("0.04 0.04 0.01", &format!("0 0 {}", 0.1205 - plate_m - 0.005));
    let cube = cuboid("0.02 0.02 0.02", "0 0 0");
    let robot = shaped(&[("openarm_left_link5", &plate), ("openarm_left_link7", &cube)]);
    let (_, first) = plan_of(&robot);
    (robot, first)
}

#[test]
fn pair_built_closer_than_clearance_is_called_close() {
    let (robot, First { plan, notes, .. }) = wrist(0.0193);
    assert_eq!(plan.close, [["openarm_left_link5".to_owned(), "openarm_left_link7".to_owned()]]);
    assert!(notes[0].contains("in 100 % of all postures") && notes[0].contains("needs no check"), "{notes:?}");
    let capsules = fit_all(&plan, &Scene::new(&robot, None, &plan.fingers)).unwrap();
    let decided = robot_file(&plan, &capsules, ("toml", TOML), ("urdf", URDF)).unwrap();
    let model = Model::from_text("toml", &decided.text, "urdf", URDF).unwrap();
    assert!(model.pairs.is_empty() && model.allowed[0].reason == AllowedReason::ProvedClear, "{:?}", model.allowed);
}

/// Both parts of the wrist fill the crossing of its axes, so they overlap in every posture.
#[test]
fn pair_that_overlaps_in_every_posture_is_listed_as_published() {
    let long = cuboid("0.02 0.02 0.1", "0 0 0.1");
    let robot = shaped(&[("openarm_left_link5", &long), ("openarm_left_link7", &cuboid("0.03 0.03 0.03", "0 0 0"))]);
    let (_, First { plan, .. }) = plan_of(&robot);
    let capsules = fit_all(&plan, &Scene::new(&robot, None, &plan.fingers)).unwrap();
    let text = robot_file(&plan, &capsules, ("toml", TOML), ("urdf", URDF)).unwrap().text;
    let model = Model::from_text("toml", &text, "urdf", URDF).unwrap();
    let reasons: Vec<AllowedReason> = model.allowed.iter().map(|pair| pair.reason).collect();
    assert_eq!(reasons, [AllowedReason::OverlapAsPublished]);
}

#[test]
fn link_without_collision_shape_is_enclosed_as_drawn() {
    let drawn = cuboid("0.05 0.05 0.05", "0 0 0.02").replace("collision", "visual");
    let small = cuboid("0.02 0.02 0.02", "0 0 0");
    let robot = shaped(&[("openarm_left_link3", &drawn), ("openarm_left_link5", &(small + &drawn))]);
    let (_, First { plan, .. }) = plan_of(&robot);
    let capsules = fit_all(&plan, &Scene::new(&robot, None, &plan.fingers)).unwrap();
    let radius_m = |link: &str| capsules.iter().find(|capsule| capsule.link == link).unwrap().shape.radius_m;
    assert!(radius_m("openarm_left_link3") > 0.03 && radius_m("openarm_left_link5") < 0.025);
}

/// A trunk and a bar beside it, 20 mm away. Its one capsule bulges over the bar.
#[test]
fn trunk_is_cut_until_it_is_clear_of_its_neighbour() {
    let robot = shaped(&[("openarm_body_link0", &cuboid("0.2 0.5 0.5", "0 0 0"))]);
    let scene = Scene::new(&robot, None, &[]);
    let matter = scene.matter(&Group::of_link("openarm_body_link0")).unwrap();
    let bar = Shape { a: Vector3::new(0.0, 0.3, -0.2), b: Vector3::new(0.0, 0.3, 0.2), radius_m: 0.03 };
    let mut splitter = Splitter::new(matter.clone(), &[], 0.0);
    let before_m = splitter.cells()[0].shape.clearance_m(&bar);
    assert!(before_m < 0.0, "{before_m}");
    assert!(splitter.cut_away(0, &bar, 6));
    let shapes: Vec<Shape> = splitter.cells().iter().map(|cell| cell.shape).collect();
    let after_m = shapes.iter().map(|shape| shape.clearance_m(&bar)).fold(f64::INFINITY, f64::min);
    assert!(after_m > before_m + 0.01, "{before_m} {after_m}");
    let wider: Vec<Shape> = shapes.iter().map(|s| Shape { radius_m: s.radius_m + 1e-3, ..*s }).collect();
    assert!(sticks_out_m(&matter, &wider) <= 0.0);
    // There is nothing to gain behind it, and no room for more.
    assert!(!Splitter::new(matter, &[], 0.0).cut_away(0, &bar, 1));
}

/// In the ranges as published the parts of the wrist can touch. With the narrower ones they cannot, in either arm.
#[test]
fn pair_that_can_touch_needs_narrower_ranges() {
    let (robot, First { plan, narrowed, .. }) = wrist(0.0165);
    let capsules = fit_all(&plan, &Scene::new(&robot, None, &plan.fingers)).unwrap();
    let refused = |toml: &str| {
        let decided = robot_file(&plan, &capsules, ("toml", toml), ("urdf", URDF)).unwrap();
        assert!(!decided.text.contains("overlap_as_published"));
        Model::from_text("toml", &decided.text, "urdf", URDF).err().map(|error| error.to_string())
    };
    assert!(refused(TOML).unwrap().contains("home: clearance of"));
    let model = bare_model("openarm_body_link0", ("toml", TOML), ("urdf", URDF)).unwrap();
    let mut toml = TOML.to_owned();
    let [left, right] = [0, 1].map(|side| model.arms[side].range());
    for ((l, r), sign) in left.zip(right).zip(model.arms[1].joint_signs()) {
        let ranges = [l, r].map(|j| [narrowed.limits[j].q_min, narrowed.limits[j].q_max]);
        let [low, high] = ranges[0];
        assert_eq!(ranges[1], if sign > 0.0 { [low, high] } else { [-high, -low] });
        for (j, range) in [l, r].into_iter().zip(ranges).filter(|(j, _)| narrowed.limits[*j] != model.limits[*j]) {
            assert!(range[0] < model.home[j] && model.home[j] < range[1] && model.joint_names[j].ends_with(['6', '7']));
            toml = tightened(&toml, &model.joint_names[j], "rad", range);
        }
    }
    assert!(toml.matches("[tighten.").count() >= 2);
    assert_eq!(refused(&toml), None);
}

#[test]
fn plan_read_back_gives_the_same_capsules() {
    let angle = cuboid("0.3 0.04 0.04", "0.15 0 0") + &cuboid("0.04 0.04 0.3", "0.3 0 0.15");
    let robot = shaped(&[("openarm_body_link0", &angle), ("openarm_left_hand", &cuboid("0.05 0.05 0.05", "0 0 0"))]);
    let (_, First { plan, capsules, .. }) = plan_of(&robot);
    let again = Plan::parse("plan", &plan.text()).unwrap();
    let fit = |plan: &Plan| fit_all(plan, &Scene::new(&robot, None, &plan.fingers)).unwrap();
    let (first, second) = (fit(&plan), fit(&again));
    assert!(first.len() > 2 && capsules.len() == first.len());
    for (a, b) in capsules.iter().zip(&first) {
        assert_eq!((&a.name, &a.link, a.shape), (&b.name, &b.link, b.shape));
    }
    for (a, b) in first.iter().zip(&second) {
        assert_eq!((&a.name, &a.link, a.shape), (&b.name, &b.link, b.shape));
    }
    let decided = robot_file(&again, &second, ("toml", TOML), ("urdf", URDF)).unwrap();
    let model = Model::from_text("toml", &decided.text, "urdf", URDF).unwrap();
    assert_eq!(model.capsules.len(), second.len());
    assert!(model.allowed.iter().any(|pair| pair.reason == AllowedReason::SameBody));
}
