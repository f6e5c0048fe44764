use super::lattice::{BRICK, EDGE, Lattice};
use super::spline::{self, Jet, Weights};
use crate::geometry::{Aabb, Implicit, Point, Vector};
use nalgebra::Matrix3;

/// Marks a brick without detail.
pub(super) const NO_BRICK: u32 = u32::MAX;

/// Sparse bricks of quadratic B-spline coefficients over a coarse grid of the same kind.
///
/// The value is the coarse spline plus the detail spline, whose coefficients are zero outside the bricks: C1 everywhere in
/// the domain, one quadratic polynomial in x, y, z each in every fine cell. Beyond the domain's box it is the value at the
/// closest point of the box plus the distance to that point: continuous and growing.
#[derive(Debug, Clone)]
pub struct DistanceField {
    pub(super) lattice: Lattice,
    /// Coefficients of the coarse spline, x fastest, ring included.
    pub(super) coarse: Vec<f64>,
    /// Number of a brick's detail, or [`NO_BRICK`].
    pub(super) index: Vec<u32>,
    /// Coefficients of the detail spline, brick after brick, x fastest.
    pub(super) detail: Vec<f32>,
}

/// The coefficients around a point of the domain.
struct Stencil {
    coarse: [f64; 27],
    coarse_weights: [Weights; 3],
    fine: Option<[f64; 27]>,
    fine_weights: [Weights; 3],
}

impl DistanceField {
    /// Value (mm), gradient (dimensionless) and Hessian (1/mm) at `p`.
    ///
    /// The Hessian jumps between fine cells; on such a face it is that of one side.
    #[must_use]
    pub fn value_gradient_hessian(&self, p: &Point) -> (f64, Vector, Matrix3<f64>) {
        let (inner, beyond) = self.clamped(p);
        let mut jet = self.jet(&inner);
        let Some((direction, distance)) = beyond else { return (jet.value, jet.gradient, jet.hessian) };
        // Moving along an axis that was cut off does not move the closest point of the box.
        for a in 0..3 {
            if direction[a] != 0.0 {
                jet.gradient[a] = 0.0;
                jet.hessian.row_mut(a).fill(0.0);
                jet.hessian.column_mut(a).fill(0.0);
            }
        }
        let cut = Matrix3::from_diagonal(&direction.map(|d| if d == 0.0 { 0.0 } else { 1.0 }));
        let hessian = jet.hessian + (cut - direction * direction.transpose()) / distance;
        (jet.value + distance, jet.gradient + direction, hessian)
    }

