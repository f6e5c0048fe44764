use crate::Service;
use prosopon_contract::{Fault, FaultKind, Halt, LandmarksDocument, WarningDocument};
use prosopon_geometry::{TriMesh, Warning};
use prosopon_planning::evaluate::GivenLandmarks;
use prosopon_session::{Case, Engine, OtherSurface, SessionParts, load_mesh};
use prosopon_store::{PartKind, SessionId};

/// Surfaces above this size are checked by the first job only, since an upload should answer soon.
const MOST_TRIANGLES: usize = 1_000_000;

/// Warnings about the landmarks and surfaces from which a job starts.
pub(crate) fn input_warnings(engine: &dyn Engine, case: &Case) -> Result<Vec<Warning>, Halt> {
    let (skin, skull) = (&case.anatomy.skin, &case.anatomy.skull);
    let other = OtherSurface { name: PartKind::Skull.as_str(), is_bone: true, mesh: skull };
    let mut found: Vec<Warning> = engine.check_surfaces(skin, &other)?.into_iter().collect();
    found.extend(engine.check_landmarks(&case.given_landmarks(), Some(skin), Some(skull))?);
    Ok(found)
}

/// Warnings about landmarks of a session, by its surfaces if it has some.
///
/// # Errors
/// The numerics', or the store's.
pub async fn landmark_warnings(
    service: &Service,
    parts: &SessionParts,
    landmarks: &LandmarksDocument,
) -> Result<Vec<WarningDocument>, Fault> {
    let (skin, skull) = (small(service, parts, PartKind::Skin).await?, small(service, parts, PartKind::Skull).await?);
    let (points, unconfirmed) = (landmarks.named_points(), landmarks.proposed.clone());
    let midline_x_mm = landmarks.midline_x_mm;
    service
        .compute(move |engine, _| {
            let given = GivenLandmarks { points: &points, unconfirmed: &unconfirmed, midline_x_mm };
            let found = engine.check_landmarks(&given, skin.as_ref(), skull.as_ref())?;
            Ok(found.into_iter().map(WarningDocument::from).collect())
        })
        .await
}

/// Warnings about a surface that was just stored, by the other surfaces and the landmarks of its session.
///
/// # Errors
/// The numerics', or the store's.
pub(super) async fn surface_warnings(
    service: &Service,
    session: SessionId,
    kind: PartKind,
) -> Result<Vec<WarningDocument>, Fault> {
    let parts = SessionParts::load(&service.store, session).await?;
    let is_other = |other: PartKind| {
        if kind == PartKind::Skin {
            matches!(other, PartKind::Skull | PartKind::Target | PartKind::Bone(_))
        } else {
            other == kind
        }
    };
    let Some(skin) = small(service, &parts, PartKind::Skin).await? else { return Ok(Vec::new()) };
    let mut others = Vec::new();
    for part in parts.all().iter().filter(|part| is_other(part.kind)) {
        if let Some(mesh) = small(service, &parts, part.kind).await? {
            others.push((part.kind, mesh));
        }
    }
    let mut found: Vec<WarningDocument> = service
        .compute(move |engine, _| {
            let mut found = Vec::new();
            for (kind, mesh) in &others {
                let is_bone = *kind != PartKind::Target;
                let other = OtherSurface { name: kind.as_str(), is_bone, mesh };
                found.extend(engine.check_surfaces(&skin, &other)?.map(WarningDocument::from));
            }
            Ok(found)
        })
        .await?;
    let places_landmarks = matches!(kind, PartKind::Skin | PartKind::Skull);
    if let Some(landmarks) = parts.landmarks()?.filter(|_| places_landmarks) {
        found.extend(landmark_warnings(service, &parts, &landmarks).await?);
    }
    Ok(found)
}

/// The surface of a part, if there is one and it is not too large.
async fn small(service: &Service, parts: &SessionParts, kind: PartKind) -> Result<Option<TriMesh>, Fault> {
    let Some(part) = parts.get(kind) else { return Ok(None) };
    match load_mesh(&service.store, part).await {
        Ok(mesh) => Ok((mesh.triangles().len() <= MOST_TRIANGLES).then_some(mesh)),
        // The upload that replaces a damaged part must not fail on it; a job that needs the part reports it.
        Err(fault) if fault.kind == FaultKind::DamagedValue => Ok(None),
        Err(fault) => Err(fault),
    }
}
