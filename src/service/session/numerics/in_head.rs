//! Cuts, solves and comparisons in the frame of the head.

use super::Numerics;
use crate::framed::{Framed, WatchBack};
use crate::path_solve::{PathSolve, Ready, solve_path};
use crate::{Case, Engine, Kept, Run, RunWatch, TissueRequest};
use prosopon_contract::{Cuts, Fault, FaultKind, Halt};
use prosopon_geometry::control::Control;
use prosopon_geometry::{TriMesh, Vector, Warning};
use prosopon_planning::evaluate;
use prosopon_planning::plan::{self, Clearance, Cut, Osteotomy, Path, PlanError, TemplateCuts};
use prosopon_planning::simulate::{self, Outcome};

impl Numerics {
    /// The osteotomy of a request in the frame of the head, and how near its cuts come to what it protects.
    pub(super) fn cut_of(
        &self,
        case: &Case,
        cuts: &Cuts,
        control: &Control,
    ) -> Result<(Osteotomy, Vec<Clearance>), Halt> {
        let (templates, all) = self.placed(case, cuts, &control.stage(0.0, 0.5))?;
        let cut = self.osteotomy_of(case, &all, &control.stage(0.5, 1.0));
        let mut osteotomy = Osteotomy::clone(&*cut.map_err(|halt| given_cuts(halt, &templates))?);
        let warnings = templates.warnings(&osteotomy);
        osteotomy.warnings.extend(warnings.into_iter().chain(cuts.warnings.iter().cloned()));
        let clearances = plan::clearances(&osteotomy, &cuts.protected)?;
        for near in &clearances {
            let Some(protected) = cuts.protected.get(near.protected) else { continue };
            if let Some(margin) = protected.margin_mm.filter(|m| near.distance_mm < *m) {
                let message = format!(
                    "{} comes within {:.1} mm of {}, less than its margin of {margin:.1} mm",
                    osteotomy.cuts.get(near.cut).map_or_else(String::new, |cut| cut.label(near.cut)),
                    near.distance_mm,
                    protected.name
                );
                osteotomy
                    .warnings
                    .push(Warning::check("below-margin", message).act("Move the cut or accept the distance."));
            }
        }
        Ok((osteotomy, clearances))
    }

    /// The cuts of a request in the frame of the head, with warnings about where they are.
    pub(super) fn place_of(
        &self,
        case: &Case,
        cuts: &Cuts,
        control: &Control,
    ) -> Result<(Vec<Cut>, Vec<Warning>), Halt> {
        let (templates, all) = self.placed(case, cuts, control)?;
        let mut warnings = cuts.warnings.clone();
        warnings.extend(templates.placing_warnings());
        let bone = self.envelope_of(case, control)?;
        match plan::try_cuts(&bone, &all, control) {
            Ok(()) => {}
            Err(fault @ PlanError::MissesBone { .. }) => {
                warnings.push(Warning::check("cut-misses-bone", fault.to_string()).act("Move or enlarge the cut."));
            }
            Err(fault @ PlanError::NotParted { .. }) => {
                warnings.push(Warning::check("bone-not-parted", fault.to_string()).act("Move or enlarge the cuts."));
            }
            Err(fault) => return Err(fault.into()),
        }
        Ok((all, warnings))
    }

