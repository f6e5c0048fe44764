use super::exact::ExactDistance;
use prosopon_geometry::control::{Cancelled, Control};
use prosopon_geometry::{Implicit, Point, TriMesh, Vector};
use rayon::prelude::*;

/// One site in this many also gives points on the surface, on an edge and on the medial axis.
const STRIDE: usize = 4;

/// Where a sample point lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleKind {
    /// Within the band around the surface.
    Band,
    /// On a face.
    Face,
    /// On an edge.
    Edge,
    /// On the medial axis behind a face and within the band, where the closest point jumps.
    MedialAxis,
}

/// Fixed points at which to test a field of `surface`.
///
/// `sites` points are spread evenly over the surface's area. Each gives one point of the band: itself plus a vector in the ball
/// of radius `band` (mm), distributed so that small distances are frequent. Every fourth site also gives a point on a face, one
/// on an edge, and one on the medial axis where that lies within the band. Every run gives the same points.
///
/// # Errors
/// [`Cancelled`].
pub fn sample_points(
    surface: &TriMesh,
    exact: &ExactDistance,
    band: f64,
    sites: usize,
    control: &Control,
) -> Result<Vec<(SampleKind, Point)>, Cancelled> {
    let mut total = 0.0;
    let sums: Vec<f64> = (0..surface.triangles().len())
        .map(|t| {
            total += surface.scaled_normal(t).norm();
            total
        })
        .collect();
    let found = (0..sites)
        .into_par_iter()
        .map(|n| {
            control.check()?;
            let target = total * (n as f64 + 0.5) / sites as f64;
            let t = sums.partition_point(|&s| s < target).min(sums.len() - 1);
            Ok(site(surface, exact, t, n, band))
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    Ok(found.into_iter().flatten().flatten().collect())
}

fn site(surface: &TriMesh, exact: &ExactDistance, t: usize, n: usize, band: f64) -> [Option<(SampleKind, Point)>; 4] {
    let [a, b, c] = surface.corners(t);
    // Low-discrepancy sequence of Roberts in six dimensions: its steps are powers of 1/r with r the root of x⁷ = x + 1.
    let sequence = |power: i32| (0.5 + 1.112_775_684_278_705_5f64.powi(-power) * n as f64).fract();
    let (mut u, mut v) = (sequence(1), sequence(2));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    let on_face = a + (b - a) * u + (c - a) * v;
    let (z, angle) = (2.0 * sequence(3) - 1.0, std::f64::consts::TAU * sequence(4));
    let flat = (1.0 - z * z).sqrt();
    let direction = Vector::new(flat * angle.cos(), flat * angle.sin(), z);
    let off = on_face + direction * (band * sequence(5).cbrt());
    let mut points = [Some((SampleKind::Band, off)), None, None, None];
    if n.is_multiple_of(STRIDE) {
        points[1] = Some((SampleKind::Face, on_face));
        points[2] = Some((SampleKind::Edge, a + (b - a) * sequence(6)));
        points[3] = medial(surface, exact, t, &on_face, band).map(|p| (SampleKind::MedialAxis, p));
    }
    points
}

/// Medial-axis point below `on_face`, when it lies within `band`.
///
/// It is the centre of the ball that touches the surface at `on_face` from below and at another point.
fn medial(surface: &TriMesh, exact: &ExactDistance, t: usize, on_face: &Point, band: f64) -> Option<Point> {
    let normal = surface.scaled_normal(t).try_normalize(0.0)?;
    let slot = exact.nearest(on_face, 0).slot;
    let touches_only_here =
        |depth: f64| exact.nearest(&(on_face - normal * depth), slot).distance_sq.sqrt() >= depth * (1.0 - 1e-6);
    if touches_only_here(band) {
        return None;
    }
    let (mut low, mut high) = (0.0, band);
    for _ in 0..20 {
        let middle = 0.5 * (low + high);
        if touches_only_here(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(on_face - normal * low)
}

/// Differences between a field and the exact signed distances.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Accuracy {
    /// Largest error over all points, mm.
    pub max_error_mm: f64,
    /// RMS error over all points, mm.
    pub rms_error_mm: f64,
    /// Largest error over the points on the surface (faces and edges), mm.
    pub surface_max_error_mm: f64,
    /// Number of points more than 0.001 mm off the surface where the field has the wrong sign.
    pub sign_errors: usize,
    /// Number of points.
    pub points: usize,
}

impl Accuracy {
    /// Accuracy from triples of place, field value (mm) and exact signed distance (mm).
    pub fn of(values: impl IntoIterator<Item = (SampleKind, f64, f64)>) -> Self {
        let mut a = Self::default();
        let mut sum = 0.0;
        for (place, value, exact) in values {
            let error = (value - exact).abs();
            a.max_error_mm = a.max_error_mm.max(error);
            sum += error * error;
            if matches!(place, SampleKind::Face | SampleKind::Edge) {
                a.surface_max_error_mm = a.surface_max_error_mm.max(error);
            }
            a.sign_errors += usize::from(exact.abs() > 1e-3 && (value < 0.0) != (exact < 0.0));
            a.points += 1;
        }
        a.rms_error_mm = (sum / a.points.max(1) as f64).sqrt();
        a
    }

    /// Measures `field` against `exact` at `points`.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn measure(
        field: &dyn Implicit,
        exact: &ExactDistance,
        points: &[(SampleKind, Point)],
        control: &Control,
    ) -> Result<Self, Cancelled> {
        let values = points
            .par_iter()
            .map(|(place, p)| {
                control.check()?;
                Ok((*place, field.value(p), exact.signed(p)))
            })
            .collect::<Result<Vec<_>, Cancelled>>()?;
        Ok(Self::of(values))
    }
}
