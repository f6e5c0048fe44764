//! Two blocks of tissue, one on the other, and the overlap of two surfaces.

use super::blocks::Slab;
use crate::fem::Boundary;
use crate::mesh::{Facing, MixedMesh, boundary_triangles};
use prosopon_geometry::{Point, Vector};

/// Two blocks without common nodes whose facing surfaces may touch.
pub(super) struct Pair {
    pub(super) mesh: MixedMesh,
    /// Nodes of the lower block; they come first.
    pub(super) n_lower: usize,
    blocks: [Slab; 2],
}

impl Pair {
    pub(super) fn new(lower: Slab, upper: Slab) -> Self {
        let (mut mesh, above) = (lower.mesh(), upper.mesh());
        let n_lower = mesh.positions.len();
        let shift = n_lower as u32;
        let layers = lower.cells[2] + 1 + usize::from(lower.skin > 0.0);
        let is_top = |t: &[u32; 3]| t.iter().all(|n| *n as usize % layers == layers - 1);
        let top: Vec<[u32; 3]> = boundary_triangles(&mesh).into_iter().filter(is_top).collect();
        assert_eq!(top.len(), 2 * lower.cells[0] * lower.cells[1]);
        mesh.positions.extend(&above.positions);
        mesh.attachment.extend(&above.attachment);
        mesh.tetrahedra.extend(above.tetrahedra.iter().map(|t| t.map(|n| n + shift)));
        mesh.tetrahedron_tissue.extend(&above.tetrahedron_tissue);
        mesh.prisms.extend(above.prisms.iter().map(|p| p.map(|n| n + shift)));
        let bottom = above.bone_faces.iter().map(|t| t.map(|n| n + shift)).collect();
        mesh.bone_faces.clear();
        mesh.facing = vec![Facing { sides: [top, bottom] }];
        Self { mesh, n_lower, blocks: [lower, upper] }
    }

    /// A block and its mirror image on top of it.
    pub(super) fn mirrored(lower: Slab) -> Self {
        let top = lower.origin[2] + lower.size[2];
        let mut pair = Self::new(lower, Slab { origin: [lower.origin[0], lower.origin[1], top], ..lower });
        let MixedMesh { positions, tetrahedra, facing, .. } = &mut pair.mesh;
        let (below, above) = positions.split_at_mut(pair.n_lower);
        for (p, q) in above.iter_mut().zip(below.iter()) {
            *p = Point::new(q.x, q.y, 2.0 * top - q.z);
        }
        let n = tetrahedra.len() / 2;
        tetrahedra[n..].iter_mut().for_each(|t| t.swap(1, 2));
        // The top of the mirrored block's numbering is its bottom.
        facing[0].sides[1] =
            facing[0].sides[0].iter().map(|[a, b, c]| [*a, *c, *b].map(|i| i + pair.n_lower as u32)).collect();
        pair
    }

    /// Moves nodes inside the blocks and inside their facing surfaces along these by `share` of a cell.
    pub(super) fn crook(&mut self, share: f64) {
        for (i, p) in self.mesh.positions.iter_mut().enumerate() {
            let slab = self.blocks[usize::from(i >= self.n_lower)];
            let shake = Vector::new((3.1 * i as f64).sin(), (5.3 * i as f64).sin(), (7.7 * i as f64).sin()) * share;
            for axis in 0..3 {
                let at = (p[axis] - slab.origin[axis]) / slab.size[axis];
                let inside = at > 1e-9 && at < 1.0 - 1e-9;
                if inside {
                    p[axis] += shake[axis] * slab.size[axis] / slab.cells[axis] as f64;
                }
            }
        }
    }

    /// Curves the facing surfaces away from each other by up to `by` mm.
    pub(super) fn round(&mut self, by: f64) {
        for (i, p) in self.mesh.positions.iter_mut().enumerate() {
            let is_upper = i >= self.n_lower;
            let slab = self.blocks[usize::from(is_upper)];
            let share = |axis: usize| 2.0 * (p[axis] - slab.origin[axis]) / slab.size[axis] - 1.0;
            let height = (p.z - slab.origin[2]) / slab.size[2];
            let out = by * (share(0).powi(2) + share(1).powi(2));
            p.z += if is_upper { out * (1.0 - height) } else { -out * height };
        }
    }

