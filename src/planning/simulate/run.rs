use super::attach::{AttachResult, Attached, attach, is_moved, open_ends};
use super::reach::{BoneMotion, beyond_reach, displacement_class_mm};
use super::skin_mover::SkinMover;
use super::tuning::{MAX_BORDER_MM, SETUP_SHARE, WARN_BORDER, WARN_BORDER_MM};
use super::{Anatomy, AttachmentRules, Beyond, CutBone, SimulateError, TissueModel};
use crate::evaluate::{FaceRegion, FaceRegions, face_regions};
use crate::plan::{Plan, PlanError};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Aabb, Point, TriMesh, Vector, Warning};
use prosopon_tissue::fem::{
    Boundary, Checkpoint, Locking, MotionNumbers, Prepared, SolveError, SolveSettings, Solver, StartState, StepReport,
    motion_numbers, motion_of_numbers,
};
use prosopon_tissue::mesh::{Attachment, MixedMesh};

/// Settings of [`solve`].
#[derive(Debug, Clone, PartialEq)]
pub struct RunSettings {
    /// Model, elements, materials and tolerances.
    pub solver: SolveSettings,
    /// Number of load steps along the path, at least 1; each yields a [`Frame`].
    pub steps: usize,
    /// Attachment of tissue to bone; the default rule when `None`.
    pub attachment: Option<AttachmentRules>,
    /// Tissue that the plan moves by less than this, by estimate, is left out: its nodes are fixed, mm. 0 keeps all tissue.
    pub leave_out_below_mm: f64,
}

/// Default of [`RunSettings::leave_out_below_mm`], mm.
///
/// The skin then differs from the solve of all tissue by less than 0.05 mm at P99 (`prosopon bench reach`).
pub const LEAVE_OUT_BELOW_MM: f64 = 0.03;

/// Treatment of locking on heads when a request names none.
///
/// Patches halve the numerical error there (phantom: P95 0.25 to 0.15 mm) at two to four times the time, and plans for the lower
/// jaw run out of time with them (`prosopon bench operations`). On patients the formulation moves the lower face by 0.03 mm.
pub const HEAD_LOCKING: Locking = Locking::None;

/// The deformed skin after one load step.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Step number, 1 to n.
    pub k: usize,
    /// Path parameter, 0 to 1.
    pub t: f64,
    /// The user's skin, deformed: positions in the order of [`TissueModel::skin`], LPS mm.
    pub skin: TriMesh,
    /// Length of each vertex' displacement, mm.
    pub displacement_mm: Vec<f32>,
    /// Report of the solver.
    pub report: StepReport,
}

/// A checkpoint: a solved step from which the path can be resumed.
#[derive(Debug, Clone, PartialEq)]
pub struct PathCheckpoint {
    /// Number of the step, 1 to n.
    pub k: usize,
    /// Motions of the moving segments from rest at the path's start, after a warm start; `None` for a path that starts at rest.
    pub begin: Option<Vec<(u32, MotionNumbers)>>,
    /// State of the solver.
    pub solver: Checkpoint,
}

/// Callback for each step, with a function that makes a checkpoint of it.
///
/// The function returns `None` where a checkpoint is not possible.
pub type OnFrame<'a> = dyn FnMut(Frame, &dyn Fn() -> Option<PathCheckpoint>) + 'a;

/// Movement of a part of the face at the end of the path.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionMotion {
    /// Name of the region.
    pub name: &'static str,
    /// Mean movement forward (towards -y), mm.
    pub forward_mm: f64,
    /// Mean movement down (towards -z), mm.
    pub down_mm: f64,
    /// Mean movement to the patient's left (+x), mm.
    pub left_mm: f64,
}

/// Tissue that a solve leaves out because the plan hardly moves it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LeftOut {
    /// Number of nodes that are fixed instead of free or sliding.
    pub nodes: usize,
    /// Number of nodes of the mesh.
    pub of_nodes: usize,
    /// Largest displacement of a free node beside one that is left out, mm: tissue just beyond would have moved by less.
    pub border_mm: f64,
}

/// Result of a path that was solved to its end.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Reports of the steps that were solved.
    pub steps: Vec<StepReport>,
    /// Mean movement of each region of the face.
    pub regions: Vec<RegionMotion>,
    /// The regions of the face.
    pub face: Vec<FaceRegion>,
    /// Positions of the deformed mesh's nodes, LPS mm.
    pub nodes: Vec<Point>,
    /// How each node was held in the solve; tissue that was left out counts as fixed.
    pub attachment: Vec<Attachment>,
    /// State at the end, for the warm start of another path.
    pub end: StartState,
    /// Tissue that was left out.
    pub left_out: LeftOut,
    /// Numbers of tied, sliding, free and fixed nodes.
    pub attached: Attached,
    /// Warnings about the inputs and the result.
    pub warnings: Vec<Warning>,
}

