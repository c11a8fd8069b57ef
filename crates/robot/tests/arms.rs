//! Arms of four to eight joints: what a draft takes for upper arm, forearm and hand, and how the model turns them.

use crate::support::{assert_words, drafted, edit, with_capsule};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use robot::{Frames, Model, draft};
use std::fmt::Write;

/// A joint of a left arm at zero: place (m) and axis in the torso frame, and range (rad).
type Row = ([f64; 3], [f64; 3], [f64; 2]);

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const WIDE: [f64; 2] = [-3.1, 3.1];
/// Signs of the right arm's joints.
const SIGNS: [f64; 8] = [1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0];

/// Invented arms, each built as a kind of real ones: joints of upper arm, forearm and hand, and rows.
fn arms() -> Vec<(&'static str, [usize; 3], Vec<Row>)> {
    let at = |x, y, z| [x, y, z];
    let shoulder = [(at(0.0, 0.2, 0.3), Y, WIDE), (at(0.0, 0.25, 0.3), X, [-0.5, 3.0]), (at(0.0, 0.25, 0.15), Z, WIDE)];
    let elbow = (at(0.0, 0.25, 0.0), Y, [-2.5, 0.1]);
    let roll = (at(0.0, 0.25, -0.1), Z, WIDE);
    let hand = [
        (at(0.0, 0.25, -0.25), Y, [-1.5, 1.5]),
        (at(0.0, 0.25, -0.25), X, [-1.0, 1.0]),
        (at(0.0, 0.25, -0.3), Z, WIDE),
    ];
    vec![
        // An industrial arm on its side: no roll of either limb, and a wrist of three joints.
        (
            "lathe",
            [2, 1, 3],
            vec![
                (at(0.0, 0.2, 0.3), Y, WIDE),
                (at(0.0, 0.3, 0.3), Z, WIDE),
                (at(0.42, 0.3, 0.43), Z, WIDE),
                (at(0.81, 0.3, 0.3), Z, WIDE),
                (at(0.81, 0.3, 0.4), Y, WIDE),
                (at(0.81, 0.2, 0.4), Z, WIDE),
            ],
        ),
        // A desk arm: a turning base, a bent upper arm and a rolling forearm.
        (
            "crane",
            [2, 2, 2],
            vec![
                (at(0.0, 0.2, 0.1), Z, WIDE),
                (at(0.0, 0.2, 0.2), Y, [-1.8, 1.9]),
                (at(0.06, 0.2, 0.5), Y, [-1.7, 1.6]),
                (at(0.26, 0.2, 0.5), X, WIDE),
                (at(0.36, 0.2, 0.5), Y, [-1.8, 2.1]),
                (at(0.43, 0.2, 0.5), X, WIDE),
            ],
        ),
        ("walker", [3, 1, 0], [&shoulder[..], &[elbow]].concat()),
        ("guide", [3, 2, 0], [&shoulder[..], &[elbow, roll]].concat()),
        ("dancer", [3, 2, 1], [&shoulder[..], &[elbow, roll, hand[0]]].concat()),
        ("diver", [3, 2, 3], [&shoulder[..], &[elbow, roll], &hand[..]].concat()),
    ]
}

/// The URDF of a robot with this left arm and its mirror image.
fn urdf(name: &str, rows: &[Row]) -> String {
    let inertial = |at: [f64; 3]| {
        format!(
            "<inertial><origin xyz=\"{} {} {}\"/><mass value=\"0.5\"/><inertia ixx=\"0.002\" iyy=\"0.002\" izz=\"0.002\" \
             ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>",
            at[0], at[1], at[2]
        )
    };
    let mut out = format!("<robot name=\"{name}\"><link name=\"chest\">{}</link>\n", inertial([0.0; 3]));
    for (side, mirror) in [("left", 1.0), ("right", -1.0)] {
        let (mut parent, mut before) = ("chest".to_owned(), [0.0; 3]);
        for (i, (place, axis, range)) in rows.iter().enumerate() {
            // The mirror image of an axis, and its sign.
            let sign = if mirror < 0.0 { SIGNS[i] } else { 1.0 };
            let axis = [axis[0] * mirror * sign, axis[1] * sign, axis[2] * mirror * sign].map(|x| x + 0.0);
            let [low, high] = if sign < 0.0 { [-range[1], -range[0]] } else { *range };
            let along = [place[0] - before[0], mirror * (place[1] - before[1]), place[2] - before[2]];
            let next =
                rows.get(i + 1).map_or([0.0, 0.0, -0.1], |next| std::array::from_fn(|k| (next.0[k] - place[k]) / 2.0));
            let _ = writeln!(
                out,
                "<link name=\"{side}_{i}\">{}</link><joint name=\"{side}_{i}\" type=\"revolute\"><parent link=\"{parent}\"/>\
                 <child link=\"{side}_{i}\"/><origin xyz=\"{} {} {}\"/><axis xyz=\"{} {} {}\"/>\
                 <limit lower=\"{low}\" upper=\"{high}\" velocity=\"2\" effort=\"40\"/></joint>",
                inertial([next[0], mirror * next[1], next[2]]),
                along[0],
                along[1],
                along[2],
                axis[0],
                axis[1],
                axis[2],
            );
            (parent, before) = (format!("{side}_{i}"), *place);
        }
    }
    out + "</robot>\n"
}

