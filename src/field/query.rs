//! Value, gradient and Hessian of a field at a point.

use super::bricks::{Bricks, NO_BRICK, Reach, is_within, place};
use super::distance_field::DistanceField;
use super::lanes::{Lanes, Plain};
use super::lattice::{DETAIL_EDGE, EDGE, PARTS};
use super::spline::{self, Between, Jet};
use nalgebra::Matrix3;
use prosopon_geometry::{Implicit, Point, Vector};

/// The node nearest to a point, and the point's position around it.
#[derive(Clone, Copy)]
struct Spot {
    /// Index of the node in its brick, along each axis.
    local: [usize; 3],
    /// Position of the point between the nodes around, along each axis.
    at: [Between; 3],
    /// Bricks of the node and its neighbours; bit a of the index selects the other brick along axis a.
    slots: [u32; 8],
}

impl DistanceField {
    /// Value (mm), gradient (dimensionless) and Hessian (1/mm) at `p` (LPS mm).
    ///
    /// The Hessian jumps across faces between cells; on such a face it is that of one side.
    #[must_use]
    pub fn value_gradient_hessian(&self, p: &Point) -> (f64, Vector, Matrix3<f64>) {
        let (inner, beyond) = self.clamped(p);
        let mut jet = self.jet(&inner);
        let Some((direction, distance)) = beyond else { return (jet.value, jet.gradient, jet.hessian) };
        // A step along a clamped axis does not move the closest point of the box.
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

    /// The closest point of the domain; for `p` outside also the unit vector to `p` and the distance, mm.
    #[inline]
    fn clamped(&self, p: &Point) -> (Point, Option<(Vector, f64)>) {
        if self.holds(p) {
            return (*p, None);
        }
        let domain = &self.domain;
        let inner = p.sup(&domain.min).inf(&domain.max);
        let offset = p - inner;
        let distance = offset.norm();
        (inner, (distance > 0.0).then(|| (offset / distance, distance)))
    }

    /// Makes further queries run without the vector instructions of this processor.
    #[cfg(test)]
    pub(super) fn without_vectors(&mut self) {
        #[cfg(target_arch = "x86_64")]
        {
            self.v3 = None;
        }
    }

    /// The spline at a point of the domain.
    #[inline(always)]
    fn jet(&self, inner: &Point) -> Jet {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = self.v3 {
            return pulp::Simd::vectorize(v3, JetTask { field: self, inner, lanes: v3 });
        }
        self.jet_with(Plain, inner)
    }

    #[inline(always)]
    fn jet_with<L: Lanes>(&self, lanes: L, inner: &Point) -> Jet {
        let spot = self.spot(inner);
        if !is_whole(&spot) {
            return self.outer_jet(inner, &spot);
        }
        let mut jet = self.brick_jet(lanes, &self.bricks.around::<EDGE>(&spot.slots, spot.local), &spot.at);
        if let Some(detail) = self.detail_spot(inner, &spot) {
            let words = self.details.around::<DETAIL_EDGE>(&detail.slots, detail.local);
            jet.add(&self.detail_jet(lanes, &words, &detail.at));
        }
        jet
    }

    #[inline(always)]
    fn brick_jet<L: Lanes>(&self, lanes: L, words: &[u64; 9], at: &[Between; 3]) -> Jet {
        spline::jet(lanes, &spline::rows(lanes, words), at).scaled(self.bricks.step(), self.lattice.per_mm)
    }

    #[inline(always)]
    fn detail_jet<L: Lanes>(&self, lanes: L, words: &[u64; 9], at: &[Between; 3]) -> Jet {
        spline::jet(lanes, &spline::rows(lanes, words), at).scaled(self.details.step(), 2.0 * self.lattice.per_mm)
    }

    #[inline(always)]
    fn holds(&self, p: &Point) -> bool {
        let domain = &self.domain;
        (0..3).all(|a| domain.min[a] <= p[a] && p[a] <= domain.max[a])
    }

    /// The node nearest to a point of the domain, and the point's position around it.
    #[inline(always)]
    fn in_nodes(&self, inner: &Point) -> Vector {
        (inner - self.lattice.origin) * self.lattice.per_mm
    }

    #[inline(always)]
    fn spot(&self, inner: &Point) -> Spot {
        let lattice = &self.lattice;
        let u = self.in_nodes(inner);
        let (i, x) = nearest_node(u.x, EDGE * lattice.bricks[0]);
        let (j, y) = nearest_node(u.y, EDGE * lattice.bricks[1]);
        let (k, z) = nearest_node(u.z, EDGE * lattice.bricks[2]);
        let local = [i % EDGE, j % EDGE, k % EDGE];
        let [nx, ny, _] = lattice.index_dims();
        let first = lattice.index_of([i / EDGE, j / EDGE, k / EDGE]);
        let own = self.index[first];
        if is_within(local, EDGE) {
            return Spot { local, at: [x, y, z], slots: [own; 8] };
        }
        let step = |a: usize| Reach::of(local[a], EDGE).other;
        let second = first.wrapping_add_signed(step(1) * nx as isize);
        let above = step(2) * (nx * ny) as isize;
        let rows = [first, second, first.wrapping_add_signed(above), second.wrapping_add_signed(above)];
        let mut slots = [0; 8];
        for (n, row) in rows.iter().enumerate() {
            slots[2 * n] = self.index[*row];
            slots[2 * n + 1] = self.index[row.wrapping_add_signed(step(0))];
        }
        Spot { local, at: [x, y, z], slots }
    }

    /// The same for the detail level, if there is one; all bricks around `spot` exist.
    #[inline(always)]
    fn detail_spot(&self, inner: &Point, spot: &Spot) -> Option<Spot> {
        if self.parts.get(spot.slots[0] as usize)?.mask == 0 {
            return None;
        }
        let lattice = &self.lattice;
        let u = self.in_nodes(inner);
        let none = self.details.none();
        let mut at = [Between::at(0.0); 3];
        let mut local = [0; 3];
        // Along each axis: the detail bricks that hold the node and its neighbours, and whether the second lies in the other
        // brick.
        let mut parts = [[0; 2]; 3];
        let mut beyond = [0; 3];
        for a in 0..3 {
            let (node, between) = nearest_node(2.0 * u[a] + 0.5, 2 * EDGE * lattice.bricks[a]);
            (at[a], local[a]) = (between, node % DETAIL_EDGE);
            let part = node / DETAIL_EDGE % PARTS;
            let other = part.wrapping_add_signed(Reach::of(local[a], DETAIL_EDGE).other);
            parts[a] = [part, other % PARTS];
            beyond[a] = usize::from(other >= PARTS) << a;
        }
        let mut slots = [none; 8];
        let own = self
            .parts
            .get(spot.slots[0] as usize)?
            .slot_or(place(PARTS, [parts[0][0], parts[1][0], parts[2][0]]), none);
        if own == none || is_within(local, DETAIL_EDGE) {
            return (own != none).then_some(Spot { local, at, slots: [own; 8] });
        }
        for (n, slot) in slots.iter_mut().enumerate() {
            let [x, y, z] = [n & 1, n >> 1 & 1, n >> 2];
            let brick = (x * beyond[0]) | (y * beyond[1]) | (z * beyond[2]);
            if let Some(of_brick) = self.parts.get(spot.slots[brick] as usize) {
                *slot = of_brick.slot_or(place(PARTS, [parts[0][x], parts[1][y], parts[2][z]]), none);
            }
        }
        Some(Spot { local, at, slots })
    }

    /// The spline where some of the bricks around a point are missing.
    #[cold]
    #[inline(never)]
    fn outer_jet(&self, inner: &Point, spot: &Spot) -> Jet {
        let lattice = &self.lattice;
        let u = self.in_nodes(inner);
        let along = spot.local.map(|n| Reach::of(n, EDGE));
        let node = [0, 1, 2].map(|a| nearest_node(u[a], EDGE * lattice.bricks[a]).0);
        if spot.slots.iter().all(|s| *s == NO_BRICK) {
            // The coarse spline has the same value there.
            let brick = node.map(|n| n / EDGE);
            let at = [0, 1, 2].map(|a| {
                let middle = (brick[a] * EDGE) as f64 + 0.5 * (EDGE as f64 - 1.0);
                Between::at(((u[a] - middle) / EDGE as f64).clamp(-0.5, 0.5))
            });
            let rows = in_rows(&self.coarse_around(brick));
            return spline::jet(Plain, &rows, &at).scaled(1.0, 1.0 / lattice.coarse_spacing());
        }
        let step = self.bricks.step();
        let missing = |n: usize| {
            let at = [n % 3, n / 3 % 3, n / 9];
            self.refined_coarse([0, 1, 2].map(|a| (node[a] + at[a]) as isize - 1)) / step
        };
        let rows = in_rows(&some_around(&self.bricks, &spot.slots, &along, missing));
        let mut jet = spline::jet(Plain, &rows, &spot.at).scaled(step, lattice.per_mm);
        if spot.slots[0] != NO_BRICK
            && let Some(detail) = self.detail_spot(inner, spot)
        {
            let words = self.details.around::<DETAIL_EDGE>(&detail.slots, detail.local);
            jet.add(&self.detail_jet(Plain, &words, &detail.at));
        }
        jet
    }
}

/// Whether all bricks around a point exist.
#[inline(always)]
fn is_whole(spot: &Spot) -> bool {
    let mut largest = 0;
    for slot in spot.slots {
        largest = slot.max(largest);
    }
    largest != NO_BRICK
}

/// The spline in the domain, compiled for this processor's vectors; a closure is not (measured).
#[cfg(target_arch = "x86_64")]
struct JetTask<'a, L> {
    field: &'a DistanceField,
    inner: &'a Point,
    lanes: L,
}

