//! Both readers of a URDF place every link in the same way, and refuse the same texts.

use messages::JOINTS_MAX;
use plant::{Body, Frames};
use rand::SeedableRng;
use robot::Model;

const HERON: &str = include_str!("../../../docs/robots/heron.urdf");

/// The robot file with two capsules on a link: their ends determine its place.
fn with_capsules(toml: &str, link: &str) -> String {
    let ends = [("[0.1, 0.02, 0.0]", "[0.0, 0.1, 0.03]"), ("[0.0, 0.0, 0.1]", "[0.04, 0.0, -0.1]")];
    let capsule = |(a, b): &(&str, &str)| {
        format!("[[collision.capsules]]\nname = \"{a}\"\nlink = \"{link}\"\na_m = {a}\nb_m = {b}\nradius_m = 0.002\n\n")
    };
    let capsules: String = ends.iter().map(capsule).collect();
    format!("{toml}{capsules}[collision.allowed]\nadjacent = {{}}\nproved_clear = {{}}\n")
}

fn edit(text: &str, after: &str, old: &str, new: &str) -> String {
    let from = text.find(after).unwrap_or_else(|| panic!("{after} is not there"));
    let at = from + text[from..].find(old).unwrap_or_else(|| panic!("{old} is not after {after}"));
    format!("{}{new}{}", &text[..at], &text[at + old.len()..])
}

/// A finger that is held, turned by a quaternion, with an inertial that is turned by one, and another one that follows it.
const FINGERS: &str = include_str!("fingers.xml");

fn robots() -> Vec<(&'static str, String)> {
    let shoulders = |angle: &str| {
        let text = edit(HERON, "port_a\"", "rpy=\"0 0 0\"", &format!("quat_xyzw=\"{angle} 0 0 3\""));
        edit(&text, "starboard_a\"", "rpy=\"0 0 0\"", &format!("quat_xyzw=\"-{angle} 0 0 3\""))
    };
    let endless = edit(HERON, "port_e\"", "type=\"revolute\"", "type=\"continuous\"");
    let endless = edit(&endless, "starboard_e\"", "type=\"revolute\"", "type=\"continuous\"");
    let unknown = HERON.replace("velocity=\"3.0\"", "velocity=\"1e9\" acceleration=\"50\" jerk=\"900\"");
    let heavy = edit(HERON, "floor_plate\"", "mass value=\"", "mass value=\"10");
    vec![
        ("as it is", HERON.to_owned()),
        ("a heavy base that floats", edit(&heavy, "plate_to_post\"", "type=\"fixed\"", "type=\"floating\"")),
        ("quaternions", shoulders("0.4")),
        ("fingers", HERON.replacen("</robot>", FINGERS, 1)),
        ("arms that do not mirror", edit(HERON, "starboard_a\"", "xyz=\"0 1 0\"", "xyz=\"0.2 0.98 0\"")),
        ("axes of other lengths", HERON.replace("xyz=\"0 1 0\"", "xyz=\"0 0.7 0\"")),
        ("joints without end", endless),
        ("placeholders", unknown.replace("effort=\"40\"", "")),
    ]
}

