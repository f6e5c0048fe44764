//! Detail bricks of half the spacing where the distance curves too much: thin walls, ridges, grooves.

use super::brick_values::{HALO, coefficients};
use super::bricks::{NO_BRICK, place};
use super::crossings::Rows;
use super::distance_field::{DistanceField, Level, Parts};
use super::fit::{Layer, fit, no_coefficients};
use super::lanes::with_vectors;
use super::lattice::{DETAIL_EDGE, EDGE, PARTS};
use super::sites::{Site, Sites, Spread};
use super::spline::weights;
use super::tiles::{Source, TILE, Tile, Tiles};
use prosopon_geometry::Vector;
use prosopon_geometry::control::{Cancelled, Control};
use rayon::prelude::*;

/// Details are added where the value at a site, which should be 0, is larger than this, in spacings.
const ROUGH: f32 = 0.13;
/// The same limit for surface points between the sites.
const ROUGH_BETWEEN: f32 = 0.17;
/// Exact distances blend into the coarser spline's between these two, in half spacings.
const FADE: [f64; 2] = [2.7, 4.5];
/// Nodes along the edge of a detail brick including its halo.
const SIDE: usize = DETAIL_EDGE + 2 * HALO;
/// Number of nodes in a detail brick.
const VOLUME: usize = DETAIL_EDGE.pow(3);

/// Positions of the detail bricks that are needed.
struct Rough {
    /// Number of detail brick positions along each axis.
    counts: [usize; 3],
    /// Whether each position needs a detail brick, x fastest.
    wanted: Vec<bool>,
    /// Whether each brick needs any detail brick, x fastest.
    any: Vec<bool>,
}

impl Rough {
    /// Finds the positions of detail bricks around surface points with too large values.
    ///
    /// These are the positions that hold the coefficients of the points' cells and of the neighbouring cells.
    fn find(field: &DistanceField, layer: &Layer, spread: &Spread, sites: &[Sites]) -> Self {
        let lattice = &field.lattice;
        let limit = ROUGH * lattice.spacing as f32;
        let limit_between = ROUGH_BETWEEN * lattice.spacing as f32;
        let counts = lattice.bricks.map(|n| PARTS * n);
        let found: Vec<Vec<[usize; 3]>> = (0..sites.len())
            .into_par_iter()
            .map_init(no_coefficients, |around, slot| {
                with_vectors(
                    #[inline(always)]
                    || {
                        let mut places = Vec::new();
                        for site in sites[slot].all.iter().filter(|s| s.value.abs() > limit) {
                            places_around(layer.at[slot], &site.local(), counts, &mut places);
                        }
                        if !sites[slot].all.is_empty() {
                            layer.fill(field, slot, around);

                            spread.for_joints(slot, layer.at[slot], |p| {
                                let site = Site::new(p, 0.0);
                                if layer.value(around, &site).abs() > limit_between {
                                    places_around(layer.at[slot], &site.local(), counts, &mut places);
                                }
                            });
                        }
                        places.sort_unstable();
                        places.dedup();
                        places
                    },
                )
            })
            .collect();
        let mut rough =
            Self { counts, wanted: vec![false; counts.iter().product()], any: vec![false; lattice.n_bricks()] };
        for at in found.into_iter().flatten() {
            let brick = at.map(|n| n / PARTS);
            if field.index[lattice.index_of(brick)] != NO_BRICK {
                let place = rough.place(at);
                rough.wanted[place] = true;
                rough.any[lattice.brick_index(brick)] = true;
            }
        }
        rough
    }

    fn place(&self, [i, j, k]: [usize; 3]) -> usize {
        i + self.counts[0] * (j + self.counts[1] * k)
    }

