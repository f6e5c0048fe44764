//! Named failures, cancellation, and determinism.

use super::blocks::{Slab, attach};
use super::bodies::Ball;
use crate::fem::material::Material;
use crate::fem::{
    Boundary, ContactBody, Locking, Model, Prepared, Preset, SolveError, SolveSettings, Solver, StepOutcome,
    StepReport, UnstableMaterial,
};
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Severity};

fn slab() -> MixedMesh {
    let mut mesh = Slab { cells: [4, 4, 2], origin: [-8.0, -8.0, 0.0], size: [16.0, 16.0, 6.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let tied = if p.x.abs().max(p.y.abs()) < 5.0 { Attachment::Tied(1) } else { Attachment::Fixed };
        (p.z == 0.0).then_some(tied)
    });
    mesh
}

fn settings() -> SolveSettings {
    SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials())
}

fn push(d: f64) -> impl Fn(f64) -> Vec<(u32, Motion)> {
    move |t| vec![(1, Motion::translation(0.0, 0.0, d * t))]
}

#[test]
fn unusable_problems_are_refused() {
    let control = Control::new();
    let refused =
        |mesh: &MixedMesh, settings: SolveSettings, part: &str| match Solver::new(mesh, vec![], settings, &control) {
            Err(SolveError::Problem { detail }) => assert!(detail.contains(part), "{detail}"),
            other => panic!("{other:?}"),
        };
    let mut free = slab();
    free.attachment.fill(Attachment::Free);
    refused(&free, settings(), "0 of its nodes are tied");
    // Held on one edge only.
    attach(&mut free, |p| (p.z == 0.0 && p.x == -8.0).then_some(Attachment::Fixed));
    refused(&free, settings(), "not on one line");
    let mut short = slab();
    short.attachment.pop();
    refused(&short, settings(), "attachments for");
    let mut wild = slab();
    wild.tetrahedra[3][1] = 9999;
    refused(&wild, settings(), "node 9999");
    refused(&slab(), SolveSettings { min_substep: 0.0, ..settings() }, "min_substep is 0");
    refused(&slab(), SolveSettings { relative_residual: f64::NAN, ..settings() }, "relative_residual is NaN");
    let (mesh, ball) = (slab(), Ball { centre: Point::origin(), radius: 1.0 });
    let twice = vec![ContactBody { segment: 1, solid: &ball }; 2];
    assert!(matches!(Solver::new(&mesh, twice, settings(), &control), Err(SolveError::Problem { .. })));
}

