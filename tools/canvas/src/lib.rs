//! A picture with smooth lines and its own letters. It is drawn at twice its size and reduced by averaging.
//! Then the letters are drawn from a built-in font, so that no font of the system is needed.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind, FontStyle, FontTransform,
};
use std::cell::RefCell;
use std::path::Path;
use std::rc::Rc;

/// Fine pixels for each pixel of the picture, in both directions. Coordinates and letter sizes are in fine
/// pixels.
pub const FINE: u32 = 2;

/// Error type of the bitmap's backend.
type Fault = <BitMapBackend<'static> as DrawingBackend>::ErrorType;
/// The whole picture, or a part of it.
pub type Area<'a> = DrawingArea<Canvas<'a>, Shift>;
/// Result of drawing.
pub type Drawn = Result<(), DrawingAreaErrorKind<Fault>>;

/// A line of letters, to be drawn at the end.
struct Letters {
    text: String,
    weight: FontWeight,
    height: RasterHeight,
    colour: BackendColor,
    transform: FontTransform,
    // Position of the anchor, in pixels of the picture.
    at: (i32, i32),
    anchor: (HPos, VPos),
}

/// A backend that stores its letters until the end.
pub struct Canvas<'a> {
    bitmap: BitMapBackend<'a>,
    letters: Rc<RefCell<Vec<Letters>>>,
}

