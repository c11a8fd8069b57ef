//! Measures how a person whom one camera sees is followed. Each file of `tools/camera/render` has what a landmarker found in
//! the images of a person whose joints are known. The frames go through every stage in virtual time, there and back.
//!
//! - *Found* is the share of the images with a person, *refused* that of the frames that `ingest` drops, by reason.
//! - *Engaged* is the share of the time after the first 3 s. The operator presses the enable once.
//! - The errors are the mean angles of the four limbs of the arms relative to the trunk: of the landmarker's points in space
//!   and of the lifter in each image, and of the command against the person of the best delay. *By truth* is the command's
//!   error if the true joints lead the robot: what it cannot reach or follow.

use crate::cli::Cli;
use crate::clips::Human;
use crate::following::{Person, Sample};
use crate::methods::limbs_of;
use crate::plots;
use crate::refusals::{Refusals, count_frames};
use crate::run::{load, write_json};
use ::report::print;
use ::report::table::{self, column, number};
use config::Loaded;
use messages::{Layout, Mode, RawSkeleton, SkeletonLayout, Stamp, TICK_HZ};
use nalgebra::Vector3;
use rayon::prelude::*;
use retarget::ArmModel;
use rt::{Exit, Failure};
use safety::engage::OperatorView;
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use train::lifting::{Judged, Pairs, Recorded, judge};
use world::{Links, Running, World, WorldConfig};

/// From an image to its landmarks at `ingest`, ns: the full network takes 17 to 40 ms, the camera and its driver as long.
/// Assumption.
const LANDMARKS_AFTER_NS: u64 = 60_000_000;
/// Ticks before the operator presses the enable.
const SETTLE: u64 = TICK_HZ;
/// Time after which the robot should be engaged, ticks: 3 s.
const ENGAGES_WITHIN: u64 = 3 * TICK_HZ;
/// Ticks between two judged commands: 50 Hz.
const SAMPLE_TICKS: u64 = 30;
/// Delays among which the best one is searched, ms.
const DELAYS_MS: [u64; 2] = [0, 800];
const DELAY_STEP_MS: usize = 20;
/// Time for which a video plays, there and back, s. A person who is followed stays before the camera for longer than a clip.
const PLAYS_S: f64 = 24.0;
/// Seed of the simulated robot's noise.
const SEED: u64 = 1;

/// Figures of one clip.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Followed {
    pub clip: String,
    pub images: usize,
    pub found: f64,
    pub refused: f64,
    pub reasons: BTreeMap<&'static str, u64>,
    pub engaged: f64,
    /// Seconds of other modes in that time.
    pub other_modes_s: BTreeMap<&'static str, f64>,
    pub strangers: u64,
    pub landmarker_deg: f64,
    pub lifter_deg: f64,
    pub robot_deg: Option<f64>,
    /// The robot's error if the true joints lead it.
    pub by_truth_deg: Option<f64>,
    pub delay_ms: Option<u64>,
    /// Mean turn of the shoulders to the camera, degrees.
    pub turned_deg: f64,
    /// Violations of the simulated robot, in both runs.
    pub violations: u64,
    #[serde(skip)]
    line: Vec<(f64, f64)>,
}

/// Number of images that play.
fn played(recorded: &Recorded) -> usize {
    recorded.images().max((PLAYS_S * recorded.rate_hz) as usize)
}

/// Returns the image that plays as number `i`. A video that began again would jump.
fn there_and_back(recorded: &Recorded, i: usize) -> usize {
    let last = recorded.images() - 1; // A file has two images at least.
    let at = i % (2 * last);
    at.min(2 * last - at)
}

/// Returns the frame of image `i` of those that play.
fn frame(recorded: &Recorded, i: usize) -> Option<RawSkeleton> {
    let (world, image, seen) = recorded.found(there_and_back(recorded, i))?;
    let mut raw = RawSkeleton { layout: SkeletonLayout::MediaPipe66 as u32, joint_count: 66, ..RawSkeleton::ZERO };
    let points = world.iter().copied().chain(image.iter().map(|[x, y]| [*x, *y, 0.0]));
    raw.positions.iter_mut().zip(points).for_each(|(to, from)| *to = from);
    raw.confidence.iter_mut().zip(seen.iter().chain(&seen)).for_each(|(to, from)| *to = *from);
    Some(stamped(raw, i, recorded.rate_hz))
}

/// Returns the frame of the true joints.
fn truth(recorded: &Recorded, i: usize) -> RawSkeleton {
    let mut raw = RawSkeleton { layout: SkeletonLayout::MediaPipe33 as u32, joint_count: 33, ..RawSkeleton::ZERO };
    raw.positions.iter_mut().zip(recorded.truth(there_and_back(recorded, i))).for_each(|(to, from)| *to = from);
    raw.confidence[..33].fill(1.0);
    stamped(raw, i, recorded.rate_hz)
}

