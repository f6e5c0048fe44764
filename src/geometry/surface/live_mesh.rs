//! A triangle mesh under edge collapse that bounds its distance from the input vertices.

use super::parts::submesh;
use super::point_triangle::distance_sq;
use crate::trimesh::scaled_normal;
use crate::{Point, TriMesh, Vector};

const NONE: u32 = u32::MAX;

/// Smallest cosine of the angle by which a collapse may turn a triangle; about 75°.
const MIN_COS: f64 = 0.25;

/// Smallest [`quality`] of a new triangle (1 is equilateral), unless a triangle that it replaces is worse.
const MIN_QUALITY: f64 = 0.15;

pub(super) struct LiveMesh {
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
    alive: Vec<bool>,
    n_alive: usize,
    fixed: Vec<bool>,
    corners: CornerLists,
    /// Input vertices; each triangle has a linked list of the samples nearest to it.
    samples: Vec<Point>,
    first_sample: Vec<u32>,
    next_sample: Vec<u32>,
    scratch: Scratch,
}

/// For each vertex a linked list of its triangle corners `3 triangle + i`; corners of dead triangles are skipped.
struct CornerLists {
    first: Vec<u32>,
    last: Vec<u32>,
    next: Vec<u32>,
}

/// Buffers of one collapse.
#[derive(Default)]
struct Scratch {
    around_u: Vec<u32>,
    around_v: Vec<u32>,
    other: Vec<u32>,
    link_u: Vec<u32>,
    link_v: Vec<u32>,
    /// Remaining triangles around the edge.
    changed: Vec<Changed>,
    /// Pairs of a sample and the index in `changed` of the triangle nearest to it.
    moved: Vec<(u32, u32)>,
}

/// A triangle with the corners that it would have.
struct Changed {
    triangle: u32,
    corners: [Point; 3],
    /// Of twice the area.
    normal: Vector,
    normal_sq: f64,
}

impl LiveMesh {
    /// Vertices that are `fixed` have no part in collapses that the caller tries.
    pub(super) fn new(mesh: &TriMesh, fixed: Vec<bool>) -> Self {
        let (n, m) = (mesh.positions().len(), mesh.triangles().len());
        let mut first_sample = vec![NONE; m];
        let mut next_sample = vec![NONE; n];
        let mut sampled = vec![false; n];
        let mut corners = CornerLists { first: vec![NONE; n], last: vec![NONE; n], next: vec![NONE; 3 * m] };
        for (t, triangle) in mesh.triangles().iter().enumerate() {
            for (i, &v) in triangle.iter().enumerate() {
                corners.append(v, (3 * t + i) as u32);
                if !sampled[v as usize] {
                    sampled[v as usize] = true;
                    next_sample[v as usize] = first_sample[t];
                    first_sample[t] = v;
                }
            }
        }
        Self {
            positions: mesh.positions().to_vec(),
            triangles: mesh.triangles().to_vec(),
            alive: vec![true; m],
            n_alive: m,
            fixed,
            corners,
            samples: mesh.positions().to_vec(),
            first_sample,
            next_sample,
            scratch: Scratch::default(),
        }
    }

    /// Joins parts of a mesh, each with the vertex of the whole mesh for each of its vertices.
    ///
    /// `positions` and `fixed` are those of the whole mesh; vertices of several parts must have the same position in each.
    pub(super) fn joined(
        mut positions: Vec<Point>,
        fixed: Vec<bool>,
        parts: impl IntoIterator<Item = (Vec<u32>, Self)>,
    ) -> Self {
        let n = positions.len();
        let (mut triangles, mut samples) = (Vec::new(), Vec::new());
        let (mut first_sample, mut next_sample) = (Vec::new(), Vec::new());
        for (vertices, part) in parts {
            for (&v, p) in vertices.iter().zip(&part.positions) {
                positions[v as usize] = *p;
            }
            for t in (0..part.triangles.len()).filter(|&t| part.alive[t]) {
                triangles.push(part.triangles[t].map(|v| vertices[v as usize]));
                let mut first = NONE;
                let mut sample = part.first_sample[t];
                while sample != NONE {
                    next_sample.push(std::mem::replace(&mut first, samples.len() as u32));
                    samples.push(part.samples[sample as usize]);
                    sample = part.next_sample[sample as usize];
                }
                first_sample.push(first);
            }
        }
        let m = triangles.len();
        let mut corners = CornerLists { first: vec![NONE; n], last: vec![NONE; n], next: vec![NONE; 3 * m] };
        for (corner, &v) in triangles.as_flattened().iter().enumerate() {
            corners.append(v, corner as u32);
        }
        let (alive, scratch) = (vec![true; m], Scratch::default());
        Self { positions, triangles, alive, n_alive: m, fixed, corners, samples, first_sample, next_sample, scratch }
    }

