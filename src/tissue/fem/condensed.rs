//! Solves contact on the nodes that it can touch only.
//!
//! These nodes are eliminated last. Their block of the factor (the *corner*) gives their compliance: how they yield to forces. So
//! contact points slide over the curved bone to equilibrium without a solve for the whole tissue.

use super::compliance::{Compliance, LowRank};
use super::contact::{ContactPair, Curved, PlacedBlock, Placement};
use super::dofs::Dofs;
use super::dot::dot;
use super::equations::Equations;
use super::linear_solve::LinearSolver;
use super::problem::Limits;
use super::tuning::{
    CONDENSED_CG_GOAL, CONDENSED_CONVEX, CONDENSED_CURVATURE_BELOW_MM, CONDENSED_GAP_SHARE, CONDENSED_MAX_CG,
    CONDENSED_MAX_MOVE_MM, CONDENSED_MAX_ROUNDS, CONDENSED_MULTIPLIER_UPDATES, CONDENSED_RISE, CONDENSED_TOLERANCE,
    NEAR_MM, TRACKING_STEP_MM, TRACKING_TOLERANCE_MM,
};
use prosopon_geometry::{Motion, Vector};
use std::ops::Range;

/// Contact in equilibrium with the quadratic model of the elements' energy, as given by the factor.
#[derive(Debug)]
pub(super) struct CondensedContact {
    /// Change of all unknowns.
    pub(super) d: Vec<f64>,
    /// State after this change.
    pub(super) x: Vec<Vector>,
    /// Contacts that are active or nearly so at `x`, linearised there and extrapolated back to zero change of the unknowns.
    pub(super) near: Vec<ContactPair>,
    /// The active ones among them.
    pub(super) active: Vec<ContactPair>,
    /// Whether the iterations converged with the whole curvature of the bodies.
    pub(super) curved: bool,
}

/// Forces at the nodes of the compliance, and the corner's unknowns under these forces.
#[derive(Debug, Clone)]
struct CondensedState {
    forces: Vec<f64>,
    corner: Vec<f64>,
}

/// Result of the iterations.
struct Found {
    state: CondensedState,
    /// Whether they converged with the whole curvature of the bodies.
    curved: bool,
}

/// Convergence criteria of contact.
#[derive(Debug, Clone, Copy)]
struct Tolerances {
    /// Largest movement of a node in the last iteration, mm.
    move_mm: f64,
    /// Largest gap or penetration of an active contact, mm.
    gap_mm: f64,
    /// Largest number of updates of the multipliers.
    multiplier_updates: usize,
}

impl Tolerances {
    const ALONG_PATH: Self = Self { move_mm: TRACKING_TOLERANCE_MM, gap_mm: f64::INFINITY, multiplier_updates: 0 };

    fn of(limits: &Limits) -> Self {
        Self {
            move_mm: CONDENSED_TOLERANCE * limits.element_size_mm,
            gap_mm: CONDENSED_GAP_SHARE * limits.penetration_tolerance_mm,
            multiplier_updates: CONDENSED_MULTIPLIER_UPDATES,
        }
    }
}

/// Path of bones and held nodes in one step.
pub(super) struct StepPath<'a> {
    /// Largest motion of bone near contact points, mm.
    pub(super) length_mm: f64,
    /// Nodes at the start, and with the held nodes at the end of the path.
    pub(super) x: [&'a [Vector]; 2],
    /// Gradients of the elements' energy by the unknowns at both, to first order.
    pub(super) gradients: [&'a [f64]; 2],
    /// Motions of the bodies at a share of the path.
    pub(super) motions: &'a dyn Fn(f64) -> Vec<Motion>,
}

/// Data that stay constant while contact is solved.
struct CondensedProblem<'a> {
    x: &'a [Vector],
    motions: &'a [Motion],
    /// First unknown of the corner.
    start: usize,
    /// The corner's part of `-L⁻¹ g`.
    reached: Vec<f64>,
    /// Unknowns of the corner without contact.
    free: Vec<f64>,
}

impl CondensedProblem<'_> {
    /// Positions after a change of the corner's unknowns.
    fn trial(&self, dofs: &Dofs, corner: &[f64]) -> Vec<Vector> {
        let mut x = self.x.to_vec();
        let first = self.start.div_ceil(3);
        let skipped = 3 * first - self.start;
        for (node, u) in dofs.nodes()[first..].iter().zip(corner[skipped..].chunks_exact(3)) {
            x[*node as usize] += Vector::new(u[0], u[1], u[2]);
        }
        x
    }

    /// The corner's unknowns under forces at the nodes of `compliance`.
    fn moved(&self, solver: &LinearSolver, compliance: &Compliance, forces: &[f64]) -> Vec<f64> {
        let mut y = self.reached.clone();
        compliance.add_forces(forces, &mut y);
        solver.corner_backward(&mut y);
        y
    }
}

