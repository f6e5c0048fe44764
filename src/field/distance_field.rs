use super::bricks::{Bricks, NO_BRICK, Reach, place, row_of};
use super::lattice::{BRICK, DETAIL_EDGE, EDGE, Lattice, PARTS};
use super::spline::{self, Jet, Rows, Weights};
use crate::geometry::{Aabb, Implicit, Point, Vector};
use nalgebra::Matrix3;
use pulp::{Arch, Simd, WithSimd};

/// A quadratic B-spline with coefficients on three lattices: a coarse one everywhere, bricks of one eighth of its spacing in
/// the band, and details of half that spacing where the surface needs them.
///
/// In the band a coefficient is that of its brick, or where there is none what the coarse spline has there when it is written
/// on the finer lattice (exact for splines: knots are divided). The details are added to that, none at their own border. So
/// the value is one C1 function everywhere in the domain, a quadratic polynomial in x, y, z each in every cell, whatever bricks
/// there are. Beyond the domain's box it is the value at the closest point of the box plus the distance to that point:
/// continuous and growing.
#[derive(Debug, Clone)]
pub struct DistanceField {
    pub(super) lattice: Lattice,
    domain: Aabb,
    /// Coefficients of the coarse spline, x fastest, ring included.
    coarse: Vec<f64>,
    /// Number of a place's brick, or [`NO_BRICK`], with a ring of those around.
    pub(super) index: Vec<u32>,
    pub(super) bricks: Bricks,
    /// The bricks of details in each brick; empty when there are none at all.
    pub(super) parts: Vec<Parts>,
    pub(super) details: Bricks,
    arch: Arch,
}

/// The bricks of details in a brick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parts {
    /// A bit for each place, x fastest.
    pub(super) mask: u64,
    /// Number of the first.
    pub(super) first: u32,
}

impl Parts {
    #[inline(always)]
    pub(super) fn slot(self, at: usize) -> u32 {
        let bit = 1u64 << at;
        if self.mask & bit == 0 { NO_BRICK } else { self.first + (self.mask & (bit - 1)).count_ones() }
    }

    /// Number of a place in a brick.
    #[inline(always)]
    pub(super) fn place(at: [usize; 3]) -> usize {
        place(PARTS, at.map(|n| n % PARTS))
    }
}

/// The polynomial of the cell around a point.
struct Cell {
    rows: Rows,
    /// What the coefficients are worth, mm.
    step: f64,
    weights: [Weights; 3],
    /// Nodes in a mm.
    per_mm: f64,
}

/// The two lattices of bricks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Level {
    Brick,
    Detail,
}

impl Level {
    /// Nodes along the edge of a brick.
    pub(super) fn edge(self) -> usize {
        match self {
            Self::Brick => EDGE,
            Self::Detail => DETAIL_EDGE,
        }
    }
}

impl DistanceField {
    /// A field that is its coarse spline alone; coefficients of bricks and of details are at most so large, mm.
    pub(super) fn coarse(lattice: Lattice, coarse: Vec<f64>, largest: [f64; 2]) -> Self {
        Self {
            index: vec![NO_BRICK; lattice.index_dims().iter().product()],
            domain: lattice.domain(),
            lattice,
            coarse,
            bricks: Bricks::new(largest[0], EDGE),
            parts: Vec::new(),
            details: Bricks::new(largest[1], DETAIL_EDGE),
            arch: Arch::new(),
        }
    }

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