    /// Directed edges of the live triangles.
    pub(super) fn edges(&self) -> impl Iterator<Item = [u32; 2]> {
        let live = self.triangles.iter().zip(&self.alive).filter(|(_, alive)| **alive);
        live.flat_map(|([a, b, c], _)| [[*a, *b], [*b, *c], [*c, *a]])
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.n_alive
    }

    pub(super) fn position(&self, v: u32) -> Point {
        self.positions[v as usize]
    }

    pub(super) fn is_fixed(&self, v: u32) -> bool {
        self.fixed[v as usize]
    }

    /// Vertices that share an edge with `v`.
    pub(super) fn neighbours(&mut self, v: u32) -> Vec<u32> {
        let mut around = Vec::new();
        self.corners.collect(v, &self.alive, &mut around);
        around.iter().map(|&c| self.following(c)).collect()
    }

    /// Merges `u` into `v` and moves `v` to `target`; returns whether it did.
    ///
    /// Returns false and changes nothing when the collapse would change the topology, turn a triangle too far or make it too
    /// thin, or leave a sample farther than `max_error` (mm) from the new triangles.
    pub(super) fn collapse(&mut self, u: u32, v: u32, target: &Point, max_error: f64) -> bool {
        let mut s = std::mem::take(&mut self.scratch);
        let done = self.keeps_topology(u, v, &mut s)
            && self.keeps_shape(u, v, target, &mut s)
            && self.keeps_distance(u, max_error, &mut s);
        if done {
            self.apply(u, v, target, &s);
        }
        self.scratch = s;
        done
    }

    /// The vertex that follows `corner` in its triangle.
    fn following(&self, corner: u32) -> u32 {
        let i = corner % 3;
        self.triangles[(corner / 3) as usize][if i == 2 { 0 } else { i as usize + 1 }]
    }

    /// Link condition: the two ends have exactly two common neighbours, those opposite the edge.
    ///
    /// Each of these two must also keep at least three triangles.
    fn keeps_topology(&mut self, u: u32, v: u32, s: &mut Scratch) -> bool {
        self.corners.collect(u, &self.alive, &mut s.around_u);
        self.corners.collect(v, &self.alive, &mut s.around_v);
        s.link_u.clear();
        s.link_u.extend(s.around_u.iter().map(|&c| self.following(c)));
        s.link_v.clear();
        s.link_v.extend(s.around_v.iter().map(|&c| self.following(c)));
        let mut common = s.link_u.iter().filter(|w| s.link_v.contains(w));
        let (Some(&a), Some(&b), None) = (common.next(), common.next(), common.next()) else { return false };
        s.link_u.contains(&v) && [a, b].into_iter().all(|w| self.corners.collect(w, &self.alive, &mut s.other) > 3)
    }

    fn keeps_shape(&self, u: u32, v: u32, target: &Point, s: &mut Scratch) -> bool {
        s.changed.clear();
        let mut worst_before = f64::MAX;
        let mut worst_after = f64::MAX;
        for &corner in s.around_u.iter().chain(&s.around_v) {
            let t = corner / 3;
            let triangle = self.triangles[t as usize];
            let before = triangle.map(|w| self.positions[w as usize]);
            worst_before = worst_before.min(quality(&before));
            if triangle.contains(&u) && triangle.contains(&v) {
                continue;
            }
            let mut after = before;
            after[(corner % 3) as usize] = *target;
            let (m, n) = (scaled_normal(&before), scaled_normal(&after));
            if m.dot(&n) <= MIN_COS * m.norm() * n.norm() {
                return false;
            }
            worst_after = worst_after.min(quality(&after));
            s.changed.push(Changed { triangle: t, corners: after, normal: n, normal_sq: n.norm_squared() });
        }
        worst_after >= MIN_QUALITY.min(worst_before)
    }

