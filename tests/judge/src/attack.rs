//! Targets and permits that try to make the robot break a promise.

use crate::nearest::RANKS;
use crate::robot::Robot;
use messages::{ALL_JOINTS, JOINTS_MAX};
use rand::RngExt;
use rand_pcg::Pcg64;

messages::named! {
    /// The attacker's behaviour for some time.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    #[repr(usize)]
    pub enum Attack {
        /// A random posture, most of them in collision, some joints far beyond their limits.
        Jump = 0 => "jump",
        /// Joints at their limits to within rounding, or far beyond, with outward velocities.
        Limits = 1 => "limits",
        /// Both arms into each other: mirrored postures that meet.
        Mirrored = 2 => "mirrored",
        /// White noise about a posture, velocities too.
        Noise = 3 => "noise",
        /// A new posture in every tick.
        Teleport = 4 => "teleport",
        /// Postures that descend the distance of a near pair.
        Gradient = 5 => "gradient",
        /// Postures along the collision boundary, with stated velocities that go straight through it.
        Hug = 6 => "hug",
        /// Sines that require more than the limits allow, with false velocities.
        Wave = 7 => "wave",
        /// NaN, infinities and absurd numbers.
        Nonsense = 8 => "nonsense",
    }
}

/// Ticks between two updates of the nearest pair: 3 ms, in which no joint moves more than 10 mrad.
const LOOK_EVERY: u64 = 5;

/// A source of targets and permits.
pub struct Attacker<'a> {
    robot: &'a Robot,
    rng: Pcg64,
    /// The current attack.
    pub attack: Attack,
    until: u64,
    permit_until: u64,
    base: [f64; JOINTS_MAX],
    phase: f64,
    rank: usize,
    /// Target positions, rad or m.
    pub q: [f64; JOINTS_MAX],
    /// Target velocities, rad/s or m/s.
    pub dq: [f64; JOINTS_MAX],
    /// Joints that have a target. None means no target at all.
    pub valid_mask: Option<u32>,
    /// The permitted share of the speed limits. None is a stop.
    pub speed_scale: Option<f64>,
}

impl<'a> Attacker<'a> {
    /// Creates an attacker of `robot`. `rng` decides its every choice.
    pub fn new(robot: &'a Robot, rng: Pcg64) -> Self {
        Self {
            robot,
            rng,
            attack: Attack::Jump,
            until: 0,
            permit_until: 0,
            base: robot.home,
            phase: 0.0,
            rank: 0,
            q: robot.home,
            dq: [0.0; JOINTS_MAX],
            valid_mask: Some(ALL_JOINTS),
            speed_scale: Some(1.0),
        }
    }

    /// Decides target and permit of tick `k`, given the last command `seen`.
    pub fn next(&mut self, k: u64, seen: &[f64; JOINTS_MAX]) {
        if k >= self.until {
            self.begin(k);
        }
        if k >= self.permit_until {
            self.change_permit(k);
        }
        match self.attack {
            Attack::Jump | Attack::Limits | Attack::Mirrored => {}
            Attack::Noise => self.noise(),
            Attack::Teleport => self.q = self.robot.posture(&mut self.rng),
            Attack::Gradient if k.is_multiple_of(LOOK_EVERY) => self.downhill(seen),
            Attack::Hug if k.is_multiple_of(LOOK_EVERY) => self.hug(seen),
            Attack::Gradient | Attack::Hug => {}
            Attack::Wave => self.wave(k),
            Attack::Nonsense => self.nonsense(),
        }
    }

    fn begin(&mut self, k: u64) {
        self.until = k + self.rng.random_range(20..1500);
        self.dq = [0.0; JOINTS_MAX];
        self.valid_mask = match self.rng.random_range(0..40) {
            0 => None,
            1..6 => Some(self.rng.random_range(0..1 << self.robot.count)),
            _ => Some(ALL_JOINTS),
        };
        self.base = self.robot.posture(&mut self.rng);
        self.phase = self.rng.random_range(0.0..std::f64::consts::TAU);
        self.rank = self.rng.random_range(0..RANKS);
        self.q = self.base;
        self.attack = match self.rng.random_range(0..20) {
            0..5 => Attack::Jump,
            5..7 => Attack::Limits,
            7..10 => Attack::Mirrored,
            10 => Attack::Noise,
            11 => Attack::Teleport,
            12..15 => Attack::Gradient,
            15..17 => Attack::Hug,
            17..19 => Attack::Wave,
            _ => Attack::Nonsense,
        };
        match self.attack {
            Attack::Jump => self.beyond_some_limits(),
            Attack::Limits => self.limits(),
            Attack::Mirrored => self.mirrored(),
            _ => {}
        }
    }

    /// Permits full speed most of the time, with some stops, some slow permits, and some that change in every tick.
    fn change_permit(&mut self, k: u64) {
        let flutter = self.rng.random_range(0..12) == 0;
        let ticks = if flutter { 1..3 } else { 10..1500 };
        self.permit_until = k + self.rng.random_range(ticks);
        self.speed_scale = match self.rng.random_range(0..20) {
            0..2 => None,
            2..7 => Some(self.rng.random_range(0.01..1.0)),
            7 => Some([0.0, -1.0, f64::NAN, 1e9][self.rng.random_range(0..4)]),
            _ => Some(1.0),
        };
        if flutter {
            // Change again soon.
            self.permit_until = self.permit_until.min(k + 2);
        }
    }

