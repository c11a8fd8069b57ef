//! Pictures in a PNG. Plotters draws them at twice their size, and each pixel is the mean of four, so that lines are
//! smooth. Letters come from a built-in font, so that no font of the system is needed.

use image::{ImageFormat, Rgb, RgbImage, imageops::thumbnail};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{BackendColor, BackendCoord, BackendTextStyle, DrawingErrorKind};
use std::path::Path;

/// Points for each pixel of the picture, in both directions. Sizes and coordinates are in points.
const FINE: i32 = 2;
/// Colour of text.
pub const INK: RGBColor = RGBColor(34, 40, 49);

/// Error type of the bitmap's backend.
type Fault = <BitMapBackend<'static> as DrawingBackend>::ErrorType;
/// The whole picture, or a part of it.
pub type Area<'a> = DrawingArea<Canvas<'a>, Shift>;
/// Result of drawing.
pub type Drawn = Result<(), DrawingAreaErrorKind<Fault>>;

/// The bitmap of a picture, with letters of its own.
pub struct Canvas<'a>(BitMapBackend<'a>);

/// Draws a picture of `size` points, initially white, into a PNG with half as many pixels in each direction.
///
/// # Errors
/// Returns an error if it cannot be drawn, or the file cannot be written.
pub fn save(path: &Path, size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), String> {
    let mut points = RgbImage::from_pixel(size.0, size.1, Rgb([255; 3]));
    let area = Canvas(BitMapBackend::with_buffer(&mut points, size)).into_drawing_area();
    draw(&area).map_err(|error| error.to_string())?;
    drop(area);
    let picture = thumbnail(&points, size.0 / FINE as u32, size.1 / FINE as u32);
    picture.save_with_format(path, ImageFormat::Png).map_err(|error| error.to_string())
}

/// Returns the style of text of this height, points. The font has the heights 32, 40 and 48.
#[must_use]
pub fn text(height: u32) -> TextStyle<'static> {
    ("monospace", height).into_font().color(&INK)
}

fn raster(size: f64) -> RasterHeight {
    match size {
        size if size < 40.0 => RasterHeight::Size16,
        size if size < 48.0 => RasterHeight::Size20,
        _ => RasterHeight::Size24,
    }
}

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Fault;

    fn get_size(&self) -> (u32, u32) {
        self.0.get_size()
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Fault>> {
        self.0.ensure_prepared()
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Fault>> {
        self.0.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, colour: BackendColor) -> Result<(), DrawingErrorKind<Fault>> {
        self.0.draw_pixel(point, colour)
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        at: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Fault>> {
        let (width, height) = self.estimate_text_size(text, style)?;
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -(width as i32) / 2,
            HPos::Right => -(width as i32),
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -(height as i32) / 2,
            VPos::Bottom => -(height as i32),
        };
        let glyphs = text.chars().map(|letter| get_raster(letter, FontWeight::Regular, raster(style.size())));
        for (i, glyph) in glyphs.enumerate() {
            for (row, line) in glyph.iter().flat_map(|glyph| glyph.rows()).enumerate() {
                for (column, &cover) in line.iter().enumerate() {
                    let (across, down) = ((i * line.len() + column) as i32, row as i32);
                    let (x, y) = style.transform().transform(left / FINE + across, top / FINE + down);
                    let colour = style.color().mix(f64::from(cover) / 255.0);
                    // All points of one pixel, so that the letters stay sharp.
                    for point in 0..FINE * FINE {
                        let inside = |at: i32, step: i32, part: i32| (at / FINE + step) * FINE + part;
                        let (x, y) = (inside(at.0, x, point % FINE), inside(at.1, y, point / FINE));
                        self.0.draw_pixel((x, y), colour)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Fault>> {
        let height = raster(style.size());
        let width = get_raster_width(FontWeight::Regular, height) * text.chars().count();
        Ok((width as u32 * FINE as u32, height.val() as u32 * FINE as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_across_the_edge_of_a_bitmap_leaves_ink() {
        let mut points = vec![255_u8; 80 * 40 * 3];
        let area = Canvas(BitMapBackend::with_buffer(&mut points, (80, 40))).into_drawing_area();
        // The part outside is left out.
        area.draw(&Text::new("XXXXXXXX", (-6, 4), text(32).color(&RGBColor(200, 0, 0)))).expect("a text");
        drop(area);
        let inked = points.chunks(3).filter(|point| point[0] > point[1]).count();
        assert!((400..2400).contains(&inked), "{inked} points of ink");
    }

    #[test]
    fn pixel_of_a_saved_png_is_the_mean_of_its_points() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        save(&path, (4, 2), |area| {
            area.draw(&Pixel::new((1, 1), BLACK))?;
            area.draw(&Rectangle::new([(2, 0), (4, 1)], RGBColor(10, 20, 30).filled()))
        })
        .expect("a picture");
        assert!(std::fs::read(&path).unwrap().starts_with(b"\x89PNG"));
        let picture = image::open(&path).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (2, 1));
        assert!(picture.get_pixel(0, 0).0.iter().all(|&channel| (190..=192).contains(&channel)), "{picture:?}");
    }

    #[test]
    fn picture_in_a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(save(&folder.path().join("none/a.png"), (10, 10), |_| Ok(())).is_err());
    }
}