/// Draws a picture of `size` pixels, initially white, into a PNG.
///
/// # Errors
/// Returns an error if it cannot be drawn, or the file cannot be written.
pub fn save(path: &Path, size: (u32, u32), draw: impl FnOnce(&Area<'_>) -> Drawn) -> Result<(), String> {
    let fine = (size.0 * FINE, size.1 * FINE);
    let mut pixels = vec![255_u8; fine.0 as usize * fine.1 as usize * 3];
    let letters: Rc<RefCell<Vec<Letters>>> = Rc::default();
    let canvas = Canvas { bitmap: BitMapBackend::with_buffer(&mut pixels, fine), letters: Rc::clone(&letters) };
    let area = canvas.into_drawing_area();
    draw(&area).and_then(|()| area.present()).map_err(|error| error.to_string())?;
    drop(area);
    let mut picture = brought_down(&pixels, size);
    for line in letters.borrow().iter() {
        line.set(&mut picture, size);
    }
    let mut file = BitMapBackend::new(path, size);
    file.blit_bitmap((0, 0), size, &picture).and_then(|()| file.present()).map_err(|error| error.to_string())
}

/// Returns the mean of each square of fine pixels.
fn brought_down(fine: &[u8], (width, height): (u32, u32)) -> Vec<u8> {
    let (w, h, n) = (width as usize, height as usize, FINE as usize);
    let mut picture = Vec::with_capacity(w * h * 3);
    for y in 0..h {
        for x in 0..w {
            for channel in 0..3 {
                let square = (0..n * n).map(|i| fine[((y * n + i / n) * w * n + x * n + i % n) * 3 + channel]);
                picture.push((square.map(usize::from).sum::<usize>() / (n * n)) as u8);
            }
        }
    }
    picture
}

fn raster<S: BackendTextStyle>(style: &S) -> (FontWeight, RasterHeight) {
    let weight = if matches!(style.style(), FontStyle::Bold) { FontWeight::Bold } else { FontWeight::Regular };
    let height = match style.size() / f64::from(FINE) {
        size if size <= 16.0 => RasterHeight::Size16,
        size if size <= 20.0 => RasterHeight::Size20,
        _ => RasterHeight::Size24,
    };
    (weight, height)
}

impl Letters {
    fn set(&self, picture: &mut [u8], (width, height): (u32, u32)) {
        let step = get_raster_width(self.weight, self.height) as i32;
        let (w, h) = (step * self.text.chars().count() as i32, self.height.val() as i32);
        let dx = match self.anchor.0 {
            HPos::Left => 0,
            HPos::Center => -w / 2,
            HPos::Right => -w,
        };
        let dy = match self.anchor.1 {
            VPos::Top => 0,
            VPos::Center => -h / 2,
            VPos::Bottom => -h,
        };
        for (i, letter) in self.text.chars().enumerate() {
            let glyph = get_raster(letter, self.weight, self.height);
            for (row, line) in glyph.iter().flat_map(|glyph| glyph.rows()).enumerate() {
                for (column, &cover) in line.iter().enumerate() {
                    let (x, y) = (dx + i as i32 * step + column as i32, dy + row as i32);
                    let (x, y) = self.transform.transform(x, y);
                    let (x, y) = (x + self.at.0, y + self.at.1);
                    if (0..width as i32).contains(&x) && (0..height as i32).contains(&y) {
                        let pixel = (y as usize * width as usize + x as usize) * 3;
                        self.blend(&mut picture[pixel..pixel + 3], f64::from(cover) / 255.0);
                    }
                }
            }
        }
    }

    fn blend(&self, pixel: &mut [u8], cover: f64) {
        let (red, green, blue) = self.colour.rgb;
        let alpha = cover * self.colour.alpha;
        for (channel, ink) in pixel.iter_mut().zip([red, green, blue]) {
            *channel = (f64::from(*channel) * (1.0 - alpha) + f64::from(ink) * alpha).round() as u8;
        }
    }
}

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Fault;

    fn get_size(&self) -> (u32, u32) {
        self.bitmap.get_size()
    }

    fn ensure_prepared(&mut self) -> Result<(), DrawingErrorKind<Fault>> {
        self.bitmap.ensure_prepared()
    }

    fn present(&mut self) -> Result<(), DrawingErrorKind<Fault>> {
        self.bitmap.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, colour: BackendColor) -> Result<(), DrawingErrorKind<Fault>> {
        self.bitmap.draw_pixel(point, colour)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Result<(), DrawingErrorKind<Fault>> {
        self.bitmap.draw_line(from, to, style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: BackendCoord,
        bottom_right: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Result<(), DrawingErrorKind<Fault>> {
        self.bitmap.draw_rect(upper_left, bottom_right, style, fill)
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        at: BackendCoord,
    ) -> Result<(), DrawingErrorKind<Fault>> {
        let (weight, height) = raster(style);
        let (text, at) = (text.to_owned(), (at.0 / FINE as i32, at.1 / FINE as i32));
        let anchor = (style.anchor().h_pos, style.anchor().v_pos);
        let (colour, transform) = (style.color(), style.transform());
        self.letters.borrow_mut().push(Letters { text, weight, height, colour, transform, at, anchor });
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Fault>> {
        let (weight, height) = raster(style);
        let width = get_raster_width(weight, height) * text.chars().count();
        Ok((width as u32 * FINE, height.val() as u32 * FINE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picture_is_saved_as_png_and_text_at_the_edge_leaves_ink() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let ink = RGBColor(200, 0, 0);
        save(&path, (120, 60), |area| {
            area.draw(&Rectangle::new([(0, 0), (239, 39)], BLUE.filled()))?;
            area.draw(&Text::new("µs 1/x", (20, 60), ("monospace", 32).into_font().color(&ink)))
        })
        .expect("a picture");
        assert!(std::fs::read(&path).unwrap().starts_with(b"\x89PNG"));

        let mut picture = vec![255_u8; 40 * 20 * 3];
        let colour = BackendColor { alpha: 1.0, rgb: (200, 0, 0) };
        let (weight, height) = (FontWeight::Regular, RasterHeight::Size16);
        let (transform, anchor) = (FontTransform::None, (HPos::Left, VPos::Top));
        // The text deliberately crosses the edge. The part outside is left out.
        Letters { text: "XXXXXXXX".into(), weight, height, colour, transform, at: (-3, 2), anchor }
            .set(&mut picture, (40, 20));
        let inked = picture.chunks(3).filter(|pixel| pixel[0] > pixel[1]).count();
        assert!((100..600).contains(&inked), "{inked} pixels of ink");
    }

    #[test]
    fn downsampled_pixel_is_the_mean_of_its_block() {
        let fine = [[0_u8; 3], [255; 3], [255; 3], [255; 3], [10; 3], [10; 3], [20; 3], [20; 3]].concat();
        assert_eq!(brought_down(&fine, (1, 1)), [191; 3]);
        assert_eq!(brought_down(&fine, (1, 2)), [[191; 3], [15; 3]].concat());
    }

    #[test]
    fn picture_in_a_missing_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(save(&folder.path().join("none/a.png"), (10, 10), |_| Ok(())).is_err());
    }
}
