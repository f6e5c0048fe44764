//! Proven bound on the field's error within the band.
//!
//! Consider a cube with centre c, half edge a and radius r that the surface does not meet: the distance has one sign s in it.
//! With the spline v, its gradient g at c and M a bound on the norm of its Hessian in the cube, s v(x) = s v(c) + s g·(x - c)
//! up to M r² / 2. The distance to a triangle is convex, so d(x) >= min over triangles t of d_t(c) + n_t·(x - c), where n_t is
//! the direction from t to c; only triangles with d_t(c) <= d(c) + 2 r can be the closest. Also d(x) <= |x - q|, where q is the
//! point of the surface closest to c. In a cube that the surface meets: |error(x)| <= |v(x)| + d(x), and also |error(x)| <=
//! |v(q)| + (1 + max |∇v|) |x - q|, where q is the point of the surface closest to x. A cube is divided while its bound is too
//! large.

use super::certificate::{ROUNDING, curvature_bound};
use super::distance_field::DistanceField;
use super::exact::{ExactDistance, is_inside};
use super::lattice::EDGE;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Implicit, Point, Vector};
use rayon::prelude::*;

/// A bound of this many spacings is accepted.
///
/// A bound below three quarters of a spacing proves the signs of queries with a checked sign.
const ACCEPTED_SPACINGS: f64 = 0.7;
/// A bound is accepted when it exceeds the largest error found by at most this share.
const ACCEPTED_EXCESS: f64 = 0.1;
/// A cube gets a new curvature bound where its term exceeds this share of an accepted bound.
const MAX_CURVATURE_SHARE: f64 = 0.1;
/// Step between bricks examined one after the other; it spreads any share of them over the field.
const STRIDE: usize = 7_919;
/// Cubes with edges of at most this many spacings are not divided further.
const SMALLEST: f64 = 1.0 / 32.0;
/// A field with more cells in bricks than this gets no bound.
const MOST_CELLS: usize = 20_000_000;

/// Bound on the error in the band, and the share of the field that it was proven for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandBound {
    /// Bound on the error at every point of the band in the examined bricks, mm.
    pub bound_mm: f64,
    /// Share of the domain's bricks that were examined, spread evenly; 1 for a proof of the whole band.
    pub share: f64,
}

/// Bound on the error of `field` at every point of its domain within `band` of a closed surface, mm.
///
/// `exact` was made from the surface. `on_surface` bounds the field's magnitude at the surface (mm); `largest_found` is the
/// largest error found by sampling (mm). No further bricks are started once `keep_going` returns false. `None` when the
/// surface is open, because the sign then changes where there is no triangle, or when the field is too large to be examined.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn band_bound(
    field: &DistanceField,
    exact: &ExactDistance,
    band: f64,
    on_surface: f64,
    largest_found: f64,
    keep_going: &(dyn Fn() -> bool + Sync),
    control: &Control,
) -> Result<Option<BandBound>, Cancelled> {
    if !exact.defects().rim.is_empty() || field.bricks.len().saturating_mul(EDGE.pow(3)) > MOST_CELLS {
        return Ok(None);
    }
    let enough = (ACCEPTED_SPACINGS * field.spacing_mm()).max((1.0 + ACCEPTED_EXCESS) * largest_found);
    let band = Band { field, exact, band, on_surface, enough };
    let lattice = &field.lattice;
    let domain = lattice.domain();
    let half = 0.5 * lattice.coarse_spacing();
    let n_bricks = lattice.n_bricks();
    let stride = if n_bricks.is_multiple_of(STRIDE) { 1 } else { STRIDE };
    let (bound, done) = (0..n_bricks)
        .into_par_iter()
        .map(|n| {
            control.check()?;
            if !keep_going() {
                return Ok((0.0, 0));
            }
            // The stride is a prime number, so every brick is examined once.
            let brick = (n as u128 * stride as u128 % n_bricks as u128) as usize;
            let at = lattice.brick_at(brick).map(|n| (2 * n + 1) as f64 * half);
            let center = domain.min + Vector::from(at);
            Ok((band.bound_in(Cube { center, half, sign: None, hint: 0, curvature: f64::INFINITY }), 1))
        })
        .try_reduce(|| (0.0, 0), |a: (f64, usize), b| Ok((a.0.max(b.0), a.1 + b.1)))?;
    let extent = domain.min.coords.amax().max(domain.max.coords.amax());
    Ok(Some(BandBound { bound_mm: bound + ROUNDING * extent, share: done as f64 / n_bricks as f64 }))
}

struct Band<'a> {
    field: &'a DistanceField,
    exact: &'a ExactDistance,
    band: f64,
    on_surface: f64,
    enough: f64,
}

#[derive(Debug, Clone, Copy)]
struct Cube {
    center: Point,
    /// Half an edge, mm.
    half: f64,
    /// Sign of the distance, when the surface does not meet a cube that contains this one.
    sign: Option<f64>,
    /// Triangle (tree order) that is probably close.
    hint: u32,
    /// Bound on the norm of the Hessian in a cube that contains this one, 1/mm.
    curvature: f64,
}

