use super::blended_cubic::BlendedCubic;
use super::linear::BARYCENTRIC;
use super::quadrature::TriangleRule;
use crate::mesh::MixedMesh;
use prosopon_geometry::{Vector, Warning};

/// C1 outer surface of the skin, with the generalised nodes of C1 prisms.
///
/// Mesh node `i` keeps index `i` (its position); the two tangent vectors of the `j`-th outer node have indices `n_nodes + 2 j`
/// and `n_nodes + 2 j + 1`.
///
/// The derivative of the surface at a vertex along an edge `e` of the flat rest triangles is the pair of tangent vectors applied
/// to the coordinates of `(I - n nᵀ) e` in the vertex's frame. It is linear in `e` and the same for every triangle there, so the
/// surface is continuous along edges and has one tangent plane at each vertex (`src/paper.md`, 14; the paper does not treat
/// curved surfaces).
#[derive(Debug, Clone, PartialEq)]
pub struct C1Surface {
    /// Mesh nodes that are corners of prisms' outer triangles, ascending.
    pub outer_nodes: Vec<u32>,
    /// For each outer node, the unit normal and two unit tangents of its vertex frame at rest.
    pub frames: Vec<[Vector; 3]>,
    /// For each outer node, the two tangent vectors of the isoparametric rest surface.
    ///
    /// They are the rest values of the generalised nodes.
    pub rest_tangents: Vec<[Vector; 2]>,
    /// Quadrature of the outer triangle.
    pub rule: TriangleRule,
    /// Outer nodes whose normal was tilted away from the angle-weighted one.
    ///
    /// The angle-weighted normal saw a triangle there edge-on or from behind.
    pub tilted: Vec<u32>,
    /// Outer nodes whose rest tangents were shortened, with the factor.
    ///
    /// This prevents inverted prisms at rest; the surface is flatter there.
    pub flattened: Vec<(u32, f64)>,
    /// Prisms that would still be inverted, ascending.
    ///
    /// They are linear wedges; along their edges the surface is continuous only at the ends.
    pub plain: Vec<u32>,
}

/// The outer triangle of one prism.
pub(super) struct Patch {
    /// Indices of the corners in `outer_nodes`.
    pub(super) corners: [usize; 3],
    /// For each corner, the edges to the next corner and the one after, in coordinates of the corner's frame.
    edges: [[[f64; 2]; 2]; 3],
    cubic: BlendedCubic,
}

impl Patch {
    /// Converts nine functions of values and edge derivatives to nine functions of values and tangents.
    fn in_tangents<const N: usize>(&self, f: &[[f64; N]; 9]) -> [[f64; N]; 9] {
        let mut out = *f;
        for i in 0..3 {
            for t in 0..2 {
                let [c, d] = [self.edges[i][0][t], self.edges[i][1][t]];
                out[3 * i + 1 + t] = std::array::from_fn(|x| c * f[3 * i + 1][x] + d * f[3 * i + 2][x]);
            }
        }
        out
    }

    pub(super) fn values(&self, l: [f64; 3]) -> [f64; 9] {
        self.in_tangents(&self.cubic.values(l).map(|v| [v])).map(|[v]| v)
    }

    /// Derivatives by (L2, L3).
    pub(super) fn derivatives(&self, l: [f64; 3]) -> [[f64; 2]; 9] {
        self.in_tangents(&self.cubic.derivatives(l))
    }
}

/// Warning of `prisms` that are wedges in place of `elements`; `None` when there are none.
pub fn wedges_warning(prisms: usize, elements: &str) -> Option<Warning> {
    let message = format!("{prisms} prisms at folds of the skin are linear wedges instead of {elements}");
    (prisms > 0).then(|| Warning::check("skin-wedges", message).act("Smooth the skin surface there."))
}

