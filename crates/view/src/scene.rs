//! What a page is told once: the robot's shapes, joints and obstacles, and the person's bones, as JSON.

use messages::{Mode, SMPL_NAMES, SMPL_PARENT};
use nalgebra::{Rotation3, UnitQuaternion};
use robot::{Form, Model, Pose, Solid};
use serde_json::{Value, json};

/// The robot and its surroundings. Lengths in m, angles in rad, quaternions x, y, z, w; poses of shapes are in their bodies'
/// frames, obstacles in the base's.
pub fn scene(model: &Model) -> Value {
    let joints: Vec<_> = (0..model.joint_names.len())
        .map(|j| {
            let limits = &model.limits[j];
            json!({
                "name": model.joint_names[j], "unit": if model.prismatic[j] { "m" } else { "rad" },
                "q_min": limits.q_min, "q_max": limits.q_max, "v_max": limits.v_max,
            })
        })
        .collect();
    let capsules: Vec<_> = model
        .capsules
        .iter()
        .map(|capsule| {
            let [a, b]: [[f64; 3]; 2] = [capsule.a.into(), capsule.b.into()];
            json!({ "name": capsule.name, "body": capsule.body, "a": a, "b": b, "radius": capsule.radius_m })
        })
        .collect();
    let shapes: Vec<_> = model
        .visuals()
        .map(|visual| {
            let mut shape = match visual.form {
                Form::Box(size) => json!({ "form": "box", "size": size }),
                Form::Cylinder { radius_m, length_m } => {
                    json!({ "form": "cylinder", "radius": radius_m, "length": length_m })
                }
                Form::Sphere { radius_m } => json!({ "form": "sphere", "radius": radius_m }),
            };
            shape["body"] = json!(visual.body);
            shape["pose"] = pose(&visual.body_from_shape);
            shape
        })
        .collect();
    let obstacles: Vec<_> = model.obstacles.iter().map(|obstacle| solid(&obstacle.name, &obstacle.solid)).collect();
    json!({
        "tell": "scene",
        "robot": model.name,
        "joints": joints,
        "capsules": capsules,
        "shapes": shapes,
        "obstacles": obstacles,
        "modes": Mode::ALL.map(Mode::name),
        "person": { "names": SMPL_NAMES, "parents": SMPL_PARENT },
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
