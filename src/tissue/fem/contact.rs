//! Frictionless unilateral contact of tissue with moved bone, by penalty and augmented Lagrangian (Wang 2009, eq. 0.9 to 0.13).
//!
//! Contact acts at two kinds of points: sliding vertices, and barycentres of bone faces that have a sliding vertex and no free
//! one. They are the quadrature points of eq. 0.13 over the faces at rest: half of a face's area at its barycentre, a sixth at
//! each vertex.
//! A sliding vertex whose faces all have a free corner takes a third of the area of each.
//! With gap `g` (negative inside), multiplier `p` and stiffness `k` the energy per area is `(max(0, p - k g)² - p²) / (2 k)`,
//! which is `k g²/2` for `g < 0` when `p = 0`. The multipliers grow until the penetration is below the tolerance.
//!
//! Tissue that faces tissue (`MixedMesh::facing`) touches by the same law: see `contact/facing.rs`. There both bodies deform.
//!
//! Where the energy is convex enough, the Hessian includes the curvature of the distance. With the Gauss-Newton part `k n nᵀ`
//! alone, points that slide slowly over an edge of bone gain a fifth in each iteration instead of digits.

mod boxes;
mod closest;
mod facing;
mod noncontact_points;
mod overlap;
mod pair;
mod passage;
mod patch;
mod points;
mod stiffness;
mod turning;

pub(super) use facing::facing_nodes;
pub(super) use noncontact_points::{NoncontactPoints, noncontact_points};
pub(super) use overlap::Overlap;
pub(super) use pair::{ContactPair, PairIndex};
pub(super) use passage::Passage;
pub(super) use points::contact_nodes;
pub(super) use stiffness::{Curved, PlacedBlock};

