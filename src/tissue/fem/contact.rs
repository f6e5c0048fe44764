//! Frictionless unilateral contact of tissue with moved bone, by penalty and augmented Lagrangian (Wang 2009, eq. 0.9 to 0.13).
//!
//! A contact point is a sliding vertex, or the barycentre of a bone face with at least one sliding vertex and no free one. They
//! are the quadrature points of eq. 0.13 over the faces at rest: half of a face's area at its barycentre, a sixth at each vertex.
//! A sliding vertex whose faces all have a free corner takes a third of the area of each.
//! With gap `g` (negative inside), multiplier `p` and stiffness `k` the energy per area is `(max(0, p - k g)² - p²) / (2 k)`,
//! which is `k g²/2` for `g < 0` when `p = 0`. The multipliers grow until the penetration is below the tolerance.
//! Where the energy is convex enough, the Hessian includes the curvature of the distance. With the Gauss-Newton part `k n nᵀ`
//! alone, points that slide slowly over an edge of bone gain a fifth in each iteration instead of digits.

mod overlap;
mod passage;
mod unguarded;

pub(super) use passage::Passage;
pub(super) use unguarded::{Unguarded, unguarded_points};

use super::tuning::{CONTACT_POINTS_PER_TASK, OPPOSITE_COSINE, PASSAGE_SAMPLE_MM, REPORTED_OVERLAP_MM};
use self::overlap::Overlap;
use self::passage::{is_clear, is_round_a_rim};
use super::compliance::{Compliance, RankOne};
use super::axes::axes_in;
use super::dofs::Dofs;
use super::report::Sunk;
use super::settings::ContactBody;
use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Motion, Point, Vector};
use rayon::prelude::*;

/// A point of the tissue's inner surface, as a weighted mean of nodes.
#[derive(Debug, Clone, Copy)]
struct ContactPoint {
    nodes: [u32; 3],
    weights: [f64; 3],
    /// Share of the surface area at rest, mm².
    area: f64,
    /// Direction into the tissue at rest; not a unit vector.
    inward: Vector,
}

impl ContactPoint {
    fn at(&self, x: &[Vector]) -> Point {
        let [a, b, c] = self.nodes.map(|n| x[n as usize]);
        Point::from(a * self.weights[0] + b * self.weights[1] + c * self.weights[2])
    }

    /// Nodes with positive weight, each once, and their weights.
    fn terms(&self) -> impl Iterator<Item = (u32, f64)> {
        (0..3).map(|i| (self.nodes[i], self.weights[i])).filter(|(_, w)| *w > 0.0)
    }
}

/// A contact point paired with a body that it touches or is near to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touch {
    point: usize,
    body: usize,
    /// Signed gap, mm, after subtraction of the overlap at rest.
    gap: f64,
    /// Gradient of the gap with respect to the point.
    normal: Vector,
    /// `p - k g`, MPa; the contact is active where this is positive.
    pressure: f64,
    /// Pressure at the state of linearisation, MPa.
    met: f64,
}

impl Touch {
    /// Indices of contact point and body.
    pub(super) fn pair(&self) -> (usize, usize) {
        (self.point, self.body)
    }

    /// Signed gap, mm.
    pub(super) fn gap(&self) -> f64 {
        self.gap
    }

