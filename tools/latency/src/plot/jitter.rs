//! Wake-ups over time: median, 99th percentile and maximum of each second, block by block.

use super::{BLUE, GREY, Look, ORANGE, builder, duration_label, legend, mesh};
use crate::distribution::{Distribution, Second};
use crate::measured::Measured;
use canvas::{Area, Drawn};
use plotters::prelude::*;

/// A gap of this length in a record, s, starts the next block.
const PAUSE_S: f64 = 2.5;
/// Shortest and longest wake-up in the picture, us.
const SHORTEST_US: f64 = 0.1;
const LONGEST_US: f64 = 1e6;

/// Draws the lower part of the picture.
pub fn draw(area: &Area<'_>, measured: &Measured) -> Drawn {
    let start_s = measured.start.0 as f64 * 1e-9;
    let series: [(&str, &Distribution, RGBColor); 3] = [
        ("retarget, events", measured.events.wake_up(), BLUE),
        ("retarget, polled", measured.polled.wake_up(), ORANGE),
        ("own probe", &measured.probe, GREY),
    ];
    let all = || series.iter().flat_map(|(_, distribution, _)| &distribution.seconds);
    let end_s = all().map(|second| second.at_s - start_s + 1.0).fold(1.0, f64::max);
    let low = all().map(|second| second.p50_us).fold(LONGEST_US, f64::min).clamp(SHORTEST_US, LONGEST_US / 10.0);
    let high = all().map(|second| second.max_us).fold(10.0 * low, f64::max).min(LONGEST_US);
    let decades = 10_f64.powf(low.log10().floor())..10_f64.powf(high.log10().ceil());
    let title = "wake-up after the deadline, each second: p50 (thick), p99 (thin), maximum (dots)";
    let mut chart = builder(area, title).build_cartesian_2d(0.0..end_s, decades.clone().log_scale())?;
    mesh(&mut chart)
        .x_labels(14)
        .x_desc("time, s; the references and the starts of the processes lie between the blocks")
        .y_desc("µs")
        .x_label_formatter(&|s: &f64| format!("{s:.0}"))
        .y_label_formatter(&duration_label)
        .draw()?;
    let inside = |us: f64| us.clamp(decades.start, decades.end);
    for (name, distribution, colour) in &series {
        // A block's line has no row in the legend, because the blocks share one.
        Look::line(*colour, 5).draw(&mut chart, name, std::iter::empty())?;
        for block in blocks(&distribution.seconds) {
            let points = |of: fn(&Second) -> f64| block.iter().map(move |one| (one.at_s - start_s, inside(of(one))));
            // The last second is drawn with its full length, so that a block of one second is visible too.
            let line = |of| points(of).chain(points(of).next_back().map(|(at_s, us)| (at_s + 1.0, us)));
            chart.draw_series(LineSeries::new(line(|one| one.p50_us), colour.stroke_width(5)))?;
            chart.draw_series(LineSeries::new(line(|one| one.p99_us), colour.mix(0.75).stroke_width(2)))?;
            chart.draw_series(points(|one| one.max_us).map(|at| Circle::new(at, 4, colour.mix(0.8).filled())))?;
        }
    }
    legend(&mut chart, SeriesLabelPosition::UpperRight)
}

/// Splits the seconds at pauses.
fn blocks(seconds: &[Second]) -> impl Iterator<Item = &[Second]> {
    seconds.chunk_by(|before, after| (0.0..PAUSE_S).contains(&(after.at_s - before.at_s)))
}
