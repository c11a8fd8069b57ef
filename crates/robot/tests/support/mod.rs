//! Common parts of this crate's tests.
#![allow(dead_code, unreachable_pub)]

use messages::JOINTS_MAX;
use rand::RngExt;
use robot::{Model, RobotError};

/// Joints of TIAGo++, and of them those of its left and right arm.
pub const JOINTS: usize = 17;
pub const LEFT_ARM: std::ops::Range<usize> = 3..10;
pub const RIGHT_ARM: std::ops::Range<usize> = 10..17;

/// The shipped robot file.
pub const TOML: &str = include_str!("../../../../config/robots/tiago_dual.toml");
/// The shipped URDF.
pub const URDF: &str = include_str!("../../../../config/robots/tiago_dual.urdf");

/// The shipped robot file with grippers.
pub const GRIPPER_TOML: &str = include_str!("../../../../config/robots/tiago_dual_pal_gripper.toml");
/// Its URDF.
pub const GRIPPER_URDF: &str = include_str!("../../../../config/robots/tiago_dual_pal_gripper.urdf");

/// Creates a model from these texts.
pub fn load(toml: &str, urdf: &str) -> Result<Model, RobotError> {
    Model::from_text("tiago_dual.toml", toml, "tiago_dual.urdf", urdf)
}

/// The shipped robot.
pub fn shipped() -> Model {
    load(TOML, URDF).unwrap_or_else(|error| panic!("{error}"))
}

/// A configuration that is uniformly distributed within the URDF's limits, rad and m.
pub fn uniform(model: &Model, rng: &mut rand_pcg::Pcg64) -> [f64; JOINTS_MAX] {
    let mut q = [0.0; JOINTS_MAX];
    for (q, limits) in q.iter_mut().zip(&model.urdf_limits).take(model.count) {
        *q = rng.random_range(limits.q_min..limits.q_max);
    }
    q
}
