//! Names for failures.

use super::assembly::{Inversion, Law};
use super::error::SolveError;
use super::newton::{Equations, Failure};
use crate::geometry::{Point, Vector};
use crate::mesh::MixedMesh;

/// An element whose material has lost strong ellipticity.
struct Weak {
    at: Inversion,
    /// Largest principal stretch.
    stretch: f64,
}

/// The error for a failure on the way to path parameter `goal`; `x` is the last equilibrium.
pub(super) fn name(
    equations: &Equations<'_>,
    mesh: &MixedMesh,
    failure: Failure,
    goal: f64,
    x: &[Vector],
) -> SolveError {
    // Whatever the symptom, a material that is no longer elliptic is the likely cause.
    let (_, weakest) = weak_elements(equations, equations.last_iterate().unwrap_or(x));
    if let (Some(weak), true) = (weakest, failure != Failure::Cancelled) {
        let p = centre(equations, mesh, weak.at);
        return SolveError::Unstable {
            path_share: goal,
            tissue: equations.assembly.tissue(weak.at).name(),
            kind: equations.assembly.parts()[weak.at.part].block.kind,
            element: weak.at.element,
            stretch: weak.stretch,
            x: p.x,
            y: p.y,
            z: p.z,
        };
    }
    match failure {
        Failure::Inverted(at) => {
            let p = centre(equations, mesh, at);
            let kind = equations.assembly.parts()[at.part].block.kind;
            SolveError::Inverted { path_share: goal, kind, element: at.element, x: p.x, y: p.y, z: p.z }
        }
        Failure::NotConverged { iterations, residual_n, tolerance_n } => {
            SolveError::NotConverged { path_share: goal, iterations, residual_n, tolerance_n }
        }
        Failure::Penetration { found_mm } => SolveError::Penetration {
            path_share: goal,
            found_mm,
            allowed_mm: equations.limits.penetration_tolerance_mm,
        },
        Failure::Indefinite => {
            SolveError::Factorisation { detail: format!("it is not positive definite at {goal:.4} of the path") }
        }
        Failure::Cancelled => SolveError::Cancelled(crate::control::Cancelled),
    }
}

/// What to tell about materials that have lost ellipticity although equilibrium was found.
pub(super) fn ellipticity_warning(equations: &Equations<'_>, x: &[Vector]) -> Option<String> {
    let (count, weakest) = weak_elements(equations, x);
    weakest.map(|weak| {
        let tissue = equations.assembly.tissue(weak.at).name();
        let kind = equations.assembly.parts()[weak.at.part].block.kind;
        format!(
            "the material of {count} elements has lost ellipticity, the worst is {kind} {} ({tissue}) at a stretch of {:.3}",
            weak.at.element, weak.stretch
        )
    })
}

/// How many elements have lost ellipticity at a point, and the one with the largest stretch.
fn weak_elements(equations: &Equations<'_>, x: &[Vector]) -> (usize, Option<Weak>) {
    let mut count = 0;
    let mut weakest: Option<Weak> = None;
    for (part, elements) in equations.assembly.parts().iter().enumerate() {
        for (element, tissue) in elements.block.tissue.iter().enumerate() {
            let Law::Hyperelastic(material) = &elements.laws[*tissue as usize] else { continue };
            if material.is_polyconvex() {
                continue;
            }
            let at = Inversion { part, element };
            let mut weak = false;
            for f in equations.assembly.deformations(at, x) {
                if f.determinant() > 0.0 && !material.is_elliptic(&f) {
                    weak = true;
                    let stretch = f.singular_values().max();
                    if weakest.as_ref().is_none_or(|w| stretch > w.stretch) {
                        weakest = Some(Weak { at, stretch });
                    }
                }
            }
            count += usize::from(weak);
        }
    }
    (count, weakest)
}

fn centre(equations: &Equations<'_>, mesh: &MixedMesh, at: Inversion) -> Point {
    let block = &equations.assembly.parts()[at.part].block;
    let nodes = &block.nodes[at.element * block.n_functions..(at.element + 1) * block.n_functions];
    let corners = nodes.iter().filter_map(|&n| mesh.positions.get(n as usize));
    let count = corners.clone().count().max(1);
    Point::from(corners.map(|p| p.coords).sum::<Vector>() / count as f64)
}