    /// Whether a detail brick is needed at any position in a box.
    fn in_box(&self, field: &DistanceField, from: [usize; 3], to: [usize; 3]) -> bool {
        let lattice = &field.lattice;
        let any = |of: &dyn Fn([usize; 3]) -> bool, from: [usize; 3], to: [usize; 3]| {
            (from[2]..=to[2]).any(|k| (from[1]..=to[1]).any(|j| (from[0]..=to[0]).any(|i| of([i, j, k]))))
        };
        any(&|at| self.any[lattice.brick_index(at)], from.map(|n| n / PARTS), to.map(|n| n / PARTS))
            && any(&|at| self.wanted[self.place(at)], from, to)
    }
}

/// Adds the detail brick positions that influence point `p` (nodes from the first) of the brick `at`.
fn places_around(at: [i32; 3], p: &[f32; 3], counts: [usize; 3], places: &mut Vec<[usize; 3]>) {
    let range = |a: usize| {
        let node = 2 * EDGE as i32 * at[a] + (2.0 * p[a] + 1.0).floor() as i32;
        let place = |n: i32| (n.max(0) as usize / DETAIL_EDGE).min(counts[a] - 1);
        place(node - 2)..=place(node + 2)
    };
    for k in range(2) {
        for j in range(1) {
            places.extend(range(0).map(|i| [i, j, k]));
        }
    }
}

/// Adds detail bricks where the field is too far from 0 on the surface, and fits them to 0 there.
///
/// `sites` are those of the bricks in `layer`.
pub(super) fn add_details(
    field: &mut DistanceField,
    source: Source,
    layer: &Layer,
    spread: &Spread,
    mut sites: Vec<Sites>,
    control: &Control,
) -> Result<(), Cancelled> {
    let rough = Rough::find(field, layer, spread, &sites);
    control.check()?;
    if !rough.any.contains(&true) {
        return Ok(());
    }
    // Bricks without details do not need their sites any more.
    for (sites, at) in sites.iter_mut().zip(&layer.at) {
        if !rough.any[field.lattice.brick_index(at.map(|n| n as usize))] {
            *sites = Sites::default();
        }
    }
    let spacing = 0.5 * field.lattice.spacing;
    let rows = Rows {
        origin: field.lattice.origin - Vector::repeat((HALO as f64 + 0.5) * spacing),
        spacing,
        dims: rough.counts.map(|n| n * DETAIL_EDGE + 2 * HALO),
    };
    // A box of nodes is needed when it overlaps a rough position or its halo.
    let wanted = |first: [usize; 3], last: [usize; 3]| {
        let from = first.map(|n| n.saturating_sub(2 * HALO) / DETAIL_EDGE);
        rough.in_box(field, from, [0, 1, 2].map(|a| (last[a] / DETAIL_EDGE).min(rough.counts[a] - 1)))
    };
    let tiles = Tiles::new(source, rows, HALO, FADE[1] * spacing, wanted);
    let built = tiles.map(
        control,
        #[inline(always)]
        |tile| tile_details(field, &rough, tile, spacing),
    )?;
    drop(tiles);
    add(field, built);
    let details = Layer::new(field, Level::Detail);
    seal(field, &details);
    let mut sites = detail_sites(field, &sites);
    fit(field, &details, &mut sites, spacing);
    Ok(())
}

/// Detail bricks of a tile: number of the parent and position in it, and codes.
#[derive(Default)]
struct Built {
    at: Vec<(u32, u8)>,
    codes: Vec<i16>,
}

