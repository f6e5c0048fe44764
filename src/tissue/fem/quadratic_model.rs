//! The quadratic model of the energy with unilateral contact: the Newton step and the linear prediction of a load step.

use super::condensed::{CondensedContact, StepPath, solve_condensed, track_contact};
use super::contact::{ContactPair, Curved};
use super::dot::dot;
use super::equations::Equations;
use super::failure::Failure;
use super::report::IterationRecord;
use super::springs::TangentKind;
use super::tuning::{
    DOUBTFUL_MM, FORCING_OF_PREDICTION, INVERSION_MARGIN, MAX_ACTIVE_SETS, MAX_CONTACT_MOTION_MM, NEGLIGIBLE_CHANGES,
    TRUSTED_MM,
};
use prosopon_geometry::{Motion, Vector};

/// Curvature of the bodies that a model includes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CurvatureTerms {
    /// Share at a state that does not come from the condensed contact solve.
    pub(super) share: f64,
    /// Whether the whole curvature is included at a state from the condensed contact solve.
    pub(super) after_condensed: bool,
    /// Whether the last model included any.
    pub(super) used: bool,
}

/// Where the model is set up, and how accurately it is solved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Goal<'a> {
    /// Values of the generalised nodes.
    pub(super) x: &'a [Vector],
    /// Motions of the bodies.
    pub(super) motions: &'a [Motion],
    /// Gradient of the energy of elements and loads by all nodes.
    pub(super) load: &'a [Vector],
    /// Relative tolerance of the linear systems.
    pub(super) forcing: f64,
}

/// State at which contact is linearised.
struct Linearisation<'a> {
    /// The condensed contact solve, when it was used and converged.
    condensed: Option<&'a CondensedContact>,
    /// Contacts that are active or nearly so.
    near: Vec<ContactPair>,
    /// Active contacts of the first round.
    active: Vec<ContactPair>,
    /// Where the curvature of the bodies is evaluated; `None` without it.
    curved: Option<Curved<'a>>,
}

/// Minimises the quadratic model of the energy over the unknowns.
///
/// The elements have gradient `load` and the assembled stiffness at `x`. Contact is linearised at the state of the condensed
/// contact solve, or else at `x`. A primal-dual active set decides which points are active in the model's own solution: otherwise
/// a step would run into bone that was not active at its start.
pub(super) fn minimise_model(
    equations: &mut Equations<'_>,
    goal: Goal<'_>,
    terms: &mut CurvatureTerms,
    record: &mut IterationRecord,
) -> Result<Vec<f64>, Failure> {
    let n = equations.work.residual().len();
    let (mut d, mut change, mut rhs) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    equations.work.prepare(&equations.problem);
    equations.problem.dofs().restrict(goal.load, &mut rhs);
    let condenses = equations.state.uses_condensed && !equations.state.contact.is_empty();
    let condensed = if condenses { solve_condensed(equations, goal.x, goal.motions, &rhs) } else { None };
    let Linearisation { condensed, near, mut active, mut curved } =
        linearisation(equations, goal, condensed.as_ref(), *terms);
    if let Some(condensed) = condensed {
        d.copy_from_slice(&condensed.d);
    }
    terms.used = curved.is_some();
    let few = if equations.problem.limits().linear { 0 } else { active.len() / NEGLIGIBLE_CHANGES };
    for round in 0..MAX_ACTIVE_SETS {
        equations.state.control.check()?;
        let begin = equations.problem.now();
        equations.work.add_contact(&equations.problem, &equations.state.contact, &active, curved);
        let norm_sq = right_hand_side(equations, goal.load, &active, condensed, &mut rhs);
        if round > 0 {
            let from = condensed.map_or(&[][..], |s| &s.d).iter().copied().chain(std::iter::repeat(0.0));
            let farther: Vec<f64> = d.iter().zip(from).map(|(d, from)| d - from).collect();
            equations.work.multiply(&equations.problem, &farther, &mut change);
            rhs.iter_mut().zip(&change).for_each(|(r, c)| *r += c);
        }
        rhs.iter_mut().for_each(|r| *r = -*r);
        equations.work.times_mut().contact_s += equations.problem.now() - begin;
        let tolerance = equations.work.solver().tolerance(goal.forcing);
        let gauss_newton = equations.state.contact.terms(&active, equations.problem.dofs());
        let checks_curvature = condensed.is_some() && curved.is_some();
        if checks_curvature {
            let change = equations.work.solver_mut().estimate(&gauss_newton, &rhs);
            if equations.problem.dofs().max_position_change(&change) > DOUBTFUL_MM {
                (curved, terms.used) = (None, false);
                continue;
            }
        }
        let work = equations.work.solve(&equations.problem, &gauss_newton, &rhs, &mut change, tolerance, norm_sq)?;
        record.factorised |= work.factorised;
        record.cg_iterations += work.cg_iterations;
        if checks_curvature && equations.problem.dofs().max_position_change(&change) > TRUSTED_MM {
            // Where the tangent with curvature is nearly singular, points would slide beyond the validity of the model.
            (curved, terms.used) = (None, false);
            continue;
        }
        d.iter_mut().zip(&change).for_each(|(d, c)| *d += c);
        let next = active_after(equations, &near, &d);
        let changes = differing(&next, &active);
        active = next;
        if changes <= few {
            break;
        }
    }
    equations.state.active = active.iter().map(ContactPair::index).collect();
    Ok(d)
}

