use super::bricks::{Bricks, NO_BRICK, place};
use super::lattice::{DETAIL_EDGE, EDGE, Lattice, PARTS};
use prosopon_geometry::{Aabb, Flat, Point};

/// Signed distance field of a surface as a quadratic B-spline on three nested lattices.
///
/// The coarse lattice covers the whole domain. Bricks of one eighth of its spacing cover the band around the surface. Detail
/// bricks of half the brick spacing are added where the surface needs them. A node without a brick takes the coefficient that
/// the coarse spline has there after knot insertion, which is exact for splines. Detail coefficients are added to that and
/// vanish at the border of the detail bricks. The value is therefore one C1 function everywhere in the domain, and one
/// quadratic polynomial in x, y and z in every cell, whatever bricks exist. Beyond the domain's box the value is that at the
/// closest point of the box plus the distance to that point; it is continuous and grows outwards.
#[derive(Debug, Clone)]
pub struct DistanceField {
    pub(super) lattice: Lattice,
    pub(super) domain: Aabb,
    /// Coefficients of the coarse spline, x fastest, ring included.
    coarse: Vec<f64>,
    /// Number of the brick at each position, or [`NO_BRICK`]; includes a ring around the domain.
    pub(super) index: Vec<u32>,
    pub(super) bricks: Bricks,
    /// Detail bricks of each brick; empty when the field has no detail bricks at all.
    pub(super) parts: Vec<Parts>,
    pub(super) details: Bricks,
    /// Vector instructions of this processor, when it has them.
    #[cfg(target_arch = "x86_64")]
    pub(super) v3: Option<pulp::x86::V3>,
}

impl Flat for DistanceField {
    fn write(&self, to: &mut Vec<u8>) {
        let Self { lattice, domain: _, coarse, index, bricks, parts, details, .. } = self;
        lattice.write(to);
        coarse.write(to);
        index.write(to);
        bricks.write(to);
        parts.write(to);
        details.write(to);
    }

    fn read(from: &mut &[u8]) -> Option<Self> {
        let field = Self::coarse(Flat::read(from)?, Flat::read(from)?, [0.0; 2]);
        let (index, bricks) = (Flat::read(from)?, Flat::read(from)?);
        Some(Self { index, bricks, parts: Flat::read(from)?, details: Flat::read(from)?, ..field })
    }
}

/// The detail bricks of one brick.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Parts {
    /// One bit for each position in the brick, x fastest; set where a detail brick exists.
    pub(super) mask: u64,
    /// Number of the first detail brick.
    pub(super) first: u32,
}

prosopon_geometry::flat!(Parts { mask, first });

impl Parts {
    #[inline(always)]
    pub(super) fn slot(self, at: usize) -> u32 {
        self.slot_or(at, NO_BRICK)
    }

    /// Number of the detail brick at a position in the brick, or `none`.
    #[inline(always)]
    pub(super) fn slot_or(self, at: usize, none: u32) -> u32 {
        let bit = 1u64 << at;
        if self.mask & bit == 0 { none } else { self.first + (self.mask & (bit - 1)).count_ones() }
    }

    /// Index of a detail brick's position in its brick, from the position in the whole field.
    #[inline(always)]
    pub(super) fn place(at: [usize; 3]) -> usize {
        place(PARTS, at.map(|n| n % PARTS))
    }
}

/// The two lattices that are stored in bricks.
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
    /// A field of the coarse spline alone; `largest` bounds the brick and detail coefficients, mm.
    pub(super) fn coarse(lattice: Lattice, coarse: Vec<f64>, largest: [f64; 2]) -> Self {
        Self {
            index: vec![NO_BRICK; lattice.index_dims().iter().product()],
            domain: lattice.domain(),
            lattice,
            coarse,
            bricks: Bricks::new(largest[0], EDGE),
            parts: Vec::new(),
            details: Bricks::new(largest[1], DETAIL_EDGE),
            #[cfg(target_arch = "x86_64")]
            v3: pulp::x86::V3::try_new(),
        }
    }

    /// The box in which the field is a spline, LPS mm.
    #[must_use]
    pub fn domain(&self) -> Aabb {
        self.domain
    }

    /// Spacing of the bricks in the band, mm; detail bricks have half of it.
    #[must_use]
    pub fn spacing_mm(&self) -> f64 {
        self.lattice.spacing
    }

    /// Number of bricks: of 8³ nodes in the band, plus detail bricks of 4³ nodes at half the spacing.
    #[must_use]
    pub fn n_bricks(&self) -> usize {
        self.bricks.len() + self.details.len()
    }

    /// Whether a brick covers `p`, so that the field has its full accuracy there.
    ///
    /// False beyond the band, beyond the domain, and beyond the box given to [`DistanceField::build_within`].
    #[must_use]
    pub fn is_fine_at(&self, p: &Point) -> bool {
        let u = (p - self.lattice.origin) * self.lattice.per_mm;
        let brick = [0, 1, 2].map(|a| ((u[a] + 0.5) / EDGE as f64).floor() as isize);
        self.slot(Level::Brick, brick) != NO_BRICK
    }

    /// Memory that the field takes, bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.coarse[..])
            + size_of_val(&self.index[..])
            + size_of_val(&self.parts[..])
            + self.bricks.bytes()
            + self.details.bytes()
    }

    /// Number of the detail brick at a position up to one brick beyond the domain, or [`NO_BRICK`].
    #[inline(always)]
    pub(super) fn detail_slot(&self, at: [isize; 3]) -> u32 {
        // The index starts with the ring.
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

    /// Position of each brick of a level, in bricks of that level; indexed by brick number.
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

    /// Number of the brick at a position of its level, or [`NO_BRICK`].
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

    /// Coefficient of the brick-level spline at any node within one brick of the domain, mm.
    pub(super) fn coefficient(&self, node: [isize; 3]) -> f64 {
        self.stored(Level::Brick, node).unwrap_or_else(|| self.refined_coarse(node))
    }

    /// Coefficient of the detail-level spline at any of its nodes, mm; 0 where there is no detail brick.
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

    /// Coefficient of the coarse spline at a node of the brick lattice, by knot insertion, mm.
    ///
    /// It is the coarse spline's polar form at the two ends of the node's cell.
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
