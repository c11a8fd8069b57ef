//! What the pictures share.

use crate::stick_figures::{Area, Drawn};
use plotters::chart::SeriesAnno;
use plotters::prelude::*;
use rt::{Exit, Failure};
use std::path::Path;

pub fn paint_file(path: &Path, size: (u32, u32), paint: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), Failure> {
    let area = SVGBackend::new(path, size).into_drawing_area();
    let drawn = area.fill(&WHITE).and_then(|()| paint(&area)).and_then(|()| area.present());
    drawn.map_err(|error| Failure::new(Exit::CantCreate, format!("{}: cannot draw: {error}", path.display())))
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

pub fn label(area: &Area<'_>, text: &str) -> Drawn {
    let (_, height) = area.dim_in_pixel();
    area.draw(&Text::new(text.to_owned(), (8, height as i32 - 18), ("sans-serif", 13)))
}
