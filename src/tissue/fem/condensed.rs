//! Contact on the condensed system: the factor gives the compliance of the nodes that contact acts on, so contact points can
//! slide over the curved bone to equilibrium without a solve for the whole tissue.

use super::tuning::{CONDENSED_CG_GOAL, CONDENSED_CONVEX, CONDENSED_RISE, NEAR_MM, CONDENSED_CURVATURE_BELOW_MM, CONDENSED_GAP_SHARE, CONDENSED_MAX_CG, CONDENSED_MAX_MOVE_MM, CONDENSED_MAX_ROUNDS, CONDENSED_MULTIPLIER_UPDATES, CONDENSED_TOLERANCE, TRACKING_STEP_MM, TRACKING_TOLERANCE_MM};
use super::compliance::{Compliance, LowRank};
use super::contact::{Curved, ContactPair};
use super::dofs::Dofs;
use super::equations::{Equations, Limits};
use super::dot::dot;
use super::linear_solve::LinearSolver;
use nalgebra::Matrix3;
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
struct State {
    forces: Vec<f64>,
    corner: Vec<f64>,
}

/// Convergence criteria of contact.
#[derive(Debug, Clone, Copy)]
struct Aim {
    enough_mm: f64,
    gap_mm: f64,
    augmentations: usize,
}

impl Aim {
    const ALONG_PATH: Self = Self { enough_mm: TRACKING_TOLERANCE_MM, gap_mm: f64::INFINITY, augmentations: 0 };

    fn of(limits: &Limits) -> Self {
        Self {
            enough_mm: CONDENSED_TOLERANCE * limits.element_size_mm,
            gap_mm: CONDENSED_GAP_SHARE * limits.penetration_tolerance_mm,
            augmentations: CONDENSED_MULTIPLIER_UPDATES,
        }
    }
}

/// The path of bones and held nodes in one step.
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

