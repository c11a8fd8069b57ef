//! Whole-body control proposes, the gate disposes: both stages as the daemon's control tick runs them.

use crate::error::TortureError;
use driver::Motion;
use messages::{JOINTS, Stamp};
use pipeline::{Overrides, RobotInterface};
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

/// Both stages with all that they remember.
#[derive(Clone, Debug)]
pub struct Stages<'a> {
    subject: &'a Subject,
    wbc: wbc::State,
    gate: gate::State,
}

/// What a tick of both stages results in.
#[derive(Clone, Copy, Debug)]
pub struct Commanded {
    /// What is sent.
    pub motion: Motion,
    /// Why the gate denied the proposal.
    pub denied: Option<gate::Denial>,
    /// What whole-body control proposed and says of it.
    pub proposed: wbc::Output,
    /// Duration of both ticks, ns.
    pub ns: u64,
}

impl<'a> Stages<'a> {
    /// Both at rest at `q` (rad, m).
    pub fn at_rest(subject: &'a Subject, q: [f64; JOINTS]) -> Self {
        Self { subject, wbc: wbc::State::at_rest(&subject.wbc, q), gate: gate::State::at_rest(q) }
    }

    /// Continues from what the driver executes.
    pub fn reseed(&mut self, motion: &Motion) {
        self.wbc.reseed(&planned(motion));
        self.gate.reseed(&motion.q, &motion.v, &motion.a, &motion.plan);
    }

    /// One tick of both.
    pub fn tick(&mut self, k: u64, now: Stamp, target: Option<wbc::Target<'_>>, permit: Permit) -> Commanded {
        let Self { subject, wbc, gate } = self;
        let allowed = match permit {
            Permit::Follow { speed_scale } => wbc::Permit::Follow { speed_scale },
            _ => wbc::Permit::Stop,
        };
        let begun = Instant::now();
        let proposed = wbc::tick(&subject.wbc, wbc, now, wbc::Input { k, target, permit: allowed });
        let wbc::Output { q, v, a, plan, .. } = proposed;
        let Some(config) = &subject.gate else {
            return Commanded { motion: Motion { q, v, a, plan }, denied: None, proposed, ns: elapsed_ns(begun) };
        };
        let decision = gate::tick(config, gate, now, gate::Proposed { k, permit, q, v, a, plan });
        let ns = elapsed_ns(begun);
        let motion = Motion { q: decision.q, v: decision.v, a: decision.a, plan: decision.plan };
        let denied = match decision.verdict {
            gate::Verdict::Deny(denial) => Some(denial),
            gate::Verdict::Accept | gate::Verdict::OnPlan => None,
        };
        if denied.is_some() {
            wbc.reseed(&planned(&motion));
        }
        Commanded { motion, denied, proposed, ns }
    }
}

fn elapsed_ns(begun: Instant) -> u64 {
    u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

fn planned(motion: &Motion) -> wbc::Planned {
    wbc::Planned { q: motion.q, v: motion.v, a: motion.a, plan: motion.plan }
}
