//! An image with its position, and what makes two images slices of one volume.

use super::header::{Header, ImagePlane};

/// Directions and spacings that differ by less, through rounded decimals, count as the same.
const MAX_DIFFERENCE: f64 = 1e-3;

/// An image with its position, and its file in the archive.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Image {
    /// Index of the file in the archive.
    pub(super) file: usize,
    pub(super) header: Header,
    pub(super) plane: ImagePlane,
}

/// Position of `image` along the normal of the first of `images`, from that one, mm.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn height(images: &[Image], image: &Image) -> f64 {
    let Some(first) = images.first() else { return 0.0 };
    let normal = first.plane.along_row.cross(&first.plane.along_column).normalize();
    (image.plane.origin - first.plane.origin).dot(&normal)
}

/// Whether two images can be slices of one volume.
#[expect(clippy::arithmetic_side_effects, reason = "floating point")]
pub(super) fn alike(a: &Image, b: &Image) -> bool {
    let near = |x: f64, y: f64| (x - y).abs() <= MAX_DIFFERENCE * x.abs();
    (a.header.columns, a.header.rows) == (b.header.columns, b.header.rows)
        && near(a.plane.spacing[0], b.plane.spacing[0])
        && near(a.plane.spacing[1], b.plane.spacing[1])
        && (a.plane.along_row - b.plane.along_row).norm() <= MAX_DIFFERENCE
        && (a.plane.along_column - b.plane.along_column).norm() <= MAX_DIFFERENCE
}
