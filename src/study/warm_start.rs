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
    Frame, LEAVE_OUT_BELOW_MM, PathCheckpoint, PreparedTissue, RunSettings, SolveRequest, displacement_class_mm, solve_prepared,
};
use prosopon_tissue::fem::{Model, Preset, SavedState, SolveSettings};

/// Streamed steps from rest, as in `prosopon demo`.
const STEPS: usize = 6;
/// Plans that a surgeon may try after the first: translation, mm (x, y, z), and turn about x (pitch), degrees.
const NEXT: [([f64; 3], f64); 4] =
    [([0.0, -5.0, -1.0], 0.0), ([0.0, -7.0, -1.5], 0.0), ([1.0, -6.0, -1.5], 0.0), ([0.0, -6.0, -1.5], 2.0)];

/// What a session's second job takes when it begins at the end of the first, and how far that is from the way from rest, in one program: the
/// scene of `bench models` with `mixed`.
#[derive(Debug)]
pub struct WarmStartStudy<'a> {
    /// The head.
    pub source: &'a HeadSource,
    /// Edge of the mesh, mm.
    pub edge_mm: f64,
    /// Where the rows go.
    pub csv: &'a Path,
}

/// What a job took.
struct Taken {
    wall_s: f64,
    cpu_s: f64,
    newton: usize,
    factorisations: usize,
    skin: TriMesh,
    end: SavedState,
}

impl WarmStartStudy<'_> {
    /// Solves, prints a line each and writes the rows. Distances are between skins, over the vertices that the mesh carries.
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
            // The session has these equations at hand when the first job was of the same size; else they are made within the time.
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
                "({x}, {y}, {z}) mm, {pitch_deg} degrees: from rest {:.1} s, from the first job's end {:.1} s (processor {:.1} and {:.1} s), skins \
                 {:.3} mm apart in the mean, {:.3} mm P99, {:.3} mm at most",
                rest.wall_s, warm.wall_s, rest.cpu_s, warm.cpu_s, off[0], off[1], off[2]
            )?;
        }
        write(self.csv, text.as_bytes())
    }
}

/// The moving segment of `plan`, turned about the middle of its box and moved.
fn moved(plan: &Plan, ready: &Prepared, [x, y, z]: [f64; 3], pitch_deg: f64) -> Result<Plan, BenchError> {
    let refused = |detail: String| BenchError::Head { detail };
    let segment = plan.paths.first().map(SegmentPath::segment).ok_or_else(|| refused("no path".to_owned()))?;
    let surface = ready.bone.osteotomy.segments.iter().find(|s| s.id == segment).map(|s| &s.surface);
    let centre = surface.map(|s| s.bounds().center()).ok_or_else(|| refused("no segment".to_owned()))?;
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::x_axis(), pitch_deg.to_radians());
    let about = Motion::rotation_wrt_point(turn, centre);
    let end = Motion::translation(x, y, z) * about;
    let path = SegmentPath::new(segment, vec![(1.0, end)]).map_err(|e| refused(e.to_string()))?;
    Ok(Plan { paths: vec![path] })
}

/// One job, with equations that are at hand or made within its time.
fn job(
    head: &Head,
    ready: &Prepared,
    plan: &Plan,
    from: Option<&SavedState>,
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
    let way = SolveRequest { plan, warm_start: from, resume: None };
    let mut on_frame = |frame: Frame, _: &dyn Fn() -> Option<PathCheckpoint>| skin = Some(frame.skin);
    let found =
        solve_prepared(&head.anatomy, &ready.tissue, &prepared, &ready.bone, way, &settings, &control, &mut on_frame)?;
    let taken = Taken {
        wall_s: start.elapsed().as_secs_f64(),
        cpu_s: process::cpu_s().zip(cpu).map_or(f64::NAN, |(after, before)| after - before),
        newton: found.steps.iter().map(|s| s.newton_iterations).sum(),
        factorisations: found.steps.iter().map(|s| s.factorisations).sum(),
        skin: skin.ok_or_else(|| BenchError::Head { detail: "no step".to_owned() })?,
        end: found.end,
    };
    Ok((taken, prepared))
}
