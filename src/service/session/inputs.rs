use std::sync::Arc;

use bytes::Bytes;
use serde::de::DeserializeOwned;

use super::{Case, TissueRequest, key_of};
use prosopon_contract::{
    CutDocument, Fault, FaultKind, FieldDocument, FieldSettingsDocument, FrameRequest, LandmarksDocument, MeshDocument,
    MeshRequest, SurfaceDocument, TissueDocument, from_json, stored_cuts, to_json,
};
use prosopon_geometry::TriMesh;
use prosopon_planning::simulate::Anatomy;
use prosopon_store::{PartKind, PartRecord, SessionId, Store, decode_grid, decode_mesh};

/// Allowed difference of the boxes of surfaces that end at the same plane, mm.
const BOX_SLACK_MM: f64 = 1.0;

/// The parts of one session, with checks of what they allow.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionParts {
    session: SessionId,
    parts: Vec<PartRecord>,
}

impl SessionParts {
    /// Reads the parts of a session.
    ///
    /// # Errors
    /// [`FaultKind::NotFound`], [`FaultKind::Gone`], or the store's.
    pub async fn load(store: &Store, session: SessionId) -> Result<Self, Fault> {
        if store.session(session).await?.is_none() {
            return Err(if store.is_deleted(&session.to_string()).await? {
                Fault::new(FaultKind::Gone, format!("session {session} was deleted"))
            } else {
                Fault::new(FaultKind::NotFound, format!("there is no session {session}"))
            });
        }
        Ok(Self { session, parts: store.parts(session).await? })
    }

    /// Wraps parts of a session that were read already.
    #[must_use]
    pub fn of(session: SessionId, parts: Vec<PartRecord>) -> Self {
        Self { session, parts }
    }

    /// All parts.
    #[must_use]
    pub fn all(&self) -> &[PartRecord] {
        &self.parts
    }

    /// The part of a kind; `None` when there is none.
    #[must_use]
    pub fn get(&self, kind: PartKind) -> Option<&PartRecord> {
        self.parts.iter().find(|p| p.kind == kind)
    }

    /// The part of a kind, which must exist.
    ///
    /// # Errors
    /// [`FaultKind::NotFound`].
    pub fn require(&self, kind: PartKind) -> Result<&PartRecord, Fault> {
        let name = kind.as_str();
        self.get(kind)
            .ok_or_else(|| Fault::new(FaultKind::NotFound, format!("the session has no {name}; upload or build it")))
    }

    /// Uploaded bones with their segments, in ascending order of segments.
    #[must_use]
    pub fn bones(&self) -> Vec<(u32, &PartRecord)> {
        let mut bones: Vec<_> = self.parts.iter().filter_map(|p| Some((p.kind.segment()?, p))).collect();
        bones.sort_by_key(|(segment, _)| *segment);
        bones
    }

    /// Segments and keys of the uploaded bones.
    #[must_use]
    pub fn bone_keys(&self) -> Vec<(u32, String)> {
        self.bones().into_iter().map(|(segment, part)| (segment, part.key.clone())).collect()
    }

    /// Description of the uploaded tissue mesh; `None` when there is none.
    ///
    /// # Errors
    /// [`FaultKind::Internal`].
    pub fn tissue(&self) -> Result<Option<TissueDocument>, Fault> {
        self.document(PartKind::Tissue)
    }

    /// Description of the uploaded tissue mesh, which must exist; `next` tells the client what to do.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`], [`FaultKind::Internal`].
    pub fn require_tissue(&self, next: &str) -> Result<TissueDocument, Fault> {
        self.tissue()?.ok_or_else(|| self.missing(&["tissue"], next))
    }

    fn document<T: DeserializeOwned>(&self, kind: PartKind) -> Result<Option<T>, Fault> {
        let Some(part) = self.get(kind) else { return Ok(None) };
        from_json(kind.as_str(), &part.document).map(Some)
    }

    /// Settings of the distance fields, or the defaults.
    ///
    /// # Errors
    /// [`FaultKind::Internal`] when the stored document cannot be read.
    pub fn field_settings(&self) -> Result<FieldSettingsDocument, Fault> {
        Ok(self.document(PartKind::FieldSettings)?.unwrap_or_default())
    }

    /// Landmarks; `None` when none were given.
    ///
    /// # Errors
    /// [`FaultKind::Internal`].
    pub fn landmarks(&self) -> Result<Option<LandmarksDocument>, Fault> {
        self.document(PartKind::Landmarks)
    }

