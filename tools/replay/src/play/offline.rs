//! Runs the stages' own ticks in virtual time and writes every command.

use crate::cli::Cli;
use client::PlayOptions;
use config::Overrides;
use indicatif::{ProgressBar, ProgressStyle};
use messages::TICK_HZ;
use motion::Motion;
use record::{OfflineRecording, Trace};
use robot::{Model, Names};
use rt::{Exit, Failure, out};
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};
use world::{Offline, OfflineEnd, OfflineReport, Row};

/// Time between two lines of progress where there is no terminal. Assumption: nobody waits longer without a sign.
const PROGRESS_PERIOD: Duration = Duration::from_secs(10);

/// Rejects options that would overwrite an input or output file, or would never end.
fn refuse(cli: &Cli, out: &Path) -> Result<(), Failure> {
    let same = |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    let beside = out.with_extension("json");
    let mut before = vec![("the motion itself", cli.file.as_deref().unwrap_or(Path::new("")))];
    for (option, out) in [
        ("--offline", Some(out)),
        ("the JSON file beside --offline", Some(&*beside)),
        ("--record", cli.record.as_deref()),
        ("--plot", cli.plot.as_deref()),
    ] {
        let Some(out) = out else { continue };
        if let Some((other, _)) = before.iter().find(|(_, other)| *other == out || same(other, out)) {
            let text = format!("{option} {}: this is {other}; give another file", out.display());
            return Err(Failure::new(Exit::Usage, text));
        }
        Failure::check_writable(out)?;
        before.push((option, out));
    }
    if cli.looped {
        return Err(Failure::new(Exit::Usage, "--offline ends, but --loop does not; give only one of them"));
    }
    Ok(())
}

pub fn run(cli: &Cli, motion: &Motion, out: &Path) -> Result<(), Failure> {
    refuse(cli, out)?;
    let loaded =
        config::load(&cli.config, Overrides::robot(cli.robot.as_ref())).map_err(Failure::with(Exit::Config))?;
    let options = PlayOptions { speed: cli.speed, looped: false, calibration: cli.calibration };
    let mut recording = match &cli.record {
        Some(path) => Some(OfflineRecording::create(path, &loaded).map_err(Failure::with(Exit::CantCreate))?),
        None => None,
    };
    let mut trace = Trace::default();
    let mut offline = Offline::new(&loaded, motion, options).map_err(Failure::with(Exit::Config))?;
    let file = File::create(out).map_err(|error| Failure::unwritable(out, &error))?;
    let mut csv = BufWriter::new(file);
    let write = |error: std::io::Error| Failure::unwritable(out, &error);

    writeln!(csv, "{}", header(&loaded.model.joint_names)).map_err(write)?;
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{wide_bar} {pos}/{len} frames, {elapsed}") {
        bar.set_style(style);
    }
    let mut printed = Instant::now();
    let end = offline.try_play(|tick| {
        if let Some(recording) = &mut recording {
            recording.moment(tick.moment, tick.operator);
        }
        if cli.plot.is_some() {
            trace.moment(tick.moment);
        }
        let (played, frames) = tick.progress;
        bar.set_length(frames);
        bar.set_position(played);
        // Without a terminal there is no bar.
        if bar.is_hidden() && printed.elapsed() >= PROGRESS_PERIOD {
            printed = Instant::now();
            out!("{played} of {frames} frames");
        }
        tick.row.map_or(Ok(()), |row| write_row(&mut csv, &row, loaded.model.count))
    });
    let end = end.and_then(|end| csv.flush().map(|()| end)).map_err(write)?;
    bar.finish();
    written(cli, recording, &trace, &loaded.model)?;
    let report = offline.report();
    write_summary(out, motion, report)?;
    match end {
        OfflineEnd::AtRest => Ok(()),
        OfflineEnd::Stopped(what) => {
            let why = explain::why_stopped(offline.status(), &Names::from_model(&loaded.model));
            let why = why.map_or(String::new(), |why| format!(": {why}"));
            Err(Failure::new(Exit::Failed, format!("{what}{why}")))
        }
    }
}

fn write_row(csv: &mut impl Write, row: &Row, count: usize) -> std::io::Result<()> {
    write!(csv, "{}", row.k as f64 / TICK_HZ as f64)?;
    for value in row.command[..count].iter().chain(&row.target[..count]) {
        write!(csv, ",{value}")?;
    }
    writeln!(csv)
}

fn written(cli: &Cli, recording: Option<OfflineRecording>, trace: &Trace, model: &Model) -> Result<(), Failure> {
    if let (Some(recording), Some(path)) = (recording, &cli.record) {
        let failed = |error| Failure::new(Exit::CantCreate, format!("{}: {error}", path.display()));
        recording.finish().map_err(failed)?;
        out!("every message in {}", path.display());
    }
    if let Some(path) = &cli.plot {
        let title = cli.file.as_deref().unwrap_or(Path::new("")).display().to_string();
        record::plot(path, trace, model, &title).map_err(Failure::with(Exit::CantCreate))?;
        out!("picture in {}", path.display());
    }
    Ok(())
}

fn write_summary(out: &Path, motion: &Motion, report: &OfflineReport) -> Result<(), Failure> {
    let beside = out.with_extension("json");
    let summary = json!({
        "motion": motion.name,
        "rows": report.rows,
        "rate_hz": TICK_HZ,
        "modes": report.modes.iter().map(|(k, mode)| json!({ "k": k, "mode": mode.name() })).collect::<Vec<_>>(),
        "frames": report.frames.iter().map(|(frame, k)| json!({ "frame": frame, "k": k })).collect::<Vec<_>>(),
        "violations": report.violations,
        "min_clearance_mm": report.min_clearance_mm,
        "fallbacks": report.fallbacks,
        "torque_share_max": report.torque_share_max,
        "limb_error_deg": { "mean": report.limb_error_deg_mean },
        "limb_error_measured_deg": { "mean": report.limb_error_measured_deg_mean },
    });
    std::fs::write(&beside, format!("{summary:#}\n")).map_err(|error| Failure::unwritable(&beside, &error))?;
    out!("{} rows in {}, modes and frames in {}", report.rows, out.display(), beside.display());
    out!(
        "limb error of the target {:.2} deg, of the robot {:.2} deg, smallest clearance {:.1} mm, largest torque \
         {:.2} of the effort limit, violations {}",
        report.limb_error_deg_mean,
        report.limb_error_measured_deg_mean,
        report.min_clearance_mm,
        report.torque_share_max,
        json!(report.violations)
    );
    Ok(())
}

/// Header of the CSV: `t_s`, one column per joint of the command, then one per joint of the target.
fn header(joint_names: &[String]) -> String {
    let mut header = String::from("t_s");
    for prefix in ["", "target."] {
        for name in joint_names {
            header.push_str(&format!(",{prefix}{name}"));
        }
    }
    header
}
