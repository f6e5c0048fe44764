use std::time::Instant;

use super::report::read;
use super::{Context, Done, changed_meanwhile};
use crate::requests::ImportRequest;
use crate::running::Phase;
use prosopon_contract::{CtDocument, Fault, Halt, OriginKind, SurfaceDocument, SurfaceOrigin, WarningDocument};
use prosopon_geometry::Warning;
use prosopon_planning::surface::CtSettings;
use prosopon_session::{PreparedSurface, SessionParts, read_part, surface_part};
use prosopon_store::{JobFilter, JobKind, JobState, PartKind, PartRecord, encode_grid, now_rfc3339};

/// Extracts skin, skull, air and soft tissue from the session's CT.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let parts = context.parts().await?;
    // The job's row gets the findings of reading also when it fails, since they may say why it does.
    let read: CtDocument = read(&parts.require(PartKind::Ct)?.document)?;
    read.findings.iter().for_each(|finding| context.running.warn(finding.clone()));
    let (records, mut warnings) = make(context, &parts, context.request()?).await?;
    warnings.retain(|warning| !read.findings.iter().any(|known| known == warning));
    let store = &context.service.store;
    context.service.persist(|| store.put_parts(context.job.session, &records)).await?;
    if !records.iter().any(|part| part.kind == PartKind::Air) {
        store.delete_part(context.job.session, PartKind::Air).await?;
    }
    Ok(Done { warnings, ..Done::default() })
}

/// Imports the session's CT again because a part made from it is damaged.
///
/// Stores only parts that are identical to the stored ones; parts that were uploaded later stay. Returns the session's parts, or
/// `None` when the damaged part does not come from the CT.
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
        | PartKind::Frame
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
    let (mut made, _) = make(context, parts, request).await?;
    let now = context.parts().await?;
    let (same, other): (Vec<_>, Vec<_>) =
        made.drain(..).partition(|made| now.get(made.kind).is_some_and(|there| there.key == made.key));
    let store = &context.service.store;
    for part in other.iter().filter_map(|part| part.blob.as_deref()) {
        store.blobs().delete(part).await;
    }
    if !same.iter().any(|made| made.kind == part.kind) {
        let detail = format!("{}; importing the CT again gives a different one", damaged.detail);
        return Err(Fault { detail, ..damaged.clone() }.into());
    }
    context.service.persist(|| store.put_parts(context.job.session, &same)).await?;
    tracing::warn!(part = part.kind.as_str(), "a damaged part was made again from the CT");
    let message = format!("the stored {} was damaged and was made again from the CT", part.kind.as_str());
    context.running.warn(Warning::info("made-again", message).into());
    Ok(Some(context.parts().await?))
}

/// Rows of the parts of a CT, whose blobs are stored, and warnings.
async fn make(
    context: &Context,
    parts: &SessionParts,
    request: ImportRequest,
) -> Result<(Vec<PartRecord>, Vec<WarningDocument>), Halt> {
    let ct = parts.require(PartKind::Ct)?;
    if ct.key != request.ct_sha256 {
        return Err(changed_meanwhile().into());
    }
    let store = &context.service.store;
    let document: CtDocument = read(&ct.document)?;
    let bytes = context.unless_stopped(read_part(store, ct)).await?;
    let started = Instant::now();
    context.running.set_phase(Phase::Surfaces);
    let origin =
        SurfaceOrigin { kind: OriginKind::Ct, format: document.format, bytes: document.bytes, sha256: document.sha256 };
    let (surfaces, soft_tissue, warnings) = context
        .compute(move |engine, control| {
            let found = engine.surfaces(&bytes, &CtSettings::from(&request), control)?;
            drop(bytes);
            let mut warnings: Vec<WarningDocument> = document.findings.iter().cloned().collect();
            warnings.extend(found.warnings.into_iter().map(WarningDocument::from));
            let prepare = |mesh, warnings| PreparedSurface::new(mesh, origin.clone(), warnings);
            let mut surfaces = vec![
                (PartKind::Skin, prepare(&found.skin, warnings.clone())?),
                (PartKind::Skull, prepare(&found.skull, Vec::new())?),
            ];
            if let Some(air) = &found.air {
                surfaces.push((PartKind::Air, prepare(air, Vec::new())?));
            }
            Ok((surfaces, encode_grid(&found.soft_tissue), warnings))
        })
        .await?;
    context.running.set_phase(Phase::Writing);
    let mut records = Vec::new();
    for (kind, surface) in surfaces {
        // The skin gets the whole time, so that the sum over the parts is right.
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
    Ok((records, warnings))
}
