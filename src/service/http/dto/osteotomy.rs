use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use prosopon_contract::{CutDocument, Findings, OsteotomyDocument, TemplateName};
use prosopon_planning::plan::Template;
use prosopon_store::OsteotomyRecord;

/// A stored osteotomy: its cuts and the segments they make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyView {
    /// Id of the osteotomy.
    pub id: Uuid,
    /// When the osteotomy was created (RFC 3339).
    pub created_at: String,
    /// Computing time of the cut, s.
    pub wall_s: f64,
    /// Whether bone or field settings have changed since the cut; if so, cut again.
    pub stale: bool,
    /// Cuts, segments and warnings.
    #[serde(flatten)]
    pub content: OsteotomyDocument,
}

impl OsteotomyView {
    pub(in crate::http) fn new(record: &OsteotomyRecord, content: OsteotomyDocument, field_key: Option<&str>) -> Self {
        Self {
            id: record.id.uuid(),
            created_at: record.created_at.clone(),
            wall_s: record.wall_s,
            stale: field_key != Some(record.field_key.as_str()),
            content,
        }
    }
}

/// All osteotomies of a session, oldest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyList {
    /// The session's osteotomies.
    pub osteotomies: Vec<OsteotomyView>,
}

/// The cuts that a request for an osteotomy would make.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OsteotomyPreview {
    /// The cuts of the templates, then those of the request: a request with these `cuts` and no template cuts the same.
    pub cuts: Vec<CutDocument>,
    /// Warnings about where the cuts are.
    #[serde(flatten)]
    pub findings: Findings,
}

/// A template and its landmarks.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TemplateView {
    /// Name of the template.
    pub name: TemplateName,
    /// Landmarks without which it cannot place its cuts: names of points, or `midline_x_mm`, `occlusal_plane_z_mm`, `le_fort_1_plane`.
    pub needs: Vec<String>,
    /// Points that improve its cuts where they are there.
    pub improved_by: Vec<String>,
}

/// All templates.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TemplateList {
    /// The templates.
    pub templates: Vec<TemplateView>,
}

impl TemplateList {
    /// Every template.
    #[must_use]
    pub fn all() -> Self {
        let names = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
        let view =
            |t: Template| TemplateView { name: t.into(), needs: names(t.needs()), improved_by: names(t.improved_by()) };
        Self { templates: Template::ALL.map(view).into() }
    }
}
