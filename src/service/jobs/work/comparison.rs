use super::{Context, Done, changed_meanwhile};
use crate::Comparison;
use crate::requests::CompareTask;
use crate::running::Phase;
use crate::tasks::{Predictions, StoredComparison, load_surface, named_surface};
use prosopon_contract::{Halt, to_json};
use prosopon_store::encode_mesh;

/// Compares two stored surfaces and stores the surface with its values.
pub(super) async fn perform(context: &Context) -> Result<Done, Halt> {
    let request: CompareTask = context.request()?;
    let (service, store) = (&context.service, &context.service.store);
    let checked = request.request.checked()?;
    let prediction = named_surface(service, checked.prediction).await?;
    let reference = named_surface(service, checked.reference).await?;
    if [&prediction.key, &reference.key] != [&request.keys[0], &request.keys[1]] {
        return Err(changed_meanwhile().into());
    }
    let comparison = Comparison {
        prediction: context.unless_stopped(load_surface(service, checked.prediction)).await?,
        reference: context.unless_stopped(load_surface(service, checked.reference)).await?.mesh,
        reference_name: reference.name,
        predictions: Predictions::of_surfaces(service, [checked.prediction, checked.reference]).await?,
        mask: checked.mask,
        exclude: checked.exclude,
        exclude_eyes: request.request.exclude_eyes,
        face_only: false,
        register: checked.register,
    };
    context.running.set_phase(Phase::Compare);
    let compared = context.compute(move |engine, control| comparison.run(engine, control)).await?;

    context.running.set_phase(Phase::Writing);
    let rest = context.put(encode_mesh(&compared.mesh)).await?;
    context.service.persist(|| store.set_rest(&context.job, &rest)).await?;
    let report = to_json("the comparison", &compared.document)?;
    let values = StoredComparison::encode(&compared);
    let values = context.put(values).await?;
    Ok(Done { report: Some(report), tissue: Some(values), ..Done::default() })
}
