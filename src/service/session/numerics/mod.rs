//! The numerics of the service: what is built is kept in memory. All of it lies in the frame of the head.

mod answers;
mod in_head;

use std::fmt;
use std::sync::Arc;

use super::framed::Framed;
use super::keys::bone_key;
use super::recent::Recent;
use super::{Case, TissueRequest};
use prosopon_contract::{Cuts, Halt};
use prosopon_field::{Envelope, envelope};
use prosopon_formats::import::Limits;
use prosopon_geometry::TriMesh;
use prosopon_geometry::control::Control;
use prosopon_planning::evaluate::{self, FrameBasis, HeadFrame};
use prosopon_planning::plan::{self, Cut, Landmarks, Osteotomy, TemplateCuts, TemplateError};
use prosopon_planning::simulate::{self, CutBone, Fields, SimulateError, TissueModel};

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
