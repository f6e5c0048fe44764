//! What matters: how far the face moves when one modelling choice at a time is changed.

mod choices;
mod tornado;

use std::io::Write;
use std::path::Path;

use super::end_skin::{EndSkin, end_skin};
use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource};
use super::operations::{self, Operation};
use choices::{Choices, choices};
use prosopon_geometry::Vector;
use prosopon_planning::evaluate::face_regions;
use prosopon_planning::simulate::Fields;

/// Operations of the study when the caller names none: one for each kind of movement.
const OPERATIONS: [&str; 6] = [
    "le_fort_1 6 forward",
    "bsso 4 back",
    "bsso 7 forward",
    "bimaxillary 5 and -5",
    "genioplasty 6 forward",
    "le_fort_1 5 up",
];

/// Changes one modelling choice at a time on several heads and operations.
#[derive(Debug)]
pub struct AssumptionStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
    /// Run only operations with these names; the usual six when empty.
    pub operations: &'a [String],
    /// Run only choices whose name contains one of these texts; all when empty.
    pub only: &'a [String],
    /// Time limit of a solve, s.
    pub limit_s: f64,
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
}

/// How the face changes with one choice, in one region of one head after one operation.
struct Row {
    head: String,
    operation: String,
    choice: &'static str,
    region: &'static str,
    /// Mean and 95th percentile of the distance to the skin of the usual choices, mm.
    mean_mm: f64,
    p95_mm: f64,
    /// Mean movement forward and up of the skin with this choice, mm.
    forward_mm: f64,
    up_mm: f64,
    /// Time of the solve, s, and in units of that of the usual choices.
    solve_s: f64,
    times: f64,
    /// Why there is no result; empty when there is one.
    fault: String,
}

impl AssumptionStudy<'_> {
    /// Runs the study, prints a line for each choice and writes rows and chart.
    ///
    /// # Errors
    /// [`BenchError`]; a failed solve is a result.
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let operations = operations::named(self.operations, &OPERATIONS)?;
        let mut rows: Vec<Row> = Vec::new();
        for source in self.heads {
            let (head, fields) = Head::with_fields(source)?;
            for operation in &operations {
                self.study(&source.name(), &head, &fields, operation, &mut rows, out)?;
                write(self.csv, csv(&rows).as_bytes())?;
                write(&self.csv.with_extension("svg"), tornado::draw(&rows)?.as_bytes())?;
            }
        }
        Ok(())
    }

    fn study(
        &self,
        name: &str,
        head: &Head,
        fields: &Fields,
        operation: &Operation,
        rows: &mut Vec<Row>,
        out: &mut dyn Write,
    ) -> Result<(), BenchError> {
        let usual = Choices::usual(operation.steps);
        let scene = match operations::scene_with(head, fields, &operation.templates, &usual.tissue) {
            Ok(scene) => scene,
            Err(why) => return Ok(writeln!(out, "{name} {}: {why}", operation.name)?),
        };
        let base = end_skin(head, &scene, operation, &usual.run, self.limit_s);
        writeln!(out, "{name} {}: {:.1} s {}", operation.name, base.solve_s, base.detail)?;
        let Ok(from) = &base.moved else { return Ok(()) };
        rows.extend(compared(name, head, operation, "as usual", &base, from, base.solve_s));
        let wanted =
            |c: &&choices::Choice| self.only.is_empty() || self.only.iter().any(|o| c.name.contains(o.as_str()));
        for choice in choices().iter().filter(wanted) {
            let mut changed = Choices::usual(operation.steps);
            (choice.change)(&mut changed);
            let found = if changed.tissue == usual.tissue {
                end_skin(head, &scene, operation, &changed.run, self.limit_s)
            } else {
                match operations::scene_with(head, fields, &operation.templates, &changed.tissue) {
                    Ok(scene) => end_skin(head, &scene, operation, &changed.run, self.limit_s),
                    Err(why) => EndSkin::missing(why),
                }
            };
            let of_choice = compared(name, head, operation, choice.name, &found, from, base.solve_s);
            let face = of_choice.iter().find(|r| r.region == "face");
            let (mean, p95) = face.map_or((f64::NAN, f64::NAN), |r| (r.mean_mm, r.p95_mm));
            let times = found.solve_s / base.solve_s;
            writeln!(out, "  {:<34} {mean:>6.2} {p95:>6.2} mm {times:>5.2} x {}", choice.name, found.detail)?;
            rows.extend(of_choice);
        }
        Ok(())
    }
}

/// Rows of one choice: a row for each region of the face, and one for all of it.
fn compared(
    name: &str,
    head: &Head,
    operation: &Operation,
    choice: &'static str,
    found: &EndSkin,
    from: &[Vector],
    base_s: f64,
) -> Vec<Row> {
    let row = |region: &'static str, fault: String| Row {
        head: name.to_owned(),
        operation: operation.name.clone(),
        choice,
        region,
        mean_mm: f64::NAN,
        p95_mm: f64::NAN,
        forward_mm: f64::NAN,
        up_mm: f64::NAN,
        solve_s: found.solve_s,
        times: found.solve_s / base_s,
        fault,
    };
    let moved = match &found.moved {
        Ok(moved) => moved,
        Err(why) => return vec![row("face", why.clone())],
    };
    let skin = head.anatomy.skin.positions();
    let regions = face_regions(&head.anatomy.skin, &head.anatomy.landmarks, head.landmarks.midline_x_mm).regions;
    let of = |region: &'static str, holds: &dyn Fn(usize) -> bool| {
        let inside: Vec<usize> = (0..skin.len()).filter(|i| holds(*i)).collect();
        if inside.is_empty() {
            return None;
        }
        let mut off: Vec<f64> = inside.iter().map(|i| (moved[*i] - from[*i]).norm()).collect();
        off.sort_unstable_by(f64::total_cmp);
        let n = inside.len() as f64;
        let mean: Vector = inside.iter().map(|i| moved[*i]).sum::<Vector>() / n;
        Some(Row {
            mean_mm: off.iter().sum::<f64>() / n,
            p95_mm: off[(0.95 * (n - 1.0)).round() as usize],
            forward_mm: -mean.y,
            up_mm: mean.z,
            ..row(region, String::new())
        })
    };
    // Only skin that either choice moves by a tenth of a millimetre, so that the back of the head does not dilute the mean.
    let mut rows: Vec<Row> = of("face", &|i| moved[i].norm().max(from[i].norm()) > 0.1).into_iter().collect();
    rows.extend(regions.iter().filter_map(|region| of(region.name, &|i| region.contains(&skin[i]))));
    rows
}

fn csv(rows: &[Row]) -> String {
    let mut text = "head,operation,choice,region,mean_mm,p95_mm,forward_mm,up_mm,solve_s,times,fault\n".to_owned();
    for r in rows {
        text += &format!(
            "{},{},{},{},{:.3},{:.3},{:.2},{:.2},{:.1},{:.2},\"{}\"\n",
            r.head,
            r.operation.replace(',', ";"),
            r.choice,
            r.region,
            r.mean_mm,
            r.p95_mm,
            r.forward_mm,
            r.up_mm,
            r.solve_s,
            r.times,
            r.fault.replace('"', "'")
        );
    }
    text
}