impl Equations<'_> {
    /// Minimises the quadratic model of the elements' energy (gradient `gradient` by the unknowns, stiffness of the current
    /// factor) plus the exact energy of contact; the multipliers are updated. `None` when there is no usable factor or the
    /// iterations do not converge.
    pub(super) fn solve_condensed(&mut self, x: &[Vector], motions: &[Motion], gradient: &[f64]) -> Option<CondensedContact> {
        let down: Vec<f64> = gradient.iter().map(|g| -g).collect();
        let mut reached = self.solver.forward(&down)?;
        let begin = (self.clock)();
        let start = self.solver.corner().start;
        let mut free = reached[start..].to_vec();
        self.solver.corner_backward(&mut free);
        let frame = CondensedProblem { x, motions, start, reached: reached[start..].to_vec(), free };
        let multipliers = self.contact.multipliers().to_vec();
        let found = self.settle(&frame, Aim::of(&self.limits));
        // In thin bone the gradient of the gap may point out of the other side.
        let through = |(state, _): &(State, bool)| {
            let at = frame.trial(&self.dofs, &state.corner);
            self.contact.passages((x, &at), (motions, motions)).iter().any(|passage| !passage.round_a_rim)
        };
        let found = found.filter(|found| !through(found));
        self.times.contact_s += (self.clock)() - begin;
        let Some((state, curved)) = found else {
            self.contact.set_multipliers(multipliers);
            return None;
        };
        let compliance = self.solver.compliance(std::iter::empty())?;
        compliance.add_forces(&state.forces, &mut reached[start..]);
        self.contact_forces = forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..self.dofs.n_unknown());
        let d = self.solver.backward(&reached);
        let begin = (self.clock)();
        let mut at = x.to_vec();
        self.dofs.add(1.0, &d, &mut at);
        let near = self.contact.near(&at, motions, NEAR_MM);
        let active: Vec<ContactPair> = near.iter().filter(|t| t.is_active()).copied().collect();
        let told = |touches: &[ContactPair]| touches.iter().map(|t| self.contact.without_change(t, &self.dofs, &d)).collect();
        let settled = CondensedContact { near: told(&near), active: told(&active), x: at, curved, d };
        self.times.contact_s += (self.clock)() - begin;
        Some(settled)
    }

    /// Solves contact every [`TRACKING_STEP_MM`] along the path of the bones and held nodes, so that a point that an edge of bone
    /// moves over stays on the face that it touched first. Stores the forces as start values for the end of the path; the
    /// multipliers are unchanged.
    pub(super) fn track_contact(&mut self, way: &StepPath<'_>) -> Option<()> {
        let n = (way.length_mm / TRACKING_STEP_MM).ceil() as usize;
        if n < 2 || self.contact.is_empty() {
            return Some(());
        }
        let mut ends = Vec::new();
        for gradient in way.gradients {
            let down: Vec<f64> = gradient.iter().map(|g| -g).collect();
            ends.push(self.solver.forward(&down)?);
        }
        let begin = (self.clock)();
        let start = self.solver.corner().start;
        let multipliers = self.contact.multipliers().to_vec();
        let mut followed = Some(());
        for i in 1..n {
            let share = i as f64 / n as f64;
            let mix = |(a, b): (&f64, &f64)| a + share * (b - a);
            let reached: Vec<f64> = ends[0][start..].iter().zip(&ends[1][start..]).map(mix).collect();
            let mut free = reached.clone();
            self.solver.corner_backward(&mut free);
            let x: Vec<Vector> = way.x[0].iter().zip(way.x[1]).map(|(a, b)| a.lerp(b, share)).collect();
            let motions = (way.motions)(share);
            let frame = CondensedProblem { x: &x, motions: &motions, start, reached, free };
            let Some((state, _)) = self.settle(&frame, Aim::ALONG_PATH) else {
                followed = None;
                break;
            };
            let Some(compliance) = self.solver.known_compliance() else { break };
            self.contact_forces =
                forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..self.dofs.n_unknown());
        }
        self.contact.set_multipliers(multipliers);
        self.times.contact_s += (self.clock)() - begin;
        followed
    }

    /// The equilibrium of contact, and whether it converged with the whole curvature of the bodies.
    fn settle(&mut self, frame: &CondensedProblem<'_>, aim: Aim) -> Option<(State, bool)> {
        let Self { solver, contact, dofs, contact_forces, .. } = self;
        let Aim { enough_mm: enough, gap_mm: gap, .. } = aim;
        // Pressures from the new bone position would push tissue too far away: contact starts from the last converged forces.
        let compliance = solver.compliance(contact_forces.iter().map(|(unknown, _)| *unknown))?;
        let mut forces = vec![0.0; compliance.len()];
        for (unknown, force) in contact_forces.iter() {
            let place = compliance.place(*unknown)?;
            forces[place..place + 3].copy_from_slice(force.as_slice());
        }
        let corner = frame.moved(solver, solver.known_compliance()?, &forces);
        let mut state = State { forces, corner };
        let mut last: Option<(f64, State)> = None;
        let (mut augmentations, mut far, mut rounds) = (0, f64::INFINITY, 0);
        loop {
            rounds += 1;
            let trial = frame.trial(dofs, &state.corner);
            let touches = contact.active_contacts(&trial, frame.motions);
            let compliance = solver.compliance(contact.unknowns_of(&touches, dofs))?;
            state.forces.resize(compliance.len(), 0.0);
            let energy = work(frame, compliance, dofs, &state) + contact.energy(&touches);
            if let Some((before, kept)) = &last
                && energy > before + CONDENSED_RISE * before.abs()
                && far > enough
            {
                if rounds > CONDENSED_MAX_ROUNDS {
                    return None;
                }
                state = between(kept, &state, 0.5);
                far *= 0.5;
                continue;
            }
            let pull = contact.forces_at(&touches, dofs, compliance)?;
            let residual: Vec<f64> = pull.iter().zip(&state.forces).map(|(p, f)| p - f).collect();
            let low_rank = LowRank::new(&contact.terms(&touches, dofs), compliance);
            let bent = far < CONDENSED_CURVATURE_BELOW_MM;
            let curvature = match bent {
                true => {
                    let curved = Curved { x: &trial, motions: frame.motions, share: 1.0 };
                    contact.curvature_blocks(&touches, curved, dofs, compliance)
                }
                false => Vec::new(),
            };
            let (change, curved) = step(compliance, low_rank.as_ref(), &curvature, &residual);
            let forces: Vec<f64> = state.forces.iter().zip(&change).map(|(f, c)| f + c).collect();
            let corner = frame.moved(solver, solver.known_compliance()?, &forces);
            let next = State { forces, corner };
            far = state.corner.iter().zip(&next.corner).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let off = touches.iter().map(|t| t.gap().abs()).fold(0.0, f64::max);
            if far <= enough || rounds >= CONDENSED_MAX_ROUNDS {
                if off <= gap || augmentations == aim.augmentations || rounds >= CONDENSED_MAX_ROUNDS {
                    return Some((next, curved && bent && far <= enough));
                }
                contact.augment(&touches);
                augmentations += 1;
                last = None;
                far = CONDENSED_CURVATURE_BELOW_MM * 0.5;
                state = next;
            } else {
                let share = (CONDENSED_MAX_MOVE_MM / far).min(1.0);
                let taken = between(&state, &next, share);
                last = Some((energy, state));
                state = taken;
            }
        }
    }
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
fn work(frame: &CondensedProblem<'_>, compliance: &Compliance, dofs: &Dofs, state: &State) -> f64 {
    let mut sum = 0.0;
    for unknown in frame.start.div_ceil(3)..dofs.n_unknown() {
        if let Some(place) = compliance.place(unknown as u32) {
            let at = 3 * unknown - frame.start;
            let moved: f64 =
                (0..3).map(|i| state.forces[place + i] * (state.corner[at + i] - frame.free[at + i])).sum();
            sum += moved;
        }
    }
    0.5 * sum
}

