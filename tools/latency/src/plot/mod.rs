//! Draws the picture of a run: how often each duration is exceeded, and the wake-ups second by second.

mod jitter;
mod tails;

use crate::measured::Measured;
use canvas::{Area, Drawn, FINE};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::path::Path;

/// Size of the picture, pixels.
const SIZE: (u32, u32) = (1600, 1200);
/// Heights of headline, distributions and jitter, pixels.
const HEADLINE: u32 = 92;
const TAILS: u32 = 660;

/// Colours of Okabe and Ito, which colour-blind people can distinguish. They are darkened where they would be
/// too pale on white.
const INK: RGBColor = RGBColor(34, 40, 49);
const GREY: RGBColor = RGBColor(120, 126, 134);
const BLUE: RGBColor = RGBColor(0, 100, 170);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 140, 105);
const PURPLE: RGBColor = RGBColor(170, 75, 135);
const SKY: RGBColor = RGBColor(60, 160, 215);
const AMBER: RGBColor = RGBColor(205, 140, 0);
const BLACK_: RGBColor = RGBColor(20, 20, 20);

/// Font heights in pixels: small for axes and legends, large for titles.
const SMALL: u32 = 16;
const LARGE: u32 = 20;
const HUGE: u32 = 24;

/// Draws the picture of `measured` into the PNG `path`.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub fn draw(path: &Path, measured: &Measured) -> Result<(), String> {
    canvas::save(path, SIZE, |area| picture(area, measured))
}

fn picture(area: &Area<'_>, measured: &Measured) -> Drawn {
    let (head, rest) = area.split_vertically(HEADLINE * FINE);
    let (middle, low) = rest.split_vertically(TAILS * FINE);
    let (left, right) = middle.split_horizontally(SIZE.0 / 2 * FINE);
    headline(&head, measured)?;
    tails::hops(&left, measured)?;
    tails::compared(&right, measured)?;
    jitter::draw(&low, measured)
}

fn headline(area: &Area<'_>, measured: &Measured) -> Drawn {
    let (name, reference) = measured.reference();
    let told = |figure: Option<f64>| figure.map_or("?".into(), |figure| format!("{figure:.2}"));
    let title = format!(
        "skeleton to command: median {} times below polled; wake-up / {name}: p50 {}, p99 {}",
        told(measured.times_below_polled("skeleton_to_command")),
        told(measured.wake_up_ratio(reference, 0.5)),
        told(measured.wake_up_ratio(reference, 0.99)),
    );
    write(area, &title, (30, 18), HUGE, &INK)?;
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
    write(area, &machine, (30, 54), SMALL, &GREY)
}

fn font(height: u32) -> FontDesc<'static> {
    ("monospace", f64::from(height * FINE)).into_font()
}

/// Writes text at a position in pixels of the picture.
fn write(area: &Area<'_>, text: &str, (x, y): (i32, i32), height: u32, colour: &RGBColor) -> Drawn {
    let style = font(height).color(colour).pos(Pos::new(HPos::Left, VPos::Top));
    area.draw(&Text::new(text.to_owned(), (x * FINE as i32, y * FINE as i32), style))
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

    fn style(&self) -> ShapeStyle {
        self.colour.stroke_width(self.width * FINE / 2)
    }
}

/// Lengths of dashes and gaps of a dashed line, fine pixels.
const DASH: i32 = 16;
const GAP: i32 = 10;

/// Draws a legend in a box, each row with its line. `at` is its upper left corner in pixels of the picture.
fn legend(area: &Area<'_>, rows: &[(String, Look)], at: (i32, i32)) -> Drawn {
    let fine = FINE as i32;
    let longest = rows.iter().map(|(text, _)| text.chars().count()).max().unwrap_or(0) as i32;
    let (row, letter) = (20, 8);
    let corner = (at.0 + 52 + longest * letter, at.1 + 10 + row * rows.len() as i32);
    let frame = [(at.0 * fine, at.1 * fine), (corner.0 * fine, corner.1 * fine)];
    area.draw(&Rectangle::new(frame, WHITE.mix(0.88).filled()))?;
    area.draw(&Rectangle::new(frame, RGBColor(205, 208, 213).stroke_width(2)))?;
    for (i, (text, look)) in rows.iter().enumerate() {
        let y = (at.1 + 5 + row * i as i32 + row / 2) * fine;
        let (from, to) = ((at.0 + 8) * fine, (at.0 + 36) * fine);
        let step = if look.dashed { DASH + GAP } else { to - from };
        let length = if look.dashed { DASH } else { to - from };
        for start in (from..to).step_by(step as usize) {
            let line = [(start, y), ((start + length).min(to), y)];
            area.draw(&PathElement::new(line, look.style()))?;
        }
        write(area, text, (at.0 + 44, at.1 + 5 + row * i as i32 + 2), SMALL, &INK)?;
    }
    Ok(())
}

/// Formats powers of ten without a fraction, us.
fn duration_label(us: &f64) -> String {
    if *us >= 1.0 { format!("{us:.0}") } else { format!("{us}") }
}
