//! Whole-body control proposes, the gate disposes: both stages as the daemon's control tick runs them.

use crate::error::TortureError;
use driver::Motion;
use messages::{JOINTS, Stamp};
use pipeline::{Commanded, Commander, Overrides, RobotInterface};
use robot::{Model, Payload};
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
    /// Bound on elbows and hands, m/s.
    pub hand_speed_m_per_s: f64,
    /// The driver also pauses for longer than one motion lasts.
    pub pauses: bool,
}

/// The bound of a robot without settings: their default.
const HAND_SPEED_MAX_M_PER_S: f64 = 3.0;

impl Subject {
    /// The robot of a settings file among the obstacles that it names, or of a robot file without any; `certified`: see
    /// [`Subject::of`]. What is attacked takes every command at its index: settings with another interface are refused.
    ///
    /// # Errors
    /// Names the file, the key, the value and the bound.
    pub fn load(config: &Path, robot: Option<&Path>, certified: bool) -> Result<Self, TortureError> {
        match robot {
            Some(file) => Self::of(pipeline::load_model(file)?.0, file, certified, HAND_SPEED_MAX_M_PER_S),
            None => {
                let loaded = pipeline::load(config, Overrides::default())?;
                match loaded.settings.sim.interface {
                    RobotInterface::Direct => {
                        Self::of(loaded.model, config, certified, loaded.settings.safety.hand_speed_m_per_s())
                    }
                    other => Err(TortureError::Interface { file: config.to_path_buf(), value: other.name() }),
                }
            }
        }
    }

    /// This robot, from `file`, with hands no faster than `hand_speed` (m/s); with `certified` as the daemon runs it, else without certificate and gate, which shows that
    /// the attacks are attacks.
    ///
    /// # Errors
    /// Names the file and the stage that refuses the robot.
    pub fn of(model: Model, file: &Path, certified: bool, hand_speed: f64) -> Result<Self, TortureError> {
        let options = if certified { wbc::Options::default() } else { wbc::Options::without_certificate_for_tests() };
        let options = options.hand_speed_m_per_s(hand_speed);
        let exact = exact_robot(hand_speed);
        let gate = gate_of(&model, file, hand_speed)?;
        Ok(Self {
            wbc: wbc::Config::new(&model, options)
                .map_err(|error| TortureError::stage(file, "whole-body control", error))?,
            gate: certified.then_some(gate),
            hand_speed_m_per_s: hand_speed,
            pauses: true,
            sim: sim::Config::new(&model, &exact)
                .map_err(|error| TortureError::stage(file, "simulated robot", error))?,
            model,
        })
    }

    /// The same without the proof of torques.
    ///
    /// # Errors
    /// Names the file, and what whole-body control refuses.
    pub fn without_torque(self, file: &Path) -> Result<Self, TortureError> {
        let options = wbc::Options::without_torque_for_tests().hand_speed_m_per_s(self.hand_speed_m_per_s);
        let wbc = wbc::Config::new(&self.model, options);
        Ok(Self { wbc: wbc.map_err(|error| TortureError::stage(file, "whole-body control", error))?, ..self })
    }

    /// The same with so much in both hands, kg, where the robot file says that they grasp; with `told`, whole-body control knows.
    /// Without, arms give way, and a driver that pauses finds the robot off its way: it does not pause.
    ///
    /// # Errors
    /// Names the file, and what a stage refuses.
    pub fn with_payload(mut self, file: &Path, mass_kg: f64, told: bool) -> Result<Self, TortureError> {
        let exact = sim::Options { payload_kg: [Some(mass_kg); 2], ..exact_robot(self.hand_speed_m_per_s) };
        self.sim = sim::Config::new(&self.model, &exact)
            .map_err(|error| TortureError::stage(file, "simulated robot", error))?;
        self.pauses &= told;
        if told {
            self.model.payload = self.model.payload.map(|hand| hand.map(|hand| Payload { mass_kg, ..hand }));
            let options = wbc::Options::default().hand_speed_m_per_s(self.hand_speed_m_per_s);
            self.wbc = wbc::Config::new(&self.model, options)
                .map_err(|error| TortureError::stage(file, "whole-body control", error))?;
        }
        Ok(self)
    }

    /// The same with the gate, whatever whole-body control leaves out.
    ///
    /// # Errors
    /// Names the file, and what the gate refuses.
    pub fn with_gate(self, file: &Path) -> Result<Self, TortureError> {
        let gate = gate_of(&self.model, file, self.hand_speed_m_per_s)?;
        Ok(Self { gate: Some(gate), ..self })
    }
}

/// A simulated robot whose encoders are exact.
fn exact_robot(hand_speed_max_m_per_s: f64) -> sim::Options {
    sim::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, hand_speed_max_m_per_s, ..sim::Options::default() }
}

fn gate_of(model: &Model, file: &Path, hand_speed: f64) -> Result<gate::Config, TortureError> {
    let gate = gate::Config::new(model).and_then(|gate| gate.with_hand_speed(hand_speed));
    gate.map_err(|error| TortureError::stage(file, "gate", error))
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