/// Computes the needed detail bricks of a tile.
#[inline(always)]
fn tile_details(field: &DistanceField, rough: &Rough, tile: &Tile, spacing: f64) -> Built {
    const ALONG: usize = TILE / DETAIL_EDGE;
    let mut built = Built::default();
    let first = tile.first.map(|n| n / DETAIL_EDGE);
    for n in 0..ALONG.pow(3) {
        let step = [n % ALONG, n / ALONG % ALONG, n / ALONG.pow(2)];
        let at = [0, 1, 2].map(|a| first[a] + step[a]);
        if (0..3).any(|a| at[a] >= rough.counts[a]) || !rough.wanted[rough.place(at)] {
            continue;
        }
        let parents = parents(field, at);
        let mut values = [0.0; SIDE.pow(3)];
        detail_values(&parents, tile, step.map(|s| s * DETAIL_EDGE), spacing, &mut values);
        let mut c = [0.0; VOLUME];
        coefficients(&values, DETAIL_EDGE, &mut c);
        for (c, refined) in c.iter_mut().zip(refined(&parents)) {
            *c -= refined;
        }
        field.details.pack(&c, &mut built.codes);
        let parent = field.index[field.lattice.index_of(at.map(|n| n / PARTS))];
        built.at.push((parent, Parts::place(at) as u8));
    }
    built
}

/// Stores detail bricks, sorted by parent and by position in it.
fn add(field: &mut DistanceField, built: Vec<Built>) {
    let mut order: Vec<(u32, u8, u32, u32)> = Vec::new();
    for (n, of_tile) in built.iter().enumerate() {
        order.extend(of_tile.at.iter().enumerate().map(|(m, at)| (at.0, at.1, n as u32, m as u32)));
    }
    order.par_sort_unstable();
    field.parts = vec![Parts::default(); field.bricks.len()];
    field.details.reserve(order.len());
    for (parent, place, n, m) in order {
        let slot = field.details.append(&built[n as usize].codes[m as usize * VOLUME..][..VOLUME]);
        let parts = &mut field.parts[parent as usize];
        if parts.mask == 0 {
            parts.first = slot;
        }
        parts.mask |= 1 << place;
    }
}

/// Sets coefficients to 0 next to positions without a detail brick: details end there with slope 0.
fn seal(field: &mut DistanceField, layer: &Layer) {
    for (slot, codes) in field.details.each_mut().enumerate() {
        layer.for_rim(slot, |n| codes[n] = 0);
    }
}

/// Moves the `sites` that lie in detail bricks into lists by detail brick.
fn detail_sites(field: &DistanceField, sites: &[Sites]) -> Vec<Sites> {
    let parts = field.parts.par_iter().zip(sites).filter(|(parts, _)| parts.mask != 0);
    parts
        .flat_map_iter(|(parts, sites)| {
            let mut found = vec![Vec::new(); parts.mask.count_ones() as usize];
            for site in &sites.all {
                let p = site.local().map(|x| 2.0 * f64::from(x) + 0.5);
                let part = p.map(|x| (x + 0.5).floor() as usize / DETAIL_EDGE);
                let slot = parts.slot(Parts::place(part));
                if slot != NO_BRICK {
                    let p = Vector::from([0, 1, 2].map(|a| p[a] - (part[a] * DETAIL_EDGE) as f64));
                    found[(slot - parts.first) as usize].push(Site::new(&p, site.value));
                }
            }
            found.into_iter().map(|sites| Sites::new(&sites, DETAIL_EDGE))
        })
        .collect()
}

/// Signed distances at the nodes of a brick and its halo; far from the surface the coarser spline's.
#[inline(always)]
fn detail_values(parents: &[f32], tile: &Tile, node: [usize; 3], spacing: f64, values: &mut [f32; SIDE.pow(3)]) {
    let (inside, _) = tile.inside(node, [SIDE; 3]);
    let weights = [-0.25, 0.25].map(|t| weights(t).map(|w| w as f32));
    let coarser = on_details(parents, &weights);
    let fade = FADE.map(|f| (f * spacing) as f32);
    tile.copy_squared(node, SIDE, values);
    for ((value, inside), coarser) in values.iter_mut().zip(inside).zip(coarser) {
        let d = value.sqrt();
        let far = ((d - fade[0]) / (fade[1] - fade[0])).clamp(0.0, 1.0);
        let signed = if inside { -d } else { d };
        *value = if far < 1.0 { signed + far * (coarser - signed) } else { coarser };
    }
}

