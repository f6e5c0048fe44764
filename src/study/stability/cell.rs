//! Result of one method on one scene, and its check.

use super::method::Method;
use super::scenes::{Check, HardScene, Setup};
use crate::slab::moved;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Severity, Vector, Warning};
use prosopon_tissue::fem::{ContactBody, SolveError, SolveSettings, Solver};
use prosopon_tissue::mesh::MixedMesh;

/// Difference from finite strain or from a finer mesh that needs a warning, mm: the mean error that the paper aims at.
const WARN_ABOVE_MM: f64 = 0.5;
/// Relative residual (residual over reactions) of the checking solves.
const TIGHT: f64 = 1e-8;

/// Verdict on a method's result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Correct, with the requested steps and materials.
    Converged,
    /// Correct, after shortened steps, other materials or a projected tangent.
    Helped,
    /// A result with a warning that it is wrong or unreliable.
    Warned,
    /// No result; the error names the reason.
    Refused,
    /// A wrong result without a warning.
    Wrong,
}

impl Verdict {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::Helped => "helped",
            Self::Warned => "warned",
            Self::Refused => "refused",
            Self::Wrong => "wrong",
        }
    }
}

/// A checked result.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    pub(super) verdict: Verdict,
    /// Short text for the map.
    pub(super) short: String,
    /// Full text: warnings or error.
    pub(super) detail: String,
    /// Largest difference from the check on the skin, mm.
    pub(super) error_mm: Option<f64>,
    /// Largest difference from finite strain or the finer mesh on the skin, mm.
    pub(super) model_error_mm: Option<f64>,
}

/// Result of a solver.
struct Answer {
    /// Displacement of every node, mm.
    moved: Vec<Vector>,
    /// Measures that the solver needed to converge.
    help: Vec<String>,
    /// Warnings about the result.
    warnings: Vec<Warning>,
    /// The outcome, when the result does not count as converged.
    fault: Option<&'static str>,
}

/// Solves `scene` by `method` and checks the result.
pub(super) fn cell(scene: &HardScene, method: Method) -> Cell {
    let answer =
        match solve(&scene.setup, method, SolveSettings::new(method.model, scene.setup.materials).relative_residual) {
            Ok(answer) => answer,
            Err(error) => return refused(scene, &error),
        };
    let numeric = difference_of_the_check(scene, method, &answer);
    let model = difference_of_the_model(scene, method, &answer);
    judged(scene, answer, numeric, model)
}

fn refused(scene: &HardScene, error: &SolveError) -> Cell {
    let mm = |share: f64| format!("at {:.2} mm", share * scene.length_mm);
    let short = match error {
        SolveError::Unstable { path_share, tissue, stretch, .. } => {
            format!("{tissue} unstable {} ({stretch:.2})", mm(*path_share))
        }
        SolveError::Inverted { path_share, .. } => format!("would invert {}", mm(*path_share)),
        SolveError::NotConverged { path_share, .. } => format!("no equilibrium {}", mm(*path_share)),
        SolveError::Penetration { path_share, .. } => format!("penetration {}", mm(*path_share)),
        SolveError::PassedThrough { path_share, .. } => format!("through bone {}", mm(*path_share)),
        SolveError::Problem { .. } | SolveError::Checkpoint { .. } => "not usable".to_owned(),
        SolveError::Element(_) => "element".to_owned(),
        SolveError::Memory { .. } => "memory".to_owned(),
        SolveError::Factorisation { .. } => "factorisation".to_owned(),
        SolveError::Cancelled(_) => "cancelled".to_owned(),
    };
    Cell { verdict: Verdict::Refused, short, detail: error.to_string(), error_mm: None, model_error_mm: None }
}

