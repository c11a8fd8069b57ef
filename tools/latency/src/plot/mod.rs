//! Draws the picture of a run: how often each duration is exceeded, and the wake-ups second by second.

mod jitter;
mod tails;

use crate::measured::Measured;
use canvas::{Area, Canvas, Drawn, text};
use plotters::chart::MeshStyle;
use plotters::coord::combinators::LogCoord;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use std::path::Path;

/// Size of the picture, points of the canvas.
const SIZE: (u32, u32) = (3200, 2400);
/// Heights of headline and distributions, points.
const HEADLINE: u32 = 184;
const TAILS: u32 = 1320;

/// Colours of Okabe and Ito, which colour-blind people can distinguish. They are darkened where they would be
/// too pale on white.
const GREY: RGBColor = RGBColor(120, 126, 134);
const BLUE: RGBColor = RGBColor(0, 100, 170);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 140, 105);
const PURPLE: RGBColor = RGBColor(170, 75, 135);
const SKY: RGBColor = RGBColor(60, 160, 215);
const AMBER: RGBColor = RGBColor(205, 140, 0);
const BLACK_: RGBColor = RGBColor(20, 20, 20);

/// Font heights, points: small for axes and legends, large for titles.
const SMALL: u32 = 32;
const LARGE: u32 = 40;
const HUGE: u32 = 48;

/// Draws the picture of `measured` into the PNG `path`.
pub fn draw(path: &Path, measured: &Measured) -> Result<(), String> {
    canvas::save(path, SIZE, |area| {
        let (head, rest) = area.split_vertically(HEADLINE);
        let (middle, low) = rest.split_vertically(TAILS);
        let (left, right) = middle.split_horizontally(SIZE.0 / 2);
        headline(&head, measured)?;
        tails::hops(&left, measured)?;
        tails::compared(&right, measured)?;
        jitter::draw(&low, measured)
    })
}

fn headline(area: &Area<'_>, measured: &Measured) -> Drawn {
    let (name, reference) = measured.reference();
    let ratio_text = |figure: Option<f64>| figure.map_or("?".into(), |figure| format!("{figure:.2}"));
    let title = format!(
        "skeleton to command: median {} times below polled; wake-up / {name}: p50 {}, p99 {}",
        ratio_text(measured.times_below_polled("skeleton_to_command")),
        ratio_text(measured.wake_up_ratio(reference, 0.5)),
        ratio_text(measured.wake_up_ratio(reference, 0.99)),
    );
    area.draw(&Text::new(title, (60, 36), text(HUGE)))?;
    let facts = measured.host.rows();
    let fact = |wanted: &str| facts.iter().find(|(name, _)| *name == wanted).map_or("?", |(_, value)| value.as_str());
    let machine = format!(
        "{}, {} cores, {}, {}; {}; load {} before, {} after",
        fact("processor"),
        fact("cores"),
        fact("kernel"),
        fact("preemption"),
        measured.granted("scheduling"),
        fact("load_average_before"),
        fact("load_average_after"),
    );
    area.draw(&Text::new(machine, (60, 108), text(SMALL).color(&GREY)))
}

/// A chart with durations, us, or fractions upwards.
type Chart<'a, X> = ChartContext<'a, Canvas<'a>, Cartesian2d<X, LogCoord<f64>>>;

/// Begins a chart with room for its axes.
fn builder<'a, 'b>(area: &'b Area<'a>, title: &str) -> ChartBuilder<'b, 'static, Canvas<'a>> {
    let mut builder = ChartBuilder::on(area);
    builder.caption(title, text(LARGE)).margin(32).margin_right(64).x_label_area_size(92).y_label_area_size(140);
    builder
}

/// Sets what all charts have in common. The caller adds the descriptions of the axes, and draws.
fn mesh<'a, 'b, X>(chart: &'b mut Chart<'a, X>) -> MeshStyle<'a, 'b, X, LogCoord<f64>, Canvas<'a>>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut mesh = chart.configure_mesh();
    mesh.label_style(text(SMALL)).axis_desc_style(text(SMALL)).axis_style(GREY.stroke_width(2));
    mesh.bold_line_style(RGBColor(214, 217, 221).stroke_width(2)).light_line_style(RGBColor(239, 241, 243));
    mesh
}

/// Style of a line.
#[derive(Clone, Copy)]
struct Look {
    colour: RGBColor,
    width: u32,
    dashed: bool,
}

impl Look {
    const fn line(colour: RGBColor, width: u32) -> Self {
        Self { colour, width, dashed: false }
    }

    const fn dashed(colour: RGBColor, width: u32) -> Self {
        Self { colour, width, dashed: true }
    }

    /// Draws a line through `points`, with a row in the legend.
    fn draw<'a, X: Ranged<ValueType = f64>>(
        self,
        chart: &mut Chart<'a, X>,
        name: &str,
        points: impl Iterator<Item = (f64, f64)> + Clone,
    ) -> Drawn {
        /// Lengths of dashes and gaps, points.
        const DASH: [u32; 2] = [16, 10];
        let style = self.colour.stroke_width(self.width);
        let drawn = if self.dashed {
            chart.draw_series(DashedLineSeries::new(points, DASH[0], DASH[1], style))?
        } else {
            chart.draw_series(LineSeries::new(points, style))?
        };
        drawn.label(name).legend(move |(x, y)| {
            let row = [(x, y), (x + 56, y)];
            if self.dashed {
                DashedPathElement::new(row, DASH[0], DASH[1], style).into_dyn()
            } else {
                PathElement::new(row, style).into_dyn()
            }
        });
        Ok(())
    }
}

fn legend<'a, X: Ranged<ValueType = f64>>(chart: &mut Chart<'a, X>, position: SeriesLabelPosition) -> Drawn {
    let mut labels = chart.configure_series_labels();
    labels.position(position).legend_area_size(72).margin(20).label_font(text(SMALL));
    labels.background_style(WHITE.mix(0.88)).border_style(RGBColor(205, 208, 213).stroke_width(2)).draw()
}

/// Formats powers of ten without a fraction, us.
fn duration_label(us: &f64) -> String {
    if *us >= 1.0 { format!("{us:.0}") } else { format!("{us}") }
}
