use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::str::FromStr;
use std::time::Instant;

use plotters::style::RGBColor;
use serde::{Deserialize, Serialize};

use super::chart::{self, Curve, Labels};
use super::error::{BenchError, read, write};
use super::files::{Scratch, refuse_unwritable};
use super::growth::exponent;
use super::model_case::{PHASES, clock, locking_name, locking_of, phases_s};
use super::process;
use super::slab::Slab;
use prosopon_geometry::Motion;
use prosopon_geometry::control::Control;
use prosopon_planning::simulate::SimulateError;
use prosopon_tissue::fem::material::{Material, Materials};
use prosopon_tissue::fem::{Boundary, Locking, Model, Prepared, SkinElement, SolveSettings, Solver};

/// Cells along the sides and through the thickness, ascending: 19 200 to 492 804 tetrahedra.
///
/// The third is the slab of the reference results.
const CELLS: [[usize; 2]; 5] = [[40, 2], [56, 3], [74, 4], [93, 5], [117, 6]];
/// Shear moduli of skin and fat, MPa, a fifth of each from C01; as in the reference results.
const SHEAR_MPA: [f64; 2] = [0.0351, 0.0118];
/// Translation of the tied patch, mm.
const MOVED_MM: [f64; 3] = [2.0, 0.0, 5.0];
/// Number of times each case is solved; the shortest time counts.
const ROUNDS: usize = 2;

/// Measures the solver's time by phase against the number of tetrahedra.
///
/// The scene is a slab of 150 x 150 x 16.5 mm. A patch of 41 x 41 mm of its bottom is moved in one step, with and without
/// locking-free formulations.
#[derive(Debug)]
pub struct SolverGrowthStudy<'a> {
    /// CSV file to write; the charts have the same name with `.svg` and `-phases.svg`.
    pub csv: &'a Path,
    /// Sizes of the study, from the smallest; at most 5.
    pub sizes: usize,
}

/// A slab and its locking treatment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlabCase {
    cells: [usize; 2],
    locking: Locking,
    poisson: f64,
}

impl FromStr for SlabCase {
    type Err = String;