/// Brick-level coefficients that a detail brick and its halo depend on, along each axis.
const PARENTS: usize = DETAIL_EDGE / 2 + 4;

/// The brick-level coefficients around the detail brick at `at`, x fastest, mm.
fn parents(field: &DistanceField, at: [usize; 3]) -> [f32; PARENTS.pow(3)] {
    let first = at.map(|n| (n * DETAIL_EDGE / 2) as isize - 2);
    let bricks = first.map(|n| n.div_euclid(EDGE as isize));
    // Along each axis the nodes lie in this brick and the next.
    let slots: [u32; 8] =
        std::array::from_fn(|n| field.slot(Level::Brick, [0, 1, 2].map(|a| bricks[a] + (n >> a & 1) as isize)));
    let mut parents = [0.0; PARENTS.pow(3)];
    for (n, parent) in parents.iter_mut().enumerate() {
        let step = [n % PARENTS, n / PARENTS % PARENTS, n / PARENTS.pow(2)];
        let node = [0, 1, 2].map(|a| first[a] + step[a] as isize);
        let local = [0, 1, 2].map(|a| (node[a] - bricks[a] * EDGE as isize) as usize);
        let slot = slots[(local[0] / EDGE) | ((local[1] / EDGE) << 1) | ((local[2] / EDGE) << 2)];
        *parent = if slot == NO_BRICK {
            field.refined_coarse(node) as f32
        } else {
            (field.bricks.step() * field.bricks.at(slot, place(EDGE, local.map(|n| n % EDGE)))) as f32
        };
    }
    parents
}

/// Coefficients of the brick-level spline on the detail lattice, by knot halving.
///
/// Along each axis it is three quarters of the near coefficient plus one quarter of the next (Chaikin).
#[inline(always)]
fn refined(parents: &[f32]) -> [f32; VOLUME] {
    let around = on_details(parents, &[[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]]);
    let mut own = [0.0; VOLUME];
    for (n, own) in own.iter_mut().enumerate() {
        let [i, j, k] = [n % DETAIL_EDGE, n / DETAIL_EDGE % DETAIL_EDGE, n / DETAIL_EDGE.pow(2)].map(|i| i + HALO);
        *own = around[i + SIDE * (j + SIDE * k)];
    }
    own
}

/// Weighted sums of a brick's parents at its nodes and halo.
///
/// A node lies a quarter of the parents' spacing before or behind its nearest parent: `weights` are those of the three parents
/// around for either case.
#[inline(always)]
fn on_details(parents: &[f32], weights: &[[f32; 3]; 2]) -> [f32; SIDE.pow(3)] {
    // The first node lies behind its parent.
    let sum = |of: &[f32], stride: usize, i: usize| {
        let (parent, w) = (i.div_ceil(2) + 1, &weights[(i + 1) % 2]);
        w[0] * of[(parent - 1) * stride] + w[1] * of[parent * stride] + w[2] * of[(parent + 1) * stride]
    };
    let mut along_x = [0.0f32; SIDE * PARENTS * PARENTS];
    for (row, out) in parents.chunks_exact(PARENTS).zip(along_x.chunks_exact_mut(SIDE)) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = sum(row, 1, i);
        }
    }
    let mut along_y = [0.0f32; SIDE * SIDE * PARENTS];
    for k in 0..PARENTS {
        for j in 0..SIDE {
            for i in 0..SIDE {
                along_y[i + SIDE * (j + SIDE * k)] = sum(&along_x[i + SIDE * PARENTS * k..], SIDE, j);
            }
        }
    }
    let mut values = [0.0; SIDE.pow(3)];
    for (n, value) in values.iter_mut().enumerate() {
        *value = sum(&along_y[n % (SIDE * SIDE)..], SIDE * SIDE, n / (SIDE * SIDE));
    }
    values
}
