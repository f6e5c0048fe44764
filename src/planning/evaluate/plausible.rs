//! Checks that two surfaces are comparable before distances between them are computed.

use super::EvaluateError;
use super::tuning::{APART_MM, DOUBTFUL_SIZE, OTHER_UNIT};
use prosopon_geometry::{TriMesh, Warning};

/// Returns warnings about a pair of surfaces: sizes that differ too much, or boxes far apart.
///
/// # Errors
/// [`EvaluateError::Input`] for a surface without area or extent and for surfaces in different units.
pub(super) fn plausible(prediction: &TriMesh, reference: &TriMesh) -> Result<Vec<Warning>, EvaluateError> {
    let input = |detail: String| Err(EvaluateError::Input { detail });
    let (a, b) = (prediction.bounds(), reference.bounds());
    for (name, mesh, bounds) in [("prediction", prediction, a), ("reference", reference, b)] {
        if mesh.area() <= 0.0 || bounds.diagonal() <= 0.0 {
            return input(format!("the {name} has no area: all its triangles have collapsed to points or lines"));
        }
    }
    let (small, large) =
        if a.diagonal() < b.diagonal() { ("prediction", "reference") } else { ("reference", "prediction") };
    let ratio = (a.diagonal() / b.diagonal()).max(b.diagonal() / a.diagonal());
    if ratio > OTHER_UNIT {
        return input(format!(
            "the {large} is {ratio:.0} times as large as the {small}: convert both to mm (is the {small} in metres?)"
        ));
    }
    let mut warnings = Vec::new();
    if ratio > DOUBTFUL_SIZE {
        let message = format!("the {large} is {ratio:.1} times as large as the {small}");
        warnings.push(Warning::check("size-mismatch", message).act("Check that both are in mm."));
    }
    let gap = (0..3).map(|i| (a.min[i] - b.max[i]).max(b.min[i] - a.max[i]).max(0.0).powi(2)).sum::<f64>().sqrt();
    if gap > APART_MM {
        let message = format!("the surfaces lie {gap:.0} mm apart");
        warnings.push(Warning::check("surfaces-apart", message).act("Check that both are in one frame (LPS, mm)."));
    }
    Ok(warnings)
}
