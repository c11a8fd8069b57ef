//! The same clips when frames arrive late: the error against the delay of a wire between the person and `ingest`.
//!
//! `origin` stays the time at which the person was seen. Targets follow by the following delay of the settings. What a wire
//! delays beyond that, and all that comes after the newest frame, is predicted. `ingest` refuses frames that are too old, so a
//! slow wire does not move the robot at all.

use super::judge::{mean, mean_deg};
use super::play::{Played, Stage};
use crate::cli::Cli;
use crate::clips::chosen;
use crate::plots::{legend, name_line, paint_file};
use crate::run::{load, write_json};
use ::report::print;
use ::report::table::{self, column, number};
use bus::FaultPlan;
use messages::TICK_HZ;
use plotters::prelude::*;
use rayon::prelude::*;
use retarget::ArmModel;
use rt::{Exit, Failure};
use serde::Serialize;
use serde_json::json;
use std::fmt;
use std::path::Path;

const DELAYS_MS: [u64; 6] = [0, 25, 50, 75, 100, 150];
/// Longest additional delay of a frame on a bad wire, ms.
const JITTER_MS: u64 = 30;
/// Share of the frames that a bad wire loses.
const LOSS: f64 = 0.05;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Wire {
    /// Shortest delay, ms.
    pub delay_ms: u64,
    /// Longest additional delay, ms. Each frame draws its own. None overtakes another.
    pub jitter_ms: u64,
    pub loss: f64,
    /// Time while Engaged, mean of the clips, s.
    pub engaged_s: f64,
    /// Error against the person of the same instant, mean of the clips in which the robot was Engaged, degrees.
    pub now_deg: Option<f64>,
    /// Error against the person of the judged delay before, degrees.
    pub at_delay_deg: Option<f64>,
    pub stopped: usize,
    pub violations: u64,
}

impl Wire {
    fn plan(delay_ms: u64, jitter_ms: u64, loss: f64) -> FaultPlan {
        let ns = |ms: u64| ms * 1_000_000;
        FaultPlan {
            drop: loss,
            delay_min_ns: ns(delay_ms),
            delay_max_ns: ns(delay_ms + jitter_ms),
            ..FaultPlan::default()
        }
    }

    fn measured(plan: &FaultPlan, played: &[Played], arm: &ArmModel, judged_ms: f64) -> Self {
        let error_deg = |delay_ms: f64| {
            mean(&played.iter().filter_map(|played| mean_deg(arm, played, delay_ms)).collect::<Vec<_>>())
        };
        let seconds: Vec<f64> = played.iter().map(|played| played.ticks as f64 / TICK_HZ as f64).collect();
        Self {
            delay_ms: plan.delay_min_ns / 1_000_000,
            jitter_ms: (plan.delay_max_ns - plan.delay_min_ns) / 1_000_000,
            loss: plan.drop,
            engaged_s: mean(&seconds).unwrap_or_default(),
            now_deg: error_deg(0.0),
            at_delay_deg: error_deg(judged_ms),
            stopped: played.iter().filter(|played| played.stopped.is_some()).count(),
            violations: played.iter().flat_map(|played| played.violations.values()).sum(),
        }
    }

    fn name(&self) -> String {
        let bad = format!(", jitter {} ms, loss {} %", self.jitter_ms, 100.0 * self.loss);
        format!("{} ms{}", self.delay_ms, if self.loss > 0.0 { &bad } else { "" })
    }
}