#[cfg(target_arch = "x86_64")]
impl<L: Lanes> pulp::WithSimd for JetTask<'_, L> {
    type Output = Jet;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Jet {
        self.field.jet_with(self.lanes, self.inner)
    }
}

/// Coefficients in rows along x; the fourth entry of a row is padding.
fn in_rows(c: &[f64; 27]) -> [[f64; 4]; 9] {
    std::array::from_fn(|n| [c[3 * n], c[3 * n + 1], c[3 * n + 2], 0.0])
}

/// Codes around a node, x fastest; `slots` are the bricks, `missing` gives codes where there is none.
fn some_around(bricks: &Bricks, slots: &[u32; 8], [x, y, z]: &[Reach; 3], missing: impl Fn(usize) -> f64) -> [f64; 27] {
    std::array::from_fn(|n| {
        let [i, j, k] = [n % 3, n / 3 % 3, n / 9];
        match slots[x.lies[i] | y.lies[j] << 1 | z.lies[k] << 2] {
            NO_BRICK => missing(n),
            slot => bricks.at(slot, place(EDGE, [x.places[i], y.places[j], z.places[k]])),
        }
    })
}

/// The node nearest to `u` and the position of `u` around it; `count` is the number of nodes.
///
/// `u` is in nodes and at most half a node outside the lattice.
#[inline(always)]
fn nearest_node(u: f64, count: usize) -> (usize, Between) {
    /// Adding this leaves the nearest integer in the lowest bits of the mantissa.
    const ROUNDING: f64 = 6_755_399_441_055_744.0;
    let u = if u > -0.5 { u } else { -0.5 };
    let n = ((u + ROUNDING).to_bits() as i32).min(count as i32 - 1);
    let t = u - f64::from(n);
    (n as usize, Between::at(if t < 0.5 { t } else { 0.5 }))
}

impl Implicit for DistanceField {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }

    fn hessian(&self, p: &Point) -> Matrix3<f64> {
        self.value_gradient_hessian(p).2
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        let (value, gradient, _) = self.value_gradient_hessian(p);
        (value, gradient)
    }
}