/// Minimises the quadratic model of the elements' energy (gradient `gradient` by the unknowns, stiffness of the current factor)
/// plus the exact energy of contact; the multipliers are updated. `None` when there is no usable factor or the iterations do not
/// converge.
pub(super) fn solve_condensed(
    equations: &mut Equations<'_>,
    x: &[Vector],
    motions: &[Motion],
    gradient: &[f64],
) -> Option<CondensedContact> {
    let down: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut reached = equations.work.solver_mut().forward(&down)?;
    let begin = equations.problem.now();
    let start = equations.work.solver().corner().start;
    let mut free = reached[start..].to_vec();
    equations.work.solver().corner_backward(&mut free);
    let problem = CondensedProblem { x, motions, start, reached: reached[start..].to_vec(), free };
    let multipliers = equations.state.contact.multipliers().to_vec();
    let tolerances = Tolerances::of(equations.problem.limits());
    let found = minimise_condensed(equations, &problem, tolerances);
    // In thin bone the gradient of the gap may point out of the other side.
    let found = found.filter(|found| !passes_through_bone(equations, &problem, &found.state));
    equations.work.times_mut().contact_s += equations.problem.now() - begin;
    let Some(Found { state, curved }) = found else {
        equations.state.contact.set_multipliers(multipliers);
        return None;
    };
    let dofs = equations.problem.dofs();
    let compliance = equations.work.solver_mut().compliance(std::iter::empty())?;
    compliance.add_forces(&state.forces, &mut reached[start..]);
    equations.state.contact_forces = forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..dofs.n_unknown());
    let d = equations.work.solver_mut().backward(&reached);
    let begin = equations.problem.now();
    let found = CondensedContact { curved, ..linearised_back(equations, x, motions, d) };
    equations.work.times_mut().contact_s += equations.problem.now() - begin;
    Some(found)
}

/// Whether a point passes through bone, and not round a rim, or through tissue on its path to the condensed solution, or strays.
fn passes_through_bone(equations: &Equations<'_>, problem: &CondensedProblem<'_>, state: &CondensedState) -> bool {
    let at = problem.trial(equations.problem.dofs(), &state.corner);
    if equations.strays(&at) {
        return true;
    }
    let start = Placement { x: problem.x, motions: problem.motions };
    let end = Placement { x: &at, motions: problem.motions };
    let contact = &equations.state.contact;
    contact.passages(start, end, &equations.state.control).iter().any(|passage| !passage.round_a_rim)
        || contact.facing_passage(problem.x, &at).is_some()
}

/// The contacts after a change `d` of the unknowns, extrapolated back to the state before; without `curved`.
fn linearised_back(equations: &Equations<'_>, x: &[Vector], motions: &[Motion], d: Vec<f64>) -> CondensedContact {
    let (contact, dofs) = (&equations.state.contact, equations.problem.dofs());
    let mut at = x.to_vec();
    dofs.add(1.0, &d, &mut at);
    let near = contact.near(&at, motions, NEAR_MM);
    let active: Vec<ContactPair> = near.iter().filter(|t| t.is_active()).copied().collect();
    let back = |contacts: &[ContactPair]| contacts.iter().map(|t| contact.without_change(t, dofs, &d)).collect();
    CondensedContact { near: back(&near), active: back(&active), x: at, curved: false, d }
}

/// Solves contact every [`TRACKING_STEP_MM`] along the path of the bones and held nodes, so that a point that an edge of bone
/// moves over stays on the face that it touched first. Stores the forces as start values for the end of the path; the multipliers
/// are unchanged. `None` when there is no usable factor or the iterations do not converge.
pub(super) fn track_contact(equations: &mut Equations<'_>, path: &StepPath<'_>) -> Option<()> {
    let n = (path.length_mm / TRACKING_STEP_MM).ceil() as usize;
    if n < 2 || equations.state.contact.is_empty() {
        return Some(());
    }
    let mut ends = Vec::new();
    for gradient in path.gradients {
        let down: Vec<f64> = gradient.iter().map(|g| -g).collect();
        ends.push(equations.work.solver_mut().forward(&down)?);
    }
    let begin = equations.problem.now();
    let start = equations.work.solver().corner().start;
    let multipliers = equations.state.contact.multipliers().to_vec();
    let mut tracked = Some(());
    for i in 1..n {
        let share = i as f64 / n as f64;
        let mix = |(a, b): (&f64, &f64)| a + share * (b - a);
        let reached: Vec<f64> = ends[0][start..].iter().zip(&ends[1][start..]).map(mix).collect();
        let mut free = reached.clone();
        equations.work.solver().corner_backward(&mut free);
        let x: Vec<Vector> = path.x[0].iter().zip(path.x[1]).map(|(a, b)| a.lerp(b, share)).collect();
        let motions = (path.motions)(share);
        let problem = CondensedProblem { x: &x, motions: &motions, start, reached, free };
        let Some(Found { state, .. }) = minimise_condensed(equations, &problem, Tolerances::ALONG_PATH) else {
            tracked = None;
            break;
        };
        let Some(compliance) = equations.work.solver().known_compliance() else { break };
        equations.state.contact_forces =
            forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..equations.problem.dofs().n_unknown());
    }
    equations.state.contact.set_multipliers(multipliers);
    equations.work.times_mut().contact_s += equations.problem.now() - begin;
    tracked
}

