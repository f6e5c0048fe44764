//! Frictionless unilateral contact of tissue with moved bone, by penalty and augmented Lagrangian (Wang 2009, eq. 0.9 to 0.13).
//!
//! Contact acts at two kinds of points: sliding vertices, and barycentres of bone faces that have a sliding vertex and no free
//! one. They are the quadrature points of eq. 0.13 over the faces at rest: half of a face's area at its barycentre, a sixth at
//! each vertex.
//! A sliding vertex whose faces all have a free corner takes a third of the area of each.
//! With gap `g` (negative inside), multiplier `p` and stiffness `k` the energy per area is `(max(0, p - k g)² - p²) / (2 k)`,
//! which is `k g²/2` for `g < 0` when `p = 0`. The multipliers grow until the penetration is below the tolerance.
//! Where the energy is convex enough, the Hessian includes the curvature of the distance. With the Gauss-Newton part `k n nᵀ`
//! alone, points that slide slowly over an edge of bone gain a fifth in each iteration instead of digits.

mod noncontact_points;
mod overlap;
mod passage;
mod points;

pub(super) use noncontact_points::{NoncontactPoints, noncontact_points};
pub(super) use overlap::Overlap;
pub(super) use passage::Passage;
pub(super) use points::contact_nodes;

use self::passage::{is_clear, is_round_a_rim};
use self::points::{ContactPoint, contact_points};
use super::axes::axes_in;
use super::compliance::{Compliance, RankOne};
use super::dofs::Dofs;
use super::report::BonePenetration;
use super::settings::ContactBody;
use super::tuning::{
    CONTACT_POINTS_PER_TASK, DEEP_OVERLAP_MM, OPPOSITE_COSINE, PASSAGE_SAMPLE_MM, REPORTED_OVERLAP_MM,
};
use crate::mesh::MixedMesh;
use nalgebra::Matrix3;
use prosopon_geometry::{Motion, Point, Vector, Warning};
use rayon::prelude::*;

/// A contact point and a body, by their indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PairIndex {
    pub(super) point: usize,
    pub(super) body: usize,
}

/// A contact point paired with a body that it touches or is near to.
#[derive(Debug, Clone, Copy)]
pub(super) struct ContactPair {
    point: usize,
    body: usize,
    /// Signed gap, mm, after subtraction of the overlap at rest.
    gap: f64,
    /// Gradient of the gap with respect to the point.
    normal: Vector,
    /// `p - k g`, MPa; the contact is active where this is positive.
    pressure: f64,
    /// Pressure at the state of linearisation, MPa.
    linearised_pressure: f64,
}

impl ContactPair {
    /// Indices of contact point and body.
    pub(super) fn index(&self) -> PairIndex {
        PairIndex { point: self.point, body: self.body }
    }

    /// Signed gap, mm.
    pub(super) fn gap(&self) -> f64 {
        self.gap
    }

    /// Whether the contact is active.
    pub(super) fn is_active(&self) -> bool {
        self.pressure > 0.0
    }
}

/// State at which the curvature of the bodies is evaluated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curved<'a> {
    /// Values of the generalised nodes.
    pub(super) x: &'a [Vector],
    /// Motion of each body.
    pub(super) motions: &'a [Motion],
    /// Share of the curvature that is included: 1 gives the exact Hessian.
    pub(super) share: f64,
}

/// A block of a matrix at offsets into the forces of a [`Compliance`].
#[derive(Debug, Clone, Copy)]
pub(super) struct PlacedBlock {
    pub(super) row: usize,
    pub(super) column: usize,
    pub(super) block: Matrix3<f64>,
}

/// State at the start or end of a substep.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement<'a> {
    /// Values of the generalised nodes, mm.
    pub(super) x: &'a [Vector],
    /// Motion of each body from rest.
    pub(super) motions: &'a [Motion],
}

/// All contact of one tissue.
pub(super) struct Contact<'a> {
    points: Vec<ContactPoint>,
    bodies: Vec<ContactBody<'a>>,
    /// MPa/mm.
    stiffness: f64,
    /// Overlap at rest, by point and body.
    overlap: Vec<Overlap>,
    /// Multipliers by point and body, MPa.
    multipliers: Vec<f64>,
    /// By point and body: whether the point has slipped round a rim of the body, or through it, so that the body no longer acts
    /// on it.
    released: Vec<bool>,
}

