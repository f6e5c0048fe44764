use std::io::Write;
use std::path::Path;
use std::process::Command;

use plotters::style::RGBColor;

use super::chart::{self, Curve, Labels};
use super::error::{BenchError, read, write};
use super::files::{Scratch, read_distances, refuse_unwritable};
use super::head::{Head, HeadSource};
use super::model_case::{Measured, ModelCase, ModelTiming, PHASES, locking_name, model_name};
use prosopon_geometry::Vector;
use prosopon_planning::evaluate::{Statistics, statistics};
use prosopon_tissue::fem::{Locking, Model};

/// Models of the study by increasing memory, with the colours of their curves (Okabe and Ito).
const VARIANTS: [(Model, Locking, RGBColor); 8] = [
    (Model::MassTensor, Locking::None, RGBColor(86, 180, 233)),
    (Model::Linear, Locking::None, RGBColor(230, 159, 0)),
    (Model::Nonlinear, Locking::None, RGBColor(0, 158, 115)),
    (Model::Mixed, Locking::None, RGBColor(0, 114, 178)),
    (Model::Nonlinear, Locking::Patched, RGBColor(0, 0, 0)),
    (Model::Mixed, Locking::Patched, RGBColor(120, 120, 120)),
    (Model::Nonlinear, Locking::Smoothed, RGBColor(204, 121, 167)),
    (Model::Mixed, Locking::Smoothed, RGBColor(213, 94, 0)),
];

/// Measures time and error of every model on several meshes of one head, against the best model on a finer mesh.
///
/// The cases of each mesh run in a separate process, in order of increasing memory. The error at a skin vertex is the length
/// of the difference between its displacement and that of the reference, mm. Only vertices count that are in a region of the
/// face and lie on a prism of every mesh.
#[derive(Debug)]
pub struct ModelStudy<'a> {
    /// The head.
    pub source: &'a HeadSource,
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
    /// Edge lengths of the meshes, mm.
    pub edges_mm: &'a [f64],
    /// Edge length of the reference mesh, mm; must be smaller than all others.
    pub reference_mm: f64,
}

/// A case with its measurement and the displacements of the skin.
struct Solved {
    case: ModelCase,
    timing: ModelTiming,
    moved: Vec<Vector>,
}

/// A row of the table.
struct Row {
    case: ModelCase,
    timing: ModelTiming,
    error: Statistics,
}

