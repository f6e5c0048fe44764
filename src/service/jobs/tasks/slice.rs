use crate::Service;
use prosopon_contract::{Fault, FaultKind, Halt, Solid};
use prosopon_geometry::{Aabb, Point};
use prosopon_planning::evaluate::{diverging, rgb_png};
use prosopon_session::Case;

/// Pixels along the longer side of a slice.
const SIZE_PX: u32 = 512;
/// Distance at which the colours saturate, mm.
const LIMIT_MM: f64 = 20.0;

/// Picture (PNG) of a distance field in the plane `axis = offset_mm`; `axis` is 0, 1 or 2 of LPS.
///
/// Blue is inside, red outside, black at the surface. The vertical axis of the picture is z, for `axis` 2 it is y. Patient left
/// is on the right of the picture.
///
/// # Errors
/// The numerics'.
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
            let colour = |value: f64| if value.abs() < pixel_mm { [0; 3] } else { diverging(value, LIMIT_MM) };
            let pixels: Vec<u8> = values.iter().flat_map(|(value, _)| colour(*value)).collect();
            rgb_png(&pixels, width, height)
                .ok_or_else(|| Halt::from(Fault::new(FaultKind::Internal, "a pixel of the slice has no value")))
        })
        .await
}

/// Centres of the pixels, row by row from the top left.
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