/// The paths to solve, and the state from which to start.
#[derive(Debug, Clone, Copy)]
pub struct PathStart<'a> {
    /// Paths of all segments that move.
    pub plan: &'a Plan,
    /// State at the end of another plan for the same tissue, bone, segments and elements.
    ///
    /// Bone moves straight from there to the end of `plan`. Where tissue slides over edges of bone the result may depend
    /// slightly on the start.
    pub warm_start: Option<&'a StartState>,
    /// Checkpoint of this path from which to resume, instead of `warm_start`.
    ///
    /// Later steps have the same bits as in an uninterrupted solve.
    pub resume: Option<&'a PathCheckpoint>,
}

/// Tissue attached to bone, with equations prepared for a class of plans.
///
/// They serve all plans that move the same segments and have the same [`displacement_class_mm`].
#[derive(Debug)]
pub struct PreparedTissue {
    mesh: MixedMesh,
    equations: Prepared,
    moving: Vec<u32>,
    displacement_mm: f64,
    /// Nodes that are left out, ascending.
    left_out: Vec<u32>,
    attached: Attached,
    warnings: Vec<Warning>,
}

impl PreparedTissue {
    /// Attaches the tissue and prepares its equations.
    ///
    /// # Errors
    /// [`SimulateError`].
    pub fn new(
        tissue: &TissueModel,
        bone: &CutBone,
        plan: &Plan,
        settings: &RunSettings,
        control: &Control,
    ) -> Result<Self, SimulateError> {
        let bone = &bone.with_globes(&tissue.globes);
        let moving = moving_segments(bone, plan)?;
        let rules = settings.attachment.clone().unwrap_or_default();
        let mut mesh = tissue.mesh.clone();
        let AttachResult { warnings, attached, tied_share } =
            attach(&mut mesh, bone, &moving, tissue.arch.as_ref(), &rules);
        let foundation_n_mm = match rules.beyond {
            Beyond::Tissue => open_ends(&mut mesh, bone, &moving, &settings.solver.materials),
            Beyond::Wall => Vec::new(),
        };
        let displacement_mm = displacement_class_mm(bone, plan);
        if displacement_mm > 0.0 && !is_moved(&mesh, bone, &moving) {
            let detail = format!(
                "no tissue is tied to the moving segments, glides on them or is pushed by them ({} nodes were painted); paint \
                 tissue at these segments `tied`",
                attached.painted
            );
            return Err(SolveError::Problem { detail }.into());
        }
        let left_out = if settings.leave_out_below_mm > 0.0 {
            let motion = BoneMotion { moving: &moving, displacement_mm };
            beyond_reach(&mesh, bone, motion, settings.leave_out_below_mm, &settings.solver.materials, control)?
        } else {
            Vec::new()
        };
        left_out.iter().for_each(|node| mesh.attachment[*node as usize] = Attachment::Fixed);
        let boundary = Boundary { tied_share, foundation_n_mm, ..Boundary::default() };
        let solver = SolveSettings { pull_off_mpa: rules.pull_off_mpa, ..settings.solver.clone() };
        let equations = Prepared::new(&mesh, &bone.bodies(), &boundary, solver, control)?;
        Ok(Self { mesh, equations, moving, displacement_mm, left_out, attached, warnings })
    }
}

/// Moves the bone along the plan and passes each step to `on_frame` as soon as it is solved.
///
/// # Errors
/// [`SimulateError`]; frames that were passed on before stay valid.
pub fn solve(
    anatomy: &Anatomy,
    tissue: &TissueModel,
    bone: &CutBone,
    plan: &Plan,
    settings: &RunSettings,
    control: &Control,
    on_frame: &mut dyn FnMut(Frame),
) -> Result<Outcome, SimulateError> {
    let prepared = PreparedTissue::new(tissue, bone, plan, settings, &control.stage(0.0, SETUP_SHARE))?;
    let control = control.stage(SETUP_SHARE, 1.0);
    let request = PathStart { plan, warm_start: None, resume: None };
    solve_prepared(anatomy, tissue, &prepared, bone, request, settings, &control, &mut |frame, _| on_frame(frame))
}

