//! Value, gradient and Hessian of a field at a point.

use super::bricks::{Bricks, NO_BRICK, Reach, place, row_of};
use super::distance_field::DistanceField;
use super::lattice::{BRICK, DETAIL_EDGE, EDGE};
use super::spline::{self, Jet, Rows, Weights};
use crate::geometry::{Implicit, Point, Vector};
use nalgebra::Matrix3;
use pulp::{Simd, WithSimd};

/// The polynomial of the cell around a point.
struct Cell {
    rows: Rows,
    /// What the coefficients are worth, mm.
    step: f64,
    weights: [Weights; 3],
    /// Nodes in a mm.
    per_mm: f64,
}

impl DistanceField {
    /// Value (mm), gradient (dimensionless) and Hessian (1/mm) at `p`.
    ///
    /// The Hessian jumps between fine cells; on such a face it is that of one side.
    #[must_use]
    pub fn value_gradient_hessian(&self, p: &Point) -> (f64, Vector, Matrix3<f64>) {
        let (inner, beyond) = self.clamped(p);
        let mut jet = self.arch.dispatch(JetTask { field: self, inner: &inner });
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

    /// The closest point of the domain, and when `p` is outside the unit vector from there to `p` and its distance.
    #[inline]
    fn clamped(&self, p: &Point) -> (Point, Option<(Vector, f64)>) {
        let domain = &self.domain;
        if (0..3).all(|a| domain.min[a] <= p[a] && p[a] <= domain.max[a]) {
            return (*p, None);
        }
        let inner = p.sup(&domain.min).inf(&domain.max);
        let offset = p - inner;
        let distance = offset.norm();
        (inner, (distance > 0.0).then(|| (offset / distance, distance)))
    }

    /// The cell of bricks (or of the coarse spline) around a point, and that of details if there are any.
    #[inline(always)]
    fn cells(&self, inner: &Point) -> (Cell, Option<Cell>) {
        let lattice = &self.lattice;
        let u = (inner - lattice.origin) * lattice.per_mm;
        let mut node = [0; 3];
        let mut weights = [Weights::at(0.0); 3];
        for a in 0..3 {
            (node[a], weights[a]) = nearest_node(u[a], EDGE * lattice.bricks[a]);
        }
        let along = node.map(|n| Reach::of(n, EDGE));
        let [nx, ny, _] = lattice.index_dims();
        let base = lattice.index_of(node.map(|n| n / EDGE));
        let steps = [along[0].other, along[1].other * nx as isize, along[2].other * (nx * ny) as isize];
        let mut slots = [0; 8];
        for (n, slot) in slots.iter_mut().enumerate() {
            let mut at = base;
            for (a, step) in steps.iter().enumerate() {
                if n >> a & 1 == 1 {
                    at = at.wrapping_add_signed(*step);
                }
            }
            *slot = self.index[at];
        }
        if slots.contains(&NO_BRICK) {
            return self.outer_cells(&u, node, &weights, &along, &slots);
        }
        let [x, y, z] = &along;
        let first = |side: usize, x: usize| {
            let mut first = [[0; 3]; 3];
            for (k, first) in first.iter_mut().enumerate() {
                for (j, first) in first.iter_mut().enumerate() {
                    let slot = slots[side | y.lies[j] << 1 | z.lies[k] << 2] as usize;
                    *first = slot * BRICK + row_of(y.places[j], z.places[k]) + x;
                }
            }
            first
        };
        let rows = if x.is_inner() {
            self.bricks.rows(&first(0, x.places[0]))
        } else {
            self.bricks.columns(&[first(0, 0), first(1, 0)], x)
        };
        let cell = Cell { rows, step: self.bricks.step(), weights, per_mm: lattice.per_mm };
        let has_details = self.parts.get(slots[0] as usize).is_some_and(|parts| parts.mask != 0);
        (cell, if has_details { self.detail(&u) } else { None })
    }

    /// [`DistanceField::cells`] where some of the bricks around do not exist.
    #[cold]
    fn outer_cells(
        &self,
        u: &Vector,
        node: [usize; 3],
        weights: &[Weights; 3],
        along: &[Reach; 3],
        slots: &[u32; 8],
    ) -> (Cell, Option<Cell>) {
        let lattice = &self.lattice;
        if slots.iter().any(|s| *s != NO_BRICK) {
            let step = self.bricks.step();
            let missing = |n: usize| {
                let at = [n % 3, n / 3 % 3, n / 9];
                self.refined_coarse([0, 1, 2].map(|a| (node[a] + at[a]) as isize - 1)) / step
            };
            let c = some_around(&self.bricks, EDGE, slots, along, missing);
            let cell = Cell { rows: spline::rows(&c), step, weights: *weights, per_mm: lattice.per_mm };
            return (cell, if slots[0] == NO_BRICK { None } else { self.detail(u) });
        }
        // The coarse spline says the same.
        let brick = node.map(|n| n / EDGE);
        let mut weights = [Weights::at(0.0); 3];
        for a in 0..3 {
            let middle = (brick[a] * EDGE) as f64 + 0.5 * (EDGE as f64 - 1.0);
            weights[a] = Weights::at(((u[a] - middle) / EDGE as f64).clamp(-0.5, 0.5));
        }
        let rows = spline::rows(&self.coarse_around(brick));
        (Cell { rows, step: 1.0, weights, per_mm: 1.0 / lattice.coarse_spacing() }, None)
    }

    /// The cell of details around a point `u`, in nodes of the bricks.
    #[inline(always)]
    fn detail(&self, u: &Vector) -> Option<Cell> {
        let lattice = &self.lattice;
        let mut node = [0; 3];
        let mut weights = [Weights::at(0.0); 3];
        for a in 0..3 {
            (node[a], weights[a]) = nearest_node(2.0 * u[a] + 0.5, 2 * EDGE * lattice.bricks[a]);
        }
        let brick = node.map(|n| n / DETAIL_EDGE);
        let own = self.detail_slot(brick.map(|b| b as isize));
        if own == NO_BRICK {
            return None;
        }
        let along = node.map(|n| Reach::of(n, DETAIL_EDGE));
        let mut slots = [own; 8];
        for (n, slot) in slots.iter_mut().enumerate().skip(1) {
            let step = |a: usize| if n >> a & 1 == 1 { along[a].other } else { 0 };
            *slot = self.detail_slot([0, 1, 2].map(|a| brick[a] as isize + step(a)));
        }
        let rows = spline::rows(&some_around(&self.details, DETAIL_EDGE, &slots, &along, |_| 0.0));
        Some(Cell { rows, step: self.details.step(), weights, per_mm: 2.0 * lattice.per_mm })
    }
}

/// Codes around a node, x fastest, of bricks whose numbers are `slots`, and what `missing` says where there is none.
#[inline(always)]
fn some_around(
    bricks: &Bricks,
    edge: usize,
    slots: &[u32; 8],
    [x, y, z]: &[Reach; 3],
    missing: impl Fn(usize) -> f64,
) -> [f64; 27] {
    let mut c = [0.0; 27];
    for k in 0..3 {
        for j in 0..3 {
            for i in 0..3 {
                let n = 9 * k + 3 * j + i;
                let slot = slots[x.lies[i] | y.lies[j] << 1 | z.lies[k] << 2];
                c[n] = match slot {
                    NO_BRICK => missing(n),
                    slot => bricks.at(slot, place(edge, [x.places[i], y.places[j], z.places[k]])),
                };
            }
        }
    }
    c
}

/// The node nearest to `u` (in nodes, at most half a node off the lattice) among `count`, and the weights of it and its
/// neighbours.
#[inline(always)]
fn nearest_node(u: f64, count: usize) -> (usize, Weights) {
    /// Adding it leaves the nearest integer in the lowest bits.
    const ROUNDING: f64 = 6_755_399_441_055_744.0;
    let u = if u > -0.5 { u } else { -0.5 };
    let n = ((u + ROUNDING).to_bits() as i32).min(count as i32 - 1);
    let t = u - f64::from(n);
    (n as usize, Weights::at(if t < 0.5 { t } else { 0.5 }))
}

impl Cell {
    #[inline(always)]
    fn jet(&self) -> Jet {
        let mut jet = spline::jet(&self.rows, &self.weights);
        jet.value *= self.step;
        jet.gradient *= self.step * self.per_mm;
        jet.hessian *= self.step * self.per_mm * self.per_mm;
        jet
    }

