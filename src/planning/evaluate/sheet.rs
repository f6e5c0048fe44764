//! One sheet with an error map from all sides, its legend and its numbers.

use super::colour::diverging;
use super::font;
use super::picture::{BLACK, encode, label};
use super::raster::{Camera, Canvas, draw};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector};

/// Columns and rows of panels, and a panel's pixels.
const GRID: [usize; 2] = [3, 2];
const PANEL_PX: [usize; 2] = [460, 540];
/// Height of the title, and of each panel's name below it.
const TITLE_PX: usize = 44;
const NAME_PX: usize = 30;
/// Letters of the title, of names and numbers.
const LARGE: usize = 3;
const SMALL: usize = 2;
/// From one line of numbers to the next.
const LINE_PX: usize = 24;
const GREY: [u8; 3] = [120; 3];

/// Name, direction of view, and what stands at the left and right of the panel.
const VIEWS: [(&str, [f64; 3], &str, &str); 5] = [
    ("three-quarter, patient's right", [0.64, 0.77, 0.0], "R", "L"),
    ("front", [0.0, 1.0, 0.0], "R", "L"),
    ("three-quarter, patient's left", [-0.64, 0.77, 0.0], "R", "L"),
    ("patient's right", [1.0, 0.0, 0.0], "P", "A"),
    ("patient's left", [-1.0, 0.0, 0.0], "A", "P"),
];

/// What a sheet shows.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a> {
    /// Its headline.
    pub title: &'a str,
    /// The surface, LPS mm.
    pub mesh: &'a TriMesh,
    /// Signed values per vertex, mm; NaN is drawn grey.
    pub values: &'a [f32],
    /// Range of the colours, mm.
    pub limit_mm: f64,
    /// Lower edges (mm) and shares of the bars; the first holds all below the second's edge, the last all above its own.
    pub histogram: &'a [(f64, f64)],
    /// Numbers: name and value.
    pub lines: &'a [(String, String)],
}

/// Draws front, three-quarter and side views at one scale, the colour scale, the histogram and the numbers. PNG, 1380 × 1184 pixels.
///
/// Upright (z up); in the front view the patient's left is on the right. Lit, with normals interpolated between vertices, drawn
/// twice as large and averaged.
#[must_use]
pub fn sheet(sheet: &Sheet<'_>) -> Vec<u8> {
    let cell = [PANEL_PX[0], PANEL_PX[1] + NAME_PX];
    let mut canvas = Canvas::white(GRID[0] * cell[0], TITLE_PX + GRID[1] * cell[1]);
    font::write(&mut canvas, sheet.title, 14, 12, LARGE, BLACK);
    let cameras: Vec<Camera> = VIEWS.iter().map(|view| camera(sheet.mesh, Vector::from(view.1))).collect();
    // All panels at the scale of the one that needs most room.
    let pixels_per_mm = cameras.iter().map(|c| c.pixels_per_mm).fold(f64::INFINITY, f64::min);
    for (i, (view, camera)) in VIEWS.iter().zip(cameras).enumerate() {
        let (left, top) = (i % GRID[0] * cell[0], TITLE_PX + i / GRID[0] * cell[1]);
        let mut large = Canvas::white(2 * PANEL_PX[0], 2 * PANEL_PX[1]);
        draw(&mut large, &Camera { pixels_per_mm, ..camera }, sheet.mesh, Some((sheet.values, sheet.limit_mm)), true);
        canvas.paste(&large.halved(), left, top);
        let middle = top + PANEL_PX[1] / 2;
        font::write(&mut canvas, view.2, left + 6, middle, SMALL, GREY);
        font::write(&mut canvas, view.3, left + PANEL_PX[0] - 16, middle, SMALL, GREY);
        let indent = PANEL_PX[0].saturating_sub(font::width(view.0, SMALL)) / 2;
        font::write(&mut canvas, view.0, left + indent, top + PANEL_PX[1] + 6, SMALL, BLACK);
    }
    numbers(&mut canvas, sheet, (GRID[0] - 1) * cell[0] + 16, TITLE_PX + cell[1] + 10);
    encode(&canvas)
}

