//! Proven bound on the field's error at the surface.
//!
//! The distance is 0 on the surface, so the error there is the spline's value v. On a part of a triangle with middle m and
//! radius r: |v(x)| <= |v(m)| + max |∇v(m)·(corner - m)| + M r² / 2, where M bounds the norm of the Hessian in all cells that
//! the part meets (Taylor; the spline is C1 and a polynomial in every cell). Second differences of the coefficients bound M,
//! because the Hessian's entries are convex combinations of them. A part is divided while its bound is above the largest value
//! found at the middles.

use super::defects::Defects;
use super::distance_field::{DistanceField, Level};
use super::lattice::{EDGE, Lattice};
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Implicit, Point, TriMesh};
use rayon::prelude::*;

/// Longest edge of the parts at the start, in spacings.
const LONGEST: f64 = 1.5;
/// A bound is accepted when it exceeds the largest value found at middles by at most this share.
const ACCEPTED_EXCESS: f64 = 0.05;
/// Parts with a smaller radius than this, in spacings, are not divided further.
const SMALLEST: f64 = 0.02;
/// A part gets a new curvature bound below this share of the radius that the old one was made for.
const RENEWED_RADIUS_SHARE: f64 = 0.6;
/// A surface that needs more parts than this gets no bound.
const MOST_PARTS: f64 = 2e7;
/// Allowance for rounding, as a share of the largest coordinate.
pub(super) const ROUNDING: f64 = 1e-12;

type Corners = [Point; 3];

/// Bound on the magnitude of `field` (mm) on all triangles of `surface`.
///
/// `defects` are those of `surface`. `None` when the surface is too large for the field's spacing to be examined.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn surface_bound(
    field: &DistanceField,
    surface: &TriMesh,
    defects: &Defects,
    control: &Control,
) -> Result<Option<f64>, Cancelled> {
    let longest = LONGEST * field.spacing_mm();
    let triangles: Vec<usize> = (0..surface.triangles().len())
        .filter(|&t| defects.distinct[t] || surface.scaled_normal(t).norm() == 0.0)
        .collect();
    let wanted: f64 = triangles.iter().map(|&t| (longest_edge(&surface.corners(t)) / longest).powi(2) + 1.0).sum();
    if wanted > MOST_PARTS {
        return Ok(None);
    }
    // The zero was fitted at the middles of whole triangles, so corners show larger values.
    let largest = |t: &usize| {
        let at = parts(surface.corners(*t), longest).flat_map(|part| part.into_iter().chain([middle(&part)]));
        at.map(|p| field.value(&p).abs()).fold(0.0, f64::max)
    };
    let found = triangles.par_iter().map(largest).reduce(|| 0.0, f64::max);
    control.check()?;
    control.report(0.3);
    let enough = (1.0 + ACCEPTED_EXCESS) * found;
    let bound = triangles
        .par_iter()
        .map(|&t| {
            control.check()?;
            let (mut bound, mut enough) = (0.0f64, enough);
            let mut stack: Vec<(Corners, Curvature)> =
                parts(surface.corners(t), longest).map(|part| (part, Curvature::around(field, &part))).collect();
            while let Some((part, mut curvature)) = stack.pop() {
                let mut here = Local::of(field, &part, &curvature);
                enough = enough.max((1.0 + ACCEPTED_EXCESS) * here.value);
                if here.bound > enough && here.radius < RENEWED_RADIUS_SHARE * curvature.radius {
                    curvature = Curvature::around(field, &part);
                    here = Local::of(field, &part, &curvature);
                }
                if here.bound > enough && here.radius > SMALLEST * field.spacing_mm() {
                    stack.extend(halves(&part).map(|half| (half, curvature)));
                } else {
                    bound = bound.max(here.bound);
                }
            }
            Ok(bound)
        })
        .try_reduce(|| 0.0, |a: f64, b| Ok(a.max(b)))?;
    let bounds = surface.bounds();
    let extent = bounds.min.coords.amax().max(bounds.max.coords.amax());
    Ok(Some(bound + ROUNDING * extent))
}

fn middle([a, b, c]: &Corners) -> Point {
    Point::from((a.coords + b.coords + c.coords) / 3.0)
}

fn longest_edge([a, b, c]: &Corners) -> f64 {
    (b - a).norm().max((c - b).norm()).max((a - c).norm())
}

/// The triangle divided into equal parts with edges of at most `longest`, mm.
fn parts(corners: Corners, longest: f64) -> impl Iterator<Item = Corners> {
    let n = (longest_edge(&corners) / longest).ceil().max(1.0);
    let [a, b, c] = corners;
    let at = move |i: f64, j: f64| a + (b - a) * (i / n) + (c - a) * (j / n);
    let n = n as usize;
    (0..n).flat_map(move |i| (0..n - i).map(move |j| (i, j))).flat_map(move |(i, j)| {
        let (u, v) = (i as f64, j as f64);
        let upright = [at(u, v), at(u + 1.0, v), at(u, v + 1.0)];
        let inverted = (i + j + 1 < n).then(|| [at(u + 1.0, v + 1.0), at(u, v + 1.0), at(u + 1.0, v)]);
        std::iter::once(upright).chain(inverted)
    })
}