    #[inline(always)]
    fn value(&self) -> f64 {
        self.step * spline::value(&self.rows, &self.weights)
    }

    #[inline(always)]
    fn value_gradient(&self) -> (f64, Vector) {
        let (value, gradient) = spline::value_gradient(&self.rows, &self.weights);
        (self.step * value, gradient * (self.step * self.per_mm))
    }
}

/// Value, gradient and Hessian in the domain, for the vectors of this machine.
struct JetTask<'a> {
    field: &'a DistanceField,
    inner: &'a Point,
}

impl WithSimd for JetTask<'_> {
    type Output = Jet;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Jet {
        let (cell, detail) = self.field.cells(self.inner);
        let mut jet = cell.jet();
        if let Some(detail) = detail {
            let detail = detail.jet();
            jet.value += detail.value;
            jet.gradient += detail.gradient;
            jet.hessian += detail.hessian;
        }
        jet
    }
}

/// The same without the Hessian.
struct SlopeTask<'a> {
    field: &'a DistanceField,
    inner: &'a Point,
}

impl WithSimd for SlopeTask<'_> {
    type Output = (f64, Vector);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> (f64, Vector) {
        let (cell, detail) = self.field.cells(self.inner);
        let (value, gradient) = cell.value_gradient();
        let Some(detail) = detail else { return (value, gradient) };
        let more = detail.value_gradient();
        (value + more.0, gradient + more.1)
    }
}

impl Implicit for DistanceField {
    fn value(&self, p: &Point) -> f64 {
        let (inner, beyond) = self.clamped(p);
        let (cell, detail) = self.cells(&inner);
        cell.value() + detail.map_or(0.0, |d| d.value()) + beyond.map_or(0.0, |(_, distance)| distance)
    }

    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        self.value_gradient_hessian(p).2
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (inner, beyond) = self.clamped(p);
        let (mut value, mut gradient) = self.arch.dispatch(SlopeTask { field: self, inner: &inner });
        if let Some((direction, distance)) = beyond {
            // Moving along an axis that was cut off does not move the closest point of the box.
            gradient = gradient.zip_map(&direction, |g, d| if d == 0.0 { g } else { d });
            value += distance;
        }
        (value, gradient)
    }
}
