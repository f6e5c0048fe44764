use super::c1_surface::C1Surface;
use crate::mesh::MixedMesh;
use prosopon_geometry::Vector;

/// Jump of the outer surface's normal across the edges between prisms.
///
/// It is given for the C1 prism and for linear triangles through the same vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalJump {
    /// Edges shared by two prisms.
    pub n_edges: usize,
    /// Largest angle with the C1 prism, degrees.
    pub c1_max_deg: f64,
    /// Mean over edges of the largest angle along each edge with the C1 prism, degrees.
    pub c1_mean_deg: f64,
    /// Largest angle with linear triangles, degrees.
    pub linear_max_deg: f64,
    /// Mean angle with linear triangles, degrees.
    pub linear_mean_deg: f64,
}

/// Positions along an edge at which normals are compared.
const ALONG: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

impl C1Surface {
    /// Jumps of the normal for generalised nodal values `values`, at rest or deformed.
    ///
    /// All are zero when no edge is shared.
    #[must_use]
    pub fn normal_jump(&self, mesh: &MixedMesh, values: &[Vector]) -> NormalJump {
        // Edges as (smaller node, larger node, prism, local edge); edge i goes from corner i to the next.
        let mut edges: Vec<(u32, u32, usize, usize)> = mesh
            .prisms
            .iter()
            .enumerate()
            .flat_map(|(prism, p)| {
                (0..3).map(move |i| {
                    let (a, b) = (p[i], p[(i + 1) % 3]);
                    (a.min(b), a.max(b), prism, i)
                })
            })
            .collect();
        edges.sort_unstable();
        let mut jump =
            NormalJump { n_edges: 0, c1_max_deg: 0.0, c1_mean_deg: 0.0, linear_max_deg: 0.0, linear_mean_deg: 0.0 };
        for pair in edges.windows(2).filter(|w| (w[0].0, w[0].1) == (w[1].0, w[1].1)) {
            let [one, two] = [&pair[0], &pair[1]];
            let c1 = ALONG
                .iter()
                .map(|&t| {
                    let normals = [one, two]
                        .map(|&(low, _, prism, i)| self.normal(mesh, values, prism, on_edge(mesh, prism, i, low, t)));
                    angle_deg(normals)
                })
                .fold(0.0, f64::max);
            let linear = angle_deg([one, two].map(|&(.., prism, _)| {
                let [a, b, c, ..] = mesh.prisms[prism].map(|n| values[n as usize]);
                (b - a).cross(&(c - a)).try_normalize(0.0)
            }));
            jump.n_edges += 1;
            jump.c1_max_deg = jump.c1_max_deg.max(c1);
            jump.linear_max_deg = jump.linear_max_deg.max(linear);
            jump.c1_mean_deg += c1;
            jump.linear_mean_deg += linear;
        }
        let n = jump.n_edges.max(1) as f64;
        jump.c1_mean_deg /= n;
        jump.linear_mean_deg /= n;
        jump
    }
}

/// Barycentric coordinates in `prism` of the point at share `t` from node `low` along its edge `i`.
fn on_edge(mesh: &MixedMesh, prism: usize, i: usize, low: u32, t: f64) -> [f64; 3] {
    let mut l = [0.0; 3];
    let (from, to) = if mesh.prisms[prism][i] == low { (i, (i + 1) % 3) } else { ((i + 1) % 3, i) };
    l[from] = 1.0 - t;
    l[to] = t;
    l
}

/// Angle between two normals, degrees; a missing normal counts as a right angle.
fn angle_deg(normals: [Option<Vector>; 2]) -> f64 {
    match normals {
        [Some(a), Some(b)] => a.cross(&b).norm().atan2(a.dot(&b)).to_degrees(),
        _ => 90.0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample_meshes::{ellipsoid_shell, height_field};
    use super::*;

    /// Third order against first: each refinement divides the C1 prism's jump by about eight, the linear one by two.
    #[test]
    fn the_normal_jumps_far_less_than_on_flat_triangles() {
        let jump = |rounds| {
            let mesh = ellipsoid_shell(rounds, [60.0, 80.0, 100.0], 1.5);
            let surface = C1Surface::new(&mesh);
            let jump = surface.normal_jump(&mesh, &surface.rest_values(&mesh));
            assert_eq!(jump.n_edges, 3 * mesh.prisms.len() / 2);
            jump
        };
        let (coarse, middle, fine) = (jump(1), jump(2), jump(3));
        assert!(middle.linear_max_deg > 13.0 && middle.c1_max_deg < 0.7, "{middle:?}");
        assert!(middle.linear_mean_deg > 10.0 && middle.c1_mean_deg < 0.25, "{middle:?}");
        assert!(middle.c1_max_deg < coarse.c1_max_deg / 5.0 && fine.c1_max_deg < middle.c1_max_deg / 5.0);
        assert!(fine.linear_max_deg > middle.linear_max_deg / 2.5);
    }

    #[test]
    fn a_flat_skin_has_no_jump_and_a_rotation_changes_none() {
        let mesh = height_field(3, 1.5, |_, _| 1.0);
        let surface = C1Surface::new(&mesh);
        let jump = surface.normal_jump(&mesh, &surface.rest_values(&mesh));
        // Only rounding errors of the blends remain.
        assert!(jump.c1_max_deg < 1e-9 && jump.linear_max_deg < 1e-9, "{jump:?}");

        let mesh = height_field(3, 1.5, |x, y| (0.3 * x).sin() + 0.02 * x * y);
        let surface = C1Surface::new(&mesh);
        let rest = surface.rest_values(&mesh);
        let turn = nalgebra::Rotation3::from_euler_angles(1.0, 0.4, -2.0);
        let turned: Vec<_> = rest.iter().map(|v| turn * v).collect();
        let (before, after) = (surface.normal_jump(&mesh, &rest), surface.normal_jump(&mesh, &turned));
        assert!((before.c1_max_deg - after.c1_max_deg).abs() < 1e-9 && before.c1_max_deg > 0.0);
        assert!((before.linear_mean_deg - after.linear_mean_deg).abs() < 1e-9);
    }
}
