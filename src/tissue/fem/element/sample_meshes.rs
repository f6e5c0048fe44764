//! Meshes for the tests of the elements.

use std::collections::BTreeMap;

use crate::mesh::{Attachment, MixedMesh};
use prosopon_geometry::{Point, Vector};

/// Prisms of thickness `thickness` below an icosphere refined `rounds` times and scaled to the half axes.
pub(super) fn ellipsoid_shell(rounds: usize, axes: [f64; 3], thickness: f64) -> MixedMesh {
    let g = 0.5 * (1.0 + 5.0_f64.sqrt());
    let mut points: Vec<Vector> = [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)]
        .into_iter()
        .flat_map(|(a, b)| [Vector::new(a, b, 0.0), Vector::new(0.0, a, b), Vector::new(b, 0.0, a)])
        .map(|p| p.normalize())
        .collect();
    // The faces are the triples of points at the shortest distance.
    let near = |a: usize, b: usize, p: &[Vector]| (p[a] - p[b]).norm() < 1.1;
    let mut triangles = vec![];
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b, &points) && near(b, c, &points) && near(a, c, &points) {
                    let outward = points[a].dot(&points[b].cross(&points[c])) > 0.0;
                    triangles.push(if outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
    }
    for _ in 0..rounds {
        let mut middles = BTreeMap::new();
        let mut finer = vec![];
        for [a, b, c] in triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(u, v)| {
                *middles.entry((u.min(v), u.max(v))).or_insert_with(|| {
                    points.push((points[u] + points[v]).normalize());
                    points.len() - 1
                })
            });
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let outer: Vec<Point> = points.iter().map(|p| Point::new(p.x * axes[0], p.y * axes[1], p.z * axes[2])).collect();
    let inner =
        |p: &Vector, x: &Point| *x - Vector::new(p.x / axes[0], p.y / axes[1], p.z / axes[2]).normalize() * thickness;
    let inner: Vec<Point> = points.iter().zip(&outer).map(|(p, x)| inner(p, x)).collect();
    shell(&outer, &inner, &triangles)
}

/// Prisms between two vertex sets with the same triangles. Inner nodes come first, so that outer node numbers differ from outer
/// indices.
pub(super) fn shell(outer: &[Point], inner: &[Point], triangles: &[[usize; 3]]) -> MixedMesh {
    let n = inner.len();
    let prisms = triangles.iter().map(|&[a, b, c]| [n + a, n + b, n + c, a, b, c].map(|i| i as u32)).collect();
    MixedMesh {
        positions: inner.iter().chain(outer).copied().collect(),
        tetrahedra: vec![],
        tetrahedron_tissue: vec![],
        prisms,
        bone_faces: vec![],
        depth_cut_nodes: Vec::new(),
        facing: Vec::new(),
        prism_tissue: Vec::new(),
        attachment: vec![Attachment::Free; 2 * n],
    }
}

/// Irregular shell over a square of `n` x `n` cells with side 4 and height `height(x, y)`; deterministic.
pub(super) fn height_field(n: usize, thickness: f64, height: impl Fn(f64, f64) -> f64) -> MixedMesh {
    let mut points = vec![];
    let wobble = |i: usize, j: usize, s: f64| {
        let inside = i > 0 && j > 0 && i < n && j < n;
        if inside { 0.8 * (s + 1.7 * i as f64 + 2.9 * j as f64 + (i * j) as f64).sin() } else { 0.0 }
    };
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (4.0 * i as f64 + wobble(i, j, 0.3), 4.0 * j as f64 + wobble(i, j, 1.9));
            points.push(Point::new(x, y, height(x, y)));
        }
    }
    let mut triangles = vec![];
    for i in 0..n {
        for j in 0..n {
            let q = [i * (n + 1) + j, (i + 1) * (n + 1) + j, (i + 1) * (n + 1) + j + 1, i * (n + 1) + j + 1];
            if (i + j) % 2 == 0 {
                triangles.extend([[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
            } else {
                triangles.extend([[q[0], q[1], q[3]], [q[1], q[2], q[3]]]);
            }
        }
    }
    let inner: Vec<Point> = points.iter().map(|p| Point::new(p.x, p.y, p.z - thickness)).collect();
    shell(&points, &inner, &triangles)
}

/// A prism over the triangle (0,0) (a,0) (0,b) from z = 0 (inner) to z = h (outer), with node numbers permuted.
pub(super) fn prism(a: f64, b: f64, h: f64, order: [u32; 6]) -> MixedMesh {
    let corners = [[0.0, 0.0, h], [a, 0.0, h], [0.0, b, h], [0.0, 0.0, 0.0], [a, 0.0, 0.0], [0.0, b, 0.0]];
    let mut positions = vec![Point::origin(); 6];
    for (corner, node) in corners.iter().zip(order) {
        positions[node as usize] = Point::from(*corner);
    }
    MixedMesh {
        positions,
        tetrahedra: vec![],
        tetrahedron_tissue: vec![],
        prisms: vec![order],
        bone_faces: vec![],
        depth_cut_nodes: Vec::new(),
        facing: Vec::new(),
        prism_tissue: Vec::new(),
        attachment: vec![Attachment::Free; 6],
    }
}
