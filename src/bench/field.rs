use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use rayon::prelude::*;

use super::chart;
use super::error::{BenchError, read, write};
use super::evaluate::Timing;
use super::files::{read_distances, read_surface, write_points};
use super::row::{COLUMNS, Case, Grid, Row, TABLE_3, table_3};
use super::winding::ProvenWinding;
use crate::control::{Cancelled, Control};
use crate::field::{Accuracy, ExactDistance, Method, Place, sample_points};
use crate::geometry::Point;

/// Half-width of the band, and margin of the grid beyond the surface, mm.
const BAND_MM: f64 = 5.0;
/// Sites of the test points.
const SITES: usize = 100_000;

/// Measures every builder on one surface.
#[derive(Debug)]
pub struct FieldStudy<'a> {
    /// Surface file.
    pub mesh: &'a Path,
    /// Where the rows go; the charts get the same name and `-memory.svg`, `-time.svg`.
    pub csv: &'a Path,
    /// All settings of the paper's Table 3, not just the coarser ones.
    pub full: bool,
}

/// A test point and its exact signed distance, mm.
struct Probe {
    place: Place,
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
        let probes = self.probes()?;
        writeln!(out, "{}", describe(&probes))?;
        let scratch = Scratch::new()?;
        let points = scratch.path("points.bin");
        write_points(&points, probes.iter().map(|p| &p.point))?;
        let mut csv = format!("{COLUMNS}\n");
        let mut rows = Vec::new();
        writeln!(out, "{COLUMNS}")?;
        for case in cases(self.full) {
            let row = self.measure(case, &probes, &points, &scratch)?;
            writeln!(out, "{}", row.csv())?;
            csv += &row.csv();
            csv.push('\n');
            rows.push(row);
            // After each row, so that an interrupted study leaves something.
            write(self.csv, csv.as_bytes())?;
        }
        writeln!(out, "\n{}", table_3(&rows))?;
        let beside = |end: &str| {
            let stem = self.csv.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            self.csv.with_file_name(format!("{stem}-{end}.svg"))
        };
        for (path, svg) in [(beside("memory"), chart::memory(&rows)?), (beside("time"), chart::time(&rows)?)] {
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
        let mut program = Command::new(std::env::current_exe().map_err(|e| failed(e.to_string()))?);
        program.args(["bench", "field", "--method", case.method.name()]);
        program.arg("--mesh").arg(self.mesh).arg("--points").arg(points);
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
fn cases(full: bool) -> Vec<Case> {
    let mut cases: Vec<Case> =
        [0.8, 0.4].map(|h| Case { method: Method::Adaptive, grid: Grid::Spacing(h), tolerance: None }).to_vec();
    let settings = TABLE_3.iter().map(|(grid, tolerance, _)| (*grid, *tolerance));
    let settings: Vec<(u32, f64)> = settings.filter(|(_, t)| full || *t > 2e-6).collect();
    let mut grids: Vec<u32> = settings.iter().map(|s| s.0).collect();
    grids.dedup();
    cases.extend(grids.iter().map(|&n| Case { method: Method::Uniform, grid: Grid::Cells(n), tolerance: None }));
    for method in [Method::Hybrid, Method::Frisken] {
        cases.extend(settings.iter().map(|&(n, t)| Case { method, grid: Grid::Cells(n), tolerance: Some(t) }));
    }
    cases
}

fn describe(probes: &[Probe]) -> String {
    let count = |place| probes.iter().filter(|p| p.place == place).count();
    let clear = probes.iter().filter(|p| p.distance.abs() > 1e-3).count();
    format!(
        "{} test points: {} in the band of {BAND_MM} mm, {} on faces, {} on edges, {} on the medial axis; errors against exact closest\n\
         points in f64 with the sign of the winding number (full sum or a truncation that is proven not to matter); signs counted at the\n\
         {clear} points more than 0.001 mm off the surface. Query: value and gradient, one thread. Builds below 1 s: best of three.",
        probes.len(),
        count(Place::Band),
        count(Place::Face),
        count(Place::Edge),
        count(Place::MedialAxis),
    )
}

/// A directory that goes when this goes.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Self, BenchError> {
        let path = std::env::temp_dir().join(format!("prosopon-bench-{}", std::process::id()));
        fs::create_dir_all(&path).map_err(|source| BenchError::File { what: "make", path: path.clone(), source })?;
        Ok(Self(path))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        fs::remove_dir_all(&self.0).ok();
    }
}
