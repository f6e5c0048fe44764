use super::bricks::{Bricks, NO_BRICK, Reach};
use super::lattice::{EDGE, Lattice};
use super::spline::{self, Jet, Rows, Weights};
use crate::geometry::{Aabb, Implicit, Point, Vector};
use nalgebra::Matrix3;

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
    pub(super) domain: Aabb,
    /// Coefficients of the coarse spline, x fastest, ring included.
    pub(super) coarse: Vec<f64>,
    /// Number of a place's brick, or [`NO_BRICK`].
    pub(super) index: Vec<u32>,
    pub(super) bricks: Bricks,
    /// Numbers of the eight finer bricks in each brick, x fastest, or [`NO_BRICK`]; empty when there are none at all.
    pub(super) children: Vec<[u32; 8]>,
    pub(super) details: Bricks,
}

/// The polynomial of the cell around a point.
struct Cell {
    rows: Rows,
    /// What the coefficients are worth, mm.
    step: f64,
    weights: [Weights; 3],
    spacing: f64,
}

/// The two lattices of bricks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Level {
    Brick,
    Detail,
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
        self.domain
    }

    /// Finest spacing, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.lattice.spacing
    }

    /// Bricks at the finest spacing and at half of it.
    #[must_use]
    pub fn n_bricks(&self) -> usize {
        self.bricks.len() + self.details.len()
    }

    /// Memory of the field, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.coarse[..])
            + size_of_val(&self.index[..])
            + size_of_val(&self.children[..])
            + self.bricks.bytes()
            + self.details.bytes()
    }

    /// The closest point of the domain, and when `p` is outside the unit vector from there to `p` and its distance.
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

    fn jet(&self, inner: &Point) -> Jet {
        let (cell, detail) = self.cells(inner);
        let mut jet = cell.jet();
        if let Some(detail) = detail {
            let detail = detail.jet();
            jet.value += detail.value;
            jet.gradient += detail.gradient;
            jet.hessian += detail.hessian;
        }
        jet
    }

    /// The cell of bricks (or of the coarse spline) around a point, and that of details if there are any.
    #[inline]
    fn cells(&self, inner: &Point) -> (Cell, Option<Cell>) {
        let lattice = &self.lattice;
        let (h, inverse) = (lattice.spacing, 1.0 / lattice.spacing);
        let u = (inner - lattice.origin) * inverse;
        let [nx, ny, nz] = lattice.bricks;
        let (i, x) = nearest_node(u.x, EDGE * nx);
        let (j, y) = nearest_node(u.y, EDGE * ny);
        let (k, z) = nearest_node(u.z, EDGE * nz);
        let detail = if self.children.is_empty() { None } else { self.detail(&u) };
        if let Some(rows) = self.gather([i, j, k]) {
            return (Cell { rows, step: self.bricks.step(), weights: [x, y, z], spacing: h }, detail);
        }
        let brick = [i / EDGE, j / EDGE, k / EDGE];
        let mut weights = [x, y, z];
        for a in 0..3 {
            let middle = (brick[a] * EDGE) as f64 + 0.5 * (EDGE as f64 - 1.0);
            weights[a] = Weights::at(((u[a] - middle) / EDGE as f64).clamp(-0.5, 0.5));
        }
        let rows = spline::rows(&self.coarse_around(brick));
        (Cell { rows, step: 1.0, weights, spacing: lattice.coarse_spacing() }, detail)
    }

    /// The cell of details around a point `u`, in nodes of the bricks.
    #[inline]
    fn detail(&self, u: &Vector) -> Option<Cell> {
        let [nx, ny, nz] = self.lattice.bricks;
        let (i, x) = nearest_node(2.0 * u.x + 0.5, 2 * EDGE * nx);
        let (j, y) = nearest_node(2.0 * u.y + 0.5, 2 * EDGE * ny);
        let (k, z) = nearest_node(2.0 * u.z + 0.5, 2 * EDGE * nz);
        let brick = [i / EDGE, j / EDGE, k / EDGE].map(|b| b as isize);
        let own = self.slot(Level::Detail, brick[0], brick[1], brick[2]);
        if own == NO_BRICK {
            return None;
        }
        let along = [Reach::of(i, 1), Reach::of(j, EDGE), Reach::of(k, EDGE * EDGE)];
        let slots = self.slots(Level::Detail, brick, own, &along);
        let rows = spline::rows(&self.details.some_around(&slots, &along));
        Some(Cell { rows, step: self.details.step(), weights: [x, y, z], spacing: 0.5 * self.lattice.spacing })
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

    /// The codes around a node; `None` when none of them has a brick, so that the coarse spline says the same.
    #[inline(always)]
    fn gather(&self, node: [usize; 3]) -> Option<Rows> {
        let bricks = &self.bricks;
        let brick = [(node[0] / EDGE) as isize, (node[1] / EDGE) as isize, (node[2] / EDGE) as isize];
        let own = self.slot(Level::Brick, brick[0], brick[1], brick[2]);
        let along = [Reach::of(node[0], 1), Reach::of(node[1], EDGE), Reach::of(node[2], EDGE * EDGE)];
        let [x, y, z] = &along;
        if x.other | y.other | z.other == 0 {
            return (own != NO_BRICK).then(|| bricks.rows(|_, _| own, x.places[0], &y.places, &z.places));
        }
        let slots = self.slots(Level::Brick, brick, own, &along);
        if slots.contains(&NO_BRICK) {
            return self.gather_some(node, &slots, &along);
        }
        if x.other == 0 {
            return Some(bricks.rows(|j, k| slots[y.lies[j] << 1 | z.lies[k] << 2], x.places[0], &y.places, &z.places));
        }
        Some(spline::rows(&bricks.some_around(&slots, &along)))
    }

    /// Numbers of the up to eight bricks that hold the nodes around one in the brick `own`; along each axis at most one other
    /// brick is touched.
    #[inline(always)]
    fn slots(&self, level: Level, brick: [isize; 3], own: u32, [x, y, z]: &[Reach; 3]) -> [u32; 8] {
        let crossed = usize::from(x.other != 0) | usize::from(y.other != 0) << 1 | usize::from(z.other != 0) << 2;
        let mut slots = [own; 8];
        for n in 1..8 {
            slots[n] = if n & crossed == n {
                let along = |bit: usize, other: isize| if n & bit == 0 { 0 } else { other };
                self.slot(
                    level,
                    brick[0] + along(1, x.other),
                    brick[1] + along(2, y.other),
                    brick[2] + along(4, z.other),
                )
            } else {
                slots[n & crossed]
            };
        }
        slots
    }

    /// [`DistanceField::gather`] where some of the bricks do not exist.
    #[cold]
    fn gather_some(&self, node: [usize; 3], slots: &[u32; 8], along: &[Reach; 3]) -> Option<Rows> {
        if slots.iter().all(|s| *s == NO_BRICK) {
            return None;
        }
        let mut c = self.bricks.some_around(slots, along);
        let [x, y, z] = along;
        for (n, c) in c.iter_mut().enumerate() {
            let (i, j, k) = (n % 3, n / 3 % 3, n / 9);
            if slots[x.lies[i] | y.lies[j] << 1 | z.lies[k] << 2] == NO_BRICK {
                let at = [node[0] + i, node[1] + j, node[2] + k].map(|n| n as isize - 1);
                *c = self.refined_coarse(at) / self.bricks.step();
            }
        }
        Some(spline::rows(&c))
    }

    /// Where each brick of a level lies, in bricks of that level.
    pub(super) fn places(&self, level: Level) -> Vec<[i32; 3]> {
        let mut places = vec![[0; 3]; self.bricks_of(level).len()];
        for (place, &slot) in self.index.iter().enumerate().filter(|(_, slot)| **slot != NO_BRICK) {
            let at = self.lattice.brick_at(place).map(|n| n as i32);
            match level {
                Level::Brick => places[slot as usize] = at,
                Level::Detail => {
                    let children = self.children.get(slot as usize).into_iter().flatten().enumerate();
                    for (n, &child) in children.filter(|(_, child)| **child != NO_BRICK) {
                        places[child as usize] = [0, 1, 2].map(|a| 2 * at[a] + (n >> a & 1) as i32);
                    }
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
    #[inline]
    pub(super) fn slot(&self, level: Level, x: isize, y: isize, z: isize) -> u32 {
        let shift = i32::from(level == Level::Detail);
        let [nx, ny, nz] = self.lattice.bricks;
        // Negative places become too large ones.
        let (i, j, k) = ((x >> shift) as usize, (y >> shift) as usize, (z >> shift) as usize);
        if i >= nx || j >= ny || k >= nz {
            return NO_BRICK;
        }
        let slot = self.index[i + nx * (j + ny * k)];
        if slot == NO_BRICK || level == Level::Brick {
            return slot;
        }
        let child = (x & 1) | (y & 1) << 1 | (z & 1) << 2;
        self.children.get(slot as usize).map_or(NO_BRICK, |children| children[child as usize])
    }

    /// Coefficient of the bricks' spline at any node within one brick of the domain, mm.
    pub(super) fn coefficient(&self, node: [isize; 3]) -> f64 {
        let edge = EDGE as isize;
        let brick = node.map(|n| n.div_euclid(edge));
        let slot = self.slot(Level::Brick, brick[0], brick[1], brick[2]);
        if slot == NO_BRICK {
            return self.refined_coarse(node);
        }
        let [i, j, k] = node.map(|n| n.rem_euclid(edge) as usize);
        self.bricks.step() * self.bricks.at(slot, i + EDGE * (j + EDGE * k))
    }

    /// Coefficient of the details at any node of theirs, mm; 0 where there are none.
    pub(super) fn detail_coefficient(&self, node: [isize; 3]) -> f64 {
        let edge = EDGE as isize;
        let brick = node.map(|n| n.div_euclid(edge));
        let slot = self.slot(Level::Detail, brick[0], brick[1], brick[2]);
        if slot == NO_BRICK {
            return 0.0;
        }
        let [i, j, k] = node.map(|n| n.rem_euclid(edge) as usize);
        self.details.step() * self.details.at(slot, i + EDGE * (j + EDGE * k))
    }

    /// Coefficient that the coarse spline has at a node of the finer lattice: its polar form at the two ends of the node's cell.
    fn refined_coarse(&self, node: [isize; 3]) -> f64 {
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

/// The node nearest to `u` (in nodes) among `count`, and the weights of it and its neighbours.
#[inline]
fn nearest_node(u: f64, count: usize) -> (usize, Weights) {
    let n = ((u + 0.5).max(0.0) as usize).min(count - 1);
    (n, Weights::at((u - n as f64).clamp(-0.5, 0.5)))
}

impl Cell {
    fn jet(&self) -> Jet {
        let mut jet = spline::jet(&self.rows, &self.weights);
        let inverse = 1.0 / self.spacing;
        jet.value *= self.step;
        jet.gradient *= self.step * inverse;
        jet.hessian *= self.step * inverse * inverse;
        jet
    }

    fn value(&self) -> f64 {
        self.step * spline::value(&self.rows, &self.weights)
    }

    fn value_gradient(&self) -> (f64, Vector) {
        let (value, gradient) = spline::value_gradient(&self.rows, &self.weights);
        (self.step * value, gradient * (self.step / self.spacing))
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
        let (cell, detail) = self.cells(&inner);
        let (mut value, mut gradient) = cell.value_gradient();
        if let Some(detail) = detail {
            let (v, g) = detail.value_gradient();
            value += v;
            gradient += g;
        }
        if let Some((direction, distance)) = beyond {
            // Moving along an axis that was cut off does not move the closest point of the box.
            gradient = gradient.zip_map(&direction, |g, d| if d == 0.0 { g } else { d });
            value += distance;
        }
        (value, gradient)
    }
}
