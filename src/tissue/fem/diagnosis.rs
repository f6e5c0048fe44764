//! From a failure of the solver to an error that names tissue, element and position.

use super::assembly::{Inversion, Law};
use super::equations::Equations;
use super::error::SolveError;
use super::failure::Failure;
use super::report::LostEllipticity;
use super::tuning::{ELEMENTS_PER_TASK, LEFT_OUT_SHARE, LEFT_OUT_STRAIN};
use crate::mesh::MixedMesh;
use nalgebra::Matrix3;
use prosopon_geometry::{Point, Vector, Warning};
use rayon::prelude::*;

/// The error for a failure on the path to parameter `goal`; `x` is the last equilibrium.
pub(super) fn name(
    equations: &Equations<'_>,
    mesh: &MixedMesh,
    failure: Failure,
    goal: f64,
    x: &[Vector],
) -> SolveError {
    // Whatever the symptom, a material that has lost ellipticity is the likely cause.
    let weak = lost_ellipticity(equations, mesh, equations.state.last_iterate().unwrap_or(x));
    if let (Some(weak), true) = (weak, failure != Failure::Cancelled) {
        let LostEllipticity { tissue, kind, element, stretch, place, .. } = weak;
        let [x, y, z] = [place.x, place.y, place.z];
        return SolveError::Unstable { path_share: goal, tissue, kind, element, stretch, x, y, z };
    }
    match failure {
        Failure::Inverted(at) => {
            let p = centre(equations, mesh, at);
            let kind = equations.problem.assembly().parts()[at.part].block.kind;
            SolveError::Inverted { path_share: goal, kind, element: at.element, x: p.x, y: p.y, z: p.z }
        }
        Failure::NotConverged { iterations, residual_n, tolerance_n } => {
            SolveError::NotConverged { path_share: goal, iterations, residual_n, tolerance_n }
        }
        Failure::Penetration { found_mm } => SolveError::Penetration {
            path_share: goal,
            found_mm,
            allowed_mm: equations.problem.limits().penetration_tolerance_mm,
        },
        Failure::PassedThrough { body, place } => SolveError::PassedThrough {
            path_share: goal,
            segment: equations.state.contact.bodies()[body].segment,
            x: place.x,
            y: place.y,
            z: place.z,
        },
        Failure::Indefinite => {
            SolveError::Factorisation { detail: format!("it is not positive definite at {goal:.4} of the path") }
        }
        Failure::Cancelled => SolveError::Cancelled(prosopon_geometry::control::Cancelled),
    }
}

/// Loss of ellipticity at `x`: number of elements, and the one with the largest stretch. Not complete when the solver is cancelled.
pub(super) fn lost_ellipticity(equations: &Equations<'_>, mesh: &MixedMesh, x: &[Vector]) -> Option<LostEllipticity> {
    let assembly = equations.problem.assembly();
    // Largest stretch of an element where its material is not elliptic.
    let weak_stretch = |part: usize, element: usize| -> Option<f64> {
        let p = &assembly.parts()[part];
        let Law::Hyperelastic(material) = &p.laws[p.block.tissue[element] as usize] else { return None };
        if material.is_polyconvex() || equations.state.control.is_cancelled() {
            return None;
        }
        let points = assembly.deformations(Inversion { part, element }, x);
        let weak = points.iter().filter(|f| f.determinant() > 0.0 && !material.is_elliptic(f));
        weak.map(|f| f.singular_values().max()).reduce(f64::max)
    };
    let mut weak: Vec<(Inversion, f64)> = Vec::new();
    for (part, p) in assembly.parts().iter().enumerate() {
        let of_part = (0..p.block.tissue.len()).into_par_iter().with_min_len(ELEMENTS_PER_TASK);
        let found = of_part.filter_map(|element| Some((Inversion { part, element }, weak_stretch(part, element)?)));
        weak.par_extend(found);
    }
    // The first of the largest, in the order of elements.
    let weakest = weak.iter().copied().reduce(|a, b| if b.1 > a.1 { b } else { a });
    weakest.map(|(at, stretch)| LostEllipticity {
        elements: weak.len(),
        tissue: equations.problem.assembly().tissue(at).name(),
        kind: equations.problem.assembly().parts()[at.part].block.kind,
        element: at.element,
        stretch,
        place: centre(equations, mesh, at),
    })
}

/// Warning about a linear solution whose displacements or rotations are too large for small strain.
pub(super) fn left_out_strain(equations: &Equations<'_>, x: &[Vector]) -> Option<Warning> {
    let (mut volume, mut beyond, mut most) = (0.0, 0.0, 0.0f64);
    for (part, p) in equations.problem.assembly().parts().iter().enumerate() {
        for (element, weights) in p.block.weights.chunks_exact(p.block.n_points).enumerate() {
            let gradients = equations.problem.assembly().deformations(Inversion { part, element }, x);
            for (f, w) in gradients.iter().zip(weights) {
                let stretch = (f - Matrix3::identity()).singular_values().max();
                let left_out = 0.5 * stretch * stretch;
                volume += w;
                most = most.max(left_out);
                if left_out > LEFT_OUT_STRAIN {
                    beyond += w;
                }
            }
        }
    }
    let share = beyond / volume;
    (share > LEFT_OUT_SHARE).then(|| {
        let message = format!(
            "the linear model leaves out strains above {LEFT_OUT_STRAIN} in {:.1} % of the tissue (up to {most:.2}): rotation or \
             stretch is too large for it",
            100.0 * share
        );
        Warning::check("neglected-strain", message).act("Use a nonlinear model.")
    })
}

fn centre(equations: &Equations<'_>, mesh: &MixedMesh, at: Inversion) -> Point {
    let block = &equations.problem.assembly().parts()[at.part].block;
    let nodes = &block.nodes[at.element * block.n_functions..(at.element + 1) * block.n_functions];
    let corners = nodes.iter().filter_map(|&n| mesh.positions.get(n as usize));
    let count = corners.clone().count().max(1);
    Point::from(corners.map(|p| p.coords).sum::<Vector>() / count as f64)
}
