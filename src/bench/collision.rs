use std::io::Write;
use std::path::Path;
use std::time::Instant;

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};
use rayon::prelude::*;

use super::chart::{self, Curve, Labels, color};
use super::error::{BenchError, write};
use super::files::read_surface;
use crate::control::Control;
use crate::field::{ExactDistance, FieldSettings, Method, MethodSettings, SignedField, Tolerance};
use crate::geometry::{Implicit, Motion, Point, TriMesh, Vector};

/// Positions on the path.
const POSITIONS: usize = 20;
/// Advance and lowering of the bone over the path, mm: the largest plan of Wang 2009, Table 2.
const FORWARD_MM: f64 = 12.2;
const DOWN_MM: f64 = 2.1;
/// Times that the path is walked; the shortest counts.
const ROUNDS: usize = 3;
/// Gap between bone and the tissue's inner surface at rest, mm.
const GAP_MM: f64 = 0.5;
/// Half-width of the band, mm.
const BAND_MM: f64 = 5.0;
/// Tolerances of the octrees, as a share of the bounding cube's edge (Wang 2009, Figure 14, and coarser ones).
const TOLERANCES: [f64; 6] = [1e-3, 1e-4, 1e-5, 4e-6, 2e-6, 1e-6];
/// Cells along the edge of the bounding cube.
const RESOLUTION: u32 = 256;

/// Measures the time of one collision detection over a path, against the octrees' tolerance (Wang 2009, Figure 14).
///
/// The tested points are vertices and barycentres (Figure 6) of the tissue's inner surface: the tissue surface pressed onto the
/// bone up to a gap. One detection is the distance at every point and the gradient at those that the bone has reached.
#[derive(Debug)]
pub struct CollisionStudy<'a> {
    /// Surface of the moved bone.
    pub mesh: &'a Path,
    /// A surface of the tissue, for example the skin.
    pub tissue: &'a Path,
    /// Where the rows go; the chart gets the same name with `.svg`.
    pub csv: &'a Path,
}

/// What a way of detection takes.
struct Measured {
    method: String,
    tolerance: Option<f64>,
    build_s: f64,
    /// Per position, all points, one thread and all threads, ms.
    one_thread_ms: f64,
    all_threads_ms: f64,
    /// Points within the bone, over all positions.
    hits: usize,
    /// Of the field.
    memory_mb: Option<f64>,
}

impl CollisionStudy<'_> {
    /// Runs the study; prints to `out`.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        let bone = read_surface(self.mesh)?;
        let points = inner_points(&bone, &read_surface(self.tissue)?);
        writeln!(
            out,
            "{} points (vertices and barycentres), {POSITIONS} positions, {FORWARD_MM} mm forward and {DOWN_MM} mm down",
            points.len()
        )?;
        let mut all = vec![by_hierarchy(&bone, &points)?];
        let mut cases: Vec<(Method, Option<f64>)> = vec![(Method::Adaptive, None), (Method::Uniform, None)];
        for method in [Method::Hybrid, Method::Frisken] {
            cases.extend(TOLERANCES.map(|t| (method, Some(t))));
        }
        for (method, tolerance) in cases {
            all.push(by_field(&bone, method, tolerance, &points)?);
        }
        let mut csv = String::from("method,tolerance,build_s,one_thread_ms,all_threads_ms,hits,memory_mb\n");
        for m in &all {
            let tolerance = m.tolerance.map_or(String::new(), |t| format!("{t:e}"));
            let memory = m.memory_mb.map_or(String::new(), |mb| format!("{mb:.2}"));
            csv += &format!(
                "{},{tolerance},{:.3},{:.3},{:.3},{},{memory}\n",
                m.method, m.build_s, m.one_thread_ms, m.all_threads_ms, m.hits
            );
        }
        write!(out, "{csv}")?;
        write(self.csv, csv.as_bytes())?;
        let svg = self.csv.with_extension("svg");
        write(&svg, chart(&all)?.as_bytes())?;
        writeln!(out, "wrote {} and {}", self.csv.display(), svg.display())?;
        Ok(())
    }
}

/// Vertices and barycentres of `tissue` moved towards the bone up to the gap.
fn inner_points(bone: &TriMesh, tissue: &TriMesh) -> Vec<Point> {
    let exact = ExactDistance::new(bone);
    let vertices: Vec<Point> = tissue
        .positions()
        .par_iter()
        .map(|p| {
            let (closest, _, distance) = exact.closest(p);
            if distance > GAP_MM { closest + (p - closest) * (GAP_MM / distance) } else { *p }
        })
        .collect();
    let barycentres = tissue.triangles().iter().map(|t| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        a + ((b - a) + (c - a)) / 3.0
    });
    vertices.iter().copied().chain(barycentres).collect()
}