struct Table {
    wires: Vec<Wire>,
    judged_ms: f64,
    clips: usize,
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let judged = format!("{} ms", self.judged_ms);
        let columns = [
            column(["engaged", "s"], 9, |wire: &Wire| number(Some(wire.engaged_s), 1)),
            column(["error", "now"], 7, |wire: &Wire| number(wire.now_deg, 1)),
            column(["degrees", &judged], 9, |wire: &Wire| number(wire.at_delay_deg, 1)),
            column(["clips", "stopped"], 8, |wire: &Wire| wire.stopped.to_string()),
            column(["", "viol."], 6, |wire: &Wire| wire.violations.to_string()),
        ];
        let names: Vec<String> = self.wires.iter().map(Wire::name).collect();
        table::write(f, ("wire", 30), &columns, names.iter().map(String::as_str).zip(&self.wires))?;
        writeln!(f, "{} clips; mean angle of four limbs, command against person", self.clips)
    }
}

pub(crate) fn run(cli: &Cli, folder: &Path) -> Result<(), Failure> {
    let loaded = load(cli)?;
    let (stage, arm) = (Stage::new(&loaded)?, ArmModel::from_model(&loaded.model));
    let files = chosen(folder, cli.clips.as_deref())?;
    let motions: Result<Vec<_>, _> = files.iter().map(|file| motion::load(file)).collect();
    let motions = motions.map_err(|error| Failure::new(Exit::Config, format!("{}: {error}", folder.display())))?;
    let bad = DELAYS_MS.map(|delay_ms| Wire::plan(delay_ms, JITTER_MS, LOSS));
    let plans = DELAYS_MS.map(|delay_ms| Wire::plan(delay_ms, 0, 0.0)).into_iter().chain(bad);
    let wire = |plan: FaultPlan| -> Result<Wire, Failure> {
        let play = |motion| {
            let _ = rt::flush_denormals();
            stage.play_over(motion, cli.calibration, plan)
        };
        let played: Result<Vec<_>, String> = motions.par_iter().map(play).collect();
        let played = played.map_err(|reason| Failure::new(Exit::Config, format!("{}: {reason}", folder.display())))?;
        Ok(Wire::measured(&plan, &played, &arm, cli.delay_ms))
    };
    let wires: Result<Vec<_>, _> = plans.map(wire).collect();
    let table = Table { wires: wires?, judged_ms: cli.delay_ms, clips: files.len() };
    if let Some(folder) = &cli.plot {
        draw(&folder.join("wires.svg"), &table)?;
    }
    print(&table);
    write_json(cli, &json!(table.wires))
}

fn draw(path: &Path, table: &Table) -> Result<(), Failure> {
    let folder = path.parent().unwrap_or(path);
    std::fs::create_dir_all(folder).map_err(|cause| Failure::unwritable(folder, &cause))?;
    let highest = table.wires.iter().filter_map(|wire| wire.now_deg).fold(10.0, f64::max);
    let longest = DELAYS_MS.into_iter().max().unwrap_or(1) as f64;
    paint_file(path, (800, 420), |area| {
        let mut chart = ChartBuilder::on(area)
            .caption("Angle between person and robot, mean of four limbs", ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..longest, 0.0..highest * 1.25)?;
        chart.configure_mesh().max_light_lines(0).x_desc("delay of the wire, ms").y_desc("degrees").draw()?;
        let at_delay = format!("person {} ms before", table.judged_ms);
        type Error = fn(&Wire) -> Option<f64>;
        let lines: [(&str, bool, Error, RGBColor); 4] = [
            ("same instant", false, |wire| wire.now_deg, RGBColor(210, 120, 40)),
            ("same instant, bad wire", true, |wire| wire.now_deg, RGBColor(240, 190, 120)),
            (&at_delay, false, |wire| wire.at_delay_deg, RGBColor(30, 110, 190)),
            (&format!("{at_delay}, bad wire"), true, |wire| wire.at_delay_deg, RGBColor(130, 180, 230)),
        ];
        for (name, bad, error, colour) in lines {
            let wires = table.wires.iter().filter(|wire| (wire.loss > 0.0) == bad);
            let points = wires.filter_map(|wire| Some((wire.delay_ms as f64, error(wire)?)));
            let drawn = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            name_line(drawn, name, colour.stroke_width(2));
        }
        legend(&mut chart)
    })
}