/// The equilibrium of contact. `None` when the iterations do not converge.
fn minimise_condensed(
    equations: &mut Equations<'_>,
    problem: &CondensedProblem<'_>,
    tolerances: Tolerances,
) -> Option<Found> {
    let dofs = equations.problem.dofs();
    let solver = equations.work.solver_mut();
    let mut state = first_state(solver, problem, &equations.state.contact_forces)?;
    let contact = &mut equations.state.contact;
    let mut last: Option<(f64, CondensedState)> = None;
    let (mut updates, mut moved_mm, mut rounds) = (0, f64::INFINITY, 0);
    loop {
        equations.state.control.check().ok()?;
        rounds += 1;
        let trial = problem.trial(dofs, &state.corner);
        let contacts = contact.active_contacts(&trial, problem.motions);
        let compliance = solver.compliance(contact.unknowns_of(&contacts, dofs))?;
        state.forces.resize(compliance.len(), 0.0);
        let energy = work(problem, compliance, dofs, &state) + contact.energy(&contacts);
        if let Some((before, kept)) = &last
            && energy > before + CONDENSED_RISE * before.abs()
            && moved_mm > tolerances.move_mm
        {
            if rounds > CONDENSED_MAX_ROUNDS {
                return None;
            }
            state = between(kept, &state, 0.5);
            moved_mm *= 0.5;
            continue;
        }
        let pull = contact.forces_at(&contacts, dofs, compliance)?;
        let residual: Vec<f64> = pull.iter().zip(&state.forces).map(|(p, f)| p - f).collect();
        let low_rank = LowRank::new(&contact.terms(&contacts, dofs), compliance, &equations.state.control);
        let includes_curvature = moved_mm < CONDENSED_CURVATURE_BELOW_MM;
        let curvature = if includes_curvature {
            let curved = Curved { x: &trial, motions: problem.motions, share: 1.0 };
            contact.curvature_blocks(&contacts, curved, dofs, compliance)
        } else {
            Vec::new()
        };
        let ForceChange { change, used_curvature } = step(compliance, low_rank.as_ref(), &curvature, &residual);
        let forces: Vec<f64> = state.forces.iter().zip(&change).map(|(f, c)| f + c).collect();
        let corner = problem.moved(solver, solver.known_compliance()?, &forces);
        let next = CondensedState { forces, corner };
        moved_mm = state.corner.iter().zip(&next.corner).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let gap_mm = contacts.iter().map(|t| t.share_of_tolerance() * t.gap().abs()).fold(0.0, f64::max);
        if moved_mm <= tolerances.move_mm || rounds >= CONDENSED_MAX_ROUNDS {
            let is_last = gap_mm <= tolerances.gap_mm
                || updates == tolerances.multiplier_updates
                || rounds >= CONDENSED_MAX_ROUNDS;
            if is_last {
                let curved = used_curvature && includes_curvature && moved_mm <= tolerances.move_mm;
                return Some(Found { state: next, curved });
            }
            contact.augment(&contacts);
            updates += 1;
            last = None;
            moved_mm = CONDENSED_CURVATURE_BELOW_MM * 0.5;
            state = next;
        } else {
            let share = (CONDENSED_MAX_MOVE_MM / moved_mm).min(1.0);
            let taken = between(&state, &next, share);
            last = Some((energy, state));
            state = taken;
        }
    }
}

/// Starts from the last converged contact forces; forces from the bone's new position would overshoot.
fn first_state(
    solver: &mut LinearSolver,
    problem: &CondensedProblem<'_>,
    contact_forces: &[(u32, Vector)],
) -> Option<CondensedState> {
    let compliance = solver.compliance(contact_forces.iter().map(|(unknown, _)| *unknown))?;
    let mut forces = vec![0.0; compliance.len()];
    for (unknown, force) in contact_forces {
        let place = compliance.place(*unknown)?;
        forces[place..place + 3].copy_from_slice(force.as_slice());
    }
    let corner = problem.moved(solver, solver.known_compliance()?, &forces);
    Some(CondensedState { forces, corner })
}

