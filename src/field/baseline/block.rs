//! The nearest triangle of each node of a block of 4³: the inner loop of sampling, in single-precision vectors.

use prosopon_geometry::{Point, Vector};
use pulp::Simd;

/// Nodes along the edge of a block.
pub(super) const SIDE: usize = 4;
/// Nodes of a block.
pub(super) const NODES: usize = SIDE * SIDE * SIDE;

/// Box around a triangle, mm from the lattice's origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Boxed {
    pub(super) center: [f32; 3],
    pub(super) half: [f32; 3],
    pub(super) id: u32,
}

/// Local frames of a triangle in which its squared distance is a sum of squares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shape {
    corner: Point,
    /// Unit normal of a plane that contains the triangle.
    normal: [f32; 3],
    /// Sides from corner 0 to 1, 1 to 2 and 2 to 0.
    sides: [Side; 3],
}

#[derive(Debug, Clone, Copy)]
struct Side {
    /// Start, relative to corner 0, mm.
    start: [f32; 3],
    /// Unit vector towards the end, and unit vector in the plane that points away from the triangle.
    along: [f32; 3],
    outwards: [f32; 3],
    /// Length, mm.
    length: f32,
}

impl Shape {
    pub(super) fn new(corners: &[Point; 3]) -> Self {
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let longest =
            (1..3).fold(edges[0], |l, i| if edges[i].norm_squared() > l.norm_squared() { edges[i] } else { l });
        // A triangle without area gets some plane through its segment; one without length gets some line through its point.
        let direction = longest.try_normalize(0.0).unwrap_or_else(Vector::x);
        let normal = edges[0].cross(&edges[1]).try_normalize(0.0).unwrap_or_else(|| {
            let axis = Vector::ith(direction.iamin(), 1.0);
            direction.cross(&axis).normalize()
        });
        let sides = [0, 1, 2].map(|i: usize| {
            // The sides of a point get opposite directions, so that nothing lies between them.
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

/// The vector in single precision.
pub(super) fn single(v: &Vector) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Number of nodes handled at once, in one or several vectors.
const LANES: usize = 16;
/// Number of such groups in a block.
const STEPS: usize = NODES / LANES;
/// Order of the steps; each is one spacing from the last along an axis, forwards or backwards.
const WALK: [(usize, usize, bool); STEPS] = [(0, 0, true), (1, 1, true), (3, 2, true), (2, 1, false)];

#[derive(Debug, Clone)]
struct Found {
    /// Squares of the smallest distances, mm².
    best_sq: [[f32; LANES]; STEPS],
    /// Heights above the planes of the nearest triangles, mm.
    heights: [[f32; LANES]; STEPS],
    nearest: [[u32; LANES]; STEPS],
}

const NOTHING: Found =
    Found { best_sq: [[f32::INFINITY; LANES]; STEPS], heights: [[0.0; LANES]; STEPS], nearest: [[0; LANES]; STEPS] };

/// The triangle nearest to a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub(super) id: u32,
    /// Squared distance, mm².
    pub(super) distance_sq: f32,
    /// Height above the triangle's plane, mm.
    pub(super) height: f32,
}

/// The nearest triangles found so far for the nodes of a block.
///
/// The lanes are the nodes of one layer across z of every second row. Lane bits 0 and 1 are the position along x, bit 2 is bit 1
/// of the position along y, and bit 3 is bit 1 of that along z. The two bits of the step are the low bits of the positions along
/// y and z. Each lane therefore represents a bundle of 2 × 2 neighbouring nodes.
#[derive(Debug, Clone)]
pub(super) struct Block {
    /// The current state of vector `n` is in `found[now[n]]`; the next state is written to the other entry.
    ///
    /// A compiler turns an update in place into a masked store, which is slow on some processors.
    found: [Found; 2],
    now: [usize; LANES],
    /// Number of lanes of a vector.
    lanes: usize,
    /// Largest `best_sq` in each bundle, mm².
    worst_sq: [f32; LANES],
    /// Offset of each bundle's first node from the block's first along each axis, mm.
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

    /// Square of the largest distance of a node from its nearest triangle, mm².
    #[inline(always)]
    pub(super) fn worst_sq<S: Simd>(&self, simd: S) -> f32 {
        let mut worst = simd.splat_f32s(0.0);
        for &w in S::as_simd_f32s(&self.worst_sq).0 {
            worst = simd.max_f32s(worst, w);
        }
        simd.reduce_max_f32s(worst)
    }

    /// Updates the nearest triangles with the triangle of `shape` and number `id`.
    ///
    /// Its box has this `center` and `half` widths. `first` is the block's first node, and `start` the same node in the frame
    /// of the box. Vectors of bundles to which the triangle cannot be nearest are skipped. The squared distance is the squared
    /// height above the plane plus, for points not above the triangle, the smallest sum over its sides of the squared distance
    /// from the side's line and the squared overshoot along it. All these are linear in the position: a sum of the bundle's and
    /// the step's contributions.
    #[inline(always)]
    pub(super) fn add<S: Simd>(&mut self, simd: S, shape: &Shape, first: &Point, b: &Boxed, start: &[f32; 3]) {
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

/// Value at `at` of the linear function with this slope that is zero at `start` from `corner`.
///
/// It is a function and not a closure because only forced inlining compiles it for the vectors in use.
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
