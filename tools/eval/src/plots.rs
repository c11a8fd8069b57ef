//! Draws the error of a clip over time.

use plotters::prelude::*;
use rt::{Exit, Failure};
use std::path::Path;

const COLOUR: RGBColor = RGBColor(30, 110, 190);

/// Draws the angle between person and robot, degrees, over time, s, as an SVG file.
pub fn draw(path: &Path, caption: &str, line: &[(f64, f64)]) -> Result<(), Failure> {
    let paint = || -> Result<(), DrawingAreaErrorKind<_>> {
        let area = SVGBackend::new(path, (1080, 320)).into_drawing_area();
        area.fill(&WHITE)?;
        let (end, highest) = line.iter().fold((0.1_f64, 10.0_f64), |(x, y), point| (x.max(point.0), y.max(point.1)));
        let mut chart = ChartBuilder::on(&area)
            .caption(caption, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..end, 0.0..highest * 1.25)?;
        chart.configure_mesh().max_light_lines(0).x_desc("seconds").y_desc("degrees").draw()?;
        chart.draw_series(LineSeries::new(line.iter().copied(), COLOUR.stroke_width(2)))?;
        area.present()
    };
    paint().map_err(|error| Failure::new(Exit::CantCreate, format!("{}: cannot draw: {error}", path.display())))
}
