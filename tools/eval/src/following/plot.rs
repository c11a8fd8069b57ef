//! Draws a clip: the error over time, and person and robot at six instants.

use super::judge::{Best, errors_deg};
use super::play::{Played, Sample};
use crate::plots::{label, legend, name_line, paint_file};
use crate::stick_figures::{Area, Drawn, FigureKind, draw, limbs_of, with_limbs};
use messages::Stamp;
use plotters::prelude::*;
use retarget::ArmModel;
use rt::Failure;
use std::path::Path;

/// Number of instants shown as stick figures.
const INSTANTS: usize = 6;
const NOW: RGBColor = RGBColor(210, 120, 40);
pub(crate) const DELAYED: RGBColor = RGBColor(30, 110, 190);
const BEST: RGBColor = RGBColor(120, 120, 120);

/// Draws `<clip>.svg` into `folder`. Draws nothing if the robot was never Engaged in the clip.
pub fn draw_clip(
    folder: &Path,
    arm: &ArmModel,
    played: &Played,
    delay_ms: f64,
    best: Option<&Best>,
) -> Result<(), Failure> {
    let Some(first) = played.spans.iter().flatten().next() else { return Ok(()) };
    let second = |at: Stamp| at.since(first.at) as f64 * 1e-9;
    let line = |delay_ms: f64| -> Vec<Vec<(f64, f64)>> {
        let spans = played.spans.iter().map(|span| errors_deg(arm, played, span, delay_ms));
        spans.map(|span| span.into_iter().map(|(at, deg)| (second(at), deg)).collect()).collect()
    };
    let best = best.map_or(&[][..], |best| &best.optimum_deg).iter().zip(&played.spans);
    let best = best.map(|(deg, span)| span.iter().zip(deg).map(|(sample, deg)| (second(sample.at), *deg)).collect());
    let lines = [
        ("same instant".to_owned(), line(0.0), NOW),
        (format!("person {delay_ms} ms before"), line(delay_ms), DELAYED),
        ("optimum".to_owned(), best.collect(), BEST),
    ];
    paint_file(&folder.join(format!("{}.svg", played.name)), (1080, 700), |area| {
        let (above, below) = area.split_vertically(300);
        error_over_time(&above, &played.name, &lines)?;
        instants(&below, arm, played, delay_ms, first.at)
    })
}

pub(crate) type Line = (String, Vec<Vec<(f64, f64)>>, RGBColor);

pub(crate) fn error_over_time(area: &Area<'_>, name: &str, lines: &[Line]) -> Drawn {
    let all = || lines.iter().flat_map(|(_, spans, _)| spans.iter().flatten());
    let (end, highest) = all().fold((0.1_f64, 10.0_f64), |(x, y), point| (x.max(point.0), y.max(point.1)));
    let mut chart = ChartBuilder::on(area)
        .caption(format!("{name}: angle between person and robot, mean of four limbs"), ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..end, 0.0..highest * 1.25)?;
    chart.configure_mesh().max_light_lines(0).x_desc("seconds").y_desc("degrees").draw()?;
    for (name, spans, colour) in lines.iter().filter(|(_, spans, _)| !spans.is_empty()) {
        for (i, span) in spans.iter().enumerate() {
            let drawn = chart.draw_series(LineSeries::new(span.iter().copied(), colour.stroke_width(2)))?;
            if i == 0 {
                name_line(drawn, name, colour.stroke_width(2));
            }
        }
    }
    legend(&mut chart)
}

fn instants(area: &Area<'_>, arm: &ArmModel, played: &Played, delay_ms: f64, start: Stamp) -> Drawn {
    let all: Vec<&Sample> = played.spans.iter().flatten().collect();
    let cells = area.split_evenly((2, INSTANTS));
    for column in 0..INSTANTS {
        let Some(sample) = all.get((2 * column + 1) * all.len() / (2 * INSTANTS)) else { continue };
        let then = Stamp(sample.at.0.saturating_sub((delay_ms * 1e6) as u64));
        let Some(positions) = played.person.positions(then) else { continue };
        let (Some(above), Some(below)) = (cells.get(column), cells.get(INSTANTS + column)) else { continue };
        draw(above, positions, FigureKind::Human)?;
        draw(below, &with_limbs(positions, &limbs_of(arm, &sample.q)), FigureKind::Robot)?;
        label(above, &format!("{:.1} s, {delay_ms} ms before", sample.at.since(start) as f64 * 1e-9))?;
        label(below, "robot")?;
    }
    Ok(())
}
