//! Extracts the parts of a robot model that this stage needs.

use crate::chain::{ArmCounts, KinematicChain, KinematicLink, Placement};
use crate::config::{Config, Options, Parts, Tasks, WbcError};
use crate::dynamics::Mass;
use crate::geometry::BodyCapsule;
use crate::hand::HandSpeed;
use crate::interface::Controllers;
use crate::interval::Bounds;
use messages::JOINTS_MAX;
use robot::{Frames, Inertia, Model};

/// Largest difference between this crate's kinematics and the model's, m and entries of rotations. The
/// rounding of a chain of eight joints is below 1e-14.
const KINEMATICS_TOLERANCE: f64 = 1e-12;

impl Config {
    /// Creates the configuration for a robot. Its kinematics are checked against the model's at three postures.
    pub fn new(model: &Model, options: Options) -> Result<Self, WbcError> {
        let parts = Parts::from_model(model)?;
        check_kinematics(model, &parts.chain)?;
        let limits = parts.limits;
        let config = Self::from_parts(parts, options)?;
        let Some(max) = options.hand_speed() else { return Ok(config) };
        if !(max.is_finite() && max > 0.0) {
            return Err(WbcError::HandSpeed(max));
        }
        let points = model.speed_points().into_iter().map(|point| (point.body, point.at));
        Ok(Self { hand: HandSpeed::new(&config.geometry.chain, &limits, points, max), ..config })
    }
}

impl Parts {
    /// Extracts the parts of a robot model.
    pub fn from_model(model: &Model) -> Result<Self, WbcError> {
        let limits = model.limits.each_ref().map(|l| Bounds {
            q_min: l.q_min,
            q_max: l.q_max,
            v_max: l.v_max,
            a_max: l.a_max,
            brake: l.a_max,
            j_max: l.j_max,
        });
        let link = |j: usize| {
            let (pose, axis) = model.joint_at_zero(j);
            KinematicLink {
                parent: model.parent_body(j + 1).unwrap_or(0),
                parent_from_body: Placement { r: pose.r, t: pose.t },
                axis,
                prismatic: model.prismatic[j],
                stroke: limits[j].q_min.abs().max(limits[j].q_max.abs()),
            }
        };
        let links: Vec<KinematicLink> = (0..model.count).map(link).collect();
        let capsule = |c: &robot::Capsule| BodyCapsule { body: c.body, a: c.a, b: c.b, radius_m: c.radius_m };
        let mass = |i: Inertia| Mass { mass_kg: i.mass_kg, center: i.center, about_center: i.about_center };
        Ok(Self {
            chain: KinematicChain::new(&links, arm_counts(model))?,
            controllers: Controllers::new(model.controllers.iter().map(|controller| controller.joints)),
            limits,
            home: model.home,
            capsules: model.capsules.iter().map(capsule).collect(),
            pairs: model.pairs.iter().map(|p| [p.a, p.b]).collect(),
            obstacles: model.obstacles.iter().map(|obstacle| obstacle.solid).collect(),
            d_min_m: model.d_min_m,
            tasks: Tasks::from_model(model),
            masses: model.inertias().map(mass),
            payload: model.payload.map(Option::unwrap_or_default),
            effort_max: model.limits.each_ref().map(|l| l.effort_max),
            stop_time_max_s: model.stop_time_max_s,
        })
    }
}

fn arm_counts(model: &Model) -> ArmCounts {
    let arm = &model.arms[0];
    ArmCounts { joints: arm.range().len(), to_elbow: arm.elbow() + 1 - arm.range().start }
}

fn check_kinematics(model: &Model, chain: &KinematicChain) -> Result<(), WbcError> {
    let mut frames = Frames::default();
    let mut placements = [Placement::identity(); JOINTS_MAX + 1];
    for share in [0.1, 0.5, 0.8] {
        let q = model.limits.each_ref().map(|l| l.q_min + share * (l.q_max - l.q_min));
        model.forward(&q, &mut frames);
        chain.forward(&q, chain.all(), &mut placements);
        for joint in 0..chain.count() {
            let (ours, theirs) = (&placements[joint + 1], &frames.base_from_body[joint + 1]);
            let off = (ours.r - theirs.r).amax().max((ours.t - theirs.t).amax());
            if off.is_nan() || off > KINEMATICS_TOLERANCE {
                return Err(WbcError::Kinematics { joint, what: "forward kinematics differ from the model's" });
            }
        }
    }
    Ok(())
}

impl Tasks {
    /// Returns the costs that the robot file gives.
    fn from_model(model: &Model) -> Self {
        Self {
            joint_weight: model.joint_weight,
            limb_weight: model.limb_weight,
            limb_bodies: model.arms.each_ref().map(robot::Arm::limb_bodies),
        }
    }
}
