use std::collections::BTreeSet;

use super::{Landmarks, Template};
use crate::plan::propose::{Proposal, propose, propose_by_proportions};
use crate::plan::{Cut, CutShape, Osteotomy, PlanError, Purpose};
use prosopon_field::Envelope;
use prosopon_geometry::TriMesh;

/// A template asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateCall {
    /// Which one.
    pub template: Template,
    /// What it goes by; what is absent is proposed from the surfaces.
    pub landmarks: Landmarks,
    /// Width of the saw's slot, mm.
    pub kerf_mm: f64,
}

/// The cuts of several templates on one bone, each cut once.
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
pub struct TemplateFault {
    /// Its place among the calls.
    pub index: usize,
    /// Why.
    pub error: PlanError,
}

impl TemplateCuts {
    /// Places the cuts of `calls` on the envelope `bone` of a head with this skin and skull.
    ///
    /// # Errors
    /// [`TemplateFault`] of the first template that lacks landmarks or misses the bone.
    pub fn place(
        calls: &[TemplateCall],
        skin: &TriMesh,
        skull: &TriMesh,
        bone: &Envelope,
    ) -> Result<Self, TemplateFault> {
        let mut merged = Self::default();
        let mut proposal = None;
        // One head has one Le Fort I plane, whichever template's request names it.
        let plane = calls.iter().find_map(|call| call.landmarks.le_fort_1_plane);
        for (index, call) in calls.iter().enumerate() {
            let (template, mut landmarks) = (call.template, call.landmarks.clone());
            landmarks.le_fort_1_plane = landmarks.le_fort_1_plane.or(plane);
            merged.proposed.extend(propose_missing(template, &mut landmarks, skin, skull, &mut proposal));
            let placed = template.cuts(&landmarks, bone).map_err(|error| TemplateFault { index, error })?;
            merged.add(call, placed);
        }
        Ok(merged)
    }

    fn add(&mut self, call: &TemplateCall, placed: Vec<Cut>) {
        let begin = self.cuts.len();
        // Two templates may tell the same bones apart.
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

    /// Which saw cuts are whose, in words.
    #[must_use]
    pub fn ranges(&self) -> Vec<String> {
        let range = |(template, saws): &(Template, Vec<usize>)| {
            let (first, last, name) = (saws.first()?, saws.last()?, template.name());
            Some(if first == last {
                format!("cut {first} is of {name}")
            } else {
                format!("cuts {first} to {last} are of {name}")
            })
        };
        self.saws.iter().filter_map(range).collect()
    }

    /// What is doubtful about the templates of `osteotomy`, which begins with these cuts.
    #[must_use]
    pub fn warnings(&self, osteotomy: &Osteotomy) -> Vec<String> {
        let parts = |saws: &[usize]| {
            osteotomy.segments.iter().any(|s| s.id != 0 && s.bounded_by.iter().any(|cut| saws.contains(cut)))
        };
        let idle = self.saws.iter().filter(|(_, saws)| !saws.is_empty() && !parts(saws));
        let mut warnings: Vec<String> = idle
            .map(|(template, _)| {
                format!(
                    "the template {} parts nothing: there is no segment at its cuts; look at its landmarks, and whether the bone is in the scan",
                    template.name()
                )
            })
            .collect();
        warnings.extend(self.steps());
        if !self.proposed.is_empty() {
            let names: Vec<&str> = self.proposed.iter().map(String::as_str).collect();
            warnings.push(format!(
                "no landmarks were given for {}: they were proposed from the surfaces and need to be checked",
                names.join(", ")
            ));
        }
        warnings
    }
}

impl TemplateCuts {
    /// What to tell of a Le Fort I cut whose sides lie lower than its middle.
    fn steps(&self) -> Option<String> {
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
            .map(|(name, z)| format!("{} at z = {z:.0} mm", name.trim_start_matches("le_fort_1_")))
            .collect();
        (!sides.is_empty()).then(|| {
            format!(
                "the Le Fort I cut steps down beside the nose so that it stays below the cheek bones: its middle lies at z = {middle:.0} mm, its sides {}; \
                 moving the plane up moves the middle alone",
                sides.join(", ")
            )
        })
    }
}

/// Fills in what a template lacks, from the surfaces; names of what was filled of what it needs.
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
        // No nasal aperture in the bone: an adult's usual distances below the tip of the nose.
        let guess = propose_by_proportions(skin);
        landmarks.le_fort_1_plane.get_or_insert(guess.le_fort_1_plane);
        landmarks.occlusal_z_mm.get_or_insert(guess.occlusal_plane_z_mm);
        filled.extend(["le_fort_1_plane", "occlusal_plane_z_mm"].map(str::to_owned));
    }
    filled.retain(|name| template.needs().contains(&name.as_str()));
    filled
}