/// As [`solve`], with equations that were prepared before; the result has the same bits.
///
/// `prepared` must be for the same tissue, bone, moving segments, attachment and solver settings. The outcome holds the reports
/// of the steps that this call solves.
///
/// # Errors
/// [`SimulateError`]; frames that were passed on before stay valid.
pub fn solve_prepared(
    anatomy: &Anatomy,
    tissue: &TissueModel,
    prepared: &PreparedTissue,
    bone: &CutBone,
    request: PathStart<'_>,
    settings: &RunSettings,
    control: &Control,
    on_frame: &mut OnFrame<'_>,
) -> Result<Outcome, SimulateError> {
    check_prepared(prepared, bone, request.plan, settings)?;
    let mut warnings = prepared.warnings.clone();
    let bone = &bone.with_globes(&tissue.globes);
    let mut solver =
        Solver::over(&prepared.equations, &prepared.mesh, bone.bodies(), &control.stage(0.0, SETUP_SHARE))?;
    let begin = start(&mut solver, request)?;
    let continued = begin.as_ref().map(|begin| {
        let motions: Vec<_> = begin.iter().map(|(segment, m)| (*segment, motion_of_numbers(*m))).collect();
        request.plan.continued_from(&motions)
    });
    let plan = continued.as_ref().unwrap_or(request.plan);
    let path = control.stage(SETUP_SHARE, 1.0);
    let share = |k: usize| k as f64 / settings.steps as f64;
    let skin = tissue.skin(anatomy);
    let skin_mover = SkinMover::new(skin, &tissue.embedding);
    warnings.extend(Aabb::of(&prepared.mesh.positions).and_then(|region| skin_mover.warning(skin, &region)));
    let mut steps = Vec::with_capacity(settings.steps);
    let mut last = skin_mover.displacements(&solver);
    let done = request.resume.map_or(0, |checkpoint| checkpoint.k);
    path.report(share(done));
    for k in done + 1..=settings.steps {
        let (motions, part) = (|t| plan.motions(t), path.stage(share(k - 1), share(k)));
        // Intermediate frames are for display; the last one is the result.
        let report = if k < settings.steps {
            solver.advance_for_display(share(k), &motions, &part)?
        } else {
            solver.advance(share(k), &motions, &part)?
        };
        last = skin_mover.displacements(&solver);
        steps.push(report.clone());
        let checkpoint = || Some(PathCheckpoint { k, begin: begin.clone(), solver: solver.checkpoint()? });
        on_frame(frame(skin, &last, k, share(k), report)?, &checkpoint);
    }
    warnings.extend(steps.last().and_then(|s: &StepReport| s.bone_penetration?.warning()));
    let FaceRegions { regions: face, from_landmarks } =
        face_regions(&anatomy.skin, &anatomy.landmarks, anatomy.midline_x_mm);
    if !from_landmarks {
        let message = "without landmarks on the front of the skin the regions of the face are placed by proportions";
        warnings.push(Warning::check("regions-by-proportions", message).act("Add landmarks."));
    }
    let regions = face.iter().filter_map(|region| region_motion(skin, &last, region)).collect();
    let (nodes, end) = (solver.positions(), solver.start_state());
    let left_out = LeftOut {
        nodes: prepared.left_out.len(),
        of_nodes: nodes.len(),
        border_mm: border_motion_mm(&prepared.mesh, &prepared.left_out, &nodes),
    };
    warnings.extend(left_out.warning(settings.leave_out_below_mm));
    control.report(1.0);
    let (attached, attachment) = (prepared.attached.clone(), prepared.mesh.attachment.clone());
    Ok(Outcome { steps, regions, face, nodes, attachment, end, left_out, attached, warnings })
}

/// Refuses a run that `prepared` is not for.
fn check_prepared(
    prepared: &PreparedTissue,
    bone: &CutBone,
    plan: &Plan,
    settings: &RunSettings,
) -> Result<(), SimulateError> {
    let fault =
        |what: &str, detail: &str| Err(PlanError::Value { what: what.to_owned(), detail: detail.to_owned() }.into());
    if settings.steps == 0 {
        return fault("steps", "is 0, at least 1 is needed");
    }
    if moving_segments(bone, plan)? != prepared.moving {
        return fault("paths", "move other segments than the equations were prepared for; prepare them again");
    }
    if displacement_class_mm(bone, plan) != prepared.displacement_mm {
        return fault(
            "paths",
            "move bone by another distance than the equations were prepared for; prepare them again",
        );
    }
    Ok(())
}

