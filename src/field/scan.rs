//! Unsigned distances on a lattice by scan conversion of the features' regions.

use super::features::{Region, Shape};
use prosopon_geometry::Point;

/// Nodes along the edge of a storage block.
pub(super) const BLOCK: usize = 8;

/// Squared distances on a lattice, in blocks of 8³ nodes that keep neighbours close in memory.
#[derive(Debug, Clone)]
pub(super) struct Slab {
    /// Position of node (0, 0, 0).
    origin: Point,
    spacing: f64,
    dims: [usize; 3],
    /// Storage offsets along each axis; a node's index is the sum of three.
    places: [Vec<u32>; 3],
    /// Squared distances, mm²; infinite where no feature is within reach.
    squared: Vec<f32>,
}

impl Slab {
    /// A slab with infinite distances.
    pub(super) fn new(origin: Point, spacing: f64, dims: [usize; 3]) -> Self {
        let blocks = dims.map(|n| n.div_ceil(BLOCK));
        let mut places = [Vec::new(), Vec::new(), Vec::new()];
        let (mut within, mut between) = (1, BLOCK.pow(3));
        for a in 0..3 {
            places[a] = (0..dims[a]).map(|i| (i % BLOCK * within + i / BLOCK * between) as u32).collect();
            within *= BLOCK;
            between *= blocks[a];
        }
        Self { origin, spacing, dims, places, squared: vec![f32::INFINITY; between] }
    }

    /// Position of node (0, 0, 0).
    pub(super) fn origin(&self) -> Point {
        self.origin
    }

    /// Squared distance at a node, mm².
    pub(super) fn squared(&self, i: usize, j: usize, k: usize) -> f32 {
        self.squared[(self.places[0][i] + self.places[1][j] + self.places[2][k]) as usize]
    }

    /// Copies squared distances (mm²) of the row along x from (i, j, k) on.
    #[inline(always)]
    pub(super) fn copy_row(&self, i: usize, j: usize, k: usize, to: &mut [f32]) {
        let row = self.places[1][j] + self.places[2][k];
        for (to, place) in to.iter_mut().zip(&self.places[0][i..]) {
            *to = self.squared[(row + place) as usize];
        }
    }

    /// Lowers the squared distances in a region to those of its feature.
    #[inline(always)]
    pub(super) fn add(&mut self, region: &Region) {
        // Rows run along the region's longest axis, so that there are few. Nodes are counted from the node before the anchor, so
        // that single precision suffices.
        let axes = [region.axis, (region.axis + 1) % 3, (region.axis + 2) % 3];
        let spacing = self.spacing as f32;
        let inverse = 1.0 / spacing;
        let mut base = [0i32; 3];
        let mut shift = [0.0f32; 3];
        let mut first = [0i32; 3];
        let mut last = [0i32; 3];
        for (a, &axis) in axes.iter().enumerate() {
            let u = (region.anchor[axis] - self.origin[axis]) / self.spacing;
            let floor = u.floor();
            base[a] = floor as i32;
            shift[a] = (u - floor) as f32;
            // Steps to the slab's ends, limited to the range that single precision counts exactly.
            let (start, end) = (-base[a], self.dims[axis] as i32 - 1 - base[a]);
            first[a] = (region.min[axis] * inverse + shift[a]).ceil().max(start as f32) as i32;
            last[a] = (region.max[axis] * inverse + shift[a]).floor().min(end as f32) as i32;
            if first[a] > last[a] {
                return;
            }
        }
        let bounds = Bounds::of(region, axes, shift, inverse);
        let ends = [first[0] as f32, last[0] as f32];
        let sides = [first[1] as f32, last[1] as f32];
        let turned = |v: &[f32; 3]| [v[axes[0]], v[axes[1]], v[axes[2]]];
        let shape = match &region.shape {
            Shape::Plane(n) => Shape::Plane(turned(n)),
            Shape::Line(e) => Shape::Line(turned(e)),
            Shape::Point => Shape::Point,
        };
        for k in first[2]..=last[2] {
            let z = k as f32;
            let (y_min, y_max) = bounds.layer(z, sides);
            let plane = self.places[axes[2]][(base[2] + k) as usize];
            for j in ceil(y_min)..=floor_of(y_max) {
                let y = j as f32;
                let (low, high) = bounds.row(y, z, ends);
                let (i0, i1) = (ceil(low), floor_of(high));
                if i0 > i1 {
                    continue;
                }
                let row = plane + self.places[axes[1]][(base[1] + j) as usize];
                let places = &self.places[axes[0]][(base[0] + i0) as usize..=(base[0] + i1) as usize];
                let offset = [i0 as f32 - shift[0], y - shift[1], z - shift[2]].map(|c| c * spacing);
                fill(&mut self.squared, row, places, shape, offset, spacing);
            }
        }
    }
}