fn stamped(mut raw: RawSkeleton, i: usize, rate_hz: f64) -> RawSkeleton {
    // Not zero, because zero means never. The world begins after a second.
    raw.header.origin = Stamp(2_000_000_000 + (i as f64 * 1e9 / rate_hz) as u64);
    (raw.header.sequence, raw.header.incarnation, raw.session_nonce) = (i as u64 + 1, 1, 1);
    raw
}

/// The person as the joints truly are.
fn person(config: &ingest::Config, recorded: &Recorded) -> Person {
    let config = ingest::Config { lifter: None, filter: ingest::Filter::None, ..config.clone() };
    let (mut state, mut person) = (ingest::State::default(), Person::default());
    for i in 0..played(recorded) {
        let raw = truth(recorded, i);
        ingest::tick(&config, &mut state, raw.header.origin, &raw).skeleton.iter().for_each(|it| person.add(it));
    }
    person
}

/// Mean angle between the directions of the limbs, degrees. The twist of a limb is not seen by a camera.
fn directions_deg(robot: &Human, person: &Human) -> f64 {
    let along = |arms: &Human| {
        arms.each_ref().map(|arm| [arm.upper * Vector3::y(), arm.fore * Vector3::y()]).as_flattened().to_vec()
    };
    let (robot, person) = (along(robot), along(person));
    let pairs = robot.iter().zip(&person);
    pairs.map(|(a, b)| a.angle(b).to_degrees()).sum::<f64>() / robot.len() as f64
}

/// Counts what `ingest` refuses.
fn refuse(config: &ingest::Config, recorded: &Recorded, out: &mut Followed) {
    let frames = (0..played(recorded)).filter_map(|i| frame(recorded, i));
    let counted = count_frames(config, frames.map(|raw| (raw.header.origin.plus_ns(LANDMARKS_AFTER_NS), raw)));
    let Refusals { frames, dropped, strangers, reasons, .. } = counted;
    (out.found, out.refused) = (frames as f64 / played(recorded) as f64, dropped as f64 / frames.max(1) as f64);
    (out.strangers, out.reasons) = (strangers, reasons);
}

/// The person whom the robot is shown at image `i`.
type Shown = fn(&Recorded, usize) -> Option<RawSkeleton>;

fn follow(loaded: &Loaded, config: &WorldConfig, recorded: &Recorded, person: &Person, shown: Shown) -> Followed {
    let mut out = Followed::default();
    let arms = ArmModel::both(&loaded.model);
    let mut world = World::new(config, SEED, Links::default());
    let (mut next, mut samples, mut engaged, mut judged) = (0, Vec::new(), 0_u64, 0_u64);
    let (mut k, mut begun_k) = (0_u64, None);
    while next < played(recorded) {
        let now = world.now();
        while next < played(recorded)
            && stamped(RawSkeleton::ZERO, next, recorded.rate_hz).header.origin.0 + LANDMARKS_AFTER_NS <= now.0
        {
            shown(recorded, next).iter().for_each(|raw| world.publish(raw));
            next += 1;
        }
        if next > 0 && begun_k.is_none() {
            begun_k = Some(k);
        }
        let begun = begun_k.map(|begun| k - begun);
        let enabled = begun.is_some_and(|since| since >= SETTLE);
        let operator = OperatorView {
            connected: true,
            enable_level: enabled,
            enable_edge: begun == Some(SETTLE),
            heartbeat_received: now,
            ..OperatorView::default()
        };
        let moment = world.step(config, &operator, Running::ALL);
        k += 1;
        let Some((control, since)) = moment.control.as_ref().zip(begun) else { continue };
        let follows = control.status.mode == Mode::Engaged as u32;
        if since >= SETTLE + ENGAGES_WITHIN {
            (judged, engaged) = (judged + 1, engaged + u64::from(follows));
            if !follows {
                let mode = Mode::from_u32(control.status.mode).map_or("unknown", Mode::name);
                *out.other_modes_s.entry(mode).or_default() += messages::TICK_S;
            }
        }
        if let (true, true, Some(command)) = (follows, since.is_multiple_of(SAMPLE_TICKS), control.command.as_ref()) {
            samples.push(Sample::new(&loaded.model, command));
        }
    }
    out.engaged = engaged as f64 / judged.max(1) as f64;
    out.violations = world.report().violations().iter().map(|(_, count)| *count).sum();
    let errors = |delay_ms: u64| -> Vec<(f64, f64)> {
        let error = |sample: &Sample| {
            let then = Stamp(sample.at.0.saturating_sub(delay_ms * 1_000_000));
            let second = sample.at.since(Stamp(2_000_000_000)) as f64 * 1e-9;
            Some((second, directions_deg(&limbs_of(arms.each_ref(), &sample.q), &person.at(then)?)))
        };
        samples.iter().filter_map(error).collect()
    };
    let mean = |line: &[(f64, f64)]| line.iter().map(|(_, deg)| deg).sum::<f64>() / line.len() as f64;
    let [first, last] = DELAYS_MS;
    let tried = (first..=last).step_by(DELAY_STEP_MS).map(|ms| (ms, errors(ms))).filter(|(_, line)| !line.is_empty());
    if let Some((ms, line)) = tried.min_by(|a, b| mean(&a.1).total_cmp(&mean(&b.1))) {
        (out.robot_deg, out.delay_ms, out.line) = (Some(mean(&line)), Some(ms), line);
    }
    out
}