impl std::fmt::Debug for Contact<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Contact")
            .field("points", &self.points.len())
            .field("bodies", &self.bodies)
            .finish_non_exhaustive()
    }
}

impl<'a> Contact<'a> {
    /// Contact points of `mesh`; `stiffness` in MPa/mm. The second value is a warning about overlap at rest.
    pub(super) fn new(mesh: &MixedMesh, bodies: Vec<ContactBody<'a>>, stiffness: f64) -> (Self, Option<Warning>) {
        let points = contact_points(mesh);
        let mut contact =
            Self { points, bodies, stiffness, overlap: Vec::new(), multipliers: Vec::new(), released: Vec::new() };
        let rest: Vec<Vector> = mesh.positions.iter().map(|p| p.coords).collect();
        let at_rest = |p: &ContactPoint| {
            let (at, inward) = (p.at(&rest), p.inward);
            contact.bodies.iter().map(move |b| {
                let value = b.solid.value(&at);
                (value, Overlap::of(b.solid, &at, value, &inward))
            })
        };
        let (gaps, overlap): (Vec<f64>, Vec<Overlap>) =
            contact.points.par_iter().with_min_len(CONTACT_POINTS_PER_TASK).flat_map_iter(at_rest).unzip();
        contact.multipliers = vec![0.0; gaps.len()];
        contact.released = vec![false; gaps.len()];
        contact.overlap = overlap;
        let overlapping = gaps.iter().filter(|g| **g < -REPORTED_OVERLAP_MM).count();
        let deepest = gaps.iter().fold(0.0, |m: f64, g| m.max(-g));
        let warning = (overlapping > 0).then(|| {
            let message = format!(
                "{overlapping} of {} contact points lie {REPORTED_OVERLAP_MM} to {deepest:.2} mm inside bone at rest; their \
                 gap is measured from that position",
                contact.points.len()
            );
            if deepest > DEEP_OVERLAP_MM {
                Warning::check("overlap-at-rest", message).act("Check whether mesh and bone belong together.")
            } else {
                Warning::info("overlap-at-rest", message)
            }
        });
        (contact, warning)
    }