/// Contacts and curvature of the first round.
fn linearisation<'a>(
    equations: &mut Equations<'_>,
    Goal { x, motions, .. }: Goal<'a>,
    condensed: Option<&'a CondensedContact>,
    terms: CurvatureTerms,
) -> Linearisation<'a> {
    match condensed {
        Some(found) => {
            let includes_curvature = found.curved && terms.after_condensed;
            let curved = includes_curvature.then_some(Curved { x: &found.x, motions, share: 1.0 });
            Linearisation { condensed, near: found.near.clone(), active: found.active.clone(), curved }
        }
        None => {
            let near = equations.near(x, motions);
            // The last active set is closer to the solution than the contacts found after a whole step of the bone.
            let last = &equations.state.active;
            let active = near.iter().filter(|t| last.binary_search(&t.index()).is_ok()).copied().collect();
            let curved = (terms.share > 0.0).then_some(Curved { x, motions, share: terms.share });
            Linearisation { condensed, near, active, curved }
        }
    }
}

/// Computes the model's gradient in `rhs`, at the state of the condensed contact solve if there is one. Returns the square of
/// the solution's energy norm, estimated with the factor.
fn right_hand_side(
    equations: &Equations<'_>,
    load: &[Vector],
    active: &[ContactPair],
    condensed: Option<&CondensedContact>,
    rhs: &mut [f64],
) -> Option<f64> {
    let mut gradient = load.to_vec();
    equations.state.contact.add_forces(active, &mut gradient);
    equations.problem.dofs().restrict(&gradient, rhs);
    let norm_sq = condensed.map(|s| -dot(rhs, &s.d)).filter(|norm| *norm > 0.0);
    if let Some(condensed) = condensed {
        let mut change = vec![0.0; rhs.len()];
        equations.problem.pattern().multiply(equations.work.elastic(), &condensed.d, &mut change);
        rhs.iter_mut().zip(&change).for_each(|(r, c)| *r += c);
    }
    norm_sq
}

/// The `near` contacts that are active after a change `d` of the unknowns.
fn active_after(equations: &Equations<'_>, near: &[ContactPair], d: &[f64]) -> Vec<ContactPair> {
    let (contact, dofs) = (&equations.state.contact, equations.problem.dofs());
    near.iter().filter(|t| contact.pressure_after(t, dofs, d) > 0.0).copied().collect()
}

