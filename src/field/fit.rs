//! Fits the coefficients near the surface so that the spline is 0 on it.
//!
//! A spline rounds the folds of the distance along ridges and in thin walls, which shifts its zero. Away from the surface this
//! is harmless. On the surface each coefficient is corrected by the mean of the errors around it, weighted by its influence
//! on them.

use super::bricks::{NO_BRICK, code, place};
use super::distance_field::{DistanceField, Level};
use super::lanes::with_vectors;
use super::lattice::{DETAIL_EDGE, EDGE};
use super::sites::{CLASSES, Site, Sites};
use rayon::prelude::*;

/// Errors below this, in spacings, are not corrected.
const SMALL: f32 = 0.04;
/// Nodes along the edge of the largest brick with one neighbour on both sides.
const SIDE: usize = EDGE + 2;
/// A brick's coefficients and those next to it, mm; one spare because rows are read four at a time.
pub(super) type Around = [f32; SIDE * SIDE * SIDE + 1];
/// Number of sweeps.
const SWEEPS: usize = 2;
/// Number of bricks around and including one; itself in the middle, x fastest.
const NEIGHBOURS: usize = 27;

/// The bricks of one level and their neighbours.
pub(super) struct Layer {
    pub(super) level: Level,
    /// Position of each brick, in bricks of the level.
    pub(super) at: Vec<[i32; 3]>,
    neighbours: Vec<[u32; NEIGHBOURS]>,
}

/// Offset of neighbour `n` along each axis: -1, 0 or 1.
fn step(n: usize) -> [isize; 3] {
    [n % 3, n / 3 % 3, n / 9].map(|s| s as isize - 1)
}

impl Layer {
    pub(super) fn new(field: &DistanceField, level: Level) -> Self {
        let at = field.places(level);
        let neighbours = at
            .par_iter()
            .map(|at| {
                std::array::from_fn(|n| {
                    let step = step(n);
                    field.slot(level, [0, 1, 2].map(|a| at[a] as isize + step[a]))
                })
            })
            .collect();
        Self { level, at, neighbours }
    }

    /// Visits the nodes of brick `slot` next to a position without a brick.
    pub(super) fn for_rim(&self, slot: usize, mut visit: impl FnMut(usize)) {
        let edge = self.level.edge();
        for (n, _) in self.neighbours[slot].iter().enumerate().filter(|(_, s)| **s == NO_BRICK) {
            let [x, y, z] = step(n).map(|s| match s {
                -1 => 0..1,
                0 => 0..edge,
                _ => edge - 1..edge,
            });
            for k in z {
                for j in y.clone() {
                    x.clone().for_each(|i| visit(place(edge, [i, j, k])));
                }
            }
        }
    }

    /// Fills `around` with the coefficients of a brick and those next to it, mm.
    pub(super) fn fill(&self, field: &DistanceField, slot: usize, around: &mut Around) {
        let edge = self.level.edge();
        let side = edge + 2;
        let bricks = field.bricks_of(self.level);
        let scale = bricks.step() as f32;
        for (n, &neighbour) in self.neighbours[slot].iter().enumerate() {
            // The neighbour's nodes next to the brick lie on its opposite side.
            let [(x, x1), (y, y1), (z, z1)] = step(n).map(|s| match s {
                -1 => (edge - 1..edge, 0),
                0 => (0..edge, 1),
                _ => (0..1, edge + 1),
            });
            for (dk, k) in z.enumerate() {
                for (dj, j) in y.clone().enumerate() {
                    let to = place(side, [x1, y1 + dj, z1 + dk]);
                    let to = &mut around[to..to + x.len()];
                    if neighbour != NO_BRICK {
                        let row = place(edge, [0, j, k]);
                        let codes = &bricks.of(neighbour)[row + x.start..row + x.end];
                        for (to, code) in to.iter_mut().zip(codes) {
                            *to = f32::from(*code) * scale;
                        }
                    } else if self.level == Level::Brick {
                        let first = step(n);
                        for (to, i) in to.iter_mut().zip(x.clone()) {
                            let local = [i, j, k];
                            let node =
                                |a: usize| (self.at[slot][a] as isize + first[a]) * edge as isize + local[a] as isize;
                            *to = field.refined_coarse([0, 1, 2].map(node)) as f32;
                        }
                    } else {
                        to.fill(0.0);
                    }
                }
            }
        }
    }

