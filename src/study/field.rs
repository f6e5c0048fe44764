use std::io::Write;
use std::path::Path;
use std::process::Command;

use rayon::prelude::*;

use super::chart;
use super::error::{BenchError, read, write};
use super::evaluate::Timing;
use super::files::{Scratch, read_distances, read_surface, refuse_unwritable, write_points, write_triangles};
use super::row::{Builder, COLUMNS, Case, Grid, Row, TABLE_3, against_openvdb, table_3};
use super::winding::ProvenWinding;
use prosopon_field::{Accuracy, ExactDistance, Method, SampleKind, sample_points};
use prosopon_geometry::Point;
use prosopon_geometry::control::{Cancelled, Control};

/// Half-width of the band, and margin of the grid beyond the surface, mm.
const BAND_MM: f64 = 5.0;
/// Sites of the test points.
const SITES: usize = 100_000;

/// Measures every builder on one surface.
#[derive(Debug)]
pub struct FieldStudy<'a> {
    /// Surface file.
    pub mesh: &'a Path,
    /// Where the rows go; the charts get the same name and `-memory.svg`, `-time.svg`, and so on.
    pub csv: &'a Path,
    /// All settings of the paper's Table 3, not just the coarser ones.
    pub full: bool,
    /// A program that builds a level set with OpenVDB (`tests/bench/openvdb.cpp`), to be measured beside the builders.
    pub openvdb: Option<&'a Path>,
}

/// A test point and its exact signed distance, mm.
struct Probe {
    place: SampleKind,
    point: Point,
    distance: f64,
}

impl FieldStudy<'_> {
    /// Runs the study; prints to `out`.
    ///
    /// Each case runs as a program of its own (this one, as `bench field --points`), so that memory is not shared.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let probes = self.probes()?;
        writeln!(out, "{}", describe(&probes))?;
        let scratch = Scratch::new()?;
        let points = scratch.path("points.bin");
        if self.openvdb.is_some() {
            write_triangles(&scratch.path("mesh.bin"), &read_surface(self.mesh)?)?;
        }
        write_points(&points, probes.iter().map(|p| &p.point))?;
        let mut csv = format!("{COLUMNS}\n");
        let mut rows: Vec<Row> = Vec::new();
        writeln!(out, "{COLUMNS}")?;
        for case in cases(self.full, self.openvdb.is_some()) {
            let row = self.measure(case, &probes, &points, &scratch)?;
            writeln!(out, "{}", row.csv())?;
            csv += &row.csv();
            csv.push('\n');
            rows.push(row);
            // After each row, so that an interrupted study leaves something.
            write(self.csv, csv.as_bytes())?;
        }
        writeln!(out, "\n{}", table_3(&rows))?;
        for (spacing, times) in against_openvdb(&rows) {
            writeln!(out, "adaptive at {spacing} mm: built {times:.1} times faster than OpenVDB's level set")?;
        }
        let beside = |end: &str| {
            let stem = self.csv.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            self.csv.with_file_name(format!("{stem}-{end}.svg"))
        };
        for (name, svg) in chart::of_fields(&rows)? {
            let path = beside(name);
            write(&path, svg.as_bytes())?;
            writeln!(out, "wrote {}", path.display())?;
        }
        writeln!(out, "wrote {}", self.csv.display())?;
        Ok(())
    }

    fn probes(&self) -> Result<Vec<Probe>, BenchError> {
        let surface = read_surface(self.mesh)?;
        let exact = ExactDistance::new(&surface);
        let winding = ProvenWinding::new(&surface);
        let control = Control::new();
        let points = sample_points(&surface, &exact, BAND_MM, SITES, &control)?;
        let probes = points
            .into_par_iter()
            .map(|(place, point)| {
                control.check()?;
                let distance = exact.closest(&point).2;
                let distance = if winding.is_inside(&point) { -distance } else { distance };
                Ok(Probe { place, point, distance })
            })
            .collect::<Result<Vec<_>, Cancelled>>()?;
        Ok(probes)
    }

    fn measure(&self, case: Case, probes: &[Probe], points: &Path, scratch: &Scratch) -> Result<Row, BenchError> {
        let failed = |detail: String| BenchError::Row { case: case.label(), detail };
        let (values, timing) = (scratch.path("values.bin"), scratch.path("timing.json"));
        let (mut program, mesh) = match (case.builder, self.openvdb) {
            (Builder::OpenVdb, Some(openvdb)) => (Command::new(openvdb), scratch.path("mesh.bin")),
            (builder, _) => {
                let mut program = Command::new(std::env::current_exe().map_err(|e| failed(e.to_string()))?);
                program.args(["bench", "field", "--method", builder.name()]);
                (program, self.mesh.to_owned())
            }
        };
        program.arg("--mesh").arg(mesh).arg("--points").arg(points);
        program.arg("--out").arg(&values).arg("--timing").arg(&timing);
        program.args(["--band-mm", &BAND_MM.to_string(), "--margin-mm", &BAND_MM.to_string()]);
        match case.grid {
            Grid::Cells(n) => program.args(["--resolution", &n.to_string()]),
            Grid::Spacing(h) => program.args(["--spacing-mm", &h.to_string()]),
        };
        if let Some(tolerance) = case.tolerance {
            program.args(["--tolerance", &tolerance.to_string()]);
        }
        let done = program.output().map_err(|e| failed(e.to_string()))?;
        if !done.status.success() {
            return Err(failed(String::from_utf8_lossy(&done.stderr).trim().to_owned()));
        }
        let timing: Timing = serde_json::from_slice(&read(&timing)?).map_err(|e| failed(e.to_string()))?;
        let values = read_distances(&values)?;
        if values.len() != probes.len() || values.iter().any(|v| !v.is_finite()) {
            return Err(failed(format!("{} distances for {} points, or not finite", values.len(), probes.len())));
        }
        let accuracy = Accuracy::of(probes.iter().zip(&values).map(|(p, &v)| (p.place, v, p.distance)));
        Ok(Row { case, timing, accuracy })
    }
}