/// Difference from the check, mm; the error says why there is no check.
fn difference_of_the_check(scene: &HardScene, method: Method, answer: &Answer) -> Result<f64, String> {
    let mesh = &scene.setup.mesh;
    let unchecked = |e: SolveError| format!("the check was refused: {e}");
    match &scene.check {
        // The closed forms are for finite strain. At small strain the two linear models check each other.
        Check::Exact(exact) if !method.model.is_linear() => {
            let exact: Vec<Vector> = mesh.positions.iter().map(exact).collect();
            Ok(on_skin(mesh, &answer.moved, &exact))
        }
        Check::Exact(_) | Check::Refined(_) => {
            let mut finer = scene.setup.clone();
            finer.steps = 10;
            let found = solve(&finer, method.other_way(), TIGHT).map_err(unchecked)?;
            Ok(on_skin(mesh, &answer.moved, &found.moved))
        }
        Check::Other(change) => {
            let mut other = scene.setup.clone();
            change(&mut other);
            let found = solve(&other, method.other_way(), TIGHT).map_err(unchecked)?;
            Ok(on_skin(mesh, &answer.moved, &found.moved))
        }
    }
}

/// Difference from finite strain and stable materials on the same or a finer mesh, mm; `None` if that is the check itself.
fn difference_of_the_model(scene: &HardScene, method: Method, answer: &Answer) -> Option<Result<f64, String>> {
    let mesh = &scene.setup.mesh;
    let unchecked = |e: SolveError| format!("the reference at finite strain was refused: {e}");
    let mut stable = scene.setup.clone();
    for tissue in [prosopon_tissue::mesh::Tissue::Skin, prosopon_tissue::mesh::Tissue::Fat] {
        if let Some(material) = stable.materials.of(tissue).stabilised() {
            stable.materials.set(tissue, material);
        }
    }
    match &scene.check {
        Check::Refined(slab) => {
            let finer = Setup { mesh: slab.over_a_patch(10.0, 16.0), ..stable };
            // The tolerance of this comparison is coarse, so the solver's default residual is enough.
            let residual = SolveSettings::new(method.model, finer.materials).relative_residual;
            let found = solve(&finer, method.at_finite_strain().cured(), residual).map_err(unchecked);
            Some(found.map(|found| on_skin(mesh, &answer.moved, &at_nodes_of(mesh, &finer.mesh, &found.moved))))
        }
        Check::Exact(exact) => method.model.is_linear().then(|| {
            let exact: Vec<Vector> = mesh.positions.iter().map(exact).collect();
            Ok(on_skin(mesh, &answer.moved, &exact))
        }),
        Check::Other(change) => method.model.is_linear().then(|| {
            change(&mut stable);
            let found = solve(&stable, method.at_finite_strain(), TIGHT).map_err(unchecked)?;
            Ok(on_skin(mesh, &answer.moved, &found.moved))
        }),
    }
}

fn judged(scene: &HardScene, answer: Answer, numeric: Result<f64, String>, model: Option<Result<f64, String>>) -> Cell {
    let error_mm = numeric.as_ref().ok().copied();
    let model_error_mm = model.as_ref().and_then(|m| m.as_ref().ok()).copied();
    let warnings = answer.warnings.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    let (verdict, short, detail) = match (&numeric, &model) {
        _ if let Some(fault) = answer.fault => (Verdict::Warned, fault.replace('_', " "), warnings),
        (Err(_), _) if answer.warnings.iter().any(|warning| warning.severity == Severity::Unreliable) => {
            (Verdict::Warned, "warns of contact".to_owned(), warnings)
        }
        (Err(why), _) | (_, Some(Err(why))) => (Verdict::Wrong, "unchecked".to_owned(), why.clone()),
        (Ok(error), _) if *error > scene.within_mm || error.is_nan() => (
            Verdict::Wrong,
            format!("{error:.3} mm off"),
            format!("differs from the check by {error:.4} mm; {warnings}"),
        ),
        (Ok(_), Some(Ok(error))) if *error > WARN_ABOVE_MM && warnings.is_empty() => {
            (Verdict::Wrong, format!("{error:.2} mm, no warning"), "no warning that the model does not fit".to_owned())
        }
        (Ok(_), Some(Ok(error))) if *error > WARN_ABOVE_MM => {
            (Verdict::Warned, format!("{error:.2} mm, warned"), warnings)
        }
        (Ok(error), _) if answer.help.is_empty() => (Verdict::Converged, format!("{error:.4} mm"), warnings),
        (Ok(_), _) => (Verdict::Helped, answer.help.join(", "), warnings),
    };
    Cell { verdict, short, detail, error_mm, model_error_mm }
}