/// Lowers one row, stored at `row` plus `places`; its first node is at `offset` from the anchor.
#[inline(always)]
fn fill(squared: &mut [f32], row: u32, places: &[u32], shape: Shape, [x, y, z]: [f32; 3], h: f32) {
    match shape {
        Shape::Plane(n) => {
            let mut d = n[0] * x + n[1] * y + n[2] * z;
            let step = n[0] * h;
            for place in places {
                let value = &mut squared[(row + place) as usize];
                *value = smaller(*value, d * d);
                d += step;
            }
        }
        Shape::Line(e) => {
            let along = e[0] * x + e[1] * y + e[2] * z;
            let mut v = [x - along * e[0], y - along * e[1], z - along * e[2]];
            let step = [h - h * e[0] * e[0], -h * e[0] * e[1], -h * e[0] * e[2]];
            for place in places {
                let value = &mut squared[(row + place) as usize];
                *value = smaller(*value, v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
                for a in 0..3 {
                    v[a] += step[a];
                }
            }
        }
        Shape::Point => {
            let rest = y * y + z * z;
            let mut d = x;
            for place in places {
                let value = &mut squared[(row + place) as usize];
                *value = smaller(*value, d * d + rest);
                d += h;
            }
        }
    }
}

/// Bounds of a region on x, linear in y and z, and those on y that follow (Fourier elimination).
struct Bounds {
    low: [[f32; 3]; CUTS],
    high: [[f32; 3]; CUTS],
    n_low: usize,
    n_high: usize,
    /// Lower and upper bounds on y, linear in z.
    y_low: [[f32; 2]; PAIRS],
    y_high: [[f32; 2]; PAIRS],
    n_y_low: usize,
    n_y_high: usize,
}

const CUTS: usize = 13;
const PAIRS: usize = 24;
/// Half-spaces steeper than this are cut with this slope: their bound then excludes every row or none.
const STEEPEST: f32 = 1e-6;

impl Bounds {
    /// Bounds in nodes from the node before the anchor, which lies `shift` nodes before the anchor.
    #[inline(always)]
    fn of(region: &Region, axes: [usize; 3], shift: [f32; 3], inverse_spacing: f32) -> Self {
        let mut bounds = Self {
            low: [[0.0; 3]; CUTS],
            high: [[0.0; 3]; CUTS],
            n_low: 0,
            n_high: 0,
            y_low: [[0.0; 2]; PAIRS],
            y_high: [[0.0; 2]; PAIRS],
            n_y_low: 0,
            n_y_high: 0,
        };
        for cut in &region.half_spaces[..region.n_half_spaces] {
            let [nx, ny, nz] = axes.map(|a| cut.normal[a]);
            let inverse = 1.0 / if nx.abs() < STEEPEST { STEEPEST.copysign(nx) } else { nx };
            let limit = cut.limit * inverse_spacing + nx * shift[0] + ny * shift[1] + nz * shift[2];
            let bound = [limit * inverse, -ny * inverse, -nz * inverse];
            if inverse > 0.0 {
                bounds.high[bounds.n_high] = bound;
                bounds.n_high += 1;
            } else {
                bounds.low[bounds.n_low] = bound;
                bounds.n_low += 1;
            }
        }
        bounds.eliminate_x();
        bounds
    }

    /// Requires every lower bound on x below every upper one; pairs that exceed the array are skipped.
    #[inline(always)]
    fn eliminate_x(&mut self) {
        for l in &self.low[..self.n_low] {
            for h in &self.high[..self.n_high] {
                let slope = l[1] - h[1];
                if slope.abs() < 1e-4 * (l[1].abs() + h[1].abs()) + 1e-6 {
                    continue;
                }
                let inverse = 1.0 / slope;
                let bound = [(h[0] - l[0]) * inverse, (h[2] - l[2]) * inverse];
                if slope > 0.0 {
                    if self.n_y_high < PAIRS {
                        self.y_high[self.n_y_high] = bound;
                        self.n_y_high += 1;
                    }
                } else if self.n_y_low < PAIRS {
                    self.y_low[self.n_y_low] = bound;
                    self.n_y_low += 1;
                }
            }
        }
    }

    #[inline(always)]
    fn layer(&self, z: f32, [first, last]: [f32; 2]) -> (f32, f32) {
        let (mut low, mut high) = (first, last);
        for b in &self.y_low[..self.n_y_low] {
            low = larger(low, b[0] + b[1] * z);
        }
        for b in &self.y_high[..self.n_y_high] {
            high = smaller(high, b[0] + b[1] * z);
        }
        (smaller(low, last + 1.0) - 1e-3, larger(high, first - 1.0) + 1e-3)
    }

    #[inline(always)]
    fn row(&self, y: f32, z: f32, [first, last]: [f32; 2]) -> (f32, f32) {
        let (mut low, mut high) = (first, last);
        for b in &self.low[..self.n_low] {
            low = larger(low, b[0] + b[1] * y + b[2] * z);
        }
        for b in &self.high[..self.n_high] {
            high = smaller(high, b[0] + b[1] * y + b[2] * z);
        }
        (smaller(low, last + 1.0), larger(high, first - 1.0))
    }
}

/// Maximum without the NaN handling of `f32::max`.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Adding this to a number below 2²² leaves the nearest integer in the lowest bits.
const ROUNDING: f32 = 12_582_912.0;
/// Just below one half: integers are missed by less than the slack of the regions.
const HALF: f32 = 0.4999;

#[inline(always)]
fn nearest(x: f32) -> i32 {
    (x + ROUNDING).to_bits() as i32 - ROUNDING.to_bits() as i32
}

#[inline(always)]
fn floor_of(x: f32) -> i32 {
    nearest(x - HALF)
}

#[inline(always)]
fn ceil(x: f32) -> i32 {
    nearest(x + HALF)
}
