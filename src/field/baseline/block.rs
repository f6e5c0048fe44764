//! The nearest triangle of each node of a block of 4³: the inner loop of the sampling, on vectors of single precision.

use super::tile::Boxed;
use prosopon_geometry::{Point, Vector};
use pulp::Simd;

/// Nodes along the edge of a block.
pub(super) const SIDE: usize = 4;
/// Nodes of a block.
pub(super) const NODES: usize = SIDE * SIDE * SIDE;

/// Frames of a triangle in which the distance to it is a sum of squares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    corner: Point,
    /// Unit normal of a plane that the triangle lies in.
    normal: [f32; 3],
    /// From corner 0 to 1, 1 to 2, 2 to 0.
    sides: [Side; 3],
}

#[derive(Debug, Clone, Copy)]
struct Side {
    /// Start, relative to corner 0, mm.
    start: [f32; 3],
    /// Unit vector towards the end, and one in the plane that points away from the triangle.
    along: [f32; 3],
    outwards: [f32; 3],
    /// mm.
    length: f32,
}

impl Shape {
    pub(super) fn new(corners: &[Point; 3]) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let longest =
            (1..3).fold(edges[0], |l, i| if edges[i].norm_squared() > l.norm_squared() { edges[i] } else { l });
        // A triangle without area is a segment in some plane, one without length a point on some line.
        let direction = longest.try_normalize(0.0).unwrap_or_else(Vector::x);
        let normal = edges[0].cross(&edges[1]).try_normalize(0.0).unwrap_or_else(|| {
            let axis = Vector::ith(direction.iamin(), 1.0);
            direction.cross(&axis).normalize()
        });
        let sides = [0, 1, 2].map(|i: usize| {
            // Those of a point lie back to back, so that nothing is between them.
            let along = edges[i].try_normalize(0.0).unwrap_or(if i == 0 { direction } else { -direction });
            Side {
                start: single(&(corners[i] - corners[0])),
                along: single(&along),
                outwards: single(&along.cross(&normal)),
                length: edges[i].norm() as f32,
            }
        });
        Self { corner: corners[0], normal: single(&normal), sides }
    }
}

/// In single precision.
pub(super) fn single(v: &Vector) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Nodes that are handled at once, in one vector or several.
const LANES: usize = 16;
/// Positions of those within the block.
const STEPS: usize = NODES / LANES;
/// The order of the steps: each is one spacing from the last, along an axis, forth or back.
const WALK: [(usize, usize, bool); STEPS] = [(0, 0, true), (1, 1, true), (3, 2, true), (2, 1, false)];

#[derive(Debug, Clone)]
struct Found {
    /// Squares of the smallest distances, mm².
    best_sq: [[f32; LANES]; STEPS],
    /// Heights over the planes of the nearest triangles, mm.
    heights: [[f32; LANES]; STEPS],
    nearest: [[u32; LANES]; STEPS],
}

const NOTHING: Found =
    Found { best_sq: [[f32::INFINITY; LANES]; STEPS], heights: [[0.0; LANES]; STEPS], nearest: [[0; LANES]; STEPS] };

/// The triangle nearest to a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) id: u32,
    /// mm².
    pub(super) distance_sq: f32,
    /// Over the triangle's plane, mm.
    pub(super) height: f32,
}

/// The nearest triangles found so far of the nodes of a block.
///
/// The lanes are the nodes of one layer across z of every second row: lane bits 0 and 1 are the place along x, bit 2 is bit 1
/// of the place along y, bit 3 that of z; the step's bits are the low bits of the places along y and z. So each lane
/// stands for a bundle of 2 × 2 nodes next to each other.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// The present state of vector `n` is in `found[now[n]]`. The next is written to the other one: a masked store, which is
    /// what a compiler makes of an update in place, is slow on some processors.
    found: [Found; 2],
    now: [usize; LANES],
    /// Lanes of a vector.
    lanes: usize,
    /// The largest of `best_sq` in each bundle.
    worst_sq: [f32; LANES],
    /// Offset of each bundle's first node from the block's along each axis, mm.
    offsets: [[f32; LANES]; 3],
    spacing: f32,
}