/// For a large panel; the surface fills nine tenths of it.
fn camera(mesh: &TriMesh, direction: Vector) -> Camera {
    let into = direction.normalize();
    let right = into.cross(&Vector::z()).normalize();
    let up = right.cross(&into);
    let seen: Vec<Point> = mesh
        .triangles()
        .iter()
        .flatten()
        .map(|v| mesh.positions()[*v as usize].coords)
        .map(|p| Point::new(right.dot(&p), up.dot(&p), into.dot(&p)))
        .collect();
    let bounds = Aabb::of(&seen).unwrap_or(Aabb { min: Point::origin(), max: Point::origin() });
    let (middle, extent) = (bounds.center(), bounds.max - bounds.min);
    let centre = Point::from(right * middle.x + up * middle.y + into * middle.z);
    let fit = |pixels: usize, mm: f64| 0.9 * 2.0 * pixels as f64 / mm.max(1e-6);
    let pixels_per_mm = fit(PANEL_PX[0], extent.x).min(fit(PANEL_PX[1], extent.y));
    Camera { centre, right, up, into, pixels_per_mm }
}

fn numbers(canvas: &mut Canvas, sheet: &Sheet<'_>, left: usize, top: usize) {
    let wide = PANEL_PX[0] - 40;
    let bottom = histogram(canvas, sheet, left, top, wide);
    let bottom = scale(canvas, sheet.limit_mm, left, bottom + 2, wide);
    for (i, (name, value)) in sheet.lines.iter().enumerate() {
        let y = bottom + 16 + i * LINE_PX;
        font::write(canvas, name, left, y, SMALL, BLACK);
        let right = (left + wide).saturating_sub(font::width(value, SMALL));
        font::write(canvas, value, right, y, SMALL, BLACK);
    }
}

/// Bars in the colours of their values, the tallest 110 pixels high. Returns where they stand.
fn histogram(canvas: &mut Canvas, sheet: &Sheet<'_>, left: usize, top: usize, wide: usize) -> usize {
    const TALL_PX: usize = 110;
    let foot = top + TALL_PX;
    let most = sheet.histogram.iter().map(|b| b.1).fold(0.0, f64::max);
    // The open bars at both ends are drawn at the ends of the scale.
    let inner = sheet.histogram.len().saturating_sub(2);
    if inner == 0 || most <= 0.0 {
        return foot;
    }
    let bar = wide as f64 / inner as f64;
    for (i, (from, share)) in sheet.histogram.iter().enumerate() {
        let place = (i.max(1) - 1).min(inner - 1);
        let tall = (share / most * TALL_PX as f64).round() as usize;
        let (x0, x1) = ((bar * place as f64) as usize, (bar * (place + 1) as f64) as usize);
        let open = i == 0 || i == inner + 1;
        let colour = diverging(from + 0.125, sheet.limit_mm);
        // Open ends are narrow bars at the very edge.
        let (x0, x1) = match (open, i) {
            (false, _) => (x0 + 1, x1),
            (true, 0) => (0, 3),
            (true, _) => (wide - 3, wide),
        };
        for x in x0..x1 {
            for y in foot - tall..foot {
                let edge = y == foot - tall || x == x0 || x + 1 == x1;
                canvas.set(left + x, y, if edge { GREY } else { colour });
            }
        }
    }
    foot
}

/// The colours from -limit to limit, with seven numbers below. Returns where it ends.
fn scale(canvas: &mut Canvas, limit: f64, left: usize, top: usize, wide: usize) -> usize {
    const TALL_PX: usize = 18;
    for x in 0..wide {
        let value = limit * (2.0 * x as f64 / (wide - 1) as f64 - 1.0);
        for y in 0..TALL_PX {
            let edge = x == 0 || x + 1 == wide || y == 0 || y + 1 == TALL_PX;
            canvas.set(left + x, top + y, if edge { BLACK } else { diverging(value, limit) });
        }
    }
    let names = top + TALL_PX + 8;
    for i in 0..=6usize {
        let share = i as f64 / 3.0 - 1.0;
        let x = ((wide - 1) as f64 * 0.5 * (1.0 + share)).round() as usize;
        (0..6).for_each(|y| canvas.set(left + x, top + TALL_PX + y, BLACK));
        let text = label(share * limit);
        let start = (left + x).saturating_sub(font::width(&text, SMALL) / 2);
        font::write(canvas, &text, start, names, SMALL, BLACK);
    }
    let below = names + font::HEIGHT * SMALL + 6;
    font::write(canvas, "mm; blue: behind the reference", left, below, SMALL, GREY);
    below + font::HEIGHT * SMALL
}
