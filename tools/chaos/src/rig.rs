//! The processes of an instance, a client and an operator. Each runs in a process of its own that a fault can hit.

use crate::injection::Target;
use crate::monitor::Monitor;
use config::Settings;
use harness::{Harness, Operator, roles};
use messages::Mode;
use rt::{Exit, Failure};
use serde_json::{Map, Value};
use std::path::Path;
use std::process::Child;

/// A running instance, with its client and operator.
pub struct Rig {
    pub harness: Harness,
    client: Child,
    /// Number of times that a client gave up by itself and was restarted.
    pub clients_begun_anew: u64,
    /// Holds the enable if the operator is the target.
    hand: Option<Child>,
    /// The operator who watches.
    pub operator: Operator,
    pub monitor: Monitor,
    pub settings: Settings,
}

impl Rig {
    /// Starts all processes, and a monitor that compares what the driver executes with its limits.
    pub fn start(config: &Path) -> Result<Self, Failure> {
        let harness = Harness::start(config, None)?;
        let client = roles::start(roles::CLIENT, &harness.instance)?;
        let operator = harness.operator()?;
        let loaded = harness.place.load()?;
        let limits = world::driver_config(&loaded, true).map_err(Failure::with(Exit::Config))?;
        let monitor = Monitor::start(harness.instance.core_domain(), limits);
        let monitor = monitor.map_err(Failure::with(Exit::Unavailable))?;
        Ok(Self { harness, client, clients_begun_anew: 0, hand: None, operator, monitor, settings: loaded.settings })
    }

    /// Brings the instance to a state in which it can be engaged. Restarts the client if it has given up, as a
    /// user would.
    pub fn clear(&mut self) -> Result<(), Failure> {
        let Self { harness, client, clients_begun_anew, operator, .. } = self;
        operator.clear(&mut || {
            if client.try_wait().map_err(Failure::with(Exit::OsErr))?.is_some() {
                *client = roles::start(roles::CLIENT, &harness.instance)?;
                *clients_begun_anew += 1;
            }
            Ok(())
        })
    }

    /// Holds the enable, and waits for `mode`. If the operator is the target, a separate program holds the enable.
    pub fn engage(&mut self, target: Target, mode: Mode) -> Result<(), Failure> {
        if target == Target::Operator {
            self.hand = Some(roles::start(roles::OPERATOR, &self.harness.instance)?);
        } else {
            self.operator.enable();
        }
        self.operator.reach(mode, &mut || Ok(()))
    }

    pub fn id(&self, target: Target) -> Result<u32, Failure> {
        let id = match target {
            Target::Client => Some(self.client.id()),
            Target::Operator => self.hand.as_ref().map(Child::id),
            process => self.harness.children.id(process.name()),
        };
        id.ok_or_else(|| Failure::new(Exit::Failed, format!("{} does not run", target.name())))
    }

    pub fn kill(&mut self, target: Target) {
        match target {
            Target::Client => end(&mut self.client),
            Target::Operator => self.let_go(),
            process => self.harness.children.kill(process.name()),
        }
    }

    /// Restarts the killed process. An operator that held the enable does not come back by itself.
    pub fn revive(&mut self, target: Target) -> Result<(), Failure> {
        match target {
            Target::Client => self.client = roles::start(roles::CLIENT, &self.harness.instance)?,
            Target::Operator => {}
            process => self.harness.children.start_one(process.name())?,
        }
        Ok(())
    }

    pub fn release(&mut self) {
        self.let_go();
        self.operator.release();
    }

    fn let_go(&mut self) {
        if let Some(mut hand) = self.hand.take() {
            end(&mut hand);
        }
    }

    /// Ends all processes in order. Returns those that had to be killed or that failed, and the report of each.
    pub fn end(mut self) -> (Vec<String>, Map<String, Value>) {
        self.release();
        end(&mut self.client);
        (self.harness.children.stop(), self.harness.reports())
    }
}

fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}
