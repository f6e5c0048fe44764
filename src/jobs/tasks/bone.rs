use std::time::Instant;

use crate::jobs::Service;
use crate::plan::{BoundedPlane, Plan};
use crate::session::{Cuts, Fault, Halt, OsteotomyDocument, PathReportDocument, PlanDocument, SessionParts};
use crate::store::{OsteotomyId, OsteotomyRecord, SessionId, encode_mesh, now_rfc3339};

/// Cuts the session's bone and stores the segments' surfaces; the row is the caller's to insert.
///
/// # Errors
/// What the numerics say of the cuts, or the store's.
pub async fn cut_bone(
    service: &Service,
    session: SessionId,
    parts: &SessionParts,
    cuts: Cuts,
    label: Option<String>,
) -> Result<(OsteotomyRecord, OsteotomyDocument), Fault> {
    parts.require_field()?;
    let case = parts.case(&service.store).await?;
    let field_key = case.key.clone();
    let template = match cuts {
        Cuts::Planes(_) => None,
        Cuts::LeFort1 { .. } => Some("le_fort_1".to_owned()),
    };
    let is_template = template.is_some();
    let started = Instant::now();
    let (document, surfaces) = service
        .compute(move |engine, control| {
            let osteotomy = engine.cut(&case, &cuts, control)?;
            let document = OsteotomyDocument::new(label, template, &osteotomy);
            let surfaces: Vec<Vec<u8>> = osteotomy.segments.iter().map(|s| encode_mesh(&s.surface)).collect();
            Ok((document, surfaces))
        })
        .await
        .map_err(|fault| if is_template { fault.with_cuts_at("/template") } else { fault })?;
    let wall_s = started.elapsed().as_secs_f64();
    let mut blobs = Vec::new();
    let mut bytes = 0;
    for surface in surfaces {
        let blob = service.store.blobs().put(session, surface).await?;
        bytes += blob.bytes;
        blobs.push(blob.key);
    }
    let record = OsteotomyRecord {
        id: OsteotomyId::new(),
        session,
        field_key,
        wall_s,
        bytes,
        document: serde_json::to_string(&document).unwrap_or_default(),
        blobs,
        created_at: now_rfc3339(),
    };
    Ok((record, document))
}

/// Follows the paths of a plan through the cut bone: the plan's document with its reports.
///
/// # Errors
/// What the numerics say of the paths.
pub async fn make_plan(
    service: &Service,
    parts: &SessionParts,
    cuts: Vec<BoundedPlane>,
    plan: Plan,
    label: Option<String>,
) -> Result<PlanDocument, Fault> {
    let case = parts.case(&service.store).await?;
    let started = Instant::now();
    service
        .compute(move |engine, control| {
            let reports = engine.follow(&case, &cuts, &plan, control)?;
            let reports = reports.iter().map(PathReportDocument::from).collect();
            let wall_s = started.elapsed().as_secs_f64();
            Ok::<_, Halt>(PlanDocument { label, paths: PlanDocument::paths_of(&plan), reports, wall_s })
        })
        .await
        .map_err(|fault| fault.with_cuts_at("/osteotomy"))
}
