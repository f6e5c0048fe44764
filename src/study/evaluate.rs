use std::hint::black_box;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::error::{BenchError, write};
use super::files::{read_points, read_surface, write_distances};
use super::process;
use prosopon_field::{ExactDistance, MethodSettings, SignedField};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Point, Warning};

/// Builds shorter than this, s, are repeated twice; the shortest of the three counts.
const SHORT_S: f64 = 1.0;

/// Time and memory to build and query one field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Timing {
    pub(super) spacing_mm: f64,
    pub(super) build_wall_s: f64,
    pub(super) build_cpu_s: Option<f64>,
    /// Memory of the field.
    pub(super) memory_mb: f64,
    /// Peak memory of the build beyond the surface, including the field.
    pub(super) peak_mb: Option<f64>,
    /// Time for value and gradient at a point on one thread, points in the order of a space-filling curve.
    pub(super) query_sorted_ns: f64,
    /// The same with the points in random order.
    pub(super) query_random_ns: f64,
    /// Time for value, gradient and Hessian, in the same two orders.
    pub(super) hessian_sorted_ns: Option<f64>,
    pub(super) hessian_random_ns: Option<f64>,
    /// Proven bound on the error at the surface, mm; only for the adaptive method.
    pub(super) surface_bound_mm: Option<f64>,
}

/// A field, its number of bricks and the warnings about its surface.
type Built = (SignedField, usize, Vec<Warning>);

/// Builds a field of the surface in `mesh` and writes its distances at the points in `points` to `out`.
///
/// The winding number decides the sign of distances near zero. Times and memory go to `timing` as JSON, warnings about the
/// surface to `warnings_out`.
///
/// # Errors
/// [`BenchError`].
pub fn evaluate(
    mesh: &Path,
    settings: &MethodSettings,
    points: &Path,
    out: &Path,
    timing: Option<&Path>,
    warnings_out: &mut dyn Write,
) -> Result<(), BenchError> {
    let points = read_points(points)?;
    let surface = read_surface(mesh)?;
    let build = || {
        SignedField::build_only(&surface, settings, &Control::new())
            .map_err(|source| BenchError::Field { method: settings.method.name(), source })
    };
    process::forget_peak();
    let before = process::memory_mb();
    let ((field, _, warnings), mut wall_s, mut cpu_s) = timed(build)?;
    let peak_mb = process::peak_mb().zip(before).map(|(peak, before)| peak - before);
    for warning in warnings {
        writeln!(warnings_out, "warning: {warning}")?;
    }
    let exact = ExactDistance::new(&surface);
    let distances: Vec<f64> = points.par_iter().map(|p| field.distance_with_checked_sign(&exact, p).distance).collect();
    write_distances(out, &distances)?;
    let Some(timing) = timing else { return Ok(()) };
    if wall_s < SHORT_S {
        for _ in 0..2 {
            let (_, wall, cpu) = timed(build)?;
            if wall < wall_s {
                (wall_s, cpu_s) = (wall, cpu);
            }
        }
    }
    let (sorted, random) = (along_a_curve(&points), shuffled(&points));
    let jet = |p: &Point| field.value_gradient(p);
    let bent = |p: &Point| field.value_gradient_hessian(p);
    let surface_bound_mm = field.surface_bound(&surface, &exact, &Control::new()).unwrap_or_default();
    let found = Timing {
        spacing_mm: field.spacing_mm(),
        build_wall_s: wall_s,
        build_cpu_s: cpu_s,
        memory_mb: field.bytes() as f64 * 1e-6,
        peak_mb,
        query_sorted_ns: query_ns(&sorted, jet),
        query_random_ns: query_ns(&random, jet),
        hessian_sorted_ns: Some(query_ns(&sorted, bent)),
        hessian_random_ns: Some(query_ns(&random, bent)),
        surface_bound_mm,
    };
    let json = serde_json::to_vec(&found).map_err(std::io::Error::other)?;
    write(timing, &json)
}

fn timed(build: impl Fn() -> Result<Built, BenchError>) -> Result<(Built, f64, Option<f64>), BenchError> {
    let (start, cpu) = (Instant::now(), process::cpu_s());
    let built = build()?;
    let wall_s = start.elapsed().as_secs_f64();
    Ok((built, wall_s, process::cpu_s().zip(cpu).map(|(after, before)| after - before)))
}

/// Mean time of a query in the best of three rounds, ns.
fn query_ns<T>(points: &[Point], query: impl Fn(&Point) -> T) -> f64 {
    let round = || {
        let start = Instant::now();
        for p in points {
            black_box(query(black_box(p)));
        }
        start.elapsed().as_secs_f64() * 1e9 / points.len().max(1) as f64
    };
    (0..3).map(|_| round()).fold(f64::INFINITY, f64::min)
}

/// The points in the order of the Morton curve over their bounding box.
fn along_a_curve(points: &[Point]) -> Vec<Point> {
    let Some(bounds) = prosopon_geometry::Aabb::of(points) else { return Vec::new() };
    let scale = 1023.0 / (bounds.max - bounds.min).max().max(f64::MIN_POSITIVE);
    let mut keyed: Vec<(u32, usize)> = points
        .iter()
        .enumerate()
        .map(|(n, p)| {
            let cell = ((p - bounds.min) * scale).map(|c| c as u32);
            let key = (0..10).fold(0, |key, bit| {
                key | (cell.x >> bit & 1) << (3 * bit)
                    | (cell.y >> bit & 1) << (3 * bit + 1)
                    | (cell.z >> bit & 1) << (3 * bit + 2)
            });
            (key, n)
        })
        .collect();
    keyed.sort_unstable();
    keyed.iter().map(|&(_, n)| points[n]).collect()
}

/// The points in a pseudo-random order that is the same in every run.
fn shuffled(points: &[Point]) -> Vec<Point> {
    let mut shuffled = points.to_vec();
    let mut state = 1u64;
    for n in (1..shuffled.len()).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        shuffled.swap(n, (state >> 33) as usize % (n + 1));
    }
    shuffled
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::write_points;
    use prosopon_field::FieldError;
    use prosopon_geometry::TriMesh;

    #[test]
    fn warnings_are_told_and_a_wrong_resolution_is_named() {
        // A cube without its lid.
        let corner = |i: usize| Point::from([0, 1, 2].map(|a| if i >> a & 1 == 1 { 10.0 } else { 0.0 }));
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = TriMesh::new((0..8).map(corner).collect(), triangles).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("open.stl"), prosopon_formats::export::stl(&mesh)).unwrap();
        write_points(&path("points.bin"), [Point::new(5.0, 5.0, 1.0)].iter()).unwrap();
        let mut warnings_out = Vec::new();
        let mut run = |settings: &MethodSettings| {
            evaluate(&path("open.stl"), settings, &path("points.bin"), &path("out.bin"), None, &mut warnings_out)
        };
        let wrong = MethodSettings { resolution: Some(0), ..MethodSettings::default() };
        match run(&wrong) {
            Err(BenchError::Field { source: FieldError::Setting { name, found, .. }, .. }) => {
                assert_eq!((name, found), ("resolution", 0.0));
            }
            other => panic!("{other:?}"),
        }
        run(&MethodSettings::default()).unwrap();
        let warnings_out = String::from_utf8(warnings_out).unwrap();
        assert!(warnings_out.starts_with("warning: ") && warnings_out.contains("edges"), "{warnings_out}");
        assert_eq!(std::fs::read(path("out.bin")).unwrap().len(), 8);
    }
}
