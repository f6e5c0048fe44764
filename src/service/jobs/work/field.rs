use std::time::Instant;

use super::{Context, Done, changed_meanwhile};
use crate::requests::FieldTask;
use crate::running::Phase;
use prosopon_contract::{FieldDocument, Halt, to_json};
use prosopon_session::Kept;
use prosopon_store::{PartKind, PartRecord};

/// Builds the distance fields of the session's surfaces.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let request: FieldTask = context.request()?;
    let parts = context.parts().await?;
    if parts.field_key()? != request.key {
        return Err(changed_meanwhile().into());
    }
    let case = context.case(&parts).await?;
    let started = Instant::now();
    context.running.set_phase(Phase::Field);
    let ((skin, bone, warnings), kept) = context
        .compute(move |engine, control| {
            let built = engine.fields(&case, control)?;
            Ok((built, engine.bytes_of(Kept::Fields, &case.key)))
        })
        .await?;
    let wall_s = started.elapsed().as_secs_f64();
    let document = FieldDocument {
        settings: request.settings,
        skin: (&skin).into(),
        bone: (&bone).into(),
        findings: warnings.iter().cloned().collect(),
    };
    let document = to_json("the document of the job", &document)?;
    let report = PartRecord { key: request.key, wall_s, ..PartRecord::of_document(PartKind::Field, document) };
    context.put_derived(report, kept).await?;
    Ok(Done { warnings: warnings.into_iter().map(Into::into).collect(), ..Done::default() })
}
