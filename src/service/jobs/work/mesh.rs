use std::time::Instant;

use super::{Context, Done, changed_meanwhile};
use crate::requests::MeshTask;
use crate::running::Phase;
use crate::tasks::input_warnings;
use prosopon_contract::{D1ReadingName, Halt, MeshDocument, PresetName, to_json};
use prosopon_geometry::Warning;
use prosopon_session::Kept;
use prosopon_store::{PartKind, PartRecord};
use prosopon_tissue::mesh::Tissue;

/// Stability warnings that a solve on this mesh would have.
fn unstable(preset: PresetName) -> Vec<Warning> {
    let materials = preset.materials(D1ReadingName::default());
    Tissue::ALL.into_iter().filter_map(|t| materials.of(t).stability_warning(t.name())).collect()
}

/// Builds the tissue mesh of the session.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let request: MeshTask = context.request()?;
    let parts = context.parts().await?;
    let tissue = parts.tissue_request(&request.settings, request.cuts.as_deref())?;
    if tissue.key != request.key {
        return Err(changed_meanwhile().into());
    }
    let case = context.case(&parts).await?;
    let started = Instant::now();
    context.running.set_phase(Phase::Mesh);
    let built = context
        .compute(move |engine, control| {
            let mut built = engine.tissue(&case, &tissue, control)?;
            built.warnings.extend(input_warnings(engine, &case)?);
            Ok((built, engine.bytes_of(Kept::Tissue, &tissue.key)))
        })
        .await;
    let (mut report, kept) = built.map_err(|halt| context.cuts_of(request.osteotomy_id, "/osteotomy", halt))?;
    report.warnings.extend(unstable(request.preset));
    let wall_s = started.elapsed().as_secs_f64();
    let osteotomy = request.osteotomy_id.map(|id| id.to_string());
    let document = MeshDocument { cuts: request.cuts, ..MeshDocument::new(request.settings, osteotomy, &report) };
    let document = to_json("the document of the job", &document)?;
    let stored = PartRecord { key: request.key, wall_s, ..PartRecord::of_document(PartKind::Mesh, document) };
    context.put_derived(stored, kept).await?;
    Ok(Done { warnings: report.warnings.into_iter().map(Into::into).collect(), ..Done::default() })
}
