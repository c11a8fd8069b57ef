//! Draws a run: every joint against its limits, clearance, latency, and the mode as a ribbon behind them.

use crate::error::RecordError;
use crate::trace::{Row, Trace};
use canvas::{Area, Drawn, INK, text};
use messages::Mode;
use plotters::prelude::*;
use robot::Model;
use std::path::Path;

const ACROSS: usize = 4;
/// Size of a panel, points of the canvas.
const PANEL: (u32, u32) = (840, 560);
/// Font height, points.
const LETTERS: u32 = 32;

const TARGET: RGBColor = RGBColor(230, 150, 30);
const COMMAND: RGBColor = RGBColor(40, 110, 200);
const MEASURED: RGBColor = RGBColor(60, 60, 60);
const LIMIT: RGBColor = RGBColor(200, 40, 40);
const PAUSE: RGBColor = RGBColor(130, 60, 150);
/// Least width of a pause, as a share of the whole time, so that it is seen.
const PAUSE_SHARE: f64 = 0.004;

fn colour(mode: u32) -> RGBColor {
    match Mode::from_u32(mode) {
        Some(Mode::Disengaged) => RGBColor(240, 240, 240),
        Some(Mode::Engaging) => RGBColor(255, 246, 205),
        Some(Mode::Engaged) => RGBColor(222, 243, 222),
        Some(Mode::Holding) => RGBColor(255, 226, 196),
        Some(Mode::Recovering) => RGBColor(222, 230, 250),
        Some(Mode::Faulted) | None => RGBColor(250, 208, 208),
    }
}

struct Line<'a> {
    colour: RGBColor,
    /// Line width, points. 0 draws a dot for each instant.
    width: u32,
    value: &'a dyn Fn(&Row) -> Option<f64>,
}

pub fn plot(path: &Path, trace: &Trace, model: &Model, title: &str) -> Result<(), RecordError> {
    let refuse = |cause: String| RecordError::Plot { file: path.display().to_string(), cause };
    if trace.rows().len() < 2 {
        return Err(refuse("fewer than two states, so there is nothing to draw".to_owned()));
    }
    // A panel for each joint, and for clearance, latency and the legend.
    let down = (model.count + 3).div_ceil(ACROSS) as u32;
    canvas::save(path, (ACROSS as u32 * PANEL.0, down * PANEL.1), |area| draw(area, trace, model, title))
        .map_err(refuse)
}

fn draw(area: &Area<'_>, trace: &Trace, model: &Model, title: &str) -> Drawn {
    let rows = trace.rows();
    let (head, body) = area.split_vertically(68);
    head.draw(&Text::new(title, (32, 16), text(LETTERS)))?;
    let panels = body.split_evenly(((model.count + 3).div_ceil(ACROSS), ACROSS));
    for (j, panel) in panels.iter().enumerate().take(model.count) {
        let limits = (model.limits[j].q_min, model.limits[j].q_max);
        let unit = if model.prismatic[j] { "m" } else { "rad" };
        let name = format!("{}, {unit}", model.joint_names[j]);
        let target = |row: &Row| row.target.filter(|(_, mask)| mask & 1 << j != 0).map(|(q, _)| q[j]);
        let lines = [
            Line { colour: TARGET, width: 2, value: &target },
            Line { colour: COMMAND, width: 4, value: &|row| row.command.map(|q| q[j]) },
            Line { colour: MEASURED, width: 2, value: &|row| Some(row.measured[j]) },
        ];
        let margin = 0.05 * (limits.1 - limits.0);
        chart(panel, trace, &name, (limits.0 - margin, limits.1 + margin), &lines, &[limits.0, limits.1])?;
    }
    let highest = |value: &dyn Fn(&Row) -> Option<f64>| rows.iter().filter_map(value).fold(1.0, f64::max) * 1.1;
    let clearance = |row: &Row| row.clearance_mm;
    let bound = model.d_min_m * 1e3;
    let lines = [Line { colour: COMMAND, width: 4, value: &clearance }];
    chart(&panels[model.count], trace, "clearance of the command, mm", (0.0, highest(&clearance)), &lines, &[bound])?;
    let latency = |row: &Row| row.latency_ms;
    let lines = [Line { colour: COMMAND, width: 0, value: &latency }];
    chart(&panels[model.count + 1], trace, "person seen to executed, ms", (0.0, highest(&latency)), &lines, &[])?;
    legend(&panels[model.count + 2])
}

fn chart(
    panel: &Area<'_>,
    trace: &Trace,
    name: &str,
    (low, high): (f64, f64),
    lines: &[Line<'_>],
    limits: &[f64],
) -> Drawn {
    let rows = trace.rows();
    let end_s = rows.last().map_or(1.0, |row| row.at_s).max(1e-3);
    let mut chart = ChartBuilder::on(panel)
        .caption(name, text(LETTERS))
        .margin(12)
        .x_label_area_size(48)
        .y_label_area_size(104)
        .build_cartesian_2d(0.0..end_s, low..high)?;
    for run in rows.chunk_by(|a, b| a.mode == b.mode) {
        let (first, last) = (&run[0], &run[run.len() - 1]);
        let next_s = rows.partition_point(|row| row.at_s <= last.at_s);
        let until_s = rows.get(next_s).map_or(end_s, |row| row.at_s);
        chart.draw_series([Rectangle::new([(first.at_s, low), (until_s, high)], colour(first.mode).filled())])?;
    }
    for (until_s, pause) in trace.pauses() {
        let from_s = (until_s - pause.length_s().max(PAUSE_SHARE * end_s)).max(0.0);
        chart.draw_series([Rectangle::new([(from_s, low), (until_s.min(end_s), high)], PAUSE.filled())])?;
    }
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(5)
        .y_labels(5)
        .x_label_formatter(&|s: &f64| format!("{s:.0}"))
        .y_label_formatter(&|y: &f64| if high - low > 20.0 { format!("{y:.0}") } else { format!("{y:.2}") })
        .label_style(text(LETTERS))
        .axis_style(INK.stroke_width(2))
        .draw()?;
    for &limit in limits {
        chart.draw_series(LineSeries::new([(0.0, limit), (end_s, limit)], LIMIT.stroke_width(2)))?;
    }
    for line in lines {
        // A gap in the values is a gap in the line.
        let has = |row: &Row| (line.value)(row).is_some();
        for run in rows.chunk_by(|a, b| has(a) == has(b)).filter(|run| has(&run[0])) {
            let points = run.iter().filter_map(|row| Some((row.at_s, (line.value)(row)?.clamp(low, high))));
            if line.width == 0 {
                chart.draw_series(points.map(|at| Circle::new(at, 2, line.colour.mix(0.6).filled())))?;
            } else {
                chart.draw_series(LineSeries::new(points, line.colour.stroke_width(line.width)))?;
            }
        }
    }
    Ok(())
}

fn legend(panel: &Area<'_>) -> Drawn {
    let lines = [("target", TARGET), ("command", COMMAND), ("measured", MEASURED), ("limit", LIMIT)];
    let lines = lines.map(|(name, colour)| (name, colour, 3));
    let modes = Mode::ALL.map(|mode| (mode.name(), colour(mode as u32), 16)).into_iter().chain([("pause", PAUSE, 16)]);
    for (y, (name, colour, half)) in (60..).step_by(44).zip(lines.into_iter().chain(modes)) {
        panel.draw(&Rectangle::new([(120, y - half), (200, y + half)], colour.filled()))?;
        panel.draw(&Text::new(name, (224, y - 16), text(LETTERS)))?;
    }
    Ok(())
}
