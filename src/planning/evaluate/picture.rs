//! Pictures of surfaces side by side.

use super::colour::diverging;
use super::font::Font;
use super::png::rgb_png;
use super::raster::{Camera, Canvas, Coloured, Shading, draw};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// The side lengths of a picture are clamped to this range, pixels.
const SIDE_PX: (u32, u32) = (64, 8192);
/// Width of the column that holds the colour bar, pixels.
const BAR_PX: usize = 92;
pub(super) const BLACK: [u8; 3] = [0; 3];

/// Viewing direction, orientation and size of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Unit vector from the eye into the scene, LPS; (0, 1, 0) views the face from the front.
    pub direction: Vector,
    /// Direction that points up in the picture, LPS.
    pub up: Vector,
    /// Width and height of the picture in pixels.
    pub size_px: [u32; 2],
}

/// A surface in a picture, optionally coloured by values.
#[derive(Debug, Clone, Copy)]
pub struct Layer<'a> {
    /// Surface to draw, LPS mm.
    pub mesh: &'a TriMesh,
    /// Values by which it is coloured; `None` draws plain skin colour.
    pub values: Option<Coloured<'a>>,
}

/// Displacements of a surface's vertices along a direction.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedAlong {
    /// Displacement of each vertex, mm; negative against the direction.
    pub values: Vec<f32>,
    /// Limit of their colours: the largest magnitude, at least 1, rounded up, mm.
    pub limit_mm: f64,
}

impl MovedAlong {
    /// The displacements as colours of a surface.
    #[must_use]
    pub fn coloured(&self) -> Coloured<'_> {
        Coloured { values: &self.values, limit_mm: self.limit_mm }
    }
}

/// Displacement of each vertex along the unit vector `direction`.
#[must_use]
pub fn moved_along(before: &TriMesh, after: &TriMesh, direction: &Vector) -> MovedAlong {
    let pairs = before.positions().iter().zip(after.positions());
    let moved: Vec<f32> = pairs.map(|(before, after)| (after - before).dot(direction) as f32).collect();
    let limit = f64::from(moved.iter().fold(1.0f32, |most, m| most.max(m.abs()))).ceil();
    MovedAlong { values: moved, limit_mm: limit }
}

/// Draws panels side by side, each showing one surface from `view`, and returns a PNG.
/// All panels have one scale and show the same window of space. A colour bar in mm is added when any panel has values.
///
/// The projection is parallel, lit from above the viewer's left shoulder, on white. Seen from the front the patient's left is
/// on the right. The colour bar belongs to the first panel with values; the others should have the same limit. A zero viewing
/// direction is replaced by (0, 1, 0), the view of the face from the front. When `up` is parallel to the direction, z or else y
/// is used. The side lengths are clamped to 64 to 8192 pixels.
#[must_use]
pub fn render_panels(panels: &[(&str, Layer<'_>)], view: &View) -> Vec<u8> {
    let [width, height] = view.size_px.map(|s| s.clamp(SIDE_PX.0, SIDE_PX.1) as usize);
    let mut canvas = Canvas::white(width, height);
    let limit = panels.iter().find_map(|(_, layer)| layer.values.map(|v| v.limit_mm));
    let scale = (height / 300).clamp(1, 4);
    let font = if scale == 1 { Font::Small } else { Font::Large };
    let title = font.height() + 6 * scale;
    let bar = if limit.is_some() { (BAR_PX * scale).min(width / 3) } else { 0 };
    let panel = [(width - bar) / panels.len().max(1), height - title.min(height / 2)];
    if let Some(camera) = camera(panels, view, panel) {
        for (i, (name, layer)) in panels.iter().enumerate() {
            // Drawn at twice the size and averaged to smooth jagged edges.
            let mut large = Canvas::white(2 * panel[0], 2 * panel[1]);
            draw(&mut large, &camera, layer.mesh, layer.values, Shading::Lit);
            canvas.paste(&large.halved(), i * panel[0], height - panel[1]);
            let wide = font.width(name);
            let left = i * panel[0] + panel[0].saturating_sub(wide) / 2;
            font.write(&mut canvas, name, left, 3 * scale, BLACK);
        }
    }
    if let Some(limit) = limit {
        colour_bar(&mut canvas, font, [width - bar, title], scale, limit);
    }
    encode(&canvas)
}

/// Camera for the double-size canvas of one panel that shows all surfaces; `None` without surfaces.
fn camera(panels: &[(&str, Layer<'_>)], view: &View, panel: [usize; 2]) -> Option<Camera> {
    let finite = |v: &Vector| v.iter().all(|c| c.is_finite());
    let into = view.direction.try_normalize(1e-9).filter(finite).unwrap_or_else(Vector::y);
    let across = |up: &Vector| into.cross(up).try_normalize(1e-6).filter(finite);
    let right = across(&view.up).or_else(|| across(&Vector::z())).or_else(|| across(&Vector::y()))?;
    let up = right.cross(&into);
    // Vertices without triangles are not visible.
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

fn colour_bar(canvas: &mut Canvas, font: Font, [left, top]: [usize; 2], scale: usize, limit: f64) {
    let (x0, x1) = (left + 10 * scale, left + 24 * scale);
    let (y0, y1) = (top + font.height() + 6 * scale, canvas.height.saturating_sub(12 * scale));
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
    font.write(canvas, "mm", x0, top, BLACK);
    for i in 0..=6 {
        let share = f64::from(i) / 3.0 - 1.0;
        let y = y0 + (span * 0.5 * (1.0 - share)).round() as usize;
        for x in x1..x1 + 3 * scale {
            canvas.set(x, y, BLACK);
        }
        font.write(canvas, &label(share * limit), x1 + 6 * scale, y.saturating_sub(font.height() / 2), BLACK);
    }
}

/// Formats a short decimal with its sign.
pub(super) fn label(value: f64) -> String {
    let digits = if value.abs() >= 100.0 || (value - value.round()).abs() < 1e-9 { 0 } else { 2 };
    let text = format!("{value:+.digits$}");
    // A value that rounds to zero has no sign and no decimals.
    if text.trim_matches(['+', '-', '0', '.']).is_empty() { "0".to_owned() } else { text }
}

pub(super) fn encode(canvas: &Canvas) -> Vec<u8> {
    // A canvas always has the stated number of pixels, at least one, so encoding cannot fail.
    rgb_png(canvas.pixels.as_flattened(), canvas.width as u32, canvas.height as u32).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::label;

    #[test]
    fn labels_are_short_and_zero_has_no_sign() {
        let labels = [0.0, -0.0, -0.004, 0.004, 3.0, -2.5, -0.5, 150.4, -3.0].map(label);
        assert_eq!(labels, ["0", "0", "0", "0", "+3", "-2.50", "-0.50", "+150", "-3"]);
    }
}
