//! Whole-body control proposes, the gate disposes: both stages as the daemon's control tick runs them.

use crate::error::TortureError;
use driver::Motion;
use messages::{JOINTS, Stamp};
use pipeline::{Commanded, Commander, Overrides, RobotInterface};
use robot::Model;
use safety::engage::Permit;
use safety::gate;
use std::path::Path;
use std::time::Instant;

/// A robot with the configuration of every stage.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The robot.
    pub model: Model,
    /// Of whole-body control.
    pub wbc: wbc::Config,
    /// Of the gate; without one the proposals are what is sent.
    pub gate: Option<gate::Config>,
    /// Of the simulated robot, whose encoders are exact: what is judged are commands.
    pub sim: sim::Config,
}

impl Subject {
    /// The robot of a settings file among the obstacles that it names, or of a robot file without any; `certified`: see
    /// [`Subject::of`]. What is attacked takes every command at its index: settings with another interface are refused.
    ///
    /// # Errors
    /// Names the file, the key, the value and the bound.
    pub fn load(config: &Path, robot: Option<&Path>, certified: bool) -> Result<Self, TortureError> {
        match robot {
            Some(file) => Self::of(pipeline::load_model(file)?.0, file, certified),
            None => {
                let loaded = pipeline::load(config, Overrides::default())?;
                match loaded.settings.sim.interface {
                    RobotInterface::Direct => Self::of(loaded.model, config, certified),
                    other => Err(TortureError::Interface { file: config.to_path_buf(), value: other.name() }),
                }
            }
        }
    }

    /// This robot, from `file`; with `certified` as the daemon runs it, else without certificate and gate, which shows that
    /// the attacks are attacks.
    ///
    /// # Errors
    /// Names the file and the stage that refuses the robot.
    pub fn of(model: Model, file: &Path, certified: bool) -> Result<Self, TortureError> {
        let options = if certified { wbc::Options::default() } else { wbc::Options::without_certificate_for_tests() };
        let exact = sim::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, ..sim::Options::default() };
        let gate = gate::Config::new(&model).map_err(|error| TortureError::stage(file, "gate", error))?;
        Ok(Self {
            wbc: wbc::Config::new(&model, options)
                .map_err(|error| TortureError::stage(file, "whole-body control", error))?,
            gate: certified.then_some(gate),
            sim: sim::Config::new(&model, &exact)
                .map_err(|error| TortureError::stage(file, "simulated robot", error))?,
            model,
        })
    }
}

/// Both stages of one robot.
#[derive(Clone, Debug)]
pub struct Stages<'a> {
    subject: &'a Subject,
    commander: Commander,
}

impl<'a> Stages<'a> {
    /// Both at rest at `q` (rad, m).
    pub fn at_rest(subject: &'a Subject, q: [f64; JOINTS]) -> Self {
        Self { subject, commander: Commander::at_rest(&subject.wbc, q) }
    }

    /// Continues from what the driver executes.
    pub fn reseed(&mut self, motion: &Motion) {
        self.commander.reseed(motion);
    }

    /// One tick of both, and how long it took, ns. Without a gate the proposal is what is sent.
    pub fn tick(&mut self, k: u64, now: Stamp, target: Option<wbc::Target<'_>>, permit: Permit) -> (Commanded, u64) {
        let Self { subject, commander } = self;
        let begun = Instant::now();
        let out = match &subject.gate {
            Some(gate) => commander.tick((&subject.wbc, gate), k, now, target, permit),
            None => {
                let proposed = commander.propose(&subject.wbc, k, now, target, permit);
                let wbc::Output { q, v, a, plan, .. } = proposed;
                Commanded { motion: Motion { q, v, a, plan }, denied: None, proposed }
            }
        };
        (out, u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }
}