    fn keeps_distance(&self, u: u32, max_error: f64, s: &mut Scratch) -> bool {
        s.moved.clear();
        let max_sq = max_error * max_error;
        // Triangles at the edge are in both fans; this visits them once.
        let once = |c: &&u32| !self.triangles[(**c / 3) as usize].contains(&u);
        for &corner in s.around_u.iter().chain(s.around_v.iter().filter(once)) {
            let mut sample = self.first_sample[(corner / 3) as usize];
            while sample != NONE {
                let p = &self.samples[sample as usize];
                let mut best = (f64::MAX, 0);
                for (index, Changed { corners: [a, b, c], normal, normal_sq, .. }) in s.changed.iter().enumerate() {
                    // No point of a triangle is nearer than its plane.
                    if normal.dot(&(p - a)).powi(2) > best.0 * normal_sq {
                        continue;
                    }
                    let d = distance_sq(p, a, b, c);
                    if d < best.0 {
                        best = (d, index as u32);
                    }
                }
                if best.0 > max_sq {
                    return false;
                }
                s.moved.push((sample, best.1));
                sample = self.next_sample[sample as usize];
            }
        }
        true
    }

    fn apply(&mut self, u: u32, v: u32, target: &Point, s: &Scratch) {
        for &corner in s.around_u.iter().chain(&s.around_v) {
            self.first_sample[(corner / 3) as usize] = NONE;
        }
        for &corner in &s.around_u {
            let t = (corner / 3) as usize;
            if self.triangles[t].contains(&v) {
                self.alive[t] = false;
                self.n_alive -= 1;
            }
            self.triangles[t][(corner % 3) as usize] = v;
        }
        self.positions[v as usize] = *target;
        self.corners.append_all(v, u);
        for &(sample, index) in &s.moved {
            let t = s.changed[index as usize].triangle as usize;
            self.next_sample[sample as usize] = self.first_sample[t];
            self.first_sample[t] = sample;
        }
    }

    /// The simplified mesh, and the largest distance of a sample from the triangle that lists it, mm.
    pub(super) fn finish(self) -> Option<(TriMesh, f64)> {
        let mut max_sq = 0.0f64;
        let kept: Vec<u32> = (0..self.triangles.len() as u32).filter(|&t| self.alive[t as usize]).collect();
        for &t in &kept {
            let [a, b, c] = self.triangles[t as usize].map(|v| self.positions[v as usize]);
            let mut sample = self.first_sample[t as usize];
            while sample != NONE {
                max_sq = max_sq.max(distance_sq(&self.samples[sample as usize], &a, &b, &c));
                sample = self.next_sample[sample as usize];
            }
        }
        let mesh = TriMesh::new(self.positions, self.triangles).ok()?;
        Some((submesh(&mesh, &kept)?, max_sq.sqrt()))
    }
}

impl CornerLists {
    fn append(&mut self, v: u32, corner: u32) {
        let last = std::mem::replace(&mut self.last[v as usize], corner);
        if last == NONE {
            self.first[v as usize] = corner;
        } else {
            self.next[last as usize] = corner;
        }
    }

    /// Moves the list of `u` to the end of the list of `v`.
    fn append_all(&mut self, v: u32, u: u32) {
        let (first, last) = (self.first[u as usize], self.last[u as usize]);
        if first != NONE {
            self.append(v, first);
            self.last[v as usize] = last;
        }
        (self.first[u as usize], self.last[u as usize]) = (NONE, NONE);
    }

    /// Fills `found` with the live corners of `v`, drops dead ones from the list, and returns the number of live corners.
    fn collect(&mut self, v: u32, alive: &[bool], found: &mut Vec<u32>) -> usize {
        found.clear();
        let mut at = self.first[v as usize];
        (self.first[v as usize], self.last[v as usize]) = (NONE, NONE);
        while at != NONE {
            let next = std::mem::replace(&mut self.next[at as usize], NONE);
            if alive[(at / 3) as usize] {
                found.push(at);
                self.append(v, at);
            }
            at = next;
        }
        found.len()
    }
}

/// Area divided by the sum of the squared edges, scaled to 1 for an equilateral triangle.
fn quality(corners: &[Point; 3]) -> f64 {
    let [a, b, c] = corners;
    let edges_sq = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
    if edges_sq > 0.0 { 2.0 * 3f64.sqrt() * scaled_normal(corners).norm() / edges_sq } else { 0.0 }
}
