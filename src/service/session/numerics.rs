use std::fmt;
use std::sync::Arc;

use super::clinical::{clinical_of, moved_bones};
use super::framed::{Framed, WatchBack};
use super::kept;
use super::keys::bone_key;
use super::path_solve::{PathSolve, Ready, solve_path};
use super::recent::Recent;
use super::scene::{bone_fields, solve_scene};
use super::tissue_file::tissue_file;
use super::{
    Case, Engine, Kept, OtherSurface, Run, RunWatch, SceneBones, SceneRun, SceneSolved, TissueRequest, key_of,
};
use prosopon_contract::{Cuts, Fault, FaultKind, Halt, Solid, import_fault};
use prosopon_field::{CheckedDistance, Envelope, ExactDistance, FieldReport, SignedField, envelope};
use prosopon_formats::import::{self, Limits};
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector, Warning};
use prosopon_planning::evaluate::{
    self, Clinical, ErrorMap, FaceRegion, FrameBasis, GivenLandmarks, HeadFrame, Registration,
};
use prosopon_planning::plan::{
    self, Clearance, Cut, Landmarks, Osteotomy, Path, PathReport, Plan, PlanError, Proposal, TemplateCuts,
    TemplateError,
};
use prosopon_planning::simulate::{self, CutBone, Fields, Mouth, Outcome, SimulateError, TissueModel};
use prosopon_planning::surface::{self, CtSettings, CtSurfaces};
use prosopon_tissue::mesh::MeshReport;

/// Default memory for intermediate results: 1.5 GiB.
const CACHE_BYTES: u64 = 1536 << 20;
/// Kinds of intermediate results in the cache.
const FRAMES: &str = "frame";
const ENVELOPES: &str = "envelope";
const FIELDS: &str = "field";
const OSTEOTOMIES: &str = "osteotomy";
const BONES: &str = "bone";
const TISSUES: &str = "mesh";
/// Memory of a mesh for each node, with its share of elements and of the embedding, bytes.
const MESH_BYTES: u64 = 1_000;

/// The numerics of the service, with the most recently used intermediate results in memory.
pub struct Numerics {
    limits: Limits,
    recent: Recent,
}

impl fmt::Debug for Numerics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Numerics").field("limits", &self.limits).finish_non_exhaustive()
    }
}

impl Numerics {
    /// Numerics that refuse inputs above `limits`.
    #[must_use]
    pub fn new(limits: Limits) -> Self {
        Self { limits, recent: Recent::new(CACHE_BYTES) }
    }

    /// The same numerics with `bytes` of memory for intermediate results.
    #[must_use]
    pub fn with_cache_bytes(self, bytes: u64) -> Self {
        Self { recent: Recent::new(bytes), ..self }
    }

    /// The frame of the head in the case.
    fn frame_of(&self, case: &Case, control: &Control) -> Result<Arc<HeadFrame>, Halt> {
        if let Some(from_scan) = case.frame {
            return Ok(Arc::new(HeadFrame { from_scan, basis: FrameBasis::Given, ..HeadFrame::of_scanner() }));
        }
        if let Some(found) = self.recent.get(FRAMES, &case.key) {
            return Ok(found);
        }
        let found = Arc::new(evaluate::head_frame(&case.anatomy.skin, &case.anatomy.skull, control)?);
        self.recent.put(FRAMES, &case.key, Arc::clone(&found), size_of::<HeadFrame>() as u64);
        Ok(found)
    }

    /// The case in the frame of its head.
    fn framed(&self, case: &Case, control: &Control) -> Result<Framed, Halt> {
        Ok(Framed::new(case, self.frame_of(case, control)?.from_scan))
    }

    /// The outer envelope of the bone; a cut needs nothing else.
    fn envelope_of(&self, case: &Case, control: &Control) -> Result<Arc<Envelope>, Halt> {
        if let Some(found) = self.recent.get(ENVELOPES, &case.key) {
            return Ok(found);
        }
        let built = envelope(&case.anatomy.skull, &case.fields.envelope, control).map_err(SimulateError::from)?;
        Ok(self.keep_envelope(&case.key, Arc::new(built)))
    }