    /// Parses `none:74:4` or `patched:74:4:0.499`: locking treatment, cells along the sides, cells through the thickness, Poisson
    /// ratio (0.45, or 0.49 with a locking-free formulation).
    fn from_str(word: &str) -> Result<Self, Self::Err> {
        let fault = || format!("{word:?} is not a case: expected locking:N:N or locking:N:N:ratio");
        let words: Vec<&str> = word.split(':').collect();
        let (&[locking, side, depth], ratio) = words.split_first_chunk::<3>().ok_or_else(fault)?;
        let number = |n: &str| n.parse().ok().filter(|n| (1..=1000).contains(n)).ok_or_else(fault);
        let locking = locking_of(locking).ok_or_else(fault)?;
        let poisson = match ratio {
            [] if locking == Locking::None => 0.45,
            [] => 0.49,
            [ratio] => ratio.parse().ok().filter(|nu| (0.0..0.5).contains(nu)).ok_or_else(fault)?,
            _ => return Err(fault()),
        };
        Ok(Self { cells: [number(side)?, number(depth)?], locking, poisson })
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
struct SlabTiming {
    tetrahedra: usize,
    prisms: usize,
    unknowns: usize,
    newton_iterations: usize,
    factorisations: usize,
    wall_s: f64,
    cpu_s: Option<f64>,
    phases_s: [f64; 7],
    peak_mb: Option<f64>,
    /// Peak memory beyond the memory in use before the solve.
    taken_mb: Option<f64>,
    /// Memory that the solver estimated from counts in advance.
    estimated_mb: f64,
}

impl SlabCase {
    fn word(&self) -> String {
        format!("{}:{}:{}:{}", locking_name(self.locking), self.cells[0], self.cells[1], self.poisson)
    }

    /// Settings of the reference results.
    fn settings(&self) -> SolveSettings {
        let locking = self.locking;
        let [skin, fat] = SHEAR_MPA.map(|mu| Material::mooney_rivlin(0.4 * mu, 0.1 * mu, self.poisson));
        let materials = Materials { skin, fat, muscle: fat, mucosa: fat, cartilage: fat };
        SolveSettings { skin_element: SkinElement::Wedge, locking, ..SolveSettings::new(Model::Nonlinear, materials) }
    }

    fn solve(&self) -> Result<SlabTiming, BenchError> {
        let [side, depth] = self.cells;
        let slab = Slab { cells: [side, side, depth], size_mm: [150.0, 150.0, 15.0], skin_mm: 1.5 };
        let mesh = slab.over_a_patch(20.5, 30.0);
        let control = Control::new().with_clock(clock);
        let (start, cpu) = (Instant::now(), process::cpu_s());
        let before = process::memory_mb();
        let prepared = Prepared::new(&mesh, &[], &Boundary::default(), self.settings(), &control);
        let prepared = prepared.map_err(SimulateError::from)?;
        let mut solver = Solver::over(&prepared, &mesh, vec![], &control).map_err(SimulateError::from)?;
        let [x, y, z] = MOVED_MM;
        let path = |t: f64| vec![(1, Motion::translation(x * t, y * t, z * t))];
        let report = solver.advance(1.0, &path, &control).map_err(SimulateError::from)?;
        Ok(SlabTiming {
            tetrahedra: slab.tetrahedra(),
            prisms: mesh.prisms.len(),
            unknowns: report.unknowns,
            newton_iterations: report.newton_iterations,
            factorisations: report.factorisations,
            wall_s: start.elapsed().as_secs_f64(),
            cpu_s: process::cpu_s().zip(cpu).map(|(after, before)| after - before),
            phases_s: phases_s(&report.phases),
            peak_mb: process::peak_mb(),
            taken_mb: process::peak_mb().zip(before).map(|(peak, before)| peak - before),
            estimated_mb: prepared.estimated_mb(report.factorisations > 1),
        })
    }
}

/// Solves one slab and writes its times and memory to `timing` as JSON.
///
/// # Errors
/// [`BenchError`].
pub fn run_slab_case(case: &SlabCase, timing: &Path) -> Result<(), BenchError> {
    let mut best = case.solve()?;
    for _ in 1..ROUNDS {
        let next = case.solve()?;
        // Memory is taken from the first round: later rounds may include memory left over from earlier ones.
        if next.wall_s < best.wall_s {
            best = SlabTiming { peak_mb: best.peak_mb, taken_mb: best.taken_mb, ..next };
        }
    }
    write(timing, &serde_json::to_vec(&best).map_err(std::io::Error::other)?)
}

impl SolverGrowthStudy<'_> {
    /// Runs the study and prints to `out`; each case runs in a separate process, so that peak memories are independent.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let scratch = Scratch::new()?;
        let mut csv = format!(
            "locking,poisson,tetrahedra,prisms,unknowns,newton_iterations,factorisations,wall_s,cpu_s,{},peak_mb,taken_mb,estimated_mb\n",
            PHASES.join(",")
        );
        write!(out, "{csv}")?;
        let mut found: Vec<(SlabCase, SlabTiming)> = Vec::new();
        for (locking, poisson, _) in TREATMENTS {
            for cells in CELLS.into_iter().take(self.sizes) {
                let case = SlabCase { cells, locking, poisson };
                let timing = measure(&case, &scratch)?;
                let row = row(&case, &timing);
                write!(out, "{row}")?;
                csv += &row;
                found.push((case, timing));
                write(self.csv, csv.as_bytes())?;
            }
        }
        let of = |locking: Locking, poisson: f64| -> Vec<&SlabTiming> {
            found.iter().filter(|f| (f.0.locking, f.0.poisson) == (locking, poisson)).map(|f| &f.1).collect()
        };
        let plain = of(Locking::None, TREATMENTS[0].1);
        let whole = |(locking, poisson, color): (Locking, f64, RGBColor)| {
            curve(&format!("{}, {poisson}", locking_name(locking)), color, &of(locking, poisson), |t| t.wall_s)
        };
        let curves: Vec<Curve> = TREATMENTS.into_iter().map(whole).collect();
        for c in &curves {
            writeln!(out, "{}: fitted exponent", c.name)?;
        }
        let labels = Labels {
            title: "Time of a solve against the size of the mesh (fitted exponent)",
            x: "tetrahedra",
            y: "solve, s",
        };
        let svg = self.csv.with_extension("svg");
        write(&svg, chart::draw(&labels, &curves)?.as_bytes())?;
        let names =
            ["setup", "tangents, assembly", "factorisation", "solves, CG", "residual", "contact", "line search"];
        let curves = names
            .iter()
            .zip(COLOURS)
            .enumerate()
            .map(|(n, (name, color))| curve(name, color, &plain, move |t| t.phases_s[n]));
        let curves: Vec<Curve> = curves.filter(|c| c.points.iter().all(|p| p.1 > 0.0)).collect();
        let labels = Labels {
            title: "Time of the solver's phases, without locking-free formulation (fitted exponent)",
            x: "tetrahedra",
            y: "s",
        };
        let stem = self.csv.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let phases = self.csv.with_file_name(format!("{stem}-phases.svg"));
        write(&phases, chart::draw(&labels, &curves)?.as_bytes())?;
        writeln!(out, "wrote {}, {} and {}", self.csv.display(), svg.display(), phases.display())?;
        Ok(())
    }
}