/// Largest difference between two displacement fields at the outer nodes of the prisms, mm.
fn on_skin(mesh: &MixedMesh, a: &[Vector], b: &[Vector]) -> f64 {
    let outer = mesh.prisms.iter().flat_map(|p| &p[..3]).map(|n| *n as usize);
    outer.map(|n| (a[n] - b[n]).norm()).fold(0.0, |most, d| if d.is_nan() { d } else { f64::max(most, d) })
}

/// Displacements of `finer` at the nodes of `mesh`; NaN where `finer` has no node.
fn at_nodes_of(mesh: &MixedMesh, finer: &MixedMesh, moved: &[Vector]) -> Vec<Vector> {
    let key = |p: &prosopon_geometry::Point| p.coords.map(|c| (c * 1e6).round() as i64).data.0[0];
    let places: std::collections::BTreeMap<[i64; 3], usize> =
        finer.positions.iter().enumerate().map(|(n, p)| (key(p), n)).collect();
    let find = |p: &prosopon_geometry::Point| places.get(&key(p)).map_or(Vector::repeat(f64::NAN), |n| moved[*n]);
    mesh.positions.iter().map(find).collect()
}

fn solve(setup: &Setup, method: Method, relative_residual: f64) -> Result<Answer, SolveError> {
    let settings = SolveSettings {
        skin_element: method.skin_element,
        locking: method.locking,
        relative_residual,
        contact_stiffness_factor: setup.contact_stiffness_factor,
        penetration_tolerance_mm: setup.penetration_mm,
        unstable_material: setup.unstable_material,
        ..SolveSettings::new(method.model, setup.materials)
    };
    let control = Control::new();
    let bodies = setup.bodies.iter().map(|(segment, solid)| ContactBody { segment: *segment, solid: solid.as_ref() });
    let mut solver = Solver::with_boundary(&setup.mesh, bodies.collect(), &setup.boundary, settings, &control)?;
    let mut answer = Answer { moved: Vec::new(), help: Vec::new(), warnings: Vec::new(), fault: None };
    let mut projected = false;
    for k in 1..=setup.steps {
        let report = solver.advance(k as f64 / setup.steps as f64, &|t| (setup.path)(t), &control)?;
        projected |= solver.iterations().iter().any(|i| i.projected);
        answer.fault = (!report.outcome.converged()).then(|| report.outcome.name());
        for warning in report.warnings {
            let help = match warning.code {
                "shortened-substeps" => Some(halvings(&warning.message)),
                "materials-replaced" => Some("stable materials".to_owned()),
                _ => None,
            };
            match help {
                Some(help) if !answer.help.contains(&help) => answer.help.push(help),
                None if !answer.warnings.contains(&warning) => answer.warnings.push(warning),
                Some(_) | None => {}
            }
        }
    }
    if projected {
        answer.help.push("projected".to_owned());
    }
    answer.moved = moved(&setup.mesh, &solver.positions());
    Ok(answer)
}

/// Number of halvings that a warning about shortened substeps gives.
fn halvings(message: &str) -> String {
    match message.strip_prefix("substeps were shortened ").and_then(|rest| rest.split(' ').next()) {
        Some("1") => "1 halving".to_owned(),
        Some(times) => format!("{times} halvings"),
        None => "shorter steps".to_owned(),
    }
}