impl Cube {
    fn radius(&self) -> f64 {
        3f64.sqrt() * self.half
    }

    fn eighths(self, sign: Option<f64>, hint: u32) -> impl Iterator<Item = Self> {
        let half = 0.5 * self.half;
        (0..8).map(move |n| {
            let side = |axis: usize| if n >> axis & 1 == 0 { -half } else { half };
            let center = self.center + Vector::new(side(0), side(1), side(2));
            Self { center, half, sign, hint, ..self }
        })
    }
}

/// Error of the field in a cube, mm.
struct CubeError {
    /// Error at the centre; 0 where it was not computed.
    found: f64,
    /// Bound on the error at every point.
    bound: f64,
}

impl Band<'_> {
    /// Bound on the error at the points of the band in `whole`, mm.
    fn bound_in(&self, whole: Cube) -> f64 {
        let spacing = self.field.spacing_mm();
        let (mut bound, mut enough) = (0.0f64, self.enough);
        let mut stack = vec![whole];
        while let Some(mut cube) = stack.pop() {
            let near = self.exact.nearest(&cube.center, cube.hint);
            let (distance, radius) = (near.distance_sq.sqrt(), cube.radius());
            if distance > self.band + radius {
                continue;
            }
            let clear = || if is_inside(self.exact.winding_number(&cube.center)) { -1.0 } else { 1.0 };
            let sign = cube.sign.or_else(|| (distance > radius).then(clear));
            // A cube of half a cell to every side is the cube of one node; in larger ones the curvature bound is of little use.
            if cube.half <= 0.5 * spacing {
                let here = match sign {
                    Some(sign) => self.beside_surface(&mut cube, sign, distance, &near.point),
                    None => CubeError { found: 0.0, bound: self.across_surface(&mut cube, distance, enough) },
                };
                enough = enough.max((1.0 + ACCEPTED_EXCESS) * here.found);
                if here.bound <= enough || !self.divides(&cube) {
                    bound = bound.max(here.bound);
                    continue;
                }
            }
            stack.extend(cube.eighths(sign, near.slot));
        }
        bound
    }

    /// The error in a cube that the surface does not meet.
    fn beside_surface(&self, cube: &mut Cube, sign: f64, distance: f64, closest: &Point) -> CubeError {
        let r = cube.radius();
        let (value, gradient) = self.field.value_gradient(&cube.center);
        let (value, gradient) = (sign * value, sign * gradient);
        let curvature_term = self.curvature_term(cube);
        let c = &cube.center;
        let rise = |slope: Vector| cube.half * slope.lp_norm(1);
        let mut above = f64::NEG_INFINITY;
        self.exact.tree().for_each_within(c, distance + 2.0 * r, |q, d| {
            above = above.max(value - d + rise(gradient - (c - q) / d));
        });
        let straight = rise(gradient - (c - closest) / distance);
        // |d n + y| - d - n·y is at most |y|² / (2 (d - |y|)), and at most 2 |y|.
        let round = if distance > r { (0.5 * r * r / (distance - r)).min(2.0 * r) } else { 2.0 * r };
        let below = distance - value + straight + round;
        CubeError { found: (value - distance).abs(), bound: above.max(below) + curvature_term }
    }

    /// Bound on the error in a cube that the surface may meet, mm; not refined once it is at most `enough`.
    fn across_surface(&self, cube: &mut Cube, distance: f64, enough: f64) -> f64 {
        let r = cube.radius();
        let (value, gradient) = self.field.value_gradient(&cube.center);
        let far = distance + r;
        let flat = value.abs() + cube.half * gradient.lp_norm(1) + far;
        let by_slope = |slope: f64| self.on_surface + (1.0 + slope) * far;
        // The curvature term only adds to both, so the cube is divided without it.
        if self.divides(cube) && flat > enough && by_slope(gradient.norm()) > enough {
            return flat.max(enough.next_up());
        }
        let plain = flat + self.curvature_term(cube);
        if plain <= enough {
            return plain;
        }
        // The surface point closest to a point of the cube, and the segment to it, lie within 3 radii of the centre.
        plain.min(by_slope(gradient.norm() + 3.0 * r * self.curvature(cube, 3.0 * 3f64.sqrt())))
    }

    fn divides(&self, cube: &Cube) -> bool {
        2.0 * cube.half > SMALLEST * self.field.spacing_mm()
    }

    /// Largest deviation of the field from its tangent in a cube, by the curvature bound, mm.
    fn curvature_term(&self, cube: &mut Cube) -> f64 {
        let square = 0.5 * cube.radius().powi(2);
        if cube.curvature * square > MAX_CURVATURE_SHARE * self.enough {
            cube.curvature = self.curvature(cube, 1.0);
        }
        cube.curvature * square
    }

    /// Bound on the norm of the Hessian in the cube enlarged by `times`, 1/mm.
    fn curvature(&self, cube: &Cube, times: f64) -> f64 {
        let reach = Vector::repeat(times * cube.half);
        curvature_bound(self.field, &(cube.center - reach), &(cube.center + reach))
    }
}
