//! Runs both stages as the daemon's control tick does: whole-body control proposes, and the gate decides.

use crate::cli::Changes;
use config::{Interface, Overrides, RobotChoice};
use control::{Commanded, Commander};
use judge::Attacker;
use messages::{JOINTS_MAX, JointMotion, Stamp};
use robot::{Model, Payload};
use rt::{Exit, Failure};
use safety::engage::Permit;
use safety::gate;
use std::fmt::Display;
use std::path::Path;
use std::time::Instant;
use world::simulated;

#[derive(Clone, Debug)]
pub struct Subject {
    pub model: Model,
    /// The robot as its judge knows it.
    pub robot: judge::Robot,
    pub wbc: wbc::Config,
    /// Configuration of the gate. Without a gate the proposals are sent.
    pub gate: Option<gate::Config>,
    /// Configuration of the simulated robot and its driver. The encoders are exact, because the commands are judged.
    pub simulated: simulated::Config,
    /// True if the driver also pauses for longer than one motion lasts.
    pub pauses: bool,
}

impl Subject {
    /// Loads the chosen robot, or else that of the settings file, among the obstacles of the settings. The attack
    /// assumes that every command is executed at its index, so settings with another interface are rejected.
    pub fn load(config: &Path, robot: Option<&RobotChoice>, changes: Changes) -> Result<Self, Failure> {
        let loaded = config::load_robot(config, &Overrides::robot(robot));
        let (settings, model) = loaded.map_err(Failure::with(Exit::Config))?;
        match settings.interface() {
            Interface::Direct => Self::new(model, config, settings.safety.hand_speed_m_per_s(), changes),
            other => {
                let cause = "must be \"direct\"; no other interface is tested";
                Err(rejected(config, format!("driver.interface = \"{}\", {cause}", other.name())))
            }
        }
    }

    /// Creates the subject for this robot, from `file`, with hands no faster than `hand_speed` (m/s). Payloads are
    /// where the robot file says that the hands grasp.
    pub fn new(mut model: Model, file: &Path, hand_speed: f64, changes: Changes) -> Result<Self, Failure> {
        fn made<T>(file: &Path, stage: &str, made: Result<T, impl Display>) -> Result<T, Failure> {
            made.map_err(|error| rejected(file, format!("{stage}: {error}")))
        }
        let robot = judge::Robot::new(model.clone());
        let payload_kg = Some(changes.payload_kg).filter(|&mass_kg| mass_kg > 0.0);
        let exact = simulated::Options {
            driver: checker::Options {
                hand_speed_max_m_per_s: hand_speed,
                payload_kg: [payload_kg; 2],
                ..checker::Options::default()
            },
            robot: plant::Options {
                encoder_noise_rad: 0.0,
                encoder_step_rad: 0.0,
                hands_kg: [payload_kg; 2],
                ..plant::Options::default()
            },
            initial: None,
        };
        let simulated = made(file, "simulated robot", simulated::Config::new(&model, &exact))?;
        let gate = gate::Config::new(&model).and_then(|gate| gate.with_hand_speed(hand_speed));
        let gate = Some(made(file, "gate", gate)?).filter(|_| !changes.no_certificate);
        if let Some(mass_kg) = payload_kg.filter(|_| !changes.hidden) {
            model.payload = model.payload.map(|hand| hand.map(|hand| Payload { mass_kg, ..hand }));
        }
        let options = match changes {
            Changes { no_certificate: true, .. } => wbc::Options::without_certificate_for_tests(),
            Changes { no_torque: true, .. } => wbc::Options::without_torque_for_tests(),
            _ => wbc::Options::default(),
        };
        let wbc = wbc::Config::new(&model, options.hand_speed_m_per_s(hand_speed));
        // With an unknown payload arms give way, and a driver that pauses would find the robot off its path. So it does
        // not pause.
        Ok(Self { wbc: made(file, "whole-body control", wbc)?, gate, simulated, robot, pauses: !changes.hidden, model })
    }
}

/// A stage, or torture itself, rejects the robot or the settings of a file.
fn rejected(file: &Path, cause: impl Display) -> Failure {
    Failure::new(Exit::Config, format!("{}: {cause}", file.display()))
}

/// Returns the attacker's target as whole-body control takes it.
pub fn target<'a>(attacker: &'a Attacker<'_>) -> Option<wbc::Target<'a>> {
    let Attacker { q, dq, valid_mask, .. } = attacker;
    valid_mask.map(|valid_mask| wbc::Target { q, dq, ddq: &[0.0; JOINTS_MAX], valid_mask })
}

/// Returns the attacker's permit as engagement gives it.
pub fn permit(attacker: &Attacker<'_>) -> Permit {
    attacker.speed_scale.map_or(Permit::Stop, |speed_scale| Permit::Follow { speed_scale })
}

#[derive(Clone, Debug)]
pub struct Stages<'a> {
    subject: &'a Subject,
    commander: Commander,
}

impl<'a> Stages<'a> {
    pub fn at_rest(subject: &'a Subject, q: [f64; JOINTS_MAX]) -> Self {
        Self { subject, commander: Commander::at_rest(&subject.wbc, q) }
    }

    /// Continues from the state that the driver executes.
    pub fn reseed(&mut self, motion: &JointMotion) {
        self.commander.reseed(motion);
    }

    /// Runs one tick of both stages, and returns its duration, ns. Without a gate the proposal is sent.
    pub fn tick(&mut self, k: u64, now: Stamp, target: Option<wbc::Target<'_>>, permit: Permit) -> (Commanded, u64) {
        let Self { subject, commander } = self;
        let begun = Instant::now();
        let proposed = commander.propose(&subject.wbc, k, now, target, permit);
        let out = match &subject.gate {
            Some(gate) => commander.check(gate, k, now, proposed, permit),
            None => Commanded { motion: proposed.motion, denied: None, proposed },
        };
        (out, u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }
}
