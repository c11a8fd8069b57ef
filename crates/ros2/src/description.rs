//! Compares the robot's own description with the URDF that the robot file names.
//!
//! The robot's own has joints that nobody commands here: wheels, fingers, suspensions. Only the commanded joints count.
//! The axis and the origin of each of them, with all joints at zero, determine every posture (product of exponentials). So
//! axes, origins and limits are compared, and no names of links.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use robot::Model;
use std::collections::HashMap;
use urdf_rs::{Joint, Robot};

/// Largest difference, m and rad. Both texts write some six digits.
const SAME: f64 = 1e-6;
/// Longest way from a joint to the root, in joints. A longer one is a loop.
const DEPTH_MAX: usize = 256;

/// Returns a sentence on the first difference in a joint of `model`.
pub fn difference(theirs: &str, model: &Model) -> Option<String> {
    let text = "/robot_description";
    let theirs = match robot::read_urdf(text, theirs) {
        Ok(theirs) => theirs,
        Err(error) => return Some(format!("{text} is no URDF: {error}")),
    };
    let Ok(ours) = robot::read_urdf(&model.texts.urdf_name, &model.texts.urdf) else {
        return Some(format!("{} is no URDF", model.texts.urdf_name));
    };
    let (our_joints, their_joints) = (by_child(&ours), by_child(&theirs));
    // Both are compared in the frame of the first joint's parent link, so that a root above ours does not matter.
    let shared =
        model.joint_names[..model.count].first().and_then(|name| joint_named(&ours, name))?.parent.link.clone();
    let base = |joints: &HashMap<&str, &Joint>| pose(joints, &shared);
    let (our_base, their_base) = (base(&our_joints)?, base(&their_joints)?);
    model.joint_names[..model.count].iter().find_map(|name| {
        let our = joint_named(&ours, name)?;
        let Some(their) = joint_named(&theirs, name) else {
            return Some(format!("{text} has no joint `{name}`: this is another robot"));
        };
        let place = |joints, joint: &Joint, base: &Isometry3<f64>| {
            let own = pose(joints, &joint.child.link)?;
            let axis = Vector3::from(joint.axis.xyz.0).try_normalize(0.0)?;
            Some((base.inverse() * own, axis))
        };
        let (Some((our_pose, our_axis)), Some((their_pose, their_axis))) =
            (place(&our_joints, our, &our_base), place(&their_joints, their, &their_base))
        else {
            return Some(format!("{text}: the way from `{name}` to the root is a loop"));
        };
        let limits = |joint: &Joint| [joint.limit.lower, joint.limit.upper, joint.limit.velocity, joint.limit.effort];
        let off = limits(our).into_iter().zip(limits(their)).any(|(our, their)| !((our - their).abs() <= SAME));
        let what = if our.joint_type != their.joint_type {
            "type"
        } else if !((our_pose * our_axis - their_pose * their_axis).norm() <= SAME) {
            "axis"
        } else if !((our_pose.translation.vector - their_pose.translation.vector).norm() <= SAME)
            || !(our_pose.rotation.angle_to(&their_pose.rotation) <= SAME)
        {
            "origin"
        } else if off {
            "limits"
        } else {
            return None;
        };
        Some(format!(
            "the {what} of `{name}` differs in {text} and {}: use the robot's own URDF",
            model.texts.urdf_name
        ))
    })
}

fn by_child(robot: &Robot) -> HashMap<&str, &Joint> {
    robot.joints.iter().map(|joint| (joint.child.link.as_str(), joint)).collect()
}

fn joint_named<'a>(robot: &'a Robot, name: &str) -> Option<&'a Joint> {
    robot.joints.iter().find(|joint| joint.name == name)
}

/// Pose of a link in the frame of the root, with all joints at zero. None if the way to the root is a loop.
fn pose(joints: &HashMap<&str, &Joint>, link: &str) -> Option<Isometry3<f64>> {
    let (mut at, mut link) = (Isometry3::identity(), link);
    for _ in 0..DEPTH_MAX {
        let Some(joint) = joints.get(link) else { return Some(at) };
        let [x, y, z] = joint.origin.xyz.0;
        let [roll, pitch, yaw] = joint.origin.rpy.0;
        let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        at = Isometry3::from_parts(Translation3::new(x, y, z), rotation) * at;
        link = &joint.parent.link;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> Model {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/tiago_dual.toml");
        config::load_model(file.as_ref()).expect("the shipped robot").0
    }

    #[test]
    fn own_description_agrees_also_below_another_root_and_with_wheels() {
        let model = model();
        let urdf = &model.texts.urdf;
        assert_eq!(difference(urdf, &model), None);
        let more = urdf.replace(
            "</robot>",
            r#"<link name="world"/><link name="wheel"/>
            <joint name="anchor" type="fixed"><parent link="world"/><child link="base_footprint"/>
              <origin xyz="1 2 3" rpy="0 0 1"/></joint>
            <joint name="wheel_joint" type="continuous"><parent link="base_link"/><child link="wheel"/></joint></robot>"#,
        );
        assert_ne!(&more, urdf);
        assert_eq!(difference(&more, &model), None);
    }

    #[test]
    fn any_other_number_or_name_is_named() {
        let model = model();
        let urdf = &model.texts.urdf;
        let joint = urdf.split("<joint name=\"arm_left_3_joint\"").nth(1).expect("in the URDF");
        let joint = joint.split("</joint>").next().expect("ends");
        let tag = |name: &str| {
            let from = joint.find(&format!("<{name}")).expect("has the tag");
            &joint[from..from + joint[from..].find("/>").expect("ends") + 2]
        };
        let edits = [
            (tag("axis").to_owned(), r#"<axis xyz="0 1 0"/>"#.to_owned(), "axis"),
            (tag("origin").to_owned(), tag("origin").replacen("0.", "1.", 1), "origin"),
            (tag("limit").to_owned(), tag("limit").replacen("velocity=\"", "velocity=\"1", 1), "limits"),
        ];
        for (from, to, what) in edits {
            let other = urdf.replacen(joint, &joint.replace(&from, &to), 1);
            assert_ne!(&other, urdf, "{what}");
            let error = difference(&other, &model).expect(what);
            assert!(error.contains(&format!("the {what} of `arm_left_3_joint`")), "{error}");
        }
        let error = difference(&urdf.replace("arm_left_3_joint", "arm_left_03_joint"), &model).expect("no such joint");
        assert!(error.contains("no joint `arm_left_3_joint`"), "{error}");
        assert!(difference("<robot", &model).expect("no URDF").contains("no URDF"));
    }
}