    /// The frame of the head that a client set; `None` when it is estimated.
    ///
    /// # Errors
    /// [`FaultKind::Internal`].
    pub fn frame(&self) -> Result<Option<FrameRequest>, Fault> {
        self.document(PartKind::Frame)
    }

    /// Key of the fields for the current inputs and settings.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`] when skin or skull are missing.
    pub fn field_key(&self) -> Result<String, Fault> {
        self.require_surfaces()?;
        let key = |kind| self.get(kind).map_or("", |p| p.key.as_str());
        let settings = to_json("the settings of the fields", &self.field_settings()?)?;
        let surfaces = [PartKind::Skin, PartKind::Skull, PartKind::Air, PartKind::Frame].map(key);
        Ok(key_of(&[&["field"], &surfaces[..], &[settings.as_str()]].concat()))
    }

    fn missing(&self, names: &[&str], next: &str) -> Fault {
        let detail = format!("{} missing: {next}", names.join(" and "));
        let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
        Fault::new(FaultKind::MissingInput, detail).with("missing", names)
    }

    /// Checks that skin and skull exist.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`].
    pub fn require_surfaces(&self) -> Result<(), Fault> {
        let missing: Vec<&str> = [PartKind::Skin, PartKind::Skull]
            .into_iter()
            .filter(|k| self.get(*k).is_none())
            .map(PartKind::as_str)
            .collect();
        if missing.is_empty() {
            return Ok(());
        }
        let has_ct = self.get(PartKind::Ct).is_some();
        let next = if has_ct { "the import of the CT has not succeeded" } else { "PUT them, or a CT, first" };
        Err(self.missing(&missing, next))
    }

    /// Number of vertices of the skull; `None` when there is no skull.
    ///
    /// # Errors
    /// [`FaultKind::Internal`].
    pub fn skull_vertices(&self) -> Result<Option<usize>, Fault> {
        Ok(self.document::<SurfaceDocument>(PartKind::Skull)?.map(|skull| skull.vertices))
    }

    /// Checks by their boxes that skin and skull belong together; building the field checks more closely.
    ///
    /// # Errors
    /// [`FaultKind::AnatomyNotUsable`], [`FaultKind::MissingInput`].
    pub fn require_nested(&self) -> Result<(), Fault> {
        self.require_surfaces()?;
        let skin: Option<SurfaceDocument> = self.document(PartKind::Skin)?;
        let skull: Option<SurfaceDocument> = self.document(PartKind::Skull)?;
        let (Some(skin), Some(skull)) = (skin, skull) else { return Ok(()) };
        let axes = [0, 1, 2];
        let inside = |a: usize| {
            skin.min_mm[a] > skull.min_mm[a] - BOX_SLACK_MM && skin.max_mm[a] < skull.max_mm[a] + BOX_SLACK_MM
        };
        let apart = |a: usize| skin.min_mm[a] > skull.max_mm[a] || skin.max_mm[a] < skull.min_mm[a];
        let detail = if axes.into_iter().all(inside) {
            "the skin lies inside the bounding box of the skull; check whether the two files are swapped"
        } else if axes.into_iter().any(apart) {
            "skin and skull do not overlap; check that both use the same frame (LPS) and unit (mm)"
        } else {
            return Ok(());
        };
        Err(Fault::new(FaultKind::AnatomyNotUsable, detail))
    }

    /// The report of the fields, which must have been built from the current inputs.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`], [`FaultKind::Stale`].
    pub fn require_field(&self) -> Result<FieldDocument, Fault> {
        let key = self.field_key()?;
        let next = format!("POST /v1/sessions/{}/field first", self.session);
        let Some(part) = self.get(PartKind::Field) else { return Err(self.missing(&["field"], &next)) };
        if part.key != key {
            let detail = format!("the field was built from inputs or settings that have changed since; {next}");
            return Err(Fault::new(FaultKind::Stale, detail).with("stale", "field"));
        }
        self.document(PartKind::Field)?.ok_or_else(|| self.missing(&["field"], &next))
    }

    /// The report of the mesh that was built last; `None` when there is none.
    ///
    /// # Errors
    /// [`FaultKind::Internal`].
    pub fn mesh(&self) -> Result<Option<MeshDocument>, Fault> {
        self.document(PartKind::Mesh)
    }