    /// Sends one in five joints far beyond a limit.
    fn beyond_some_limits(&mut self) {
        for j in 0..self.robot.count {
            let limits = &self.robot.limits[j];
            match self.rng.random_range(0..10) {
                0 => self.q[j] = limits.q_min - 1.0,
                1 => self.q[j] = limits.q_max + 1.0,
                _ => {}
            }
        }
    }

    fn limits(&mut self) {
        for j in 0..self.robot.count {
            let limits = &self.robot.limits[j];
            let outwards = [0.0, 1e-12, 1e-6, -1e-6, -1e-3, 5.0][self.rng.random_range(0..6)];
            let up = self.rng.random_bool(0.5);
            self.q[j] = if up { limits.q_max + outwards } else { limits.q_min - outwards };
            let speed = [0.0, 1.0, 10.0, 1e6][self.rng.random_range(0..4)] * limits.v_max;
            self.dq[j] = if up { speed } else { -speed };
        }
    }

    /// Sets mirrored postures, forward and inward, in which the hands meet.
    fn mirrored(&mut self) {
        let arm = self.robot.signs.len();
        let [left, right] = [self.robot.count - 2 * arm, self.robot.count - arm];
        for i in 0..arm {
            self.q[right + i] = self.robot.signs[i] * self.q[left + i];
        }
        let inwards = self.rng.random_range(0.0..0.6);
        self.q[left] = self.robot.limits[left].q_max - inwards;
        self.q[right] = self.robot.signs[0] * self.q[left];
    }

    fn noise(&mut self) {
        for j in 0..self.robot.count {
            self.q[j] = self.base[j] + self.rng.random_range(-0.1..0.1);
            self.dq[j] = self.rng.random_range(-3.0..3.0);
        }
    }

    fn wave(&mut self, k: u64) {
        let t = k as f64 * messages::TICK_S;
        // Every second wave states a false velocity.
        let honest = if self.rank.is_multiple_of(2) { 1.0 } else { -4.0 };
        for j in 0..self.robot.count {
            let w = 2.0 + j as f64;
            let (sin, cos) = (w * t + self.phase).sin_cos();
            self.q[j] = self.base[j] + 0.6 * sin;
            self.dq[j] = honest * 0.6 * w * cos;
        }
    }

    fn nonsense(&mut self) {
        const VALUES: [f64; 8] =
            [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -f64::MAX, f64::MAX, 1e300, -0.0, f64::MIN_POSITIVE];
        for j in 0..self.robot.count {
            self.q[j] = VALUES[self.rng.random_range(0..VALUES.len())];
            self.dq[j] = VALUES[self.rng.random_range(0..VALUES.len())];
            // Some joints have valid targets, so that the motion is not simply held.
            if self.rng.random_bool(0.3) {
                (self.q[j], self.dq[j]) = (self.base[j], 0.0);
            }
        }
    }

    /// Direction in which a near pair's distance falls, as shares of each joint's largest speed.
    fn downward(&self, seen: &[f64; JOINTS_MAX]) -> Option<[f64; JOINTS_MAX]> {
        let gradient = self.robot.gradient(seen, self.rank)?;
        let weighted: [f64; JOINTS_MAX] = std::array::from_fn(|j| -gradient[j] * self.robot.limits[j].v_max);
        let largest = weighted.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        (largest > 0.0).then(|| weighted.map(|x| x / largest))
    }

    fn downhill(&mut self, seen: &[f64; JOINTS_MAX]) {
        let Some(down) = self.downward(seen) else { return };
        let ahead_s = [0.02, 0.1, 0.5][self.rng.random_range(0..3)];
        for j in 0..self.robot.count {
            let speed = down[j] * self.robot.limits[j].v_max;
            self.q[j] = seen[j] + ahead_s * speed;
            self.dq[j] = speed;
        }
    }

    fn hug(&mut self, seen: &[f64; JOINTS_MAX]) {
        let Some(down) = self.downward(seen) else { return };
        let lie = [1.0, 3.0, 100.0][self.rng.random_range(0..3)];
        let length: f64 = down.iter().map(|x| x * x).sum();
        // Go some way along the boundary, towards the base posture, and a little into the boundary.
        let mut along: [f64; JOINTS_MAX] = std::array::from_fn(|j| self.base[j] - seen[j]);
        // Body joints but a lift or a waist move no arm, and those move both.
        for along in along.iter_mut().take(self.robot.count - 2 * self.robot.signs.len()).skip(1) {
            *along = 0.0;
        }
        let into: f64 = (0..self.robot.count).map(|j| along[j] * down[j]).sum::<f64>() / length;
        for j in 0..self.robot.count {
            let tangent = along[j] - into * down[j];
            self.q[j] = seen[j] + tangent.clamp(-0.3, 0.3) + 0.02 * down[j];
            self.dq[j] = lie * down[j] * self.robot.limits[j].v_max;
        }
    }
}
