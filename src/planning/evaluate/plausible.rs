//! What two surfaces have to have in common before a distance between them means anything.

use super::EvaluateError;
use prosopon_geometry::TriMesh;

/// Boxes that differ more than this in size are in different units.
const OTHER_UNIT: f64 = 200.0;
/// Boxes that differ more than this may be.
const DOUBTFUL: f64 = 5.0;
/// Boxes farther apart than this do not show one head in one frame, mm.
const APART_MM: f64 = 50.0;

/// What is doubtful about a pair of surfaces.
///
/// # Errors
/// [`EvaluateError::Input`] for a surface without extent and for surfaces in different units.
pub(super) fn plausible(prediction: &TriMesh, reference: &TriMesh) -> Result<Vec<String>, EvaluateError> {
    let input = |detail: String| Err(EvaluateError::Input { detail });
    let (a, b) = (prediction.bounds(), reference.bounds());
    for (name, mesh, bounds) in [("prediction", prediction, a), ("reference", reference, b)] {
        if mesh.area() <= 0.0 || bounds.diagonal() <= 0.0 {
            return input(format!("the {name} has no area: all of its triangles are points or lines"));
        }
    }
    let (small, large) =
        if a.diagonal() < b.diagonal() { ("prediction", "reference") } else { ("reference", "prediction") };
    let ratio = (a.diagonal() / b.diagonal()).max(b.diagonal() / a.diagonal());
    if ratio > OTHER_UNIT {
        return input(format!(
            "the {large} is {ratio:.0} times as large as the {small}: one of them is not in mm (metres?)"
        ));
    }
    let mut warnings = Vec::new();
    if ratio > DOUBTFUL {
        warnings.push(format!("the {large} is {ratio:.1} times as large as the {small}: are both in mm?"));
    }
    let gap = (0..3).map(|i| (a.min[i] - b.max[i]).max(b.min[i] - a.max[i]).max(0.0).powi(2)).sum::<f64>().sqrt();
    if gap > APART_MM {
        warnings.push(format!("the surfaces lie {gap:.0} mm apart: do both have the same frame (LPS, mm)?"));
    }
    Ok(warnings)
}
