//! The page about capsules and meshes: a mesh inside passes, and a capsule that was made too thin is found.

use crate::first::{TOML, URDF, cuboid, shaped as with_shapes};
use collision::cover::{Cover, cover};
use collision::first::first_plan;
use collision::scene::{Posture, Scene};
use collision::write::{bare_model, fit_all, robot_file};
use robot::Model;
use std::path::Path;

const LINK: &str = "openarm_left_link5";
/// A bar of 40 x 40 x 200 mm, m.
const MESH: &str = "v -0.02 -0.02 0\nv 0.02 -0.02 0\nv 0.02 0.02 0\nv -0.02 0.02 0\n\
                    v -0.02 -0.02 0.2\nv 0.02 -0.02 0.2\nv 0.02 0.02 0.2\nv -0.02 0.02 0.2\n\
                    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// Returns the shipped URDF with the mesh on one link, and a box on the body.
fn shaped() -> urdf_rs::Robot {
    let mesh = "<collision><geometry><mesh filename=\"package://any/meshes/bar.obj\"/></geometry></collision>";
    with_shapes(&[(LINK, mesh), ("openarm_body_link0", &cuboid("0.1 0.1 0.1", "0 0 0"))])
}

/// Fits a robot file to the shapes.
fn fitted(urdf: &urdf_rs::Robot, meshes: &Path) -> String {
    let (toml, files) = (("toml", TOML), ("urdf", URDF));
    let model = bare_model("openarm_body_link0", toml, files).unwrap();
    let plan = first_plan(&model, urdf, Some(meshes), &Posture::new()).unwrap().plan;
    let scene = Scene::new(urdf, Some(meshes), &plan.fingers);
    robot_file(&plan, &fit_all(&plan, &scene).unwrap(), toml, files).unwrap().text
}

fn covered(toml: &str, meshes: &Path, without: &[&str]) -> Cover {
    let model = Model::from_text("toml", toml, "urdf", URDF).unwrap();
    let without: Vec<String> = without.iter().map(|link| (*link).to_owned()).collect();
    cover(&model, &shaped(), Some(meshes), &Posture::new(), &without).unwrap()
}

/// Returns the robot file with a capsule whose radius is smaller by `by_m`.
fn thinner(toml: &str, capsule: &str, by_m: f64) -> String {
    let (before, after) = toml.split_once(&format!("name = \"{capsule}\"")).expect("the capsule");
    let (middle, rest) = after.split_once("radius_m = ").expect("a radius");
    let (radius, rest) = rest.split_once('\n').expect("a line");
    let radius_m = radius.parse::<f64>().unwrap() - by_m;
    format!("{before}name = \"{capsule}\"{middle}radius_m = {radius_m}\n{rest}")
}

#[test]
fn mesh_outside_a_thin_capsule_fails_with_link_and_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("bar.obj"), MESH).unwrap();
    let toml = fitted(&shaped(), folder.path());
    let good = covered(&toml, folder.path(), &[]);
    assert!(good.holds(), "{}", good.page());
    assert!(good.page().starts_with("covered: the shapes of all 2 links lie in their capsules"), "{}", good.page());
    // The fit adds a margin of 2 mm, and the worst corner lies on the capsule without it.
    let thin = covered(&thinner(&toml, LINK, 0.005), folder.path(), &[]);
    assert!(!thin.holds(), "{}", thin.page());
    let worst = &thin.links[0];
    assert_eq!((worst.link.as_str(), worst.capsules), (LINK, 1));
    assert!((worst.out_m - 0.003).abs() < 2e-4, "{worst:?}");
    let corners = [[0.02, 0.02, 0.0], [0.02, 0.02, 0.2]];
    let is_corner = |corner: &[f64; 3]| (0..3).all(|i| (worst.at[i].abs() - corner[i]).abs() < 1e-9);
    assert!(corners.iter().any(is_corner), "{worst:?}");
    let page = thin.page();
    assert!(page.starts_with("NOT COVERED: 1 of 2 links"), "{page}");
    let sentence = format!("`{LINK}` sticks out by {:.2} mm at (", worst.out_m * 1e3);
    assert!(page.contains(&sentence), "{page}");
    let ratio = |cover: &Cover| cover.links.iter().find(|link| link.link == LINK).unwrap().volume_ratio;
    assert!(ratio(&good) > 1.0 && ratio(&thin) < ratio(&good), "{} {}", ratio(&good), ratio(&thin));
    assert!(covered(&thinner(&toml, LINK, 0.005), folder.path(), &[LINK]).holds(), "left out");
}

#[test]
fn body_without_a_capsule_is_not_covered() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("bar.obj"), MESH).unwrap();
    let toml = fitted(&shaped(), folder.path());
    let moved = toml.replace(&format!("link = \"{LINK}\""), "link = \"openarm_left_link4\"");
    assert_ne!(moved, toml);
    let page = covered(&moved, folder.path(), &[]).page();
    assert!(page.contains(&format!("`{LINK}` moves with a body that has no capsule")), "{page}");
    assert!(page.contains("no shape on what these joints move: openarm_left_joint4"), "{page}");
}

#[test]
fn unknown_link_to_leave_out_is_refused() {
    let model = Model::from_text("toml", TOML, "urdf", URDF).unwrap();
    let folder = Path::new("unused");
    let refused = cover(&model, &shaped(), Some(folder), &Posture::new(), &["nose".to_owned()]).unwrap_err();
    assert!(refused.to_string().contains("no link `nose`"), "{refused}");
}

/// A sphere that equals its capsule is covered. Its cube would not be.
#[test]
fn round_sphere_counts_as_sphere() {
    let capsule = "\n[[collision.capsules]]\nname = \"ball\"\nlink = \"openarm_body_link0\"\na_m = [0.0, 0.0, 0.3]\n\
                   b_m = [0.0, 0.0, 0.3]\nradius_m = 0.05\n";
    let at = TOML.find("\n[[collision.capsules]]").unwrap();
    let toml = format!("{}{capsule}{}", &TOML[..at], &TOML[at..]);
    let ball = "<collision><origin xyz=\"0 0 0.3\"/><geometry><sphere radius=\"0.0499\"/></geometry></collision>";
    let urdf = with_shapes(&[("openarm_body_link0", ball)]);
    let model = Model::from_text("toml", &toml, "urdf", URDF).unwrap();
    let found = cover(&model, &urdf, None, &Posture::new(), &[]).unwrap();
    assert!(found.holds(), "{}", found.page());
}
