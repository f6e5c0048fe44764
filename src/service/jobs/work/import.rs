use std::time::Instant;

use super::report::read;
use super::{Context, Done, changed_meanwhile};
use crate::requests::ImportRequest;
use crate::running::Phase;
use prosopon_planning::surface::CtSettings;
use prosopon_session::{
    CtDocument, Fault, FaultKind, Halt, PreparedSurface, SessionParts, SurfaceDocument, SurfaceOrigin, read_part,
    surface_part,
};
use prosopon_store::{JobFilter, JobKind, JobState, PartKind, PartRecord, encode_grid, now_rfc3339};

/// Skin, skull, air and soft tissue of the session's CT.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let parts = context.parts().await?;
    make(context, &parts, context.request()?).await
}

/// The last import of the session's CT once more, for a part of it that is damaged: the parts, and what the job tells of it. `None`
/// where that part is not from a CT that is there.
pub(super) async fn again(
    context: &Context,
    parts: &SessionParts,
    damaged: &Fault,
) -> Result<Option<SessionParts>, Halt> {
    let part = parts.all().iter().find(|part| damaged.facts.get("part").is_some_and(|name| name == part.kind.as_str()));
    let (Some(part), Some(ct)) = (part, parts.get(PartKind::Ct)) else { return Ok(None) };
    let is_from_ct = match part.kind {
        PartKind::SoftTissue => true,
        PartKind::Skin | PartKind::Skull | PartKind::Air => {
            read::<SurfaceDocument>(&part.document)?.origin.sha256 == read::<CtDocument>(&ct.document)?.sha256
        }
        PartKind::Ct
        | PartKind::Target
        | PartKind::Landmarks
        | PartKind::FieldSettings
        | PartKind::Field
        | PartKind::Mesh
        | PartKind::Tissue
        | PartKind::Bone(_) => false,
    };
    let imports = JobFilter {
        session: Some(context.job.session),
        kind: Some(JobKind::Import),
        state: Some(JobState::Succeeded),
        limit: 1,
        ..JobFilter::default()
    };
    let imports = context.service.store.jobs(&imports).await?;
    let Some(last) = imports.first().filter(|_| is_from_ct) else { return Ok(None) };
    let request: ImportRequest = read(&last.request)?;
    tracing::warn!(part = part.kind.as_str(), "a damaged part is made again from the CT");
    context.running.warn(format!("the stored {} was damaged and was made again from the CT", part.kind.as_str()));
    make(context, parts, request).await?;
    let made = context.parts().await?;
    if made.get(part.kind).is_some_and(|made| made.key == part.key) {
        return Ok(Some(made));
    }
    Err(Fault::new(FaultKind::Stale, format!("{}; what its CT gives now differs: import it again", damaged.detail))
        .into())
}

async fn make(context: &Context, parts: &SessionParts, request: ImportRequest) -> Result<Done, Halt> {
    let ct = parts.require(PartKind::Ct)?;
    if ct.key != request.ct_sha256 {
        return Err(changed_meanwhile().into());
    }
    let store = &context.service.store;
    let document: CtDocument = read(&ct.document)?;
    let bytes = context.unless_stopped(read_part(store, ct)).await?;
    let started = Instant::now();
    context.running.set_phase(Phase::Surfaces);
    let origin = SurfaceOrigin {
        kind: "ct".to_owned(),
        format: document.format,
        bytes: document.bytes,
        sha256: document.sha256,
    };
    let (surfaces, soft_tissue, warnings) = context
        .compute(move |engine, control| {
            let mut found = engine.surfaces(&bytes, &CtSettings::from(&request), control)?;
            found.warnings.splice(0..0, document.warnings);
            drop(bytes);
            let prepare = |mesh, warnings| PreparedSurface::new(mesh, origin.clone(), warnings);
            let mut surfaces = vec![
                (PartKind::Skin, prepare(&found.skin, found.warnings.clone())?),
                (PartKind::Skull, prepare(&found.skull, Vec::new())?),
            ];
            if let Some(air) = &found.air {
                surfaces.push((PartKind::Air, prepare(air, Vec::new())?));
            }
            Ok((surfaces, encode_grid(&found.soft_tissue), found.warnings))
        })
        .await?;
    context.running.set_phase(Phase::Writing);
    let has_air = surfaces.iter().any(|(kind, _)| *kind == PartKind::Air);
    let mut records = Vec::new();
    for (kind, surface) in surfaces {
        // The whole time is booked on the skin, so that the sum over the parts is right.
        let wall_s = if kind == PartKind::Skin { started.elapsed().as_secs_f64() } else { 0.0 };
        records.push(surface_part(store, context.job.session, kind, surface, wall_s).await?.0);
    }
    let blob = context.put(soft_tissue).await?;
    records.push(PartRecord {
        kind: PartKind::SoftTissue,
        key: blob.sha256,
        blob: Some(blob.key),
        bytes: blob.bytes,
        wall_s: 0.0,
        document: "{}".to_owned(),
        updated_at: now_rfc3339(),
    });
    context.service.persist(|| store.put_parts(context.job.session, &records)).await?;
    if !has_air {
        store.delete_part(context.job.session, PartKind::Air).await?;
    }
    Ok(Done { warnings, ..Done::default() })
}
