//! A bound on the field's error within the band that no point of it can exceed.
//!
//! In a cube around c (half an edge a, radius r) that the surface does not meet, the sign s of the distance is that of c. With
//! the spline v, its gradient g at c and M above the norm of its Hessian in the cube, s v(x) = s v(c) + s g·(x - c) up to M r² / 2.
//! The distance to a triangle is convex, so d(x) >= min over triangles t of d_t(c) + n_t·(x - c) with n_t the direction from t
//! to c; only triangles with d_t(c) <= d(c) + 2 r can be the closest. And d(x) <= |x - q| with q the point of the surface closest
//! to c. Where the surface meets the cube: |error(x)| <= |v(x)| + d(x), and also <= |v(q)| + (1 + max |∇v|) |x - q| with q the
//! point of the surface closest to x. Cubes whose bound is not good enough are divided.

use super::certificate::{ROUNDING, curvature_bound};
use super::distance_field::DistanceField;
use super::exact::{ExactDistance, is_inside};
use super::lattice::EDGE;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Implicit, Point, Vector};
use rayon::prelude::*;

/// A bound of this many spacings is good enough: below three quarters of a spacing settled signs are proven.
const ENOUGH: f64 = 0.7;
/// A bound that exceeds an error found by no more than this share is good enough.
const LOOSE: f64 = 0.1;
/// Curvature is bounded again in a part of a cube where what it adds is more than this share of a bound that is good enough.
const SLIGHT: f64 = 0.1;
/// Bricks next to each other in the order of proving lie so far apart that any share of them is spread over the field.
const STRIDE: usize = 7_919;
/// Cubes with edges of at most this many spacings are not divided further.
const SMALLEST: f64 = 1.0 / 32.0;
/// With more cells in bricks than this a field gets no bound.
const MOST_CELLS: usize = 20_000_000;

/// A bound on the error in the band, as far as it was proven.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BandBound {
    /// No point of the band in the bricks that were gone through has a larger error, mm.
    pub bound_mm: f64,
    /// Share of the domain's bricks that were gone through, spread evenly; 1 for a proof for the whole band.
    pub share: f64,
}

/// Bound on the error of `field` (mm) at every point of its domain within `band` (mm) of the closed surface that `exact` was made for.
///
/// `on_surface` is a bound on its magnitude at the surface, `seen` (mm) the largest error found by trial. No more bricks are begun when
/// `goes_on` says no. `None` when the surface is open (its sign then changes where no triangle is) or the field too large to be gone
/// through.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn band_bound(
    field: &DistanceField,
    exact: &ExactDistance,
    band: f64,
    (on_surface, seen): (f64, f64),
    goes_on: &(dyn Fn() -> bool + Sync),
    control: &Control,
) -> Result<Option<BandBound>, Cancelled> {
    if !exact.defects().rim.is_empty() || field.bricks.len().saturating_mul(EDGE.pow(3)) > MOST_CELLS {
        return Ok(None);
    }
    let enough = (ENOUGH * field.spacing_mm()).max((1.0 + LOOSE) * seen);
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
            if !goes_on() {
                return Ok((0.0, 0));
            }
            // The stride is a prime number: every brick has its turn.
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
    /// Of the distance, when the surface does not meet the cube that this one is part of.
    sign: Option<f64>,
    /// Triangle (tree order) that is probably close.
    hint: u32,
    /// Bound on the norm of the Hessian in a cube that this one is part of, 1/mm.
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

impl Band<'_> {
    /// The bound at the points of the band in `whole`.
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
            // Half a cell is the cube of a node; in larger ones curvature says little.
            if cube.half <= 0.5 * spacing {
                let (found, here) = match sign {
                    Some(sign) => self.beside_surface(&mut cube, sign, distance, &near.point),
                    None => (0.0, self.across_surface(&mut cube, distance, enough)),
                };
                enough = enough.max((1.0 + LOOSE) * found);
                if here <= enough || !self.divides(&cube) {
                    bound = bound.max(here);
                    continue;
                }
            }
            stack.extend(cube.eighths(sign, near.slot));
        }
        bound
    }

    /// The error at the centre of a cube that the surface does not meet, and the bound.
    fn beside_surface(&self, cube: &mut Cube, sign: f64, distance: f64, closest: &Point) -> (f64, f64) {
        let r = cube.radius();
        let (value, gradient) = self.field.value_gradient(&cube.center);
        let (value, gradient) = (sign * value, sign * gradient);
        let bend = self.bend(cube);
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
        ((value - distance).abs(), above.max(below) + bend)
    }

    /// The bound in a cube that the surface may meet; one of at most `enough` is not made sharper.
    fn across_surface(&self, cube: &mut Cube, distance: f64, enough: f64) -> f64 {
        let r = cube.radius();
        let (value, gradient) = self.field.value_gradient(&cube.center);
        let far = distance + r;
        let flat = value.abs() + cube.half * gradient.lp_norm(1) + far;
        let by_slope = |slope: f64| self.on_surface + (1.0 + slope) * far;
        // Curvature makes neither smaller: the cube will be divided.
        if self.divides(cube) && flat > enough && by_slope(gradient.norm()) > enough {
            return flat.max(enough.next_up());
        }
        let plain = flat + self.bend(cube);
        if plain <= enough {
            return plain;
        }
        // The closest point of the surface to a point of the cube, and the way there, lie within 3 radii of the centre.
        plain.min(by_slope(gradient.norm() + 3.0 * r * self.curvature(cube, 3.0 * 3f64.sqrt())))
    }

    fn divides(&self, cube: &Cube) -> bool {
        2.0 * cube.half > SMALLEST * self.field.spacing_mm()
    }

    /// How far curvature can bend the field in a cube off its tangent, mm.
    fn bend(&self, cube: &mut Cube) -> f64 {
        let square = 0.5 * cube.radius().powi(2);
        if cube.curvature * square > SLIGHT * self.enough {
            cube.curvature = self.curvature(cube, 1.0);
        }
        cube.curvature * square
    }

    /// Bound on the norm of the Hessian in the cube made `times` larger, 1/mm.
    fn curvature(&self, cube: &Cube, times: f64) -> f64 {
        let reach = Vector::repeat(times * cube.half);
        curvature_bound(self.field, &(cube.center - reach), &(cube.center + reach))
    }
}