fn measured(loaded: &Loaded, config: &WorldConfig, input: &ingest::Config, recorded: &Recorded) -> Followed {
    let pairs = Pairs { clips: vec![(recorded.name.clone(), recorded.pairs())] };
    let of = |judged: &Judged| judged.mean_deg;
    let person = person(input, recorded);
    let by_camera = follow(loaded, config, recorded, &person, frame);
    let by_truth = follow(loaded, config, recorded, &person, |recorded, i| Some(truth(recorded, i)));
    let mut out = Followed {
        clip: recorded.name.clone(),
        images: recorded.images(),
        landmarker_deg: of(&judge(&pairs, None)),
        lifter_deg: input.lifter.as_ref().map_or(f64::NAN, |lifter| of(&judge(&pairs, Some(lifter)))),
        turned_deg: recorded.turned_deg(),
        by_truth_deg: by_truth.robot_deg,
        violations: by_camera.violations + by_truth.violations,
        ..by_camera
    };
    refuse(input, recorded, &mut out);
    out
}

fn show(f: &mut fmt::Formatter<'_>, rows: &[Followed]) -> fmt::Result {
    let deg =
        |head: [&str; 2], of: fn(&Followed) -> Option<f64>| column(head, 10, move |row: &Followed| number(of(row), 1));
    let share =
        |head: &str, of: fn(&Followed) -> f64| column(["", head], 8, move |row: &Followed| format!("{:.3}", of(row)));
    let columns = [
        deg(["", "turned"], |row| Some(row.turned_deg)),
        share("found", |row| row.found),
        share("refused", |row| row.refused),
        share("engaged", |row| row.engaged),
        column(["new", "persons"], 8, |row: &Followed| row.strangers.to_string()),
        deg(["", "landmarker"], |row| Some(row.landmarker_deg)),
        deg(["", "lifter"], |row| Some(row.lifter_deg)),
        deg(["", "robot"], |row| row.robot_deg),
        deg(["robot", "by truth"], |row| row.by_truth_deg),
        column(["best", "delay ms"], 8, |row: &Followed| number(row.delay_ms.map(|ms| ms as f64), 0)),
        column(["", "violations"], 10, |row: &Followed| row.violations.to_string()),
    ];
    table::write(f, ("clip", 24), &columns, rows.iter().map(|row| (row.clip.as_str(), row)))?;
    for row in rows {
        let reasons = row.reasons.iter().map(|(reason, count)| format!("refused {reason} {count}"));
        let modes = row.other_modes_s.iter().map(|(mode, s)| format!("{mode} {s:.1} s"));
        let notes: Vec<_> = reasons.chain(modes).collect();
        if !notes.is_empty() {
            writeln!(f, "{}: {}", row.clip, notes.join(", "))?;
        }
    }
    Ok(())
}

pub fn run(cli: &Cli, folder: &Path) -> Result<(), Failure> {
    let _ = rt::flush_denormals();
    let loaded = load(cli)?;
    let config = WorldConfig::new(&loaded).map_err(Failure::with(Exit::Config))?;
    let input =
        world::input_config(&loaded.settings.ingest, loaded.layouts.clone(), &loaded.operators, loaded.lifter.clone());
    let clips = Recorded::all(folder)?;
    let rows: Vec<Followed> = clips.par_iter().map(|clip| measured(&loaded, &config, &input, clip)).collect();
    print(&fmt::from_fn(|f| show(f, &rows)));
    if let Some(folder) = &cli.plot {
        std::fs::create_dir_all(folder).map_err(|cause| Failure::unwritable(folder, &cause))?;
        rows.iter().try_for_each(|row| draw(folder, row))?;
    }
    write_json(cli, &json!({ "video": folder.display().to_string(), "clips": rows }))
}

fn draw(folder: &Path, row: &Followed) -> Result<(), Failure> {
    let delay_ms = row.delay_ms.unwrap_or_default();
    let caption =
        format!("{}: angle between the robot and the person {delay_ms} ms before, mean of four limbs", row.clip);
    plots::draw(&folder.join(format!("{}.svg", row.clip)), &caption, &row.line)
}
