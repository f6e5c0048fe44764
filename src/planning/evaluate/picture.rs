//! Pictures of surfaces side by side.

use super::colour::diverging;
use super::font;
use super::png::rgb_png;
use super::raster::{Camera, Canvas, draw};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// Sides of a picture are clamped to this range, pixels.
const SIDE_PX: (u32, u32) = (64, 8192);
/// Width of the colour bar's column.
const BAR_PX: usize = 92;
pub(super) const BLACK: [u8; 3] = [0; 3];

/// Where the viewer stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Direction from the eye into the scene, unit, LPS; (0, 1, 0) looks the patient in the face.
    pub direction: Vector,
    /// What is up in the picture.
    pub up: Vector,
    /// Width and height of the picture in pixels.
    pub size_px: [u32; 2],
}

/// One surface in a picture: the mesh and, if given, per-vertex values with the limit of the colour map and a title for the colour bar.
#[derive(Debug, Clone, Copy)]
pub struct Layer<'a> {
    /// The surface.
    pub mesh: &'a TriMesh,
    /// Values per vertex and the limit of the diverging map; plain skin colour when absent. NaN is drawn grey.
    pub values: Option<(&'a [f32], f64)>,
}

/// How far each vertex moved along the unit vector `direction`, mm, negative against it; and a limit for its colours, mm.
#[must_use]
pub fn moved_along(before: &TriMesh, after: &TriMesh, direction: &Vector) -> (Vec<f32>, f64) {
    let pairs = before.positions().iter().zip(after.positions());
    let moved: Vec<f32> = pairs.map(|(before, after)| (after - before).dot(direction) as f32).collect();
    let limit = f64::from(moved.iter().fold(1.0f32, |most, m| most.max(m.abs()))).ceil();
    (moved, limit)
}

/// Draws panels side by side, each one surface seen from `view`, all at the same scale, with a colour bar (labelled in mm) when any panel has values. PNG bytes.
///
/// Parallel projection lit from above the viewer's left shoulder, on white; all panels show the same window of space. Seen from the front
/// the patient's left is on the right. The colour bar belongs to the first panel with values; the others should have the
/// same limit. A view without a direction looks the patient in the face; an up that is along the direction gives way to
/// z, then to y. The size is clamped to 64 to 8192 pixels a side.
#[must_use]
pub fn picture(panels: &[(&str, Layer<'_>)], view: &View) -> Vec<u8> {
    let [width, height] = view.size_px.map(|s| s.clamp(SIDE_PX.0, SIDE_PX.1) as usize);
    let mut canvas = Canvas::white(width, height);
    let limit = panels.iter().find_map(|(_, layer)| layer.values.map(|v| v.1));
    let scale = (height / 300).clamp(1, 4);
    let title = (font::HEIGHT + 6) * scale;
    let bar = if limit.is_some() { (BAR_PX * scale).min(width / 3) } else { 0 };
    let panel = [(width - bar) / panels.len().max(1), height - title.min(height / 2)];
    if let Some(camera) = camera(panels, view, panel) {
        for (i, (name, layer)) in panels.iter().enumerate() {
            // Drawn twice as large and averaged, against jagged edges.
            let mut large = Canvas::white(2 * panel[0], 2 * panel[1]);
            draw(&mut large, &camera, layer.mesh, layer.values, true);
            canvas.paste(&large.halved(), i * panel[0], height - panel[1]);
            let wide = font::width(name, scale);
            let left = i * panel[0] + panel[0].saturating_sub(wide) / 2;
            font::write(&mut canvas, name, left, 3 * scale, scale, BLACK);
        }
    }
    if let Some(limit) = limit {
        colour_bar(&mut canvas, width - bar, title, scale, limit);
    }
    encode(&canvas)
}

/// A camera for the large canvas of one panel that shows all surfaces; `None` without surfaces.
fn camera(panels: &[(&str, Layer<'_>)], view: &View, panel: [usize; 2]) -> Option<Camera> {
    let finite = |v: &Vector| v.iter().all(|c| c.is_finite());
    let into = view.direction.try_normalize(1e-9).filter(finite).unwrap_or_else(Vector::y);
    let across = |up: &Vector| into.cross(up).try_normalize(1e-6).filter(finite);
    let right = across(&view.up).or_else(|| across(&Vector::z())).or_else(|| across(&Vector::y()))?;
    let up = right.cross(&into);
    // Only vertices of triangles: others are not seen.
    let seen = panels.iter().flat_map(|(_, l)| {
        l.mesh.triangles().iter().flatten().map(|v| {
            let p = l.mesh.positions()[*v as usize].coords;
            Point::new(right.dot(&p), up.dot(&p), into.dot(&p))
        })
    });
    let seen: Vec<Point> = seen.collect();
    let bounds = Aabb::of(&seen)?;
    let (middle, extent) = (bounds.center(), bounds.max - bounds.min);
    let centre = Point::from(right * middle.x + up * middle.y + into * middle.z);
    let fit = |pixels: usize, mm: f64| 0.94 * 2.0 * pixels as f64 / mm.max(1e-6);
    let pixels_per_mm = fit(panel[0], extent.x).min(fit(panel[1], extent.y));
    Some(Camera { centre, right, up, into, pixels_per_mm })
}

fn colour_bar(canvas: &mut Canvas, left: usize, top: usize, scale: usize, limit: f64) {
    let (x0, x1) = (left + 10 * scale, left + 24 * scale);
    let (y0, y1) = (top + 14 * scale, canvas.height.saturating_sub(12 * scale));
    if y1 <= y0 + 8 {
        return;
    }
    let span = (y1 - y0 - 1) as f64;
    for y in y0..y1 {
        let value = limit * (1.0 - 2.0 * (y - y0) as f64 / span);
        for x in x0..x1 {
            let edge = x == x0 || x + 1 == x1 || y == y0 || y + 1 == y1;
            canvas.set(x, y, if edge { BLACK } else { diverging(value, limit) });
        }
    }
    font::write(canvas, "mm", x0, top, scale, BLACK);
    for i in 0..=6 {
        let share = f64::from(i) / 3.0 - 1.0;
        let y = y0 + (span * 0.5 * (1.0 - share)).round() as usize;
        for x in x1..x1 + 3 * scale {
            canvas.set(x, y, BLACK);
        }
        font::write(canvas, &label(share * limit), x1 + 6 * scale, y.saturating_sub(3 * scale), scale, BLACK);
    }
}

/// Short decimal with a sign.
pub(super) fn label(value: f64) -> String {
    let digits = if value.abs() >= 100.0 || (value - value.round()).abs() < 1e-9 { 0 } else { 2 };
    let sign = if value > 0.0 { "+" } else { "" };
    format!("{sign}{value:.digits$}").replace("-0", if value == 0.0 { "0" } else { "-0" })
}

pub(super) fn encode(canvas: &Canvas) -> Vec<u8> {
    // A canvas has as many pixels as it says, and at least one.
    rgb_png(canvas.pixels.as_flattened(), canvas.width as u32, canvas.height as u32).unwrap_or_default()
}
