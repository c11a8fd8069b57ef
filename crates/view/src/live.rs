//! Reads a running instance by polling only. A waiting reader would cost the writers a system call.

use crate::ViewError;
use crate::frame::LatestMessages;
use bus::{BusError, Domain, DomainConfig, Reader};
use messages::{Header, JointCommand, JointTarget, RobotState, Service, Skeleton, Stamp, Status};

/// Silence after which a writer is shown as gone, ns. This is five periods of the slowest writers, clients at 20 Hz.
pub const GONE_AFTER_NS: u64 = 250_000_000;

/// Readers of every service of the core domain.
#[allow(missing_docs, reason = "the names say it")]
pub struct Readers {
    pub skeletons: Reader<Skeleton>,
    pub targets: Reader<JointTarget>,
    /// Those of a policy.
    pub policies: Reader<JointTarget>,
    pub commands: Reader<JointCommand>,
    pub states: Reader<RobotState>,
    pub statuses: Reader<Status>,
    _domain: Domain,
}

impl Readers {
    /// Attaches to the core domain of an instance, as `name`.
    pub fn open(domain: DomainConfig, name: &str) -> Result<Self, BusError> {
        let domain = Domain::open(domain, name)?;
        Ok(Self {
            skeletons: domain.reader(Service::Skeleton)?,
            targets: domain.reader(Service::JointTarget)?,
            policies: domain.reader(Service::PolicyTarget)?,
            commands: domain.reader(Service::JointCommand)?,
            states: domain.reader(Service::RobotState)?,
            statuses: domain.reader(Service::Status)?,
            _domain: domain,
        })
    }
}

/// The newest message of every service.
pub struct Live {
    readers: Readers,
    heard: LatestMessages,
}

impl Live {
    pub fn open(domain: DomainConfig) -> Result<Self, ViewError> {
        Ok(Self { readers: Readers::open(domain, "view")?, heard: LatestMessages::default() })
    }

    pub fn look(&mut self, now: Stamp) -> &LatestMessages {
        let Self { readers, heard } = self;
        newest(&mut heard.skeleton, readers.skeletons.latest(), now, |message| &message.header);
        newest(&mut heard.target, readers.targets.latest(), now, |message| &message.header);
        newest(&mut heard.command, readers.commands.latest(), now, |message| &message.header);
        newest(&mut heard.state, readers.states.latest(), now, |message| &message.header);
        newest(&mut heard.status, readers.statuses.latest(), now, |message| &message.header);
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
