//! Reads a running instance's messages. It only polls. A waiting reader would have to be woken, which costs the
//! writer a system call. Polling costs only this process.

use crate::encoder::{RecordingEncoder, Sample};
use crate::{Entry, Rates, Topic};
use bus::{BusError, DomainConfig};
use messages::Stamp;
use robot::Model;
use view::Readers;

/// Time between two polls, ns. With `--full` it is well below a tick (667 us). Otherwise it is below the period
/// of the fastest client.
const LOOK_FULL_NS: u64 = 250_000;
const LOOK_NS: u64 = 2_000_000;

pub struct Attached {
    readers: Readers,
    encoder: RecordingEncoder,
    look_ns: u64,
    /// Hash of the settings in the messages, if it differs from ours.
    other_settings: Option<u64>,
    own_hash: u64,
    any: bool,
}

impl Attached {
    /// Attaches to the domain of an instance. `hash` is that of the settings whose robot is drawn. `offset_ns`
    /// converts the monotonic clock to that of the file.
    pub fn open(
        domain: DomainConfig,
        (model, hash): (&Model, u64),
        rates: Rates,
        offset_ns: u64,
    ) -> Result<Self, BusError> {
        Ok(Self {
            readers: Readers::open(domain, "record")?,
            encoder: RecordingEncoder::new(model, rates, offset_ns),
            look_ns: if rates.full { LOOK_FULL_NS } else { LOOK_NS },
            other_settings: None,
            own_hash: hash,
            any: false,
        })
    }

    pub fn next_look(&self, now: Stamp) -> Stamp {
        now.plus_ns(self.look_ns)
    }

    /// Takes new messages, in the order in which they flow.
    pub fn look(&mut self, write: &mut dyn FnMut(Entry)) {
        let mut hash = None;
        if let Some(skeleton) = self.readers.skeletons.latest() {
            self.encoder.encode(Sample::Skeleton(&skeleton), write);
        }
        if let Some(target) = self.readers.targets.latest() {
            self.encoder.encode(Sample::Target(&target), write);
        }
        if let Some(target) = self.readers.policies.latest() {
            self.encoder.encode(Sample::Policy(&target), write);
        }
        if let Some(command) = self.readers.commands.latest() {
            hash = Some(command.header.config_hash);
            self.encoder.encode(Sample::Command(&command), write);
        }
        if let Some(state) = self.readers.states.latest() {
            hash = hash.or(Some(state.header.config_hash));
            self.encoder.encode(Sample::State(&state), write);
        }
        if let Some(status) = self.readers.statuses.latest() {
            self.encoder.encode(Sample::Status(&status), write);
        }
        self.any |= hash.is_some();
        self.other_settings = self.other_settings.or(hash.filter(|&hash| hash != self.own_hash));
    }

    pub fn other_settings(&self) -> Option<u64> {
        self.other_settings
    }

    /// Returns true if a message of a driver or of `control` was read.
    pub fn heard_any(&self) -> bool {
        self.any
    }

    pub fn missed(&self) -> [(Topic, u64); 4] {
        self.encoder.missed()
    }
}
