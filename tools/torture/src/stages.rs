//! Runs both stages as the daemon's control tick does: whole-body control proposes, and the gate decides.

use crate::error::TortureError;
use config::{Overrides, RobotInterface};
use control::{Commanded, Commander};
use driver::Motion;
use judge::Attacker;
use messages::{JOINTS, Stamp};
use robot::{Model, Payload};
use safety::engage::Permit;
use safety::gate;
use std::path::Path;
use std::time::Instant;

/// A robot, with the configuration of every stage.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The robot.
    pub model: Model,
    /// The robot as its judge knows it.
    pub robot: judge::Robot,
    /// Configuration of whole-body control.
    pub wbc: wbc::Config,
    /// Configuration of the gate. Without a gate the proposals are sent.
    pub gate: Option<gate::Config>,
    /// Configuration of the simulated robot. Its encoders are exact, because the commands are judged.
    pub sim: sim::Config,
    /// Bound on the speed of elbows and hands, m/s.
    pub hand_speed_m_per_s: f64,
    /// True if the driver also pauses for longer than one motion lasts.
    pub pauses: bool,
}

/// Bound of a robot without settings. It is the default of the settings.
const HAND_SPEED_MAX_M_PER_S: f64 = 3.0;

impl Subject {
    /// Loads the robot of a settings file with its obstacles, or of a robot file without any. For `certified`,
    /// see [`Subject::of`]. The attack assumes that every command is executed at its index, so settings with
    /// another interface are rejected.
    ///
    /// # Errors
    /// Returns an error that names the file, the key, the value and the bound.
    pub fn load(config: &Path, robot: Option<&Path>, certified: bool) -> Result<Self, TortureError> {
        match robot {
            Some(file) => Self::of(config::load_model(file)?.0, file, certified, HAND_SPEED_MAX_M_PER_S),
            None => {
                let loaded = config::load(config, Overrides::default())?;
                match loaded.settings.sim.interface {
                    RobotInterface::Direct => {
                        Self::of(loaded.model, config, certified, loaded.settings.safety.hand_speed_m_per_s())
                    }
                    other => Err(TortureError::Interface { file: config.to_path_buf(), value: other.name() }),
                }
            }
        }
    }

    /// Creates the subject for this robot, from `file`, with hands no faster than `hand_speed` (m/s). If
    /// `certified` is true, the stages run as in the daemon. Otherwise they run without certificate and gate,
    /// which shows that the attacks are effective.
    ///
    /// # Errors
    /// Returns an error that names the file and the stage that rejects the robot.
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
            robot: judge::Robot::of(model.clone()),
            model,
        })
    }

    /// Returns the subject without the proof of torques.
    ///
    /// # Errors
    /// Returns an error that names the file, and the reason of whole-body control.
    pub fn without_torque(self, file: &Path) -> Result<Self, TortureError> {
        let options = wbc::Options::without_torque_for_tests().hand_speed_m_per_s(self.hand_speed_m_per_s);
        let wbc = wbc::Config::new(&self.model, options);
        Ok(Self { wbc: wbc.map_err(|error| TortureError::stage(file, "whole-body control", error))?, ..self })
    }

    /// Returns the subject with `mass_kg` in both hands, where the robot file says that they grasp. If `told`
    /// is true, whole-body control knows the payload. Otherwise arms give way, and a driver that pauses would
    /// find the robot off its path. So that driver does not pause.
    ///
    /// # Errors
    /// Returns an error that names the file, and the reason of the stage that rejects it.
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

    /// Returns the subject with the gate, regardless of what whole-body control leaves out.
    ///
    /// # Errors
    /// Returns an error that names the file, and the reason of the gate.
    pub fn with_gate(self, file: &Path) -> Result<Self, TortureError> {
        let gate = gate_of(&self.model, file, self.hand_speed_m_per_s)?;
        Ok(Self { gate: Some(gate), ..self })
    }
}

/// Options of a simulated robot with exact encoders.
fn exact_robot(hand_speed_max_m_per_s: f64) -> sim::Options {
    sim::Options { encoder_noise_rad: 0.0, encoder_step_rad: 0.0, hand_speed_max_m_per_s, ..sim::Options::default() }
}

fn gate_of(model: &Model, file: &Path, hand_speed: f64) -> Result<gate::Config, TortureError> {
    let gate = gate::Config::new(model).and_then(|gate| gate.with_hand_speed(hand_speed));
    gate.map_err(|error| TortureError::stage(file, "gate", error))
}

/// Returns the attacker's target as whole-body control takes it.
pub fn target<'a>(attacker: &'a Attacker<'_>) -> Option<wbc::Target<'a>> {
    let Attacker { q, dq, valid_mask, .. } = attacker;
    valid_mask.map(|valid_mask| wbc::Target { q, dq, ddq: &[0.0; JOINTS], valid_mask })
}

/// Returns the attacker's permit as engagement gives it.
pub fn permit(attacker: &Attacker<'_>) -> Permit {
    attacker.speed_scale.map_or(Permit::Stop, |speed_scale| Permit::Follow { speed_scale })
}

/// Both stages of one robot.
#[derive(Clone, Debug)]
pub struct Stages<'a> {
    subject: &'a Subject,
    commander: Commander,
}

impl<'a> Stages<'a> {
    /// Creates both stages at rest at `q` (rad, m).
    pub fn at_rest(subject: &'a Subject, q: [f64; JOINTS]) -> Self {
        Self { subject, commander: Commander::at_rest(&subject.wbc, q) }
    }

    /// Continues from the state that the driver executes.
    pub fn reseed(&mut self, motion: &Motion) {
        self.commander.reseed(motion);
    }

    /// Runs one tick of both stages, and returns its duration, ns. Without a gate the proposal is sent.
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
