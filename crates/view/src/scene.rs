//! The first message to a page, as JSON: the robot's shapes, joints and obstacles, and the person's bones.

use crate::look::{FingerMotion, Part, Shape};
use crate::robot_view::{Mesh, RobotView};
use messages::{Mode, SMPL_NAMES, SMPL_PARENT};
use nalgebra::{Rotation3, UnitQuaternion};
use robot::{Capsule, Form, Frames, Model, Pose, Solid};
use serde_json::{Value, json};

/// Returns the robot and its surroundings. Lengths are in m, angles in rad, quaternions as x, y, z, w. Poses of
/// shapes are in their bodies' frames, obstacles in the base frame. A `matrix` holds the three upper rows of a
/// transform into the body's frame.
pub fn scene(view: &RobotView) -> Value {
    let model = &view.model;
    let obstacles: Vec<_> = model.obstacles.iter().map(|obstacle| solid(&obstacle.name, &obstacle.solid)).collect();
    json!({
        "tell": "scene",
        "robot": model.name,
        "joints": joints(model),
        "capsules": capsules(view),
        "shapes": shapes(model),
        "parts": view.look.parts.iter().map(part).collect::<Vec<_>>(),
        "meshes": view.meshes.iter().map(mesh).collect::<Vec<_>>(),
        "missing_meshes": view.missing,
        "grippers": model.grippers.each_ref().map(Option::is_some),
        "shoulders": view.shoulder_bodies(),
        "half_span": half_span_m(model),
        "obstacles": obstacles,
        "modes": Mode::NAMES,
        "limits": {
            "clearance_mm": model.d_min_m * 1e3,
            "behind_deg": explain::BEHIND_DEG,
            "delays_ms": view.following_delays_ms,
        },
        "person": { "names": SMPL_NAMES, "parents": SMPL_PARENT },
    })
}

/// Returns how far the robot reaches to its side in the T-pose, m. The page places the person by it.
fn half_span_m(model: &Model) -> f64 {
    let mut frames = Frames::default();
    model.forward(&model.t_pose(), &mut frames);
    let reach = |capsule: &Capsule| {
        let ends = [capsule.a, capsule.b].map(|end| frames.base_from_body[capsule.body].transform_point(&end).y.abs());
        ends[0].max(ends[1]) + capsule.radius_m
    };
    model.capsules.iter().map(reach).fold(0.0, f64::max)
}

fn joints(model: &Model) -> Vec<Value> {
    let joint = |j: usize| {
        let limits = &model.limits[j];
        json!({
            "name": model.joint_names[j], "unit": if model.prismatic[j] { "m" } else { "rad" },
            "q_min": limits.q_min, "q_max": limits.q_max, "v_max": limits.v_max,
        })
    };
    (0..model.joint_names.len()).map(joint).collect()
}

fn capsules(view: &RobotView) -> Vec<Value> {
    let capsules = view.model.capsules.iter().enumerate().map(|(n, capsule)| {
        let [a, b]: [[f64; 3]; 2] = [capsule.a.into(), capsule.b.into()];
        let colour = view.look.capsules.get(n).copied().flatten().map(|colour| colour.text());
        json!({
            "name": capsule.name, "body": capsule.body, "a": a, "b": b, "radius": capsule.radius_m, "colour": colour,
        })
    });
    capsules.collect()
}

fn shapes(model: &Model) -> Vec<Value> {
    let shape = |visual: robot::Visual| {
        let mut shape = match visual.form {
            Form::Box(size) => json!({ "form": "box", "size": size }),
            Form::Cylinder { radius_m, length_m } => {
                json!({ "form": "cylinder", "radius": radius_m, "length": length_m })
            }
            Form::Capsule { radius_m, length_m } => {
                let [a, b] = [-0.5, 0.5].map(|end| [0.0, 0.0, end * length_m]);
                json!({ "form": "capsule", "a": a, "b": b, "radius": radius_m, "top": radius_m })
            }
            Form::Sphere { radius_m } => json!({ "form": "sphere", "radius": radius_m }),
        };
        shape["body"] = json!(visual.body);
        shape["pose"] = pose(&visual.body_from_shape);
        shape
    };
    model.visuals().map(shape).collect()
}

fn part(part: &Part) -> Value {
    let mut shape = match &part.shape {
        Shape::Box { size_m, edge_m } => json!({ "form": "box", "size": size_m, "edge": edge_m }),
        Shape::Cone { radius_m, top_radius_m, length_m, edge_m } => {
            json!({ "form": "cone", "radius": radius_m, "top": top_radius_m, "length": length_m, "edge": edge_m })
        }
        Shape::Ellipsoid { radii_m } => json!({ "form": "ellipsoid", "radii": radii_m }),
        Shape::Capsule { a_m, b_m, radius_m, top_radius_m } => {
            json!({ "form": "capsule", "a": a_m, "b": b_m, "radius": radius_m, "top": top_radius_m })
        }
        Shape::Lathe { profile_m, stretch, squareness } => {
            json!({ "form": "lathe", "profile": profile_m, "stretch": stretch, "squareness": squareness })
        }
    };
    if let Some(closing) = &part.closing {
        shape["hand"] = json!(closing.hand);
        shape["outer"] = json!(closing.body_from_link.as_flattened());
        shape["inner"] = json!(closing.link_from_shape.as_flattened());
        shape["motions"] = closing.motions.iter().map(motion).collect();
    }
    shape["link"] = json!(part.link);
    shape["body"] = json!(part.body);
    shape["matrix"] = json!(part.body_from_shape.as_flattened());
    shape["colour"] = json!(part.colour.text());
    shape["roughness"] = json!(part.roughness);
    shape
}

fn motion(motion: &FingerMotion) -> Value {
    match motion {
        FingerMotion::Slide { offset_m } => json!({ "slide": offset_m }),
        FingerMotion::Turn { pivot_m, axis, turn_rad } => json!({ "pivot": pivot_m, "axis": axis, "turn": turn_rad }),
    }
}

fn mesh(mesh: &Mesh) -> Value {
    json!({
        "link": mesh.link, "body": mesh.body, "matrix": mesh.body_from_mesh.as_flattened(), "file": mesh.file,
        "colour": mesh.colour.map(|colour| colour.text()),
    })
}

fn solid(name: &str, solid: &Solid) -> Value {
    match solid {
        Solid::HalfSpace { normal, offset_m } => {
            let normal: [f64; 3] = (*normal).into();
            json!({ "name": name, "form": "plane", "normal": normal, "offset": offset_m })
        }
        Solid::Box { center, r, half_m } => {
            let size: [f64; 3] = (half_m * 2.0).into();
            json!({ "name": name, "form": "box", "size": size, "pose": pose(&Pose { r: *r, t: *center }) })
        }
    }
}

fn pose(pose: &Pose) -> Value {
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(pose.r));
    let (t, q): ([f64; 3], [f64; 4]) = (pose.t.into(), turn.coords.into());
    json!([t[0], t[1], t[2], q[0], q[1], q[2], q[3]])
}