    /// The box within which the field is a spline, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        self.domain
    }

    /// Finest spacing, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.lattice.spacing
    }

    /// Bricks of 8³ nodes at the finest spacing, and of 4³ at half of it.
    #[must_use]
    pub fn n_bricks(&self) -> usize {
        self.bricks.len() + self.details.len()
    }

    /// Whether the field has its finest spacing at `p`: false beyond the band, the domain, or the box that it was built within.
    #[must_use]
    pub fn is_fine_at(&self, p: &Point) -> bool {
        let u = (p - self.lattice.origin) * self.lattice.per_mm;
        let brick = [0, 1, 2].map(|a| ((u[a] + 0.5) / EDGE as f64).floor() as isize);
        self.slot(Level::Brick, brick) != NO_BRICK
    }

    /// Memory of the field, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.coarse[..])
            + size_of_val(&self.index[..])
            + size_of_val(&self.parts[..])
            + self.bricks.bytes()
            + self.details.bytes()
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

    /// Number of the brick of details at a place up to one brick beyond the domain.
    #[inline(always)]
    fn detail_slot(&self, at: [isize; 3]) -> u32 {
        // From the ring on.
        let [i, j, k] = at.map(|n| (n + PARTS as isize) as usize);
        let [nx, ny, _] = self.lattice.index_dims();
        let slot = self.index[i / PARTS + nx * (j / PARTS + ny * (k / PARTS))];
        self.parts.get(slot as usize).map_or(NO_BRICK, |parts| parts.slot(Parts::place([i, j, k])))
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

    /// Where each brick of a level lies, in bricks of that level.
    pub(super) fn places(&self, level: Level) -> Vec<[i32; 3]> {
        let mut places = vec![[0; 3]; self.bricks_of(level).len()];
        for n in 0..self.lattice.n_bricks() {
            let at = self.lattice.brick_at(n);
            let slot = self.index[self.lattice.index_of(at)];
            if slot == NO_BRICK {
                continue;
            }
            if level == Level::Brick {
                places[slot as usize] = at.map(|n| n as i32);
            } else if let Some(parts) = self.parts.get(slot as usize) {
                for n in (0..PARTS.pow(3)).filter(|n| parts.mask >> n & 1 == 1) {
                    let part = [n % PARTS, n / PARTS % PARTS, n / (PARTS * PARTS)];
                    places[parts.slot(n) as usize] = [0, 1, 2].map(|a| (PARTS * at[a] + part[a]) as i32);
                }
            }
        }
        places
    }

    pub(super) fn bricks_of_mut(&mut self, level: Level) -> &mut Bricks {
        match level {
            Level::Brick => &mut self.bricks,
            Level::Detail => &mut self.details,
        }
    }

    pub(super) fn bricks_of(&self, level: Level) -> &Bricks {
        match level {
            Level::Brick => &self.bricks,
            Level::Detail => &self.details,
        }
    }

    /// Number of the brick at a place of its level, or [`NO_BRICK`].
    pub(super) fn slot(&self, level: Level, at: [isize; 3]) -> u32 {
        let size = if level == Level::Brick { 1 } else { PARTS as isize };
        if (0..3).any(|a| at[a] < 0 || at[a] >= size * self.lattice.bricks[a] as isize) {
            return NO_BRICK;
        }
        match level {
            Level::Brick => self.index[self.lattice.index_of(at.map(|n| n as usize))],
            Level::Detail => self.detail_slot(at),
        }
    }

    /// Coefficient of the bricks' spline at any node within one brick of the domain, mm.
    pub(super) fn coefficient(&self, node: [isize; 3]) -> f64 {
        self.stored(Level::Brick, node).unwrap_or_else(|| self.refined_coarse(node))
    }

    /// Coefficient of the details at any node of theirs, mm; 0 where there are none.
    pub(super) fn detail_coefficient(&self, node: [isize; 3]) -> f64 {
        self.stored(Level::Detail, node).unwrap_or(0.0)
    }

    fn stored(&self, level: Level, node: [isize; 3]) -> Option<f64> {
        let edge = level.edge();
        let slot = self.slot(level, node.map(|n| n.div_euclid(edge as isize)));
        let place = place(edge, node.map(|n| n.rem_euclid(edge as isize) as usize));
        let bricks = self.bricks_of(level);
        (slot != NO_BRICK).then(|| bricks.step() * bricks.at(slot, place))
    }

    /// Coefficient that the coarse spline has at a node of the finer lattice: its polar form at the two ends of the node's cell.
    pub(super) fn refined_coarse(&self, node: [isize; 3]) -> f64 {
        let edge = EDGE as isize;
        let half = 0.5 / EDGE as f64;
        let mut brick = [0; 3];
        let mut weights = [[0.0; 3]; 3];
        for a in 0..3 {
            // The ring of coarse nodes reaches one brick beyond the domain.
            let last = self.lattice.bricks[a] as isize;
            brick[a] = node[a].div_euclid(edge).clamp(-1, last);
            let t = ((node[a] - brick[a] * edge) as f64 - 0.5 * (EDGE as f64 - 1.0)) / EDGE as f64;
            let square = t * t - half * half;
            weights[a] = [0.5 * (0.25 - t + square), 0.75 - square, 0.5 * (0.25 + t + square)];
        }
        let mut sum = 0.0;
        for k in 0..3 {
            for j in 0..3 {
                let row = self.lattice.coarse_index_beyond([
                    brick[0] - 1,
                    brick[1] + j as isize - 1,
                    brick[2] + k as isize - 1,
                ]);
                let line: f64 = (0..3).map(|i| weights[0][i] * self.coarse[row + i]).sum();
                sum += weights[2][k] * weights[1][j] * line;
            }
        }
        sum
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
