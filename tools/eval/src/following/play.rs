//! Plays one clip through every stage in virtual time, and records the commands.

use super::expectation::Expectation;
use super::hands::{self, HandError, HandSample};
use super::person::Person;
use crate::methods::Posture;
use client::PlayOptions;
use config::Loaded;
use messages::{JointCommand, Mode, Stamp, command_flag, deadline};
use motion::{CalibrationMode, Motion};
use plant::Links;
use robot::Model;
use rt::{Exit, Failure};
use std::collections::BTreeMap;
use world::{Moment, Offline, OfflineEnd};

/// Ticks between two judged commands: 50 Hz.
pub(super) const SAMPLE_TICKS: u64 = 30;
/// Ticks between two judged torques: 150 Hz. This is many times the bandwidth of an arm, which takes 5 ms to
/// full acceleration.
const TORQUE_TICKS: u64 = 10;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// The deadline of the command's tick.
    pub at: Stamp,
    /// Positions of joints 1 to 5 of both arms, rad.
    pub q: Posture,
}

#[derive(Clone, Debug, Default)]
pub struct Played {
    pub name: String,
    pub person: Person,
    /// Commands at 50 Hz, in one list for each uninterrupted time in which the robot was Engaged.
    pub spans: Vec<Vec<Sample>>,
    /// Errors of the hands at each sample, where the person's are known.
    pub hands: Vec<HandError>,
    /// Expectations of the person at each new skeleton while Engaged.
    pub expected: Vec<Expectation>,
    pub ticks: u64,
    /// Ticks among them whose command was the next point of the previous plan.
    pub on_plan: u64,
    /// Largest share of an arm joint's effort limit that a command requires, stops included.
    pub torque_share_max: f64,
    /// Violations by kind, of the commands and of the joints' true motion.
    pub violations: BTreeMap<String, u64>,
    pub stopped: Option<String>,
}

#[derive(Debug)]
pub struct Stage<'a> {
    loaded: &'a Loaded,
    links: Links,
}

impl<'a> Stage<'a> {
    pub fn new(loaded: &'a Loaded) -> Result<Self, Failure> {
        let texts = &loaded.model.texts;
        let files = ((&*texts.toml_name, &*texts.toml), (&*texts.urdf_name, &*texts.urdf));
        let links = Links::from_text(files.0, files.1, [Some(0.0); 2]).map_err(Failure::with(Exit::Config))?;
        Ok(Self { loaded, links })
    }

    pub fn play(&self, motion: &Motion, calibration: CalibrationMode) -> Result<Played, String> {
        let options = PlayOptions { speed: 1.0, looped: false, calibration };
        let mut watch = Watch { stage: self, played: Played::default(), hands: Vec::new(), engaged_at: None };
        watch.played.name.clone_from(&motion.name);
        let mut offline = Offline::new(self.loaded, motion, options).map_err(|error| error.to_string())?;
        let end = offline.play(|tick| watch.see(tick.moment));
        let mut played = watch.played;
        played.hands =
            hands::errors(&self.loaded.model, &watch.hands, self.loaded.settings.retarget.following_delay_ms / 1e3);
        if let OfflineEnd::Stopped(why) = end {
            played.stopped = Some(why);
        }
        played.violations = offline.report().violations.clone();
        let judged = offline.judged();
        for kind in plant::ViolationKind::ALL {
            played.violations.insert(format!("true {}", kind.name()), judged.count(kind));
        }
        Ok(played)
    }

    fn torque_share(&self, command: &JointCommand) -> f64 {
        let torques = self.links.torques(&command.q, &command.v, &command.a);
        let share = |j: usize| torques[j].abs() / self.loaded.model.limits[j].effort_max;
        self.loaded.model.arms.iter().flat_map(robot::Arm::range).map(share).fold(0.0, f64::max)
    }
}

struct Watch<'a> {
    stage: &'a Stage<'a>,
    played: Played,
    hands: Vec<HandSample>,
    engaged_at: Option<u64>,
}

impl Watch<'_> {
    fn see(&mut self, moment: &Moment) {
        if let Some(skeleton) = &moment.skeleton {
            self.played.person.add(skeleton);
        }
        let Some(control) = &moment.control else { return };
        let Some(command) = control.command.as_ref() else {
            self.engaged_at = None;
            return;
        };
        if moment.k.is_multiple_of(TORQUE_TICKS) {
            let share = self.stage.torque_share(command);
            self.played.torque_share_max = self.played.torque_share_max.max(share);
        }
        if control.status.mode != Mode::Engaged as u32 {
            self.engaged_at = None;
            return;
        }
        if let Some(target) = &moment.target {
            // The first target of a new skeleton has the expectation.
            let expected = &mut self.played.expected;
            if expected.last().is_none_or(|last| target.header.origin > last.origin) {
                let delay_ns = (self.stage.loaded.settings.retarget.following_delay_ms * 1e6) as u64;
                expected.push(Expectation::new(target, delay_ns));
            }
        }
        let began = *self.engaged_at.get_or_insert_with(|| {
            self.played.spans.push(Vec::new());
            moment.k
        });
        self.played.ticks += 1;
        self.played.on_plan += u64::from(command.flags & command_flag::ON_PLAN != 0);
        if let (true, Some(span)) = ((moment.k - began).is_multiple_of(SAMPLE_TICKS), self.played.spans.last_mut()) {
            let model = &self.stage.loaded.model;
            span.push(Sample::new(model, command));
            let hands = moment.target.as_ref().map(|target| hands::samples(model, target, command));
            self.hands.extend(hands.into_iter().flatten());
        }
    }
}

impl Sample {
    pub(crate) fn new(model: &Model, command: &JointCommand) -> Self {
        let arms =
            |all: &[f64; messages::JOINTS_MAX]| model.arms.each_ref().map(|arm| arm.mirrored(&arm.limb_values(all)));
        Self { at: deadline(command.k), q: arms(&command.q) }
    }
}
