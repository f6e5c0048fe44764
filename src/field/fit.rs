//! Moves the coefficients near the surface so that the spline is 0 on it.
//!
//! A spline rounds the folds that a distance has along ridges and in thin walls, and so shifts its zero. Off the surface that
//! does not matter; on it each coefficient takes back the mean of the errors around it, weighted by what it has to do with them.

use super::bricks::NO_BRICK;
use super::distance_field::{DistanceField, Level};
use super::lattice::{BRICK, EDGE};
use crate::geometry::{Implicit, Point, TriMesh};
use rayon::prelude::*;

/// Points of the surface are at most about this far apart, in spacings.
const APART: f64 = 1.5;
/// Most parts of a triangle's edge.
const MOST_PARTS: f64 = 200.0;
/// About the most points; with more to place they are farther apart.
const MOST_SITES: f64 = 4e6;
/// Errors below this (in spacings) are left alone.
const SMALL: f32 = 0.04;

/// Points spread over a surface, where a field should be 0.
#[derive(Debug)]
pub(super) struct Sites {
    points: Vec<Point>,
    between: Vec<Point>,
}

impl Sites {
    /// Points on the triangles of `mesh` that are `distinct`, for the spacing `spacing`, mm: the middles of equal parts of each, and
    /// all vertices.
    pub(super) fn new(mesh: &TriMesh, distinct: &[bool], spacing: f64) -> Self {
        let parts = |t: usize, apart: f64| {
            let [a, b, c] = mesh.corners(t);
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            (longest / apart).ceil().clamp(1.0, MOST_PARTS)
        };
        let apart = APART * spacing;
        let wanted: f64 = (0..distinct.len()).filter(|&t| distinct[t]).map(|t| parts(t, apart).powi(2)).sum();
        let apart = apart * (wanted / MOST_SITES).sqrt().max(1.0);
        let on_triangles = |of: fn(usize, &mut dyn FnMut(f64, f64))| {
            (0..mesh.triangles().len())
                .into_par_iter()
                .filter(|&t| distinct[t])
                .fold(Vec::new, |mut points, t| {
                    let [a, b, c] = mesh.corners(t);
                    let n = parts(t, apart);
                    of(n as usize, &mut |u, v| points.push(a + (b - a) * (u / n) + (c - a) * (v / n)));
                    points
                })
                .flatten_iter()
                .collect::<Vec<Point>>()
        };
        let mut points = on_triangles(middles);
        points.extend(vertices(mesh, distinct));
        Self { points, between: on_triangles(joints) }
    }

    pub(super) fn points(&self) -> &[Point] {
        &self.points
    }

    /// Corners of the parts, without the vertices: the points of the surface that are farthest from sites.
    pub(super) fn between(&self) -> &[Point] {
        &self.between
    }
}

/// The middles of the `n`² parts of a triangle, in parts along two of its sides.
fn middles(n: usize, add: &mut dyn FnMut(f64, f64)) {
    for i in 0..n {
        for j in 0..n - i {
            let (u, v) = (i as f64, j as f64);
            add(u + 1.0 / 3.0, v + 1.0 / 3.0);
            if i + j + 1 < n {
                add(u + 2.0 / 3.0, v + 2.0 / 3.0);
            }
        }
    }
}

/// Their corners but the triangle's own.
fn joints(n: usize, add: &mut dyn FnMut(f64, f64)) {
    for i in 0..=n {
        for j in 0..=n - i {
            if i < n && j < n && i + j > 0 {
                add(i as f64, j as f64);
            }
        }
    }
}

/// The vertices of triangles that are `distinct`: tips and ridges, where a spline is farthest off.
fn vertices(mesh: &TriMesh, distinct: &[bool]) -> Vec<Point> {
    let mut used = vec![false; mesh.positions().len()];
    for (triangle, _) in mesh.triangles().iter().zip(distinct).filter(|(_, distinct)| **distinct) {
        for v in triangle {
            used[*v as usize] = true;
        }
    }
    mesh.positions().iter().zip(used).filter(|(_, used)| *used).map(|(p, _)| *p).collect()
}

/// Where a site lies on a lattice.
struct Site {
    /// Its cell's node.
    node: [i32; 3],
    /// From there, in spacings.
    offset: [f32; 3],
}

impl Site {
    fn of(field: &DistanceField, level: Level, p: &Point) -> Self {
        let lattice = &field.lattice;
        let mut site = Self { node: [0; 3], offset: [0.0; 3] };
        for a in 0..3 {
            let u = (p[a] - lattice.origin[a]) / lattice.spacing;
            let u = if level == Level::Detail { 2.0 * u + 0.5 } else { u };
            let nearest = (u + 0.5).floor();
            site.node[a] = nearest as i32;
            site.offset[a] = (u - nearest) as f32;
        }
        site
    }

    /// Weights of the nodes around it along each axis.
    fn weights(&self) -> [[f32; 3]; 3] {
        self.offset.map(|t| {
            let (low, high) = (0.5 - t, 0.5 + t);
            [0.5 * low * low, 0.75 - t * t, 0.5 * high * high]
        })
    }

