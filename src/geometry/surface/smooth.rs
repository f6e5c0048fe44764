use crate::{Point, TriMesh, Vector};
use rayon::prelude::*;

/// Factors of the two half steps. 1/LAMBDA + 1/MU = 0.1 is the pass band: it keeps waves longer than about 10 edges.
const LAMBDA: f64 = 0.5;
const MU: f64 = -1.0 / (1.0 / LAMBDA - 0.1);

/// Taubin smoothing, which removes noise without shrinking the surface.
///
/// Each iteration moves every vertex by the share 0.5 towards the mean of its neighbours, then by the share 0.526 away from
/// it. Vertices on an open border or a non-manifold edge keep their position.
///
/// # Source
/// G. Taubin, A signal processing approach to fair surface design, SIGGRAPH 1995.
#[must_use]
pub fn smooth(mesh: &TriMesh, iterations: usize) -> TriMesh {
    let neighbours = Neighbours::of(mesh);
    let mut positions = mesh.positions().to_vec();
    for _ in 0..iterations {
        positions = neighbours.stepped(&positions, LAMBDA);
        positions = neighbours.stepped(&positions, MU);
    }
    // Means of finite points are finite.
    mesh.with_positions(positions).unwrap_or_else(|_| mesh.clone())
}

/// Neighbours of each vertex in one array; none for vertices that keep their position.
struct Neighbours {
    starts: Vec<u32>,
    vertices: Vec<u32>,
}

impl Neighbours {
    fn of(mesh: &TriMesh) -> Self {
        let n = mesh.positions().len();
        let mut counts = vec![0u32; n];
        // Around an inner vertex each neighbour follows it in one triangle and precedes it in another, so that the sum is 0.
        let mut balance = vec![0i64; n];
        for t in mesh.triangles() {
            for i in 0..3 {
                counts[t[i] as usize] += 1;
                balance[t[i] as usize] += i64::from(t[(i + 1) % 3]) - i64::from(t[(i + 2) % 3]);
            }
        }
        let mut starts = Vec::with_capacity(n + 1);
        starts.push(0u32);
        for v in 0..n {
            starts.push(starts[v] + if balance[v] == 0 { counts[v] } else { 0 });
        }
        let mut fill = starts.clone();
        let mut vertices = vec![0u32; starts[n] as usize];
        for t in mesh.triangles() {
            for i in 0..3 {
                let v = t[i] as usize;
                if balance[v] == 0 {
                    vertices[fill[v] as usize] = t[(i + 1) % 3];
                    fill[v] += 1;
                }
            }
        }
        Self { starts, vertices }
    }

    fn stepped(&self, positions: &[Point], factor: f64) -> Vec<Point> {
        let step = |v: usize| {
            let ring = &self.vertices[self.starts[v] as usize..self.starts[v + 1] as usize];
            let p = positions[v];
            if ring.is_empty() {
                return p;
            }
            let sum: Vector = ring.iter().map(|&w| positions[w as usize] - p).sum();
            p + sum * (factor / ring.len() as f64)
        };
        (0..positions.len()).into_par_iter().map(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{TopologyFaults, isosurface};
    use super::*;
    use crate::ScalarGrid;

    fn rough_sphere(radius: f64) -> TriMesh {
        let n = 44;
        let mut grid = ScalarGrid {
            dims: [n; 3],
            origin: Point::new(-21.5, -21.5, -21.5),
            spacing: 1.0,
            values: vec![0.0; n * n * n],
        };
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    let at = grid.index(i, j, k);
                    let noise = ((at * 7919) % 101) as f64 / 101.0 - 0.5;
                    grid.values[at] = (grid.position(i, j, k).coords.norm() - radius + 0.6 * noise) as f32;
                }
            }
        }
        isosurface(&grid, 0.0).unwrap()
    }

    fn roughness(mesh: &TriMesh, radius: f64) -> f64 {
        let sum: f64 = mesh.positions().iter().map(|p| (p.coords.norm() - radius).powi(2)).sum();
        (sum / mesh.positions().len() as f64).sqrt()
    }

    #[test]
    fn noise_goes_and_the_volume_stays() {
        let mesh = rough_sphere(16.0);
        let smoothed = smooth(&mesh, 10);
        assert!(TopologyFaults::of(&smoothed).is_closed_manifold());
        assert!(roughness(&smoothed, 16.0) < 0.5 * roughness(&mesh, 16.0));
        // Laplacian smoothing by 10 steps would remove 2 % of the volume.
        assert!((smoothed.volume() / mesh.volume() - 1.0).abs() < 2e-3);
    }

    #[test]
    fn an_open_border_stays_and_the_inside_moves() {
        let p = |x: f64, y: f64, z: f64| Point::new(x, y, z);
        let positions =
            vec![p(1.0, 0.0, 0.0), p(0.0, 1.0, 0.0), p(-1.0, 0.0, 0.0), p(0.0, -1.0, 0.0), p(0.0, 0.0, 1.0)];
        let mesh = TriMesh::new(positions, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]).unwrap();
        let smoothed = smooth(&mesh, 1);
        assert_eq!(smoothed.positions()[..4], mesh.positions()[..4]);
        assert!((smoothed.positions()[4].z - (1.0 - LAMBDA) * (1.0 - MU)).abs() < 1e-12);
    }
}
