//! Draws the figures.

use crate::methods::Posture;
use crate::metrics::Task;
use crate::report::Report;
use crate::stick_figures::{Area, Drawn, FigureKind, draw, limbs_of, with_limbs};
use plotters::chart::SeriesAnno;
use plotters::prelude::*;
use retarget::ArmModel;
use rt::{Exit, Failure};
use std::path::{Path, PathBuf};

/// Number of instants shown as stick figures.
const INSTANTS: usize = 6;
/// Methods whose error is shown by limb, if measured.
const BY_LIMB: [&str; 5] = ["oracle", "ours_k2", "sew", "ours_k0", "closed_form_3lm"];
const COLOURS: [RGBColor; 5] = [
    RGBColor(120, 120, 120),
    RGBColor(30, 110, 190),
    RGBColor(60, 160, 90),
    RGBColor(120, 180, 230),
    RGBColor(210, 120, 40),
];
const LIMB_NAMES: [&str; 4] = ["left upper arm", "left forearm", "right upper arm", "right forearm"];

/// Draws into `folder`: `error-against-k.svg`, `error-by-limb.svg`, and `poses.svg` with the postures of `shown`.
pub fn draw_all(
    folder: &Path,
    report: &Report,
    arm: &ArmModel,
    tasks: &[Task],
    shown: Option<(&str, &[Vec<Posture>])>,
) -> Result<Vec<PathBuf>, Failure> {
    std::fs::create_dir_all(folder).map_err(|cause| Failure::unwritable(folder, &cause))?;
    let mut drawn = Vec::new();
    let mut picture = |name: &str, size: (u32, u32), paint: &dyn Fn(&Area<'_>) -> Drawn| {
        drawn.push(folder.join(name));
        paint_file(&folder.join(name), size, paint)
    };
    picture("error-against-k.svg", (640, 420), &|area| error_against_k(area, report))?;
    picture("error-by-limb.svg", (720, 420), &|area| error_by_limb(area, report))?;
    if let Some((name, postures)) = shown {
        let size = (180 * INSTANTS as u32, 420);
        picture("poses.svg", size, &|area| poses(area, arm, tasks, name, postures))?;
    }
    Ok(drawn)
}

pub fn paint_file(path: &Path, size: (u32, u32), paint: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), Failure> {
    let area = SVGBackend::new(path, size).into_drawing_area();
    let drawn = area.fill(&WHITE).and_then(|()| paint(&area)).and_then(|()| area.present());
    drawn.map_err(|error| Failure::new(Exit::CantCreate, format!("{}: cannot draw: {error}", path.display())))
}

fn error_against_k(area: &Area<'_>, report: &Report) -> Drawn {
    let points = |value: &dyn Fn(&crate::metrics::MethodFigures) -> f64| -> Vec<(f64, f64)> {
        (0..=3)
            .filter_map(|k| report.figures(&format!("ours_k{k}")).map(|figures| (f64::from(k), value(figures))))
            .collect()
    };
    let series = [
        ("limb", points(&|f| f.limb_deg_mean), COLOURS[1]),
        ("bone direction", points(&|f| f.direction_deg), COLOURS[2]),
    ];
    let highest = series.iter().flat_map(|(_, points, _)| points).map(|point| point.1).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption("Error against refinement steps", ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(52)
        .build_cartesian_2d(-0.2..3.2, 0.0..highest * 1.2)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .max_light_lines(0)
        .x_labels(4)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .x_desc("refinement steps K")
        .y_desc("mean error, degrees")
        .draw()?;
    for (name, points, colour) in series {
        let line = LineSeries::new(points.clone(), colour.stroke_width(3));
        name_line(chart.draw_series(line)?, name, colour.stroke_width(3));
        chart.draw_series(points.into_iter().map(|point| Circle::new(point, 4, colour.filled())))?;
    }
    if let Some(best) = report.figures("oracle") {
        let (grey, ends) = (COLOURS[0].stroke_width(2), [(-0.2, best.limb_deg_mean), (3.2, best.limb_deg_mean)]);
        let line = DashedLineSeries::new(ends, 6, 4, grey);
        name_line(chart.draw_series(line)?, "limb, best that the arm can do", grey);
    }
    legend(&mut chart)
}

pub type Chart<'a, 'b> = ChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

pub fn name_line<'a, 'b: 'a>(line: &mut SeriesAnno<'a, SVGBackend<'b>>, name: &str, style: ShapeStyle) {
    line.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
}

pub fn legend<'a, 'b: 'a>(chart: &mut Chart<'a, 'b>) -> Drawn {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", 13))
        .draw()
}

fn error_by_limb(area: &Area<'_>, report: &Report) -> Drawn {
    let rows: Vec<_> = BY_LIMB.iter().filter_map(|name| report.figures(name).map(|figures| (*name, figures))).collect();
    let highest = rows.iter().flat_map(|(_, figures)| figures.by_limb_deg).fold(1.0, f64::max);
    let mut chart = ChartBuilder::on(area)
        .caption("Mean error by limb", ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(32)
        .y_label_area_size(52)
        .build_cartesian_2d(0.0..4.0, 0.0..highest * 1.4)?;
    // A limb's name stands in the middle of its group.
    let name = |x: &f64| if x.fract() == 0.5 { LIMB_NAMES[*x as usize].to_owned() } else { String::new() };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .max_light_lines(0)
        .x_labels(9)
        .x_label_formatter(&name)
        .y_desc("mean error, degrees")
        .draw()?;
    let width = 0.8 / rows.len().max(1) as f64;
    for (row, (name, figures)) in rows.iter().enumerate() {
        let colour = COLOURS[row % COLOURS.len()];
        let bars = figures.by_limb_deg.iter().enumerate().map(|(limb, degrees)| {
            let left = limb as f64 + 0.1 + row as f64 * width;
            Rectangle::new([(left, 0.0), (left + width * 0.9, *degrees)], colour.filled())
        });
        chart
            .draw_series(bars)?
            .label(*name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
    }
    legend(&mut chart)
}

fn poses(area: &Area<'_>, arm: &ArmModel, tasks: &[Task], name: &str, postures: &[Vec<Posture>]) -> Drawn {
    let all: Vec<(&Task, usize, &Posture)> = tasks
        .iter()
        .zip(postures)
        .flat_map(|(task, postures)| postures.iter().enumerate().map(move |(frame, posture)| (task, frame, posture)))
        .collect();
    let chosen = (0..INSTANTS).filter_map(|i| all.get((2 * i + 1) * all.len() / (2 * INSTANTS)));
    let cells = area.split_evenly((2, INSTANTS));
    for (column, (task, frame, posture)) in chosen.enumerate() {
        let (Some(above), Some(below)) = (cells.get(column), cells.get(INSTANTS + column)) else { continue };
        let Some(positions) = task.clip.positions.get(*frame) else { continue };
        draw(above, positions, FigureKind::Human)?;
        draw(below, &with_limbs(positions, &limbs_of(arm, posture)), FigureKind::Robot)?;
        label(above, &format!("{} {:.1} s", task.clip.name, *frame as f64 / task.clip.rate_hz))?;
        label(below, name)?;
    }
    Ok(())
}

pub fn label(area: &Area<'_>, text: &str) -> Drawn {
    let (_, height) = area.dim_in_pixel();
    area.draw(&Text::new(text.to_owned(), (8, height as i32 - 18), ("sans-serif", 13)))
}
