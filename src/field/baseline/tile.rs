use super::block::{Block, Boxed, NODES, Nearest, SIDE, Shape, single};
use super::pseudonormal::Pseudonormals;
use super::settings::EDGE;
use prosopon_geometry::{Point, TriMesh, Vector};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Nodes of a tile.
pub(super) const TILE: usize = EDGE * EDGE * EDGE;
/// Number of boxes tested together; every vector length divides it.
const GROUP: usize = 16;
/// Boxes closer to a block than this share of the largest distance of a node are processed first.
const CLOSE: f32 = 0.5;

/// Signed distances at the nodes of a tile, x fastest, mm, and the triangle nearest to the first.
#[derive(Debug, Clone)]
pub(super) struct Tile {
    pub(super) values: [f32; TILE],
    pub(super) nearest_to_first: u32,
}

/// Samples the signed distance on a lattice, by tiles of 8³ nodes.
///
/// A block of 4³ nodes considers the triangles whose box is within reach of it (the partial field's region of influence) and
/// closer than the largest current distance of its nodes. Values are exact up to the reach, within the rounding of `f32`; beyond
/// they are distances to some of the triangles.
#[derive(Debug)]
pub(super) struct Sampler {
    origin: Point,
    spacing: f64,
    reach: f32,
    corners: Vec<[Point; 3]>,
    shapes: Vec<Shape>,
    boxes: Vec<Boxed>,
    normals: Pseudonormals,
    arch: Arch,
}

/// Working memory of a thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// Boxes within reach of the row of tiles, and of the tile.
    row: Vec<Boxed>,
    near: Vec<Boxed>,
    /// Boxes of the tile by axis, padded to full groups: centres, then half widths.
    sides: [Vec<f32>; 6],
    /// Squares of the smallest distances between the boxes and a block, mm².
    least_sq: Vec<f32>,
    /// Indices in `near` of the candidates of a block.
    order: Vec<u32>,
}

impl Sampler {
    /// Prepares sampling; node (i, j, k) lies at `origin + spacing (i, j, k)`, and `reach` is in mm.
    pub(super) fn new(surface: &TriMesh, origin: Point, spacing: f64, reach: f64) -> Self {
        let normals = Pseudonormals::new(surface);
        let corners: Vec<[Point; 3]> = (0..surface.triangles().len()).map(|t| surface.corners(t)).collect();
        let shapes = corners.par_iter().map(Shape::new).collect();
        // Allows for the rounding of positions to single precision.
        let extent = surface.bounds().diagonal() + spacing * EDGE as f64 + (surface.bounds().min - origin).norm();
        let slack = 1e-6 * extent;
        let boxes = corners
            .par_iter()
            .enumerate()
            .map(|(t, c)| {
                let (low, high) = (c[0].inf(&c[1]).inf(&c[2]), c[0].sup(&c[1]).sup(&c[2]));
                let half = (high - low) * 0.5;
                Boxed { center: single(&(low + half - origin)), half: single(&half.add_scalar(slack)), id: t as u32 }
            })
            .collect();
        Self { origin, spacing, reach: (reach + slack) as f32, corners, shapes, boxes, normals, arch: Arch::new() }
    }

    /// Distance from `p` to triangle `t`, signed by its pseudonormals, mm.
    pub(super) fn signed(&self, p: &Point, t: u32) -> f64 {
        self.normals.signed(p, &self.corners[t as usize], t as usize)
    }

    /// The boxes within reach of slab `k` of tiles.
    pub(super) fn slab(&self, k: usize) -> Vec<Boxed> {
        let mut slab = Vec::new();
        self.within_reach(&self.boxes, 2, k, &mut slab);
        slab
    }

    /// Prepares `scratch` for the row of tiles at `j` in a slab.
    pub(super) fn row(&self, slab: &[Boxed], j: usize, scratch: &mut Scratch) {
        self.within_reach(slab, 1, j, &mut scratch.row);
    }

    fn within_reach(&self, boxes: &[Boxed], axis: usize, tile: usize, found: &mut Vec<Boxed>) {
        let half = 0.5 * self.spacing * (EDGE - 1) as f64;
        let middle = (self.spacing * (tile * EDGE) as f64 + half) as f32;
        let reach = self.reach + half as f32;
        found.clear();
        found.extend(boxes.iter().filter(|b| (b.center[axis] - middle).abs() <= b.half[axis] + reach));
    }

    /// The tile at `at` of the row that `scratch` was prepared for; `None` when no triangle's box is within reach.
    pub(super) fn tile(&self, at: [usize; 3], scratch: &mut Scratch) -> Option<Tile> {
        let Scratch { row, near, sides, .. } = scratch;
        self.within_reach(row, 0, at[0], near);
        if near.is_empty() {
            return None;
        }
        let n_padded = near.len().next_multiple_of(GROUP);
        for a in 0..3 {
            for (side, value) in [(a, &near[0].center), (3 + a, &near[0].half)] {
                sides[side].clear();
                // Padding repeats the first box, which changes no result.
                sides[side].resize(n_padded, value[a]);
            }
            for (n, b) in near.iter().enumerate() {
                sides[a][n] = b.center[a];
                sides[3 + a][n] = b.half[a];
            }
        }
        Some(self.arch.dispatch(Fill { sampler: self, at, scratch }))
    }

