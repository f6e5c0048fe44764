use std::io::Write;
use std::path::Path;
use std::process::Command;

use plotters::style::RGBColor;

use super::chart::{Curve, Labels};
use super::error::{BenchError, read, write};
use super::files::{Scratch, read_distances, refuse_unwritable};
use super::head::{Head, HeadSource};
use super::model_case::{Measured, ModelCase, ModelTiming, PHASES, STEPS, locking_name, model_name};
use super::pareto_chart::{self, Panel};
use prosopon_geometry::Vector;
use prosopon_planning::evaluate::{Statistics, between_solutions, face_regions};
use prosopon_planning::simulate::budget::{Demand, Grounds, Limits, choose};
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

/// Errors that are asked of `auto`, mm.
const ASKED_MM: [f64; 4] = [0.3, 0.1, 0.05, 0.02];

/// Measures time and error of every model on several meshes of heads, against `mixed` with patched elements on a finer mesh.
///
/// The cases of each mesh run in a separate process, in order of increasing memory. The error at a skin vertex is the length
/// of the difference between its displacement and that of the reference, mm. Only vertices count that are in a region of the
/// face, move, and lie on a prism of every mesh.
#[derive(Debug)]
pub struct ModelStudy<'a> {
    /// The heads.
    pub sources: &'a [HeadSource],
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
    /// Edge lengths of the meshes, mm.
    pub edges_mm: &'a [f64],
    /// Edge length of the reference mesh, mm; must be smaller than all others.
    pub reference_mm: f64,
    /// Names and times, s, of lines in the chart; a name `SCENE: NAME` is drawn for that scene only.
    pub lines: &'a [(String, f64)],
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
        let (mut text, mut panels) = (format!("{}\n", columns()), Vec::new());
        for source in self.sources {
            let (rows, lines) = self.scene(source, out)?;
            text += &lines;
            write(self.csv, text.as_bytes())?;
            write!(out, "\n{}:\n{}", source.name(), table(&rows))?;
            panels.push(Panel { lines: self.lines_of(&source.name()), ..panel(source, &rows) });
        }
        let svg = self.csv.with_extension("svg");
        write(&svg, self.chart(&panels)?.as_bytes())?;
        writeln!(out, "wrote {} and {}", self.csv.display(), svg.display())?;
        Ok(())
    }

    /// The rows of one head, and all its lines of the CSV file.
    fn scene(&self, source: &HeadSource, out: &mut dyn Write) -> Result<(Vec<Row>, String), BenchError> {
        let head = Head::load(source)?;
        let scratch = Scratch::new()?;
        let reference = ModelCase { model: Model::Mixed, locking: Locking::Patched, edge_mm: self.reference_mm };
        let (mut reference, refused) = measure(source, &[reference], &scratch, out)?;
        let Some(reference) = reference.pop() else {
            let detail = refused.into_iter().map(|r| r.1).collect();
            return Err(BenchError::Row { case: "the reference".to_owned(), detail });
        };
        let (mut solved, mut refused) = (Vec::new(), Vec::new());
        for &edge_mm in self.edges_mm {
            let cases = VARIANTS.map(|(model, locking, _)| ModelCase { model, locking, edge_mm });
            let (found, not) = measure(source, &cases, &scratch, out)?;
            solved.extend(found);
            refused.extend(not);
        }
        let rows = compare(&head, &reference, solved)?;
        let mut text = String::new();
        rows.iter().for_each(|row| text += &format!("{}\n", row.csv(source, false)));
        let reference = Row { case: reference.case, timing: reference.timing, error: zero() };
        text += &format!("{}\n", reference.csv(source, true));
        for (case, detail) in refused {
            let (case, detail) = (case.word().replace(':', ","), detail.replace([',', '\n'], ";"));
            text += &format!("{},{case},refused: {detail}\n", source.name());
        }
        Ok((rows, text))
    }

    /// The lines of a scene, without its name.
    fn lines_of(&self, scene: &str) -> Vec<(String, f64)> {
        let of_scene = |(name, seconds): &(String, f64)| match name.split_once(": ") {
            Some((own, name)) => (own == scene).then(|| (name.to_owned(), *seconds)),
            None => Some((name.clone(), *seconds)),
        };
        self.lines.iter().filter_map(of_scene).collect()
    }

    fn chart(&self, panels: &[Panel]) -> Result<String, BenchError> {
        let title = format!(
            "Le Fort I, 6 steps: time against numerical error (reference: mixed, patched, {} mm; labels: edge, mm)",
            self.reference_mm
        );
        let x = "error, mm: P95 over the moving face";
        let labels = Labels { title: &title, x, y: "processor time of the path, s" };
        pareto_chart::draw(&labels, panels)
    }
}

