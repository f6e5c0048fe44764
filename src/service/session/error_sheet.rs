use super::ErrorDocument;
use prosopon_geometry::TriMesh;
use prosopon_planning::evaluate::{Sheet, sheet};

/// Colours of error maps saturate here, mm.
const ERROR_LIMIT_MM: f64 = 3.0;

/// The error map of `mesh` from all sides, with its numbers. PNG; computes.
#[must_use]
pub fn error_sheet(mesh: &TriMesh, error_mm: &[f32], document: &ErrorDocument) -> Vec<u8> {
    let histogram: Vec<(f64, f64)> = document.histogram.iter().map(|b| (b.from_mm, b.share)).collect();
    sheet(&Sheet {
        title: &document.title(),
        mesh,
        values: error_mm,
        limit_mm: ERROR_LIMIT_MM,
        histogram: &histogram,
        lines: &document.lines(),
    })
}