/// Locking treatments and Poisson ratios of the study, with the colours of their curves (Okabe and Ito).
const TREATMENTS: [(Locking, f64, RGBColor); 4] = [
    (Locking::None, 0.45, RGBColor(0, 114, 178)),
    (Locking::Smoothed, 0.49, RGBColor(213, 94, 0)),
    (Locking::Patched, 0.49, RGBColor(0, 158, 115)),
    (Locking::Patched, 0.499, RGBColor(0, 0, 0)),
];

/// Okabe and Ito.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(86, 180, 233),
    RGBColor(204, 121, 167),
    RGBColor(0, 158, 115),
];

fn curve(name: &str, color: RGBColor, timings: &[&SlabTiming], y: impl Fn(&SlabTiming) -> f64) -> Curve {
    let points: Vec<(f64, f64)> = timings.iter().map(|t| (t.tetrahedra as f64, y(t))).collect();
    Curve { name: format!("{name} ({:.2})", exponent(&points)), color, points, marks: Vec::new() }
}

fn measure(case: &SlabCase, scratch: &Scratch) -> Result<SlabTiming, BenchError> {
    let failed = |detail: String| BenchError::Row { case: case.word(), detail };
    let timing = scratch.path("timing.json");
    let mut program = Command::new(std::env::current_exe().map_err(|e| failed(e.to_string()))?);
    program.args(["bench", "solver-growth", "--case", &case.word(), "--timing"]).arg(&timing);
    let done = program.output().map_err(|e| failed(e.to_string()))?;
    if !done.status.success() {
        return Err(failed(String::from_utf8_lossy(&done.stderr).trim().to_owned()));
    }
    serde_json::from_slice(&read(&timing)?).map_err(|e| failed(e.to_string()))
}

fn row(case: &SlabCase, t: &SlabTiming) -> String {
    let phases: Vec<String> = t.phases_s.iter().map(|s| format!("{s:.3}")).collect();
    format!(
        "{},{},{},{},{},{},{},{:.3},{},{},{},{},{:.0}\n",
        locking_name(case.locking),
        case.poisson,
        t.tetrahedra,
        t.prisms,
        t.unknowns,
        t.newton_iterations,
        t.factorisations,
        t.wall_s,
        t.cpu_s.map_or(String::new(), |s| format!("{s:.2}")),
        phases.join(","),
        t.peak_mb.map_or(String::new(), |mb| format!("{mb:.0}")),
        t.taken_mb.map_or(String::new(), |mb| format!("{mb:.0}")),
        t.estimated_mb,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_slab_is_solved_and_cases_are_read_as_they_are_written() {
        let case: SlabCase = "patched:8:1".parse().unwrap();
        assert_eq!((case.word(), case.word().parse()), ("patched:8:1:0.49".to_owned(), Ok(case)));
        let timing = case.solve().unwrap();
        assert!(timing.tetrahedra == 384 && timing.unknowns > 0 && timing.newton_iterations > 1);
        for word in ["none:4", "none:0:4", "some:4:4", "none:4:x", "none:4:4:0.5", "none:4:4:0.4:1"] {
            assert!(word.parse::<SlabCase>().is_err(), "{word}");
        }
    }
}
