use super::far::{FarLattice, NONE, far_value, within_far};
use super::octree::{Bricks, Octree};
use super::packed::{Codec, NODES, Packed, SIDE, Splits, node};
use super::report::{SampledReport, defects};
use super::settings::{Cube, EDGE, SampledSettings};
use super::tile::{Sampler, Scratch, TILE};
use super::tolerance::{Predicate, corners};
use crate::error::FieldError;
use prosopon_geometry::TriMesh;
use prosopon_geometry::control::{Cancelled, Control};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The finest samples: tiles near the surface, and the far field elsewhere.
struct Samples {
    tiles: usize,
    /// Index in `values` of each tile's samples, or [`NONE`].
    index: Vec<u32>,
    values: Vec<Box<[f32]>>,
    far: FarLattice,
    /// Distance up to which values are exact, mm.
    reach: f32,
}

/// Result of the coalescence for each brick.
struct Coalesced {
    /// Level of the leaf that each brick belongs to.
    levels: Vec<u8>,
    /// Whether each brick is divided.
    divided: Vec<bool>,
    /// Whether any part of each brick is within the band.
    touches_band: Vec<bool>,
}

impl Octree {
    /// Builds the field of `surface` bottom up, from samples of the finest grid in the band.
    ///
    /// Eight cells at a time are united while their corners are within the tolerance of the united cell's interpolant.
    ///
    /// # Errors
    /// [`FieldError`] for settings out of range, too much memory, or cancellation.
    ///
    /// # Source
    /// Wang 2009, Algorithm 1, with these departures. The smallest distance keeps its sign (`src/paper.md`, 1). A
    /// triangle's region is its box enlarged by the band, because the prism's own box misses points whose closest feature is a
    /// sharp edge. Cells without a corner in the band are united whatever the tolerance, and hold distances instead of infinity
    /// (`src/paper.md`, 4).
    pub fn hybrid(
        surface: &TriMesh,
        settings: &SampledSettings,
        control: &Control,
    ) -> Result<(Self, SampledReport), FieldError> {
        let cube = Cube::around(surface, settings)?;
        let (built, defects) = rayon::join(|| sampled(surface, settings, &cube, control), || defects(surface));
        let samples = built?;
        control.check()?;
        let predicate = cube.predicate(settings, samples.far.values());
        let (coalesced, bricks) = coalesce(&cube, &samples, &predicate, &control.stage(0.8, 1.0))?;
        let octree = Self::new(cube, &predicate, samples.far.values(), &coalesced.levels, bricks);
        let report = SampledReport::of(&octree, predicate.tolerance, defects);
        control.report(1.0);
        Ok((octree, report))
    }
}

fn sampled(
    surface: &TriMesh,
    settings: &SampledSettings,
    cube: &Cube,
    control: &Control,
) -> Result<Samples, FieldError> {
    // One more tile for the nodes on the far faces of the last bricks.
    let tiles = cube.bricks() + 1;
    let reach = settings.band_mm + 2.0 * cube.spacing;
    let sampler = Sampler::new(surface, cube.origin, cube.spacing, reach);
    control.check()?;
    let done = AtomicUsize::new(0);
    let stored = AtomicUsize::new(0);
    let slabs = (0..tiles)
        .into_par_iter()
        .map(|k| {
            let slab = sampler.slab(k);
            let mut scratch = Scratch::default();
            let mut found = Vec::new();
            for j in 0..tiles {
                control.check()?;
                cube.allow((stored.load(Ordering::Relaxed) * TILE) as u64)?;
                sampler.row(&slab, j, &mut scratch);
                let before = found.len();
                for i in 0..tiles {
                    let Some(tile) = sampler.tile([i, j, k], &mut scratch) else { continue };
                    found.push((i + tiles * (j + tiles * k), tile.nearest_to_first, Box::<[f32]>::from(tile.values)));
                }
                stored.fetch_add(found.len() - before, Ordering::Relaxed);
            }
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            control.report(0.75 * done as f64 / tiles as f64);
            Ok(found)
        })
        .collect::<Result<Vec<_>, FieldError>>()?;
    let mut index = vec![NONE; tiles * tiles * tiles];
    let mut nearest = index.clone();
    let mut values = Vec::with_capacity(stored.into_inner());
    for (place, triangle, tile) in slabs.into_iter().flatten() {
        index[place] = values.len() as u32;
        nearest[place] = triangle;
        values.push(tile);
    }
    let far = FarLattice::new(&sampler, &cube.origin, cube.spacing, tiles, &nearest);
    Ok(Samples { tiles, index, values, far: far.without_last(), reach: reach as f32 })
}

impl Samples {
    /// Values at the nodes of brick `at`; `None` when no part of it was sampled.
    fn brick(&self, at: [usize; 3]) -> Option<Box<[f32; NODES]>> {
        let place = |c: usize| {
            let [x, y, z] = [0, 1, 2].map(|a| at[a] + (c >> a & 1));
            self.index[x + self.tiles * (y + self.tiles * z)]
        };
        let tiles = [0, 1, 2, 3, 4, 5, 6, 7].map(place);
        if tiles.iter().all(|&t| t == NONE) {
            return None;
        }
        let mut values = Box::new([0.0; NODES]);
        let far = self.far.around(at);
        for (n, value) in values.iter_mut().enumerate() {
            let local = [n % SIDE, n / SIDE % SIDE, n / (SIDE * SIDE)];
            let tile = tiles[local[0] / EDGE + 2 * (local[1] / EDGE) + 4 * (local[2] / EDGE)];
            let t = local.map(|l| l as f32 / EDGE as f32);
            *value = match self.values.get(tile as usize) {
                Some(tile) => {
                    let value = tile[local[0] % EDGE + EDGE * (local[1] % EDGE + EDGE * (local[2] % EDGE))];
                    within_far(value, self.reach, &far, t)
                }
                None => far_value(&far, t),
            };
        }
        Some(values)
    }
}

