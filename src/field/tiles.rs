//! Signed distances on a lattice, tile by tile.

use super::crossings::{Crossings, Rows};
use super::defects::Defects;
use super::exact::is_inside;
use super::features::Features;
use super::lanes::with_vectors;
use super::lattice::EDGE;
use super::scan::Slab;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Aabb, Point, TriMesh, Vector, Warning};
use rayon::prelude::*;

/// Nodes along the edge of a tile without halo: its distances fit the second-level cache.
pub(super) const TILE: usize = 48;

/// Surface data from which signed distances are computed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) mesh: &'a TriMesh,
    pub(super) defects: &'a Defects,
    pub(super) features: &'a Features,
}

/// Signed distances of one surface on a lattice, in tiles of 48³ nodes that overlap by a halo.
#[derive(Debug)]
pub(super) struct Tiles<'a> {
    source: Source<'a>,
    rows: Rows,
    halo: usize,
    reach: f64,
    crossings: Crossings,
    /// Number of tiles along each axis.
    counts: [usize; 3],
    /// Start of the features of each tile: those of tile n are `members[first[n]..first[n + 1]]`.
    first: Vec<u32>,
    members: Vec<u32>,
}

/// The nodes of one tile with its halo.
#[derive(Debug)]
pub(super) struct Tile<'a> {
    source: Source<'a>,
    /// Lattice index of the tile's first node, halo included.
    pub(super) first: [usize; 3],
    slab: Slab,
    spacing: f64,
    dims: [usize; 3],
    /// Winding number of the closed surface at each node, x fastest.
    winding: Vec<i8>,
}

impl<'a> Tiles<'a> {
    /// Covers `rows` (halo included) with tiles whose distances are exact up to `reach`, mm.
    ///
    /// Only features whose box of nodes (first and last along each axis) is `wanted` are considered.
    pub(super) fn new(
        source: Source<'a>,
        rows: Rows,
        halo: usize,
        reach: f64,
        wanted: impl Fn([usize; 3], [usize; 3]) -> bool + Sync,
    ) -> Self {
        let counts = rows.dims.map(|n| n.saturating_sub(2 * halo).div_ceil(TILE).max(1));
        let boxes: Vec<Option<[[u16; 2]; 3]>> = (0..source.features.len())
            .into_par_iter()
            .map(|index| {
                let nodes_in = |Aabb { min, max }: Aabb| {
                    let mut nodes = [[0usize; 2]; 3];
                    for a in 0..3 {
                        let low = ((min[a] - rows.origin[a]) / rows.spacing).ceil().max(0.0);
                        let high = ((max[a] - rows.origin[a]) / rows.spacing).floor().min((rows.dims[a] - 1) as f64);
                        if low > high {
                            return None;
                        }
                        nodes[a] = [low as usize, high as usize];
                    }
                    Some(nodes)
                };
                let is_wanted = |nodes: &[[usize; 2]; 3]| wanted(nodes.map(|n| n[0]), nodes.map(|n| n[1]));
                // The larger box is cheaper to compute, so it is tested first.
                nodes_in(source.features.box_within(index, reach)).filter(is_wanted)?;
                let nodes = nodes_in(source.features.bounds(index, reach)).filter(is_wanted)?;
                // A tile covers its own nodes and a halo on both sides.
                Some([0, 1, 2].map(|a| {
                    let before = (nodes[a][0].saturating_sub(2 * halo) / TILE).min(counts[a] - 1);
                    [before as u16, (nodes[a][1] / TILE).min(counts[a] - 1) as u16]
                }))
            })
            .collect();
        let each = |tiles: &[[u16; 2]; 3], visit: &mut dyn FnMut(usize)| {
            for k in tiles[2][0]..=tiles[2][1] {
                for j in tiles[1][0]..=tiles[1][1] {
                    for i in tiles[0][0]..=tiles[0][1] {
                        visit(usize::from(i) + counts[0] * (usize::from(j) + counts[1] * usize::from(k)));
                    }
                }
            }
        };
        let mut first = vec![0u32; counts.iter().product::<usize>() + 1];
        for tiles in boxes.iter().flatten() {
            each(tiles, &mut |n| first[n + 1] += 1);
        }
        for n in 1..first.len() {
            first[n] += first[n - 1];
        }
        let mut next = first.clone();
        let mut members = vec![0u32; first[first.len() - 1] as usize];
        for (index, tiles) in boxes.iter().enumerate() {
            if let Some(tiles) = tiles {
                each(tiles, &mut |n| {
                    members[next[n] as usize] = index as u32;
                    next[n] += 1;
                });
            }
        }
        // The boxes take as much memory as the crossings.
        drop(boxes);
        let crossings = Crossings::new(source.mesh, &source.defects.counts, &source.defects.rim, &rows);
        Self { source, rows, halo, reach, crossings, counts, first, members }
    }