/// The two halves of a part, divided at the middle of its longest edge.
fn halves(part: &Corners) -> [Corners; 2] {
    let length = |i: usize| (part[(i + 1) % 3] - part[i]).norm_squared();
    let longest = (1..3).fold(0, |best, i| if length(i) > length(best) { i } else { best });
    let [a, b, c] = [0, 1, 2].map(|i| part[(longest + i) % 3]);
    let half = nalgebra::center(&a, &b);
    [[a, half, c], [half, b, c]]
}

/// Bound on the field on a part of a triangle.
struct Local {
    /// Radius of the part around its middle, mm.
    radius: f64,
    /// Magnitude of the field at the middle, mm.
    value: f64,
    /// Bound on the magnitude at every point of the part, mm.
    bound: f64,
}

/// Bound on the norm of the Hessian in all cells that a part meets.
#[derive(Debug, Clone, Copy)]
struct Curvature {
    /// Radius of that part, mm.
    radius: f64,
    bound: f64,
}

impl Curvature {
    fn around(field: &DistanceField, part: &Corners) -> Self {
        let (mut min, mut max) = (part[0], part[0]);
        for p in &part[1..] {
            (min, max) = (min.inf(p), max.sup(p));
        }
        Self { radius: radius(part), bound: curvature_bound(field, &min, &max) }
    }
}

impl Local {
    fn of(field: &DistanceField, part: &Corners, curvature: &Curvature) -> Self {
        let m = middle(part);
        let (value, gradient) = field.value_gradient(&m);
        let radius = radius(part);
        // The linear term is largest at a corner.
        let rise = part.iter().map(|p| gradient.dot(&(p - m)).abs()).fold(0.0, f64::max);
        let curvature_term = 0.5 * curvature.bound * radius * radius;
        Self { radius, value: value.abs(), bound: value.abs() + rise + curvature_term }
    }
}

/// Largest distance of a corner from the middle, mm.
fn radius(part: &Corners) -> f64 {
    let m = middle(part);
    part.iter().map(|p| (p - m).norm()).fold(0.0, f64::max)
}

/// Bound on the norm of the Hessian in all cells that meet the box, 1/mm.
pub(super) fn curvature_bound(field: &DistanceField, min: &Point, max: &Point) -> f64 {
    let lattice = &field.lattice;
    let node = |level: Level| move |a: usize, end: usize| node_of(lattice, level, a, [min, max][end][a]);
    let coarser = level_bound(lattice.spacing, node(Level::Brick), |n| field.coefficient(n));
    if field.parts.is_empty() {
        return coarser;
    }
    let h = 0.5 * lattice.spacing;
    coarser + level_bound(h, node(Level::Detail), |n| field.detail_coefficient(n))
}

/// The node of a level whose cell holds the coordinate `x` along an axis.
fn node_of(lattice: &Lattice, level: Level, axis: usize, x: f64) -> isize {
    let u = (x - lattice.origin[axis]) / lattice.spacing;
    let (u, most) = match level {
        Level::Brick => (u, EDGE),
        Level::Detail => (2.0 * u + 0.5, 2 * EDGE),
    };
    ((u + 0.5).floor() as isize).clamp(0, (most * lattice.bricks[axis]) as isize - 1)
}

/// Bound on the norm of the Hessian of one level of spacing `h` (mm), 1/mm.
///
/// It uses the nodes around the cells `node(axis, 0)..=node(axis, 1)`.
fn level_bound(h: f64, node: impl Fn(usize, usize) -> isize, coefficient: impl Fn([isize; 3]) -> f64) -> f64 {
    let first = [0, 1, 2].map(|a| node(a, 0) - 1);
    let dims = [0, 1, 2].map(|a| (node(a, 1) + 2 - first[a]) as usize);
    let strides = [1, dims[0], dims[0] * dims[1]];
    let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / strides[2]];
    let total = dims.iter().product();
    let c: Vec<f64> = (0..total).map(|n| coefficient([0, 1, 2].map(|a| first[a] + at(n)[a] as isize))).collect();
    let mut largest = [[0.0f64; 3]; 3];
    for n in 0..total {
        let place = at(n);
        for a in 0..3 {
            let sa = strides[a];
            if place[a] > 0 && place[a] + 1 < dims[a] {
                let second = c[n - sa] - 2.0 * c[n] + c[n + sa];
                largest[a][a] = largest[a][a].max(second.abs());
            }
            for b in 0..a {
                let sb = strides[b];
                if place[a] + 1 < dims[a] && place[b] + 1 < dims[b] {
                    let mixed = c[n] - c[n + sa] - c[n + sb] + c[n + sa + sb];
                    largest[a][b] = largest[a][b].max(mixed.abs());
                }
            }
        }
    }
    let squares: f64 =
        (0..3).map(|a| largest[a][a].powi(2) + 2.0 * (0..a).map(|b| largest[a][b].powi(2)).sum::<f64>()).sum();
    squares.sqrt() / (h * h)
}