    /// Value of the level's spline at a site, mm.
    #[inline(always)]
    pub(super) fn value(&self, around: &Around, site: &Site) -> f32 {
        let side = self.level.edge() + 2;
        let [x, y, z] = site.weights();
        let [i, j, k] = site.cell();
        // The fourth lane is padding.
        let mut line = [0.0f32; 4];
        for (n, z) in z.iter().enumerate() {
            for (m, y) in y.iter().enumerate() {
                let start = i + side * (j + m + side * (k + n));
                let row = &around[start..start + 4];
                let yz = y * z;
                for l in 0..4 {
                    line[l] += yz * row[l];
                }
            }
        }
        x[0] * line[0] + x[1] * line[1] + x[2] * line[2]
    }
}

pub(super) fn no_coefficients() -> Around {
    [0.0; SIDE * SIDE * SIDE + 1]
}

/// Fits the coefficients of a level to 0 on the surface; updates the values of its `sites` (by brick).
///
/// # Source
/// S. Lee, G. Wolberg, S. Y. Shin, Scattered data interpolation with multilevel B-splines, IEEE TVCG 1997, equation 5.
pub(super) fn fit(field: &mut DistanceField, layer: &Layer, sites: &mut [Sites], spacing: f64) {
    let small = SMALL * spacing as f32;
    let mut is_stale = vec![true; sites.len()];
    for sweep in 0..=SWEEPS {
        let bad: Vec<u32> = sites
            .par_iter_mut()
            .enumerate()
            .map_init(no_coefficients, |around, (slot, sites)| {
                if is_stale[slot] && !sites.all.is_empty() {
                    layer.fill(field, slot, around);
                    with_vectors(
                        #[inline(always)]
                        || {
                            for site in &mut sites.all {
                                site.value = site.below + layer.value(around, site);
                            }
                        },
                    );
                }
                sites.classes_beyond(small)
            })
            .collect();
        if sweep == SWEEPS {
            return;
        }
        let matters: [u32; NEIGHBOURS] = std::array::from_fn(classes_that_matter);
        let moves = |slot: usize| {
            let next_to = layer.neighbours[slot].iter().zip(&matters);
            next_to.filter(|(n, _)| **n != NO_BRICK).any(|(n, matters)| bad[*n as usize] & matters != 0)
        };
        let moved: Vec<bool> = (0..sites.len()).into_par_iter().map(moves).collect();
        let step = field.bricks_of(layer.level).step() as f32;
        let sites = &*sites;
        let each: Vec<(usize, &mut [i16])> = field.bricks_of_mut(layer.level).each_mut().enumerate().collect();
        each.into_par_iter().filter(|(slot, _)| moved[*slot]).for_each(|(slot, codes)| {
            with_vectors(
                #[inline(always)]
                || match layer.level {
                    Level::Brick => {
                        correct_coefficients::<WIDE, { room(WIDE) }>(layer, slot, sites, &matters, step, codes)
                    }
                    Level::Detail => {
                        correct_coefficients::<DETAIL_WIDE, { room(DETAIL_WIDE) }>(
                            layer, slot, sites, &matters, step, codes,
                        );
                    }
                },
            );
        });
        is_stale = (0..sites.len())
            .into_par_iter()
            .map(|slot| layer.neighbours[slot].iter().any(|n| *n != NO_BRICK && moved[*n as usize]))
            .collect();
    }
}

