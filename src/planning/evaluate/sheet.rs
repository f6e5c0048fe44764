//! One sheet that shows an error map from all sides with its legend and statistics.

use super::colour::diverging;
use super::font::Font;
use super::picture::{BLACK, encode, label};
use super::raster::{Canvas, Coloured, Shading, draw};
use super::tuning::BIN_MM;
use super::views::{ORIENTED_VIEWS, cameras};
use prosopon_geometry::TriMesh;

/// Columns and rows of panels, and a panel's size in pixels.
const GRID: [usize; 2] = [3, 2];
const PANEL_PX: [usize; 2] = [460, 540];
/// Heights of the title and of the name below each panel, pixels.
const TITLE_PX: usize = 44;
const NAME_PX: usize = 30;
/// Font of titles, names and numbers.
const FONT: Font = Font::Large;
/// Distance between two lines of numbers, pixels.
const LINE_PX: usize = 24;
const GREY: [u8; 3] = [120; 3];

/// Panels of the sheet, as indices of [`ORIENTED_VIEWS`]: the faces above, the profiles below.
const PANELS: [usize; 5] = [1, 2, 3, 0, 4];

/// Contents of a sheet.
#[derive(Debug, Clone, Copy)]
pub struct Sheet<'a> {
    /// Title of the sheet.
    pub title: &'a str,
    /// The surface, LPS mm.
    pub mesh: &'a TriMesh,
    /// Signed values per vertex, mm; NaN is drawn grey.
    pub values: &'a [f32],
    /// The colours cover the range from `-limit_mm` to `limit_mm`, mm.
    pub limit_mm: f64,
    /// Histogram: lower edges (mm) and shares.
    /// The first bar holds everything below the second's edge, the last everything above its own.
    pub histogram: &'a [(f64, f64)],
    /// Lines of text: name and value.
    pub lines: &'a [(String, String)],
}

/// Draws front, three-quarter and side views with colour scale, histogram and numbers as a PNG.
///
/// The PNG has 1380 × 1184 pixels. All views have one scale and show the head upright (z up); in the front view the patient's
/// left is on the right. The surface is shaded with interpolated normals, drawn at twice the size and averaged.
#[must_use]
pub fn render_sheet(sheet: &Sheet<'_>) -> Vec<u8> {
    let cell = [PANEL_PX[0], PANEL_PX[1] + NAME_PX];
    let mut canvas = Canvas::white(GRID[0] * cell[0], TITLE_PX + GRID[1] * cell[1]);
    FONT.write(&mut canvas, sheet.title, 14, 12, BLACK);
    let views = PANELS.map(|i| ORIENTED_VIEWS[i]);
    let cameras = cameras(&[sheet.mesh], &views, PANEL_PX);
    let coloured = Coloured { values: sheet.values, limit_mm: sheet.limit_mm };
    for (i, (view, camera)) in views.iter().zip(&cameras).enumerate() {
        let (left, top) = (i % GRID[0] * cell[0], TITLE_PX + i / GRID[0] * cell[1]);
        let mut large = Canvas::white(2 * PANEL_PX[0], 2 * PANEL_PX[1]);
        draw(&mut large, camera, sheet.mesh, Some(coloured), Shading::Lit);
        canvas.paste(&large.halved(), left, top);
        let middle = top + PANEL_PX[1] / 2;
        FONT.write(&mut canvas, view.left, left + 6, middle, GREY);
        FONT.write(&mut canvas, view.right, left + PANEL_PX[0] - 16, middle, GREY);
        let indent = PANEL_PX[0].saturating_sub(FONT.width(view.name)) / 2;
        FONT.write(&mut canvas, view.name, left + indent, top + PANEL_PX[1] + 6, BLACK);
    }
    numbers(&mut canvas, sheet, (GRID[0] - 1) * cell[0] + 16, TITLE_PX + cell[1] + 10);
    encode(&canvas)
}

fn numbers(canvas: &mut Canvas, sheet: &Sheet<'_>, left: usize, top: usize) {
    let wide = PANEL_PX[0] - 40;
    let bottom = histogram(canvas, sheet, left, top, wide);
    let bottom = scale(canvas, sheet.limit_mm, left, bottom + 2, wide);
    for (i, (name, value)) in sheet.lines.iter().enumerate() {
        let y = bottom + 16 + i * LINE_PX;
        FONT.write(canvas, name, left, y, BLACK);
        let right = (left + wide).saturating_sub(FONT.width(value));
        FONT.write(canvas, value, right, y, BLACK);
    }
}

/// Draws bars in the colours of their values, the tallest 110 pixels high.
/// Returns the y of the base line.
fn histogram(canvas: &mut Canvas, sheet: &Sheet<'_>, left: usize, top: usize, wide: usize) -> usize {
    const TALL_PX: usize = 110;
    let foot = top + TALL_PX;
    let most = sheet.histogram.iter().map(|b| b.1).fold(0.0, f64::max);
    // The open bins at both ends are drawn at the ends of the scale.
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
        let colour = diverging(from + 0.5 * BIN_MM, sheet.limit_mm);
        // The open bins are drawn as narrow bars at the edges.
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

/// Draws the colour scale from -limit to limit with seven numbers below.
/// Returns the y of its lower end.
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
        let start = (left + x).saturating_sub(FONT.width(&text) / 2);
        FONT.write(canvas, &text, start, names, BLACK);
    }
    let below = names + FONT.height() + 6;
    FONT.write(canvas, "mm; blue: behind the reference", left, below, GREY);
    below + FONT.height()
}
