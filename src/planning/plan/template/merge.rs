use std::collections::BTreeSet;

use super::{Landmarks, Template};
use crate::plan::propose::{Proposal, propose, propose_by_proportions};
use crate::plan::{Cut, CutShape, Osteotomy, PlanError, Purpose};
use prosopon_field::Envelope;
use prosopon_geometry::{TriMesh, Warning};

/// A request for the cuts of one template.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateCall {
    /// The template.
    pub template: Template,
    /// Landmarks that the caller gives; missing ones are proposed from the surfaces.
    pub landmarks: Landmarks,
    /// Kerf of the template's saw cuts, mm.
    pub kerf_mm: f64,
}

/// The cuts of several templates on one bone, without duplicates.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TemplateCuts {
    /// The cuts, in the order of the templates.
    pub cuts: Vec<Cut>,
    /// Each template with the indices of its own saw cuts.
    saws: Vec<(Template, Vec<usize>)>,
    /// Names of the landmarks that were proposed.
    proposed: BTreeSet<String>,
}

/// A template that cannot place its cuts.
#[derive(Debug)]
pub struct TemplateError {
    /// Index of the call.
    pub index: usize,
    /// Why the template cannot place its cuts.
    pub error: PlanError,
}

impl TemplateCuts {
    /// Places the cuts of `calls` on the envelope `bone` of a head with this skin and skull.
    ///
    /// # Errors
    /// [`TemplateError`] for the first template whose landmarks are missing or not arranged as in a head.
    pub fn place(
        calls: &[TemplateCall],
        skin: &TriMesh,
        skull: &TriMesh,
        bone: &Envelope,
    ) -> Result<Self, TemplateError> {
        let mut merged = Self::default();
        let mut proposal = None;
        // One head has one Le Fort I plane, whichever call gives it.
        let plane = calls.iter().find_map(|call| call.landmarks.le_fort_1_plane);
        for (index, call) in calls.iter().enumerate() {
            let (template, mut landmarks) = (call.template, call.landmarks.clone());
            landmarks.le_fort_1_plane = landmarks.le_fort_1_plane.or(plane);
            merged.proposed.extend(propose_missing(template, &mut landmarks, skin, skull, &mut proposal));
            let placed = template.cuts(&landmarks, bone).map_err(|error| TemplateError { index, error })?;
            merged.add(call, placed);
        }
        Ok(merged)
    }

    fn add(&mut self, call: &TemplateCall, placed: Vec<Cut>) {
        let begin = self.cuts.len();
        // Two templates may need the same separation, which is kept once.
        for mut cut in placed {
            if cut.purpose == Purpose::Osteotomy && !matches!(cut.shape, CutShape::FreePart(_)) {
                cut.kerf_mm = call.kerf_mm;
            }
            if !self.cuts.contains(&cut) {
                self.cuts.push(cut);
            }
        }
        let saws = (begin..self.cuts.len()).filter(|cut| self.cuts[*cut].purpose == Purpose::Osteotomy);
        self.saws.push((call.template, saws.collect()));
    }

    /// For each template with saw cuts, their indices and its name, for example `0 to 2: le_fort_1`.
    #[must_use]
    pub fn ranges(&self) -> Vec<String> {
        let range = |(template, saws): &(Template, Vec<usize>)| {
            let (first, last, name) = (saws.first()?, saws.last()?, template.name());
            Some(if first == last { format!("{first}: {name}") } else { format!("{first} to {last}: {name}") })
        };
        self.saws.iter().filter_map(range).collect()
    }

    /// Warnings about the templates in `osteotomy`, whose first cuts are these.
    #[must_use]
    pub fn warnings(&self, osteotomy: &Osteotomy) -> Vec<Warning> {
        let parts = |saws: &[usize]| {
            osteotomy.segments.iter().any(|s| s.id != 0 && s.bounded_by.iter().any(|cut| saws.contains(cut)))
        };
        let idle = self.saws.iter().filter(|(_, saws)| !saws.is_empty() && !parts(saws));
        let mut warnings: Vec<Warning> = idle
            .map(|(template, _)| {
                let message = format!("template {} parts nothing: its cuts bound no segment", template.name());
                Warning::check("template-idle", message).act("Check its landmarks and the bone in the scan.")
            })
            .collect();
        warnings.extend(self.placing_warnings());
        warnings
    }

    /// Warnings about where the cuts are, which need no cut bone.
    #[must_use]
    pub fn placing_warnings(&self) -> Vec<Warning> {
        let mut warnings: Vec<Warning> = self.steps().into_iter().collect();
        if !self.proposed.is_empty() {
            let names: Vec<&str> = self.proposed.iter().map(String::as_str).collect();
            let message = format!("landmarks that were not given are proposed from the surfaces: {}", names.join(", "));
            warnings.push(Warning::check("proposed-landmarks", message).act("Check these landmarks."));
        }
        warnings
    }
}

impl TemplateCuts {
    /// Warning about a Le Fort I cut whose sides lie lower than its middle.
    fn steps(&self) -> Option<Warning> {
        let level = |c: &Cut| {
            let CutShape::Plane(p) = &c.shape else { return None };
            let name = c.name.as_deref().filter(|name| name.starts_with("le_fort_1"))?;
            (p.normal.z.abs() > 0.7).then(|| (name.to_owned(), p.point.z))
        };
        let levels: Vec<(String, f64)> = self.cuts.iter().filter_map(level).collect();
        let (_, middle) = levels.iter().find(|(name, _)| name == "le_fort_1")?;
        let sides: Vec<String> = levels
            .iter()
            .filter(|(_, z)| (z - middle).abs() > 0.5)
            .map(|(name, z)| format!("{} by {:.0} mm", name.trim_start_matches("le_fort_1_"), middle - z))
            .collect();
        (!sides.is_empty()).then(|| {
            let message = format!(
                "the Le Fort I cut steps down beside the nose to stay below the cheek bones: its sides lie lower than its middle, {}",
                sides.join(", ")
            );
            Warning::info("le-fort-1-steps", message)
        })
    }
}

/// Fills missing landmarks from the surfaces; returns the names of those filled that the template needs.
fn propose_missing(
    template: Template,
    landmarks: &mut Landmarks,
    skin: &TriMesh,
    skull: &TriMesh,
    cached: &mut Option<Proposal>,
) -> Vec<String> {
    if landmarks.missing(template).is_empty() {
        return Vec::new();
    }
    let proposal = cached.get_or_insert_with(|| propose(skin, skull));
    let mut filled = proposal.fill(landmarks);
    if matches!(template, Template::LeFort1 | Template::TwoPieceMaxilla) && !landmarks.missing(template).is_empty() {
        // The bone shows no nasal aperture: an adult's usual distances below the tip of the nose are used.
        let guess = propose_by_proportions(skin);
        landmarks.le_fort_1_plane.get_or_insert(guess.le_fort_1_plane);
        landmarks.occlusal_z_mm.get_or_insert(guess.occlusal_plane_z_mm);
        filled.extend(["le_fort_1_plane", "occlusal_plane_z_mm"].map(str::to_owned));
    }
    filled.retain(|name| template.needs().contains(&name.as_str()));
    filled
}
