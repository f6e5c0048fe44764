//! Small surfaces with known distances.

use crate::{FieldReport, FieldSettings, Method, MethodSettings, SignedField, Tolerance};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Point, TriMesh, Vector};
use std::collections::BTreeMap;

/// Sphere around `center`: an icosahedron subdivided `levels` times.
pub(super) fn sphere(center: Point, radius: f64, levels: usize) -> TriMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut p: Vec<Vector> = [
        [-1.0, g, 0.0],
        [1.0, g, 0.0],
        [-1.0, -g, 0.0],
        [1.0, -g, 0.0],
        [0.0, -1.0, g],
        [0.0, 1.0, g],
        [0.0, -1.0, -g],
        [0.0, 1.0, -g],
        [g, 0.0, -1.0],
        [g, 0.0, 1.0],
        [-g, 0.0, -1.0],
        [-g, 0.0, 1.0],
    ]
    .map(|c| Vector::from(c).normalize())
    .to_vec();
    let mut t: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    for _ in 0..levels {
        let mut middles = BTreeMap::new();
        let mut middle = |a: u32, b: u32, p: &mut Vec<Vector>| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                p.push((p[a as usize] + p[b as usize]).normalize());
                p.len() as u32 - 1
            })
        };
        let mut finer = Vec::new();
        for [a, b, c] in t {
            let (ab, bc, ca) = (middle(a, b, &mut p), middle(b, c, &mut p), middle(c, a, &mut p));
            finer.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        t = finer;
    }
    TriMesh::new(p.into_iter().map(|v| center + v * radius).collect(), t).unwrap()
}

/// Box with half-sizes `half`, two triangles per face.
pub(super) fn block(center: Point, half: Vector) -> TriMesh {
    let p = (0..8)
        .map(|n| {
            let s = |bit: usize| if n >> bit & 1 == 1 { 1.0 } else { -1.0 };
            center + Vector::new(s(0) * half.x, s(1) * half.y, s(2) * half.z)
        })
        .collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let t = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh::new(p, t).unwrap()
}

/// Signed distance to [`block`].
pub(super) fn block_distance(center: Point, half: Vector, p: &Point) -> f64 {
    let q = (p - center).abs() - half;
    q.sup(&Vector::zeros()).norm() + q.max().min(0.0)
}

/// Torus around the z axis through `center`, n × n × 2 triangles.
pub(super) fn torus(center: Point, large: f64, small: f64, n: u32) -> TriMesh {
    let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let positions = (0..n * n).map(|i| {
        let (u, v) = (angle(i % n), angle(i / n));
        let r = large + small * v.cos();
        center + Vector::new(r * u.cos(), r * u.sin(), small * v.sin())
    });
    let at = |u: u32, v: u32| u % n + n * (v % n);
    let triangles = (0..n * n).flat_map(|i| {
        let (u, v) = (i % n, i / n);
        [[at(u, v), at(u + 1, v), at(u + 1, v + 1)], [at(u, v), at(u + 1, v + 1), at(u, v + 1)]]
    });
    TriMesh::new(positions.collect(), triangles.collect()).unwrap()
}

/// Signed distance to a torus of these radii around the z axis through `center`.
pub(super) fn torus_distance(center: Point, large: f64, small: f64, p: &Point) -> f64 {
    let q = p - center;
    (q.xy().norm() - large).hypot(q.z) - small
}

/// Cone with its tip at the origin, axis along z, base at -`height`, and `n` sides.
pub(super) fn cone(radius: f64, height: f64, n: u32) -> TriMesh {
    let mut p = vec![Point::origin(), Point::new(0.0, 0.0, -height)];
    p.extend((0..n).map(|i| {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(n);
        Point::new(radius * angle.cos(), radius * angle.sin(), -height)
    }));
    let t = (0..n).flat_map(|i| {
        let (a, b) = (2 + i, 2 + (i + 1) % n);
        [[0, a, b], [1, b, a]]
    });
    TriMesh::new(p, t.collect()).unwrap()
}