/// Runs the cases of one mesh in one process; returns the solved cases, and the others with the reason.
fn measure(
    source: &HeadSource,
    cases: &[ModelCase],
    scratch: &Scratch,
    out: &mut dyn Write,
) -> Result<(Vec<Solved>, Vec<(ModelCase, String)>), BenchError> {
    let words: Vec<String> = cases.iter().map(ModelCase::word).collect();
    let failed = |detail: String| BenchError::Row { case: words.join(","), detail };
    let (values, timing) = (scratch.path("moved.bin"), scratch.path("timing.json"));
    let mut program = Command::new(std::env::current_exe().map_err(|e| failed(e.to_string()))?);
    program.args(["bench", "models", "--scene", &source.word(), "--cases", &words.join(",")]);
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

fn compare(head: &Head, reference: &Solved, solved: Vec<Solved>) -> Result<Vec<Row>, BenchError> {
    let skin = &head.anatomy.skin;
    let regions = face_regions(skin, &head.anatomy.landmarks, head.landmarks.midline_x_mm).regions;
    let mut on_all = vec![true; skin.positions().len()];
    for case in solved.iter().chain([reference]) {
        if case.moved.len() != on_all.len() {
            let detail = format!("{} displacements for {} vertices", case.moved.len(), on_all.len());
            return Err(BenchError::Row { case: case.case.word(), detail });
        }
        on_all.iter_mut().zip(&case.moved).for_each(|(on_all, u)| *on_all &= u.iter().all(|c| c.is_finite()));
    }
    // Skin without a prism in some mesh counts as skin at rest.
    let counted = |moved: &[Vector]| -> Vec<Vector> {
        moved.iter().zip(&on_all).map(|(u, on_all)| if *on_all { *u } else { Vector::zeros() }).collect()
    };
    let truth = counted(&reference.moved);
    let row = |case: Solved| {
        let error =
            between_solutions(skin, &regions, &counted(&case.moved), &truth).ok_or_else(|| BenchError::Row {
                case: case.case.word(),
                detail: "no skin of the face moves on a prism of every mesh".to_owned(),
            })?;
        Ok(Row { case: case.case, timing: case.timing, error })
    };
    solved.into_iter().map(row).collect()
}

/// Processor time of the path, which other work on the machine changes little; wall time where it is not known.
fn time_s(row: &Row) -> f64 {
    row.timing.cpu_s.unwrap_or(row.timing.solve_s)
}

/// The plot of a head, with what `auto` chooses before it knows a mesh.
fn panel(source: &HeadSource, rows: &[Row]) -> Panel {
    let curve = |&(model, locking, color): &(Model, Locking, RGBColor)| {
        let own = rows.iter().filter(|r| r.case.model == model && r.case.locking == locking);
        let (points, marks) = own.map(|r| ((r.error.p95, time_s(r)), format!("{}", r.case.edge_mm))).unzip();
        Curve { name: variant_name(model, locking), color, points, marks }
    };
    let mut stars: Vec<((f64, f64), String)> = Vec::new();
    for asked_mm in ASKED_MM {
        let demand = Demand {
            displacement_mm: rows.first().map_or(0.0, |r| r.timing.displacement_mm),
            steps: STEPS as u32,
            mesh: None,
            max_edge_mm: f64::INFINITY,
            edge_mm: None,
            locking: None,
        };
        let Some(choice) = choose(&demand, Limits { error_mm: Some(asked_mm), wall_s: None }) else { continue };
        let is_chosen = |r: &&Row| {
            let of_case = (r.case.model, r.case.locking, r.case.edge_mm);
            of_case == (Model::Nonlinear, choice.chosen.locking, choice.chosen.edge_mm)
        };
        let Some(row) = rows.iter().find(is_chosen) else { continue };
        let (point, promised) = ((row.error.p95, time_s(row)), choice.grounds == Grounds::Fastest);
        let word = if promised { format!("{asked_mm}") } else { format!("({asked_mm})") };
        match stars.iter_mut().find(|(other, _)| *other == point) {
            Some((_, words)) => *words += &format!(", {word}"),
            None => stars.push((point, word)),
        }
    }
    Panel { title: source.name(), curves: VARIANTS.iter().map(curve).collect(), stars, lines: Vec::new() }
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