impl ModelStudy<'_> {
    /// Runs the study; prints to `out`.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let finest = self.edges_mm.iter().copied().fold(f64::INFINITY, f64::min);
        if self.edges_mm.is_empty() || self.reference_mm.is_nan() || self.reference_mm >= finest {
            let detail = format!("--reference-mm is {} mm: it must be smaller than all --edges-mm", self.reference_mm);
            return Err(BenchError::Head { detail });
        }
        let head = Head::load(self.source)?;
        let scratch = Scratch::new()?;
        let reference = ModelCase { model: Model::Mixed, locking: Locking::Smoothed, edge_mm: self.reference_mm };
        let (mut reference, refused) = self.measure(&[reference], &scratch, out)?;
        let Some(reference) = reference.pop() else {
            let detail = refused.into_iter().map(|r| r.1).collect();
            return Err(BenchError::Row { case: "the reference".to_owned(), detail });
        };
        let (mut solved, mut refused) = (Vec::new(), Vec::new());
        for &edge_mm in self.edges_mm {
            let cases = VARIANTS.map(|(model, locking, _)| ModelCase { model, locking, edge_mm });
            let (found, not) = self.measure(&cases, &scratch, out)?;
            solved.extend(found);
            refused.extend(not);
        }
        let rows = self.compare(&head, &reference, solved)?;
        let mut text = format!("{}\n", columns());
        rows.iter().for_each(|row| text += &format!("{}\n", row.csv(self.source, false)));
        text += &format!(
            "{}\n",
            Row { case: reference.case, timing: reference.timing, error: zero() }.csv(self.source, true)
        );
        for (case, detail) in refused {
            text += &format!(
                "{},{},refused: {}\n",
                self.source.name(),
                case.word().replace(':', ","),
                detail.replace([',', '\n'], ";")
            );
        }
        write(self.csv, text.as_bytes())?;
        write!(out, "\n{}", table(&rows))?;
        let svg = self.csv.with_extension("svg");
        write(&svg, self.chart(&rows)?.as_bytes())?;
        writeln!(out, "wrote {} and {}", self.csv.display(), svg.display())?;
        Ok(())
    }

    /// Runs the cases of one mesh in one process; returns the solved cases, and the others with the reason.
    fn measure(
        &self,
        cases: &[ModelCase],
        scratch: &Scratch,
        out: &mut dyn Write,
    ) -> Result<(Vec<Solved>, Vec<(ModelCase, String)>), BenchError> {
        let words: Vec<String> = cases.iter().map(ModelCase::word).collect();
        let failed = |detail: String| BenchError::Row { case: words.join(","), detail };
        let (values, timing) = (scratch.path("moved.bin"), scratch.path("timing.json"));
        let mut program = Command::new(std::env::current_exe().map_err(|e| failed(e.to_string()))?);
        program.args(["bench", "models", "--scene", &self.source.word(), "--cases", &words.join(",")]);
        program.arg("--out").arg(&values).arg("--timing").arg(&timing);
        let done = program.output().map_err(|e| failed(e.to_string()))?;
        if !done.status.success() {
            // A mesh that cannot be built counts as a refusal of all its cases; the study continues with the other meshes.
            let detail = String::from_utf8_lossy(&done.stderr).trim().to_owned();
            writeln!(out, "{}: refused: {detail}", words.join(","))?;
            return Ok((Vec::new(), cases.iter().map(|case| (*case, detail.clone())).collect()));
        }
        let timings: Vec<Measured> = serde_json::from_slice(&read(&timing)?).map_err(|e| failed(e.to_string()))?;
        let (mut solved, mut refused) = (Vec::new(), Vec::new());
        for (n, (&case, timing)) in cases.iter().zip(timings).enumerate() {
            match timing {
                Ok(timing) => {
                    writeln!(out, "{}: {}", case.word(), describe(&timing))?;
                    let moved = read_distances(&values.with_extension(n.to_string()))?;
                    let moved = moved.as_chunks::<3>().0.iter().map(|&u| Vector::from(u)).collect();
                    solved.push(Solved { case, timing, moved });
                }
                Err(detail) => {
                    writeln!(out, "{}: refused: {detail}", case.word())?;
                    refused.push((case, detail));
                }
            }
        }
        Ok((solved, refused))
    }

    fn compare(&self, head: &Head, reference: &Solved, solved: Vec<Solved>) -> Result<Vec<Row>, BenchError> {
        let skin = &head.anatomy.skin;
        let mut chosen = head.face();
        for case in solved.iter().chain([reference]) {
            if case.moved.len() != chosen.len() {
                let detail = format!("{} displacements for {} vertices", case.moved.len(), chosen.len());
                return Err(BenchError::Row { case: case.case.word(), detail });
            }
            chosen.iter_mut().zip(&case.moved).for_each(|(chosen, u)| *chosen &= u.iter().all(|c| c.is_finite()));
        }
        let row = |case: Solved| {
            let errors: Vec<f32> =
                case.moved.iter().zip(&reference.moved).map(|(u, r)| (u - r).norm() as f32).collect();
            let error = statistics(skin, &errors, Some(&chosen)).ok_or_else(|| BenchError::Row {
                case: case.case.word(),
                detail: "no vertex of the face lies on a prism of every mesh".to_owned(),
            })?;
            Ok(Row { case: case.case, timing: case.timing, error })
        };
        solved.into_iter().map(row).collect()
    }

    fn chart(&self, rows: &[Row]) -> Result<String, BenchError> {
        let curves = VARIANTS.iter().map(|&(model, locking, color)| {
            let own = rows.iter().filter(|r| r.case.model == model && r.case.locking == locking);
            let (points, marks) = own
                .map(|r| {
                    ((r.error.mean_abs, r.timing.cpu_s.unwrap_or(r.timing.solve_s)), format!("{}", r.case.edge_mm))
                })
                .unzip();
            Curve { name: variant_name(model, locking), color, points, marks }
        });
        let title =
            format!("Le Fort I on the {} (reference: mixed, smoothed, {} mm)", self.source.name(), self.reference_mm);
        let labels = Labels {
            title: &title,
            x: "mean error over the face, mm (labels: edge length of the mesh, mm)",
            y: "processor time of the solve with 6 steps, s",
        };
        chart::draw(&labels, &curves.collect::<Vec<_>>())
    }
}

