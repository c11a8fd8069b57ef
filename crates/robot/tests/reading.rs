//! Tests what of a URDF is read, what is passed over, and where an error is.

use crate::support::{HERON, assert_words, edit};
use robot::{draft, read_urdf};
use urdf_rs::Geometry;

fn refused(urdf: &str, words: &[&str]) {
    assert_words(draft("r.urdf", urdf), words);
}

fn line(urdf: &str, of: &str) -> String {
    let at = urdf.find(of).unwrap_or_else(|| panic!("{of}"));
    format!("r.urdf: line {}: ", urdf[..at].matches('\n').count() + 1)
}

const ORIGIN: &str = "<origin xyz=\"0 0.17 0.18\" rpy=\"0 0 0\"/>";

#[test]
fn quaternion_is_read_as_the_same_turn_in_any_length() {
    let rpy = |urdf: &str| {
        let robot = read_urdf("r.urdf", urdf).unwrap();
        let joint = robot.joints.into_iter().find(|joint| joint.name == "port_a").unwrap();
        (joint.origin.xyz.0, joint.origin.rpy.0)
    };
    for wanted in [[0.3, -0.2, 0.9], [0.0, 0.0, 0.0], [-3.0, 1.2, 2.0], [0.0, std::f64::consts::FRAC_PI_2, 0.7]] {
        let [roll, pitch, yaw] = wanted;
        let q = nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        for length in [1.0, 3.0] {
            let q = q.coords * length;
            let text = format!("<origin xyz=\"1 2 3\" quat_xyzw=\"{} {} {} {}\"/>", q.x, q.y, q.z, q.w);
            let (xyz, own) = rpy(&edit(HERON, "port_a\"", ORIGIN, &text));
            let own = nalgebra::UnitQuaternion::from_euler_angles(own[0], own[1], own[2]);
            let off = own.angle_to(&nalgebra::UnitQuaternion::from_euler_angles(roll, pitch, yaw));
            assert!(off < 1e-7 && xyz == [1.0, 2.0, 3.0], "{wanted:?}: {off}");
        }
    }
    for (origin, why) in [
        ("<origin quat_xyzw=\"0 0 0 0\"/>", "must not be zero"),
        ("<origin quat_xyzw=\"0 0 1\"/>", "must be 4 numbers"),
        ("<origin rpy=\"0 0 0\" quat_xyzw=\"0 0 0 1\"/>", "must have one"),
    ] {
        let urdf = edit(HERON, "port_a\"", ORIGIN, origin);
        refused(&urdf, &[&line(&urdf, origin), "joint `port_a`: <origin>", why]);
    }
}

#[test]
fn direction_of_any_length_is_the_same_axis() {
    let axis = "<axis xyz=\"0 1 0\"/>";
    let plain = draft("r.urdf", HERON).unwrap().toml;
    for length in ["2", "0.7071", "1e-3"] {
        let long = edit(HERON, "port_a\"", axis, &format!("<axis xyz=\"0 {length} 0\"/>"));
        assert_eq!(draft("r.urdf", &long).unwrap().toml, plain, "{length}");
    }
    let zero = edit(HERON, "port_a\"", axis, "<axis xyz=\"0 0 0\"/>");
    refused(&zero, &[&line(&zero, "<joint name=\"port_a\""), "joint `port_a`", "axis = 0, must be above 0"]);
}

#[test]
fn all_errors_come_at_once_with_their_lines() {
    let urdf = edit(HERON, "link name=\"lamp\"", "mass value=\"0.6\"", "mass value=\"light\"");
    let urdf = edit(&urdf, "port_c\"", "velocity=\"3.0\"", "velocity=\"fast\"");
    let urdf = edit(&urdf, "starboard_c\"", "<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 1\"/><axis xyz=\"0 0 1\"/>");
    refused(
        &urdf,
        &[
            &line(&urdf, "light"),
            "link `lamp`: <mass>: value = \"light\", must be a number",
            &line(&urdf, "fast"),
            "joint `port_c`: <limit>: velocity = \"fast\"",
            "joint `starboard_c`: <axis>: occurs twice",
        ],
    );
}

#[test]
fn xacro_that_is_not_expanded_is_refused_with_the_command() {
    let way = "`xacro FILE.xacro > FILE.urdf`";
    let value = edit(HERON, "link name=\"lamp\"", "mass value=\"0.6\"", "mass value=\"${m}\"");
    refused(&value, &[&line(&value, "${m}"), "link `lamp`", way]);
    let whole = "<robot name=\"r\" xmlns:xacro=\"http://wiki\">\n<xacro:include filename=\"arm.xacro\"/></robot>";
    refused(whole, &["r.urdf: line 2: <xacro:include>", way]);
    let left_over = HERON.replacen("</robot>", "<xacro:sensor/></robot>", 1);
    draft("r.urdf", &left_over).expect("its links are there without it");
}

#[test]
fn what_nothing_uses_may_be_wrong() {
    let sphere = "<geometry><sphere radius=\"0.07\"/></geometry>";
    for (old, new) in [
        (sphere, "<geometry><sphere radius=\"0.07\"/></geometry><material><texture/></material>"),
        (sphere, "<geometry><box size=\"1 2\"/></geometry>"),
        (sphere, "<geometry><prism/></geometry>"),
        (sphere, ""),
    ] {
        draft("r.urdf", &edit(HERON, "link name=\"lamp\"", old, new)).unwrap_or_else(|error| panic!("{new}: {error}"));
    }
    let collision = "<collision>\n      <origin xyz=\"0.02 0 0.06\"";
    let urdf = edit(HERON, collision, sphere, "<geometry><box size=\"1 2\"/></geometry>");
    refused(&urdf, &[&line(&urdf, "<box size=\"1 2\"/>"), "link `lamp`"]);
    let lamp = |urdf: &str| {
        let robot = read_urdf("r.urdf", urdf).unwrap();
        let link = robot.links.into_iter().find(|link| link.name == "lamp").unwrap();
        (link.visual.len(), matches!(link.collision[0].geometry, Geometry::Sphere { radius: 0.07 }))
    };
    assert_eq!(lamp(HERON), (1, true));
}

#[test]
fn joint_that_nothing_commands_needs_no_plausible_limit_and_no_leader() {
    let finger = |limit: &str, mimic: &str| {
        let tip = format!(
            "<link name=\"tip\"/><joint name=\"tip_slide\" type=\"prismatic\"><parent link=\"port_paddle\"/>\
             <child link=\"tip\"/><axis xyz=\"0 0 -3\"/>{limit}{mimic}</joint></robot>"
        );
        HERON.replacen("</robot>", &tip, 1)
    };
    for limit in
        ["<limit lower=\"0\" upper=\"0.04\"/>", "", "<limit lower=\"0\" upper=\"1e6\" velocity=\"1e9\" effort=\"-1\"/>"]
    {
        let draft = draft("r.urdf", &finger(limit, "<mimic joint=\"nobody\"/>")).unwrap();
        assert_eq!(draft.refusals, [""; 0], "{limit}");
    }
}