/// Brings the solver to the start of the request; returns the motions from rest after a warm start.
fn start(
    solver: &mut Solver<'_>,
    PathStart { warm_start, resume, .. }: PathStart<'_>,
) -> Result<Option<Vec<(u32, MotionNumbers)>>, SimulateError> {
    match (resume, warm_start) {
        (Some(checkpoint), _) => {
            solver.restore(&checkpoint.solver)?;
            Ok(checkpoint.begin.clone())
        }
        (None, Some(state)) => {
            solver.start_from(state)?;
            Ok(Some(state.motions().iter().map(|(segment, m)| (*segment, motion_numbers(m))).collect()))
        }
        (None, None) => Ok(None),
    }
}

impl LeftOut {
    /// Warning about tissue beside the left-out part that moves too far for the estimate, `below_mm`.
    fn warning(&self, below_mm: f64) -> Option<Warning> {
        if self.border_mm <= (WARN_BORDER * below_mm).min(WARN_BORDER_MM) {
            return None;
        }
        let message = format!(
            "beside tissue that was left out because the plan was estimated to move it by less than {below_mm} mm, tissue moves \
             by {:.2} mm",
            self.border_mm
        );
        Some(if self.border_mm <= MAX_BORDER_MM {
            Warning::info("left-out-moves", message)
        } else {
            Warning::check("left-out-moves", message).act("Solve again with a smaller `leave_out_below_mm`.")
        })
    }
}

/// Largest displacement of a node that shares a cell with one that was `left_out`, mm.
fn border_motion_mm(mesh: &MixedMesh, left_out: &[u32], nodes: &[Point]) -> f64 {
    let mut beyond = vec![false; nodes.len()];
    left_out.iter().for_each(|node| beyond[*node as usize] = true);
    let cells = mesh.tetrahedra.iter().map(<[u32; 4]>::as_slice).chain(mesh.prisms.iter().map(<[u32; 6]>::as_slice));
    let border = cells.filter(|cell| cell.iter().any(|n| beyond[*n as usize])).flatten();
    let free = border.filter(|n| !matches!(mesh.attachment[**n as usize], Attachment::Tied(_) | Attachment::Fixed));
    free.map(|n| (nodes[*n as usize] - mesh.positions[*n as usize]).norm()).fold(0.0, f64::max)
}

fn moving_segments(bone: &CutBone, plan: &Plan) -> Result<Vec<u32>, PlanError> {
    let moving: Vec<u32> = plan.paths.iter().map(crate::plan::Path::segment).collect();
    let known = |id: u32| id != 0 && bone.osteotomy.segments.iter().any(|s| s.id == id);
    match moving.iter().position(|&id| !known(id)) {
        Some(index) => Err(PlanError::Value {
            what: format!("paths[{index}].segment"),
            detail: format!("segment {} cannot move: it does not exist or is the skull", moving[index]),
        }),
        None => Ok(moving),
    }
}

fn frame(
    skin: &TriMesh,
    displacements: &[Vector],
    k: usize,
    t: f64,
    report: StepReport,
) -> Result<Frame, SimulateError> {
    let moved = skin.positions().iter().zip(displacements).map(|(p, u)| p + u).collect();
    let skin = skin
        .with_positions(moved)
        .map_err(|e| SimulateError::Anatomy { detail: format!("the deformed skin is not usable: {e}") })?;
    let displacement_mm = displacements.iter().map(|u| u.norm() as f32).collect();
    Ok(Frame { k, t, skin, displacement_mm, report })
}

/// Area-weighted mean movement of the skin in `region`; `None` when it holds no vertex.
fn region_motion(skin: &TriMesh, displacements: &[Vector], region: &FaceRegion) -> Option<RegionMotion> {
    let mut weight = 0.0;
    let mut sum = Vector::zeros();
    for (triangle, corners) in skin.triangles().iter().enumerate() {
        let third = skin.scaled_normal(triangle).norm() / 6.0;
        for &v in corners {
            if region.contains(&skin.positions()[v as usize]) {
                weight += third;
                sum += displacements[v as usize] * third;
            }
        }
    }
    (weight > 0.0).then(|| {
        let mean = sum / weight;
        RegionMotion { name: region.name, forward_mm: -mean.y, down_mm: -mean.z, left_mm: mean.x }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use prosopon_geometry::Severity;

    #[test]
    fn left_out_tissue_that_moves_is_reported_by_how_far() {
        let warning = |border_mm| LeftOut { nodes: 1, of_nodes: 9, border_mm }.warning(LEAVE_OUT_BELOW_MM);
        assert_eq!(warning(0.1), None);
        let severity = |border_mm| warning(border_mm).map(|w| (w.code, w.severity));
        assert_eq!(severity(0.32), Some(("left-out-moves", Severity::Info)));
        assert_eq!(severity(0.7), Some(("left-out-moves", Severity::Check)));
    }
}
