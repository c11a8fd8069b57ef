//! Content for viewers: joint states, transforms of the links, the person as lines, the robot's capsules.

use foxglove::messages::{
    Color, CylinderPrimitive, Duration, FrameTransform, FrameTransforms, JointState, JointStates, LinePrimitive,
    Point3, Pose, Quaternion, SceneEntity, SceneUpdate, SpherePrimitive, Timestamp, Vector3, line_primitive,
};
use messages::{JOINTS_MAX, SMPL_JOINTS, SMPL_PARENT};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use robot::{Frames, Model};

/// The frame in which the person is drawn, and its position beside the robot, m.
const PERSON_FRAME: &str = "person";
const PERSON_AT_M: [f64; 3] = [0.0, 1.5, 0.0];
/// Thickness of the person's lines, m.
const BONE_M: f64 = 0.03;

pub fn timestamp(ns: u64) -> Timestamp {
    let seconds = u32::try_from(ns / 1_000_000_000).unwrap_or(u32::MAX);
    Timestamp::new(seconds, (ns % 1_000_000_000) as u32)
}

/// Returns joint states. Joints whose bit in `mask` is clear have no position.
pub fn joint_states(model: &Model, at_ns: u64, q: &[f64; JOINTS_MAX], v: &[f64; JOINTS_MAX], mask: u32) -> JointStates {
    let joint = |j: usize| {
        let meant = mask & 1 << j != 0;
        JointState {
            name: model.joint_names[j].clone(),
            position: meant.then_some(q[j]),
            velocity: meant.then_some(v[j]),
            ..JointState::default()
        }
    };
    JointStates { timestamp: Some(timestamp(at_ns)), joints: (0..model.count).map(joint).collect() }
}

fn root(model: &Model) -> &str {
    let is_root = |(_, body, pose): &(&str, usize, &robot::Pose)| *body == 0 && **pose == robot::Pose::identity();
    model.links().find(is_root).map_or("base", |(name, ..)| name)
}

/// Returns the transforms of every link of the robot at `q`, and of the person's frame beside it.
pub fn transforms(model: &Model, frames: &mut Frames, at_ns: u64, q: &[f64; JOINTS_MAX]) -> FrameTransforms {
    model.forward(q, frames);
    let root = root(model);
    let transform = |child: &str, r: &Matrix3<f64>, t: [f64; 3]| FrameTransform {
        timestamp: Some(timestamp(at_ns)),
        parent_frame_id: root.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(Vector3 { x: t[0], y: t[1], z: t[2] }),
        rotation: Some(quaternion(&UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*r)))),
    };
    let links = model.links().filter(|(name, ..)| *name != root).map(|(name, body, in_body)| {
        let pose = frames.base_from_body[body].compose(in_body);
        transform(name, &pose.r, pose.t.into())
    });
    let person = transform(PERSON_FRAME, &Matrix3::identity(), PERSON_AT_M);
    FrameTransforms { transforms: links.chain([person]).collect() }
}

fn quaternion(q: &UnitQuaternion<f64>) -> Quaternion {
    Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }
}

pub fn capsules(model: &Model, frames: &Frames, at_ns: u64) -> SceneUpdate {
    let colour = Some(Color { r: 0.2, g: 0.5, b: 0.9, a: 0.5 });
    let (mut cylinders, mut spheres) = (Vec::new(), Vec::new());
    for capsule in &model.capsules {
        let [a, b] = capsule.ends(frames);
        let (middle, along, d) = ((a + b) / 2.0, b - a, 2.0 * capsule.radius_m);
        let turn = UnitQuaternion::rotation_between(&nalgebra::Vector3::z(), &along).unwrap_or_default();
        cylinders.push(CylinderPrimitive {
            pose: Some(pose(middle, &turn)),
            size: Some(Vector3 { x: d, y: d, z: along.norm() }),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: colour,
        });
        spheres.extend([a, b].map(|end| SpherePrimitive {
            pose: Some(pose(end, &UnitQuaternion::identity())),
            size: Some(Vector3 { x: d, y: d, z: d }),
            color: colour,
        }));
    }
    scene(SceneEntity { cylinders, spheres, ..entity(root(model), "capsules", at_ns) })
}

pub fn person(positions: &[[f32; 3]; SMPL_JOINTS], at_ns: u64) -> SceneUpdate {
    let point = |joint: usize| {
        let [x, y, z] = positions[joint].map(f64::from);
        Point3 { x, y, z }
    };
    let line = LinePrimitive {
        r#type: line_primitive::Type::LineList as i32,
        pose: Some(pose(nalgebra::Vector3::zeros(), &UnitQuaternion::identity())),
        thickness: BONE_M,
        points: (1..SMPL_JOINTS).flat_map(|joint| [point(SMPL_PARENT[joint]), point(joint)]).collect(),
        color: Some(Color { r: 0.95, g: 0.6, b: 0.1, a: 1.0 }),
        ..LinePrimitive::default()
    };
    scene(SceneEntity { lines: vec![line], ..entity(PERSON_FRAME, "person", at_ns) })
}

fn pose(at: nalgebra::Vector3<f64>, turn: &UnitQuaternion<f64>) -> Pose {
    Pose { position: Some(Vector3 { x: at.x, y: at.y, z: at.z }), orientation: Some(quaternion(turn)) }
}

fn entity(frame: &str, id: &str, at_ns: u64) -> SceneEntity {
    SceneEntity {
        timestamp: Some(timestamp(at_ns)),
        frame_id: frame.to_owned(),
        id: id.to_owned(),
        lifetime: Some(Duration::new(0, 0)),
        ..SceneEntity::default()
    }
}

fn scene(entity: SceneEntity) -> SceneUpdate {
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}
