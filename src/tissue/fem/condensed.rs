//! Contact settled with all else condensed: at the nodes that contact acts on, the factor says how tissue gives way, so the points
//! can be followed over the curved bone as far as they will go without a solve for the whole tissue.

use super::compliance::{Compliance, LowRank};
use super::contact::{Curved, Touch};
use super::dofs::Dofs;
use super::equations::{Equations, Limits, NEAR_MM};
use super::linear_solve::{LinearSolver, dot};
use nalgebra::Matrix3;
use prosopon_geometry::{Motion, Vector};
use std::ops::Range;

/// Rounds of Newton's method on the condensed energy.
const MAX_ROUNDS: usize = 40;
/// Rounds settle when no node moves farther than this share of the element size.
const SETTLED: f64 = 2.5e-4;
/// Points that still move this far, mm, are followed without the bodies' curvature.
const CURVED_BELOW_MM: f64 = 1.0;
/// Points move at most this far in one round, mm: the gap of thin bone says less farther off.
const MAX_MOVE_MM: f64 = 1.0;
/// Conjugate gradients of one round with curvature.
const MAX_CURVED: usize = 40;
/// Updates of the multipliers.
const MAX_AUGMENTATIONS: usize = 6;
/// Bone moves this far between two places at which contact settles on the way of a step, mm: a point that is met so deep at an edge is
/// pushed out on the other face.
const FOLLOWED_MM: f64 = 0.25;
/// Contact on the way counts as settled when no node moves farther, mm.
const SETTLED_ON_THE_WAY_MM: f64 = 0.05;
/// Gaps and penetrations are brought below this share of the tolerance.
const GAP_SHARE: f64 = 0.8;

/// Contact that is in equilibrium with the quadratic model of the elements' energy, as the factor sees it.
#[derive(Debug)]
pub(super) struct Settled {
    /// Change of all unknowns.
    pub(super) d: Vec<f64>,
    /// Where it leads.
    pub(super) x: Vec<Vector>,
    /// Points that push there or nearly touch, linearised there and told as for no change of the unknowns.
    pub(super) near: Vec<Touch>,
    /// Those that push.
    pub(super) active: Vec<Touch>,
    /// Whether it settled with the whole curvature of the bodies.
    pub(super) curved: bool,
}

/// Forces at the nodes of the compliance, and where they bring the corner's unknowns.
#[derive(Debug, Clone)]
struct State {
    forces: Vec<f64>,
    corner: Vec<f64>,
}

/// When contact counts as settled.
#[derive(Debug, Clone, Copy)]
struct Aim {
    enough_mm: f64,
    gap_mm: f64,
    augmentations: usize,
}

impl Aim {
    const ON_THE_WAY: Self = Self { enough_mm: SETTLED_ON_THE_WAY_MM, gap_mm: f64::INFINITY, augmentations: 0 };

    fn of(limits: &Limits) -> Self {
        Self {
            enough_mm: SETTLED * limits.element_size_mm,
            gap_mm: GAP_SHARE * limits.penetration_tolerance_mm,
            augmentations: MAX_AUGMENTATIONS,
        }
    }
}

/// A way of bones and held nodes.
pub(super) struct Way<'a> {
    /// How far bone moves near contact points, mm.
    pub(super) length_mm: f64,
    /// Nodes before, and with the held ones at the end of the way.
    pub(super) x: [&'a [Vector]; 2],
    /// Gradient of the elements' energy by the unknowns there, to first order.
    pub(super) gradients: [&'a [f64]; 2],
    /// Motions of the bodies at a share of the way.
    pub(super) motions: &'a dyn Fn(f64) -> Vec<Motion>,
}

/// What does not change while contact settles.
struct Frame<'a> {
    x: &'a [Vector],
    motions: &'a [Motion],
    /// First unknown of the corner.
    start: usize,
    /// The corner of `-L⁻¹ g`.
    reached: Vec<f64>,
    /// Corner without contact.
    free: Vec<f64>,
}