    /// The bricks whose coefficients matter to it, up to eight.
    fn slots(&self, field: &DistanceField, level: Level) -> [u32; 8] {
        let edge = EDGE as i32;
        let brick = self.node.map(|n| n.div_euclid(edge) as isize);
        let other = self.node.map(|n| match n.rem_euclid(edge) {
            0 => -1,
            l if l + 1 == edge => 1,
            _ => 0,
        });
        let mut slots = [NO_BRICK; 8];
        for (n, slot) in slots.iter_mut().enumerate() {
            let step = [0, 1, 2].map(|a| if n >> a & 1 == 1 { other[a] } else { 0 });
            if (0..3).all(|a| n >> a & 1 == 0 || other[a] != 0) {
                *slot = field.slot(level, brick[0] + step[0], brick[1] + step[1], brick[2] + step[2]);
            }
        }
        slots
    }
}

/// Moves the coefficients of one level `sweeps` times; the values that are left at the sites, mm (0 at those that the level does
/// not reach).
///
/// # Source
/// S. Lee, G. Wolberg, S. Y. Shin, Scattered data interpolation with multilevel B-splines, IEEE TVCG 1997, equation 5.
pub(super) fn fit(field: &mut DistanceField, level: Level, sites: &Sites, sweeps: usize) -> Vec<f32> {
    let mut errors = vec![0.0; sites.points.len()];
    let n_bricks = field.bricks_of(level).len();
    if n_bricks == 0 {
        return errors;
    }
    let spacing = if level == Level::Detail { 0.5 * field.lattice.spacing } else { field.lattice.spacing };
    let small = SMALL * spacing as f32;
    let places = field.places(level);
    let on_lattice: Vec<Site> = sites.points.par_iter().map(|p| Site::of(field, level, p)).collect();
    let slots: Vec<[u32; 8]> = on_lattice.par_iter().map(|s| s.slots(field, level)).collect();
    let members = Members::new(&slots, n_bricks);
    let mut moved = vec![true; n_bricks];
    for sweep in 0..=sweeps {
        errors.par_iter_mut().zip(&sites.points).zip(&slots).for_each(|((error, p), slots)| {
            if slots.iter().any(|&s| s != NO_BRICK && moved[s as usize]) {
                *error = field.value(p) as f32;
            }
        });
        if sweep == sweeps {
            break;
        }
        let corrections: Vec<Option<Box<[f32; BRICK]>>> = (0..n_bricks)
            .into_par_iter()
            .map(|slot| {
                let own = members.of(slot);
                let is_good = own.iter().all(|&s| errors[s as usize].abs() <= small);
                (!is_good).then(|| corrections(own, places[slot], &on_lattice, &errors))
            })
            .collect();
        let bricks = field.bricks_of_mut(level);
        for (slot, corrections) in corrections.iter().enumerate() {
            moved[slot] = corrections.is_some();
            if let Some(corrections) = corrections {
                bricks.shift(slot, corrections);
            }
        }
    }
    errors
}

/// Sites of every brick of a level: those that its coefficients matter to.
struct Members {
    first: Vec<u32>,
    sites: Vec<u32>,
}

impl Members {
    fn new(slots: &[[u32; 8]], n_bricks: usize) -> Self {
        let mut first = vec![0u32; n_bricks + 1];
        for &slot in slots.iter().flatten().filter(|s| **s != NO_BRICK) {
            first[slot as usize + 1] += 1;
        }
        for n in 0..n_bricks {
            first[n + 1] += first[n];
        }
        let mut next = first.clone();
        let mut sites = vec![0u32; first[n_bricks] as usize];
        for (site, slots) in slots.iter().enumerate() {
            for &slot in slots.iter().filter(|s| **s != NO_BRICK) {
                sites[next[slot as usize] as usize] = site as u32;
                next[slot as usize] += 1;
            }
        }
        Self { first, sites }
    }

    fn of(&self, slot: usize) -> &[u32] {
        &self.sites[self.first[slot] as usize..self.first[slot + 1] as usize]
    }
}

/// What each coefficient of the brick at `brick` has to take back, mm.
fn corrections(own: &[u32], brick: [i32; 3], sites: &[Site], errors: &[f32]) -> Box<[f32; BRICK]> {
    let mut sums = Box::new([0.0f32; BRICK]);
    let mut totals = [0.0f32; BRICK];
    let edge = EDGE as i32;
    for &s in own {
        let site = &sites[s as usize];
        let square = |w: &[f32; 3]| w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
        let weights = site.weights();
        let [x, y, z] = &weights;
        let share = errors[s as usize] / (square(x) * square(y) * square(z));
        // The first of the three nodes along each axis, from the brick's first.
        let [i0, j0, k0] = [0, 1, 2].map(|a| site.node[a] - 1 - edge * brick[a]);
        let within = |first: i32| ((-first).max(0) as usize)..((edge - first).min(3) as usize);
        for k in within(k0) {
            for j in within(j0) {
                let row = edge * ((j0 + j as i32) + edge * (k0 + k as i32)) + i0;
                let yz = y[j] * z[k];
                for i in within(i0) {
                    let place = (row + i as i32) as usize;
                    let w = x[i] * yz;
                    sums[place] += w * w * w * share;
                    totals[place] += w * w;
                }
            }
        }
    }
    for (sum, total) in sums.iter_mut().zip(totals) {
        *sum = if total > 0.0 { *sum / total } else { 0.0 };
    }
    sums
}
