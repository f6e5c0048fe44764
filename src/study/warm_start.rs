use std::io::Write;
use std::path::Path;
use std::time::Instant;

use super::error::{BenchError, write};
use super::files::refuse_unwritable;
use super::head::{Head, HeadSource, Prepared};
use super::model_case::{clock, displacements};
use super::process;
use super::reach::distances;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Motion, TriMesh};
use prosopon_planning::plan::{Path as SegmentPath, Plan};
use prosopon_planning::simulate::{
    Frame, LEAVE_OUT_BELOW_MM, PathCheckpoint, PathStart, PreparedTissue, RunSettings, displacement_class_mm,
    solve_prepared,
};
use prosopon_tissue::fem::{Model, Preset, SolveSettings, StartState};

/// Streamed steps from rest, as in `prosopon demo`.
const STEPS: usize = 6;
/// Plans that a surgeon may try after the first: translation (x, y, z), mm, and rotation about x (pitch), degrees.
const NEXT: [([f64; 3], f64); 4] =
    [([0.0, -5.0, -1.0], 0.0), ([0.0, -7.0, -1.5], 0.0), ([1.0, -6.0, -1.5], 0.0), ([0.0, -6.0, -1.5], 2.0)];

/// Measures the time of a session's second job when it starts from the result of the first one.
///
/// The scene is that of `bench models` with the model `mixed`, in one process. The resulting skin is compared with that of a
/// job that starts from rest.
#[derive(Debug)]
pub struct WarmStartStudy<'a> {
    /// The head.
    pub source: &'a HeadSource,
    /// Edge length of the mesh, mm.
    pub edge_mm: f64,
    /// CSV file to write.
    pub csv: &'a Path,
}

/// Time and result of a job.
struct Taken {
    wall_s: f64,
    cpu_s: f64,
    newton: usize,
    factorisations: usize,
    skin: TriMesh,
    end: StartState,
}

impl WarmStartStudy<'_> {
    /// Runs the study, prints a line per plan and writes the rows.
    ///
    /// Distances are between the two skins, over the vertices that lie on the mesh.
    ///
    /// # Errors
    /// [`BenchError`].
    pub fn run(&self, out: &mut dyn Write) -> Result<(), BenchError> {
        refuse_unwritable(self.csv)?;
        let head = Head::load(self.source)?;
        let ready = head.prepare(self.edge_mm)?;
        let (first, _) = job(&head, &ready, &ready.plan, None, None)?;
        writeln!(out, "first job: {:.1} s from the mesh to the last skin", first.wall_s)?;
        let mut text = "dx_mm,dy_mm,dz_mm,pitch_deg,rest_s,rest_cpu_s,rest_newton,warm_s,warm_cpu_s,warm_newton,warm_factorisations,\
            mean_mm,p99_mm,largest_mm\n"
            .to_owned();
        for ([x, y, z], pitch_deg) in NEXT {
            let plan = moved(&ready.plan, &ready, [x, y, z], pitch_deg)?;
            let (rest, prepared) = job(&head, &ready, &plan, None, None)?;
            // A session has these equations in memory when the first job was in the same displacement class; otherwise the
            // time of the second job includes building them.
            let same = displacement_class_mm(&ready.bone, &plan) == displacement_class_mm(&ready.bone, &ready.plan);
            let (warm, _) = job(&head, &ready, &plan, Some(&first.end), same.then_some(prepared))?;
            let off = distances(&displacements(&head, &ready, &rest.skin), &displacements(&head, &ready, &warm.skin));
            text += &format!(
                "{x},{y},{z},{pitch_deg},{:.2},{:.2},{},{:.2},{:.2},{},{},{:.4},{:.4},{:.4}\n",
                rest.wall_s,
                rest.cpu_s,
                rest.newton,
                warm.wall_s,
                warm.cpu_s,
                warm.newton,
                warm.factorisations,
                off[0],
                off[1],
                off[2]
            );
            writeln!(
                out,
                "({x}, {y}, {z}) mm, {pitch_deg} degrees: from rest {:.1} s, from the first job's result {:.1} s \
                 (processor {:.1} and {:.1} s), distance of the skins: mean {:.3} mm, P99 {:.3} mm, max {:.3} mm",
                rest.wall_s, warm.wall_s, rest.cpu_s, warm.cpu_s, off[0], off[1], off[2]
            )?;
        }
        write(self.csv, text.as_bytes())
    }
}

/// A plan for the segment of `plan`: rotation about the centre of its bounding box, then translation.
fn moved(plan: &Plan, ready: &Prepared, [x, y, z]: [f64; 3], pitch_deg: f64) -> Result<Plan, BenchError> {
    let refused = |detail: String| BenchError::Head { detail };
    let segment =
        plan.paths.first().map(SegmentPath::segment).ok_or_else(|| refused("the plan has no path".to_owned()))?;
    let surface = ready.bone.osteotomy.segments.iter().find(|s| s.id == segment).map(|s| &s.surface);
    let centre =
        surface.map(|s| s.bounds().center()).ok_or_else(|| refused("the plan's segment does not exist".to_owned()))?;
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), pitch_deg.to_radians());
    let about = Motion::rotation_wrt_point(turn, centre);
    let end = Motion::translation(x, y, z) * about;
    let path = SegmentPath::new(segment, vec![(1.0, end)]).map_err(|e| refused(e.to_string()))?;
    Ok(Plan { paths: vec![path] })
}

/// Runs one job; its time includes building the equations unless `prepared` has them.
fn job(
    head: &Head,
    ready: &Prepared,
    plan: &Plan,
    from: Option<&StartState>,
    prepared: Option<PreparedTissue>,
) -> Result<(Taken, PreparedTissue), BenchError> {
    let settings = RunSettings {
        solver: SolveSettings::new(Model::Mixed, Preset::Wang2009Stable.materials()),
        steps: if from.is_some() { 1 } else { STEPS },
        attachment: None,
        leave_out_below_mm: LEAVE_OUT_BELOW_MM,
    };
    let control = Control::new().with_clock(clock);
    let (start, cpu) = (Instant::now(), process::cpu_s());
    let prepared = match prepared {
        Some(prepared) => prepared,
        None => PreparedTissue::new(&ready.tissue, &ready.bone, plan, &settings, &control)?,
    };
    let mut skin = None;
    let way = PathStart { plan, warm_start: from, resume: None };
    let mut on_frame = |frame: Frame, _: &dyn Fn() -> Option<PathCheckpoint>| skin = Some(frame.skin);
    let found =
        solve_prepared(&head.anatomy, &ready.tissue, &prepared, &ready.bone, way, &settings, &control, &mut on_frame)?;
    let taken = Taken {
        wall_s: start.elapsed().as_secs_f64(),
        cpu_s: process::cpu_s().zip(cpu).map_or(f64::NAN, |(after, before)| after - before),
        newton: found.steps.iter().map(|s| s.newton_iterations).sum(),
        factorisations: found.steps.iter().map(|s| s.factorisations).sum(),
        skin: skin.ok_or_else(|| BenchError::Head { detail: "the solver returned no step".to_owned() })?,
        end: found.end,
    };
    Ok((taken, prepared))
}