impl Frame<'_> {
    /// Positions when the corner's unknowns have changed.
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
    /// Minimises the quadratic model of the elements' energy, with `gradient` by the unknowns, plus the energy of contact as it is, as far
    /// as the factor tells; multipliers grow with it. `None` when no factor serves or the points do not come to rest.
    pub(super) fn settle_contact(&mut self, x: &[Vector], motions: &[Motion], gradient: &[f64]) -> Option<Settled> {
        let down: Vec<f64> = gradient.iter().map(|g| -g).collect();
        let mut reached = self.solver.forward(&down)?;
        let begin = (self.clock)();
        let start = self.solver.corner().start;
        let mut free = reached[start..].to_vec();
        self.solver.corner_backward(&mut free);
        let frame = Frame { x, motions, start, reached: reached[start..].to_vec(), free };
        let multipliers = self.contact.multipliers().to_vec();
        let found = self.settle(&frame, Aim::of(&self.limits));
        // Within thin bone a gap may show the way out on the other side.
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
        self.settled_forces = forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..self.dofs.n_unknown());
        let d = self.solver.backward(&reached);
        let begin = (self.clock)();
        let mut at = x.to_vec();
        self.dofs.add(1.0, &d, &mut at);
        let near = self.contact.near(&at, motions, NEAR_MM);
        let active: Vec<Touch> = near.iter().filter(|t| t.pushes()).copied().collect();
        let told = |touches: &[Touch]| touches.iter().map(|t| self.contact.without_change(t, &self.dofs, &d)).collect();
        let settled = Settled { near: told(&near), active: told(&active), x: at, curved, d };
        self.times.contact_s += (self.clock)() - begin;
        Some(settled)
    }

    /// Follows the points while the bones and held nodes go from one place to the next: contact settles every [`FOLLOWED_MM`], so that a
    /// point over which an edge comes is met by the face that it met first. Leaves the forces for the end to begin with; multipliers stay.
    pub(super) fn follow_contact(&mut self, way: &Way<'_>) -> Option<()> {
        let n = (way.length_mm / FOLLOWED_MM).ceil() as usize;
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
            let frame = Frame { x: &x, motions: &motions, start, reached, free };
            let Some((state, _)) = self.settle(&frame, Aim::ON_THE_WAY) else {
                followed = None;
                break;
            };
            let Some(compliance) = self.solver.known_compliance() else { break };
            self.settled_forces =
                forces_by_unknown(compliance, &state.forces, start.div_ceil(3)..self.dofs.n_unknown());
        }
        self.contact.set_multipliers(multipliers);
        self.times.contact_s += (self.clock)() - begin;
        followed
    }

    /// The state in which contact is at rest, and whether the bodies' whole curvature was used.
    fn settle(&mut self, frame: &Frame<'_>, aim: Aim) -> Option<(State, bool)> {
        let Self { solver, contact, dofs, settled_forces, .. } = self;
        let Aim { enough_mm: enough, gap_mm: gap, .. } = aim;
        // Bone that has moved into tissue would push it away too far: contact begins as it settled last.
        let compliance = solver.compliance(settled_forces.iter().map(|(unknown, _)| *unknown))?;
        let mut forces = vec![0.0; compliance.len()];
        for (unknown, force) in settled_forces.iter() {
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
            let touches = contact.touches(&trial, frame.motions);
            let compliance = solver.compliance(contact.unknowns_of(&touches, dofs))?;
            state.forces.resize(compliance.len(), 0.0);
            let energy = work(frame, compliance, dofs, &state) + contact.energy(&touches);
            if let Some((before, kept)) = &last
                && energy > before + 1e-9 * before.abs()
                && far > enough
            {
                if rounds > MAX_ROUNDS {
                    return None;
                }
                state = between(kept, &state, 0.5);
                far *= 0.5;
                continue;
            }
            let pull = contact.forces_at(&touches, dofs, compliance)?;
            let residual: Vec<f64> = pull.iter().zip(&state.forces).map(|(p, f)| p - f).collect();
            let low_rank = LowRank::new(&contact.terms(&touches, dofs), compliance);
            let bent = far < CURVED_BELOW_MM;
            let curvature = match bent {
                true => {
                    let curved = Curved { x: &trial, motions: frame.motions, share: 1.0 };
                    contact.bends(&touches, curved, dofs, compliance)
                }
                false => Vec::new(),
            };
            let (change, curved) = step(compliance, low_rank.as_ref(), &curvature, &residual);
            let forces: Vec<f64> = state.forces.iter().zip(&change).map(|(f, c)| f + c).collect();
            let corner = frame.moved(solver, solver.known_compliance()?, &forces);
            let next = State { forces, corner };
            far = state.corner.iter().zip(&next.corner).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let off = touches.iter().map(|t| t.gap().abs()).fold(0.0, f64::max);
            if far <= enough || rounds >= MAX_ROUNDS {
                if off <= gap || augmentations == aim.augmentations || rounds >= MAX_ROUNDS {
                    return Some((next, curved && bent && far <= enough));
                }
                contact.augment(&touches);
                augmentations += 1;
                last = None;
                far = CURVED_BELOW_MM * 0.5;
                state = next;
            } else {
                let share = (MAX_MOVE_MM / far).min(1.0);
                let taken = between(&state, &next, share);
                last = Some((energy, state));
                state = taken;
            }
        }
    }
}

/// Forces at the nodes of `compliance` by unknown node, ascending, where there are any.
fn forces_by_unknown(compliance: &Compliance, forces: &[f64], unknowns: Range<usize>) -> Vec<(u32, Vector)> {
    unknowns
        .filter_map(|unknown| Some((unknown as u32, compliance.place(unknown as u32)?)))
        .filter_map(|(unknown, place)| Some((unknown, Vector::from_column_slice(forces.get(place..place + 3)?))))
        .filter(|(_, force)| *force != Vector::zeros())
        .collect()
}

/// Half the forces' work on the way from the free state, mJ.
fn work(frame: &Frame<'_>, compliance: &Compliance, dofs: &Dofs, state: &State) -> f64 {
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

/// The state at `share` of the way from `a` to `b`; forces that `a` lacks are zero.
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

/// Change of the forces by Newton's method for forces that are `residual` away from what contact wants, and whether `curvature`, blocks
/// that are taken off the stiffness, was used to the end: not where the energy is not convex with it.
///
/// Conjugate gradients for `S⁻¹ + V D Vᵀ - P`, preconditioned by its inverse without `P`; `S⁻¹` times each direction is carried along.
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
    // Direction, the stiffness without `P` times it, and `S⁻¹` times it.
    let (mut p, mut hp, mut sp) = (z.clone(), r.clone(), w.clone());
    let mut rz = dot(&r, &z);
    let goal = 1e-6 * rz;
    for iteration in 0..MAX_CURVED {
        if rz <= goal {
            return (change, true);
        }
        let mut ap = hp.clone();
        for (row, column, block) in curvature {
            let v = block * Vector::new(p[*column], p[column + 1], p[column + 2]);
            (0..3).for_each(|i| ap[row + i] -= v[i]);
        }
        let bent = dot(&p, &ap);
        let convex = bent > 1e-3 * dot(&p, &hp);
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
