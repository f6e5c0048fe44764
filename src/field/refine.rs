//! Bricks of half the spacing where the distance bends too much near the surface: thin walls, ridges, grooves.

use super::bricks::{Bricks, NO_BRICK};
use super::build::{AROUND, HALO, LARGEST, coefficients};
use super::crossings::Rows;
use super::distance_field::{DistanceField, Level};
use super::fit::Sites;
use super::lattice::{BRICK, EDGE, Lattice};
use super::spline::Weights;
use super::tiles::{Source, TILE, Tile, Tiles};
use crate::control::{Cancelled, Control};
use crate::geometry::{Implicit, Point, Vector};
use rayon::prelude::*;

/// Where the value at a point of the surface, which should be 0, is larger than this (in spacings), the octant is refined.
const ROUGH: f32 = 0.13;
/// The same for points between the sites.
const ROUGH_BETWEEN: f64 = 0.17;
/// Distances are exact up to the first of these (in half spacings) and the coarser spline's from the second on.
const FADE: [f64; 2] = [2.7, 4.5];

/// Marks the octants of half bricks around surface points where the field is too far from 0 (`errors` at the sites, mm); x
/// fastest.
fn rough_octants(field: &DistanceField, sites: &Sites, errors: &[f32], counts: [usize; 3]) -> Vec<bool> {
    let lattice = &field.lattice;
    let limit = ROUGH * lattice.spacing as f32;
    let limit_between = ROUGH_BETWEEN * lattice.spacing;
    let mut octants = Vec::new();
    for (p, error) in sites.points().iter().zip(errors) {
        if error.abs() > limit {
            octants_around(lattice, p, counts, &mut octants);
        }
    }
    let is_rough = |p: &&Point| field.value(p).abs() > limit_between;
    let between: Vec<&Point> = sites.between().par_iter().filter(is_rough).collect();
    for p in between {
        octants_around(lattice, p, counts, &mut octants);
    }
    let mut rough = vec![false; counts.iter().product()];
    for octant in octants {
        rough[octant] = true;
    }
    rough
}

/// Adds the octants that the coefficients of the cell around `p` and their neighbours lie in.
fn octants_around(lattice: &Lattice, p: &Point, counts: [usize; 3], octants: &mut Vec<usize>) {
    let range = |a: usize| {
        let node = (2.0 * (p[a] - lattice.origin[a]) / lattice.spacing + 1.0).floor();
        let octant = |n: f64| ((n / EDGE as f64).max(0.0) as usize).min(counts[a] - 1);
        octant(node - 2.0)..=octant(node + 2.0)
    };
    for k in range(2) {
        for j in range(1) {
            for i in range(0) {
                octants.push(i + counts[0] * (j + counts[1] * k));
            }
        }
    }
}

/// Adds bricks of half the spacing where the field is too far from 0 on the surface.
pub(super) fn add_details(
    field: &mut DistanceField,
    source: Source,
    sites: &Sites,
    errors: &[f32],
    control: &Control,
) -> Result<(), Cancelled> {
    let counts = field.lattice.bricks.map(|n| 2 * n);
    let is_rough = rough_octants(field, sites, errors, counts);
    control.check()?;
    if !is_rough.contains(&true) {
        return Ok(());
    }
    let spacing = 0.5 * field.lattice.spacing;
    let rows = Rows {
        origin: field.lattice.origin - Vector::repeat((HALO as f64 + 0.5) * spacing),
        spacing,
        dims: counts.map(|n| n * EDGE + 2 * HALO),
    };
    // A box of nodes matters when a rough octant or its halo meets it.
    let wanted = |first: [usize; 3], last: [usize; 3]| {
        let from = first.map(|n| n.saturating_sub(2 * HALO) / EDGE);
        let to = [0, 1, 2].map(|a| (last[a] / EDGE).min(counts[a] - 1));
        (from[2]..=to[2]).any(|k| {
            (from[1]..=to[1]).any(|j| (from[0]..=to[0]).any(|i| is_rough[i + counts[0] * (j + counts[1] * k)]))
        })
    };
    let tiles = Tiles::new(source, rows, HALO, FADE[1] * spacing, wanted);
    let details = Bricks::new(LARGEST * spacing);
    let built = tiles.map(control, |tile| {
        let mut built = Vec::new();
        let first = tile.first.map(|n| n / EDGE);
        for n in 0..(TILE / EDGE).pow(3) {
            let step = [n % (TILE / EDGE), n / (TILE / EDGE) % (TILE / EDGE), n / (TILE / EDGE).pow(2)];
            let at = [0, 1, 2].map(|a| first[a] + step[a]);
            if (0..3).all(|a| at[a] < counts[a]) && is_rough[at[0] + counts[0] * (at[1] + counts[1] * at[2])] {
                let parents = parents(field, at);
                let values = detail_values(&parents, tile, step.map(|s| s * EDGE), spacing);
                let mut c = coefficients(&values);
                for (c, refined) in c.iter_mut().zip(refined(&parents)) {
                    *c -= refined;
                }
                built.push((at, details.packed(&c)));
            }
        }
        built
    })?;
    add(field, details, &built);
    Ok(())
}