    /// The report of the mesh, which must have been built from the current inputs.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`], [`FaultKind::Stale`].
    pub fn require_mesh(&self) -> Result<MeshDocument, Fault> {
        self.require_surfaces()?;
        let next = format!("POST /v1/sessions/{}/mesh first", self.session);
        let (Some(part), Some(mesh)) = (self.get(PartKind::Mesh), self.mesh()?) else {
            return Err(self.missing(&["mesh"], &next));
        };
        if part.key != self.mesh_key(&mesh.settings, mesh.cuts.as_deref())? {
            let detail = format!("the mesh was built from inputs or settings that have changed since; {next}");
            return Err(Fault::new(FaultKind::Stale, detail).with("stale", "mesh"));
        }
        Ok(mesh)
    }

    /// Key of a mesh with these settings and cuts for the current inputs.
    ///
    /// # Errors
    /// As [`SessionParts::field_key`].
    pub fn mesh_key(&self, settings: &MeshRequest, cuts: Option<&[CutDocument]>) -> Result<String, Fault> {
        let landmarks = self.get(PartKind::Landmarks).map_or("", |p| p.key.as_str());
        let text = to_json("settings of a mesh", &MeshRequest { osteotomy: None, ..settings.clone() })?;
        let cuts = to_json("cuts of a mesh", &cuts)?;
        let field = self.field_key()?;
        let mut made_from = vec!["mesh", &field, landmarks, &text, &cuts];
        let soft_tissue = self.get(PartKind::SoftTissue).filter(|_| !settings.tissue_by_depth);
        made_from.extend(soft_tissue.map(|part| part.key.as_str()));
        Ok(key_of(&made_from))
    }

    /// Reads the surfaces and returns the patient case for the numerics.
    ///
    /// # Errors
    /// [`FaultKind::MissingInput`], or the store's.
    pub async fn case(&self, store: &Store) -> Result<Case, Fault> {
        let key = self.field_key()?;
        let landmarks = self.landmarks()?;
        let air = match self.get(PartKind::Air) {
            Some(part) => Some(load_mesh(store, part).await?),
            None => None,
        };
        let soft_tissue = match self.get(PartKind::SoftTissue) {
            Some(part) => Some(decode_grid(&read_part(store, part).await?)?.into()),
            None => None,
        };
        let anatomy = Anatomy {
            skin: load_mesh(store, self.require(PartKind::Skin)?).await?,
            skull: load_mesh(store, self.require(PartKind::Skull)?).await?,
            air,
            soft_tissue,
            landmarks: landmarks.as_ref().map(LandmarksDocument::named_points).unwrap_or_default(),
            midline_x_mm: landmarks.as_ref().and_then(|l| l.midline_x_mm),
        };
        Ok(Case {
            anatomy: Arc::new(anatomy),
            fields: (&self.field_settings()?).into(),
            key,
            midline_x_mm: landmarks.as_ref().and_then(|l| l.midline_x_mm),
            occlusal_z_mm: landmarks.as_ref().and_then(|l| l.occlusal_plane_z_mm),
            unconfirmed: landmarks.map(|l| l.proposed).unwrap_or_default(),
            frame: self.frame()?.map(|frame| frame.motion()),
        })
    }

    /// The request of a tissue mesh with these settings and cuts.
    ///
    /// # Errors
    /// As [`SessionParts::field_key`].
    pub fn tissue_request(&self, settings: &MeshRequest, cuts: Option<&[CutDocument]>) -> Result<TissueRequest, Fault> {
        Ok(TissueRequest {
            settings: settings.into(),
            cuts: cuts.map(stored_cuts).transpose()?,
            key: self.mesh_key(settings, cuts)?,
        })
    }
}

/// Reads the surface of a part.
///
/// # Errors
/// [`FaultKind::NotFound`] when the part has no surface, or the store's.
pub async fn load_mesh(store: &Store, part: &PartRecord) -> Result<TriMesh, Fault> {
    if part.blob.is_none() {
        return Err(Fault::new(FaultKind::NotFound, format!("{} is not a surface", part.kind.as_str())));
    }
    Ok(decode_mesh(&read_part(store, part).await?)?)
}

/// Reads the blob of a part.
///
/// # Errors
/// [`FaultKind::DamagedValue`] with the part's name, or the store's.
pub async fn read_part(store: &Store, part: &PartRecord) -> Result<Bytes, Fault> {
    let name = part.kind.as_str();
    store.blobs().get(part.blob.as_deref().unwrap_or_default()).await.map_err(|error| match Fault::from(error) {
        fault if fault.kind == FaultKind::DamagedValue => {
            let detail =
                format!("the stored {name}: {}; upload it again, or the CT that it was made from", fault.detail);
            Fault { detail, ..fault }.with("part", name)
        }
        other => other,
    })
}