/// The bone's motion at each position: forward is -y, down is -z.
fn path() -> Vec<Motion> {
    let at = |n: usize| (n + 1) as f64 / POSITIONS as f64;
    (0..POSITIONS).map(|n| Motion::translation(0.0, -FORWARD_MM * at(n), -DOWN_MM * at(n))).collect()
}

/// Mean time of a position, best of some rounds, ms, on one and on all threads, and the number of hits.
fn detect(points: &[Point], hit: impl Fn(&Point) -> bool + Sync) -> (f64, f64, usize) {
    let path = path();
    let mut hits = 0;
    let mut best_ms = |detect: &dyn Fn() -> usize| {
        let round = || {
            let start = Instant::now();
            hits = detect();
            start.elapsed().as_secs_f64() * 1e3 / POSITIONS as f64
        };
        std::iter::repeat_with(round).take(ROUNDS).fold(f64::INFINITY, f64::min)
    };
    let one =
        best_ms(&|| path.iter().map(|m| points.iter().filter(|p| hit(&m.inverse_transform_point(p))).count()).sum());
    let all = best_ms(&|| {
        path.iter().map(|m| points.par_iter().filter(|p| hit(&m.inverse_transform_point(p))).count()).sum()
    });
    (one, all, hits)
}

fn by_field(bone: &TriMesh, method: Method, tolerance: Option<f64>, points: &[Point]) -> Result<Measured, BenchError> {
    let defaults = MethodSettings::default();
    let settings = MethodSettings {
        method,
        field: FieldSettings { band_mm: BAND_MM, margin_mm: BAND_MM, ..defaults.field },
        resolution: Some(RESOLUTION),
        tolerance: tolerance.map_or(defaults.tolerance, Tolerance::Relative),
    };
    let start = Instant::now();
    let (field, ..) = SignedField::build_only(bone, &settings, &Control::new())
        .map_err(|source| BenchError::Field { method: method.name(), source })?;
    let build_s = start.elapsed().as_secs_f64();
    let (one_thread_ms, all_threads_ms, hits) =
        detect(points, |p| field.value(p) < 0.0 && std::hint::black_box(field.value_gradient(p)).0 < 0.0);
    let memory_mb = Some(field.bytes() as f64 * 1e-6);
    Ok(Measured {
        method: method.name().to_owned(),
        tolerance,
        build_s,
        one_thread_ms,
        all_threads_ms,
        hits,
        memory_mb,
    })
}

/// No field at all: the closest point by parry's bounding volume hierarchy, signed by its pseudonormals.
fn by_hierarchy(bone: &TriMesh, points: &[Point]) -> Result<Measured, BenchError> {
    let start = Instant::now();
    let vertices = bone.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
    let shape = Shape::with_flags(vertices, bone.triangles().to_vec(), TriMeshFlags::ORIENTED)
        .map_err(|e| BenchError::Hierarchy { detail: e.to_string() })?;
    let build_s = start.elapsed().as_secs_f64();
    let (one_thread_ms, all_threads_ms, hits) = detect(points, |p| {
        let q = shape.project_local_point(ParryVector::new(p.x, p.y, p.z), false);
        let towards = Vector::new(q.point.x - p.x, q.point.y - p.y, q.point.z - p.z);
        std::hint::black_box(towards.norm());
        q.is_inside
    });
    Ok(Measured {
        method: "closest point (parry3d)".to_owned(),
        tolerance: None,
        build_s,
        one_thread_ms,
        all_threads_ms,
        hits,
        memory_mb: None,
    })
}

/// Time against tolerance; what has no tolerance is a level line.
fn chart(all: &[Measured]) -> Result<String, BenchError> {
    let mut curves: Vec<Curve> = Vec::new();
    for m in all {
        let color = Method::ALL.into_iter().find(|k| k.name() == m.method).map_or(plotters::style::BLACK, color);
        let points: Vec<(f64, f64)> = match m.tolerance {
            Some(t) => vec![(t, m.one_thread_ms)],
            None => [TOLERANCES[0], TOLERANCES[TOLERANCES.len() - 1]].map(|t| (t, m.one_thread_ms)).to_vec(),
        };
        match curves.iter_mut().find(|c| c.name == m.method) {
            Some(curve) => curve.points.extend(points),
            None => curves.push(Curve { name: m.method.clone(), color, points }),
        }
    }
    let labels = Labels {
        title: "Time of one collision detection against the octree's tolerance (256³, one thread)",
        x: "tolerance, share of the bounding cube's edge",
        y: "one detection, ms",
    };
    chart::draw(&labels, &curves)
}