/// Interpolation from `a` to `b` at `share`; forces missing in `a` are zero.
fn between(a: &State, b: &State, share: f64) -> State {
    let mix = |a: &[f64], b: &[f64]| {
        let from = a.iter().copied().chain(std::iter::repeat(0.0));
        b.iter().zip(from).map(|(b, a)| a + share * (b - a)).collect()
    };
    if share == 1.0 {
        b.clone()
    } else {
        State { forces: mix(&a.forces, &b.forces), corner: mix(&a.corner, &b.corner) }
    }
}

/// Newton change of the forces when they differ by `residual` from the contact forces, and whether `curvature` (blocks subtracted
/// from the stiffness) was used to the end; it is dropped where the energy is not convex with it.
///
/// Conjugate gradients for `S⁻¹ + V D Vᵀ - P`, preconditioned by the inverse without `P`; `S⁻¹` times each direction is updated
/// by recurrence.
fn step(
    compliance: &Compliance,
    low_rank: Option<&LowRank>,
    curvature: &[(usize, usize, Matrix3<f64>)],
    residual: &[f64],
) -> (Vec<f64>, bool) {
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
        return (w, true);
    }
    let mut r = residual.to_vec();
    let mut change = vec![0.0; r.len()];
    // Direction, its product with the stiffness without `P`, and its product with `S⁻¹`.
    let (mut p, mut hp, mut sp) = (z.clone(), r.clone(), w.clone());
    let mut rz = dot(&r, &z);
    let goal = CONDENSED_CG_GOAL * rz;
    for iteration in 0..CONDENSED_MAX_CG {
        if rz <= goal {
            return (change, true);
        }
        let mut ap = hp.clone();
        for (row, column, block) in curvature {
            let v = block * Vector::new(p[*column], p[column + 1], p[column + 2]);
            (0..3).for_each(|i| ap[row + i] -= v[i]);
        }
        let bent = dot(&p, &ap);
        let convex = bent > CONDENSED_CONVEX * dot(&p, &hp);
        if !convex {
            return (if iteration == 0 { w } else { change }, false);
        }
        let alpha = rz / bent;
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
    (change, true)
}
