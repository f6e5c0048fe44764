use std::io::Cursor;

use image::{ImageFormat, Rgb, RgbImage};

use crate::jobs::Service;
use crate::session::{Case, Fault, FaultKind, Halt, Solid};
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::evaluate::diverging;

/// Pixels along the longer side of a slice.
const SIZE_PX: u32 = 512;
/// Distance at which the colours saturate, mm.
const LIMIT_MM: f64 = 20.0;

/// A plane `axis = offset_mm` through a field as a PNG: blue inside, red outside, black at the surface. Second axis up
/// (or z up), LPS; patient left is to the right of the picture.
///
/// # Errors
/// What the numerics say.
pub async fn field_slice(
    service: &Service,
    case: Case,
    solid: Solid,
    axis: usize,
    offset_mm: f64,
) -> Result<Vec<u8>, Fault> {
    service
        .compute(move |engine, control| {
            let bounds = case.anatomy.skin.bounds().grown(5.0);
            let (across, up) = [(1, 2), (0, 2), (0, 1)][axis];
            let pixel_mm = (bounds.max - bounds.min).max() / f64::from(SIZE_PX);
            let [width, height] =
                [across, up].map(|a| (((bounds.max[a] - bounds.min[a]) / pixel_mm).ceil() as u32).clamp(1, SIZE_PX));
            let points = pixel_centres(&bounds, [axis, across, up], [width, height], offset_mm, pixel_mm);
            let values = engine.distances(&case, solid, &points, control)?;
            let mut picture = RgbImage::new(width, height);
            for (index, (value, _)) in values.iter().enumerate() {
                let colour = if value.abs() < pixel_mm { [0; 3] } else { diverging(*value, LIMIT_MM) };
                let (x, y) = (index as u32 % width, index as u32 / width);
                picture.put_pixel(x, y, Rgb(colour));
            }
            let mut png = Cursor::new(Vec::new());
            picture
                .write_to(&mut png, ImageFormat::Png)
                .map_err(|e| Halt::from(Fault::new(FaultKind::Internal, e.to_string())))?;
            Ok(png.into_inner())
        })
        .await
}

/// Row by row from the top left.
fn pixel_centres(
    bounds: &Aabb,
    [axis, across, up]: [usize; 3],
    [width, height]: [u32; 2],
    offset_mm: f64,
    pixel_mm: f64,
) -> Vec<Point> {
    let mut points = Vec::with_capacity((width * height) as usize);
    for row in 0..height {
        for column in 0..width {
            let mut p = Point::origin();
            p[axis] = offset_mm;
            p[across] = bounds.min[across] + (f64::from(column) + 0.5) * pixel_mm;
            p[up] = bounds.max[up] - (f64::from(row) + 0.5) * pixel_mm;
            points.push(p);
        }
    }
    points
}
