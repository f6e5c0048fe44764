//! Answers to requests in LPS: each goes into the frame of the head and back.

use std::sync::Arc;

use super::{FIELDS, Numerics, TISSUES};
use crate::clinical::{clinical_of, moved_bones};
use crate::kept;
use crate::scene::{bone_fields, solve_scene};
use crate::tissue_file::tissue_file;
use crate::{
    Case, Engine, Kept, OtherSurface, Run, RunWatch, SceneBones, SceneRun, SceneSolved, TissueRequest, key_of,
};
use prosopon_contract::{Cuts, Fault, FaultKind, Halt, Solid, import_fault};
use prosopon_field::{CheckedDistance, ExactDistance, FieldReport, SignedField};
use prosopon_formats::import;
use prosopon_geometry::control::Control;
use prosopon_geometry::{Implicit, Motion, Point, TriMesh, Vector, Warning};
use prosopon_planning::evaluate::{self, Clinical, ErrorMap, FaceRegion, GivenLandmarks, HeadFrame, Registration};
use prosopon_planning::plan::{self, Clearance, Cut, Osteotomy, PathReport, Plan, Proposal};
use prosopon_planning::simulate::{Fields, Mouth, Outcome, TissueModel};
use prosopon_planning::surface::{self, CtSettings, CtSurfaces};
use prosopon_tissue::mesh::MeshReport;

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
        let cuts_back = framed.cuts_back(&osteotomy.cuts, &cuts.cuts);
        osteotomy = Osteotomy { cuts: cuts_back, ..framed.osteotomy_back(&osteotomy) };
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
        Ok((framed.cuts_back(&all, &cuts.cuts), warnings))
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
        framed.halt_back(clinical_of(&framed.case, &bones, [&skins[0], &skins[1]], &control.stage(0.5, 1.0)))
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