impl C1Surface {
    /// Changes made to prevent inverted prisms at rest; empty when none were needed.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        if !self.tilted.is_empty() {
            let message = format!(
                "the skin is so sharply creased at {} of {} outer nodes that their normals were tilted towards all triangles \
                 there",
                self.tilted.len(),
                self.outer_nodes.len()
            );
            warnings.push(Warning::check("creased-skin", message).act("Smooth the skin surface there."));
        }
        if let Some(least) = self.flattened.iter().map(|f| f.1).min_by(f64::total_cmp) {
            let message = format!(
                "the skin surface was flattened at {} of {} outer nodes (tangents shortened by factors down to {least:.2}) so \
                 that no prism is inverted at rest",
                self.flattened.len(),
                self.outer_nodes.len()
            );
            warnings.push(Warning::check("flattened-skin", message).act("Smooth the skin surface there."));
        }
        warnings.extend(wedges_warning(self.plain.len(), "C1 prisms"));
        warnings
    }

    /// Index of mesh node `node` in `outer_nodes`.
    fn place(&self, node: u32) -> usize {
        self.outer_nodes.partition_point(|&n| n < node)
    }

    pub(super) fn patch(&self, mesh: &MixedMesh, prism: usize) -> Patch {
        let [a, b, c, ..] = mesh.prisms[prism];
        let corners = [a, b, c].map(|n| self.place(n));
        let x = [a, b, c].map(|n| mesh.positions[n as usize].coords);
        let edges = std::array::from_fn(|i| {
            let [_, t1, t2] = &self.frames[corners[i]];
            [(i + 1) % 3, (i + 2) % 3].map(|to| {
                let edge = x[to] - x[i];
                [edge.dot(t1), edge.dot(t2)]
            })
        });
        Patch { corners, edges, cubic: BlendedCubic::new(&x) }
    }

    /// Values of the nine outer functions of prism `prism`, at barycentric coordinates `l`.
    ///
    /// `l` refers to the outer triangle. The order is position, tangent 1, tangent 2 for each corner.
    #[must_use]
    pub fn outer_functions(&self, mesh: &MixedMesh, prism: usize, l: [f64; 3]) -> [f64; 9] {
        if self.is_plain(prism) {
            return std::array::from_fn(|a| if a % 3 == 0 { l[a / 3] } else { 0.0 });
        }
        self.patch(mesh, prism).values(l)
    }

    /// Derivatives of the nine outer functions by `(L2, L3)`, with `L1 = 1 - L2 - L3`.
    #[must_use]
    pub fn outer_derivatives(&self, mesh: &MixedMesh, prism: usize, l: [f64; 3]) -> [[f64; 2]; 9] {
        if self.is_plain(prism) {
            return std::array::from_fn(|a| if a % 3 == 0 { BARYCENTRIC[a / 3] } else { [0.0; 2] });
        }
        self.patch(mesh, prism).derivatives(l)
    }

    /// Whether `prism` is a linear wedge.
    pub(super) fn is_plain(&self, prism: usize) -> bool {
        self.plain.binary_search(&(prism as u32)).is_ok()
    }

    /// Generalised nodes of the nine outer functions of prism `prism`.
    #[must_use]
    pub fn outer_nodes_of(&self, mesh: &MixedMesh, prism: usize) -> [u32; 9] {
        let n_nodes = mesh.positions.len();
        let [a, b, c, ..] = mesh.prisms[prism];
        let mut nodes = [0; 9];
        for (i, node) in [a, b, c].into_iter().enumerate() {
            let tangent = (n_nodes + 2 * self.place(node)) as u32;
            nodes[3 * i..3 * i + 3].copy_from_slice(&[node, tangent, tangent + 1]);
        }
        nodes
    }

    /// Rest values of all generalised nodes: positions, then tangents, mm.
    #[must_use]
    pub fn rest_values(&self, mesh: &MixedMesh) -> Vec<Vector> {
        let positions = mesh.positions.iter().map(|p| p.coords);
        positions.chain(self.rest_tangents.iter().flatten().copied()).collect()
    }

    /// Point of the outer surface for generalised nodal values `values`, mm.
    #[must_use]
    pub fn point(&self, mesh: &MixedMesh, values: &[Vector], prism: usize, l: [f64; 3]) -> Vector {
        let functions = self.outer_functions(mesh, prism, l);
        self.outer_nodes_of(mesh, prism).iter().zip(functions).map(|(&n, f)| values[n as usize] * f).sum()
    }

    /// Outward unit normal of the outer surface for generalised nodal values `values`.
    ///
    /// `None` where the surface has no normal.
    #[must_use]
    pub fn normal(&self, mesh: &MixedMesh, values: &[Vector], prism: usize, l: [f64; 3]) -> Option<Vector> {
        let (mut u, mut v) = (Vector::zeros(), Vector::zeros());
        for (&n, [d2, d3]) in self.outer_nodes_of(mesh, prism).iter().zip(self.outer_derivatives(mesh, prism, l)) {
            u += values[n as usize] * d2;
            v += values[n as usize] * d3;
        }
        u.cross(&v).try_normalize(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::c1_prisms;
    use super::super::sample_meshes::{ellipsoid_shell, height_field};
    use super::*;
    use nalgebra::Matrix3;

    const INSIDE: [[f64; 3]; 4] = [[0.2, 0.3, 0.5], [0.9, 0.05, 0.05], [1.0 / 3.0; 3], [0.01, 0.98, 0.01]];

    fn meshes() -> Vec<MixedMesh> {
        vec![
            ellipsoid_shell(1, [30.0, 40.0, 25.0], 1.5),
            height_field(4, 1.5, |_, _| 2.0),
            height_field(4, 1.5, |x, y| 1.5 * (0.3 * x).sin() + 0.03 * y * y),
        ]
    }

    #[test]
    fn position_functions_add_up_to_one_and_interpolate_at_corners() {
        for mesh in meshes() {
            let surface = C1Surface::new(&mesh);
            for prism in [0, 7, mesh.prisms.len() - 1] {
                for l in INSIDE {
                    let f = surface.outer_functions(&mesh, prism, l);
                    assert!((f[0] + f[3] + f[6] - 1.0).abs() < 1e-14);
                    let d = surface.outer_derivatives(&mesh, prism, l);
                    for c in 0..2 {
                        assert!((d[0][c] + d[3][c] + d[6][c]).abs() < 1e-13);
                    }
                }
                for i in 0..3 {
                    let mut l = [0.0; 3];
                    l[i] = 1.0;
                    let f = surface.outer_functions(&mesh, prism, l);
                    assert!((0..9).all(|a| (f[a] - f64::from(u8::from(a == 3 * i))).abs() < 1e-15));
                }
            }
        }
    }

    #[test]
    fn derivatives_agree_with_differences_of_the_values() {
        let mesh = ellipsoid_shell(0, [30.0, 40.0, 25.0], 1.5);
        let surface = C1Surface::new(&mesh);
        for l in INSIDE {
            let d = surface.outer_derivatives(&mesh, 3, l);
            for c in 0..2 {
                let h = 1e-6;
                let at = |s: f64| {
                    let mut m = l;
                    m[c + 1] += s * h;
                    m[0] -= s * h;
                    surface.outer_functions(&mesh, 3, m)
                };
                let (plus, minus) = (at(1.0), at(-1.0));
                for a in 0..9 {
                    // Functions of tangents scale with the edge's length, 30 mm.
                    let found = (plus[a] - minus[a]) / (2.0 * h);
                    assert!((found - d[a][c]).abs() < 1e-7 * 30.0, "{a} {c}: {found} {}", d[a][c]);
                }
            }
        }
    }

    /// At a corner the derivative along an edge is the projected edge, for every triangle there.
    #[test]
    fn derivatives_at_a_corner_are_the_projected_edges() {
        let mesh = ellipsoid_shell(1, [30.0, 40.0, 25.0], 1.5);
        let surface = C1Surface::new(&mesh);
        let values = surface.rest_values(&mesh);
        for prism in 0..20 {
            let nodes = surface.outer_nodes_of(&mesh, prism);
            let slopes = surface.outer_derivatives(&mesh, prism, [1.0, 0.0, 0.0]);
            let normal = surface.frames[surface.place(mesh.prisms[prism][0])][0];
            for c in 0..2 {
                let found: Vector = nodes.iter().zip(slopes).map(|(&n, d)| values[n as usize] * d[c]).sum();
                let edge = values[nodes[3 * (c + 1)] as usize] - values[nodes[0] as usize];
                assert!((found - (edge - normal * normal.dot(&edge))).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn the_surface_is_continuous_along_shared_edges() {
        for mesh in meshes() {
            let surface = C1Surface::new(&mesh);
            let mut values = surface.rest_values(&mesh);
            for (i, v) in values.iter_mut().enumerate() {
                *v += Vector::new((i as f64).sin(), (1.3 * i as f64).cos(), (2.1 * i as f64).sin()) * 0.3;
            }
            let mut shared = 0;
            for (p, one) in mesh.prisms.iter().enumerate() {
                for (q, two) in mesh.prisms.iter().enumerate().skip(p + 1) {
                    for (i, j) in (0..9).map(|x| (x / 3, x % 3)) {
                        // The neighbour traverses the same edge in the other direction.
                        if one[i] != two[(j + 1) % 3] || one[(i + 1) % 3] != two[j] {
                            continue;
                        }
                        shared += 1;
                        for t in [0.0, 0.13, 0.5, 0.81] {
                            let (mut l, mut m) = ([0.0; 3], [0.0; 3]);
                            (l[i], l[(i + 1) % 3]) = (1.0 - t, t);
                            (m[j], m[(j + 1) % 3]) = (t, 1.0 - t);
                            let gap = surface.point(&mesh, &values, p, l) - surface.point(&mesh, &values, q, m);
                            assert!(gap.norm() < 1e-12);
                        }
                    }
                }
            }
            assert!(shared > mesh.prisms.len());
        }
    }

    fn gradient(mesh: &MixedMesh, surface: &C1Surface, values: &[Vector], check: impl Fn(Matrix3<f64>)) {
        let block = c1_prisms(mesh, surface).unwrap();
        for e in 0..block.n_elements() {
            for p in 0..block.n_points {
                let f: Matrix3<f64> = (0..12)
                    .map(|a| {
                        let g = block.gradients[(e * block.n_points + p) * 12 + a];
                        values[block.nodes[e * 12 + a] as usize] * g.transpose()
                    })
                    .sum();
                check(f);
            }
        }
    }

    #[test]
    fn linear_fields_and_rigid_rotations_are_exact_at_every_point() {
        let a = Matrix3::new(1.2, 0.3, -0.1, 0.2, 0.9, 0.4, 0.0, -0.3, 1.1);
        let r = nalgebra::Rotation3::from_euler_angles(0.4, 1.2, -0.7).into_inner();
        for mesh in meshes() {
            let surface = C1Surface::new(&mesh);
            assert!(surface.warnings().is_empty());
            for m in [a, r] {
                let n = mesh.positions.len();
                let mut values = surface.rest_values(&mesh);
                for (i, v) in values.iter_mut().enumerate() {
                    *v = m * *v + if i < n { Vector::new(3.0, -1.0, 2.0) } else { Vector::zeros() };
                }
                gradient(&mesh, &surface, &values, |f| assert!((f - m).norm() < 1e-11, "{}", f - m));
            }
        }
    }

    #[test]
    fn weights_are_positive_and_add_up_to_the_volume() {
        let mesh = height_field(4, 1.5, |_, _| 2.0);
        let block = c1_prisms(&mesh, &C1Surface::new(&mesh)).unwrap();
        assert!(block.weights.iter().all(|w| *w > 0.0));
        assert!((block.weights.iter().sum::<f64>() - 16.0 * 16.0 * 1.5).abs() < 1e-9 * 384.0);
        // A shell under a sphere: the curved surface encloses the sphere's volume more closely than the flat triangles.
        let radius: f64 = 30.0;
        let mesh = ellipsoid_shell(2, [radius; 3], 1.5);
        let block = c1_prisms(&mesh, &C1Surface::new(&mesh)).unwrap();
        assert!(block.weights.iter().all(|w| *w > 0.0));
        let volume = |corners: usize| -> f64 {
            let x = |p: &[u32; 6], i: usize| mesh.positions[p[corners + i] as usize].coords;
            mesh.prisms.iter().map(|p| x(p, 0).dot(&x(p, 1).cross(&x(p, 2))) / 6.0).sum()
        };
        let exact = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        let curved = volume(3) + block.weights.iter().sum::<f64>();
        let (curved_error, flat_error) = ((curved / exact - 1.0).abs(), (volume(0) / exact - 1.0).abs());
        assert!(flat_error > 0.02 && curved_error < flat_error / 20.0, "{curved_error} {flat_error}");
    }

    #[test]
    fn an_empty_skin_is_an_empty_surface() {
        let mut mesh = height_field(1, 1.5, |_, _| 0.0);
        mesh.prisms.clear();
        let surface = C1Surface::new(&mesh);
        assert!(surface.outer_nodes.is_empty() && surface.warnings().is_empty());
        assert_eq!(c1_prisms(&mesh, &surface).unwrap().n_elements(), 0);
    }
}
