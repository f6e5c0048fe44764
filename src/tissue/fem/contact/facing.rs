//! Contact of tissue with tissue: points on each of two sides against the triangles of the other.
//!
//! Each triangle carries a fixed number of points with equal shares of half of its area at rest. The gap of a point is the signed
//! Euclidean distance to the current triangles of the other side, so the force of a point lies along the line to its nearest
//! point: forces and moments of both sides balance exactly. The points of one side integrate their own shape functions exactly
//! and those of the other side up to the spacing of the points; as both sides have half of the area, a uniform pressure passes
//! through unlike meshes (`a_uniform_pressure_passes_through_unlike_meshes` in `fem/tests/facing.rs`).
//!
//! The Euclidean distance is smooth where a penetrating point crosses a valley between triangles; on a ridge the nearest triangle
//! changes, where the energy has no minimum. With averaged normals the energy would have neither property, or forces would not
//! be its gradient. Where a pressed point slides past the rim of the other side, its force ends at once and the energy jumps; what was
//! tried against that stands in `tests/bench/RESULTS.md` under "Lips that part".

use super::boxes::{bounds, widened};
use super::pair::{ContactPair, PairIndex, Target, Terms};
use super::patch::{Nearest, Patch, Shape};
use crate::fem::tuning::{FACING_COSINE, FACING_POINTS_PER_EDGE, FACING_TRIANGLES_PER_TASK, NEAR_MM};
use crate::mesh::MixedMesh;
use prosopon_geometry::Vector;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Points of each triangle.
const POINTS: usize = FACING_POINTS_PER_EDGE * FACING_POINTS_PER_EDGE;

/// A point of a triangle.
#[derive(Debug, Clone, Copy)]
struct FacingPoint {
    nodes: [u32; 3],
    weights: [f64; 3],
    /// Half of its share of the triangle's area at rest, mm².
    area: f64,
    /// Overlap at rest, mm.
    rest_mm: f64,
}

impl FacingPoint {
    fn at(&self, x: &[Vector]) -> Vector {
        let [a, b, c] = self.nodes.map(|n| x[n as usize]);
        a * self.weights[0] + b * self.weights[1] + c * self.weights[2]
    }
}

/// Points of the triangles of one patch against another one.
#[derive(Debug)]
struct Pass {
    own: usize,
    other: usize,
    /// Triangles of the same side that share a node with each own one; empty for distinct sides.
    skipped: Vec<Vec<u32>>,
    /// First of its points.
    first: usize,
}

/// Law of contact at the points: multipliers, MPa, and stiffness, MPa/mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointLaw<'a> {
    pub(super) multipliers: &'a [f64],
    pub(super) stiffness: f64,
    /// Index of the first point.
    pub(super) first_index: usize,
}

/// All tissue that may touch tissue.
#[derive(Debug, Default)]
pub(super) struct FacingTissue {
    patches: Vec<Patch>,
    passes: Vec<Pass>,
    points: Vec<FacingPoint>,
}

/// Nodes of tissue that faces tissue.
pub(in crate::fem) fn facing_nodes(mesh: &MixedMesh) -> Vec<bool> {
    let mut found = vec![false; mesh.positions.len()];
    for node in mesh.facing.iter().flat_map(|f| &f.sides).flatten().flatten() {
        found[*node as usize] = true;
    }
    found
}

impl FacingTissue {
    pub(super) fn new(mesh: &MixedMesh) -> Self {
        let rest: Vec<Vector> = mesh.positions.iter().map(|p| p.coords).collect();
        let mut found = Self::default();
        for facing in &mesh.facing {
            let sets = facing.sides.each_ref().map(|side| side.iter().map(sorted).collect::<BTreeSet<_>>());
            let first = found.patches.len();
            found.patches.extend(facing.sides.iter().map(|side| Patch::new(side, &rest)));
            found.add_pass([first, first + 1], &sets, &rest);
            if sets[0] != sets[1] {
                let [a, b] = sets;
                found.add_pass([first + 1, first], &[b, a], &rest);
            }
        }
        let gaps = found.gaps(&rest);
        for (point, gap) in found.points.iter_mut().zip(gaps) {
            point.rest_mm = (-gap).max(0.0);
        }
        found
    }

    /// `sets` are the triangles of both sides with sorted nodes.
    fn add_pass(&mut self, [own, other]: [usize; 2], sets: &[BTreeSet<[u32; 3]>; 2], rest: &[Vector]) {
        let (mine, theirs) = (&self.patches[own], &self.patches[other]);
        let skipped = |t: &[u32; 3]| {
            let around = theirs.around(t).into_iter();
            let is_of_one_side = |other: &u32| {
                sets[1].contains(&sorted(t)) || sets[0].contains(&sorted(&theirs.triangles[*other as usize]))
            };
            around.filter(is_of_one_side).collect::<Vec<u32>>()
        };
        let skipped: Vec<Vec<u32>> = mine.triangles.iter().map(skipped).collect();
        let first = self.points.len();
        for nodes in &mine.triangles {
            let [a, b, c] = nodes.map(|n| rest[n as usize]);
            let area = 0.25 * (b - a).cross(&(c - a)).norm() / POINTS as f64;
            let at = |weights: [f64; 3]| FacingPoint { nodes: *nodes, weights, area, rest_mm: 0.0 };
            self.points.extend(weights().into_iter().map(at));
        }
        self.passes.push(Pass { own, other, skipped, first });
    }

    pub(super) fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// Area of each point, mm².
    pub(super) fn areas(&self) -> impl Iterator<Item = f64> {
        self.points.iter().map(|p| p.area)
    }