impl Block {
    pub(super) fn new(lanes: usize, spacing: f32) -> Self {
        let mut offsets = [[0.0; LANES]; 3];
        for lane in 0..LANES {
            let place = [lane & 3, lane >> 2 & 1, lane >> 3];
            for a in 0..3 {
                offsets[a][lane] = spacing * (place[a] * if a == 0 { 1 } else { 2 }) as f32;
            }
        }
        Self { found: [NOTHING; 2], now: [0; LANES], lanes, worst_sq: [f32::INFINITY; LANES], offsets, spacing }
    }

    pub(super) fn clear(&mut self) {
        self.found = [NOTHING; 2];
        self.now = [0; LANES];
        self.worst_sq = [f32::INFINITY; LANES];
    }

    /// The triangle nearest to node `at` of the block.
    pub(super) fn nearest(&self, [x, y, z]: [usize; 3]) -> Nearest {
        let (step, lane) = ((y & 1) | (z & 1) << 1, x | (y >> 1) << 2 | (z >> 1) << 3);
        let found = &self.found[self.now[lane / self.lanes]];
        Nearest {
            id: found.nearest[step][lane],
            distance_sq: found.best_sq[step][lane],
            height: found.heights[step][lane],
        }
    }

    /// The largest distance of a node from its nearest triangle, squared.
    #[inline(always)]
    pub(super) fn worst_sq<S: Simd>(&self, simd: S) -> f32 {
        let mut worst = simd.splat_f32s(0.0);
        for &w in S::as_simd_f32s(&self.worst_sq).0 {
            worst = simd.max_f32s(worst, w);
        }
        simd.reduce_max_f32s(worst)
    }