    pub(super) fn bodies(&self) -> &[ContactBody<'a>] {
        &self.bodies
    }

    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty() || self.bodies.is_empty()
    }

    /// Active contacts at `x` when body `b` has moved by `motions[b]` from rest, in the order of points.
    pub(super) fn active_contacts(&self, x: &[Vector], motions: &[Motion]) -> Vec<ContactPair> {
        self.near(x, motions, f64::NEG_INFINITY)
    }

    /// Contacts that are active or whose gap is below `reach` mm, in the order of points.
    pub(super) fn near(&self, x: &[Vector], motions: &[Motion], reach: f64) -> Vec<ContactPair> {
        let n = self.bodies.len();
        self.points
            .par_iter()
            .enumerate()
            .with_min_len(CONTACT_POINTS_PER_TASK)
            .flat_map_iter(|(point, p)| {
                let at = p.at(x);
                self.bodies.iter().enumerate().filter_map(move |(body, b)| {
                    let pair = point * n + body;
                    if self.released[pair] {
                        return None;
                    }
                    let Overlap { shift, rest_mm } = self.overlap[pair];
                    let (value, gradient) =
                        b.solid.value_gradient(&(motions[body].inverse_transform_point(&at) + shift));
                    let gap = value + rest_mm;
                    let pressure = self.multipliers[pair] - self.stiffness * gap;
                    let normal = motions[body].rotation * gradient;
                    (pressure > 0.0 || gap < reach).then_some(ContactPair {
                        point,
                        body,
                        gap,
                        normal,
                        pressure,
                        linearised_pressure: pressure,
                    })
                })
            })
            .collect()
    }

    /// Contact energy, mJ.
    pub(super) fn energy(&self, contacts: &[ContactPair]) -> f64 {
        let n = self.bodies.len();
        let pushed: f64 = contacts.iter().map(|t| self.points[t.point].area * t.pressure * t.pressure).sum();
        let held: f64 = (self.multipliers.iter().enumerate()).map(|(i, p)| self.points[i / n].area * p * p).sum();
        (pushed - held) / (2.0 * self.stiffness)
    }

    /// Adds the gradient of the contact energy, at the state of linearisation, to `forces`.
    pub(super) fn add_forces(&self, contacts: &[ContactPair], forces: &mut [Vector]) {
        for t in contacts {
            let p = &self.points[t.point];
            for (node, weight) in p.terms() {
                forces[node as usize] -= t.normal * (weight * p.area * t.linearised_pressure);
            }
        }
    }

    /// First-order change of the gap of `contact` for a change `d` of the unknowns, mm.
    fn gap_change(&self, contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> f64 {
        (self.points[contact.point].terms())
            .filter_map(|(node, weight)| dofs.unknown(node).map(|u| (3 * u as usize, weight)))
            .map(|(i, weight)| {
                weight * (contact.normal.x * d[i] + contact.normal.y * d[i + 1] + contact.normal.z * d[i + 2])
            })
            .sum()
    }

    /// First-order pressure at `contact` after the unknowns have changed by `d`, MPa.
    pub(super) fn pressure_after(&self, contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> f64 {
        contact.pressure - self.stiffness * self.gap_change(contact, dofs, d)
    }

    /// A contact found after the unknowns have changed by `d`, extrapolated back linearly to the state before that change.
    pub(super) fn without_change(&self, contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> ContactPair {
        let change = self.gap_change(contact, dofs, d);
        ContactPair { gap: contact.gap - change, pressure: contact.pressure + self.stiffness * change, ..*contact }
    }

    /// Unknown nodes that the contacts act on; nodes may repeat.
    pub(super) fn unknowns_of(&self, contacts: &[ContactPair], dofs: &Dofs) -> impl Iterator<Item = u32> {
        contacts.iter().flat_map(|t| self.points[t.point].terms()).filter_map(|(node, _)| dofs.unknown(node))
    }

    /// Contact forces on the nodes of `compliance`, N; `None` when `compliance` lacks a node.
    pub(super) fn forces_at(&self, contacts: &[ContactPair], dofs: &Dofs, compliance: &Compliance) -> Option<Vec<f64>> {
        let mut forces = vec![0.0; compliance.len()];
        for t in contacts {
            let p = &self.points[t.point];
            for (node, weight) in p.terms() {
                let Some(unknown) = dofs.unknown(node) else { continue };
                let place = compliance.place(unknown)?;
                for axis in (0..3).filter(|&axis| dofs.axes_of(node as usize) >> axis & 1 == 0) {
                    forces[place + axis] += t.normal[axis] * (weight * p.area * t.pressure);
                }
            }
        }
        Some(forces)
    }

    /// Passes the blocks of the energy's Hessian to `add`: row and column among the unknowns (`row >= column`), and the block.
    /// Gauss-Newton when `curved` is `None`; otherwise with the curvature of the bodies.
    pub(super) fn hessian(
        &self,
        contacts: &[ContactPair],
        curved: Option<Curved<'_>>,
        dofs: &Dofs,
        mut add: impl FnMut(u32, u32, &Matrix3<f64>),
    ) {
        for t in contacts {
            let p = &self.points[t.point];
            let mut block = t.normal * t.normal.transpose() * (self.stiffness * p.area);
            if let Some(Curved { x, motions, share }) = curved {
                block -= self.curvature_term(t, x, motions) * share;
            }
            for (a, wa) in p.terms() {
                for (b, wb) in p.terms() {
                    if let (Some(row), Some(column)) = (dofs.unknown(a), dofs.unknown(b))
                        && row >= column
                    {
                        add(row, column, &(block * (wa * wb)));
                    }
                }
            }
        }
    }

    /// Curvature term of one contact, subtracted from its Hessian with respect to the point, N/mm.
    fn curvature_term(&self, contact: &ContactPair, x: &[Vector], motions: &[Motion]) -> Matrix3<f64> {
        let p = &self.points[contact.point];
        let motion = &motions[contact.body];
        let shift = self.overlap[contact.point * self.bodies.len() + contact.body].shift;
        let curvature = self.bodies[contact.body].solid.hessian(&(motion.inverse_transform_point(&p.at(x)) + shift));
        let r = motion.rotation.to_rotation_matrix();
        r.matrix() * curvature * r.matrix().transpose() * (contact.linearised_pressure.max(0.0) * p.area)
    }

    /// Curvature terms of the contacts at the nodes of `compliance`: row, column and the block to subtract from the Hessian.
    pub(super) fn curvature_blocks(
        &self,
        contacts: &[ContactPair],
        Curved { x, motions, share }: Curved<'_>,
        dofs: &Dofs,
        compliance: &Compliance,
    ) -> Vec<PlacedBlock> {
        let of_contact = |t: &ContactPair| {
            let (p, block) = (self.points[t.point], self.curvature_term(t, x, motions) * share);
            let mut placed = Vec::with_capacity(9);
            for (a, wa) in p.terms() {
                for (b, wb) in p.terms() {
                    let place = |node: u32| compliance.place(dofs.unknown(node)?);
                    if let (Some(row), Some(column)) = (place(a), place(b)) {
                        let mut block = block * (wa * wb);
                        axes_in(dofs.axes_of(a as usize)).for_each(|axis| block.row_mut(axis).fill(0.0));
                        axes_in(dofs.axes_of(b as usize)).for_each(|axis| block.column_mut(axis).fill(0.0));
                        placed.push(PlacedBlock { row, column, block });
                    }
                }
            }
            placed
        };
        contacts.par_iter().with_min_len(CONTACT_POINTS_PER_TASK).flat_map_iter(of_contact).collect()
    }

    /// The Gauss-Newton part of the Hessian as rank-one terms, one for each contact.
    pub(super) fn terms(&self, contacts: &[ContactPair], dofs: &Dofs) -> Vec<RankOne> {
        let term = |t: &ContactPair| {
            let p = &self.points[t.point];
            let nodes = p.terms().filter_map(|(node, weight)| {
                let mut entry = t.normal * weight;
                axes_in(dofs.axes_of(node as usize)).for_each(|axis| entry[axis] = 0.0);
                dofs.unknown(node).map(|u| (u, entry))
            });
            RankOne { nodes: nodes.collect(), factor: self.stiffness * p.area }
        };
        contacts.iter().map(term).collect()
    }

    /// Force of each body on the tissue, N.
    pub(super) fn forces_by_body(&self, contacts: &[ContactPair]) -> Vec<Vector> {
        let mut forces = vec![Vector::zeros(); self.bodies.len()];
        for t in contacts {
            forces[t.body] += t.normal * (self.points[t.point].area * t.pressure);
        }
        forces
    }

    /// Augmented Lagrangian update: the current pressures become the multipliers.
    pub(super) fn augment(&mut self, contacts: &[ContactPair]) {
        let n = self.bodies.len();
        self.multipliers.fill(0.0);
        for t in contacts {
            self.multipliers[t.point * n + t.body] = t.pressure;
        }
    }

    /// Switches off contact between the point and the body of `passage`.
    pub(super) fn release(&mut self, passage: &Passage) {
        let pair = passage.point * self.bodies.len() + passage.body;
        self.released[pair] = true;
        self.multipliers[pair] = 0.0;
    }

    /// Which pairs are released, by point and body.
    pub(super) fn released(&self) -> &[bool] {
        &self.released
    }

    pub(super) fn set_released(&mut self, released: Vec<bool>) {
        self.released = released;
    }

    /// The released point that lies deepest in its body, relative to rest.
    pub(super) fn bone_penetration(&self, x: &[Vector], motions: &[Motion]) -> Option<BonePenetration> {
        let n = self.bodies.len();
        let mut deepest: Option<BonePenetration> = None;
        for (pair, _) in self.released.iter().enumerate().filter(|(_, released)| **released) {
            let (point, body) = (pair / n, pair % n);
            let place = self.points[point].at(x);
            let Overlap { shift, rest_mm } = self.overlap[pair];
            let b = &self.bodies[body];
            let depth_mm = -rest_mm - b.solid.value(&(motions[body].inverse_transform_point(&place) + shift));
            if depth_mm > 0.0 {
                let points = 1 + deepest.map_or(0, |d| d.points);
                let is_deepest = deepest.is_none_or(|d| depth_mm > d.depth_mm);
                let found = if is_deepest {
                    Some(BonePenetration { depth_mm, segment: b.segment, place, points })
                } else {
                    deepest
                };
                deepest = found.map(|d| BonePenetration { points, ..d });
            }
        }
        deepest
    }

    pub(super) fn multipliers(&self) -> &[f64] {
        &self.multipliers
    }

    pub(super) fn set_multipliers(&mut self, multipliers: Vec<f64>) {
        self.multipliers = multipliers;
    }

    /// Contact stiffness, MPa/mm.
    pub(super) fn stiffness(&self) -> f64 {
        self.stiffness
    }

    /// Restores stiffness (MPa/mm) and multipliers (MPa).
    pub(super) fn restore(&mut self, stiffness: f64, multipliers: Vec<f64>) {
        (self.stiffness, self.multipliers) = (stiffness, multipliers);
    }

    /// Multiplies the contact stiffness by `factor`.
    pub(super) fn stiffen(&mut self, factor: f64) {
        self.stiffness *= factor;
    }

    /// Largest displacement of bone near the contact points between two sets of motions, mm. A body is ignored for points farther
    /// than `reach` from it.
    pub(super) fn largest_motion(&self, x: &[Vector], from: &[Motion], to: &[Motion], reach: f64) -> f64 {
        let per_point: Vec<f64> = self
            .points
            .par_iter()
            .with_min_len(CONTACT_POINTS_PER_TASK)
            .map(|p| {
                let at = p.at(x);
                let mut largest = 0.0f64;
                for (body, b) in self.bodies.iter().enumerate() {
                    let local = from[body].inverse_transform_point(&at);
                    if from[body] != to[body] && b.solid.value(&local) < reach {
                        largest = largest.max((to[body] * local - at).norm());
                    }
                }
                largest
            })
            .collect();
        per_point.into_iter().fold(0.0, f64::max)
    }

    /// Contact points that have passed to the other side of a body between two states: on a straight line in the body's frame
    /// they entered the solid, and the solid now pushes them the other way. In the order of points; one body for each point.
    pub(super) fn passages(&self, start: Placement<'_>, end: Placement<'_>) -> Vec<Passage> {
        let n = self.bodies.len();
        let passed = |(point, p): (usize, &ContactPoint)| {
            let (from, place) = (p.at(start.x), p.at(end.x));
            let through = |body: usize| {
                let Overlap { shift, rest_mm } = self.overlap[point * n + body];
                // A point that still overlaps at rest has no defined side.
                if rest_mm > 0.0 || self.released[point * n + body] {
                    return None;
                }
                let from_inside = shift != Vector::zeros();
                let from = start.motions[body].inverse_transform_point(&from) + shift;
                let to = end.motions[body].inverse_transform_point(&place) + shift;
                let (length, solid) = ((to - from).norm(), self.bodies[body].solid);
                if length < PASSAGE_SAMPLE_MM || solid.value(&from) > length {
                    return None;
                }
                let normal = |p: &Point| solid.value_gradient(p).1;
                let (out, back) = (normal(&from), normal(&to));
                let is_through = !is_clear(solid, &from, &to) && out.dot(&back) < OPPOSITE_COSINE;
                let round_a_rim = || from_inside || is_round_a_rim(solid, (&from, &to), &(out + back));
                is_through.then(|| Passage { point, body, place, round_a_rim: round_a_rim() })
            };
            (0..n).find_map(through)
        };
        // The order of points does not depend on the number of threads.
        self.points.par_iter().enumerate().with_min_len(CONTACT_POINTS_PER_TASK).filter_map(passed).collect()
    }
}

/// Largest penetration, mm.
pub(super) fn penetration(contacts: &[ContactPair]) -> f64 {
    contacts.iter().map(|t| -t.gap).fold(0.0, f64::max)
}
