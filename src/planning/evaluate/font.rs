//! Text on a canvas, in fixed-width fonts of embedded-graphics with the characters of ISO 8859-1.

use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_10X20};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::text::Baseline;
use embedded_graphics::text::renderer::TextRenderer;

use super::raster::Canvas;

/// Size of letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Font {
    /// 6 × 10 pixels.
    Small,
    /// 10 × 20 pixels.
    Large,
}

impl Font {
    fn face(self) -> &'static MonoFont<'static> {
        match self {
            Self::Small => &FONT_6X10,
            Self::Large => &FONT_10X20,
        }
    }

    /// Height of a line, pixels.
    pub(super) fn height(self) -> usize {
        self.face().character_size.height as usize
    }

    /// Width of `text`, pixels.
    pub(super) fn width(self, text: &str) -> usize {
        text.chars().count() * self.face().character_size.width as usize
    }

    /// Writes `text` with its top left at `(x, y)`; what does not fit on the canvas is cut off.
    pub(super) fn write(self, canvas: &mut Canvas, text: &str, x: usize, y: usize, [r, g, b]: [u8; 3]) {
        // The fonts have neither a minus sign nor a dash.
        let text = text.replace(['−', '–'], "-");
        let style = MonoTextStyle::new(self.face(), Rgb888::new(r, g, b));
        let at = Point::new(i32::try_from(x).unwrap_or(i32::MAX), i32::try_from(y).unwrap_or(i32::MAX));
        let Ok(_end) = style.draw_string(&text, at, Baseline::Top, canvas);
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.width as u32, self.height as u32)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(at, colour) in pixels {
            if let (Ok(x), Ok(y)) = (usize::try_from(at.x), usize::try_from(at.y)) {
                self.set(x, y, [colour.r(), colour.g(), colour.b()]);
            }
        }
        Ok(())
    }
}