use self::facing::{FacingTissue, PointLaw};
use self::pair::{Target, Terms};
use self::passage::{is_clear, is_round_a_rim};
use self::points::{ContactPoint, contact_points};
use super::compliance::Compliance;
use super::dofs::Dofs;
use super::report::BonePenetration;
use super::settings::ContactBody;
use super::tuning::{
    CONTACT_POINTS_PER_TASK, DEEP_OVERLAP_MM, OPPOSITE_COSINE, PASSAGE_SAMPLE_MM, REPORTED_OVERLAP_MM,
};
use crate::mesh::MixedMesh;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, Point, Vector, Warning};
use rayon::prelude::*;

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
    /// Multipliers by point and body, then by point of facing tissue, MPa.
    multipliers: Vec<f64>,
    /// By point and body: whether the point has slipped round a rim of the body, or through it, so that the body no longer acts
    /// on it.
    released: Vec<bool>,
    /// Tissue that may touch tissue.
    facing: FacingTissue,
    /// Stiffness of contact between tissues relative to that with bone.
    facing_factor: f64,
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
        let mut contact = Self {
            points,
            bodies,
            stiffness,
            overlap: Vec::new(),
            multipliers: Vec::new(),
            released: Vec::new(),
            facing: FacingTissue::default(),
            facing_factor: 1.0,
        };
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

    /// Adds the facing tissue of `mesh`; its contact is `factor` times as stiff as that with bone. Returns a warning about overlap
    /// at rest.
    pub(super) fn add_facing(&mut self, mesh: &MixedMesh, factor: f64) -> Option<Warning> {
        (self.facing, self.facing_factor) = (FacingTissue::new(mesh), factor);
        self.multipliers.resize(self.released.len() + self.facing.len(), 0.0);
        let (overlapping, deepest) = self.facing.overlap_at_rest(REPORTED_OVERLAP_MM);
        (overlapping > 0).then(|| {
            let message = format!(
                "tissue that faces tissue overlaps at rest by {REPORTED_OVERLAP_MM} to {deepest:.2} mm at {overlapping} of {} \
                 points; their gap is measured from that position",
                self.facing.len()
            );
            Warning::check("facing-overlap-at-rest", message).act("Check the two sides of the slit.")
        })
    }

    pub(super) fn is_empty(&self) -> bool {
        (self.points.is_empty() || self.bodies.is_empty()) && self.facing.is_empty()
    }

    /// Whether tissue may touch tissue.
    pub(super) fn has_facing(&self) -> bool {
        !self.facing.is_empty()
    }

    /// Place of a pair in the list of multipliers.
    fn slot(&self, index: PairIndex) -> usize {
        match index.point.checked_sub(self.points.len()) {
            Some(facing) => self.released.len() + facing,
            None => index.point * self.bodies.len() + index.body,
        }
    }

    /// Active contacts at `x` when body `b` has moved by `motions[b]` from rest, in the order of points.
    pub(super) fn active_contacts(&self, x: &[Vector], motions: &[Motion]) -> Vec<ContactPair> {
        self.near(x, motions, f64::NEG_INFINITY)
    }

    /// Contacts that are active or whose gap is below `reach` mm, in the order of points.
    pub(super) fn near(&self, x: &[Vector], motions: &[Motion], reach: f64) -> Vec<ContactPair> {
        let n = self.bodies.len();
        let mut found: Vec<ContactPair> = (self.points.par_iter().enumerate())
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
                    (pressure > 0.0 || gap < reach).then(|| ContactPair {
                        index: PairIndex { point, body },
                        target: Target::Body(body),
                        gap,
                        normal,
                        area: p.area,
                        stiffness: self.stiffness,
                        pressure,
                        linearised_pressure: pressure,
                        terms: p.terms().collect::<Terms>(),
                    })
                })
            })
            .collect();
        if self.has_facing() {
            let law = PointLaw {
                multipliers: &self.multipliers[self.released.len()..],
                stiffness: self.stiffness * self.facing_factor,
                first_index: self.points.len(),
            };
            found.extend(self.facing.near(x, law, reach));
        }
        found
    }

    /// Contact energy, mJ.
    pub(super) fn energy(&self, contacts: &[ContactPair]) -> f64 {
        let n = self.bodies.len();
        let of_body = |t: &&ContactPair| matches!(t.target, Target::Body(_));
        let pushed: f64 = contacts.iter().filter(of_body).map(|t| t.area * t.pressure * t.pressure).sum();
        let (bones, facing) = self.multipliers.split_at(self.released.len());
        let held: f64 = (bones.iter().enumerate()).map(|(i, p)| self.points[i / n].area * p * p).sum();
        let with_bone = (pushed - held) / (2.0 * self.stiffness);
        if !self.has_facing() {
            return with_bone;
        }
        let pushed: f64 = contacts.iter().filter(|t| !of_body(t)).map(|t| t.area * t.pressure * t.pressure).sum();
        let held: f64 = self.facing.areas().zip(facing).map(|(area, p)| area * p * p).sum();
        with_bone + (pushed - held) / (2.0 * self.stiffness * self.facing_factor)
    }

    /// Adds the gradient of the contact energy, at the state of linearisation, to `forces`.
    pub(super) fn add_forces(&self, contacts: &[ContactPair], forces: &mut [Vector]) {
        for t in contacts {
            for (node, weight) in t.terms.iter() {
                forces[node as usize] -= t.normal * (weight * t.area * t.linearised_pressure);
            }
        }
    }

    /// First-order change of the gap of `contact` for a change `d` of the unknowns, mm.
    fn gap_change(contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> f64 {
        (contact.terms.iter())
            .filter_map(|(node, weight)| dofs.unknown(node).map(|u| (3 * u as usize, weight)))
            .map(|(i, weight)| {
                weight * (contact.normal.x * d[i] + contact.normal.y * d[i + 1] + contact.normal.z * d[i + 2])
            })
            .sum()
    }

    /// First-order pressure at `contact` after the unknowns have changed by `d`, MPa.
    pub(super) fn pressure_after(&self, contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> f64 {
        contact.pressure - contact.stiffness * Self::gap_change(contact, dofs, d)
    }

    /// A contact found after the unknowns have changed by `d`, extrapolated back linearly to the state before that change.
    pub(super) fn without_change(&self, contact: &ContactPair, dofs: &Dofs, d: &[f64]) -> ContactPair {
        let change = Self::gap_change(contact, dofs, d);
        ContactPair { gap: contact.gap - change, pressure: contact.pressure + contact.stiffness * change, ..*contact }
    }

    /// Unknown nodes that the contacts act on; nodes may repeat.
    pub(super) fn unknowns_of(&self, contacts: &[ContactPair], dofs: &Dofs) -> impl Iterator<Item = u32> {
        contacts.iter().flat_map(|t| t.terms.iter()).filter_map(|(node, _)| dofs.unknown(node))
    }

    /// Contact forces on the nodes of `compliance`, N; `None` when `compliance` lacks a node.
    pub(super) fn forces_at(&self, contacts: &[ContactPair], dofs: &Dofs, compliance: &Compliance) -> Option<Vec<f64>> {
        let mut forces = vec![0.0; compliance.len()];
        for t in contacts {
            for (node, weight) in t.terms.iter() {
                let Some(unknown) = dofs.unknown(node) else { continue };
                let place = compliance.place(unknown)?;
                for axis in (0..3).filter(|&axis| dofs.axes_of(node as usize) >> axis & 1 == 0) {
                    forces[place + axis] += t.normal[axis] * (weight * t.area * t.pressure);
                }
            }
        }
        Some(forces)
    }

    /// Force of each body on the tissue, N.
    pub(super) fn forces_by_body(&self, contacts: &[ContactPair]) -> Vec<Vector> {
        let mut forces = vec![Vector::zeros(); self.bodies.len()];
        for t in contacts {
            match t.target {
                Target::Body(body) => forces[body] += t.normal * (t.area * t.pressure),
                Target::Tissue { .. } => {}
            }
        }
        forces
    }

    /// Augmented Lagrangian update: the current pressures become the multipliers.
    pub(super) fn augment(&mut self, contacts: &[ContactPair]) {
        self.multipliers.fill(0.0);
        for t in contacts {
            let slot = self.slot(t.index);
            self.multipliers[slot] = t.pressure;
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

    /// Depth, mm, to which facing tissue has passed through its other side between two states, too deep for contact to act.
    pub(super) fn facing_passage(&self, from: &[Vector], to: &[Vector]) -> Option<f64> {
        if self.has_facing() { self.facing.passage(from, to) } else { None }
    }

    /// Contact points that have passed to the other side of a body between two states: on a straight line in the body's frame
    /// they entered the solid, and the solid now pushes them the other way. In the order of points; one body for each point. When
    /// `control` cancels, some are missing.
    pub(super) fn passages(&self, start: Placement<'_>, end: Placement<'_>, control: &Control) -> Vec<Passage> {
        let n = self.bodies.len();
        let passed = |(point, p): (usize, &ContactPoint)| {
            if control.is_cancelled() {
                return None;
            }
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

/// Largest penetration that the tolerance is compared with, mm: between its points, tissue on tissue may lie deeper.
pub(super) fn tested_penetration(contacts: &[ContactPair]) -> f64 {
    contacts.iter().map(|t| t.share_of_tolerance() * -t.gap).fold(0.0, f64::max)
}
