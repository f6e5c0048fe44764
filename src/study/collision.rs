use std::io::Write;
use std::path::Path;
use std::time::Instant;

use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh as Shape, TriMeshFlags};
use rayon::prelude::*;
use serde::Deserialize;

use super::chart::{self, Curve, Labels, color};
use super::error::{BenchError, read, write};
use super::files::{read_surface, refuse_unwritable};
use prosopon_field::{ExactDistance, FieldSettings, Method, MethodSettings, SignedField, Tolerance};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector};
use prosopon_planning::plan::le_fort_1;
use prosopon_planning::simulate::{Anatomy, FieldsSettings, TissueSettings, build_fields, build_tissue, cut_bone};
use prosopon_tissue::mesh::MixedMesh;

/// Positions on the path.
const POSITIONS: usize = 20;
/// Advance and lowering of the bone over the path, mm: the largest plan of Wang 2009, Table 2.
const FORWARD_MM: f64 = 12.2;
const DOWN_MM: f64 = 2.1;
/// Repetitions of the path; the shortest time counts.
const ROUNDS: usize = 3;
/// Half-width of the band, mm.
const BAND_MM: f64 = 5.0;
/// Tolerances of the octrees relative to the edge of the bounding cube (Wang 2009, Figure 14, and coarser ones).
const TOLERANCES: [f64; 6] = [1e-3, 1e-4, 1e-5, 4e-6, 2e-6, 1e-6];
/// Finest spacing, mm: 256³ over a skull.
const SPACING_MM: f64 = 0.8;

/// Measures the time of one collision detection against the tolerance of the octrees (Wang 2009, Figure 14).
///
/// The scene is a Le Fort I osteotomy. The test points are the vertices and barycentres (Figure 6) of the tissue mesh faces that
/// are turned to bone. They are tested against the segment below the cut. One detection computes the distance at every point and
/// the gradient at the points inside the segment.
#[derive(Debug)]
pub struct CollisionStudy<'a> {
    /// Surface of the skull.
    pub skull: &'a Path,
    /// Surface of the skin.
    pub skin: &'a Path,
    /// JSON with the Le Fort I plane, the midline and the occlusal plane.
    pub landmarks: &'a Path,
    /// Where the rows go; the chart gets the same name with `.svg`.
    pub csv: &'a Path,
}

/// Time and memory of one detection method.
struct Measured {
    method: String,
    tolerance: Option<f64>,
    build_s: f64,
    /// Time per position for all points, on one thread and on all threads, ms.
    one_thread_ms: f64,
    all_threads_ms: f64,
    /// Number of points inside the bone, summed over all positions.
    hits: usize,
    /// Memory of the field, MB.
    memory_mb: Option<f64>,
}

/// Required members of the landmarks file.
#[derive(Deserialize)]
struct Landmarks {
    midline_x_mm: f64,
    occlusal_plane_z_mm: f64,
    le_fort_1_plane: Plane,
}

#[derive(Deserialize)]
struct Plane {
    point: [f64; 3],
    normal: [f64; 3],
}

impl CollisionStudy<'_> {
    /// The surface of the moving segment and the test points, both at rest.
    fn scene(&self) -> Result<(TriMesh, Vec<Point>), BenchError> {
        let landmarks: Landmarks = serde_json::from_slice(&read(self.landmarks)?)
            .map_err(|e| BenchError::Landmarks { path: self.landmarks.to_owned(), detail: e.to_string() })?;
        let (skin, skull) = (read_surface(self.skin)?, read_surface(self.skull)?);
        let anatomy = Anatomy { skin, skull, air: None, soft_tissue: None, landmarks: Vec::new(), midline_x_mm: None };
        let (control, settings) = (Control::new(), FieldsSettings::default());
        let fields = build_fields(&anatomy, &settings, &control)?;
        let plane = &landmarks.le_fort_1_plane;
        let plane = (Point::from(plane.point), Vector::from(plane.normal));
        let cuts = le_fort_1(plane, landmarks.midline_x_mm, landmarks.occlusal_plane_z_mm, [None; 2], &fields.bone);
        let bone = cut_bone(&fields.bone, &cuts, &settings.field, &control)?;
        let moved = bone.osteotomy.segments.iter().filter(|s| s.id != 0);
        let moved = moved.max_by(|a, b| a.volume_mm3.total_cmp(&b.volume_mm3)).ok_or_else(|| {
            BenchError::Landmarks { path: self.landmarks.to_owned(), detail: "no moving segment".to_owned() }
        })?;
        let tissue = build_tissue(&anatomy, &fields, Some(&bone), &TissueSettings::default(), &control)?;
        Ok((moved.surface.clone(), inner_points(&tissue.mesh)))
    }

    /// Runs the study; prints to `out`.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let (bone, points) = self.scene()?;
        writeln!(
            out,
            "{} points (vertices and barycentres), a segment of {} triangles, {POSITIONS} positions, \
             {FORWARD_MM} mm forward and {DOWN_MM} mm down",
            points.len(),
            bone.triangles().len()
        )?;
        let mut all =
            vec![by_hierarchy(&bone, &points, Sign::Pseudonormals)?, by_hierarchy(&bone, &points, Sign::None)?];
        all.push(by_own_hierarchy(&bone, &points));
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

