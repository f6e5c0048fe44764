//! Energy, forces and stiffness of one element, for any number `N` of functions and any number of quadrature points.

use super::law::{Curvature, Law, matrix};
use crate::fem::element::ElementBlock;
use crate::fem::material::Inverted;
use nalgebra::{Matrix3, SVector};
use prosopon_geometry::Vector;

/// Index pairs `(i, k)`, `i <= k`, of the 3×3 parts of an element matrix.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
/// Index of `(i, k)` in [`PAIRS`].
const PAIR_OF: [[usize; 3]; 3] = [[0, 3, 4], [3, 1, 5], [4, 5, 2]];

/// Number of 3×3 blocks in the lower triangle of an element matrix.
pub(super) const fn n_slots(n: usize) -> usize {
    n * (n + 1) / 2
}

/// One element of a block whose elements have `N` functions.
#[derive(Clone, Copy)]
pub(super) struct Element<'a, const N: usize> {
    nodes: &'a [u32; N],
    gradients: &'a [[Vector; N]],
    weights: &'a [f64],
}

impl<'a, const N: usize> Element<'a, N> {
    #[inline(always)]
    pub(super) fn new(block: &'a ElementBlock, element: usize) -> Self {
        let q = block.n_points;
        let (nodes, _) = block.nodes.as_chunks::<N>();
        let (gradients, _) = block.gradients.as_chunks::<N>();
        Self {
            nodes: &nodes[element],
            gradients: &gradients[element * q..(element + 1) * q],
            weights: &block.weights[element * q..(element + 1) * q],
        }
    }

    #[inline(always)]
    pub(super) fn collect(&self, x: &[Vector]) -> [Vector; N] {
        self.nodes.map(|n| x[n as usize])
    }

    /// Energy, mJ.
    #[inline(always)]
    pub(super) fn energy(&self, law: &Law, x: &[Vector; N]) -> Result<f64, Inverted> {
        let mut energy = 0.0;
        for (g, w) in self.gradients.iter().zip(self.weights) {
            energy += w * law.energy(&outer_sum(x, g))?;
        }
        Ok(energy)
    }

    /// Adds the forces to `out` (three entries for each node) and returns the energy, mJ.
    #[inline(always)]
    pub(super) fn forces(&self, law: &Law, x: &[Vector; N], out: &mut [f64]) -> Result<f64, Inverted> {
        let mut energy = 0.0;
        for (g, w) in self.gradients.iter().zip(self.weights) {
            let f = outer_sum(x, g);
            energy += w * law.energy(&f)?;
            add_forces(&(law.stress(&f)? * *w), g, out);
        }
        Ok(energy)
    }

    /// Adds the first-order change of the forces for a change `dx` of the nodes.
    #[inline(always)]
    pub(super) fn force_change(
        &self,
        law: &Law,
        x: &[Vector; N],
        dx: &[Vector; N],
        out: &mut [f64],
    ) -> Result<(), Inverted> {
        for (g, w) in self.gradients.iter().zip(self.weights) {
            let (_, tangent) = law.stress_and_tangent(&outer_sum(x, g), Curvature::Exact)?;
            let df = SVector::<f64, 9>::from_column_slice(outer_sum(dx, g).as_slice());
            add_forces(&(matrix(&(tangent * df)) * *w), g, out);
        }
        Ok(())
    }

    /// Adds the forces, and writes the lower triangle of the element matrix: block `(a, b)`, `a >= b`, has nine column-major
    /// entries from `9 (a (a + 1) / 2 + b)` on.
    #[inline(always)]
    pub(super) fn tangent(
        &self,
        law: &Law,
        curvature: Curvature,
        x: &[Vector; N],
        forces: &mut [f64],
        blocks: &mut [f64],
    ) -> Result<(), Inverted> {
        let mut k = [[[0.0; N]; N]; 6];
        for (g, w) in self.gradients.iter().zip(self.weights) {
            let (stress, c) = law.stress_and_tangent(&outer_sum(x, g), curvature)?;
            add_forces(&(stress * *w), g, forces);
            // By component, so that the innermost loop runs over functions and vectorises.
            let mut by_axis = [[0.0; N]; 3];
            for (a, g) in g.iter().enumerate() {
                for l in 0..3 {
                    by_axis[l][a] = g[l];
                }
            }
            for (&(i, m), k) in PAIRS.iter().zip(&mut k) {
                let mut part = [[0.0; 3]; 3];
                for (j, row) in part.iter_mut().enumerate() {
                    for (l, entry) in row.iter_mut().enumerate() {
                        *entry = w * c[(i + 3 * j, m + 3 * l)];
                    }
                }
                for (g, row) in g.iter().zip(k.iter_mut()) {
                    let h: [f64; 3] = std::array::from_fn(|l| g.x * part[0][l] + g.y * part[1][l] + g.z * part[2][l]);
                    for b in 0..N {
                        row[b] += h[0] * by_axis[0][b] + h[1] * by_axis[1][b] + h[2] * by_axis[2][b];
                    }
                }
            }
        }
        let mut slot = blocks.chunks_exact_mut(9);
        for a in 0..N {
            for b in 0..=a {
                let Some(block) = slot.next() else { return Ok(()) };
                for i in 0..3 {
                    for m in 0..3 {
                        let k = &k[PAIR_OF[i][m]];
                        block[3 * m + i] = if i <= m { k[a][b] } else { k[b][a] };
                    }
                }
            }
        }
        Ok(())
    }