    /// Number of points that overlap at rest by more than `least` mm, and the deepest overlap, mm.
    pub(super) fn overlap_at_rest(&self, least: f64) -> (usize, f64) {
        let deeper = self.points.iter().filter(|p| p.rest_mm > least);
        (deeper.count(), self.points.iter().map(|p| p.rest_mm).fold(0.0, f64::max))
    }

    /// Calls `make` for each point that has tissue of the other side within `reach` mm; results are in the order of points.
    fn each_near<T: Send>(
        &self,
        x: &[Vector],
        reach: f64,
        make: impl Fn(usize, &FacingPoint, &Nearest) -> Option<T> + Sync,
    ) -> Vec<T> {
        let shapes: Vec<Shape> = self.patches.iter().map(|p| p.shape(x)).collect();
        let mut found = Vec::new();
        for pass in &self.passes {
            let (own, other) = (&self.patches[pass.own], &self.patches[pass.other]);
            let (my_shape, shape) = (&shapes[pass.own], &shapes[pass.other]);
            let of_triangle = |t: usize| {
                let outward = my_shape.normals[t];
                let mut candidates = other.near(shape, &widened(bounds(&own.corners(t as u32, x)), reach));
                candidates.retain(|c| outward.dot(&shape.normals[*c as usize]) < FACING_COSINE);
                let first = pass.first + t * POINTS;
                let points = if candidates.is_empty() { first..first } else { first..first + POINTS };
                let make = &make;
                points.filter_map(move |index| {
                    let point = &self.points[index];
                    let nearest = other.nearest(shape, (&candidates, &pass.skipped[t]), &point.at(x), x)?;
                    (nearest.gap.abs() <= reach).then(|| make(index, point, &nearest)).flatten()
                })
            };
            let triangles = (0..own.triangles.len()).into_par_iter().with_min_len(FACING_TRIANGLES_PER_TASK);
            found.extend(triangles.flat_map_iter(of_triangle).collect::<Vec<T>>());
        }
        found
    }

    /// Gap of every point at `x`, mm; infinite where no tissue is near.
    fn gaps(&self, x: &[Vector]) -> Vec<f64> {
        let mut gaps = vec![f64::INFINITY; self.points.len()];
        for (index, gap) in self.each_near(x, NEAR_MM, |index, _, nearest| Some((index, nearest.gap))) {
            gaps[index] = gap;
        }
        gaps
    }

    /// Contacts that are active or whose gap is below `reach` mm, in the order of points.
    pub(super) fn near(&self, x: &[Vector], law: PointLaw<'_>, reach: f64) -> Vec<ContactPair> {
        let pair = |index: usize, point: &FacingPoint, nearest: &Nearest| {
            let gap = nearest.gap + point.rest_mm;
            let pressure = law.multipliers[index] - law.stiffness * gap;
            let own = point.nodes.into_iter().zip(point.weights);
            let other = nearest.nodes.into_iter().zip(nearest.weights).take(nearest.n_nodes);
            (pressure > 0.0 || gap < reach).then(|| ContactPair {
                index: PairIndex { point: law.first_index + index, body: 0 },
                target: Target::Tissue { nodes: nearest.nodes, n_nodes: nearest.n_nodes },
                gap,
                normal: nearest.normal,
                area: point.area,
                stiffness: law.stiffness,
                pressure,
                linearised_pressure: pressure,
                terms: own.chain(other.map(|(n, w)| (n, -w))).collect::<Terms>(),
            })
        };
        self.each_near(x, reach.max(NEAR_MM), pair)
    }

    /// Overlap at rest of a point, mm.
    pub(super) fn rest_mm(&self, index: usize) -> f64 {
        self.points[index].rest_mm
    }

    /// Largest depth, mm, of points that were outside the other side or touched it at `from` and have passed so deep at `to` that
    /// they are no longer found.
    pub(super) fn passage(&self, from: &[Vector], to: &[Vector]) -> Option<f64> {
        let starts = self.each_near(from, NEAR_MM, |index, _, nearest| Some((index, *nearest)));
        let ends = self.gaps(to);
        let depth = |(index, start): &(usize, Nearest)| {
            let point = &self.points[*index];
            let triangle = start.nodes.map(|n| to[n as usize]);
            let normal = (triangle[1] - triangle[0]).cross(&(triangle[2] - triangle[0])).try_normalize(0.0)?;
            let on = (0..3).map(|i| triangle[i] * start.weights[i]).sum::<Vector>();
            let depth = (on - point.at(to)).dot(&normal);
            (ends[*index] == f64::INFINITY && depth > NEAR_MM && depth < 2.0 * NEAR_MM).then_some(depth)
        };
        starts.iter().filter_map(depth).reduce(f64::max)
    }
}

fn sorted(triangle: &[u32; 3]) -> [u32; 3] {
    let mut nodes = *triangle;
    nodes.sort_unstable();
    nodes
}

/// Barycentric weights of a triangle's points: the centres of `n²` equal parts.
///
/// Corners are no points: those of sides that coincide at rest meet corners, where the direction to the nearest point is undefined.
fn weights() -> Vec<[f64; 3]> {
    let n = FACING_POINTS_PER_EDGE;
    let inner = |i: usize, j: usize, up: f64| {
        let (u, v) = ((i as f64 + up) / n as f64, (j as f64 + up) / n as f64);
        [1.0 - u - v, u, v]
    };
    let rows = (0..n).flat_map(|i| (0..n - i).map(move |j| (i, j)));
    let up = rows.clone().map(|(i, j)| inner(i, j, 1.0 / 3.0));
    let down = rows.filter(|(i, j)| i + j + 1 < n).map(|(i, j)| inner(i, j, 2.0 / 3.0));
    up.chain(down).collect()
}