    /// Takes into account the triangle of `shape`, which lies in the box with this `center` and `half` widths and has the
    /// number `id`; `first` is the block's first node, `start` the same in the frame of the box.
    ///
    /// Vectors of bundles that it cannot be nearest to are left out. The square of the distance is that of the height over the
    /// plane plus, for points not above the triangle, the smallest over its sides of the square of the distance from the
    /// side's line and that of the overshoot along it. All these are linear in the position: the sum of the bundle's share
    /// and of that of the step.
    #[inline(always)]
    pub(super) fn add<S: Simd>(&mut self, simd: S, shape: &Shape, first: &Point, (b, start): (&Boxed, &[f32; 3])) {
        let corner = single(&(shape.corner - first));
        let zero = simd.splat_f32s(0.0);
        let id = simd.splat_u32s(b.id);
        let [x, y, z] = &self.offsets;
        let offsets = [S::as_simd_f32s(x).0, S::as_simd_f32s(y).0, S::as_simd_f32s(z).0];
        // Half the width of a bundle.
        let wide = 0.5 * self.spacing;
        let widths = [b.half[0], b.half[1] + wide, b.half[2] + wide];
        let middles = [b.center[0] - start[0], b.center[1] - start[1] - wide, b.center[2] - start[2] - wide];
        let worst_sq = S::as_mut_simd_f32s(&mut self.worst_sq).0;
        let [a, b, c] = &shape.sides;
        let lengths = [simd.splat_f32s(a.length), simd.splat_f32s(b.length), simd.splat_f32s(c.length)];
        for (n, worst_sq) in worst_sq.iter_mut().enumerate() {
            let at = [offsets[0][n], offsets[1][n], offsets[2][n]];
            let mut least_sq = zero;
            for axis in 0..3 {
                let apart = simd.abs_f32s(simd.sub_f32s(at[axis], simd.splat_f32s(middles[axis])));
                let outside = simd.max_f32s(simd.sub_f32s(apart, simd.splat_f32s(widths[axis])), zero);
                least_sq = simd.mul_add_f32s(outside, outside, least_sq);
            }
            if simd.first_true_m32s(simd.less_than_f32s(least_sq, *worst_sq)) >= S::F32_LANES {
                continue;
            }
            let [even, odd] = &mut self.found;
            let (before, after) = if self.now[n] == 0 { (even, odd) } else { (odd, even) };
            self.now[n] = 1 - self.now[n];
            let mut height = linear(simd, &at, corner, &shape.normal, &[0.0; 3]);
            let mut along = [
                linear(simd, &at, corner, &a.along, &a.start),
                linear(simd, &at, corner, &b.along, &b.start),
                linear(simd, &at, corner, &c.along, &c.start),
            ];
            let mut outwards = [
                linear(simd, &at, corner, &a.outwards, &a.start),
                linear(simd, &at, corner, &b.outwards, &b.start),
                linear(simd, &at, corner, &c.outwards, &c.start),
            ];
            let mut worst = zero;
            for (step, axis, forth) in WALK {
                if step != 0 {
                    let h = if forth { self.spacing } else { -self.spacing };
                    height = simd.add_f32s(height, simd.splat_f32s(h * shape.normal[axis]));
                    for i in 0..3 {
                        let side = &shape.sides[i];
                        along[i] = simd.add_f32s(along[i], simd.splat_f32s(h * side.along[axis]));
                        outwards[i] = simd.add_f32s(outwards[i], simd.splat_f32s(h * side.outwards[axis]));
                    }
                }
                let mut beside_sq = simd.splat_f32s(f32::INFINITY);
                let mut farthest_out = simd.splat_f32s(f32::NEG_INFINITY);
                for i in 0..3 {
                    let (s, out) = (along[i], outwards[i]);
                    let over = simd.sub_f32s(s, simd.min_f32s(simd.max_f32s(s, zero), lengths[i]));
                    let distance_sq = simd.mul_add_f32s(over, over, simd.mul_f32s(out, out));
                    beside_sq = simd.min_f32s(beside_sq, distance_sq);
                    farthest_out = simd.max_f32s(farthest_out, out);
                }
                let beside_sq = simd.select_f32s(simd.less_than_f32s(farthest_out, zero), zero, beside_sq);
                let distance_sq = simd.mul_add_f32s(height, height, beside_sq);
                let best_sq = S::as_simd_f32s(&before.best_sq[step]).0[n];
                let nearest = S::as_simd_u32s(&before.nearest[step]).0[n];
                let is_nearer = simd.less_than_f32s(distance_sq, best_sq);
                let best_sq = simd.min_f32s(distance_sq, best_sq);
                S::as_mut_simd_f32s(&mut after.best_sq[step]).0[n] = best_sq;
                let heights = S::as_simd_f32s(&before.heights[step]).0[n];
                S::as_mut_simd_f32s(&mut after.heights[step]).0[n] = simd.select_f32s(is_nearer, height, heights);
                S::as_mut_simd_u32s(&mut after.nearest[step]).0[n] = simd.select_u32s(is_nearer, id, nearest);
                worst = simd.max_f32s(worst, best_sq);
            }
            *worst_sq = worst;
        }
    }
}

/// The linear function with this slope at `at`, zero at `start` from `corner`.
///
/// Functions, not closures: only what is forced inline is compiled for the vectors in use.
#[inline(always)]
fn linear<S: Simd>(simd: S, at: &[S::f32s; 3], corner: [f32; 3], slope: &[f32; 3], start: &[f32; 3]) -> S::f32s {
    let mut at_first = 0.0;
    for a in 0..3 {
        at_first -= (corner[a] + start[a]) * slope[a];
    }
    let mut sum = simd.splat_f32s(at_first);
    for a in 0..3 {
        sum = simd.mul_add_f32s(at[a], simd.splat_f32s(slope[a]), sum);
    }
    sum
}