    /// Planes of symmetry x = 0, y = 0 and z = 0; the top goes down by `by` mm.
    pub(super) fn compressed(&self, by: f64) -> Boundary {
        let top = self.mesh.positions.iter().map(|p| p.z).fold(0.0, f64::max);
        let is_top = |p: &Point| p.z > top - 1e-9;
        let axes = |p: &Point| {
            u8::from(p.x.abs() < 1e-9) + 2 * u8::from(p.y.abs() < 1e-9) + 4 * u8::from(p.z.abs() < 1e-9 || is_top(p))
        };
        let moved = |p: &Point| if is_top(p) { -Vector::z() * by } else { Vector::zeros() };
        Boundary {
            held_axes: self.mesh.positions.iter().map(axes).collect(),
            prescribed_mm: self.mesh.positions.iter().map(moved).collect(),
            ..Boundary::default()
        }
    }

    /// The mesh with nodes at the same place merged, without facing surfaces.
    pub(super) fn glued(&self) -> MixedMesh {
        let mut mesh = self.mesh.clone();
        let (lower, upper) = self.mesh.positions.split_at(self.n_lower);
        let mut kept: Vec<Point> = lower.to_vec();
        let mut number: Vec<u32> = (0..self.n_lower as u32).collect();
        for p in upper {
            let known = lower.iter().position(|q| (q - p).norm() < 1e-9);
            number.push(known.unwrap_or(kept.len()) as u32);
            if known.is_none() {
                kept.push(*p);
            }
        }
        mesh.attachment.truncate(kept.len());
        mesh.positions = kept;
        mesh.tetrahedra.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
        mesh.prisms.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
        mesh.facing.clear();
        mesh
    }
}

/// Largest depth, mm, of points of one side in the tissue of the other: `n²` points on each facing triangle, vertices included,
/// beyond the overlap at rest. A point is inside when it lies below a triangle of the other side that it projects on.
pub(super) fn overlap_mm(mesh: &MixedMesh, now: &[Point], n: usize) -> f64 {
    let mut deepest = 0.0f64;
    for facing in &mesh.facing {
        for (own, other) in [(0, 1), (1, 0)] {
            for t in &facing.sides[own] {
                let corners = t.map(|i| now[i as usize].coords);
                let outward = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
                for (i, j) in (0..=n).flat_map(|i| (0..=n - i).map(move |j| (i, j))) {
                    let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                    let p = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
                    let depth = depth_in(&facing.sides[other], t, now, &p, &outward);
                    deepest = deepest.max(depth);
                }
            }
        }
    }
    deepest
}

/// Depth of `p` below the nearest of the triangles on which it projects, mm; 0 when it is outside, or when that triangle shares a
/// node with its `own`.
fn depth_in(side: &[[u32; 3]], own: &[u32; 3], now: &[Point], p: &Vector, outward: &Vector) -> f64 {
    let (mut nearest, mut is_neighbour) = (f64::INFINITY, false);
    for t in side {
        let [a, b, c] = t.map(|i| now[i as usize].coords);
        let normal = (b - a).cross(&(c - a));
        let on_edge = |from: &Vector, to: &Vector| normal.dot(&(to - from).cross(&(p - from))) >= 0.0;
        let projects = on_edge(&a, &b) && on_edge(&b, &c) && on_edge(&c, &a);
        let height = normal.normalize().dot(&(p - a));
        if projects && normal.dot(outward) < 0.0 && height.abs() < nearest.abs() {
            (nearest, is_neighbour) = (height, t.iter().any(|n| own.contains(n)));
        }
    }
    if nearest < 0.0 && !is_neighbour { -nearest } else { 0.0 }
}
