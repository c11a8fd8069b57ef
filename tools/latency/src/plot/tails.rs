//! Draws how often each duration is exceeded: the complement of the cumulative distribution, with both axes
//! logarithmic.

use super::{AMBER, BLACK_, BLUE, GREEN, GREY, Look, ORANGE, PURPLE, SKY, builder, duration_label, legend, mesh};
use crate::distribution::Distribution;
use crate::measured::Measured;
use canvas::{Area, Drawn};
use plotters::prelude::*;

/// Lowest fraction shown: one wake-up in 11 minutes.
const RAREST: f64 = 1e-6;
/// Shortest and longest duration in the picture, us.
const SHORTEST_US: f64 = 0.1;
const LONGEST_US: f64 = 1e6;

struct Line<'a> {
    label: String,
    distribution: &'a Distribution,
    look: Look,
}

pub fn hops(area: &Area<'_>, measured: &Measured) -> Drawn {
    let looks = [
        Look::line(SKY, 3),
        Look::dashed(SKY, 3),
        Look::line(AMBER, 3),
        Look::dashed(AMBER, 3),
        Look::line(GREEN, 3),
        Look::dashed(GREEN, 3),
        Look::line(PURPLE, 3),
        Look::line(BLACK_, 4),
        Look::dashed(BLACK_, 4),
    ];
    let lines: Vec<_> = measured
        .events
        .hops()
        .zip(looks)
        .map(|((name, distribution), look)| Line { label: name.replace('_', " "), distribution, look })
        .collect();
    panel(area, "every hop, woken by events", &lines)
}

/// Draws end to end latency and wake-ups with their references.
pub fn compared(area: &Area<'_>, measured: &Measured) -> Drawn {
    let line = |label: &str, distribution, look| Line { label: label.to_owned(), distribution, look };
    let (events, polled) = (&measured.events, &measured.polled);
    let mut lines = vec![
        line("skeleton to command, events", events.hop("skeleton_to_command"), Look::line(BLUE, 4)),
        line("skeleton to command, polled", polled.hop("skeleton_to_command"), Look::line(ORANGE, 4)),
        line("target to command, events", events.hop("target_to_command"), Look::dashed(BLUE, 3)),
        line("target to command, polled", polled.hop("target_to_command"), Look::dashed(ORANGE, 3)),
        line("wake-up of retarget", events.wake_up(), Look::line(GREEN, 3)),
    ];
    if let Some(cyclictest) = &measured.cyclictest {
        lines.push(line("wake-up of cyclictest", cyclictest, Look::line(BLACK_, 3)));
    }
    lines.push(line("wake-up of own probe", &measured.probe, Look::dashed(GREY, 3)));
    panel(area, "end to end and wake-up, compared", &lines)
}

fn panel(area: &Area<'_>, title: &str, lines: &[Line<'_>]) -> Drawn {
    let (low, high) = span(lines);
    let rarest = lines.iter().map(|line| 1.0 / line.distribution.count().max(1) as f64).fold(1.0, f64::min);
    let floor = 10_f64.powf((rarest * 0.999).log10().floor()).clamp(RAREST, 1e-3);
    let mut chart = builder(area, title).build_cartesian_2d((low..high).log_scale(), (floor..1.0).log_scale())?;
    mesh(&mut chart)
        .x_desc("duration, µs")
        .y_desc("fraction that takes longer")
        .x_label_formatter(&duration_label)
        .y_label_formatter(&|fraction: &f64| if *fraction > 0.5 { "1".into() } else { format!("{fraction:.0e}") })
        .draw()?;
    for line in lines {
        line.look.draw(&mut chart, &line.label, steps(line.distribution, low, high, floor).into_iter())?;
    }
    legend(&mut chart, SeriesLabelPosition::LowerLeft)
}

/// Returns the range of the axis. It begins at the decade below the 1% quantile and ends a little above the
/// longest maximum.
fn span(lines: &[Line<'_>]) -> (f64, f64) {
    let lows = lines.iter().filter_map(|line| line.distribution.quantile_us(0.01));
    let low = lows.fold(LONGEST_US, f64::min).max(SHORTEST_US);
    let high = lines.iter().map(|line| line.distribution.max_us()).fold(10.0 * low, f64::max).min(LONGEST_US);
    (10_f64.powf(low.log10().floor()), 1.5 * high)
}

/// Returns the steps of a tail that lie in the picture. Fractions below the floor end on the floor.
fn steps(distribution: &Distribution, low: f64, high: f64, floor: f64) -> Vec<(f64, f64)> {
    let mut points: Vec<(f64, f64)> = vec![(low, 1.0)];
    for (us, fraction) in distribution.tail() {
        points.push((us.clamp(low, high), fraction.max(floor)));
        if fraction <= floor {
            break;
        }
    }
    points
}
