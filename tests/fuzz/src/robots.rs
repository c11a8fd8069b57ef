//! A URDF and its robot file: any text, and changes of the shipped ones.

use crate::bytes::Bytes;
use robot::{Frames, Model};
use std::borrow::Cow;
use std::sync::LazyLock;

/// Joints of TIAGo++.
const JOINTS: usize = 17;

pub(crate) const TOML: &str = include_str!("../../../config/robots/tiago_dual.toml");
pub(crate) const URDF: &str = include_str!("../../../config/robots/tiago_dual.urdf");

/// The shipped robot.
pub(crate) static MODEL: LazyLock<Model> =
    LazyLock::new(|| Model::from_text("robot.toml", TOML, "robot.urdf", URDF).expect("the shipped robot"));

/// Runs the input. The first byte selects the meaning of the others: the text of a URDF, of a robot file, or
/// changes of the shipped pair. Each change is (file and length, place, number of bytes removed, bytes inserted).
pub(crate) fn run(input: &[u8]) {
    let Some((&kind, rest)) = input.split_first() else { return };
    let text = || String::from_utf8_lossy(rest);
    let (toml, urdf) = match kind {
        0 => (Cow::from(TOML), text()),
        1 => (text(), Cow::from(URDF)),
        _ => {
            let (toml, urdf) = changed(rest);
            (toml.into(), urdf.into())
        }
    };
    match Model::from_text("robot.toml", &toml, "robot.urdf", &urdf) {
        Ok(model) => check(&model),
        Err(error) => {
            let error = error.to_string();
            assert!(error.contains("robot.toml") || error.contains("robot.urdf"), "names no file: {error}");
        }
    }
}

/// Returns the shipped texts with parts replaced. Places wrap around.
fn changed(input: &[u8]) -> (String, String) {
    let mut texts = [TOML.as_bytes().to_vec(), URDF.as_bytes().to_vec()];
    let mut bytes = Bytes::new(input);
    for _ in 0..8 {
        if bytes.is_empty() {
            break;
        }
        let head = bytes.u8();
        let text = &mut texts[usize::from(head & 1)];
        let at = usize::from(bytes.u16()) % text.len().max(1);
        let end = (at + usize::from(bytes.u8())).min(text.len());
        let new = bytes.take(usize::from(head >> 1)).to_vec();
        text.splice(at..end, new);
    }
    let [toml, urdf] = texts.map(|text| String::from_utf8_lossy(&text).into_owned());
    (toml, urdf)
}

/// Invariants of every accepted robot. The ceilings are repeated here, written in another way.
fn check(model: &Model) {
    for j in 0..JOINTS {
        let (limits, urdf) = (&model.limits[j], &model.urdf_limits[j]);
        let [q, v, a, jerk] = if model.prismatic[j] { [3.0, 2.0, 20.0, 2e3] } else { [13.0, 20.0, 200.0, 2e4] };
        assert!(-q <= urdf.q_min && urdf.q_min <= limits.q_min, "{j}: {limits:?}");
        assert!(limits.q_min < limits.q_max && limits.q_max <= urdf.q_max && urdf.q_max <= q, "{j}: {limits:?}");
        assert!(limits.v_max > 0.0 && limits.v_max <= urdf.v_max && urdf.v_max <= v, "{j}: {limits:?}");
        assert!(limits.a_max > 0.0 && limits.a_max <= a && limits.j_max > 0.0 && limits.j_max <= jerk, "{limits:?}");
        assert!(limits.stop_time_s() <= 0.5, "{j}: {limits:?}");
        assert!(limits.contains(model.home[j]), "{j}: home {}", model.home[j]);
    }
    assert!(model.d_min_m > 0.0 && model.d_min_m.is_finite());
    let mut frames = Frames::default();
    model.forward(&model.home, &mut frames);
    for name in &model.joint_names {
        assert!(!name.is_empty());
    }
    // Every accepted robot also gives a valid configuration of the deciding parts.
    let gate = safety::gate::Config::new(model);
    assert!(gate.is_ok(), "{:?}", gate.err());
}