fn add(field: &mut DistanceField, mut details: Bricks, built: &[Vec<([usize; 3], Box<[i16; BRICK]>)>]) {
    field.children = vec![[NO_BRICK; 8]; field.bricks.len()];
    details.reserve(built.iter().map(Vec::len).sum());
    for (at, codes) in built.iter().flatten() {
        let slot = field.index[field.lattice.brick_index(at.map(|n| n / 2))];
        let child = (at[0] & 1) | (at[1] & 1) << 1 | (at[2] & 1) << 2;
        if let Some(children) = field.children.get_mut(slot as usize) {
            children[child] = details.push(codes);
        }
    }
    field.details = details;
    seal(field);
}

/// Takes the details from nodes next to places without details: there they end, and with their slope 0.
pub(super) fn seal(field: &mut DistanceField) {
    for (slot, at) in field.places(Level::Detail).into_iter().enumerate() {
        let open: Vec<[i32; 3]> = (0..27)
            .map(|n| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1])
            .filter(|s| {
                let [i, j, k] = [0, 1, 2].map(|a| (at[a] + s[a]) as isize);
                field.slot(Level::Detail, i, j, k) == NO_BRICK
            })
            .collect();
        field.details.clear(slot, |node| {
            let last = EDGE - 1;
            open.iter()
                .any(|s| (0..3).all(|a| s[a] == 0 || (s[a] < 0 && node[a] == 0) || (s[a] > 0 && node[a] == last)))
        });
    }
}

/// Signed distances at the nodes of the octant `at` and next to it; away from the surface those of the coarser spline.
fn detail_values(parents: &[f32], tile: &Tile, node: [usize; 3], spacing: f64) -> [f32; AROUND.pow(3)] {
    let (inside, _) = tile.inside(node, [AROUND; 3]);
    let weights = [-0.25, 0.25].map(|t| Weights::at(t).value.map(|w| w as f32));
    let coarser = on_details(parents, &weights);
    let mut values = [0.0f32; AROUND.pow(3)];
    let fade = FADE.map(|f| (f * spacing) as f32);
    tile.copy_squared(node, &mut values);
    for ((value, inside), coarser) in values.iter_mut().zip(inside).zip(coarser) {
        let d = value.sqrt();
        let far = ((d - fade[0]) / (fade[1] - fade[0])).clamp(0.0, 1.0);
        let signed = if inside { -d } else { d };
        *value = if far < 1.0 { signed + far * (coarser - signed) } else { coarser };
    }
    values
}

/// Coefficients of the bricks' spline that an octant's nodes and those next to it need, along each axis.
const PARENTS: usize = EDGE / 2 + 4;

/// Those coefficients for the octant `at`, x fastest.
fn parents(field: &DistanceField, at: [usize; 3]) -> Vec<f32> {
    let first = at.map(|n| (n * EDGE / 2) as isize - 2);
    let place = |n: usize| [n % PARENTS, n / PARENTS % PARENTS, n / PARENTS.pow(2)];
    (0..PARENTS.pow(3)).map(|n| field.coefficient([0, 1, 2].map(|a| first[a] + place(n)[a] as isize)) as f32).collect()
}

/// Coefficients that the bricks' spline has at the octant's nodes: halving the knots (Chaikin) takes three quarters of the near
/// one and one quarter of the next.
fn refined(parents: &[f32]) -> [f32; BRICK] {
    let around = on_details(parents, &[[0.25, 0.75, 0.0], [0.0, 0.75, 0.25]]);
    let mut own = [0.0; BRICK];
    for (n, own) in own.iter_mut().enumerate() {
        let [i, j, k] = [n % EDGE + HALO, n / EDGE % EDGE + HALO, n / (EDGE * EDGE) + HALO];
        *own = around[i + AROUND * (j + AROUND * k)];
    }
    own
}

/// Sums of an octant's parents at its nodes and those next to it. A node lies a quarter of the parents' spacing before or behind
/// the nearest of them: `weights` are those of the three around for either case.
fn on_details(parents: &[f32], weights: &[[f32; 3]; 2]) -> [f32; AROUND.pow(3)] {
    // The first node lies behind its parent.
    let sum = |of: &[f32], stride: usize, i: usize| {
        let (parent, w) = (i.div_ceil(2) + 1, &weights[(i + 1) % 2]);
        w[0] * of[(parent - 1) * stride] + w[1] * of[parent * stride] + w[2] * of[(parent + 1) * stride]
    };
    let mut along_x = [0.0f32; AROUND * PARENTS * PARENTS];
    for (row, out) in parents.chunks_exact(PARENTS).zip(along_x.chunks_exact_mut(AROUND)) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = sum(row, 1, i);
        }
    }
    let mut along_y = [0.0f32; AROUND * AROUND * PARENTS];
    for k in 0..PARENTS {
        for j in 0..AROUND {
            for i in 0..AROUND {
                along_y[i + AROUND * (j + AROUND * k)] = sum(&along_x[i + AROUND * PARENTS * k..], AROUND, j);
            }
        }
    }
    let mut values = [0.0; AROUND.pow(3)];
    for (n, value) in values.iter_mut().enumerate() {
        *value = sum(&along_y[n % (AROUND * AROUND)..], AROUND * AROUND, n / (AROUND * AROUND));
    }
    values
}
