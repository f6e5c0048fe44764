//! A path continued by another solver has the bits of a path solved without interruption.

use super::blocks::{Slab, attach};
use super::bodies::RoundedPost;
use crate::fem::{
    Checkpoint, ContactBody, FactorOrigin, Model, PhaseTimes, Preset, SkinElement, SolveError, SolveSettings, Solver,
    StepReport, UnstableMaterial,
};
use crate::mesh::Attachment;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Vector};

const STEPS: usize = 6;

/// Bone moves upwards and sideways under the tissue.
fn path(t: f64) -> Vec<(u32, Motion)> {
    vec![(1, Motion::new(Vector::new(2.5 * t * t, 1.0 * t, 5.0 * t), Vector::new(0.0, 0.2 * t, 0.1 * t)))]
}

/// Solves step `k` as a job does.
fn solve(solver: &mut Solver<'_>, k: usize) -> StepReport {
    let (t, control) = (k as f64 / STEPS as f64, Control::new());
    let solved =
        if k < STEPS { solver.advance_for_display(t, &path, &control) } else { solver.advance(t, &path, &control) }
            .unwrap();
    StepReport { phases: PhaseTimes::default(), ..solved }
}

#[test]
fn steps_after_a_checkpoint_have_the_bits_of_a_path_at_a_stretch() {
    let mut mesh = Slab { cells: [10, 10, 3], origin: [-20.0, -20.0, 0.0], size: [40.0, 40.0, 10.0], skin: 1.5 }.mesh();
    attach(&mut mesh, |p| {
        let rim = p.x.abs() > 19.9 || p.y.abs() > 19.9;
        if rim { Some(Attachment::Fixed) } else { (p.z == 0.0).then_some(Attachment::Sliding) }
    });
    let post = RoundedPost { half_width: 9.0, edge_radius: 2.0 };
    let (mut origins, mut stabilised) = ([0; 4], 0);
    let (stable, published) = (Preset::Wang2009Stable, Preset::Wang2009);
    let slides = mesh.clone();
    // Half of the nodes glide, and come off where bone pulls.
    attach(&mut mesh, |p| {
        (p.z == 0.0 && p.x.abs() < 19.9 && p.y.abs() < 19.9 && p.x > 0.0).then_some(Attachment::Gliding(1))
    });
    let glides = mesh;
    for (model, skin_element, preset, mesh) in [
        (Model::Mixed, SkinElement::Wedge, stable, &slides),
        (Model::Mixed, SkinElement::C1Prism, stable, &slides),
        (Model::Nonlinear, SkinElement::Tetrahedron, stable, &slides),
        (Model::Linear, SkinElement::Wedge, stable, &slides),
        (Model::MassTensor, SkinElement::Wedge, stable, &slides),
        (Model::Mixed, SkinElement::Wedge, published, &slides),
        (Model::Mixed, SkinElement::C1Prism, stable, &glides),
        (Model::Linear, SkinElement::Wedge, stable, &glides),
    ] {
        let settings = SolveSettings::new(model, preset.materials());
        let unstable_material = UnstableMaterial::Stabilise;
        let pull_off_mpa = Some(2e-3);
        let settings = SolveSettings { skin_element, unstable_material, pull_off_mpa, ..settings };
        let bodies = || vec![ContactBody { segment: 1, solid: &post }];
        // As in a step whose last system requested a factor.
        let ask_for_a_factor = |solver: &mut Solver<'_>, k| {
            if k == 2 && model == Model::Nonlinear {
                solver.equations.work.solver_mut().refresh();
            }
        };
        let solver = || Solver::new(mesh, bodies(), settings.clone(), &Control::new()).unwrap();
        let mut whole = solver();
        let (mut reports, mut checkpoints) = (Vec::new(), Vec::new());
        for k in 1..=STEPS {
            reports.push(solve(&mut whole, k));
            ask_for_a_factor(&mut whole, k);
            checkpoints.push(whole.checkpoint().expect("elements alone are stable"));
        }
        let least = if std::ptr::eq(mesh, &glides) { 0 } else { 10 };
        assert!(reports.iter().any(|r| r.active_contacts > least), "{reports:?}");
        for k in 1..STEPS {
            let from = &checkpoints[k - 1];
            origins[match from.factor {
                FactorOrigin::Rest => 0,
                FactorOrigin::State { .. } => 1,
                FactorOrigin::Vertices(_) => 2,
                FactorOrigin::Nothing => 3,
            }] += 1;
            stabilised += usize::from(from.stabilised);
            let mut after = solver();
            after.restore(from).unwrap();
            assert_eq!(after.checkpoint().as_ref(), Some(from));
            for k in k + 1..=STEPS {
                assert_eq!(solve(&mut after, k), reports[k - 1], "{model:?} {skin_element:?}");
                ask_for_a_factor(&mut after, k);
                assert!(after.checkpoint().unwrap() == checkpoints[k - 1], "{model:?} {skin_element:?} step {k}");
            }
        }
    }
    assert!(origins.iter().all(|n| *n > 0) && stabilised > 0, "all occur: {origins:?}, {stabilised} stabilised");
}

#[test]
fn a_checkpoint_of_another_problem_is_refused() {
    let slab = |cells| Slab { cells: [cells, cells, 2], origin: [0.0; 3], size: [20.0, 20.0, 8.0], skin: 1.5 }.mesh();
    let held = |mesh: &mut _| attach(mesh, |p| (p.z == 0.0).then_some(Attachment::Tied(1)));
    let (mut mesh, mut other) = (slab(4), slab(5));
    held(&mut mesh);
    held(&mut other);
    let settings = SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials());
    let new = |mesh| Solver::new(mesh, Vec::new(), settings.clone(), &Control::new()).unwrap();
    let mut solver = new(&mesh);
    solve(&mut solver, 1);
    let checkpoint = solver.checkpoint().unwrap();
    let refused = |mesh, checkpoint: &Checkpoint| new(mesh).restore(checkpoint);
    assert!(matches!(refused(&other, &checkpoint), Err(SolveError::Checkpoint { .. })));
    let pressed = Checkpoint { multipliers: vec![(7, 1.0)], ..checkpoint.clone() };
    assert!(matches!(refused(&mesh, &pressed), Err(SolveError::Checkpoint { .. })));
    let known = Checkpoint { known_compliance: vec![vec![u32::MAX]], ..checkpoint.clone() };
    assert!(matches!(refused(&mesh, &known), Err(SolveError::Checkpoint { .. })));
    let mut broken = checkpoint.clone();
    broken.x[0][0] = f64::NAN;
    assert!(matches!(refused(&mesh, &broken), Err(SolveError::Checkpoint { .. })));
    new(&mesh).restore(&checkpoint).unwrap();
}