/// Unites cells within bricks, then bricks.
fn coalesce(
    cube: &Cube,
    samples: &Samples,
    predicate: &Predicate,
    control: &Control,
) -> Result<(Coalesced, Bricks), Cancelled> {
    let b = cube.bricks();
    let layers = (0..b)
        .into_par_iter()
        .map(|k| {
            control.check()?;
            let mut bricks = Bricks::default();
            let mut touched = Vec::new();
            for place in k * b * b..(k + 1) * b * b {
                let Some(values) = samples.brick([place % b, place / b % b, k]) else { continue };
                let united = unite(&values, predicate);
                if united.touches_band {
                    touched.push(place);
                }
                if let Some(splits) = united.splits {
                    let (packed, leaves) = Packed::new(splits, &values, &predicate.codec, &mut bricks.codes);
                    bricks.places.push(place as u32);
                    bricks.packed.push(packed);
                    bricks.leaves += leaves;
                }
            }
            Ok((bricks, touched))
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let mut coalesced =
        Coalesced { levels: vec![0; b * b * b], divided: vec![false; b * b * b], touches_band: vec![false; b * b * b] };
    let mut bricks = Bricks::default();
    for (layer, touched) in layers {
        bricks.append(layer);
        for place in touched {
            coalesced.touches_band[place] = true;
        }
    }
    for &place in &bricks.places {
        coalesced.divided[place as usize] = true;
    }
    coalesced.unite_bricks(b, samples.far.values(), predicate);
    Ok((coalesced, bricks))
}

/// Result of uniting a brick's cells.
struct United {
    /// Divided cells; `None` when the brick is one cell.
    splits: Option<Splits>,
    touches_band: bool,
}

/// Unites the cells of a brick from the finest up.
///
/// Eight cells become one when none of them is divided and the united cell fits, or when none of their corners is in the band.
fn unite(values: &[f32; NODES], predicate: &Predicate) -> United {
    let mut splits = Splits::default();
    let mut touched = [0u64; 2];
    let is_split = |first: [usize; 3], size: usize, is_child_split: bool, touches: bool| {
        let corners = corners(first, size, |at| values[node(at)]);
        let touches = touches || predicate.touches_band(&corners);
        (is_child_split || (touches && !predicate.fits(&corners)), touches)
    };
    for n in 0..64 {
        let (split, touches) = is_split([n % 4 * 2, n / 4 % 4 * 2, n / 16 * 2], 2, false, false);
        splits.twos |= u64::from(split) << n;
        touched[0] |= u64::from(touches) << n;
    }
    for n in 0..8 {
        let first = [n % 2 * 4, n / 2 % 2 * 4, n / 4 * 4];
        // Bits of the eight children.
        let children = 0x0033_0033u64 << Splits::two(first);
        let (split, touches) = is_split(first, 4, splits.twos & children != 0, touched[0] & children != 0);
        splits.fours |= u8::from(split) << n;
        touched[1] |= u64::from(touches) << n;
    }
    let (split, touches_band) = is_split([0; 3], 8, splits.fours != 0, touched[1] != 0);
    United { splits: split.then_some(splits), touches_band }
}

impl Coalesced {
    /// Unites whole bricks, level by level.
    fn unite_bricks(&mut self, b: usize, lattice: &[f32], predicate: &Predicate) {
        let mut size = 2;
        let mut level = 1;
        let mut any = true;
        while any && size <= b {
            any = false;
            let groups = b / size;
            for group in 0..groups * groups * groups {
                let first = [group % groups, group / groups % groups, group / (groups * groups)].map(|g| g * size);
                let place = |at: [usize; 3]| at[0] + b * (at[1] + b * at[2]);
                let members = |n: usize, step: usize| {
                    let per = size / step;
                    place([
                        first[0] + n % per * step,
                        first[1] + n / per % per * step,
                        first[2] + n / (per * per) * step,
                    ])
                };
                let eight = [0, 1, 2, 3, 4, 5, 6, 7].map(|n| members(n, size / 2));
                if eight.iter().any(|&m| self.divided[m] || self.levels[m] != level - 1) {
                    continue;
                }
                let corners = corners(first, size, |at| lattice[at[0] + (b + 1) * (at[1] + (b + 1) * at[2])]);
                let touches = eight.iter().any(|&m| self.touches_band[m]) || predicate.touches_band(&corners);
                if touches && !predicate.fits(&corners) {
                    continue;
                }
                any = true;
                for n in 0..size * size * size {
                    let m = members(n, 1);
                    self.levels[m] = level;
                    self.touches_band[m] = touches;
                }
            }
            size *= 2;
            level += 1;
        }
    }
}

impl Cube {
    /// The predicate for `settings`; `far` are values whose range must be storable.
    pub(super) fn predicate(&self, settings: &SampledSettings, far: &[f32]) -> Predicate {
        let largest = far.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        // Covers the corners of the finest cells that touch the band.
        let fine = settings.band_mm + 2.0 * self.spacing;
        let codec = Codec::new(fine, f64::from(largest).max(fine));
        Predicate { codec, tolerance: self.tolerance_mm(settings.tolerance) as f32, band: settings.band_mm as f32 }
    }
}
