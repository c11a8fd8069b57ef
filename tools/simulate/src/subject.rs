//! The test subject: settings and robot from a file, and a run that has engaged, from which others branch.

use crate::run::Run;
use client::{PlayOptions, Player};
use config::{ConfigError, Interface, Overrides, RobotChoice};
use messages::{JOINTS_MAX, Mode, TICK_HZ};
use motion::CalibrationMode;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use robot::{Frames, Model};
use safety::monitor;
use std::path::Path;
use world::WorldConfig;

/// Number of postures in which a robot is found.
const POSTURES: usize = 16;
/// How far outside its limits a robot is found, rad. The torso uses a tenth of it, m. Recovery takes less than
/// a second.
const OUTSIDE: f64 = 0.02;
/// How much closer to itself a robot is found than a start permits, m.
const CLOSER_M: f64 = 0.002;
/// Ticks of motion of the run from which others branch, after it has engaged: three seconds. The oracle judges
/// in them whether the robot does what the person does.
const MOVED: u64 = 3 * TICK_HZ + 10;
/// Ticks within which that run must have engaged: 20 s.
const ENGAGED_WITHIN: u64 = 20 * TICK_HZ;

pub struct Subject {
    pub config: WorldConfig,
    pub player: Player,
    /// One camera sees the person, see `camera.rs`.
    pub is_camera: bool,
    /// A policy leads, see `policy.rs`.
    pub is_policy: bool,
    /// Postures slightly outside the limits.
    pub outside: Vec<[f64; JOINTS_MAX]>,
    /// Postures slightly too close to self-collision.
    pub close: Vec<[f64; JOINTS_MAX]>,
}

impl Subject {
    pub fn model(&self) -> &Model {
        &self.config.control.model
    }

    pub fn load(config: &Path, robot: Option<&RobotChoice>) -> Result<Self, ConfigError> {
        let loaded = config::load(config, Overrides::robot(robot))?;
        if loaded.settings.interface() == Interface::Jtc100Restart {
            let cause = "driver.interface = \"jtc100-restart\" breaks limits on purpose; simulate looks for what breaks them otherwise";
            return Err(ConfigError::Syntax { file: config.display().to_string(), cause: cause.into() });
        }
        let model = &loaded.model;
        let play = PlayOptions { speed: 1.0, looped: true, calibration: CalibrationMode::First10s };
        Ok(Self {
            is_camera: false,
            is_policy: false,
            player: Player::new(&motion::builtin(), play, 1, 1),
            outside: outside(model),
            close: close(model),
            config: WorldConfig::recoverable(&loaded)?,
        })
    }

    /// Returns a run that has engaged and moved for three seconds. With `is_remote`, the operator and the person are at
    /// another machine, see `remote.rs`.
    pub fn engaged(&self, is_remote: bool) -> Result<Run<'_>, String> {
        let mut run = Run::cold(self, 1, is_remote).quiet();
        let mut left = ENGAGED_WITHIN;
        let mut moved = 0;
        while moved < MOVED {
            run.tick().map_err(|v| format!("without any fault: tick {}, {}: {}", v.tick, v.invariant, v.detail))?;
            moved += u64::from(run.mode() == Mode::Engaged);
            left -= 1;
            if left == 0 {
                return Err("without any fault the robot did not engage".into());
            }
        }
        Ok(run)
    }
}

fn outside(model: &Model) -> Vec<[f64; JOINTS_MAX]> {
    let mut rng = Pcg64Mcg::seed_from_u64(43);
    (0..POSTURES)
        .map(|_| {
            let mut q = model.home;
            let joint = rng.random_range(0..model.count);
            let (limits, stops) = (&model.limits[joint], &model.urdf_limits[joint]);
            let by = OUTSIDE * if model.prismatic[joint] { 0.1 } else { 1.0 };
            q[joint] = if rng.random() { limits.q_max + by } else { limits.q_min - by };
            q[joint] = q[joint].clamp(stops.q_min, stops.q_max);
            q
        })
        .collect()
}

/// Moves from home towards random postures until the measured clearance is slightly less than a start needs.
fn close(model: &Model) -> Vec<[f64; JOINTS_MAX]> {
    let mut rng = Pcg64Mcg::seed_from_u64(44);
    let mut frames = Frames::default();
    let wanted = model.d_measured_min_m - CLOSER_M;
    let mut clearance = |q: &[f64; JOINTS_MAX]| monitor::measured_clearance(model, &mut frames, q).distance_m;
    let mut found = Vec::new();
    for _ in 0..100_000 {
        let to: [f64; JOINTS_MAX] = std::array::from_fn(|j| {
            let limits = &model.limits[j];
            if j < model.count { rng.random_range(limits.q_min..=limits.q_max) } else { 0.0 }
        });
        let at = |s: f64| -> [f64; JOINTS_MAX] { std::array::from_fn(|j| model.home[j] + s * (to[j] - model.home[j])) };
        let (mut low, mut high) = (0.0, 1.0);
        if clearance(&at(low)) <= wanted || clearance(&at(high)) >= wanted {
            continue;
        }
        for _ in 0..40 {
            let middle = (low + high) / 2.0;
            if clearance(&at(middle)) > wanted { low = middle } else { high = middle }
        }
        found.push(at(high));
        if found.len() == POSTURES {
            break;
        }
    }
    if found.is_empty() { vec![model.home] } else { found }
}