    /// Whether the contact is active.
    pub(super) fn pushes(&self) -> bool {
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
    pub(super) fn new(mesh: &MixedMesh, bodies: Vec<ContactBody<'a>>, stiffness: f64) -> (Self, Option<String>) {
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
            format!(
                "{overlapping} of {} contact points lie {REPORTED_OVERLAP_MM} to {deepest:.2} mm inside bone at rest; their gap is \
                 measured from that position",
                contact.points.len()
            )
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
    pub(super) fn touches(&self, x: &[Vector], motions: &[Motion]) -> Vec<Touch> {
        self.near(x, motions, f64::NEG_INFINITY)
    }

    /// Contacts that are active or whose gap is below `reach` mm, in the order of points.
    pub(super) fn near(&self, x: &[Vector], motions: &[Motion], reach: f64) -> Vec<Touch> {
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
                    (pressure > 0.0 || gap < reach).then_some(Touch {
                        point,
                        body,
                        gap,
                        normal,
                        pressure,
                        met: pressure,
                    })
                })
            })
            .collect()
    }

    /// Contact energy, mJ.
    pub(super) fn energy(&self, touches: &[Touch]) -> f64 {
        let n = self.bodies.len();
        let pushed: f64 = touches.iter().map(|t| self.points[t.point].area * t.pressure * t.pressure).sum();
        let held: f64 = (self.multipliers.iter().enumerate()).map(|(i, p)| self.points[i / n].area * p * p).sum();
        (pushed - held) / (2.0 * self.stiffness)
    }

    /// Adds the gradient of the contact energy, at the state of linearisation, to `forces`.
    pub(super) fn add_forces(&self, touches: &[Touch], forces: &mut [Vector]) {
        for t in touches {
            let p = &self.points[t.point];
            for (node, weight) in p.terms() {
                forces[node as usize] -= t.normal * (weight * p.area * t.met);
            }
        }
    }

    /// First-order change of the gap of `touch` for a change `d` of the unknowns, mm.
    fn gap_change(&self, touch: &Touch, dofs: &Dofs, d: &[f64]) -> f64 {
        (self.points[touch.point].terms())
            .filter_map(|(node, weight)| dofs.unknown(node).map(|u| (3 * u as usize, weight)))
            .map(|(i, weight)| weight * (touch.normal.x * d[i] + touch.normal.y * d[i + 1] + touch.normal.z * d[i + 2]))
            .sum()
    }

    /// First-order pressure at `touch` after the unknowns have changed by `d`, MPa.
    pub(super) fn pressure_after(&self, touch: &Touch, dofs: &Dofs, d: &[f64]) -> f64 {
        touch.pressure - self.stiffness * self.gap_change(touch, dofs, d)
    }

    /// A contact found after the unknowns have changed by `d`, extrapolated back linearly to the state before that change.
    pub(super) fn without_change(&self, touch: &Touch, dofs: &Dofs, d: &[f64]) -> Touch {
        let change = self.gap_change(touch, dofs, d);
        Touch { gap: touch.gap - change, pressure: touch.pressure + self.stiffness * change, ..*touch }
    }

    /// Unknown nodes that the contacts act on; nodes may repeat.
    pub(super) fn unknowns_of(&self, touches: &[Touch], dofs: &Dofs) -> impl Iterator<Item = u32> {
        touches.iter().flat_map(|t| self.points[t.point].terms()).filter_map(|(node, _)| dofs.unknown(node))
    }

    /// Contact forces on the nodes of `compliance`, N; `None` when `compliance` lacks a node.
    pub(super) fn forces_at(&self, touches: &[Touch], dofs: &Dofs, compliance: &Compliance) -> Option<Vec<f64>> {
        let mut forces = vec![0.0; compliance.len()];
        for t in touches {
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
        touches: &[Touch],
        curved: Option<Curved<'_>>,
        dofs: &Dofs,
        mut add: impl FnMut(u32, u32, &nalgebra::Matrix3<f64>),
    ) {
        for t in touches {
            let p = &self.points[t.point];
            let mut block = t.normal * t.normal.transpose() * (self.stiffness * p.area);
            if let Some(Curved { x, motions, share }) = curved {
                block -= self.bend(t, x, motions) * share;
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
    fn bend(&self, touch: &Touch, x: &[Vector], motions: &[Motion]) -> nalgebra::Matrix3<f64> {
        let p = &self.points[touch.point];
        let motion = &motions[touch.body];
        let shift = self.overlap[touch.point * self.bodies.len() + touch.body].shift;
        let curvature = self.bodies[touch.body].solid.hessian(&(motion.inverse_transform_point(&p.at(x)) + shift));
        let r = motion.rotation.to_rotation_matrix();
        r.matrix() * curvature * r.matrix().transpose() * (touch.met.max(0.0) * p.area)
    }

    /// Curvature terms of the contacts at the nodes of `compliance`: row, column and the block to subtract from the Hessian.
    pub(super) fn bends(
        &self,
        touches: &[Touch],
        Curved { x, motions, share }: Curved<'_>,
        dofs: &Dofs,
        compliance: &Compliance,
    ) -> Vec<(usize, usize, nalgebra::Matrix3<f64>)> {
        let of_touch = |t: &Touch| {
            let (p, block) = (self.points[t.point], self.bend(t, x, motions) * share);
            let mut placed = Vec::with_capacity(9);
            for (a, wa) in p.terms() {
                for (b, wb) in p.terms() {
                    let place = |node: u32| compliance.place(dofs.unknown(node)?);
                    if let (Some(row), Some(column)) = (place(a), place(b)) {
                        let mut block = block * (wa * wb);
                        axes_in(dofs.axes_of(a as usize)).for_each(|axis| block.row_mut(axis).fill(0.0));
                        axes_in(dofs.axes_of(b as usize)).for_each(|axis| block.column_mut(axis).fill(0.0));
                        placed.push((row, column, block));
                    }
                }
            }
            placed
        };
        touches.par_iter().with_min_len(CONTACT_POINTS_PER_TASK).flat_map_iter(of_touch).collect()
    }

    /// The Gauss-Newton part of the Hessian as rank-one terms, one for each contact.
    pub(super) fn terms(&self, touches: &[Touch], dofs: &Dofs) -> Vec<RankOne> {
        let term = |t: &Touch| {
            let p = &self.points[t.point];
            let nodes = p.terms().filter_map(|(node, weight)| {
                let mut entry = t.normal * weight;
                axes_in(dofs.axes_of(node as usize)).for_each(|axis| entry[axis] = 0.0);
                dofs.unknown(node).map(|u| (u, entry))
            });
            RankOne { nodes: nodes.collect(), factor: self.stiffness * p.area }
        };
        touches.iter().map(term).collect()
    }

    /// Force of each body on the tissue, N.
    pub(super) fn forces_by_body(&self, touches: &[Touch]) -> Vec<Vector> {
        let mut forces = vec![Vector::zeros(); self.bodies.len()];
        for t in touches {
            forces[t.body] += t.normal * (self.points[t.point].area * t.pressure);
        }
        forces
    }

    /// Augmented Lagrangian update: the current pressures become the multipliers.
    pub(super) fn augment(&mut self, touches: &[Touch]) {
        let n = self.bodies.len();
        self.multipliers.fill(0.0);
        for t in touches {
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
    pub(super) fn sunk(&self, x: &[Vector], motions: &[Motion]) -> Option<Sunk> {
        let n = self.bodies.len();
        let mut deepest: Option<Sunk> = None;
        for (pair, _) in self.released.iter().enumerate().filter(|(_, released)| **released) {
            let (point, body) = (pair / n, pair % n);
            let place = self.points[point].at(x);
            let Overlap { shift, rest_mm } = self.overlap[pair];
            let b = &self.bodies[body];
            let depth_mm = -rest_mm - b.solid.value(&(motions[body].inverse_transform_point(&place) + shift));
            if depth_mm > 0.0 {
                let points = 1 + deepest.map_or(0, |d| d.points);
                let is_deepest = deepest.is_none_or(|d| depth_mm > d.depth_mm);
                let found =
                    if is_deepest { Some(Sunk { depth_mm, segment: b.segment, place, points }) } else { deepest };
                deepest = found.map(|d| Sunk { points, ..d });
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
    pub(super) fn passages(&self, x: (&[Vector], &[Vector]), motions: (&[Motion], &[Motion])) -> Vec<Passage> {
        let n = self.bodies.len();
        let passed = |(point, p): (usize, &ContactPoint)| {
            let (from, place) = (p.at(x.0), p.at(x.1));
            let through = |body: usize| {
                let Overlap { shift, rest_mm } = self.overlap[point * n + body];
                // A point that still overlaps at rest has no defined side.
                if rest_mm > 0.0 || self.released[point * n + body] {
                    return None;
                }
                let from_inside = shift != Vector::zeros();
                let from = motions.0[body].inverse_transform_point(&from) + shift;
                let to = motions.1[body].inverse_transform_point(&place) + shift;
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
pub(super) fn penetration(touches: &[Touch]) -> f64 {
    touches.iter().map(|t| -t.gap).fold(0.0, f64::max)
}

/// Mesh nodes that contact can act on.
pub(super) fn contact_nodes(mesh: &MixedMesh) -> Vec<bool> {
    let mut found = vec![false; mesh.positions.len()];
    for point in contact_points(mesh) {
        for (node, _) in point.terms() {
            found[node as usize] = true;
        }
    }
    found
}

fn contact_points(mesh: &MixedMesh) -> Vec<ContactPoint> {
    let sliding = |n: u32| mesh.attachment[n as usize] == Attachment::Sliding;
    let free = |n: u32| mesh.attachment[n as usize] == Attachment::Free;
    let (mut vertex_area, mut vertex_inward) =
        (vec![0.0; mesh.positions.len()], vec![Vector::zeros(); mesh.positions.len()]);
    let inward_of = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|n| mesh.positions[n as usize]);
        (c - a).cross(&(b - a))
    };
    let mut points = Vec::new();
    let (whole, edge): (Vec<&[u32; 3]>, Vec<&[u32; 3]>) = (mesh.bone_faces.iter())
        .filter(|face| face.iter().any(|&n| sliding(n)))
        .partition(|face| !face.iter().any(|&n| free(n)));
    for face in whole {
        let inward = inward_of(face);
        let area = 0.5 * inward.norm();
        points.push(ContactPoint { nodes: *face, weights: [1.0 / 3.0; 3], area: 0.5 * area, inward });
        for &n in face {
            vertex_inward[n as usize] += inward;
            vertex_area[n as usize] += area / 6.0;
        }
    }
    // A vertex whose faces all have a free corner takes its share of those faces only.
    let mut alone: Vec<(usize, Vector)> = Vec::new();
    for face in edge {
        for &n in face.iter().filter(|n| sliding(**n) && vertex_area[**n as usize] == 0.0) {
            alone.push((n as usize, inward_of(face)));
        }
    }
    for (node, inward) in alone {
        vertex_inward[node] += inward;
        vertex_area[node] += inward.norm() / 6.0;
    }
    for (node, &area) in vertex_area.iter().enumerate() {
        if area > 0.0 && sliding(node as u32) {
            let inward = vertex_inward[node];
            points.push(ContactPoint { nodes: [node as u32; 3], weights: [1.0, 0.0, 0.0], area, inward });
        }
    }
    points
}
