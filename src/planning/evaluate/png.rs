/// Encodes RGB pixels, row by row from the top left, as a PNG.
/// Returns `None` unless there are `3 * width * height` bytes and at least one pixel.
#[must_use]
pub fn rgb_png(pixels: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(pixels).ok()?;
    writer.finish().ok()?;
    Some(bytes)
}

/// A PNG decoded by a test.
#[cfg(test)]
pub(super) struct Decoded {
    pub(super) size: (u32, u32),
    pixels: Vec<u8>,
}

#[cfg(test)]
impl Decoded {
    pub(super) fn of(bytes: &[u8]) -> Self {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgb, png::BitDepth::Eight));
        Self { size: (info.width, info.height), pixels }
    }

    pub(super) fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 3 * (y * self.size.0 + x) as usize;
        self.pixels[at..at + 3].try_into().unwrap()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_come_back_and_sizes_must_match() {
        let pixels: Vec<u8> = (0..2 * 3 * 3).collect();
        let image = Decoded::of(&rgb_png(&pixels, 3, 2).unwrap());
        assert_eq!((image.size, image.pixel(2, 1)), ((3, 2), [15, 16, 17]));
        assert_eq!(rgb_png(&pixels, 2, 2), None);
        assert_eq!(rgb_png(&[], 0, 2), None);
    }
}