/// The settings in the order of the paper's table.
fn cases(full: bool, openvdb: bool) -> Vec<Case> {
    let at = |builder, h| Case { builder, grid: Grid::Spacing(h), tolerance: None };
    let mut cases: Vec<Case> = [0.8, 0.4].map(|h| at(Builder::Ours(Method::Adaptive), h)).to_vec();
    if openvdb {
        cases.extend([0.8, 0.4].map(|h| at(Builder::OpenVdb, h)));
    }
    let settings = TABLE_3.iter().map(|(grid, tolerance, _)| (*grid, *tolerance));
    let settings: Vec<(u32, f64)> = settings.filter(|(_, t)| full || *t > 2e-6).collect();
    let mut grids: Vec<u32> = settings.iter().map(|s| s.0).collect();
    grids.dedup();
    let uniform = Builder::Ours(Method::Uniform);
    cases.extend(grids.iter().map(|&n| Case { builder: uniform, grid: Grid::Cells(n), tolerance: None }));
    for builder in [Method::Hybrid, Method::Frisken].map(Builder::Ours) {
        cases.extend(settings.iter().map(|&(n, t)| Case { builder, grid: Grid::Cells(n), tolerance: Some(t) }));
    }
    cases
}

fn describe(probes: &[Probe]) -> String {
    let count = |place| probes.iter().filter(|p| p.place == place).count();
    let clear = probes.iter().filter(|p| p.distance.abs() > 1e-3).count();
    format!(
        "{} test points: {} in the band of {BAND_MM} mm, {} on faces, {} on edges, {} on the medial axis; errors against exact closest\n\
         points in f64 with the sign of the winding number (full sum or a truncation that is proven not to matter); signs counted at the\n\
         {clear} points more than 0.001 mm off the surface. Query: value and gradient (OpenVDB: value alone), then with Hessian, one thread.\n\
         Builds below 1 s: best of three.",
        probes.len(),
        count(SampleKind::Band),
        count(SampleKind::Face),
        count(SampleKind::Edge),
        count(SampleKind::MedialAxis),
    )
}
