//! Torques that hold a posture against gravity, for a robot whose motors are springs.
//!
//! With 80 N m/rad a stretched arm of G1 would sag by 78 mrad. The driver departs from a robot that is 50 mrad off. So
//! xr_teleoperate sends such torques, too. With the height z_b(q) of each body's centre of mass the potential energy is
//! U = sum m_b g z_b, and
//!
//! ```text
//! tau_j = dU / dq_j = g sum m_b dz_b / dq_j
//! ```
//!
//! The base stands upright. A robot that leans needs other torques.

use messages::JOINTS_MAX;
use robot::{Frames, Inertia, Model};

/// Standard gravity, m/s^2 (ISO 80000-3).
const G: f64 = 9.80665;

pub struct Gravity {
    model: Model,
    bodies: [Inertia; JOINTS_MAX + 1],
}

impl Gravity {
    /// Masses of the URDF's links, and of the payloads in the robot file.
    pub fn new(model: &Model) -> Self {
        let mut bodies = model.inertias();
        for (arm, payload) in model.arms.iter().zip(&model.payload) {
            if let Some(payload) = payload {
                let hand = &mut bodies[arm.hand_body()];
                *hand = hand.combined(&Inertia::point(payload.mass_kg, payload.center));
            }
        }
        Self { model: model.clone(), bodies }
    }

    /// Torques at the posture `q`, N m and N.
    pub fn torques(&self, q: &[f64; JOINTS_MAX]) -> [f64; JOINTS_MAX] {
        let mut frames = Frames::default();
        self.model.forward(q, &mut frames);
        let mut torques = [0.0; JOINTS_MAX];
        for body in 1..=self.model.count {
            let centre = frames.base_from_body[body].transform_point(&self.bodies[body].center);
            let columns = self.model.jacobian(&frames, body, &centre);
            for (torque, column) in torques.iter_mut().zip(&columns) {
                *torque += G * self.bodies[body].mass_kg * column[2];
            }
        }
        torques
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bias forces of MuJoCo 4.0.0 on the same URDF, N m: waist, left and right arm. Joint i stands at 0.1 (i + 1) (-1)^i rad.
    const MUJOCO: [f64; 17] = [
        0.0, 4.3531, -9.3394, -1.6644, 0.7243, 0.4047, -1.0076, -0.1769, 0.0329, -0.169, 2.0185, -1.0951, 0.2492,
        -0.8145, -0.2476, -0.0797, 0.11,
    ];

    #[test]
    fn torques_are_those_of_mujoco() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/unitree_g1.toml");
        let (model, _) = config::load_model(file.as_ref()).expect("the shipped robot");
        assert_eq!(model.count, MUJOCO.len());
        let q = std::array::from_fn(|j| 0.1 * (j + 1) as f64 * if j % 2 == 0 { 1.0 } else { -1.0 });
        let torques = Gravity::new(&model).torques(&q);
        for (j, (torque, expected)) in torques.iter().zip(MUJOCO).enumerate() {
            let (name, error) = (&model.joint_names[j], torque - expected);
            assert!(error.abs() < 1e-3 * expected.abs().max(1.0), "{name}: {torque} is not {expected}");
        }
    }
}
