//! Counts how often `ingest` would reject a person who did nothing wrong. Every motion of a folder, resampled
//! to several rates, goes through the input stage alone.

use crate::cli::Cli;
use crate::clips::chosen;
use crate::run::{load, write_json};
use ::report::table::{self, column};
use ::report::{check_bounds, print};
use messages::{RawSkeleton, Stamp};
use motion::{CalibrationMode, Motion};
use rayon::prelude::*;
use rt::Failure;
use serde::Serialize;
use serde_json::{Map, json};
use skeleton::DropReason;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// Allowed rates, Hz: those at which clients may send, and 20.
const RATES_HZ: [f64; 2] = [20.0, 240.0];
/// Time of the first frame. It is not zero, because zero means never.
const BEGIN_NS: u64 = 1_000_000_000;

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Refusals {
    pub frames: u64,
    pub dropped: u64,
    pub arm_left_out: u64,
    pub strangers: u64,
    pub reasons: BTreeMap<&'static str, u64>,
}

impl Refusals {
    fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.dropped += other.dropped;
        self.arm_left_out += other.arm_left_out;
        self.strangers += other.strangers;
        for (name, count) in &other.reasons {
            *self.reasons.entry(name).or_default() += count;
        }
    }
}

/// Passes a motion to `ingest` at this frame rate, each frame at once.
pub fn count(config: &ingest::Config, motion: &Motion, calibration: CalibrationMode, rate_hz: f64) -> Refusals {
    let hinges = motion::calibrate(motion, calibration);
    let motion = motion::resampled(motion, rate_hz);
    let frame = |i: usize| {
        let now = Stamp(BEGIN_NS + (i as f64 * 1e9 / rate_hz) as u64);
        let mut raw: RawSkeleton = motion::raw_frame(&motion, i, &hinges);
        (raw.header.sequence, raw.header.origin, raw.header.stamp) = (i as u64 + 1, now, now);
        (raw.header.incarnation, raw.session_nonce) = (1, 1);
        (now, raw)
    };
    count_frames(config, (0..motion.frames.len()).map(frame))
}

/// Passes frames to `ingest`, each at the time of its arrival.
pub(crate) fn count_frames(config: &ingest::Config, frames: impl Iterator<Item = (Stamp, RawSkeleton)>) -> Refusals {
    let (mut state, mut out, mut person) = (ingest::State::default(), Refusals::default(), None);
    for (now, raw) in frames {
        let skeleton = ingest::tick(config, &mut state, now, &raw).skeleton;
        out.frames += 1;
        let Some(skeleton) = skeleton else {
            out.dropped += 1;
            continue;
        };
        let all = messages::skeleton_flag::ALL;
        out.arm_left_out += u64::from(skeleton.flags & all != all);
        out.strangers += u64::from(person.is_some_and(|known| known != skeleton.operator_id));
        person = Some(skeleton.operator_id);
    }
    let reasons = DropReason::ALL.iter().map(|&reason| (reason.name(), state.skeleton.dropped(reason)));
    out.reasons = reasons.filter(|(_, count)| *count > 0).collect();
    out
}

fn show_rates(f: &mut fmt::Formatter<'_>, rates: &[(f64, Refusals)]) -> fmt::Result {
    let count = |head, width, count: fn(&Refusals) -> u64| {
        column(["", head], width, move |row: &Refusals| count(row).to_string())
    };
    let columns = [
        count("frames", 9, |row| row.frames),
        count("dropped", 9, |row| row.dropped),
        count("one arm", 9, |row| row.arm_left_out),
        count("strangers", 10, |row| row.strangers),
    ];
    let names: Vec<String> = rates.iter().map(|(rate, _)| format!("{rate:>6}")).collect();
    table::write(f, ("    Hz", 6), &columns, names.iter().zip(rates).map(|(name, (_, all))| (name.as_str(), all)))
}

pub fn run(cli: &Cli, folder: &Path) -> Result<(), Failure> {
    cli.rates.iter().try_for_each(|&rate| check_bounds("--rates", rate, RATES_HZ))?;
    let loaded = load(cli)?;
    let config = world::input_config(&loaded.settings.ingest, loaded.layouts, &loaded.operators, loaded.lifter);
    let motions: Vec<Motion> = chosen(folder, cli.clips.as_deref())?
        .iter()
        .filter_map(|file| match motion::load_with(file, &cli.load) {
            Ok(motion) => Some(motion),
            Err(error) => {
                eprintln!("skipped {error}");
                None
            }
        })
        .collect();
    let (mut rates, mut worst) = (Vec::new(), String::new());
    for &rate in &cli.rates {
        let of = |motion: &Motion| count(&config, motion, cli.calibration, rate);
        let found: Vec<Refusals> = motions.par_iter().map(of).collect();
        let mut all = Refusals::default();
        for (motion, found) in motions.iter().zip(found) {
            all.add(&found);
            let reasons: Vec<_> = found.reasons.iter().map(|(name, count)| format!("{name} {count}")).collect();
            if !reasons.is_empty() {
                worst += &format!("{} at {rate} Hz: {}\n", motion.name, reasons.join(", "));
            }
        }
        rates.push((rate, all));
    }
    let (folder, motions) = (folder.display().to_string(), motions.len());
    print(&fmt::from_fn(|f| {
        show_rates(f, &rates)?;
        writeln!(f, "{worst}{motions} motions of {folder}, at recorded speed")
    }));
    let rates: Map<_, _> = rates.iter().map(|(rate, all)| (format!("{rate}"), json!(all))).collect();
    write_json(cli, &json!({ "refusals": folder, "motions": motions, "rates_hz": rates }))
}
