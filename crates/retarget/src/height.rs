//! The lift goes down as the person crouches.
//!
//! A person's shoulders are lower than legs and trunk are long. Walking and standing lower them by a share of that length, and
//! a crouch, a bow or a wide stand by more. The lift goes down from home by that, by the arms' lengths L:
//!
//! ```text
//! down = max(0, (1 - STANDING) (legs + trunk) - height) L_robot / L_person          m
//! ```

use messages::{SMPL_JOINTS, Smpl};
use nalgebra::Vector3;

/// Share of legs and trunk by which walking lowers the shoulders. In 27 CMU clips of walking and everyday motion it is at
/// most 0.08 while the person is upright.
const STANDING: f64 = 0.08;
/// Time constant of the lift's target, s. A crouch takes a second (assumption).
const SLOW_S: f64 = 0.5;
/// Share of the lift's speed that its target uses (assumption).
const SPEED: f64 = 0.5;

/// The joint that lifts the robot's torso.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lift {
    /// Index of the joint.
    pub joint: usize,
    /// Home position, m.
    pub home: f64,
    /// Lowest position, m.
    pub q_min: f64,
    /// Largest speed, m/s.
    pub v_max: f64,
}

impl Lift {
    /// Returns the next target, `elapsed_s` after `before`, for a person who is this much lower than one who stands, m.
    pub(crate) fn next(&self, before: f64, crouch_m: f64, elapsed_s: f64) -> f64 {
        let aim = (self.home - crouch_m).max(self.q_min.min(self.home));
        let step = (aim - before) * (elapsed_s / SLOW_S).min(1.0);
        let most = SPEED * self.v_max * elapsed_s;
        before + step.max(-most).min(most)
    }
}

/// Returns how much lower the shoulders are than those of a person who stands, m. `None` if a joint of legs or trunk was not
/// seen or is not finite.
pub fn crouch_m(positions: &[[f32; 3]; SMPL_JOINTS]) -> Option<f64> {
    let seen = |joint: Smpl| {
        let at = positions[joint as usize];
        (at != [0.0; 3] && at.iter().all(|x| x.is_finite())).then(|| Vector3::from(at).cast::<f64>())
    };
    let legs = [[Smpl::LeftHip, Smpl::LeftKnee, Smpl::LeftAnkle], [Smpl::RightHip, Smpl::RightKnee, Smpl::RightAnkle]];
    let (mut legs_m, mut floor, mut hips) = (0.0, f64::INFINITY, Vector3::zeros());
    for [hip, knee, ankle] in legs {
        let [hip, knee, ankle] = [seen(hip)?, seen(knee)?, seen(ankle)?];
        legs_m += ((hip - knee).norm() + (knee - ankle).norm()) / 2.0;
        floor = floor.min(ankle.z);
        hips += hip / 2.0;
    }
    let shoulders = (seen(Smpl::LeftShoulder)? + seen(Smpl::RightShoulder)?) / 2.0;
    let upright_m = (1.0 - STANDING) * (legs_m + (shoulders - hips).norm());
    Some((upright_m - (shoulders.z - floor)).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Legs of 0.4 m and 0.4 m, a trunk of 0.5 m, and knees in front by the sine of `bend`.
    fn person(bend_rad: f64) -> [[f32; 3]; SMPL_JOINTS] {
        let mut positions = [[0.0; 3]; SMPL_JOINTS];
        let (sin, cos) = bend_rad.sin_cos();
        let sides = [
            (0.1, [Smpl::LeftAnkle, Smpl::LeftKnee, Smpl::LeftHip, Smpl::LeftShoulder]),
            (-0.1, [Smpl::RightAnkle, Smpl::RightKnee, Smpl::RightHip, Smpl::RightShoulder]),
        ];
        for (y, joints) in sides {
            let heights = [(0.0, 0.1), (0.4 * sin, 0.1 + 0.4 * cos), (0.0, 0.1 + 0.8 * cos), (0.0, 0.6 + 0.8 * cos)];
            for (joint, (x, z)) in joints.into_iter().zip(heights) {
                positions[joint as usize] = [x as f32, y as f32, z as f32];
            }
        }
        positions
    }

    #[test]
    fn crouch_is_what_bent_knees_take_beyond_a_walk() {
        assert_eq!(crouch_m(&person(0.0)), Some(0.0));
        assert_eq!(crouch_m(&person(0.3)), Some(0.0));
        let deep_m = crouch_m(&person(1.0)).expect("all joints are seen");
        assert!((deep_m - (0.8 * (1.0 - 1.0_f64.cos()) - STANDING * 1.3)).abs() < 1e-5, "{deep_m} m");
        for joint in [Smpl::LeftKnee, Smpl::RightAnkle, Smpl::LeftShoulder] {
            for gone in [[0.0; 3], [0.0, f32::NAN, 1.0]] {
                let mut positions = person(1.0);
                positions[joint as usize] = gone;
                assert_eq!(crouch_m(&positions), None);
            }
        }
    }
}
