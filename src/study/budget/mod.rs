//! What a finer mesh and another formulation cost and bring: the table by which `auto` keeps a budget.

mod fit;
mod kept;
mod picture;

use std::io::Write;
use std::path::Path;

use super::end_skin::{EndSkin, end_skin, usual_run};
use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource};
use super::model_case::{largest_displacement_mm, locking_name};
use super::operations::{self, Operation, Scene};
use prosopon_planning::evaluate::{between_solutions, face_regions};
use prosopon_planning::simulate::budget::{Demand, KnownMesh};
use prosopon_planning::simulate::{Fields, TissueSettings};
use prosopon_tissue::fem::Locking;
use prosopon_tissue::mesh::MeshSettings;

/// Operations of the study when the caller names none.
const OPERATIONS: [&str; 3] = ["le_fort_1 6 forward", "bsso 4 back", "genioplasty 6 forward"];
/// Formulations that are compared.
const LOCKINGS: [Locking; 2] = [Locking::None, Locking::Patched];

/// Measures error and time of edges and formulations on several heads and operations, and fits them.
///
/// The error is the 95th percentile of the distance to the skin of the reference, over the part of the face that moves. The
/// reference has `patched` elements on a finer mesh; where it fails, its scene is left out.
#[derive(Debug)]
pub struct BudgetStudy<'a> {
    /// The heads.
    pub heads: &'a [HeadSource],
    /// Run only operations with these names; the usual three when empty.
    pub operations: &'a [String],
    /// Edge lengths, mm, from coarse to fine.
    pub edges_mm: &'a [f64],
    /// Edge length of the reference, mm.
    pub reference_mm: f64,
    /// Time limit of a solve, s.
    pub limit_s: f64,
    /// CSV file to write; the chart has the same name with `.svg`.
    pub csv: &'a Path,
}

/// One mesh and formulation in one scene.
struct Row {
    head: String,
    operation: String,
    locking: Locking,
    edge_mm: f64,
    displacement_mm: f64,
    steps: u32,
    nodes: usize,
    mesh_s: f64,
    solve_s: f64,
    /// Distance to the skin of the reference, mm; NaN where the solve failed.
    error_mm: f64,
    /// Distance to the skin of the next coarser mesh with this formulation, mm; NaN where there is none.
    to_coarser_mm: f64,
    fault: String,
}

impl BudgetStudy<'_> {
    /// Runs the study, prints a line for each case and the fit, and writes the rows.
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
                self.scene(&source.name(), &head, &fields, operation, &mut rows, out)?;
                write(self.csv, csv(&rows).as_bytes())?;
                write(&self.csv.with_extension("svg"), picture::draw(&rows)?.as_bytes())?;
            }
        }
        fit::print(&rows, out)?;
        kept::print(&rows, out)
    }

    fn scene(
        &self,
        name: &str,
        head: &Head,
        fields: &Fields,
        operation: &Operation,
        rows: &mut Vec<Row>,
        out: &mut dyn Write,
    ) -> Result<(), BenchError> {
        let meshed = |edge_mm| {
            let mesh = MeshSettings { edge_mm, ..MeshSettings::default() };
            operations::scene_with(
                head,
                fields,
                &operation.templates,
                &TissueSettings { mesh, ..TissueSettings::default() },
            )
        };
        let solved = |scene: &Scene, locking| {
            let mut run = usual_run(operation.steps);
            run.solver.locking = locking;
            end_skin(head, scene, operation, &run, self.limit_s)
        };
        let reference = match meshed(self.reference_mm) {
            Ok(scene) => solved(&scene, Locking::Patched),
            Err(why) => EndSkin::missing(why),
        };
        writeln!(out, "{name} {}: reference {:.1} s {}", operation.name, reference.solve_s, reference.detail)?;
        let Ok(truth) = &reference.moved else { return Ok(()) };
        let regions = face_regions(&head.anatomy.skin, &head.anatomy.landmarks, head.landmarks.midline_x_mm).regions;
        let mut coarser = LOCKINGS.map(|_| None);
        for &edge_mm in self.edges_mm {
            let scene = match meshed(edge_mm) {
                Ok(scene) => scene,
                Err(why) => {
                    writeln!(out, "  {edge_mm} mm: {why}")?;
                    continue;
                }
            };
            let Ok(plan) = operations::plan(&scene.bone, &operation.moves, &head.landmarks) else { continue };
            for (locking, coarser) in LOCKINGS.into_iter().zip(&mut coarser) {
                let found = solved(&scene, locking);
                let off = |a: &[_], b: &[_]| {
                    between_solutions(&head.anatomy.skin, &regions, a, b).map_or(f64::NAN, |s| s.p95)
                };
                let (error_mm, to_coarser_mm) = match &found.moved {
                    Ok(moved) => {
                        (off(moved, truth), coarser.as_ref().map_or(f64::NAN, |before: &Vec<_>| off(moved, before)))
                    }
                    Err(_) => (f64::NAN, f64::NAN),
                };
                let row = Row {
                    head: name.to_owned(),
                    operation: operation.name.clone(),
                    locking,
                    edge_mm,
                    displacement_mm: largest_displacement_mm(&scene.bone, &plan),
                    steps: operation.steps as u32,
                    nodes: scene.tissue.report.nodes,
                    mesh_s: scene.prepare_s,
                    solve_s: found.solve_s,
                    error_mm,
                    to_coarser_mm,
                    fault: found.moved.as_ref().err().cloned().unwrap_or_default(),
                };
                writeln!(
                    out,
                    "  {edge_mm} mm {:<8} {:>7} nodes, mesh {:>5.1} s, solve {:>6.1} s, error {error_mm:.3} mm, to coarser \
                     {to_coarser_mm:.3} mm {}",
                    locking_name(locking),
                    row.nodes,
                    row.mesh_s,
                    row.solve_s,
                    row.fault
                )?;
                rows.push(row);
                *coarser = found.moved.ok();
            }
        }
        Ok(())
    }
}

/// What is known of a scene once its first mesh is built.
fn demand_of(row: &Row) -> Demand {
    Demand {
        displacement_mm: row.displacement_mm,
        steps: row.steps,
        mesh: Some(KnownMesh { edge_mm: row.edge_mm, nodes: row.nodes, wall_s: row.mesh_s, is_kept: true }),
        max_edge_mm: f64::INFINITY,
        edge_mm: None,
        locking: None,
    }
}

fn csv(rows: &[Row]) -> String {
    let mut text =
        "head,operation,locking,edge_mm,displacement_mm,steps,nodes,mesh_s,solve_s,error_mm,to_coarser_mm,fault\n"
            .to_owned();
    for r in rows {
        text += &format!(
            "{},{},{},{},{:.2},{},{},{:.1},{:.1},{:.4},{:.4},\"{}\"\n",
            r.head,
            r.operation.replace(',', ";"),
            locking_name(r.locking),
            r.edge_mm,
            r.displacement_mm,
            r.steps,
            r.nodes,
            r.mesh_s,
            r.solve_s,
            r.error_mm,
            r.to_coarser_mm,
            r.fault.replace('"', "'")
        );
    }
    text
}