/// Signed distance to [`cone`] with round sides: that to a triangle in a half plane of the axis.
pub(super) fn cone_distance(radius: f64, height: f64, p: &Point) -> f64 {
    let (r, z) = (p.coords.xy().norm(), p.z);
    let to_segment = |a: [f64; 2], b: [f64; 2]| {
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [r - a[0], z - a[1]]);
        let t = ((u[0] * v[0] + u[1] * v[1]) / (u[0] * u[0] + u[1] * u[1])).clamp(0.0, 1.0);
        (v[0] - t * u[0]).hypot(v[1] - t * u[1])
    };
    let rim = [radius, -height];
    let distance = to_segment([0.0, 0.0], rim).min(to_segment([0.0, -height], rim));
    let inside = z < 0.0 && z > -height && r < -z * radius / height;
    if inside { -distance } else { distance }
}

/// Tetrahedron with its corners in the order that gives a positive volume.
pub(super) fn tetrahedron(corners: [Point; 4]) -> TriMesh {
    TriMesh::new(corners.to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]).unwrap()
}

/// Signed distance to a convex polyhedron; inside it is the distance to the nearest plane.
pub(super) fn convex_distance(mesh: &TriMesh, p: &Point) -> f64 {
    let triangles = || (0..mesh.triangles().len()).map(|t| mesh.corners(t));
    let height = triangles()
        .map(|[a, b, c]| (b - a).cross(&(c - a)).normalize().dot(&(p - a)))
        .fold(f64::NEG_INFINITY, f64::max);
    if height <= 0.0 {
        return height;
    }
    triangles().map(|c| (crate::triangle::closest_point(p, &c) - p).norm()).fold(f64::INFINITY, f64::min)
}

/// Sphere of 320 triangles with vertices moved along their radius by a share of up to `roughness`.
pub(super) fn rough_ball(center: Point, radius: f64, roughness: f64, seed: u64) -> TriMesh {
    let ball = sphere(Point::origin(), radius, 2);
    let mut random = Random(seed);
    let moved =
        ball.positions().iter().map(|p| center + p.coords * (1.0 + roughness * (2.0 * random.unit() - 1.0))).collect();
    ball.with_positions(moved).unwrap()
}

/// Fields of all methods at this spacing (mm) with their reports; the octrees' tolerance is 0.01 mm.
pub(super) fn fields(mesh: &TriMesh, spacing_mm: f64, band_mm: f64) -> Vec<(Method, SignedField, FieldReport)> {
    let field = FieldSettings { spacing_mm, band_mm, margin_mm: band_mm + 1.0 };
    let build = |method| {
        let settings = MethodSettings { method, field, resolution: None, tolerance: Tolerance::Mm(0.01) };
        let (field, report) = SignedField::build(mesh, &settings, &Control::new()).unwrap();
        (method, field, report)
    };
    Method::ALL.map(build).into()
}

/// `mesh` with only the triangles that `keep` (index, corners) accepts.
pub(super) fn filtered(mesh: &TriMesh, keep: impl Fn(usize, [Point; 3]) -> bool) -> TriMesh {
    let t = mesh.triangles().iter().enumerate().filter(|(n, _)| keep(*n, mesh.corners(*n))).map(|(_, t)| *t).collect();
    TriMesh::new(mesh.positions().to_vec(), t).unwrap()
}

/// `mesh` with the triangles flipped that `flip` accepts.
pub(super) fn flipped(mesh: &TriMesh, flip: impl Fn(usize) -> bool) -> TriMesh {
    let t = mesh.triangles().iter().enumerate().map(|(n, &[a, b, c])| if flip(n) { [a, c, b] } else { [a, b, c] });
    TriMesh::new(mesh.positions().to_vec(), t.collect()).unwrap()
}

/// Both surfaces in one mesh.
pub(super) fn joined(a: &TriMesh, b: &TriMesh) -> TriMesh {
    let shift = a.positions().len() as u32;
    let positions = a.positions().iter().chain(b.positions()).copied().collect();
    let triangles = a.triangles().iter().copied().chain(b.triangles().iter().map(|t| t.map(|v| v + shift)));
    TriMesh::new(positions, triangles.collect()).unwrap()
}

/// Pseudo-random numbers in [0, 1); the same on every run.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Random point of the cube with half-size `half` around `center`.
    pub(super) fn point(&mut self, center: Point, half: f64) -> Point {
        center + Vector::from_fn(|_, _| (2.0 * self.unit() - 1.0) * half)
    }
}
