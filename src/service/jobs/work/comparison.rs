use super::{Context, Done, changed_meanwhile, to_json};
use crate::Comparison;
use crate::requests::CompareRecord;
use crate::running::Phase;
use crate::tasks::{Predictions, StoredComparison, load_surface, named_surface};
use prosopon_session::Halt;
use prosopon_store::encode_mesh;

/// Compares two stored surfaces and stores the surface with its values.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let request: CompareRecord = context.request()?;
    let (service, store) = (&context.service, &context.service.store);
    let prediction = named_surface(service, request.prediction).await?;
    let reference = named_surface(service, request.reference).await?;
    if [&prediction.key, &reference.key] != [&request.keys[0], &request.keys[1]] {
        return Err(changed_meanwhile().into());
    }
    let comparison = Comparison {
        prediction: context.unless_stopped(load_surface(service, request.prediction)).await?,
        reference: context.unless_stopped(load_surface(service, request.reference)).await?.mesh,
        reference_name: reference.name,
        predictions: Predictions::of_surfaces(service, [request.prediction, request.reference]).await?,
        mask: (&request.mask).into(),
        exclude: request.exclude.iter().map(Into::into).collect(),
        exclude_eyes: request.exclude_eyes,
        face_only: false,
        register: request.register.as_ref().map(Into::into),
    };
    context.running.set_phase(Phase::Compare);
    let compared = context.compute(move |engine, control| comparison.run(engine, control)).await?;

    context.running.set_phase(Phase::Writing);
    let rest = context.put(encode_mesh(&compared.mesh)).await?;
    context.service.persist(|| store.set_rest(&context.job, &rest)).await?;
    let report = to_json(&compared.document)?;
    let values = StoredComparison::encode(&compared);
    let values = context.put(values).await?;
    Ok(Done { report: Some(report), tissue: Some(values), warnings: Vec::new() })
}
