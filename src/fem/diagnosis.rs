//! Names for failures.

use super::assembly::{Inversion, Law};
use super::error::SolveError;
use super::newton::{Equations, Failure};
use super::report::LostEllipticity;
use crate::geometry::{Point, Vector};
use crate::mesh::MixedMesh;

/// The error for a failure on the way to path parameter `goal`; `x` is the last equilibrium.
pub(super) fn name(
    equations: &Equations<'_>,
    mesh: &MixedMesh,
    failure: Failure,
    goal: f64,
    x: &[Vector],
) -> SolveError {
    // Whatever the symptom, a material that is no longer elliptic is the likely cause.
    let weak = lost_ellipticity(equations, mesh, equations.last_iterate().unwrap_or(x));
    if let (Some(weak), true) = (weak, failure != Failure::Cancelled) {
        let LostEllipticity { tissue, kind, element, stretch, place, .. } = weak;
        let [x, y, z] = [place.x, place.y, place.z];
        return SolveError::Unstable { path_share: goal, tissue, kind, element, stretch, x, y, z };
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

/// Where materials have lost ellipticity at `x`: how many elements, and the one with the largest stretch.
pub(super) fn lost_ellipticity(equations: &Equations<'_>, mesh: &MixedMesh, x: &[Vector]) -> Option<LostEllipticity> {
    let mut elements = 0;
    let mut weakest: Option<(Inversion, f64)> = None;
    for (part, p) in equations.assembly.parts().iter().enumerate() {
        for (element, tissue) in p.block.tissue.iter().enumerate() {
            let Law::Hyperelastic(material) = &p.laws[*tissue as usize] else { continue };
            if material.is_polyconvex() {
                continue;
            }
            let at = Inversion { part, element };
            let mut weak = false;
            for f in equations.assembly.deformations(at, x) {
                if f.determinant() > 0.0 && !material.is_elliptic(&f) {
                    weak = true;
                    let stretch = f.singular_values().max();
                    if weakest.is_none_or(|w| stretch > w.1) {
                        weakest = Some((at, stretch));
                    }
                }
            }
            elements += usize::from(weak);
        }
    }
    weakest.map(|(at, stretch)| LostEllipticity {
        elements,
        tissue: equations.assembly.tissue(at).name(),
        kind: equations.assembly.parts()[at.part].block.kind,
        element: at.element,
        stretch,
        place: centre(equations, mesh, at),
    })
}

fn centre(equations: &Equations<'_>, mesh: &MixedMesh, at: Inversion) -> Point {
    let block = &equations.assembly.parts()[at.part].block;
    let nodes = &block.nodes[at.element * block.n_functions..(at.element + 1) * block.n_functions];
    let corners = nodes.iter().filter_map(|&n| mesh.positions.get(n as usize));
    let count = corners.clone().count().max(1);
    Point::from(corners.map(|p| p.coords).sum::<Vector>() / count as f64)
}