    /// Calls `each` in parallel for every tile with a feature in reach; results in the order of tiles.
    pub(super) fn map<T: Send>(
        &self,
        control: &Control,
        each: impl Fn(&Tile) -> T + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        let busy: Vec<usize> = (0..self.first.len() - 1).filter(|&n| self.first[n] < self.first[n + 1]).collect();
        self.map_over(&busy, control, each)
    }

    /// Like [`Tiles::map`], for every tile.
    pub(super) fn map_all<T: Send>(
        &self,
        control: &Control,
        each: impl Fn(&Tile) -> T + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        let all: Vec<usize> = (0..self.first.len() - 1).collect();
        self.map_over(&all, control, each)
    }

    fn map_over<T: Send>(
        &self,
        busy: &[usize],
        control: &Control,
        each: impl Fn(&Tile) -> T + Sync,
    ) -> Result<Vec<T>, Cancelled> {
        let share = 1.0 / busy.len().max(1) as f64;
        busy.par_iter()
            .enumerate()
            .map(|(done, &n)| {
                control.check()?;
                control.report(done as f64 * share);
                Ok(with_vectors(
                    #[inline(always)]
                    || each(&self.tile(n)),
                ))
            })
            .collect()
    }

    #[inline(always)]
    fn tile(&self, n: usize) -> Tile<'a> {
        let [nx, ny, _] = self.counts;
        let first = [n % nx, n / nx % ny, n / (nx * ny)].map(|t| t * TILE);
        let rows = &self.rows;
        let mut dims = [0; 3];
        for a in 0..3 {
            dims[a] = (TILE + 2 * self.halo).min(rows.dims[a] - first[a]);
        }
        let offset = Vector::new(first[0] as f64, first[1] as f64, first[2] as f64) * rows.spacing;
        let mut slab = Slab::new(rows.origin + offset, rows.spacing, dims);
        let members = &self.members[self.first[n] as usize..self.first[n + 1] as usize];
        for &member in members {
            slab.add(&self.source.features.region(member as usize, self.reach));
        }
        let mut winding = vec![0i8; dims.iter().product()];
        for k in 0..dims[2] {
            let range = first[1]..first[1] + dims[1];
            self.crossings.for_runs(first[2] + k, range, rows.dims[0], |j, from, to, w| {
                let row = dims[0] * (j - first[1] + dims[1] * k);
                let from = from.clamp(first[0], first[0] + dims[0]) - first[0];
                let to = to.clamp(first[0], first[0] + dims[0]) - first[0];
                winding[row + from..row + to].fill(w.clamp(-100, 100) as i8);
            });
        }
        Tile { source: self.source, first, slab, spacing: rows.spacing, dims, winding }
    }
}