#[test]
fn an_impossible_step_is_named_and_leaves_the_state_where_it_was() {
    let (mesh, control) = (slab(), Control::new());
    let mut solver = Solver::new(&mesh, vec![], SolveSettings { min_substep: 1.0, ..settings() }, &control).unwrap();
    let before = solver.positions();
    match solver.advance(1.0, &push(40.0), &control) {
        Err(SolveError::Inverted { path_share, .. }) => assert_eq!(path_share, 1.0),
        other => panic!("{other:?}"),
    }
    assert_eq!(before, solver.positions());
    let few = SolveSettings { max_iterations: 1, min_substep: 1.0, relative_residual: 1e-10, ..settings() };
    let mut solver = Solver::new(&mesh, vec![], few, &control).unwrap();
    match solver.advance(1.0, &push(2.0), &control) {
        Err(SolveError::NotConverged { iterations, residual_n, tolerance_n, .. }) => {
            assert!(iterations == 1 && residual_n > tolerance_n);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_large_motion_is_reached_in_substeps() {
    let (mesh, control) = (slab(), Control::new());
    let mut solver = Solver::new(&mesh, vec![], settings(), &control).unwrap();
    let report = solver.advance(1.0, &push(30.0), &control).unwrap();
    assert!(report.substeps > 1 && report.min_det_f > 0.0, "{report:?}");
    assert!(report.warnings.iter().any(|w| w.code == "shortened-substeps"), "{report:?}");
}

#[test]
fn the_published_constants_fail_with_the_tissue_that_lost_ellipticity() {
    let (mesh, control) = (slab(), Control::new());
    let published = SolveSettings::new(Model::Mixed, Preset::Wang2009.materials());
    let mut solver = Solver::new(&mesh, vec![], published, &control).unwrap();
    match solver.advance(1.0, &push(5.0), &control) {
        Err(SolveError::Unstable { stretch, .. }) => assert!(stretch > 1.0),
        other => panic!("{other:?}"),
    }
    assert!(solver.path_parameter() < 1.0);
}

#[test]
fn an_equilibrium_outside_ellipticity_is_no_convergence() {
    let (mesh, control) = (slab(), Control::new());
    let published = SolveSettings::new(Model::Mixed, Preset::Wang2009.materials());
    let mut solver = Solver::new(&mesh, vec![], published, &control).unwrap();
    let near = solver.advance(0.002, &push(5.0), &control).unwrap();
    assert_eq!(near.outcome, StepOutcome::Converged);
    // Fat loses ellipticity at a stretch of 1.019; 0.2 mm of a layer of 6 mm, sheared beside the patch, is beyond that.
    let beyond = solver.advance(0.04, &push(5.0), &control).unwrap();
    match beyond.outcome {
        StepOutcome::OutsideEllipticity(lost) => {
            assert!(lost.elements > 0 && lost.tissue == "fat" && (1.01..1.2).contains(&lost.stretch), "{lost}");
        }
        other @ (StepOutcome::Converged | StepOutcome::Stabilised | StepOutcome::InsideOut { .. }) => {
            panic!("{other:?}")
        }
    }
    assert!(
        !beyond.outcome.converged()
            && beyond.warnings.iter().any(|w| w.code == "lost-ellipticity" && w.severity == Severity::Unreliable)
    );
}

/// A layer of 6 mm between two plates is compressed by 9 mm: small strain has a solution, which is meaningless.
#[test]
fn a_small_strain_answer_inside_out_is_no_convergence() {
    let (mut mesh, control) = (slab(), Control::new());
    attach(&mut mesh, |p| match p.z {
        0.0 => Some(Attachment::Tied(1)),
        6.0 => Some(Attachment::Fixed),
        _ => None,
    });
    for model in [Model::Linear, Model::MassTensor] {
        let settings = SolveSettings::new(model, Preset::Wang2009Stable.materials());
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        assert_eq!(solver.advance(0.05, &push(9.0), &control).unwrap().outcome, StepOutcome::Converged);
        let beyond = solver.advance(1.0, &push(9.0), &control).unwrap();
        assert!(beyond.min_det_f < 0.0 && !beyond.outcome.converged(), "{beyond:?}");
        assert!(matches!(beyond.outcome, StepOutcome::InsideOut { elements: 1.., .. }), "{beyond:?}");
        assert!(
            beyond.warnings.iter().any(|w| w.code == "inside-out-elements" && w.severity == Severity::Unreliable),
            "{:?}",
            beyond.warnings
        );
    }
}

/// A hyperelastic result does not depend on the path: stable materials give the same result as from the start, to the
/// displacement tolerance (2.5e-4 of an edge).
#[test]
fn stable_materials_take_over_only_on_request() {
    let (mesh, control) = (slab(), Control::new());
    let published = SolveSettings::new(Model::Mixed, Preset::Wang2009.materials());
    let stabilising = SolveSettings { unstable_material: UnstableMaterial::Stabilise, ..published };
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        let mut solver =
            Solver::new(&mesh, vec![], SolveSettings { locking, ..stabilising.clone() }, &control).unwrap();
        let report = solver.advance(1.0, &push(4.0), &control).unwrap();
        assert_eq!(report.outcome, StepOutcome::Stabilised);
        assert!(
            report.warnings.iter().any(|w| w.code == "materials-replaced" && w.message.contains("fat")),
            "{:?}",
            report.warnings
        );
        let mut stable = Solver::new(&mesh, vec![], SolveSettings { locking, ..settings() }, &control).unwrap();
        let plain = stable.advance(1.0, &push(4.0), &control).unwrap();
        assert_eq!(plain.outcome, StepOutcome::Converged);
        for (a, b) in solver.positions().iter().zip(stable.positions()) {
            assert!((a - b).norm() < 1e-3, "{a} {b}");
        }
    }
}

#[test]
fn too_large_rotations_of_a_linear_model_and_locking_elements_are_reported() {
    let (mesh, control) = (slab(), Control::new());
    let linear = SolveSettings::new(Model::Linear, Preset::Wang2009Stable.materials());
    let reports_strain = |d: f64| {
        let mut solver = Solver::new(&mesh, vec![], linear.clone(), &control).unwrap();
        solver.advance(1.0, &push(d), &control).unwrap().warnings.iter().any(|w| w.code == "neglected-strain")
    };
    assert!(!reports_strain(0.2) && reports_strain(4.0));
    let mut materials = Preset::Wang2009Stable.materials();
    let mut locks = |poisson: f64, locking: Locking| {
        materials.fat = Material::neo_hookean(0.012, poisson);
        let settings = SolveSettings { locking, ..SolveSettings::new(Model::Mixed, materials) };
        let mut solver = Solver::new(&mesh, vec![], settings, &control).unwrap();
        let report = solver.advance(0.1, &push(1.0), &control).unwrap();
        let found = report.warnings.into_iter().find(|w| w.message.contains("fat is above"));
        found.map(|w| (w.code, w.severity))
    };
    assert_eq!(locks(0.499, Locking::None), Some(("stiff-elements", Severity::Check)));
    assert_eq!(locks(0.499, Locking::Smoothed), None);
    assert_eq!(locks(0.4999, Locking::Smoothed), Some(("stiff-smoothed-elements", Severity::Check)));
    assert_eq!(locks(0.4999, Locking::Patched), None);
}

/// Fails before allocation and gives the estimated size.
#[test]
fn equations_that_do_not_fit_into_memory_are_refused() {
    let mesh = slab();
    let needed = |memory_mb: f64| {
        let control = Control::new().with_memory_mb(memory_mb);
        Prepared::new(&mesh, &[], &Boundary::default(), settings(), &control).map(|p| p.estimated_mb(true))
    };
    let all = needed(f64::INFINITY).unwrap();
    assert!(all > 32.0 && needed(1.01 * all).is_ok());
    match needed(0.99 * all) {
        Err(SolveError::Memory { needed_mb, allowed_mb, .. }) => {
            assert!((needed_mb - all).abs() < 1e-6 && allowed_mb == 0.99 * all);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn cancelling_stops_before_the_next_iteration() {
    let (mesh, control) = (slab(), Control::new());
    let mut solver = Solver::new(&mesh, vec![], settings(), &control).unwrap();
    let stop = |t: f64| {
        control.cancel();
        push(2.0)(t)
    };
    let result = solver.advance(1.0, &stop, &control);
    assert!(matches!(result, Err(SolveError::Cancelled(_))), "{result:?}");
    assert!(solver.iterations().is_empty());
    assert_eq!(solver.path_parameter(), 0.0);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    // Large enough for faer to run in parallel.
    let mut mesh = Slab { cells: [16, 16, 4], origin: [-24.0, -24.0, 0.0], size: [48.0, 48.0, 10.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let r = p.x.abs().max(p.y.abs());
        if r > 23.9 { Some(Attachment::Fixed) } else { (p.z == 0.0).then_some(Attachment::Sliding) }
    });
    let ball = Ball { centre: Point::new(1.0, 2.0, -20.0), radius: 20.0 };
    let run = |threads: usize, locking: Locking| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let control = Control::new();
            let body = ContactBody { segment: 1, solid: &ball };
            let mut solver = Solver::new(&mesh, vec![body], SolveSettings { locking, ..settings() }, &control).unwrap();
            let report = solver.advance(1.0, &push(1.5), &control).unwrap();
            let bits: Vec<u64> = solver.positions().iter().flat_map(|p| [p.x, p.y, p.z].map(f64::to_bits)).collect();
            (bits, report)
        })
    };
    for locking in [Locking::None, Locking::Smoothed, Locking::Patched] {
        let one = run(1, locking);
        assert!(one.1.unknowns > 3000 && one.1.active_contacts > 0);
        assert_eq!(one, run(2, locking));
        assert_eq!(one, run(3, locking));
    }
}

#[test]
fn changes_of_the_skin_at_rest_are_reported_with_the_first_step() {
    let mut mesh = slab();
    mesh.positions.iter_mut().for_each(|p| p.z -= 4.0 * p.x.abs());
    let control = Control::new();
    let mut solver = Solver::new(&mesh, vec![], settings(), &control).unwrap();
    let reports_crease = |report: &StepReport| report.warnings.iter().any(|w| w.code == "creased-skin");
    assert!(reports_crease(&solver.advance(0.5, &|_| Vec::new(), &control).unwrap()));
    assert!(!reports_crease(&solver.advance(1.0, &|_| Vec::new(), &control).unwrap()));
}