fn model(name: &str, rows: &[Row]) -> Model {
    drafted(&urdf(name, rows))
}

#[test]
fn drafts_find_which_joints_turn_which_part() {
    for (name, shape, rows) in arms() {
        let model = model(name, &rows);
        for (side, arm) in model.arms.iter().enumerate() {
            let taken = [0..3, 3..5, 5..8].map(|slots| arm.slots[slots].iter().flatten().count());
            assert_eq!((taken, arm.range().len()), (shape, shape.iter().sum()), "{name}");
            assert_eq!(arm.rolls(), [shape[0] == 3, shape[1] == 2], "{name}");
            let signs = if side == 0 { vec![1.0; rows.len()] } else { SIGNS[..rows.len()].to_vec() };
            assert_eq!(Vec::from_iter(arm.joint_signs()), signs, "{name}");
        }
    }
}

/// In the T-pose the elbow lies straight to the side of the shoulder, but for what lies along the axes.
#[test]
fn t_pose_holds_both_arms_out_to_the_sides() {
    for (name, _, rows) in arms() {
        let model = model(name, &rows);
        let mut frames = Frames::default();
        model.forward(&model.t_pose(), &mut frames);
        for (side, arm) in [1.0, -1.0].into_iter().zip(&model.arms) {
            let place = |joint: usize| frames.base_from_body[joint + 1].t;
            let limb = place(arm.elbow()) - place(arm.range().start + 1);
            let last = arm.limb_bodies()[0];
            let axis = frames.base_from_body[last].r * model.joint_at_zero(last - 1).1;
            let across = if arm.rolls()[0] { limb } else { limb - axis * limb.dot(&axis) };
            let off = across.normalize() - Vector3::new(0.0, side, 0.0);
            assert!(off.norm() < 1e-4, "{name}: {across}");
        }
    }
}

#[test]
fn hand_of_three_joints_reaches_every_rotation() {
    let mut rng = Pcg64::seed_from_u64(3);
    for name in ["lathe", "diver"] {
        let rows = arms().into_iter().find(|row| row.0 == name).expect("an arm of this name").2;
        for joints in model(name, &rows).wrists {
            let turn = |q| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(joints.rotation(q)));
            for _ in 0..200 {
                let q = std::array::from_fn(|i| joints.home[i] + rng.random_range(-0.8..0.8));
                let inside = (0..3).all(|i| (joints.q_min[i]..=joints.q_max[i]).contains(&q[i]));
                let wanted = turn(q);
                let found = joints.nearest(&wanted, joints.home);
                assert!((0..3).all(|i| (joints.q_min[i]..=joints.q_max[i]).contains(&found[i])), "{name}: {found:?}");
                let off_deg = turn(found).angle_to(&wanted).to_degrees();
                assert!(!inside || off_deg < 0.1, "{name}: {q:?} became {found:?}, {off_deg} degrees off");
            }
        }
    }
}

/// Joints that turn twice keep one turn, so that home is never a turn away.
#[test]
fn joint_that_turns_twice_gets_one_turn() {
    let (_, _, mut rows) = arms().remove(0);
    rows[3].2 = [-6.2, 6.2];
    let model = model("lathe", &rows);
    let joint = model.arms[0].range().start + 3;
    assert_eq!((model.urdf_limits[joint].q_max, model.limits[joint].q_max < 3.15), (6.2, true));
    assert!(model.limits[joint + 1].q_max < 3.1, "the others keep the URDF's");
}

#[test]
fn arms_that_no_limb_needs_are_refused_with_bound_and_place() {
    let (_, _, rows) = arms().remove(1);
    let text = urdf("crane", &rows);
    let draft = draft("r.urdf", &text).expect("a draft").toml;
    let refused = |toml: &str, words: &[&str]| assert_words(with_capsule(toml, &text), words);
    let short = edit(&draft, "[arms.right]", "\n    \"right_5\",", "");
    refused(&short, &["arms.left.joints and arms.right.joints", "6 and 5 joints", "must be 4 to 8"]);
    let late = edit(&draft, "[arms.left]", "upper = \"left_1\"", "upper = \"left_3\"");
    refused(&late, &["arms.left.upper", "`left_3`", "must move with joint `left_1` or `left_2`"]);
    let other = edit(&draft, "[arms.left]", "fore = \"left_3\"", "fore = \"left_2\"");
    refused(&other, &["arms.left.reference_rad", "4 positions", "must be 3"]);
}
