use std::io::Write;
use std::path::Path;

use super::cell::{Cell, Verdict, cell};
use super::method::METHODS;
use super::{map, scenes};
use crate::error::{BenchError, write};
use crate::files::refuse_unwritable;

/// Solves every hard scene by every method and checks each result.
///
/// The reference is a closed form, an equivalent scene with finer steps and a tighter tolerance, the other linear model, or
/// a finer mesh.
#[derive(Debug)]
pub struct StabilityStudy<'a> {
    /// CSV file to write; the map has the same name with `.svg`.
    pub csv: &'a Path,
    /// Run only scenes whose name contains this text.
    pub only: Option<&'a str>,
}

impl StabilityStudy<'_> {
    /// Runs the study and prints to `out`; returns whether no result is wrong without a warning.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<bool, BenchError> {
        refuse_unwritable(self.csv)?;
        let mut csv = String::from("scene,method,verdict,error_mm,model_error_mm,allowed_mm,in_short,detail\n");
        let mut rows: Vec<(String, Vec<Cell>)> = Vec::new();
        for scene in scenes::all()?.iter().filter(|s| self.only.is_none_or(|part| s.name.contains(part))) {
            let mut cells = Vec::new();
            for method in METHODS {
                let cell = cell(scene, method);
                writeln!(
                    out,
                    "{}, {}: {}, {} {}",
                    scene.name,
                    method.name,
                    cell.verdict.name(),
                    cell.short,
                    cell.detail
                )?;
                csv += &row(&scene.name, method.name, scene.within_mm, &cell);
                cells.push(cell);
                write(self.csv, csv.as_bytes())?;
            }
            rows.push((scene.name.clone(), cells));
        }
        let count = |verdict| rows.iter().flat_map(|r| &r.1).filter(|c| c.verdict == verdict).count();
        for verdict in [Verdict::Converged, Verdict::Helped, Verdict::Warned, Verdict::Refused, Verdict::Wrong] {
            writeln!(out, "{}: {}", verdict.name(), count(verdict))?;
        }
        let svg = self.csv.with_extension("svg");
        write(&svg, map::draw(&rows)?.as_bytes())?;
        writeln!(out, "wrote {} and {}", self.csv.display(), svg.display())?;
        Ok(count(Verdict::Wrong) == 0)
    }
}

fn row(scene: &str, method: &str, within_mm: f64, cell: &Cell) -> String {
    let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.6}"));
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "'"));
    format!(
        "{},{method},{},{},{},{within_mm},{},{}\n",
        quoted(scene),
        cell.verdict.name(),
        number(cell.error_mm),
        number(cell.model_error_mm),
        quoted(&cell.short),
        quoted(&cell.detail)
    )
}
