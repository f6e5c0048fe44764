use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::JobView;
use prosopon_contract::SessionSettings;
use prosopon_jobs::ImportRequest;
use prosopon_session::SessionParts;
use prosopon_store::{JobKind, JobRecord, JobState, PartKind, PartRecord, SessionRecord};

/// State of a part of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartState {
    /// Neither stored nor being made.
    Missing,
    /// A job makes it.
    Building,
    /// Stored.
    Ready,
    /// Stored, but its inputs have changed since it was made.
    Stale,
    /// A CT whose last import ended without surfaces; the import job gives the reason.
    Failed,
}

/// One part of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PartView {
    /// State of the part.
    pub state: PartState,
    /// Stored size, bytes.
    pub bytes: u64,
    /// Time that making the part took, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_s: Option<f64>,
    /// SHA-256 of an input's stored form, or key of the inputs from which a derived part was made.
    ///
    /// The SHA-256 of the upload itself is in a report's `origin`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// When the part was stored (RFC 3339).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub updated_at: Option<String>,
}

/// A session with the state of its parts, osteotomies, plans and jobs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SessionView {
    /// Id of the session.
    pub id: Uuid,
    /// Tag that the client gave.
    pub label: Option<String>,
    /// Default settings of the session's jobs.
    pub settings: SessionSettings,
    /// When the session was created (RFC 3339).
    pub created_at: String,
    /// When the session will be deleted if it is not used (RFC 3339).
    ///
    /// Absent if sessions do not expire, and in lists.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expires_at: Option<String>,
    /// Total stored size, bytes.
    pub bytes: u64,
    /// Parts by name.
    ///
    /// The names are `ct`, `skin`, `skull`, `air`, `soft_tissue` (fat and muscle of the CT), `target`, `landmarks`, `frame` (when a client set it),
    /// `field_settings`, `field`, `mesh` and `tissue`, and `bone_0` to `bone_9` for uploaded bones.
    pub parts: BTreeMap<String, PartView>,
    /// Ids of the session's osteotomies.
    pub osteotomies: Vec<Uuid>,
    /// Ids of the session's plans.
    pub plans: Vec<Uuid>,
    /// The session's last 100 jobs, newest first.
    pub jobs: Vec<JobView>,
}

/// A page of sessions, newest first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SessionList {
    /// The sessions of this page.
    pub sessions: Vec<SessionView>,
    /// Path of the next page; absent on the last page.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
}

impl SessionView {
    /// The view of an empty session.
    pub(in crate::http) fn new(record: &SessionRecord) -> Self {
        let missing = |kind: &PartKind| (kind.as_str().to_owned(), part_view(PartState::Missing, None));
        Self {
            id: record.id.uuid(),
            label: record.label.clone(),
            settings: serde_json::from_str(&record.settings).unwrap_or_default(),
            created_at: record.created_at.clone(),
            expires_at: None,
            bytes: 0,
            parts: PartKind::ALL.iter().map(missing).collect(),
            osteotomies: Vec::new(),
            plans: Vec::new(),
            jobs: Vec::new(),
        }
    }

    pub(in crate::http) fn fill_parts(&mut self, parts: &SessionParts, jobs: &[JobRecord]) {
        for kind in PartKind::ALL {
            self.parts.insert(kind.as_str().to_owned(), view_of(kind, parts, jobs));
        }
        for bone in parts.all().iter().filter(|p| matches!(p.kind, PartKind::Bone(_))) {
            self.parts.insert(bone.kind.as_str().to_owned(), view_of(bone.kind, parts, jobs));
        }
    }
}

fn part_view(state: PartState, record: Option<&PartRecord>) -> PartView {
    PartView {
        state,
        bytes: record.map_or(0, |r| r.bytes),
        wall_s: record.map(|r| r.wall_s),
        sha256: record.map(|r| r.key.clone()),
        updated_at: record.map(|r| r.updated_at.clone()),
    }
}

pub(in crate::http) fn view_of(kind: PartKind, parts: &SessionParts, jobs: &[JobRecord]) -> PartView {
    let record = parts.get(kind);
    let maker = match kind {
        PartKind::Field => Some(JobKind::Field),
        PartKind::Mesh => Some(JobKind::Mesh),
        PartKind::Skin | PartKind::Skull | PartKind::Air | PartKind::SoftTissue => Some(JobKind::Import),
        PartKind::Ct
        | PartKind::Target
        | PartKind::Landmarks
        | PartKind::Frame
        | PartKind::FieldSettings
        | PartKind::Tissue
        | PartKind::Bone(_) => None,
    };
    let building = jobs.iter().any(|job| Some(job.kind) == maker && !job.state.has_ended());
    let stale = match kind {
        PartKind::Field => parts.require_field().is_err(),
        PartKind::Mesh => parts.require_mesh().is_err(),
        PartKind::Ct
        | PartKind::Skin
        | PartKind::Skull
        | PartKind::Air
        | PartKind::SoftTissue
        | PartKind::Target
        | PartKind::Landmarks
        | PartKind::Frame
        | PartKind::FieldSettings
        | PartKind::Tissue
        | PartKind::Bone(_) => false,
    };
    let state = match (building, record.is_some(), stale) {
        (true, ..) => PartState::Building,
        (false, false, _) => PartState::Missing,
        (false, true, true) => PartState::Stale,
        (false, true, false) if kind == PartKind::Ct && import_failed(record, jobs) => PartState::Failed,
        (false, true, false) => PartState::Ready,
    };
    part_view(state, record)
}

/// Whether the imports of a CT ended without surfaces.
///
/// A cancelled import counts only if no other import ran.
fn import_failed(ct: Option<&PartRecord>, newest_first: &[JobRecord]) -> bool {
    let is_of_ct = |job: &&JobRecord| {
        let request = serde_json::from_str::<ImportRequest>(&job.request);
        job.kind == JobKind::Import && request.is_ok_and(|request| ct.is_some_and(|ct| ct.key == request.ct_sha256))
    };
    let imports: Vec<&JobRecord> = newest_first.iter().filter(is_of_ct).collect();
    let newest = imports.iter().find(|job| job.state != JobState::Cancelled);
    newest.map_or(!imports.is_empty(), |job| job.state == JobState::Failed)
}