    fn keep_envelope(&self, key: &str, built: Arc<Envelope>) -> Arc<Envelope> {
        let bytes = surface_bytes(&built.surface);
        self.recent.put(ENVELOPES, key, Arc::clone(&built), bytes);
        built
    }

    fn fields_of(&self, case: &Case, control: &Control) -> Result<Arc<Fields>, Halt> {
        if let Some(found) = self.recent.get(FIELDS, &case.key) {
            return Ok(found);
        }
        let known = self.recent.get(ENVELOPES, &case.key);
        let built = simulate::build_fields_around(&case.anatomy, known, &case.fields, control)?;
        Ok(self.keep_fields(&case.key, built))
    }

    fn keep_fields(&self, key: &str, built: Fields) -> Arc<Fields> {
        let built = Arc::new(built);
        self.keep_envelope(key, Arc::clone(&built.bone));
        let of_fields = [Some(&built.skin), Some(&built.bone_field), built.air.as_ref()];
        let bytes = of_fields.into_iter().flatten().map(|f| f.bytes() as u64).sum::<u64>();
        self.recent.put(FIELDS, key, Arc::clone(&built), bytes);
        built
    }

    /// The cuts of the templates of a request, and all of its cuts: those of its templates, then its own.
    fn placed(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(TemplateCuts, Vec<Cut>), Halt> {
        let bone = self.envelope_of(case, control)?;
        let anatomy = &case.anatomy;
        let templates =
            TemplateCuts::place(&cuts.templates, &anatomy.skin, &anatomy.skull, &bone).map_err(template_fault)?;
        let all = templates.cuts.iter().chain(&cuts.cuts).map(Cut::rounded).collect();
        Ok((templates, all))
    }

    /// The osteotomy with the names of its segments.
    fn osteotomy_of(&self, case: &Case, cuts: &[Cut], control: &Control) -> Result<Arc<Osteotomy>, Halt> {
        let (midline_x_mm, occlusal_z_mm) = (case.midline_x_mm, case.occlusal_z_mm);
        let key = bone_key(case, cuts);
        if let Some(found) = self.recent.get(OSTEOTOMIES, &key) {
            return Ok(found);
        }
        let bone = self.envelope_of(case, &control.stage(0.0, 0.5))?;
        let mut cut = plan::cut(&bone, cuts, &control.stage(0.5, 1.0))?;
        plan::name_segments(&mut cut, &Landmarks { midline_x_mm, occlusal_z_mm, ..Landmarks::default() });
        let cut = Arc::new(cut);
        let bytes = cut.segments.iter().map(|s| surface_bytes(&s.surface)).sum::<u64>();
        self.recent.put(OSTEOTOMIES, &key, Arc::clone(&cut), bytes);
        Ok(cut)
    }

    fn bone_of(&self, case: &Case, cuts: &[Cut], control: &Control) -> Result<Arc<CutBone>, Halt> {
        let key = bone_key(case, cuts);
        if let Some(found) = self.recent.get(BONES, &key) {
            return Ok(found);
        }
        let osteotomy = self.osteotomy_of(case, cuts, &control.stage(0.0, 0.6))?;
        let built = simulate::segment_fields(&osteotomy, &case.fields.field, &control.stage(0.6, 1.0))?;
        let bone = Arc::new(built);
        let fields = bone.fields.iter().map(|f| f.bytes() as u64).sum::<u64>();
        let surfaces = bone.osteotomy.segments.iter().map(|s| surface_bytes(&s.surface)).sum::<u64>();
        self.recent.put(BONES, &key, Arc::clone(&bone), fields + surfaces);
        Ok(bone)
    }

    fn tissue_of(&self, case: &Case, request: &TissueRequest, control: &Control) -> Result<Arc<TissueModel>, Halt> {
        if let Some(found) = self.recent.get(TISSUES, &request.key) {
            return Ok(found);
        }
        let fields = self.fields_of(case, &control.stage(0.0, 0.3))?;
        let bone = match &request.cuts {
            Some(cuts) => Some(self.bone_of(case, cuts, &control.stage(0.3, 0.4))?),
            None => None,
        };
        let control = control.stage(0.4, 1.0);
        let built = simulate::build_tissue(&case.anatomy, &fields, bone.as_deref(), &request.settings, &control)?;
        Ok(self.keep_tissue(&request.key, built))
    }

    fn keep_tissue(&self, key: &str, built: TissueModel) -> Arc<TissueModel> {
        let built = Arc::new(built);
        let bytes = built.report.nodes as u64 * MESH_BYTES;
        self.recent.put(TISSUES, key, Arc::clone(&built), bytes);
        built
    }

    /// The osteotomy of a request in the frame of the head, and how near its cuts come to what it protects.
    fn cut_of(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Osteotomy, Vec<Clearance>), Halt> {
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
    fn place_of(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Vec<Cut>, Vec<Warning>), Halt> {
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

    /// Solves along the plan, all in the frame of the head but what `watch` is told; `own` is the skin at rest in LPS.
    fn solve_of(
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
    fn distance_to_mesh_of(
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

fn surface_bytes(surface: &TriMesh) -> u64 {
    (surface.positions().len() * 24 + surface.triangles().len() * 12) as u64
}

/// The fault of a template that cannot place its cuts, with the template's position in the request.
fn template_fault(TemplateError { index, error }: TemplateError) -> Halt {
    match Halt::from(error) {
        Halt::Cancelled => Halt::Cancelled,
        Halt::Fault(mut fault) => {
            for field in &mut fault.errors {
                field.pointer = format!("/templates/{index}{}", field.pointer);
            }
            Halt::Fault(fault)
        }
    }
}

/// Warnings about the landmarks by which templates are placed: those of the session, and those of the request in their place.
fn template_landmarks(case: &Case, cuts: &Cuts) -> Result<Vec<Warning>, Halt> {
    let mut found = Vec::new();
    for call in &cuts.templates {
        let points: Vec<(String, Point)> = call.landmarks.points.iter().map(|(name, p)| (name.clone(), *p)).collect();
        let stays = |name: &&String| {
            case.anatomy.landmarks.iter().any(|(n, p)| n == *name && points.iter().any(|(m, q)| m == n && p == q))
        };
        let unconfirmed: Vec<String> = case.unconfirmed.iter().filter(stays).cloned().collect();
        let midline_x_mm = call.landmarks.midline_x_mm;
        let landmarks = GivenLandmarks { points: &points, unconfirmed: &unconfirmed, midline_x_mm };
        for warning in evaluate::check_landmarks(&landmarks, Some(&case.anatomy.skin), Some(&case.anatomy.skull))? {
            if !found.contains(&warning) {
                found.push(warning);
            }
        }
    }
    Ok(found)
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

impl Engine for Numerics {
    fn surfaces(&self, ct: &[u8], settings: &CtSettings, control: &Control) -> Result<CtSurfaces, Halt> {
        let (volume, warnings) =
            import::volume(ct, &self.limits).map_err(|e| import_fault(&e, FaultKind::VolumeNotUsable))?;
        control.check()?;
        let mut surfaces = surface::from_ct(&volume, settings, control)?;
        surfaces.warnings.splice(0..0, warnings);
        Ok(surfaces)
    }

    fn fields(&self, case: &Case, control: &Control) -> Result<(FieldReport, FieldReport, Vec<Warning>), Halt> {
        let framed = self.framed(case, &control.stage(0.0, 0.1))?;
        let fields = framed.halt_back(self.fields_of(&framed.case, &control.stage(0.1, 1.0)))?;
        let warnings = framed.warnings_back(fields.warnings.clone());
        Ok((framed.field_back(&fields.skin_report), framed.field_back(&fields.bone_report), warnings))
    }

    fn distances(
        &self,
        case: &Case,
        solid: Solid,
        points: &[Point],
        control: &Control,
    ) -> Result<Vec<(f64, Vector)>, Halt> {
        let framed = self.framed(case, control)?;
        let fields = self.fields_of(&framed.case, control)?;
        let field = match solid {
            Solid::Skin => &fields.skin,
            Solid::Bone => &fields.bone_field,
        };
        let at = |p| {
            let (value, gradient) = field.value_gradient(&framed.point(p));
            (value, framed.direction_back(&gradient))
        };
        Ok(points.iter().map(at).collect())
    }

    fn nearest(
        &self,
        case: &Case,
        solid: Solid,
        points: &[Point],
        control: &Control,
    ) -> Result<Vec<CheckedDistance>, Halt> {
        let framed = self.framed(case, control)?;
        let fields = self.fields_of(&framed.case, control)?;
        let (field, surface) = match solid {
            Solid::Skin => (&fields.skin, &framed.case.anatomy.skin),
            Solid::Bone => (&fields.bone_field, &fields.bone.surface),
        };
        let exact = ExactDistance::new(surface);
        control.check()?;
        let at = |p| {
            let found = field.distance_with_checked_sign(&exact, &framed.point(p));
            let (gradient, closest) = (framed.direction_back(&found.gradient), framed.point_back(&found.closest));
            CheckedDistance { gradient, closest, ..found }
        };
        Ok(points.iter().map(at).collect())
    }

    fn cut(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Osteotomy, Vec<Clearance>), Halt> {
        let framed = self.framed(case, &control.stage(0.0, 0.2))?;
        let control = control.stage(0.2, 1.0);
        let (mut osteotomy, clearances) =
            framed.halt_back(self.cut_of(&framed.case, &framed.request(cuts), &control))?;
        osteotomy = framed.osteotomy_back(&osteotomy);
        osteotomy.warnings.extend(template_landmarks(case, cuts)?);
        osteotomy.warnings.extend(self.frame_of(case, &control)?.warnings.clone());
        Ok((osteotomy, framed.clearances_back(clearances)))
    }

    fn place(&self, case: &Case, cuts: &Cuts, control: &Control) -> Result<(Vec<Cut>, Vec<Warning>), Halt> {
        let framed = self.framed(case, control)?;
        let (all, found) = framed.halt_back(self.place_of(&framed.case, &framed.request(cuts), control))?;
        let mut warnings = framed.warnings_back(found);
        warnings.extend(template_landmarks(case, cuts)?);
        warnings.extend(self.frame_of(case, control)?.warnings.clone());
        Ok((framed.cuts_back(&all), warnings))
    }

    fn check_landmarks(
        &self,
        landmarks: &GivenLandmarks<'_>,
        skin: Option<&TriMesh>,
        skull: Option<&TriMesh>,
    ) -> Result<Vec<Warning>, Halt> {
        Ok(evaluate::check_landmarks(landmarks, skin, skull)?)
    }

    fn check_surfaces(&self, skin: &TriMesh, other: &OtherSurface<'_>) -> Result<Option<Warning>, Halt> {
        let names = ["skin", other.name];
        Ok(if other.is_bone {
            evaluate::check_skin_and_bone(skin, other.mesh, names)?
        } else {
            evaluate::check_two_skins(skin, other.mesh, names)?
        })
    }

    fn frame(&self, case: &Case, control: &Control) -> Result<HeadFrame, Halt> {
        Ok(HeadFrame::clone(&*self.frame_of(case, control)?))
    }

    fn propose(&self, case: &Case, control: &Control) -> Result<Proposal, Halt> {
        let framed = self.framed(case, control)?;
        let anatomy = &framed.case.anatomy;
        Ok(framed.proposal_back(&plan::propose(&anatomy.skin, &anatomy.skull)))
    }

    fn outline(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt> {
        let framed = self.framed(case, control)?;
        let osteotomy = framed.halt_back(self.osteotomy_of(&framed.case, &framed.cuts(cuts), control))?;
        let reports = plan::outline(&osteotomy, &framed.plan(plan)).map_err(Halt::from);
        Ok(framed.paths_back(framed.halt_back(reports)?))
    }

    fn follow(&self, case: &Case, cuts: &[Cut], plan: &Plan, control: &Control) -> Result<Vec<PathReport>, Halt> {
        let framed = self.framed(case, control)?;
        let cut = self.osteotomy_of(&framed.case, &framed.cuts(cuts), &control.stage(0.0, 0.5));
        let osteotomy = framed.halt_back(cut)?;
        let reports = plan::follow(&osteotomy, &framed.plan(plan), &control.stage(0.5, 1.0)).map_err(Halt::from);
        Ok(framed.paths_back(framed.halt_back(reports)?))
    }

    fn tissue(&self, case: &Case, request: &TissueRequest, control: &Control) -> Result<MeshReport, Halt> {
        let framed = self.framed(case, control)?;
        let tissue = framed.halt_back(self.tissue_of(&framed.case, &framed.tissue(request), control))?;
        Ok(framed.mesh_back(&tissue.report))
    }

    fn has(&self, kept: Kept, key: &str) -> bool {
        let kind = match kept {
            Kept::Fields => FIELDS,
            Kept::Tissue => TISSUES,
        };
        self.recent.contains(kind, key)
    }

    fn bytes_of(&self, kept: Kept, key: &str) -> Option<Vec<u8>> {
        match kept {
            Kept::Fields => {
                let fields: Arc<Fields> = self.recent.get(FIELDS, key)?;
                matches!(fields.bone_field, SignedField::Adaptive(_)).then(|| kept::to_bytes(kept, key, &*fields))?
            }
            Kept::Tissue => {
                self.recent.get::<TissueModel>(TISSUES, key).and_then(|tissue| kept::to_bytes(kept, key, &*tissue))
            }
        }
    }

    fn recall(&self, kept: Kept, key: &str, bytes: &[u8]) -> bool {
        match kept {
            Kept::Fields => {
                kept::from_bytes(kept, key, bytes).map(|fields| drop(self.keep_fields(key, fields))).is_some()
            }
            Kept::Tissue => {
                kept::from_bytes(kept, key, bytes).map(|tissue| drop(self.keep_tissue(key, tissue))).is_some()
            }
        }
    }

    fn skin(&self, run: &Run, control: &Control) -> Result<TriMesh, Halt> {
        if run.tissue.settings.mouth == Mouth::Glued {
            return Ok(run.case.anatomy.skin.clone());
        }
        let framed = self.framed(&run.case, control)?;
        let tissue = framed.halt_back(self.tissue_of(&framed.case, &framed.tissue(&run.tissue), control))?;
        Ok(framed.rest_back(tissue.skin(&framed.case.anatomy), &run.case.anatomy.skin))
    }

    fn solve(&self, run: &Run, control: &Control, watch: &mut dyn RunWatch) -> Result<Outcome, Halt> {
        let framed = self.framed(&run.case, control)?;
        self.frame_of(&run.case, control)?.warnings.iter().for_each(|warning| watch.warning(warning.clone()));
        let own = &run.case.anatomy.skin;
        let solved = self.solve_of(&framed, &framed.run(run), own, control, watch);
        Ok(framed.outcome_back(&framed.halt_back(solved)?))
    }

    fn distance_to_mesh(
        &self,
        run: &Run,
        moved: &TriMesh,
        other: &TissueRequest,
        control: &Control,
    ) -> Result<Option<f64>, Halt> {
        let framed = self.framed(&run.case, control)?;
        let there = framed.run(run);
        let rest = self.skin(run, &control.without_progress())?;
        let skins = [framed.surface(&rest), framed.surface(moved)];
        framed.halt_back(self.distance_to_mesh_of(&there, [&skins[0], &skins[1]], &framed.tissue(other), control))
    }

    fn solve_scene(&self, run: &SceneRun, control: &Control, watch: &mut dyn RunWatch) -> Result<SceneSolved, Halt> {
        const FIELDS: f64 = 0.1;
        let before = control.stage(0.0, FIELDS);
        watch.stage("field");
        let (bones, warnings) = match &run.bones {
            SceneBones::Surfaces(surfaces) => bone_fields(surfaces, run, &before)?,
            SceneBones::Cut { case, cuts } => {
                watch.stage("cut");
                // The client's mesh lies in LPS, and so does its bone.
                let case = Case { key: key_of(&["scanner", &case.key]), ..Case::clone(case) };
                let bone = self.bone_of(&case, cuts, &before)?;
                let segments = bone.osteotomy.segments.iter().map(|s| s.id);
                (segments.zip(bone.fields.iter().cloned()).collect(), bone.osteotomy.warnings.clone())
            }
        };
        let mut solved = solve_scene(run, bones, &control.stage(FIELDS, 1.0), watch)?;
        solved.warnings.splice(0..0, warnings);
        Ok(solved)
    }

    fn tissue_file(&self, run: &Run, outcome: &Outcome, control: &Control) -> Result<Vec<u8>, Halt> {
        let framed = self.framed(&run.case, control)?;
        let tissue = framed.halt_back(self.tissue_of(&framed.case, &framed.tissue(&run.tissue), control))?;
        let mut mesh = tissue.mesh.clone();
        mesh.positions.iter_mut().for_each(|p| *p = framed.point_back(p));
        tissue_file(&mesh, outcome)
            .ok_or_else(|| Fault::new(FaultKind::Internal, "the deformed nodes are not those of the mesh").into())
    }

    fn clinical(&self, run: &Run, moved: &TriMesh, control: &Control) -> Result<Clinical, Halt> {
        let framed = self.framed(&run.case, control)?;
        let cut = self.osteotomy_of(&framed.case, &framed.cuts(&run.cuts), &control.stage(0.0, 0.5));
        let osteotomy = framed.halt_back(cut)?;
        let motions = framed.motions(&run.plan.motions(1.0));
        let rest = self.skin(run, &control.without_progress())?;
        let skins = [framed.surface(&rest), framed.surface(moved)];
        let bones = moved_bones(&osteotomy, &motions);
        let found = clinical_of(&framed.case, &bones, [&skins[0], &skins[1]], &control.stage(0.5, 1.0));
        Ok(framed.clinical_back(&framed.halt_back(found)?))
    }

    fn nearest_bone(
        &self,
        case: &Case,
        cuts: &[Cut],
        motions: &[(u32, Motion)],
        skin: &TriMesh,
        control: &Control,
    ) -> Result<Option<Vec<Vector>>, Halt> {
        let framed = self.framed(case, control)?;
        let cut = self.osteotomy_of(&framed.case, &framed.cuts(cuts), &control.stage(0.0, 0.5));
        let osteotomy = framed.halt_back(cut)?;
        let bones = moved_bones(&osteotomy, &framed.motions(motions));
        let found = evaluate::nearest_bone_displacement(&framed.surface(skin), &bones, &control.stage(0.5, 1.0))?;
        Ok(found.map(|all| all.iter().map(|u| framed.direction_back(u)).collect()))
    }

    fn regions(&self, case: &Case, control: &Control) -> Result<(Vec<FaceRegion>, bool), Halt> {
        let framed = self.framed(case, control)?;
        let Case { anatomy, midline_x_mm, .. } = &framed.case;
        let found = evaluate::face_regions(&anatomy.skin, &anatomy.landmarks, *midline_x_mm);
        Ok((framed.regions_back(&found.regions), found.from_landmarks))
    }

    fn error_map(
        &self,
        prediction: &TriMesh,
        reference: &TriMesh,
        mask: Option<&[bool]>,
        regions: &[FaceRegion],
        control: &Control,
    ) -> Result<ErrorMap, Halt> {
        Ok(evaluate::error_map(prediction, reference, mask, regions, control)?)
    }

    fn register(
        &self,
        source: &TriMesh,
        target: &TriMesh,
        unaltered: Option<&[bool]>,
        control: &Control,
    ) -> Result<Registration, Halt> {
        Ok(evaluate::register(source, target, unaltered, control)?)
    }
}