/// Non-zero forces at the nodes of `compliance`, by unknown node, ascending.
fn forces_by_unknown(compliance: &Compliance, forces: &[f64], unknowns: Range<usize>) -> Vec<(u32, Vector)> {
    unknowns
        .filter_map(|unknown| Some((unknown as u32, compliance.place(unknown as u32)?)))
        .filter_map(|(unknown, place)| Some((unknown, Vector::from_column_slice(forces.get(place..place + 3)?))))
        .filter(|(_, force)| *force != Vector::zeros())
        .collect()
}

/// Half the work of the forces from the free state on, mJ.
fn work(problem: &CondensedProblem<'_>, compliance: &Compliance, dofs: &Dofs, state: &CondensedState) -> f64 {
    let mut sum = 0.0;
    for unknown in problem.start.div_ceil(3)..dofs.n_unknown() {
        if let Some(place) = compliance.place(unknown as u32) {
            let at = 3 * unknown - problem.start;
            let moved: f64 =
                (0..3).map(|i| state.forces[place + i] * (state.corner[at + i] - problem.free[at + i])).sum();
            sum += moved;
        }
    }
    0.5 * sum
}

/// Interpolation from `a` to `b` at `share`; forces missing in `a` are zero.
fn between(a: &CondensedState, b: &CondensedState, share: f64) -> CondensedState {
    let mix = |a: &[f64], b: &[f64]| {
        let from = a.iter().copied().chain(std::iter::repeat(0.0));
        b.iter().zip(from).map(|(b, a)| a + share * (b - a)).collect()
    };
    if share == 1.0 {
        b.clone()
    } else {
        CondensedState { forces: mix(&a.forces, &b.forces), corner: mix(&a.corner, &b.corner) }
    }
}

/// Newton change of the forces.
struct ForceChange {
    change: Vec<f64>,
    /// Whether the curvature was used to the end.
    used_curvature: bool,
}

/// Newton change of the forces when they differ by `residual` from the contact forces.
///
/// The matrix is `S⁻¹ + V D Vᵀ - P`:
///
/// - `S`: the compliance of the nodes (`compliance`).
/// - `V`: for each active contact, its normal, weighted at the contact point's nodes.
/// - `D`: the stiffnesses of these contacts. `low_rank` holds `V` and `D`.
/// - `P`: the blocks of the bone's curvature (`curvature`). They are dropped where the energy is not convex with them.
///
/// Conjugate gradients solve it, preconditioned by the inverse without `P`. `S⁻¹` times each direction is updated by recurrence.
fn step(
    compliance: &Compliance,
    low_rank: Option<&LowRank>,
    curvature: &[PlacedBlock],
    residual: &[f64],
) -> ForceChange {
    let precondition = |r: &[f64]| -> (Vec<f64>, Vec<f64>) {
        let mut forces = r.to_vec();
        let mut moved = compliance.displacements(r);
        if let Some(low_rank) = low_rank {
            let back = low_rank.reaction(&moved);
            moved.iter_mut().zip(compliance.displacements(&back)).for_each(|(u, b)| *u += b);
            forces.iter_mut().zip(back).for_each(|(f, b)| *f += b);
        }
        (moved, forces)
    };
    let (mut z, mut w) = precondition(residual);
    if curvature.is_empty() {
        return ForceChange { change: w, used_curvature: true };
    }
    let mut r = residual.to_vec();
    let mut change = vec![0.0; r.len()];
    // Direction, its product with the stiffness without `P`, and its product with `S⁻¹`.
    let (mut p, mut hp, mut sp) = (z.clone(), r.clone(), w.clone());
    let mut rz = dot(&r, &z);
    let goal = CONDENSED_CG_GOAL * rz;
    for iteration in 0..CONDENSED_MAX_CG {
        if rz <= goal {
            return ForceChange { change, used_curvature: true };
        }
        let mut ap = hp.clone();
        for PlacedBlock { row, column, block } in curvature {
            let v = block * Vector::new(p[*column], p[column + 1], p[column + 2]);
            (0..3).for_each(|i| ap[row + i] -= v[i]);
        }
        let stiffness = dot(&p, &ap);
        let convex = stiffness > CONDENSED_CONVEX * dot(&p, &hp);
        if !convex {
            return ForceChange { change: if iteration == 0 { w } else { change }, used_curvature: false };
        }
        let alpha = rz / stiffness;
        for i in 0..r.len() {
            change[i] += alpha * sp[i];
            r[i] -= alpha * ap[i];
        }
        (z, w) = precondition(&r);
        let next = dot(&r, &z);
        let beta = next / rz;
        rz = next;
        for i in 0..r.len() {
            p[i] = z[i] + beta * p[i];
            hp[i] = r[i] + beta * hp[i];
            sp[i] = w[i] + beta * sp[i];
        }
    }
    ForceChange { change, used_curvature: true }
}