/// Vertices and barycentres of the tissue faces that are turned to bone.
fn inner_points(tissue: &MixedMesh) -> Vec<Point> {
    let corner = |v: &u32| tissue.positions[*v as usize];
    let mut nodes: Vec<u32> = tissue.bone_faces.iter().flatten().copied().collect();
    nodes.sort_unstable();
    nodes.dedup();
    let barycentres = tissue.bone_faces.iter().map(|[a, b, c]| {
        let (a, b, c) = (corner(a), corner(b), corner(c));
        a + ((b - a) + (c - a)) / 3.0
    });
    nodes.iter().map(corner).chain(barycentres).collect()
}

/// The bone's motion at each position: forward is -y, down is -z.
fn path() -> Vec<Motion> {
    let at = |n: usize| (n + 1) as f64 / POSITIONS as f64;
    (0..POSITIONS).map(|n| Motion::translation(0.0, -FORWARD_MM * at(n), -DOWN_MM * at(n))).collect()
}

/// Mean time per position on one thread and on all threads, ms (best of all rounds), and the number of hits.
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
        field: FieldSettings { spacing_mm: SPACING_MM, band_mm: BAND_MM, margin_mm: BAND_MM },
        resolution: None,
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

/// Whether a closest point comes with the side of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sign {
    None,
    Pseudonormals,
}

/// Detection without a field: closest point by parry's bounding volume hierarchy.
fn by_hierarchy(bone: &TriMesh, points: &[Point], sign: Sign) -> Result<Measured, BenchError> {
    let start = Instant::now();
    let vertices = bone.positions().iter().map(|p| ParryVector::new(p.x, p.y, p.z)).collect();
    let (flags, method) = match sign {
        Sign::None => (TriMeshFlags::empty(), "closest point, unsigned (parry3d)"),
        Sign::Pseudonormals => (TriMeshFlags::ORIENTED, "closest point (parry3d)"),
    };
    let shape = Shape::with_flags(vertices, bone.triangles().to_vec(), flags)
        .map_err(|e| BenchError::Hierarchy { detail: e.to_string() })?;
    let build_s = start.elapsed().as_secs_f64();
    let (one_thread_ms, all_threads_ms, hits) = detect(points, |p| {
        let q = shape.project_local_point(ParryVector::new(p.x, p.y, p.z), false);
        let towards = Vector::new(q.point.x - p.x, q.point.y - p.y, q.point.z - p.z);
        std::hint::black_box(towards.norm());
        q.is_inside
    });
    Ok(Measured {
        method: method.to_owned(),
        tolerance: None,
        build_s,
        one_thread_ms,
        all_threads_ms,
        hits,
        memory_mb: None,
    })
}

/// The same by our own hierarchy, which the distance fields are built with. It has no sign.
fn by_own_hierarchy(bone: &TriMesh, points: &[Point]) -> Measured {
    let start = Instant::now();
    let exact = ExactDistance::new(bone);
    let build_s = start.elapsed().as_secs_f64();
    let (one_thread_ms, all_threads_ms, hits) = detect(points, |p| std::hint::black_box(exact.closest(p)).2 < 0.0);
    let memory_mb = Some(exact.bytes() as f64 * 1e-6);
    let method = "closest point, unsigned (ours)".to_owned();
    Measured { method, tolerance: None, build_s, one_thread_ms, all_threads_ms, hits, memory_mb }
}

/// Chart of time against tolerance; a method without a tolerance is a horizontal line.
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
            None => curves.push(Curve { name: m.method.clone(), color, points, marks: Vec::new() }),
        }
    }
    let labels = Labels {
        title: "Time of one collision detection against the octree's tolerance (0.8 mm, one thread)",
        x: "tolerance relative to the edge of the bounding cube",
        y: "one detection, ms",
    };
    chart::draw(&labels, &curves)
}
