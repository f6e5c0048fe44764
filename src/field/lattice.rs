use prosopon_geometry::{Aabb, Point, Vector};

/// Fine nodes along the edge of a brick.
pub(super) const EDGE: usize = 8;
/// Fine nodes in a brick.
pub(super) const BRICK: usize = EDGE * EDGE * EDGE;
/// Nodes along the edge of a detail brick; they have half the spacing.
pub(super) const DETAIL_EDGE: usize = 4;
/// Number of detail bricks along the edge of a brick.
pub(super) const PARTS: usize = 2 * EDGE / DETAIL_EDGE;
/// Most fine nodes along an axis: single precision counts them exactly.
const LONGEST: f64 = 2e6;
/// Coarse nodes beyond the bricks on every side.
///
/// One has a coefficient that is read; the next one is needed for the second differences there.
const RING: usize = 2;

/// A box of bricks, each of 8³ fine nodes around one coarse node.
///
/// Fine node (i, j, k) lies at `origin + spacing (i, j, k)`. Coarse nodes lie in the middle of their brick, so the cell of a
/// coarse coefficient (half a coarse spacing to every side) consists of the cells of the brick's fine coefficients. Both
/// splines together are therefore one quadratic polynomial in every fine cell. The domain is the union of those cells.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    pub(super) origin: Point,
    pub(super) spacing: f64,
    /// Fine nodes per mm.
    pub(super) per_mm: f64,
    /// Number of bricks along each axis.
    pub(super) bricks: [usize; 3],
}

prosopon_geometry::flat!(Lattice { origin, spacing, per_mm, bricks });

impl Lattice {
    /// Lattice that covers `bounds`.
    ///
    /// Fails with the number of coarse nodes when that exceeds `most`, or when an axis would get too many fine nodes.
    pub(super) fn covering(bounds: &Aabb, spacing: f64, most: u64) -> Result<Self, u64> {
        let coarse = spacing * EDGE as f64;
        let extent = bounds.max - bounds.min;
        let needed = [0, 1, 2].map(|a| (extent[a] / coarse).ceil().max(1.0));
        let samples: f64 = needed.iter().map(|n| n + 2.0 * RING as f64).product();
        // Steps along an axis are counted in single precision, which limits their number.
        if samples > most as f64 || needed.iter().any(|n| n * EDGE as f64 > LONGEST) {
            return Err(samples as u64);
        }
        let bricks = needed.map(|n| n as usize);
        let size = Vector::new(bricks[0] as f64, bricks[1] as f64, bricks[2] as f64) * coarse;
        let origin = bounds.center() - size * 0.5 + Vector::repeat(0.5 * spacing);
        Ok(Self { origin, spacing, per_mm: 1.0 / spacing, bricks })
    }

    pub(super) fn n_bricks(&self) -> usize {
        self.bricks.iter().product()
    }

    /// Position of brick `index` along each axis.
    pub(super) fn brick_at(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.bricks;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    pub(super) fn brick_index(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.bricks[0] * (j + self.bricks[1] * k)
    }

    /// First and end positions along each axis of the bricks that overlap `bounds`, if any do.
    pub(super) fn bricks_meeting(&self, bounds: &Aabb) -> Option<[[usize; 3]; 2]> {
        let domain = self.domain();
        let mut chosen = [[0; 3]; 2];
        for a in 0..3 {
            let place = |x: f64| (x - domain.min[a]) / self.coarse_spacing();
            let last = self.bricks[a] as f64;
            let (from, to) = (place(bounds.min[a]), place(bounds.max[a]));
            // The comparisons are also false for NaN.
            let meets = from <= to && from < last && to > 0.0;
            if !meets {
                return None;
            }
            chosen[0][a] = from.max(0.0) as usize;
            chosen[1][a] = (to.ceil() as usize).min(self.bricks[a]);
        }
        Some(chosen)
    }

    /// Dimensions of the brick index with its ring around the domain.
    pub(super) fn index_dims(&self) -> [usize; 3] {
        self.bricks.map(|n| n + 2)
    }

    /// Entry of a brick position in the brick index; positions may lie one brick beyond the domain.
    #[inline(always)]
    pub(super) fn index_of(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.index_dims();
        (i + 1) + nx * ((j + 1) + ny * (k + 1))
    }

    /// Number of coarse nodes along each axis, ring included.
    pub(super) fn coarse_dims(&self) -> [usize; 3] {
        self.bricks.map(|n| n + 2 * RING)
    }

    pub(super) fn coarse_spacing(&self) -> f64 {
        self.spacing * EDGE as f64
    }

    /// Position of the first coarse node, at the corner of the ring.
    pub(super) fn coarse_origin(&self) -> Point {
        self.origin + Vector::repeat(self.spacing * (0.5 * (EDGE as f64 - 1.0) - (RING * EDGE) as f64))
    }

    /// Index among the coarse nodes of the one in brick `at`.
    pub(super) fn coarse_index(&self, at: [usize; 3]) -> usize {
        let dims = self.coarse_dims();
        (at[0] + RING) + dims[0] * ((at[1] + RING) + dims[1] * (at[2] + RING))
    }

    /// Like [`Lattice::coarse_index`], for positions up to [`RING`] bricks beyond the domain.
    pub(super) fn coarse_index_beyond(&self, at: [isize; 3]) -> usize {
        let dims = self.coarse_dims();
        let [i, j, k] = at.map(|b| (b + RING as isize).max(0) as usize);
        i + dims[0] * (j + dims[1] * k)
    }

    /// The domain's box.
    pub(super) fn domain(&self) -> Aabb {
        let min = self.origin - Vector::repeat(0.5 * self.spacing);
        let [x, y, z] = self.bricks.map(|n| n as f64 * self.coarse_spacing());
        Aabb { min, max: min + Vector::new(x, y, z) }
    }
}