    /// Smallest det F over the points.
    #[inline(always)]
    pub(super) fn min_det(&self, x: &[Vector; N]) -> f64 {
        self.gradients.iter().map(|g| outer_sum(x, g).determinant()).fold(f64::INFINITY, f64::min)
    }

    /// Deformation gradients at the points.
    pub(super) fn deformations(&self, x: [Vector; N]) -> impl Iterator<Item = Matrix3<f64>> + use<'a, N> {
        self.gradients.iter().map(move |g| outer_sum(&x, g))
    }

    /// Share of `dx`, at most 1, at which det F first becomes zero at a point.
    #[inline(always)]
    pub(super) fn first_inversion(&self, x: &[Vector; N], dx: &[Vector; N]) -> f64 {
        self.gradients
            .iter()
            .map(|g| first_root(&det_along(&outer_sum(x, g), &outer_sum(dx, g)), 0.0, 1.0).unwrap_or(1.0))
            .fold(1.0, f64::min)
    }
}

/// `Σ_a x_a ⊗ g_a`.
#[inline(always)]
fn outer_sum<const N: usize>(x: &[Vector; N], g: &[Vector; N]) -> Matrix3<f64> {
    let mut f = Matrix3::zeros();
    for (x, g) in x.iter().zip(g) {
        for c in 0..3 {
            for r in 0..3 {
                f[(r, c)] += x[r] * g[c];
            }
        }
    }
    f
}

#[inline(always)]
fn add_forces<const N: usize>(weighted_stress: &Matrix3<f64>, g: &[Vector; N], out: &mut [f64]) {
    for (g, out) in g.iter().zip(out.chunks_exact_mut(3)) {
        let force = weighted_stress * g;
        for i in 0..3 {
            out[i] += force[i];
        }
    }
}

/// Bernstein coefficients on [0, 1] of the cubic `det(F + s D)`.
fn det_along(f: &Matrix3<f64>, d: &Matrix3<f64>) -> [f64; 4] {
    let cross = |a: &Matrix3<f64>| {
        let [x, y, z] = [a.column(0), a.column(1), a.column(2)];
        Matrix3::from_columns(&[y.cross(&z), z.cross(&x), x.cross(&y)])
    };
    let (c0, c1, c2, c3) = (f.determinant(), cross(f).dot(d), cross(d).dot(f), d.determinant());
    [c0, c0 + c1 / 3.0, c0 + (2.0 * c1 + c2) / 3.0, c0 + c1 + c2 + c3]
}

/// First root of a cubic in the interval from `from` to `from + width`, given by its Bernstein coefficients there.
///
/// It is found by bisection to 1e-3 and rounded towards `from`.
fn first_root(bernstein: &[f64; 4], from: f64, width: f64) -> Option<f64> {
    if bernstein.iter().all(|b| *b > 0.0) {
        return None;
    }
    if width < 1e-3 || bernstein[0] <= 0.0 {
        return Some(from);
    }
    let (left, right) = halves(bernstein);
    let half = 0.5 * width;
    first_root(&left, from, half).or_else(|| first_root(&right, from + half, half))
}

fn halves(b: &[f64; 4]) -> ([f64; 4], [f64; 4]) {
    let mid = |a: f64, b: f64| 0.5 * (a + b);
    let (p, q, r) = (mid(b[0], b[1]), mid(b[1], b[2]), mid(b[2], b[3]));
    let (s, t) = (mid(p, q), mid(q, r));
    let m = mid(s, t);
    ([b[0], p, s, m], [m, t, r, b[3]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_root_of_a_cubic_determinant_is_found_from_below() {
        // det(I + s diag(-2, -1.5, 0)) has roots 1/2 and 2/3.
        let d = Matrix3::from_diagonal(&Vector::new(-2.0, -1.5, 0.0));
        let root = first_root(&det_along(&Matrix3::identity(), &d), 0.0, 1.0).unwrap();
        assert!((0.498..=0.5).contains(&root), "{root}");
        let stretch = Matrix3::from_diagonal(&Vector::new(5.0, -0.9, 1.0));
        assert_eq!(first_root(&det_along(&Matrix3::identity(), &stretch), 0.0, 1.0), None);
    }
}