#[test]
fn links_masses_and_limits_are_the_same_for_both_readers() {
    for (name, urdf) in robots() {
        let draft = robot::draft("r.urdf", &urdf).unwrap_or_else(|error| panic!("{name}: {error}"));
        let links = urdf.split("<link name=\"").skip(1).map(|rest| &rest[..rest.find('"').unwrap()]);
        let read = |link: &str| {
            let toml = with_capsules(&draft.toml, link);
            let model = Model::from_text("r.toml", &toml, "r.urdf", &urdf).unwrap_or_else(|error| panic!("{error}"));
            let body = Body::from_text("r.toml", &toml, "r.urdf", &urdf).unwrap_or_else(|error| panic!("{error}"));
            (model, body)
        };
        for link in links {
            let (model, body) = read(link);
            for (own, other) in body.capsules.iter().zip(&model.capsules) {
                let off = (own.ends[0] - other.a).amax().max((own.ends[1] - other.b).amax());
                assert!(off < 1e-9 && own.body == other.body, "{name}: {link}: {own:?} {other:?}");
            }
        }
        let (model, body) = read("chest");
        for (own, other) in body.inertias.iter().zip(&model.inertias()) {
            assert!((own.mass_kg - other.mass_kg).abs() < 1e-12, "{name}: {own:?} {other:?}");
            assert!((own.moment - other.center * other.mass_kg).amax() < 1e-9, "{name}: {own:?} {other:?}");
            assert!((own.about_origin - other.about(&nalgebra::Vector3::zeros())).amax() < 1e-9, "{name}");
        }
        for (j, own) in body.joints.iter().enumerate() {
            for (own, other) in [(&own.urdf, &model.urdf_limits[j]), (&own.limits, &model.limits[j])] {
                let own = [own.q_min, own.q_max, own.v_max, own.a_max, own.j_max, own.effort_max];
                let other = [other.q_min, other.q_max, other.v_max, other.a_max, other.j_max, other.effort_max];
                assert_eq!(own, other, "{name}: {}", model.joint_names[j]);
            }
        }
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        let (mut ours, mut theirs) = (Frames::default(), robot::Frames::default());
        for _ in 0..100 {
            let q: [f64; JOINTS_MAX] = crate::support::uniform(&body, &mut rng);
            body.forward(&q, &mut ours);
            model.forward(&q, &mut theirs);
            for (own, other) in ours.base_from_body.iter().zip(&theirs.base_from_body) {
                let off = (own.r - other.r).amax().max((own.t - other.t).amax());
                assert!(off < 1e-9, "{name}: {off}");
            }
        }
    }
}

#[test]
fn what_one_reader_refuses_the_other_refuses_at_the_same_line() {
    let toml = with_capsules(&robot::draft("r.urdf", HERON).unwrap().toml, "chest");
    let axis = "<axis xyz=\"0 0 1\"/>";
    for (old, new) in [
        ("rpy=\"0 0 0\"/>\n    <axis xyz=\"0 0 1\"/>", "rpy=\"0 0 0\" quat_xyzw=\"0 0 0 1\"/>"),
        ("rpy=\"0 0 0\"/>\n    <axis xyz=\"0 0 1\"/>", "quat_xyzw=\"0 0 0 0\"/>"),
        ("rpy=\"0 0 0\"/>\n    <axis xyz=\"0 0 1\"/>", "quat_xyzw=\"0 0 1\"/>"),
        (axis, "<axis xyz=\"0 0 1\"/><axis xyz=\"0 0 1\"/>"),
        (axis, "<axis xyz=\"0 0\"/>"),
        (axis, "<axis/>"),
        (axis, "<axis xyz=\"0 0 1\"/><mimic joint=\"port_a\" multiplier=\"two\"/>"),
        ("lower=\"", "lower=\"low"),
        ("effort=\"", "jerk=\"none\" effort=\""),
    ] {
        let urdf = edit(HERON, "\"port_c\"", old, new);
        let lines = 1 + urdf[..urdf.find("\"port_c\"").unwrap()].matches('\n').count();
        let model = Model::from_text("r.toml", &toml, "r.urdf", &urdf).map(|_| ()).expect_err(new).to_string();
        let body = Body::from_text("r.toml", &toml, "r.urdf", &urdf).map(|_| ()).expect_err(new).to_string();
        for error in [&model, &body] {
            let line = error.strip_prefix("r.urdf: line ").and_then(|rest| rest.split(':').next()?.parse().ok());
            assert!(line.is_some_and(|line: usize| (lines..lines + 7).contains(&line)), "{new}: {error}");
        }
        let line = |error: &str| error.split(':').nth(1).map(str::to_owned);
        assert_eq!(line(&model), line(&body), "{model}\n{body}");
    }
}