    /// The box within which the field is a spline, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        self.lattice.domain()
    }

    /// Finest spacing, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.lattice.spacing
    }

    /// Memory of the field, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.coarse[..]) + size_of_val(&self.index[..]) + size_of_val(&self.detail[..])
    }

    /// The closest point of the domain, and when `p` is outside the unit vector from there to `p` and its distance.
    fn clamped(&self, p: &Point) -> (Point, Option<(Vector, f64)>) {
        let domain = self.lattice.domain();
        let inner = p.sup(&domain.min).inf(&domain.max);
        let offset = p - inner;
        let distance = offset.norm();
        (inner, (distance > 0.0).then(|| (offset / distance, distance)))
    }

    fn jet(&self, inner: &Point) -> Jet {
        let s = self.stencil(inner);
        let (h, coarse_h) = (self.lattice.spacing, self.lattice.coarse_spacing());
        let mut jet = spline::jet(&s.coarse, &s.coarse_weights);
        jet.gradient /= coarse_h;
        jet.hessian /= coarse_h * coarse_h;
        if let Some(fine) = &s.fine {
            let detail = spline::jet(fine, &s.fine_weights);
            jet.value += detail.value;
            jet.gradient += detail.gradient / h;
            jet.hessian += detail.hessian / (h * h);
        }
        jet
    }

    fn stencil(&self, inner: &Point) -> Stencil {
        let lattice = &self.lattice;
        let mut node = [0usize; 3];
        let mut coarse_weights = [Weights::at(0.0); 3];
        let mut fine_weights = coarse_weights;
        for a in 0..3 {
            let u = (inner[a] - lattice.origin[a]) / lattice.spacing;
            node[a] = ((u + 0.5).floor().max(0.0) as usize).min(EDGE * lattice.bricks[a] - 1);
            fine_weights[a] = Weights::at((u - node[a] as f64).clamp(-0.5, 0.5));
            let middle = (node[a] / EDGE * EDGE) as f64 + 0.5 * (EDGE as f64 - 1.0);
            coarse_weights[a] = Weights::at(((u - middle) / EDGE as f64).clamp(-0.5, 0.5));
        }
        let brick = node.map(|n| n / EDGE);
        Stencil { coarse: self.coarse_around(brick), coarse_weights, fine: self.detail_around(node), fine_weights }
    }

    pub(super) fn coarse_around(&self, brick: [usize; 3]) -> [f64; 27] {
        let dims = self.lattice.coarse_dims();
        let first = self.lattice.coarse_index(brick) - 1 - dims[0] * (1 + dims[1]);
        let mut c = [0.0; 27];
        for k in 0..3 {
            for j in 0..3 {
                let row = first + dims[0] * (j + dims[1] * k);
                c[9 * k + 3 * j..][..3].copy_from_slice(&self.coarse[row..row + 3]);
            }
        }
        c
    }

    /// The 27 detail coefficients around a fine node; `None` when all are zero for lack of bricks.
    fn detail_around(&self, node: [usize; 3]) -> Option<[f64; 27]> {
        let brick = node.map(|n| n / EDGE);
        let local = node.map(|n| n % EDGE);
        let mut c = [0.0; 27];
        if local.iter().all(|&l| l > 0 && l + 1 < EDGE) {
            let slot = self.index[self.lattice.brick_index(brick)];
            if slot == NO_BRICK {
                return None;
            }
            let first = slot as usize * BRICK + (local[0] - 1) + EDGE * ((local[1] - 1) + EDGE * (local[2] - 1));
            for k in 0..3 {
                for j in 0..3 {
                    let row = &self.detail[first + EDGE * (j + EDGE * k)..][..3];
                    for i in 0..3 {
                        c[9 * k + 3 * j + i] = f64::from(row[i]);
                    }
                }
            }
            return Some(c);
        }
        let mut any = false;
        for (n, c) in c.iter_mut().enumerate() {
            let step = [n % 3, n / 3 % 3, n / 9];
            if let Some(value) = detail_at(&self.lattice, &self.index, &self.detail, node, step) {
                *c = f64::from(value);
                any = true;
            }
        }
        any.then_some(c)
    }
}

/// Detail at the node `node + step - 1`; `None` where there is no brick.
pub(super) fn detail_at(
    lattice: &Lattice,
    index: &[u32],
    detail: &[f32],
    node: [usize; 3],
    step: [usize; 3],
) -> Option<f32> {
    let mut brick = [0; 3];
    let mut local = [0; 3];
    for a in 0..3 {
        let n = (node[a] + step[a]).checked_sub(1)?;
        if n >= EDGE * lattice.bricks[a] {
            return None;
        }
        brick[a] = n / EDGE;
        local[a] = n % EDGE;
    }
    let slot = index[lattice.brick_index(brick)];
    (slot != NO_BRICK).then(|| detail[slot as usize * BRICK + local[0] + EDGE * (local[1] + EDGE * local[2])])
}

impl Implicit for DistanceField {
    fn value(&self, p: &Point) -> f64 {
        let (inner, beyond) = self.clamped(p);
        let s = self.stencil(&inner);
        let fine = s.fine.map_or(0.0, |c| spline::value(&c, &s.fine_weights));
        spline::value(&s.coarse, &s.coarse_weights) + fine + beyond.map_or(0.0, |(_, distance)| distance)
    }

    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        self.value_gradient_hessian(p).2
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (inner, beyond) = self.clamped(p);
        let s = self.stencil(&inner);
        let (mut value, mut gradient) = spline::value_gradient(&s.coarse, &s.coarse_weights);
        gradient /= self.lattice.coarse_spacing();
        if let Some(fine) = &s.fine {
            let (v, g) = spline::value_gradient(fine, &s.fine_weights);
            value += v;
            gradient += g / self.lattice.spacing;
        }
        if let Some((direction, distance)) = beyond {
            // Moving along an axis that was cut off does not move the closest point of the box.
            gradient = gradient.zip_map(&direction, |g, d| if d == 0.0 { g } else { d });
            value += distance;
        }
        (value, gradient)
    }
}
