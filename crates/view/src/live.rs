//! Reads a running instance, by polling alone: a reader that waits would cost the writers a system call.

use crate::ViewError;
use crate::frame::Heard;
use bus::{Domain, DomainConfig, Reader};
use messages::{Header, JointCommand, JointTarget, RobotState, Service, Skeleton, Stamp, Status};

/// A writer that is silent for longer is shown as gone, ns: five periods of the slowest, which clients are at 20 Hz.
const GONE_AFTER_NS: u64 = 250_000_000;

/// Readers of every service of the core domain.
pub struct Live {
    skeletons: Reader<Skeleton>,
    targets: Reader<JointTarget>,
    commands: Reader<JointCommand>,
    states: Reader<RobotState>,
    statuses: Reader<Status>,
    heard: Heard,
    _domain: Domain,
}

impl Live {
    /// Attaches to the core domain of an instance.
    ///
    /// # Errors
    /// The domain or a service cannot be opened.
    pub fn open(domain: DomainConfig) -> Result<Self, ViewError> {
        let domain = Domain::open(domain, "view")?;
        Ok(Self {
            skeletons: domain.reader(Service::Skeleton)?,
            targets: domain.reader(Service::JointTarget)?,
            commands: domain.reader(Service::JointCommand)?,
            states: domain.reader(Service::RobotState)?,
            statuses: domain.reader(Service::Status)?,
            heard: Heard::default(),
            _domain: domain,
        })
    }

    /// The newest of everything at `now`.
    pub fn look(&mut self, now: Stamp) -> &Heard {
        let heard = &mut self.heard;
        newest(&mut heard.skeleton, self.skeletons.latest(), now, |message| &message.header);
        newest(&mut heard.target, self.targets.latest(), now, |message| &message.header);
        newest(&mut heard.command, self.commands.latest(), now, |message| &message.header);
        newest(&mut heard.state, self.states.latest(), now, |message| &message.header);
        newest(&mut heard.status, self.statuses.latest(), now, |message| &message.header);
        heard
    }
}

fn newest<M>(kept: &mut Option<M>, new: Option<M>, now: Stamp, header: impl Fn(&M) -> &Header) {
    if new.is_some() {
        *kept = new;
    }
    if kept.as_ref().is_some_and(|message| now.since(header(message).stamp) > GONE_AFTER_NS) {
        *kept = None;
    }
}
