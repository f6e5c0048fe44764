use prosopon_contract::ErrorDocument;
use prosopon_geometry::TriMesh;
use prosopon_planning::evaluate::{Sheet, render_sheet};

/// Error at which the colours saturate, mm.
pub const ERROR_LIMIT_MM: f64 = 3.0;

/// Draws the error map of `mesh` from all sides with its statistics, as PNG. Call it on the CPU pool.
#[must_use]
pub fn error_sheet(mesh: &TriMesh, error_mm: &[f32], document: &ErrorDocument) -> Vec<u8> {
    let histogram: Vec<(f64, f64)> = document.histogram.iter().map(|b| (b.from_mm, b.share)).collect();
    render_sheet(&Sheet {
        title: &document.title(),
        mesh,
        values: error_mm,
        limit_mm: ERROR_LIMIT_MM,
        histogram: &histogram,
        lines: &document.lines(),
    })
}
