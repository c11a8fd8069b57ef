//! Code that the tests of this crate share.

use messages::{JOINTS_MAX, Stamp, StopPlan};
use plant::{Body, Config, Options, Setpoint};
use rand::RngExt;

/// A shipped robot: name of the robot file, its text, name of the URDF, its text.
pub(crate) type Texts = [&'static str; 4];

/// Returns the texts of a shipped robot.
macro_rules! shipped {
    ($robot:literal, $urdf:literal) => {
        [
            $robot,
            include_str!(concat!("../../../../config/robots/", $robot)),
            $urdf,
            include_str!(concat!("../../../../config/robots/", $urdf)),
        ]
    };
}

/// The robot with two Hey5 hands.
pub(crate) const HANDS: Texts = shipped!("tiago_dual.toml", "tiago_dual.urdf");
/// The robot with two PAL grippers.
pub(crate) const GRIPPERS: Texts = shipped!("tiago_dual_pal_gripper.toml", "tiago_dual_pal_gripper.urdf");
pub(crate) const OPENARM: Texts = shipped!("openarm_v10.toml", "openarm_v10.urdf");
pub(crate) const UR5E: Texts = shipped!("ur5e_pair.toml", "ur5e_pair.urdf");

/// Joints of TIAGo++.
pub(crate) const JOINTS: usize = 17;
/// The left arm's joints, and the right arm's.
pub(crate) const ARMS: [std::ops::Range<usize>; 2] = [3..10, 10..17];
/// The left elbow.
pub(crate) const ELBOW: usize = 6;

/// Start time of every test, long after the origin of the clock.
pub(crate) const START: Stamp = Stamp(1_000_000_000_000);
/// A tick of 1/1500 s, ns.
pub(crate) const TICK_NS: u64 = 666_667;

pub(crate) fn body(texts: [&str; 4]) -> Body {
    let [toml_name, toml, urdf_name, urdf] = texts;
    Body::from_text(toml_name, toml, urdf_name, urdf).unwrap_or_else(|error| panic!("{error}"))
}

pub(crate) fn config(texts: Texts, options: &Options) -> Config {
    let [toml_name, toml, urdf_name, urdf] = texts;
    Config::from_text(toml_name, toml, urdf_name, urdf, options).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns a posture uniform within the URDF's limits.
pub(crate) fn uniform(body: &Body, rng: &mut rand_pcg::Pcg64) -> [f64; JOINTS_MAX] {
    let mut q = [0.0; JOINTS_MAX];
    for (q, joint) in q.iter_mut().zip(&body.joints) {
        *q = rng.random_range(joint.urdf.q_min..joint.urdf.q_max);
    }
    q
}

/// Returns a setpoint without a plan.
pub(crate) fn setpoint(k: u64, q: [f64; JOINTS_MAX], v: [f64; JOINTS_MAX], a: [f64; JOINTS_MAX]) -> Setpoint {
    let plan = StopPlan { jerk: [[0.0; 3]; JOINTS_MAX], duration_s: [[0.0; 3]; JOINTS_MAX] };
    Setpoint { k, q, v, a, plan }
}

/// Returns a setpoint at rest at `q`.
pub(crate) fn rest(k: u64, q: [f64; JOINTS_MAX]) -> Setpoint {
    setpoint(k, q, [0.0; JOINTS_MAX], [0.0; JOINTS_MAX])
}

/// Sines about a centre on all joints: amplitude, angular frequency and phase of each.
#[derive(Clone)]
pub(crate) struct Sines {
    pub(crate) centre: [f64; JOINTS_MAX],
    pub(crate) rows: [[f64; 3]; JOINTS_MAX],
}

impl Sines {
    /// Returns random sines that use the limits of speed or acceleration, whichever comes first, within the range
    /// of positions.
    pub(crate) fn random(body: &Body, rng: &mut rand_pcg::Pcg64, share: f64) -> Self {
        let mut sines = Self { centre: [0.0; JOINTS_MAX], rows: [[0.0; 3]; JOINTS_MAX] };
        for (j, joint) in body.joints.iter().enumerate() {
            let limits = &joint.limits;
            let (v_max, a_max) = (share * limits.v_max, share * limits.a_max);
            let reach = 0.45 * (limits.q_max - limits.q_min);
            // A w = v and A w^2 = a at once if the frequency is a / v.
            let omega = a_max / v_max * rng.random_range(0.4..2.5);
            let amplitude = (v_max / omega).min(a_max / (omega * omega)).min(reach);
            let centre = rng.random_range(limits.q_min + amplitude..limits.q_max - amplitude);
            sines.centre[j] = centre;
            sines.rows[j] = [amplitude, omega, rng.random_range(0.0..std::f64::consts::TAU)];
        }
        sines
    }

    /// Returns random sines at the share `most` of the limits, or as near to it as the motors can bear. None asks
    /// for more than 0.85 of an effort limit, as no command of whole-body control does.
    pub(crate) fn bearable(config: &Config, rng: &mut rand_pcg::Pcg64, most: f64) -> Self {
        let mut share = most;
        loop {
            let sines = Self::random(config.body(), rng, share);
            let asked = (0..9000).step_by(10).map(|k| sines.torque_share(config, k)).fold(0.0, f64::max);
            if asked <= 0.85 {
                return sines;
            }
            share *= 0.97;
        }
    }

    /// Returns the largest torque of tick `k` over its effort limit.
    fn torque_share(&self, config: &Config, k: u64) -> f64 {
        let at = self.at(k);
        let torques = config.links().torques(&at.q, &at.v, &at.a).into_iter().zip(&config.body().joints);
        torques.map(|(torque, joint)| torque.abs() / joint.limits.effort_max).fold(0.0, f64::max)
    }

    /// Returns the setpoint of tick `k`. It begins at rest. A ramp lets the sines grow within the first two seconds.
    pub(crate) fn at(&self, k: u64) -> Setpoint {
        let (t, u) = (k as f64 / 1500.0, (k as f64 / 3000.0).min(1.0));
        let (ramp, rate) = (u * u * u * (10.0 + u * (-15.0 + 6.0 * u)), 15.0 * u * u * (1.0 - u) * (1.0 - u));
        let bend = 15.0 * u * (1.0 - u) * (1.0 - 2.0 * u);
        let mut out = rest(k, self.centre);
        for (j, [amplitude, omega, phase]) in self.rows.into_iter().enumerate() {
            let (sin, cos) = (omega * t + phase).sin_cos();
            let (x, dx, ddx) = (amplitude * sin, amplitude * omega * cos, -amplitude * omega * omega * sin);
            out.q[j] += ramp * x;
            out.v[j] = rate * x + ramp * dx;
            out.a[j] = bend * x + 2.0 * rate * dx + ramp * ddx;
        }
        out
    }
}