/// Bit set of the classes of sites of neighbour `n` that the brick's own coefficients influence.
fn classes_that_matter(n: usize) -> u32 {
    let step = step(n);
    let matters = |class: &usize| {
        let side = [class % 3, class / 3 % 3, class / 9];
        // In a neighbour on the upper side these are the first cells.
        (0..3).all(|a| step[a] == 0 || side[a] == if step[a] > 0 { 0 } else { 2 })
    };
    (0..CLASSES).filter(matters).fold(0, |bits, class| bits | 1 << class)
}

/// Nodes along the edge of a brick with two more on both sides.
const WIDE: usize = EDGE + 4;
const DETAIL_WIDE: usize = DETAIL_EDGE + 4;

/// Length of a buffer of two numbers per node and one spare node, as rows are read four at a time.
const fn room(wide: usize) -> usize {
    2 * (wide * wide * wide + 1)
}

/// Corrects a brick's codes, each worth `step` (mm), by the weighted mean error of the sites around.
#[inline(always)]
fn correct_coefficients<const WIDE: usize, const ROOM: usize>(
    layer: &Layer,
    slot: usize,
    sites: &[Sites],
    matters: &[u32; NEIGHBOURS],
    step: f32,
    codes: &mut [i16],
) {
    let edge = layer.level.edge();
    let mut wanted = [0.0f32; ROOM];
    for (n, &neighbour) in layer.neighbours[slot].iter().enumerate().filter(|(_, s)| **s != NO_BRICK) {
        // Index in the box of the first of the three nodes around the neighbour's first node.
        let shift = self::step(n).map(|s| s * edge as isize + 1);
        for class in (0..CLASSES).filter(|class| matters[n] >> class & 1 == 1) {
            for site in sites[neighbour as usize].of_class(class) {
                let cell = site.cell();
                let first = [0, 1, 2].map(|a| (cell[a] as isize + shift[a]) as usize);
                spread::<WIDE>(site, first, &mut wanted);
            }
        }
    }
    if layer.level == Level::Detail {
        // The details end there, so these coefficients stay.
        layer.for_rim(slot, |n| wanted[2 * wide_place::<WIDE>(edge, n) + 1] = 0.0);
    }
    for (n, own) in codes.iter_mut().enumerate() {
        let at = 2 * wide_place::<WIDE>(edge, n);
        let (sum, total) = (wanted[at], wanted[at + 1]);
        if total > 0.0 {
            *own = code(f32::from(*own) - sum / (total * step));
        }
    }
}

/// Index of a brick's node in the box around it.
#[inline(always)]
fn wide_place<const WIDE: usize>(edge: usize, n: usize) -> usize {
    place(WIDE, [n % edge + 2, n / edge % edge + 2, n / (edge * edge) + 2])
}

/// Adds a site's weighted correction of each coefficient and its weight.
///
/// `first` is the first of the site's nodes. The two numbers, w³ e / Σw² and w², are stored next to each other.
#[inline(always)]
fn spread<const WIDE: usize>(site: &Site, first: [usize; 3], wanted: &mut [f32]) {
    let [x, y, z] = site.weights();
    let square = |w: &[f32; 3]| w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    let share = site.value / (square(&x) * square(&y) * square(&z));
    // The fourth node has no weight.
    let mut along = [0.0f32; 8];
    for (i, x) in x.iter().enumerate() {
        (along[2 * i], along[2 * i + 1]) = (x * x * x, x * x);
    }
    for (k, z) in z.iter().enumerate() {
        for (j, y) in y.iter().enumerate() {
            let row = 2 * place(WIDE, [first[0], first[1] + j, first[2] + k]);
            let row = &mut wanted[row..row + 8];
            let square = y * y * z * z;
            let cube = square * y * z * share;
            for l in 0..4 {
                row[2 * l] += along[2 * l] * cube;
                row[2 * l + 1] += along[2 * l + 1] * square;
            }
        }
    }
}
