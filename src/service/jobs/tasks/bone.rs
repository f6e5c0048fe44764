use std::time::Instant;

use crate::Service;
use crate::kept::case_of;
use prosopon_contract::{Cuts, Fault, FrameDocument, Halt, OsteotomyDocument, PlanDocument, to_json};
use prosopon_geometry::Warning;
use prosopon_geometry::control::Control;
use prosopon_planning::plan::{Cut, Plan, Proposal};
use prosopon_session::{Case, Engine, SessionParts};
use prosopon_store::{OsteotomyId, OsteotomyRecord, PartKind, SessionId, encode_mesh, now_rfc3339};

/// Cuts the bone of a session and stores the segments' surfaces; the caller inserts the returned row.
///
/// # Errors
/// The numerics' for unusable cuts, or the store's.
pub async fn cut_bone(
    service: &Service,
    session: SessionId,
    parts: &SessionParts,
    cuts: Cuts,
    label: Option<String>,
) -> Result<(OsteotomyRecord, OsteotomyDocument), Fault> {
    parts.require_nested()?;
    let case = case_of(service, parts).await?;
    let field_key = case.key.clone();
    let templates: Vec<String> = cuts.templates.iter().map(|t| t.template.name().to_owned()).collect();
    let from_template = cuts.cuts.is_empty().then_some("/templates");
    let started = Instant::now();
    let (document, surfaces) = service
        .compute(move |engine, control| {
            let (osteotomy, clearances) = engine.cut(&case, &cuts, control)?;
            let document = OsteotomyDocument::new(label, templates, &osteotomy, &cuts.protected, &clearances);
            let surfaces: Vec<Vec<u8>> = osteotomy.segments.iter().map(|s| encode_mesh(&s.surface)).collect();
            Ok((document, surfaces))
        })
        .await
        .map_err(|fault| from_template.map_or(fault.clone(), |pointer| fault.with_cuts_at(pointer)))?;
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
        document: to_json("the osteotomy", &document)?,
        blobs,
        created_at: now_rfc3339(),
    };
    Ok((record, document))
}

/// The cuts that a request would make in the bone of a session, without cutting it.
///
/// # Errors
/// The numerics' for templates that cannot be placed, or the store's.
pub async fn place_cuts(
    service: &Service,
    parts: &SessionParts,
    cuts: Cuts,
) -> Result<(Vec<Cut>, Vec<Warning>), Fault> {
    parts.require_nested()?;
    let case = case_of(service, parts).await?;
    service.compute(move |engine, control| engine.place(&case, &cuts, control)).await
}

/// The frame of the head of a session, in which the numerics run.
///
/// # Errors
/// [`FaultKind::NotFound`](prosopon_contract::FaultKind::NotFound) when skin or skull is missing, or the store's.
pub async fn frame_of(service: &Service, parts: &SessionParts) -> Result<FrameDocument, Fault> {
    parts.require(PartKind::Skin)?;
    parts.require(PartKind::Skull)?;
    let case = case_of(service, parts).await?;
    service.compute(move |engine, control| Ok(FrameDocument::from(&engine.frame(&case, control)?))).await
}

/// Proposes landmarks from the skin and skull of a session.
///
/// # Errors
/// [`FaultKind::NotFound`](prosopon_contract::FaultKind::NotFound) when skin or skull is missing, or the store's.
pub async fn propose_landmarks(service: &Service, parts: &SessionParts) -> Result<Proposal, Fault> {
    parts.require(PartKind::Skin)?;
    parts.require(PartKind::Skull)?;
    let case = case_of(service, parts).await?;
    service.compute(move |engine, control| engine.propose(&case, control)).await
}

/// A plan with the displacements along its paths.
///
/// # Errors
/// The numerics' for unusable paths, or the store's.
pub async fn make_plan(
    service: &Service,
    parts: &SessionParts,
    cuts: Vec<Cut>,
    plan: Plan,
    label: Option<String>,
) -> Result<PlanDocument, Fault> {
    let case = case_of(service, parts).await?;
    let started = Instant::now();
    service
        .compute(move |engine, control| {
            let reports = engine.outline(&case, &cuts, &plan, control)?;
            Ok::<_, Halt>(PlanDocument::new(label, &plan).reported(&reports, started.elapsed().as_secs_f64()))
        })
        .await
        .map_err(|fault| fault.with_cuts_at("/osteotomy"))
}

/// The same plan with overlaps and gaps of bone along its paths.
///
/// # Errors
/// The numerics', or the store's.
pub async fn measure_plan(
    service: &Service,
    parts: &SessionParts,
    cuts: Vec<Cut>,
    plan: PlanDocument,
) -> Result<PlanDocument, Fault> {
    let case = case_of(service, parts).await?;
    service
        .compute(move |engine, control| measured(engine, &case, &cuts, plan, control))
        .await
        .map_err(|fault| fault.with_cuts_at("/osteotomy"))
}

/// As [`measure_plan`], on the thread of the caller.
pub(crate) fn measured(
    engine: &dyn Engine,
    case: &Case,
    cuts: &[Cut],
    plan: PlanDocument,
    control: &Control,
) -> Result<PlanDocument, Halt> {
    let started = Instant::now();
    let reports = engine.follow(case, cuts, &plan.plan()?, control)?;
    Ok(PlanDocument { measured: true, ..plan.reported(&reports, started.elapsed().as_secs_f64()) })
}