    /// Solves along the plan in the frame of the head, and reports to `watch` in LPS; `own` is the patient's skin in LPS.
    pub(super) fn solve_of(
        &self,
        framed: &Framed,
        run: &Run,
        own: &TriMesh,
        control: &Control,
        watch: &mut dyn RunWatch,
    ) -> Result<Outcome, Halt> {
        // Measured on a head: rebuilding field and mesh takes about as long as a quarter of the path.
        let shares = if self.has(Kept::Tissue, &run.tissue.key) { [0.0, 0.02, 0.03] } else { [0.1, 0.15, 0.25] };
        watch.stage("field");
        self.fields_of(&run.case, &control.stage(0.0, shares[0]))?;
        watch.stage("cut");
        let bone = self.bone_of(&run.case, &run.cuts, &control.stage(shares[0], shares[1]))?;
        watch.stage("mesh");
        let tissue = self.tissue_of(&run.case, &run.tissue, &control.stage(shares[1], shares[2]))?;
        let rest = tissue.skin(&run.case.anatomy);
        let own = framed.rest_back(rest, own);
        let watch = &mut WatchBack { framed, rest: [rest, &own], watch };
        watch.mesh(&tissue.report);
        let is_chosen = run.tissue.cuts.is_some() && run.tissue.settings.region.is_none();
        if !is_chosen {
            let moving: Vec<u32> = run.plan.paths.iter().map(Path::segment).collect();
            let lacks = simulate::region_warning(&run.case.anatomy, &bone, &moving, &run.tissue.settings);
            lacks.into_iter().for_each(|warning| watch.warning(warning));
        }
        simulate::globe_warnings(&tissue, &bone, &run.plan).into_iter().for_each(|warning| watch.warning(warning));
        // Before the solve, so that they are there when it fails.
        let solver = &run.settings.solver;
        let materials = [solver.stiffness_warnings(&tissue.mesh), solver.stability_warnings(&tissue.mesh)];
        materials.into_iter().flatten().for_each(|warning| watch.warning(warning));
        watch.stage("solve");
        let ready = Ready { run, bone: &bone, tissue: &tissue };
        let control = control.stage(shares[2], 1.0);
        let last = PathSolve {
            plan: &run.plan,
            steps: run.settings.steps,
            after: run.after.as_deref(),
            checkpoint: run.checkpoint.as_ref(),
        };
        solve_path(&self.recent, &ready, last, &control, &mut |frame, checkpoint| watch.frame(frame, checkpoint))
    }

    /// As [`Engine::distance_to_mesh`], in the frame of the head; `rest` and `moved` are the skins of the run.
    pub(super) fn distance_to_mesh_of(
        &self,
        run: &Run,
        [rest, moved]: [&TriMesh; 2],
        other: &TissueRequest,
        control: &Control,
    ) -> Result<Option<f64>, Halt> {
        let case = &run.case;
        let unknown = |detail: &str| Halt::from(Fault::new(FaultKind::Internal, detail));
        let bone = self.bone_of(case, &run.cuts, &control.stage(0.0, 0.1))?;
        let tissue = self.tissue_of(case, other, &control.stage(0.1, 0.3))?;
        let mut last = None;
        let control = control.stage(0.3, 1.0);
        let anatomy = &case.anatomy;
        // Not through the cache, which keeps the equations of the mesh that the next plan will use.
        simulate::solve(anatomy, &tissue, &bone, &run.plan, &run.settings, &control, &mut |f| last = Some(f.skin))?;
        let other = last.ok_or_else(|| unknown("the other mesh has no step"))?;
        let count = rest.positions().len();
        if [moved, &other].iter().any(|skin| skin.positions().len() != count) {
            return Err(unknown("the lips part differently on the two meshes"));
        }
        let displacements = |skin: &TriMesh| -> Vec<Vector> {
            skin.positions().iter().zip(rest.positions()).map(|(a, b)| a - b).collect()
        };
        let regions = evaluate::face_regions(&anatomy.skin, &anatomy.landmarks, case.midline_x_mm).regions;
        let found = evaluate::between_solutions(rest, &regions, &displacements(moved), &displacements(&other));
        Ok(found.map(|statistics| statistics.p95))
    }
}

/// Maps pointers to the request's own cuts, which come after those of its templates.
fn given_cuts(halt: Halt, templates: &TemplateCuts) -> Halt {
    match halt {
        Halt::Cancelled => Halt::Cancelled,
        Halt::Fault(mut fault) => {
            for field in &mut fault.errors {
                let Some(rest) = field.pointer.strip_prefix("/cuts/") else { continue };
                let (number, below) = rest.split_once('/').map_or((rest, String::new()), |(n, b)| (n, format!("/{b}")));
                let Ok(number) = number.parse::<usize>() else { continue };
                field.pointer = match number.checked_sub(templates.cuts.len()) {
                    Some(own) => format!("/cuts/{own}{below}"),
                    None => "/templates".to_owned(),
                };
            }
            let ranges = templates.ranges();
            if fault.kind == FaultKind::BoneNotParted && !ranges.is_empty() {
                fault.detail = format!("{} (cuts {})", fault.detail, ranges.join(", "));
            }
            Halt::Fault(fault)
        }
    }
}