    #[inline(always)]
    fn fill<S: Simd>(&self, simd: S, at: [usize; 3], scratch: &mut Scratch) -> Tile {
        let mut tile = Tile { values: [0.0; TILE], nearest_to_first: 0 };
        let mut block = Block::new(S::F32_LANES, self.spacing as f32);
        for octant in 0..EDGE {
            let first = [octant & 1, octant >> 1 & 1, octant >> 2].map(|o| o * SIDE);
            let offset = Vector::from([0, 1, 2].map(|a| self.spacing * (at[a] * EDGE + first[a]) as f64));
            self.nearest(simd, &offset, &mut block, scratch);
            for n in 0..NODES {
                let local = [n % SIDE, n / SIDE % SIDE, n / (SIDE * SIDE)];
                let Nearest { id, distance_sq, height } = block.nearest(local);
                let to = (first[0] + local[0]) + EDGE * ((first[1] + local[1]) + EDGE * (first[2] + local[2]));
                tile.values[to] = if self.normals.is_clear(id, height, distance_sq) {
                    distance_sq.sqrt().copysign(height)
                } else {
                    let step = Vector::new(local[0] as f64, local[1] as f64, local[2] as f64) * self.spacing;
                    self.signed(&(self.origin + offset + step), id) as f32
                };
            }
            if octant == 0 {
                tile.nearest_to_first = block.nearest([0; 3]).id;
            }
        }
        tile
    }

    /// The nearest triangles of the nodes of the block with its first node at `offset` from the origin.
    #[inline(always)]
    fn nearest<S: Simd>(&self, simd: S, offset: &Vector, block: &mut Block, scratch: &mut Scratch) {
        let Scratch { near, sides, least_sq, order, .. } = scratch;
        let half = 0.5 * (SIDE - 1) as f32 * self.spacing as f32;
        let start = single(offset);
        let closest = measure(simd, sides, [start[0] + half, start[1] + half, start[2] + half], half, least_sq);
        let first = closest.min(near.len() - 1);
        let first_node = self.origin + offset;
        block.clear();
        block.add(simd, &self.shapes[near[first].id as usize], &first_node, &near[first], &start);
        // A block with all boxes out of reach uses only the first candidate.
        let worst_sq = block.worst_sq(simd).min(self.reach * self.reach);
        order.clear();
        order.extend((0..near.len() as u32).filter(|&n| least_sq[n as usize] < worst_sq && n as usize != first));
        // Close boxes come first, because they exclude many of the others.
        let close_sq = CLOSE * CLOSE * worst_sq;
        for close in [true, false] {
            for &n in order.iter().filter(|&&n| (least_sq[n as usize] < close_sq) == close) {
                let b = &near[n as usize];
                block.add(simd, &self.shapes[b.id as usize], &first_node, b, &start);
            }
        }
    }
}

/// Squared smallest distances of boxes from a cube, mm², and the box with the closest middle.
#[inline(always)]
fn measure<S: Simd>(simd: S, sides: &[Vec<f32>; 6], middle: [f32; 3], half: f32, least_sq: &mut Vec<f32>) -> usize {
    let [cx, cy, cz, hx, hy, hz] = sides;
    least_sq.clear();
    least_sq.resize(cx.len(), 0.0);
    let axes = [
        (S::as_simd_f32s(cx).0, S::as_simd_f32s(hx).0, simd.splat_f32s(middle[0])),
        (S::as_simd_f32s(cy).0, S::as_simd_f32s(hy).0, simd.splat_f32s(middle[1])),
        (S::as_simd_f32s(cz).0, S::as_simd_f32s(hz).0, simd.splat_f32s(middle[2])),
    ];
    let (zero, half) = (simd.splat_f32s(0.0), simd.splat_f32s(half));
    let (mut closest, mut closest_sq) = (0, f32::INFINITY);
    for (n, least_sq) in S::as_mut_simd_f32s(least_sq).0.iter_mut().enumerate() {
        let (mut outside_sq, mut middle_sq) = (zero, zero);
        for (center, width, middle) in axes {
            let apart = simd.sub_f32s(center[n], middle);
            let outside = simd.sub_f32s(simd.abs_f32s(apart), simd.add_f32s(width[n], half));
            let outside = simd.max_f32s(outside, zero);
            outside_sq = simd.mul_add_f32s(outside, outside, outside_sq);
            middle_sq = simd.mul_add_f32s(apart, apart, middle_sq);
        }
        *least_sq = outside_sq;
        let smallest = simd.reduce_min_f32s(middle_sq);
        if smallest < closest_sq {
            closest_sq = smallest;
            let is_smallest = simd.less_than_or_equal_f32s(middle_sq, simd.splat_f32s(smallest));
            closest = n * S::F32_LANES + simd.first_true_m32s(is_smallest);
        }
    }
    closest
}

/// Work that fills a tile; a type, so that all of it is compiled for the processor's vectors.
struct Fill<'a> {
    sampler: &'a Sampler,
    at: [usize; 3],
    scratch: &'a mut Scratch,
}

impl WithSimd for Fill<'_> {
    type Output = Tile;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Tile {
        self.sampler.fill(simd, self.at, self.scratch)
    }
}
