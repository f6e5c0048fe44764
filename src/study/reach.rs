use std::io::Write;
use std::path::Path;

use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource};
use super::model_case::{ModelCase, ModelTiming, solved};
use prosopon_planning::simulate::LEAVE_OUT_BELOW_MM;
use prosopon_tissue::fem::{Locking, Model};

/// Thresholds of the displacement below which tissue is left out, mm.
const BELOW_MM: [f64; 5] = [0.01, 0.02, LEAVE_OUT_BELOW_MM, 0.1, 0.2];

/// Measures the time saved and the error made by leaving out tissue that a plan hardly moves.
///
/// The scene is that of `bench models` with the model `mixed`, solved on one mesh in one process, first with all tissue and
/// then with less and less of it.
#[derive(Debug)]
pub struct ReachStudy<'a> {
    /// The head.
    pub source: &'a HeadSource,
    /// Edge length of the mesh, mm.
    pub edge_mm: f64,
    /// CSV file to write.
    pub csv: &'a Path,
}

impl ReachStudy<'_> {
    /// Runs the study, prints a line per threshold and writes the rows.
    ///
    /// Errors are distances from the skin that was solved with all tissue, over the vertices that lie on the mesh.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let head = Head::load(self.source)?;
        let ready = head.prepare(self.edge_mm)?;
        let case = ModelCase { model: Model::Mixed, locking: Locking::None, edge_mm: self.edge_mm };
        let (whole, reference) = solved(&head, &ready, &case, 0.0)?;
        let mut text =
            "below_mm,unknowns,unknowns_kept,solve_s,first_frame_s,cpu_s,peak_mb,mean_mm,p99_mm,largest_mm,border_mm\n"
                .to_owned();
        let mut row = |below_mm: f64, timing: &ModelTiming, off: [f64; 3]| {
            let kept = timing.unknowns as f64 / whole.unknowns as f64;
            let number = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.1}"));
            let (cpu, peak) = (number(timing.cpu_s), number(timing.peak_mb));
            text += &format!(
                "{below_mm},{},{kept:.3},{:.2},{:.2},{cpu},{peak},{:.4},{:.4},{:.4},{:.3}\n",
                timing.unknowns, timing.solve_s, timing.first_frame_s, off[0], off[1], off[2], timing.border_mm
            );
            writeln!(
                out,
                "threshold {below_mm} mm: {} unknowns ({:.0} %), first frame {:.1} s, path {:.1} s (processor {cpu} s), \
                 skin error: mean {:.3} mm, P99 {:.3} mm, max {:.3} mm; beside what is left out tissue moves \
                 by {:.2} mm",
                timing.unknowns,
                100.0 * kept,
                timing.first_frame_s,
                timing.solve_s,
                off[0],
                off[1],
                off[2],
                timing.border_mm
            )
        };
        row(0.0, &whole, [0.0; 3])?;
        for below_mm in BELOW_MM {
            let (timing, moved) = solved(&head, &ready, &case, below_mm)?;
            row(below_mm, &timing, distances(&reference, &moved))?;
        }
        write(self.csv, text.as_bytes())
    }
}

/// Mean, P99 and largest distance between two lists of displacements (x, y, z of each vertex), mm.
pub(super) fn distances(a: &[f64], b: &[f64]) -> [f64; 3] {
    let vertices = a.as_chunks::<3>().0.iter().zip(b.as_chunks::<3>().0);
    let distance = |(p, q): (&[f64; 3], &[f64; 3])| (0..3).map(|i| (p[i] - q[i]).powi(2)).sum::<f64>().sqrt();
    let mut all: Vec<f64> = vertices.map(distance).filter(|d| d.is_finite()).collect();
    all.sort_by(f64::total_cmp);
    let last = all.len().saturating_sub(1);
    let at = |share: f64| all.get((share * last as f64) as usize).copied().unwrap_or(f64::NAN);
    [all.iter().sum::<f64>() / all.len() as f64, at(0.99), at(1.0)]
}
