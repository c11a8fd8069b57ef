//! Records a run in virtual time: every message of every tick, and the inputs of each control tick.

use crate::about::{Origin, about};
use crate::encoder::{Rates, RecordingEncoder, Sample};
use crate::error::RecordError;
use crate::file::Recording;
use crate::inputs::Inputs;
use config::{Loaded, Overrides};
use control::STATUS_EVERY;
use messages::TICK_HZ;
use safety::engage::OperatorView;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use world::Moment;

const PICTURES_HZ: f64 = 60.0;

pub struct OfflineRecording {
    recording: Recording<File>,
    encoder: RecordingEncoder,
    flushed: u64,
    failure: Option<RecordError>,
}

impl OfflineRecording {
    /// Begins the file. Replaces an existing one.
    pub fn create(path: &Path, loaded: &Loaded) -> Result<Self, RecordError> {
        let file = File::create(path).map_err(|error| RecordError::Open { cause: rt::unwritable(path, &error) })?;
        let (table, files) = about(loaded, &Overrides::default(), Origin::Offline);
        let rates = Rates { pictures_hz: PICTURES_HZ, full: true };
        let recording = Recording::begin(file, &table, &files)?;
        Ok(Self { recording, encoder: RecordingEncoder::new(&loaded.model, rates, 0), flushed: 0, failure: None })
    }

    pub fn moment(&mut self, moment: &Moment, operator: &OperatorView) {
        let Self { recording, encoder, failure, .. } = self;
        let mut write = |entry| {
            if failure.is_none() {
                *failure = recording.add(&entry).err();
            }
        };
        let targets = moment.target.iter().map(Sample::Target).chain(moment.policy_seen.iter().map(Sample::Policy));
        let published = moment.skeleton.iter().map(Sample::Skeleton).chain(targets);
        published.for_each(|sample| encoder.encode(sample, &mut write));
        if let Some(control) = &moment.control {
            let status = &control.status;
            let inputs = Inputs {
                k: status.k,
                now: status.header.stamp,
                incarnation: status.header.incarnation,
                operator: *operator,
                realtime_ok: true,
                target: moment.target_seen.map_or(0, |target| target.header.sequence),
                policy: moment.policy_seen.map_or(0, |policy| policy.header.sequence),
                state: moment.state_seen.map_or(0, |state| state.header.sequence),
            };
            encoder.encode(Sample::Inputs(&inputs), &mut write);
            if let Some(command) = &control.command {
                encoder.encode(Sample::Command(command), &mut write);
            }
            if status.k.is_multiple_of(STATUS_EVERY) || control.transition.is_some() {
                encoder.encode(Sample::Status(status), &mut write);
            }
        }
        if let Some(robot) = &moment.robot {
            encoder.encode(Sample::State(robot), &mut write);
        }
        // A chunk holds at most half a second.
        if moment.k >= self.flushed + TICK_HZ / 2 && self.failure.is_none() {
            self.flushed = moment.k;
            self.failure = self.recording.flush().err();
        }
    }

    pub fn finish(mut self) -> Result<(), RecordError> {
        match self.failure {
            Some(failure) => Err(failure),
            None => self.recording.finish(&BTreeMap::from([("samples_lost".to_owned(), "0".to_owned())])),
        }
    }
}
