use super::cell::{continued, sampled};
use super::packed::{Codec, Packed};
use super::settings::{Cube, EDGE};
use super::tolerance::Predicate;
use prosopon_geometry::{Aabb, Implicit, Point, Vector};

/// Marks an undivided brick in the index of an [`Octree`]; the other bits are the level of its leaf.
const LEAF: u32 = 1 << 31;

/// Adaptively sampled signed distances: octree leaves with trilinear interpolation between corners.
///
/// Leaves down to 8³ finest cells share their corners on one lattice. Each divided brick of 8³ cells has its own nodes, shared
/// among its leaves but not with its neighbours. Values have 16 bits. Outside the bounding cube the value is that at the closest
/// point of the cube plus the distance from there.
///
/// # Accuracy
/// As in the paper, the field jumps across faces between leaves of different size, by up to about the tolerance. The tolerance
/// is checked at the children's corners only, so the error within a cell can be larger.
///
/// # Source
/// S. F. Frisken, R. N. Perry, A. P. Rockwood, T. R. Jones, Adaptively sampled distance fields, 2000; Wang 2009, Algorithm 1.
#[derive(Debug, Clone)]
pub struct Octree {
    cube: Cube,
    codec: Codec,
    /// Half-width of the band, mm.
    band: f64,
    /// Codes at the corners of all bricks, x fastest.
    lattice: Vec<i16>,
    /// For each brick its index in `bricks`, or [`LEAF`] and the level of its leaf.
    index: Vec<u32>,
    bricks: Vec<Packed>,
    codes: Vec<i16>,
    leaves: usize,
}

/// The divided bricks of an octree, sorted by their position.
#[derive(Debug, Default)]
pub(super) struct Bricks {
    pub(super) places: Vec<u32>,
    pub(super) packed: Vec<Packed>,
    pub(super) codes: Vec<i16>,
    pub(super) leaves: usize,
}

impl Bricks {
    /// Appends bricks at later positions.
    pub(super) fn append(&mut self, mut later: Self) {
        let shift = self.codes.len() as u32;
        for packed in &mut later.packed {
            packed.first += shift;
        }
        self.places.append(&mut later.places);
        self.packed.append(&mut later.packed);
        self.codes.append(&mut later.codes);
        self.leaves += later.leaves;
    }
}

impl Octree {
    /// Makes an octree from the values at the corners of all bricks and the divided bricks.
    ///
    /// `levels` has for every undivided brick the level of its leaf: 0 is one brick, and each level doubles the edge.
    pub(super) fn new(cube: Cube, predicate: &Predicate, lattice: &[f32], levels: &[u8], bricks: Bricks) -> Self {
        let codec = predicate.codec;
        let mut index: Vec<u32> = levels.iter().map(|&l| LEAF | u32::from(l)).collect();
        for (n, &place) in bricks.places.iter().enumerate() {
            index[place as usize] = n as u32;
        }
        let b = cube.bricks();
        let first_of_leaf = |place: usize| {
            let size = 1usize << levels[place];
            index[place] & LEAF != 0
                && [place % b, place / b % b, place / (b * b)].iter().all(|a| a.is_multiple_of(size))
        };
        let undivided = (0..index.len()).filter(|&place| first_of_leaf(place)).count();
        let lattice = lattice.iter().map(|&v| codec.encode(v)).collect();
        let Bricks { packed, mut codes, leaves, .. } = bricks;
        codes.shrink_to_fit();
        let band = f64::from(predicate.band);
        Self { cube, codec, band, lattice, index, bricks: packed, codes, leaves: leaves + undivided }
    }

    /// Memory that the field takes, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.lattice[..])
            + size_of_val(&self.index[..])
            + size_of_val(&self.bricks[..])
            + size_of_val(&self.codes[..])
    }

    /// Number of leaves.
    #[must_use]
    pub fn leaves(&self) -> usize {
        self.leaves
    }

    /// Number of stored distances.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.lattice.len() + self.codes.len()
    }

    /// Number of divided bricks.
    pub(super) fn n_bricks(&self) -> usize {
        self.bricks.len()
    }

    /// Edge of the finest cell, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.cube.spacing
    }

    /// The bounding cube, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        self.cube.domain()
    }

    pub(super) fn half_step_mm(&self) -> f32 {
        self.codec.half_step()
    }

    pub(super) fn cube(&self) -> &Cube {
        &self.cube
    }

    fn inside(&self, p: &Point) -> (f64, Vector) {
        let b = self.cube.bricks();
        let at = (p - self.cube.origin) / self.cube.spacing;
        let cell = [0, 1, 2].map(|a| (at[a].max(0.0) as usize).min(self.cube.cells - 1));
        let brick = cell.map(|c| c / EDGE);
        let entry = self.index[brick[0] + b * (brick[1] + b * brick[2])];
        let (first, size, codes) = if entry & LEAF != 0 {
            let size = 1usize << (entry & !LEAF);
            let first = brick.map(|i| i & !(size - 1));
            let mut codes = [0; 8];
            for (c, code) in codes.iter_mut().enumerate() {
                let [x, y, z] = [0, 1, 2].map(|a| first[a] + (c >> a & 1) * size);
                *code = self.lattice[x + (b + 1) * (y + (b + 1) * z)];
            }
            (first.map(|f| f * EDGE), size * EDGE, codes)
        } else {
            let (first, size, codes) = self.bricks[entry as usize].leaf(cell.map(|c| c % EDGE), &self.codes);
            ([0, 1, 2].map(|a| brick[a] * EDGE + first[a]), size, codes)
        };
        let corners = codes.map(|c| f64::from(self.codec.decode(c)));
        let t = [0, 1, 2].map(|a| (at[a] - first[a] as f64) / size as f64);
        let (value, gradient) = sampled(&corners, t, self.band);
        (value, gradient / (size as f64 * self.cube.spacing))
    }
}

impl Implicit for Octree {
    fn value(&self, p: &Point) -> f64 {
        self.value_gradient(p).0
    }

    fn value_gradient(&self, p: &Point) -> (f64, Vector) {
        continued(&self.cube.domain(), p, |p| self.inside(p))
    }
}