/// Linear prediction of the state after the bones have moved: held nodes take their prescribed positions, the others follow by
/// the tangent at `x`. `motions` gives the motions of the bodies at a share of the path, along which bone near contact points
/// moves by `length_mm`.
pub(super) fn predict(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &dyn Fn(f64) -> Vec<Motion>,
    length_mm: f64,
    motion_of: &dyn Fn(u32) -> Motion,
) -> Result<Vec<Vector>, Failure> {
    equations.state.begin_attempt();
    let [begin, end] = [motions(0.0), motions(1.0)];
    let mut target = x.to_vec();
    equations.problem.dofs().prescribe(motion_of, equations.state.load_share, &mut target);
    equations.state.springs.carry(&begin, &end, equations.problem.dofs(), &mut target);
    let [forces, load] = gradients_along(equations, [x, &target], [&begin, &end])?;
    let gradients = [&forces, &load].map(|by_node| {
        let mut gradient = vec![0.0; equations.work.residual().len()];
        equations.problem.dofs().restrict(by_node, &mut gradient);
        gradient
    });
    let kept = equations.state.contact_forces.clone();
    let end = end.as_slice();
    let mut inverted = None;
    for kind in [TangentKind::Exact, TangentKind::PositiveDefinite] {
        let springs = equations.state.springs.stiffness_at(&target, end);
        equations.work.tangent(&equations.problem, x, kind.elements(), kind.springs(springs))?;
        let mut record = IterationRecord::default();
        equations.work.prepare(&equations.problem);
        let path = StepPath { length_mm, x: [x, &target], gradients: [&gradients[0], &gradients[1]], motions };
        if track_contact(equations, &path).is_none() {
            equations.state.contact_forces.clone_from(&kept);
        }
        let goal = Goal { x: &target, motions: end, load: &load, forcing: FORCING_OF_PREDICTION };
        match minimise_model(equations, goal, &mut CurvatureTerms::default(), &mut record) {
            Ok(d) => match predicted(equations, &target, end, 1.0, &d) {
                Err(Failure::Inverted(_)) => inverted = Some(d),
                found => return found,
            },
            Err(Failure::Cancelled) => return Err(Failure::Cancelled),
            Err(_) => {}
        }
        equations.work.solver_mut().refresh();
    }
    // Where the tangent is nearly singular, the whole prediction may be far off; equilibrium is then sought from a part of it.
    let Some(d) = inverted else { return Err(Failure::Indefinite) };
    let whole = equations.moved(&target, end, 1.0, &d);
    let change: Vec<Vector> = whole.iter().zip(&target).map(|(a, b)| a - b).collect();
    let share = INVERSION_MARGIN * equations.problem.assembly().first_inversion(&target, &change).share;
    predicted(equations, &target, end, share, &d)
}

/// The state after a share of the predicted change `d`, unless it lies far off, penetrates bone deeply or inverts an element.
fn predicted(
    equations: &Equations<'_>,
    target: &[Vector],
    motions: &[Motion],
    share: f64,
    d: &[f64],
) -> Result<Vec<Vector>, Failure> {
    let x = equations.moved(target, motions, share, d);
    // Where the tangent is nearly singular, the prediction knows no bounds.
    if equations.strays(&x) {
        return Err(Failure::Indefinite);
    }
    let found_mm = equations.energy(&x, motions)?.penetration_mm;
    if found_mm > 2.0 * MAX_CONTACT_MOTION_MM { Err(Failure::Penetration { found_mm }) } else { Ok(x) }
}

/// Gradients of the energy of elements, springs and loads by all nodes at `x`, and at `target`, there to first order in the
/// elements. `begin` and `end` are the motions of the bodies at both.
fn gradients_along(
    equations: &mut Equations<'_>,
    [x, target]: [&[Vector]; 2],
    [begin, end]: [&[Motion]; 2],
) -> Result<[Vec<Vector>; 2], Failure> {
    let change: Vec<Vector> = target.iter().zip(x).map(|(a, b)| a - b).collect();
    let mut load = vec![Vector::zeros(); x.len()];
    equations.work.force_change(&equations.problem, x, &change, &mut load)?;
    equations.work.compute_forces(&equations.problem, x)?;
    let mut forces = equations.work.forces().to_vec();
    load.iter_mut().zip(&forces).for_each(|(load, f)| *load += f);
    equations.state.springs.add(&equations.state.springs.gradients(x, begin), &mut forces);
    equations.state.springs.add(&equations.state.springs.gradients(target, end), &mut load);
    equations.subtract_loads(&mut load);
    equations.subtract_loads(&mut forces);
    Ok([forces, load])
}

/// Number of points in exactly one of two sets, each in the order of points.
fn differing(a: &[ContactPair], b: &[ContactPair]) -> usize {
    let common = a.iter().filter(|t| b.binary_search_by_key(&t.index(), ContactPair::index).is_ok()).count();
    a.len() + b.len() - 2 * common
}