fn variant_name(model: Model, locking: Locking) -> String {
    match locking {
        Locking::None => model_name(model).to_owned(),
        Locking::Smoothed | Locking::Patched => format!("{}, {}", model_name(model), locking_name(locking)),
    }
}

fn describe(t: &ModelTiming) -> String {
    format!(
        "{} tetrahedra, {} prisms, {} unknowns, {} after {} iterations, solved in {:.2} s",
        t.tetrahedra, t.prisms, t.unknowns, t.outcome, t.newton_iterations, t.solve_s
    )
}

fn columns() -> String {
    let phases = PHASES.join(",");
    format!(
        "scene,model,locking,edge_mm,outcome,tetrahedra,prisms,unknowns,newton_iterations,factorisations,max_penetration_mm,prepare_s,solve_s,cpu_s,first_frame_s,{phases},other_s,peak_mb,points,mean_error_mm,p95_error_mm,max_error_mm"
    )
}

/// Error of the reference itself.
fn zero() -> Statistics {
    Statistics {
        count: 0,
        mean: 0.0,
        mean_abs: 0.0,
        rms: 0.0,
        p50: 0.0,
        p90: 0.0,
        p95: 0.0,
        max: 0.0,
        l2_norm: 0.0,
        variance: 0.0,
        share_below: [1.0; 3],
    }
}

impl Row {
    fn csv(&self, source: &HeadSource, is_reference: bool) -> String {
        let (t, e) = (&self.timing, &self.error);
        let phases: Vec<String> = t.phases_s.iter().map(|s| format!("{s:.3}")).collect();
        let other_s = t.solve_s - t.phases_s.iter().sum::<f64>();
        let error = if is_reference {
            "reference,,,".to_owned()
        } else {
            format!("{},{:.5},{:.5},{:.5}", e.count, e.mean_abs, e.p95, e.max)
        };
        format!(
            "{},{},{},{},{},{},{},{},{},{},{:.4},{:.3},{:.3},{},{:.3},{},{other_s:.3},{},{error}",
            source.name(),
            model_name(self.case.model),
            locking_name(self.case.locking),
            self.case.edge_mm,
            t.outcome,
            t.tetrahedra,
            t.prisms,
            t.unknowns,
            t.newton_iterations,
            t.factorisations,
            t.max_penetration_mm,
            t.prepare_s,
            t.solve_s,
            t.cpu_s.map_or(String::new(), |s| format!("{s:.2}")),
            t.first_frame_s,
            phases.join(","),
            t.peak_mb.map_or(String::new(), |mb| format!("{mb:.0}")),
        )
    }
}

/// The rows as an aligned table.
fn table(rows: &[Row]) -> String {
    let mut text = String::from(
        "model                  h mm   tetra. prisms unknowns  solve s  CPU s (setup tangent factor triang. residual contact search) peak MB   mean    P95    max mm\n",
    );
    for r in rows {
        let t = &r.timing;
        let phases: Vec<String> = t.phases_s.iter().map(|s| format!("{s:6.2}")).collect();
        text += &format!(
            "{:<21} {:>5} {:>8} {:>6} {:>8} {:>8.2} {:>6.1} ({}) {:>6.0} {:>8.4} {:>6.3} {:>6.3}\n",
            variant_name(r.case.model, r.case.locking),
            r.case.edge_mm,
            t.tetrahedra,
            t.prisms,
            t.unknowns,
            t.solve_s,
            t.cpu_s.unwrap_or_default(),
            phases.join(" "),
            t.peak_mb.unwrap_or_default(),
            r.error.mean_abs,
            r.error.p95,
            r.error.max
        );
    }
    text
}