impl Tile<'_> {
    /// Nodes along each axis, halo included.
    pub(super) fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Position of node (i, j, k) of the tile.
    pub(super) fn position(&self, at: [usize; 3]) -> Point {
        self.slab.origin() + Vector::new(at[0] as f64, at[1] as f64, at[2] as f64) * self.spacing
    }

    /// Squared distance at a node, mm²; exact up to the reach, too large or infinite beyond.
    pub(super) fn squared(&self, [i, j, k]: [usize; 3]) -> f32 {
        self.slab.squared(i, j, k)
    }

    /// Copies the squared distances (mm²) of `side` nodes along each axis from `first` on, x fastest.
    #[inline(always)]
    pub(super) fn copy_squared(&self, first: [usize; 3], side: usize, to: &mut [f32]) {
        for (row, to) in to.chunks_exact_mut(side).enumerate() {
            self.slab.copy_row(first[0], first[1] + row % side, first[2] + row / side, to);
        }
    }

    /// Smallest squared distance over the brick of nodes from `first` on, mm².
    #[inline(always)]
    pub(super) fn least_squared(&self, first: [usize; 3]) -> f32 {
        let mut least = f32::INFINITY;
        let mut nodes = [0.0f32; EDGE];
        for row in 0..EDGE * EDGE {
            self.slab.copy_row(first[0], first[1] + row % EDGE, first[2] + row / EDGE, &mut nodes);
            for d in nodes {
                least = if d < least { d } else { least };
            }
        }
        least
    }

    /// Inside flags of the nodes of the box of `size` nodes from `first` on, x fastest.
    ///
    /// Also returns how many of the inside nodes have a negative winding number.
    #[inline(always)]
    pub(super) fn inside(&self, first: [usize; 3], size: [usize; 3]) -> (Vec<bool>, usize) {
        let rim = &self.source.defects.rim;
        let half = Vector::from(size.map(|n| 0.5 * (n - 1) as f64 * self.spacing));
        let (center, radius) = (self.position(first) + half, half.norm() + 1e-9);
        let far = rim.is_far(&center, radius);
        // Away from the caps their contribution changes slowly.
        let near = (!far).then(|| {
            let slope = if rim.has_cap_near(&center, radius) { f64::INFINITY } else { rim.slope(&center, radius) };
            (rim.share(&center), slope * radius)
        });
        let mut inside = Vec::with_capacity(size.iter().product());
        let mut inverted = 0;
        for k in first[2]..first[2] + size[2] {
            for j in first[1]..first[1] + size[1] {
                let row = &self.winding[first[0] + self.dims[0] * (j + self.dims[1] * k)..][..size[0]];
                for (i, closed) in row.iter().enumerate() {
                    let closed = f64::from(*closed);
                    let winding = match near {
                        None => closed,
                        Some((share, change)) => {
                            let guess = closed - share;
                            let is_clear = (guess.abs() - 0.5).abs() > change;
                            if is_clear { guess } else { closed - rim.share(&self.position([first[0] + i, j, k])) }
                        }
                    };
                    let is_inside = is_inside(winding);
                    inverted += usize::from(is_inside && winding < 0.0);
                    inside.push(is_inside);
                }
            }
        }
        (inside, inverted)
    }
}

/// Visits the nodes of a box, x fastest.
pub(super) fn for_box(first: [usize; 3], size: [usize; 3], mut visit: impl FnMut([usize; 3])) {
    for k in first[2]..first[2] + size[2] {
        for j in first[1]..first[1] + size[1] {
            for i in first[0]..first[0] + size[0] {
                visit([i, j, k]);
            }
        }
    }
}

/// Counts over all nodes whose sign was determined.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    n_inside: usize,
    n_inverted: usize,
}

impl Tally {
    pub(super) fn count(inside: &[bool], inverted: usize) -> Self {
        Self { n_inside: inside.iter().filter(|i| **i).count(), n_inverted: inverted }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.n_inside += other.n_inside;
        self.n_inverted += other.n_inverted;
    }

    /// Warning about a surface that encloses nothing or whose normals point inwards.
    pub(super) fn warning(&self) -> Option<Warning> {
        if self.n_inside == 0 {
            let found = "the surface encloses nothing at this spacing";
            return Some(
                Warning::unreliable("encloses-nothing", found).act("Close the surface or use a smaller spacing."),
            );
        }
        let share = self.n_inverted as f64 / self.n_inside as f64;
        if share > 0.99 {
            let found =
                "the surface is inside out (its normals point inwards); its enclosed volume still counts as inside";
            Some(Warning::info("surface-inside-out", found))
        } else if self.n_inverted > 0 {
            let found = format!("normals point inwards around {:.2} % of the inside; it stays inside", 100.0 * share);
            Some(Warning::check("partly-inside-out", found).act("Check the orientation of the surface's parts."))
        } else {
            None
        }
    }
}
